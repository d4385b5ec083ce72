//! For tests: a daemon that only receives.

use std::sync::{Arc, Mutex};

use acl::{AgentId, DaemonId};
use bytes::Bytes;

use crate::{Addressed, Delivery, Inbound, Presence, Question};

/// Records everything that it receives, and answers every query with the name of the resource.
#[derive(Default)]
pub(crate) struct Ear(Mutex<Vec<String>>);

impl Ear {
    pub(crate) fn new() -> Arc<Ear> {
        Arc::default()
    }

    fn note(&self, line: String) {
        self.0.lock().expect("no test panics while it listens").push(line);
    }

    /// Returns the lines recorded since the last call.
    pub(crate) fn words(&self) -> Vec<String> {
        std::mem::take(&mut *self.0.lock().expect("as above"))
    }
}

impl Inbound for Ear {
    fn deliver(&self, delivery: Delivery) {
        let text = String::from_utf8_lossy(&delivery.payload).into_owned();
        match delivery.addressed {
            Addressed::To(agent, subject) => self.note(format!("{agent} {subject:?} {text}")),
            _ => self.note(text),
        }
    }

    fn presence(&self, presence: Presence) {
        let word = if matches!(presence, Presence::Joined(_)) { "joined" } else { "left" };
        self.note(format!("{word} {}", presence.resident().agent));
    }

    fn question(&self, question: Question) {
        (question.answer)(Bytes::from_static(question.resource.as_str().as_bytes()));
    }
}

pub(crate) fn daemon(name: &str) -> DaemonId {
    DaemonId::new(name).expect("a name")
}

pub(crate) fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}
