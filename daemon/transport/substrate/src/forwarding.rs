//! A substrate in front of another substrate. It overrides the operations in which it counts, loses
//! or records messages, and passes all other calls on.

use std::time::Duration;

use acl::{AgentId, Incarnation, Performative};
use bytes::Bytes;

use crate::{
    AgentAddress, BoxFuture, OverhearCallback, OverhearToken, PresenceToken, ResourceQuery,
    SendError, Subject, Substrate,
};

/// A [`Substrate`] in front of another one. An implementation overrides the operations that it
/// changes.
#[expect(clippy::missing_errors_doc, reason = "as those of `Substrate`")]
pub trait ForwardingSubstrate: Send + Sync + 'static {
    /// Returns the substrate to which this one forwards all calls.
    fn inner(&self) -> &dyn Substrate;

    /// Sends to one agent, as [`Substrate::send`] does. By default passes the call on.
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.inner().send(to, subject, payload)
    }

    /// Sends to all agents, as [`Substrate::broadcast`] does. By default passes the call on.
    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.inner().broadcast(sender, performative, payload)
    }

    /// Sends an action model or heartbeat to all agents, as [`Substrate::broadcast_state`] does.
    /// The heartbeats of a batch pass through this method one by one. By default passes the call
    /// on.
    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.inner().broadcast_state(sender, payload)
    }

    /// Queries daemons for a resource, as [`Substrate::ask`] does. By default passes the call on.
    fn ask(&self, question: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        self.inner().ask(question, timeout)
    }
}

impl<T: ForwardingSubstrate> Substrate for T {
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        ForwardingSubstrate::send(self, to, subject, payload)
    }

    fn broadcast(&self, who: &AgentId, act: Performative, payload: Bytes) -> Result<(), SendError> {
        ForwardingSubstrate::broadcast(self, who, act, payload)
    }

    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        ForwardingSubstrate::broadcast_state(self, sender, payload)
    }

    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        self.inner().announce(agent, incarnation)
    }

    fn ask(&self, question: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        ForwardingSubstrate::ask(self, question, timeout)
    }

    fn broadcast_ready(&self) -> BoxFuture<()> {
        self.inner().broadcast_ready()
    }

    fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        self.inner().overhear(listener)
    }

    fn close(&self) -> BoxFuture<()> {
        self.inner().close()
    }
}
