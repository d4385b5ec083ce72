//! A daemon in a test: a substrate, and a written record of the messages it receives.

use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use bytes::Bytes;
use substrate::{
    AgentAddress, Delivery, Destination, Inbound, Presence, PresenceToken, ReceivedQuery, Rejected,
    Resource, ResourceQuery, Subject, Substrate,
};
use substrate_zenoh::{Config, SessionMode, ZenohSubstrate};
use tokio::sync::mpsc;

/// A time far beyond the duration of any step; a test that reaches it has failed.
pub(crate) const DEADLINE: Duration = Duration::from_secs(10);

/// Texts longer than `LONG` bytes are recorded with their first `SHORT` bytes only.
const LONG: usize = 4 << 20;
const SHORT: usize = 80;

pub(crate) const HERE: &str = "tcp/127.0.0.1:0";

pub(crate) struct Daemon {
    pub(crate) name: &'static str,
    pub(crate) substrate: Arc<ZenohSubstrate>,
    heard: mpsc::UnboundedReceiver<String>,
}

/// Receiver that records messages as text, and answers every question with its name, the resource
/// and the agent.
struct Ear {
    name: &'static str,
    heard: mpsc::UnboundedSender<String>,
}

impl Ear {
    fn note(&self, line: String) {
        // An error means that the test has ended.
        let _ = self.heard.send(line);
    }
}

impl Inbound for Ear {
    fn deliver(&self, delivery: Delivery) {
        let mut text = String::from_utf8_lossy(&delivery.payload).into_owned();
        if text.len() > LONG {
            text.truncate(SHORT);
        }
        if let Some(origin) = delivery.origin {
            text += &format!(" <{}>", origin.daemon);
        }
        self.note(match delivery.destination {
            Destination::To(agent, Subject::Message(performative)) => {
                format!("to {agent} {performative}: {text}")
            }
            Destination::To(agent, Subject::Receipt) => format!("to {agent} receipt: {text}"),
            Destination::All(sender, performative) => {
                format!("all {sender} {performative}: {text}")
            }
            Destination::AgentState(sender) => format!("beat {sender}: {text}"),
        });
    }

    fn presence(&self, presence: Presence) {
        let word = if matches!(presence, Presence::Joined(_)) { "joined" } else { "left" };
        let resident = presence.resident();
        self.note(format!("{word} {}@{}", resident.agent, resident.daemon));
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        let Rejected { violation, claimed, .. } = rejected;
        self.note(format!("rejected {} {}", violation.as_str(), claimed.unwrap_or("-")));
    }

    fn receive_query(&self, question: ReceivedQuery) {
        let agent = question.agent.map_or("-".to_owned(), |agent| agent.to_string());
        let text = format!("{} {} {agent}", self.name, question.resource.as_str());
        (question.answer)(Bytes::from(text));
    }
}

pub(crate) fn config(name: &str) -> Config {
    Config::new(ecosystem("office"), DaemonId::new(name).expect("a name"))
}

pub(crate) fn ecosystem(name: &str) -> EcosystemId {
    EcosystemId::new(name).expect("a name")
}

pub(crate) fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

/// Returns a receiver for messages, and the channel to which it writes each of them as a line.
pub(crate) fn ear(name: &'static str) -> (Arc<dyn Inbound>, mpsc::UnboundedReceiver<String>) {
    let (sender, heard) = mpsc::unbounded_channel();
    (Arc::new(Ear { name, heard: sender }), heard)
}

impl Daemon {
    pub(crate) async fn open(name: &'static str, change: impl FnOnce(&mut Config)) -> Daemon {
        let (inbound, heard) = ear(name);
        let mut config = config(name);
        change(&mut config);
        let substrate = config.open(inbound).await.expect("a good configuration");
        Daemon { name, substrate, heard }
    }

    /// Opens a router that listens on a port of the kernel's choice.
    pub(crate) async fn listening(name: &'static str) -> Daemon {
        Daemon::open(name, |config| config.listen = vec![HERE.to_owned()]).await
    }

    /// Opens a router that listens, and connects to `other`.
    pub(crate) async fn linked(name: &'static str, other: &Daemon) -> Daemon {
        let connect = other.substrate.locators();
        Daemon::open(name, |config| {
            config.listen = vec![HERE.to_owned()];
            config.connect = connect;
        })
        .await
    }

    /// Opens a client that connects to the daemon `other`.
    pub(crate) async fn client(name: &'static str, other: &Daemon) -> Daemon {
        let connect = other.substrate.locators();
        Daemon::open(name, |config| {
            config.mode = SessionMode::Client;
            config.connect = connect;
        })
        .await
    }

    /// Waits until this line is recorded. Returns all lines up to it.
    #[track_caller]
    pub(crate) fn hear(&mut self, line: &str) -> impl Future<Output = Vec<String>> {
        let at = std::panic::Location::caller();
        async move {
            let mut lines = Vec::new();
            let waiting = async {
                while lines.last().is_none_or(|last| last != line) {
                    lines.push(self.heard.recv().await.expect("the ear lives with its session"));
                }
            };
            let in_time = tokio::time::timeout(DEADLINE, waiting).await;
            assert!(in_time.is_ok(), "{at}: {} waits for `{line}`; heard {lines:?}", self.name);
            lines
        }
    }

    /// Waits until all of these lines are recorded, in any order.
    pub(crate) async fn hear_all(&mut self, lines: &[&str]) {
        let mut missing: Vec<_> = lines.to_vec();
        while !missing.is_empty() {
            let heard = self.hear_any().await;
            missing.retain(|line| !heard.iter().any(|heard| heard == line));
        }
    }

    /// Waits until any line is recorded, and returns it.
    pub(crate) async fn hear_any(&mut self) -> Vec<String> {
        let line = tokio::time::timeout(DEADLINE, self.heard.recv()).await.expect("in time");
        vec![line.expect("the ear lives with its session")]
    }

    /// Returns a line that has been recorded already; `None` if there is none.
    pub(crate) fn heard_already(&mut self) -> Option<String> {
        self.heard.try_recv().ok()
    }

    pub(crate) fn announce(&self, name: &str) -> PresenceToken {
        self.substrate.announce(&agent(name), Incarnation(1)).expect("open")
    }

    pub(crate) fn send(&self, daemon: &str, to: &str, subject: Subject, text: &str) {
        let daemon = DaemonId::new(daemon).expect("a name");
        let to = AgentAddress { daemon, agent: agent(to) };
        self.substrate.send(&to, subject, Bytes::from(text.to_owned())).expect("open");
    }

    pub(crate) fn request(&self, daemon: &str, to: &str, text: &str) {
        self.send(daemon, to, Subject::Message(Performative::Request), text);
    }

    /// Sends a question, and returns the answers sorted.
    pub(crate) async fn ask(
        &self,
        daemon: Option<&str>,
        resource: Resource,
        about: Option<&str>,
    ) -> Vec<String> {
        let daemon = daemon.map(|name| DaemonId::new(name).expect("a name"));
        let ask = ResourceQuery { daemon, resource, agent: about.map(agent) };
        let answers = self.substrate.ask(ask, DEADLINE).await;
        let mut answers: Vec<String> =
            answers.iter().map(|answer| String::from_utf8_lossy(answer).into_owned()).collect();
        answers.sort();
        answers
    }
}
