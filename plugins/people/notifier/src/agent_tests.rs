//! Tests of the agent: on a network in memory, with a receiver on loopback.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use acl::content::Question;
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, EcosystemFolder, ExchangeOpening, Host,
    LaunchContext, LaunchableAgent, MessageRouter, Resources, StateFolder,
};
use serde_json::{Value, json};
use substrate::Substrate;
use substrate::memory::Network;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::receiver::{PATIENCE, TestReceiver};

/// Agent that asks people a question when it is activated.
struct Asker(&'static str);

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: None,
            performative: Performative::QueryRef,
            protocol: Protocol::Query,
            conversation: ctx.new_conversation(),
            content: json!(Question::new(self.0)),
        };
        ctx.open(opening, Duration::from_secs(600), |_: &mut Self, _, _| ());
    }
}

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// A daemon of the network. It is gone when the value is.
struct TestDaemon {
    router: Arc<MessageRouter>,
    _port: Arc<dyn Substrate>,
}

impl TestDaemon {
    fn new(network: &Network, daemon: &str) -> TestDaemon {
        let ecosystem = EcosystemId::new("lab").expect("a name");
        let daemon = DaemonId::new(daemon).expect("a name");
        let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
        let port = network.open(daemon, Arc::<MessageRouter>::clone(&router) as _);
        router.connect(Arc::clone(&port));
        TestDaemon { router, _port: port }
    }

    fn launch(&self, agent: Box<dyn LaunchableAgent>, id: &str, number: u64) -> RunningAgent {
        let stopping = CancellationToken::new();
        let task = agent.launch(LaunchContext {
            id: name(id),
            incarnation: Incarnation(number),
            router: Arc::clone(&self.router),
            ontology: Arc::from("test"),
            stopping: stopping.clone(),
            has_replicas: id == "notifier",
            via: [].into(),
        });
        let task = tokio::spawn(async move {
            let _ = task.await;
        });
        RunningAgent { task, stopping }
    }

    fn ask(&self, text: &'static str, number: u64) -> RunningAgent {
        self.launch(Box::new(Asker(text)), &format!("asker-{number}"), number)
    }
}

struct RunningAgent {
    task: JoinHandle<()>,
    stopping: CancellationToken,
}

impl RunningAgent {
    /// Ends the agent in good order.
    async fn end(self) {
        self.stopping.cancel();
        let ended = tokio::time::timeout(PATIENCE, self.task).await;
        ended.expect("it ends in time").expect("it does not panic");
    }
}

/// Builds a notifier for a webhook at this port, with its files in a folder.
fn notifier(folder: &Path, port: u16) -> Box<dyn LaunchableAgent> {
    let secret = folder.join("secret");
    std::fs::write(&secret, "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").expect("a file");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o600);
    std::fs::set_permissions(&secret, mode).expect("ours");
    let url = format!("http://127.0.0.1:{port}/");
    let config = json!({ "to": [{ "kind": "webhook", "url": url, "secret-file": "secret" }] });
    let ontology = pddl::parse_domain("(define (domain lab))").value.expect("a domain");
    let map = "(define (problem map) (:domain lab) (:init) (:goal (and)))";
    let map = pddl::parse_problem(map).value.expect("a map");
    let mut resources = Resources::default();
    resources.insert(EcosystemFolder(folder.to_owned()));
    resources.insert(StateFolder(folder.to_owned()));
    let host = Host { resources, ..Host::new(ontology, map) };
    let blueprint = Blueprint {
        id: name("notifier"),
        driver: String::new(),
        config: config.into(),
        host: Arc::new(host),
    };
    crate::build(blueprint).expect("right")
}

/// Waits for the next notice with another text than these.
async fn next(receiver: &mut TestReceiver, known: &mut BTreeSet<String>) -> String {
    loop {
        let body: Value = serde_json::from_slice(&receiver.next().await.body).expect("JSON");
        assert_eq!(body["ecosystem"], "lab");
        let text = body["text"].as_str().expect("text").to_owned();
        if known.insert(text.clone()) {
            return text;
        }
    }
}

#[tokio::test]
async fn a_question_of_another_daemon_is_told() {
    let network = Network::new();
    let (home, away) = (TestDaemon::new(&network, "home"), TestDaemon::new(&network, "away"));
    let mut receiver = TestReceiver::start(&[], None).await;
    let folder = tempfile::tempdir().expect("a folder");
    let notifier = home.launch(notifier(folder.path(), receiver.port), "notifier", 1);
    let _asker = away.ask("May it?", 1);
    assert_eq!(next(&mut receiver, &mut BTreeSet::new()).await, "May it?");
    notifier.end().await;
    assert!(receiver.arrived().is_none(), "it is told once");
}

#[tokio::test]
async fn the_other_replica_tells_when_the_leader_has_ended() {
    let network = Network::new();
    let (one, two) = (TestDaemon::new(&network, "one"), TestDaemon::new(&network, "two"));
    let mut receiver = TestReceiver::start(&[], None).await;
    let folders = [(), ()].map(|()| tempfile::tempdir().expect("a folder"));
    let leader = one.launch(notifier(folders[0].path(), receiver.port), "notifier", 1);
    let standby = two.launch(notifier(folders[1].path(), receiver.port), "notifier", 2);
    let mut known = BTreeSet::new();
    let _first = two.ask("First?", 3);
    assert_eq!(next(&mut receiver, &mut known).await, "First?");
    leader.end().await;
    let _second = two.ask("Second?", 4);
    assert_eq!(next(&mut receiver, &mut known).await, "Second?");
    standby.end().await;
}

#[tokio::test]
async fn a_notice_outlasts_a_restart_while_the_receiver_is_away() {
    let network = Network::new();
    let home = TestDaemon::new(&network, "home");
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    drop(listener);
    let folder = tempfile::tempdir().expect("a folder");
    let before = home.launch(notifier(folder.path(), port), "notifier", 1);
    let _asker = home.ask("Still there?", 2);
    let file = folder.path().join("notifier.notices.json");
    let is_saved = || std::fs::read_to_string(&file).is_ok_and(|it| it.contains("Still there?"));
    let deadline = tokio::time::Instant::now() + PATIENCE;
    while !is_saved() {
        assert!(tokio::time::Instant::now() < deadline, "it is not written");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    before.end().await;
    // The kernel does not give the port to another process soon.
    let mut receiver = TestReceiver::start_at(port, &[], None).await;
    let after = home.launch(notifier(folder.path(), port), "notifier", 3);
    assert_eq!(next(&mut receiver, &mut BTreeSet::new()).await, "Still there?");
    after.end().await;
    assert!(!is_saved(), "what has arrived waits no more");
}
