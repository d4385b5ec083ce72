//! Passes all messages of a scenario to a listener, from the first message of its agents to the
//! last one, as a foreign tool on the network would receive them.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use acl::{DaemonId, EcosystemId};
use bytes::Bytes;
use substrate::{Destination, OverhearToken, SendError, Subject};
use substrate_zenoh::{OpenError, SessionMode, Tap};

use crate::hosting::DaemonNode;

/// How long the messages that were sent last may take to the listener, once all agents have ended.
/// Between processes of one machine a message takes about a millisecond.
const LAST_WITHIN: Duration = Duration::from_millis(200);

/// Function that takes the key expression and the payload of a message.
type MessageTaker = dyn Fn(&str, Bytes) + Send + Sync;

/// A listener that receives all messages of a scenario, each with the key expression to which it
/// was sent. It is called on the threads of the senders, and must not block.
#[derive(Clone)]
pub(crate) struct ScenarioTap(Arc<MessageTaker>);

/// The connection of a listener to the agents of a scenario.
pub(super) enum TapLink {
    /// The agents are in this process.
    Here(#[expect(dead_code, reason = "its drop ends the listening")] OverhearToken),
    /// The agents are in other processes.
    Elsewhere(#[expect(dead_code, reason = "its drop ends the listening")] Tap),
}

impl ScenarioTap {
    /// Creates a listener that is called with the key expression and the payload of each message.
    pub(crate) fn new(listen: impl Fn(&str, Bytes) + Send + Sync + 'static) -> ScenarioTap {
        ScenarioTap(Arc::new(listen))
    }

    /// Passes on all messages of the agents in this process.
    pub(super) fn listen_here(&self, node: &DaemonNode) -> Result<TapLink, SendError> {
        let (ecosystem, daemon) = (node.router().ecosystem().clone(), node.router().daemon());
        let (listen, daemon) = (Arc::clone(&self.0), daemon.clone());
        let token = node.overhear(move |message| {
            if let Some(key) = key(&ecosystem, &daemon, &message.destination) {
                listen(&key, message.payload);
            }
        })?;
        Ok(TapLink::Here(token))
    }

    /// Passes on all messages of an ecosystem, through the daemon at `endpoint`.
    pub(super) async fn listen_at(
        &self,
        ecosystem: &EcosystemId,
        endpoint: Option<String>,
    ) -> Result<TapLink, OpenError> {
        let name = DaemonId::new("recorder").expect("invariant: a word is a name");
        let mut config = substrate_zenoh::Config::new(ecosystem.clone(), name);
        config.mode = SessionMode::Client;
        config.connect.extend(endpoint);
        let listen = Arc::clone(&self.0);
        let tap = substrate_zenoh::tap(config, move |key, message| listen(key, message.payload));
        tap.await.map(TapLink::Elsewhere)
    }
}

impl fmt::Debug for ScenarioTap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ScenarioTap")
    }
}

impl TapLink {
    /// Waits for the messages that are still on their way, and closes the connection.
    pub(super) async fn close(self) {
        if matches!(self, TapLink::Elsewhere(_)) {
            tokio::time::sleep(LAST_WITHIN).await;
        }
    }
}

/// Returns the key expression of a message as Zenoh has it; `None` for a receipt, which is no
/// message of an agent. All agents are of one daemon.
fn key(ecosystem: &EcosystemId, daemon: &DaemonId, destination: &Destination) -> Option<String> {
    let key = match destination {
        Destination::To(_, Subject::Receipt) => return None,
        Destination::To(agent, Subject::Message(performative)) => {
            format!("in/{daemon}/{agent}/{performative}")
        }
        Destination::All(sender, performative) => format!("all/{performative}/{sender}"),
        Destination::AgentState(agent) => format!("model/{daemon}/{agent}"),
    };
    Some(format!("althing/{ecosystem}/{key}"))
}
