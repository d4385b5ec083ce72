//! A substrate in front of another: it overrides the operations in which it counts, loses or
//! records messages, and passes on all others.

use std::time::Duration;

use acl::{AgentId, Incarnation, Performative};
use bytes::Bytes;

use crate::{Address, Ask, BoxFuture, PresenceToken, SendError, Subject, Substrate};

/// A [`Substrate`] in front of another. An implementation overrides the operations that it changes.
#[expect(clippy::missing_errors_doc, reason = "as those of `Substrate`")]
pub trait Through: Send + Sync + 'static {
    /// Returns the substrate behind this one.
    fn wire(&self) -> &dyn Substrate;

    /// As [`Substrate::send`].
    fn send(&self, to: &Address, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.wire().send(to, subject, payload)
    }

    /// As [`Substrate::broadcast`].
    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.wire().broadcast(sender, performative, payload)
    }

    /// As [`Substrate::beat`]; the heartbeats of a batch pass here one by one.
    fn beat(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.wire().beat(sender, payload)
    }

    /// As [`Substrate::ask`].
    fn ask(&self, question: Ask, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        self.wire().ask(question, timeout)
    }
}

impl<T: Through> Substrate for T {
    fn send(&self, to: &Address, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        Through::send(self, to, subject, payload)
    }

    fn broadcast(&self, who: &AgentId, act: Performative, payload: Bytes) -> Result<(), SendError> {
        Through::broadcast(self, who, act, payload)
    }

    fn beat(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        Through::beat(self, sender, payload)
    }

    fn announce(&self, agent: &AgentId, life: Incarnation) -> Result<PresenceToken, SendError> {
        self.wire().announce(agent, life)
    }

    fn ask(&self, question: Ask, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        Through::ask(self, question, timeout)
    }

    fn introduced(&self) -> BoxFuture<()> {
        self.wire().introduced()
    }

    fn close(&self) -> BoxFuture<()> {
        self.wire().close()
    }
}
