//! A router of Zenoh, as `rmw_zenohd` is: the nodes of a robot and its clients meet there.
//!
//!     router
//!
//! It listens at a free port of this machine, and writes `listening ENDPOINT`. It ends with its
//! standard input.

use std::io::Read;

#[tokio::main]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("error");
    let config = hiroz::config::RouterConfigBuilder::new()
        .with_listen_endpoint("tcp/127.0.0.1:0")
        .build_config()?;
    let session = zenoh::open(config).await?;
    for locator in session.info().locators().await {
        println!("listening {locator}");
    }
    let until_closed =
        tokio::task::spawn_blocking(|| std::io::stdin().read_to_end(&mut Vec::new()));
    drop(until_closed.await);
    session.close().await
}
