//! Daemons of one machine find each other, in any order and under any name.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::{AgentId, DaemonId, EcosystemId};
use substrate::{Delivery, Inbound, Presence, ReceivedQuery};
use substrate_zenoh::{Config, SessionMode, ZenohSubstrate};
use tokio::sync::mpsc;

use crate::support::{Office, PATIENCE};

const DAEMONS: [&str; 5] =
    ["reasoning", "turtlebot-laptop", "office2-pi", "conf-room-pi", "corridor-pi"];

/// One agent of each daemon.
const AGENTS: [&str; 5] =
    ["plan-executor", "turtlebot-1", "thermometer-office2", "co2-conf-room", "camera-1"];

/// Client of one daemon that receives presence as its router reports it.
struct Lookout {
    daemon: &'static str,
    heard: mpsc::UnboundedReceiver<Presence>,
    _session: Arc<ZenohSubstrate>,
}

struct Ear(mpsc::UnboundedSender<Presence>);

impl Inbound for Ear {
    fn deliver(&self, _: Delivery) {}
    fn receive_query(&self, _: ReceivedQuery) {}
    fn presence(&self, presence: Presence) {
        // The receiver is gone when the test is over.
        let _ = self.0.send(presence);
    }
}

impl Lookout {
    async fn at(office: &Office, daemon: &'static str) -> Lookout {
        let ecosystem = EcosystemId::new("smart-office").expect("a name");
        let mut config = Config::new(ecosystem, DaemonId::new("lookout").expect("a name"));
        config.mode = SessionMode::Client;
        let socket = office.runtime_folder().join(format!("smart-office/{daemon}.sock"));
        config.connect = vec![format!("unixsock-stream/{}", socket.display())];
        let (tell, heard) = mpsc::unbounded_channel();
        let session = config.open(Arc::new(Ear(tell))).await.expect("the daemon runs");
        Lookout { daemon, heard, _session: session }
    }

    /// Waits until all of these agents have joined.
    async fn sees(&mut self, agents: &[&str]) {
        self.waits(agents, |presence| matches!(presence, Presence::Joined(_))).await;
    }

    /// Waits until all of these agents have left.
    async fn misses(&mut self, agents: &[&str]) {
        self.waits(agents, |presence| matches!(presence, Presence::Left(_))).await;
    }

    async fn waits(&mut self, agents: &[&str], what: impl Fn(&Presence) -> bool) {
        let id = |name: &&str| AgentId::new(name).expect("a name");
        let mut missing: BTreeSet<_> = agents.iter().map(id).collect();
        while !missing.is_empty() {
            let heard = tokio::time::timeout(PATIENCE, self.heard.recv()).await;
            let Ok(heard) = heard else { panic!("{} does not hear of {missing:?}", self.daemon) };
            let presence = heard.expect("the session lives");
            if what(&presence) {
                missing.remove(&presence.resident().agent);
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn daemons_that_start_at_once() {
    let mut office = Office::new();
    office.up_at_once(&DAEMONS);
    for daemon in DAEMONS {
        Lookout::at(&office, daemon).await.sees(&AGENTS).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_daemon_that_is_killed_and_started_again_at_once() {
    let mut office = Office::new();
    office.up(&DAEMONS, &[]);
    let mut other = Lookout::at(&office, "reasoning").await;
    other.sees(&AGENTS).await;
    // Names that sort before and after those of the others.
    for (daemon, agent) in [("conf-room-pi", "co2-conf-room"), ("turtlebot-laptop", "turtlebot-1")]
    {
        for _ in 0..2 {
            office.kill(daemon);
            office.up(&[daemon], &[]);
            other.misses(&[agent]).await;
            other.sees(&[agent]).await;
            Lookout::at(&office, daemon).await.sees(&AGENTS).await;
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_daemon_that_the_other_files_do_not_name() {
    let mut office = Office::new();
    office.up(&["reasoning", "corridor-pi"], &[]);
    let text = std::fs::read_to_string(Office::file()).expect("the repository's own");
    let folder = Office::file().canonicalize().expect("it is there");
    let domains = folder.ancestors().nth(2).expect("a folder").join("domains");
    let text = text.replace("../domains", &domains.display().to_string());
    let entry = "[[agent]]\nname = \"newcomer\"\nplugin = \"temperature-sensor\"\n\
                 daemon = \"annex-pi\"\nconfig = { location = \"office1\" }\n";
    let file = office.write("newer.toml", &format!("{text}\n{entry}"));
    office.up_from(&file, "annex-pi");
    Lookout::at(&office, "reasoning").await.sees(&["newcomer", "camera-1"]).await;
    Lookout::at(&office, "annex-pi").await.sees(&["newcomer", "camera-1"]).await;
}

#[test]
fn a_name_is_taken_once() {
    let mut office = Office::new();
    office.up(&["corridor-pi"], &[]);
    let file = Office::file().display().to_string();
    let second = office.run(&["up", &file, "--daemon", "corridor-pi"]);
    assert_eq!(second.status.code(), Some(69));
    let said = crate::support::stderr(&second);
    assert!(said.contains("a daemon of this name is running here already"), "{said}");
    let (code, agents) = office.ask(&["agents"]);
    assert_eq!(code, Some(0), "{agents}");
    assert!(agents.contains("camera-1"), "the first goes on: {agents}");
}
