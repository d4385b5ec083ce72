//! The whole way: a daemon with a `turtlebot` whose robot is not ours, and a goal for it.
//!
//! The program is that of the workspace: `cargo build -p althing` before, or name another one in
//! `ALTHING`.

mod support;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use ros2_link::{RosAddress, RosDialect};
use support::{PATIENCE, Peer};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");

/// A daemon in a folder of its own. It ends with this value.
struct Daemon {
    folder: PathBuf,
    child: Option<Child>,
}

impl Daemon {
    fn start(ecosystem: &str) -> Daemon {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("althing-{}-{number}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir(&folder).expect("a new folder");
        std::fs::write(folder.join("lab.toml"), ecosystem).expect("a file");
        let mut daemon = Daemon { folder, child: None };
        let child = daemon.command(&["up", "lab.toml"]).spawn();
        daemon.child = Some(child.expect("the program starts"));
        daemon
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let program = std::env::var_os("ALTHING")
            .map_or_else(|| Path::new(ROOT).join("target/debug/althing"), PathBuf::from);
        assert!(
            program.is_file(),
            "`{}` is not there: run `cargo build -p althing`, or name the program in ALTHING",
            program.display()
        );
        let folder = &self.folder;
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(folder)
            .env("ALTHING_RUNTIME_DIR", folder.join("run"))
            .env("ALTHING_STATE_DIR", folder.join("state"))
            .env("ALTHING_PLUGINS_DIR", folder.join("plugins"))
            .stdin(Stdio::null());
        command
    }

    fn ask(&self, arguments: &[&str]) -> Output {
        let asked = self.command(&[arguments, &["--ecosystem", "lab.toml"]].concat()).output();
        asked.expect("the program runs")
    }

    fn await_fact(&self, fact: &str) {
        let began = Instant::now();
        loop {
            let state = self.ask(&["state", "--json"]);
            let known = String::from_utf8_lossy(&state.stdout).into_owned();
            if known.contains(fact) {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "{fact}: {known}");
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        drop(child.kill());
        drop(child.wait());
        drop(std::fs::remove_dir_all(&self.folder));
    }
}

/// Returns an ecosystem with the smart office's map, and this robot.
fn ecosystem(address: &RosAddress) -> String {
    let RosAddress { endpoint, dialect, namespace, domain_id } = address;
    let dialect = match dialect {
        RosDialect::Ros2Dds => "ros2dds",
        RosDialect::RmwZenoh => "rmw-zenoh",
    };
    let domain = Path::new(ROOT).canonicalize().expect("a folder").join("domains/smart-office");
    let domain = domain.display();
    let agents = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"]
        .map(|plugin| format!("[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\n\n"));
    format!(
        r#"
[ecosystem]
name = "lab"
domain = "{domain}/domain.pddl"
problem = "{domain}/map.pddl"
mode = "decentralized"

{agents}
[[agent]]
name = "turtlebot-1"
plugin = "turtlebot"
driver = "ros2"

[agent.config]
start = "corridor"

[agent.config.ros2]
endpoint = "{endpoint}"
dialect = "{dialect}"
namespace = "{namespace}"
domain-id = {domain_id}

[agent.config.ros2.places]
corridor = {{ x = 0.0, y = 0.0 }}
office1 = {{ x = 6.5, y = -1.25 }}
office2 = {{ x = -6.0, y = 0.0 }}
conf-room = {{ x = 0.0, y = 6.0 }}
"#,
        agents = agents.concat(),
    )
}

async fn robot_reaches_a_goal(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "tb1").await;
    let daemon = Daemon::start(&ecosystem(&peer.address));
    // Nobody told the robot where it stands, so the daemon does: at its `start`.
    peer.nodes.saw("initialpose").await;
    daemon.await_fact("(at turtlebot-1 corridor)");
    let asked = daemon.ask(&["goal", "(at turtlebot-1 office1)"]);
    assert!(asked.status.success(), "{asked:?}");
    assert_eq!(peer.nodes.saw("goal").await, "goal 6.5 -1.25");
    peer.nodes.saw("arrived").await;
    daemon.await_fact("(at turtlebot-1 office1)");
    // A way that is blocked fails with the reason of Nav2.
    peer.nodes.tell("behave abort 9003 the way is blocked");
    let asked = daemon.ask(&["act", "(move turtlebot-1 office1 corridor)"]);
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&asked.stdout),
        String::from_utf8_lossy(&asked.stderr)
    );
    assert!(!asked.status.success() && said.contains("the way is blocked (error 9003)"), "{said}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_on_cyclone_dds_behind_the_bridge_reaches_a_goal() {
    robot_reaches_a_goal(RosDialect::Ros2Dds).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_of_hiroz_at_a_router_reaches_a_goal() {
    robot_reaches_a_goal(RosDialect::RmwZenoh).await;
}
