//! The receiving side of a daemon, for tests: records everything that the daemon receives.

use std::sync::{Arc, Mutex};

use acl::{AgentId, DaemonId};
use bytes::Bytes;

use crate::{Delivery, Destination, Inbound, Presence, ReceivedQuery};

/// Recorder of everything that a daemon receives. Answers every query with the name of the queried
/// resource.
#[derive(Default)]
pub(crate) struct RecordingInbound(Mutex<Vec<String>>);

impl RecordingInbound {
    pub(crate) fn new() -> Arc<RecordingInbound> {
        Arc::default()
    }

    fn record(&self, line: String) {
        self.0.lock().expect("no test panics while it listens").push(line);
    }

    /// Returns the lines that were recorded since the last call.
    pub(crate) fn take_lines(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.lock().expect("as above"))
    }
}

impl Inbound for RecordingInbound {
    fn deliver(&self, delivery: Delivery) {
        let text = String::from_utf8_lossy(&delivery.payload).into_owned();
        match delivery.destination {
            Destination::To(agent, subject) => self.record(format!("{agent} {subject:?} {text}")),
            _ => self.record(text),
        }
    }

    fn presence(&self, presence: Presence) {
        let word = if matches!(presence, Presence::Joined(_)) { "joined" } else { "left" };
        self.record(format!("{word} {}", presence.resident().agent));
    }

    fn receive_query(&self, question: ReceivedQuery) {
        (question.answer)(Bytes::from_static(question.resource.as_str().as_bytes()));
    }
}

pub(crate) fn daemon(name: &str) -> DaemonId {
    DaemonId::new(name).expect("a name")
}

pub(crate) fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}
