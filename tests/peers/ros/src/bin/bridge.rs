//! The bridge between DDS and Zenoh: `zenoh-plugin-ros2dds` in a router of Zenoh, as the program
//! `zenoh-bridge-ros2dds` is, which is not on the registry.
//!
//!     bridge DOMAIN [NAMESPACE]
//!
//! It listens at a free port of this machine, and writes `listening ENDPOINT`. It ends with its
//! standard input.

use std::io::Read;

use zenoh::internal::{plugins::PluginsManager, runtime::RuntimeBuilder};
use zenoh_plugin_ros2dds::ROS2Plugin;

#[tokio::main]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("error");
    let mut arguments = std::env::args().skip(1);
    let domain = arguments.next().unwrap_or_default();
    let namespace = arguments.next().unwrap_or_else(|| "/".to_owned());
    let settings = format!(
        r#"{{
            mode: "router",
            listen: {{ endpoints: ["tcp/127.0.0.1:0"] }},
            scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
            timestamping: {{ enabled: true }},
            adminspace: {{ enabled: true }},
            plugins_loading: {{ enabled: true }},
            plugins: {{ ros2dds: {{ domain: {domain}, namespace: "{namespace}" }} }},
        }}"#
    );
    let mut plugins = PluginsManager::static_plugins_only();
    plugins.declare_static_plugin::<ROS2Plugin, &str>("ros2dds", true);
    let config = zenoh::Config::from_json5(&settings)?;
    let mut runtime = RuntimeBuilder::new(config).plugins_manager(plugins).build().await?;
    runtime.start().await?;
    for locator in runtime.get_locators() {
        println!("listening {locator}");
    }
    let until_closed =
        tokio::task::spawn_blocking(|| std::io::stdin().read_to_end(&mut Vec::new()));
    drop(until_closed.await);
    runtime.close().await
}
