//! The processes of a robot: its nodes, and the bridge or router that links them with Zenoh.

#![allow(dead_code, reason = "each test uses a part")]

use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use ros2_link::{Nav2Names, Nav2Robot, RosAddress, RosDialect, RosLink};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinSet;

/// How long a step may take, on a loaded machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

/// Keeps DDS within this machine.
const LOOPBACK: &str = "<CycloneDDS><Domain><General><Interfaces>\
    <NetworkInterface name=\"lo\" multicast=\"true\"/>\
    </Interfaces></General></Domain></CycloneDDS>";

/// A process that reads commands and writes events, one a line. It ends with this value.
pub(crate) struct Program {
    child: Child,
    commands: Option<ChildStdin>,
    events: UnboundedReceiver<String>,
}

/// A robot that is not ours.
pub(crate) struct Peer {
    pub(crate) nodes: Program,
    bridge: Program,
    pub(crate) address: RosAddress,
    distribution: &'static str,
}

impl Program {
    pub(crate) fn start(command: &mut Command) -> Program {
        let mut child = command
            .env("CYCLONEDDS_URI", LOOPBACK)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program of the peer is there");
        let output = child.stdout.take().expect("a pipe");
        let (sender, events) = unbounded_channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                drop(sender.send(line));
            }
        });
        Program { commands: child.stdin.take(), child, events }
    }

    pub(crate) fn tell(&mut self, command: &str) {
        let commands = self.commands.as_mut().expect("it is not closed");
        writeln!(commands, "{command}").expect("the program runs");
    }

    /// Waits for an event that begins with `word`, and returns it. Other events are skipped.
    pub(crate) async fn saw(&mut self, word: &str) -> String {
        let seen = async {
            loop {
                let event = self.events.recv().await;
                let event = event.unwrap_or_else(|| panic!("it ended before `{word}`"));
                if event.split(' ').next() == Some(word) {
                    return event;
                }
            }
        };
        let seen = tokio::time::timeout(PATIENCE, seen).await;
        seen.unwrap_or_else(|_| panic!("it did not say `{word}`"))
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        drop(self.commands.take());
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

impl Peer {
    /// Starts a robot that speaks `dialect`, and waits until its nodes run.
    pub(crate) async fn start(dialect: RosDialect, namespace: &str) -> Peer {
        Peer::of(dialect, namespace, "jazzy").await
    }

    /// Starts a robot of a distribution of ROS.
    pub(crate) async fn of(
        dialect: RosDialect,
        namespace: &str,
        distribution: &'static str,
    ) -> Peer {
        let domain_id = free_domain();
        let mut bridge = match dialect {
            RosDialect::Ros2Dds => Command::new(env!("CARGO_BIN_EXE_bridge")),
            RosDialect::RmwZenoh => Command::new(env!("CARGO_BIN_EXE_router")),
        };
        bridge.arg(domain_id.to_string()).env("ROS_DISTRO", distribution);
        let mut bridge = Program::start(&mut bridge);
        let listening = bridge.saw("listening").await;
        let endpoint = listening.split_once(' ').expect("an endpoint").1.to_owned();
        let namespace = namespace.to_owned();
        let address = RosAddress { endpoint, dialect, namespace, domain_id };
        let nodes = start_nodes(&address, distribution, None).await;
        Peer { nodes, bridge, address, distribution }
    }

    /// Ends the robot's nodes, and starts them again. They tell the pose once, when they start.
    pub(crate) async fn restart_nodes(&mut self, pose: &str) {
        self.nodes.commands = None;
        drop(self.nodes.child.wait());
        self.nodes = start_nodes(&self.address, self.distribution, Some(pose)).await;
    }

    /// Ends the robot's nodes without a farewell.
    pub(crate) fn kill_nodes(&mut self) {
        self.nodes.child.kill().expect("it runs");
    }

    pub(crate) fn kill_bridge(&mut self) {
        self.bridge.child.kill().expect("it runs");
    }

    pub(crate) fn link(&self) -> RosLink {
        link(self.address.clone())
    }

    pub(crate) fn robot(&self) -> Nav2Robot {
        Nav2Robot::new(self.link(), Nav2Names::default())
    }

    /// Returns the robot as it is seen through a relay, which can break the link.
    pub(crate) async fn robot_through_relay(&self) -> (Nav2Robot, Relay) {
        let relay = Relay::start(self.address.endpoint.trim_start_matches("tcp/")).await;
        let endpoint = format!("tcp/{}", relay.at);
        let link = link(RosAddress { endpoint, ..self.address.clone() });
        (Nav2Robot::new(link, Nav2Names::default()), relay)
    }
}

fn link(address: RosAddress) -> RosLink {
    RosLink::open(address, Arc::new(ros2_link::standard_interfaces())).expect("an address")
}

/// A relay of TCP between the link and the robot.
pub(crate) struct Relay {
    at: SocketAddr,
    to: String,
    connections: JoinSet<()>,
}

impl Relay {
    async fn start(to: &str) -> Relay {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let at = listener.local_addr().expect("a port");
        let mut relay = Relay { at, to: to.to_owned(), connections: JoinSet::new() };
        relay.listen(listener);
        relay
    }

    fn listen(&mut self, listener: TcpListener) {
        let to = self.to.clone();
        self.connections.spawn(async move {
            let mut connections = JoinSet::new();
            loop {
                let (mut near, _) = listener.accept().await.expect("a connection");
                let mut far = TcpStream::connect(&to).await.expect("the robot listens");
                connections.spawn(async move {
                    drop(tokio::io::copy_bidirectional(&mut near, &mut far).await);
                });
            }
        });
    }

    /// Breaks the link.
    pub(crate) async fn cut(&mut self) {
        self.connections.shutdown().await;
    }

    /// Lets the link be made anew.
    pub(crate) async fn heal(&mut self) {
        let listener = TcpListener::bind(self.at).await.expect("the port is still free");
        self.listen(listener);
    }
}

async fn start_nodes(address: &RosAddress, distribution: &str, pose: Option<&str>) -> Program {
    let RosAddress { endpoint, dialect, namespace, domain_id } = address;
    let mut nodes = match dialect {
        RosDialect::Ros2Dds => {
            let python = std::env::var("ROS_PEERS_PYTHON").unwrap_or("python3".to_owned());
            let has_dds = Command::new(&python).args(["-c", "import cyclonedds"]).output();
            assert!(
                has_dds.is_ok_and(|output| output.status.success()),
                "`{python}` has no Cyclone DDS: run `{python} -m pip install cyclonedds==11.0.1`, \
                 or name another Python in ROS_PEERS_PYTHON"
            );
            let mut nodes = Command::new(python);
            nodes.arg("-B").arg(concat!(env!("CARGO_MANIFEST_DIR"), "/dds/robot.py"));
            nodes
        }
        RosDialect::RmwZenoh => {
            let mut nodes = Command::new(env!("CARGO_BIN_EXE_hiroz-robot"));
            nodes.arg(endpoint);
            nodes
        }
    };
    nodes.arg(domain_id.to_string()).arg(namespace).arg(distribution);
    if let Some(pose) = pose {
        nodes.env("ROBOT_POSE", pose);
    }
    let mut nodes = Program::start(&mut nodes);
    nodes.saw("ready").await;
    nodes
}

/// Returns a domain of ROS that no other test of this process uses. Domains are ports of DDS, which
/// cannot be left to the kernel.
fn free_domain() -> u32 {
    const DOMAINS: u32 = 200;
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let begin = std::process::id().wrapping_mul(17);
    1 + begin.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % DOMAINS
}
