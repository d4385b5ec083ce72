//! The sending side of a daemon: passes messages to the substrate, and counts the messages that the
//! substrate does not accept.
//!
//! Heartbeats of several agents are sent in batches, and requests for models of one daemon are
//! combined.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use substrate::{
    AgentAddress, BoxFuture, OverhearCallback, OverhearToken, PresenceToken, Rejected,
    ResourceQuery, SendError, Subject, Substrate, ViolationKind,
};

use crate::failure_counters::FailureCounters;
use crate::heartbeat_batcher::{GATHERED_WITHIN, HeartbeatBatcher};
use crate::model_fetcher::ModelFetcher;
use crate::rejections::Rejections;

/// Link of one daemon to the substrate. Clones refer to the same link.
#[derive(Clone)]
pub(crate) struct SubstrateLink(Arc<LinkState>);

struct LinkState {
    daemon: DaemonId,
    substrate: OnceLock<Arc<dyn Substrate>>,
    /// Heartbeats of this daemon's agents that wait to be sent in one batch.
    batcher: HeartbeatBatcher,
    /// Requests for models of agents of other daemons.
    fetcher: ModelFetcher,
    counters: Arc<FailureCounters>,
    rejections: Arc<Rejections>,
}

impl SubstrateLink {
    /// Creates the link of `daemon`, without a substrate.
    pub(crate) fn new(
        daemon: DaemonId,
        counters: Arc<FailureCounters>,
        rejections: Arc<Rejections>,
    ) -> SubstrateLink {
        let (substrate, batcher) = (OnceLock::new(), HeartbeatBatcher::default());
        let fetcher = ModelFetcher::default();
        let state = LinkState { daemon, substrate, batcher, fetcher, counters, rejections };
        SubstrateLink(Arc::new(state))
    }

    /// Sets the substrate. Only the first call has an effect.
    pub(crate) fn connect(&self, substrate: Arc<dyn Substrate>) {
        // A second substrate would split the daemon's agents; the first one stays.
        let _ = self.0.substrate.set(substrate);
    }

    /// Announces that an agent of this daemon is present. The agent stays present until the
    /// returned token is dropped.
    pub(crate) fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        self.0.substrate.get().ok_or(SendError::Closed)?.announce(agent, incarnation)
    }

    /// Completes when every daemon that is present now receives this daemon's broadcasts.
    pub(crate) fn broadcast_ready(&self) -> BoxFuture<()> {
        match self.0.substrate.get() {
            Some(substrate) => substrate.broadcast_ready(),
            None => Box::pin(std::future::ready(())),
        }
    }

    /// Queries other daemons for a resource. Returns all answers that come within `timeout`.
    pub(crate) fn ask(&self, query: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        match self.0.substrate.get() {
            Some(substrate) => substrate.ask(query, timeout),
            None => Box::pin(std::future::ready(Vec::new())),
        }
    }

    /// Requests the model of an agent of another daemon. Requests to one daemon at about the same
    /// moment are combined.
    pub(crate) fn fetch_model(
        &self,
        agent: AgentId,
        daemon: DaemonId,
        timeout: Duration,
    ) -> BoxFuture<Vec<Bytes>> {
        match self.0.substrate.get() {
            Some(substrate) => self.0.fetcher.model_of(agent, daemon, substrate, timeout),
            None => Box::pin(std::future::ready(Vec::new())),
        }
    }

    /// Passes every message of the ecosystem to `listener`; see [`Substrate::overhear`].
    pub(crate) fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        self.0.substrate.get().ok_or(SendError::Closed)?.overhear(listener)
    }

    /// Sends a payload to one agent.
    pub(crate) fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) {
        self.hand_over(|substrate| substrate.send(to, subject, payload));
    }

    /// Sends a payload to all agents.
    pub(crate) fn broadcast(&self, sender: &AgentId, performative: Performative, payload: Bytes) {
        self.hand_over(|substrate| substrate.broadcast(sender, performative, payload));
    }

    /// Broadcasts a model or heartbeat at once. If a heartbeat of the same sender waits for a
    /// batch, that heartbeat is withdrawn.
    pub(crate) fn broadcast_state(&self, sender: &AgentId, payload: Bytes) {
        self.withdraw_heartbeat(sender);
        self.hand_over(|substrate| substrate.broadcast_state(sender, payload));
    }

    /// Broadcasts a heartbeat in one batch with those that other agents of this daemon send at
    /// about the same moment.
    ///
    /// # Panics
    ///
    /// Panics if called outside a Tokio runtime.
    pub(crate) fn batch_heartbeat(&self, sender: &AgentId, payload: Bytes) {
        if !self.0.batcher.add(sender, payload) {
            return;
        }
        let link = self.clone();
        tokio::spawn(async move {
            tokio::time::sleep(GATHERED_WITHIN).await;
            let heartbeats = link.0.batcher.take();
            link.hand_over(|substrate| substrate.broadcast_heartbeats(heartbeats));
        });
    }

    /// Removes the heartbeat of `sender` that waits for a batch.
    pub(crate) fn withdraw_heartbeat(&self, sender: &AgentId) {
        self.0.batcher.withdraw(sender);
    }

    fn hand_over(&self, send: impl FnOnce(&dyn Substrate) -> Result<(), SendError>) {
        let LinkState { daemon, substrate, counters, rejections, .. } = &*self.0;
        let substrate = substrate.get().ok_or(SendError::Closed);
        if let Err(error) = substrate.and_then(|substrate| send(&**substrate)) {
            counters.count_not_sent();
            if let SendError::TooLong { .. } = error {
                rejections.note(&Rejected {
                    violation: ViolationKind::Oversized,
                    detail: &error.to_string(),
                    claimed: Some(daemon.as_str()),
                    key: "its own",
                });
            }
            tracing::debug!(%error, "the substrate did not take a message");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use substrate::memory::Network;
    use substrate::{Delivery, Destination, Inbound, Presence, ReceivedQuery};

    use super::*;

    /// Daemon that records the senders and payloads of the broadcasts of state that it receives.
    #[derive(Default)]
    struct Receiver(Mutex<Vec<(String, Bytes)>>);

    impl Inbound for Receiver {
        fn deliver(&self, delivery: Delivery) {
            if let Destination::AgentState(sender) = delivery.destination {
                let received = (sender.to_string(), delivery.payload);
                self.0.lock().expect("no panic").push(received);
            }
        }
        fn presence(&self, _: Presence) {}
        fn receive_query(&self, _: ReceivedQuery) {}
    }

    fn link() -> (SubstrateLink, Arc<FailureCounters>) {
        let counters = Arc::<FailureCounters>::default();
        let daemon = DaemonId::new("d").expect("a name");
        (SubstrateLink::new(daemon, Arc::clone(&counters), Arc::default()), counters)
    }

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    #[test]
    fn a_message_without_a_substrate_is_counted() {
        let (link, counters) = link();
        link.broadcast(&name("a"), Performative::Inform, Bytes::new());
        let daemon = DaemonId::new("d").expect("a name");
        assert_eq!(counters.report(daemon, Vec::new(), [].into()).not_sent, 1);
        assert!(matches!(link.announce(&name("a"), Incarnation(1)), Err(SendError::Closed)));
    }

    #[tokio::test(start_paused = true)]
    async fn a_heartbeat_in_a_batch_gives_way_to_a_later_one() {
        let ((link, _), network) = (link(), Network::new());
        let (receiver, other) = (Arc::<Receiver>::default(), Arc::<Receiver>::default());
        link.connect(network.open(DaemonId::new("d").expect("a name"), other));
        network.open(DaemonId::new("e").expect("a name"), Arc::<Receiver>::clone(&receiver));
        let received = || std::mem::take(&mut *receiver.0.lock().expect("no panic"));
        let payload = |text: &'static str| Bytes::from_static(text.as_bytes());
        link.batch_heartbeat(&name("a"), payload("1"));
        link.batch_heartbeat(&name("b"), payload("2"));
        link.broadcast_state(&name("a"), payload("3"));
        assert_eq!(received(), [("a".to_owned(), payload("3"))], "at once");
        tokio::time::sleep(GATHERED_WITHIN * 2).await;
        assert_eq!(received(), [("b".to_owned(), payload("2"))], "the batch");
    }
}
