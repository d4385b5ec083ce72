//! Records the answers to calls for proposals that a daemon of this process receives, and the
//! awards that it sends. The recorder is between the daemon's message router and its substrate,
//! because a separate listener would cost time. The messages are decoded after the clock has
//! stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use acl::content::Bid;
use acl::{AgentId, Performative, ReplyToken};
use agent::{MessageRouter, Presence};
use bytes::Bytes;
use substrate::{
    AgentAddress, Answer, Delivery, Destination, ForwardingSubstrate, Inbound, ReceivedQuery,
    Rejected, SendError, Subject, Substrate,
};

/// The recorded messages, in their order.
#[derive(Default)]
pub(crate) struct Overheard(Mutex<Vec<(Performative, Bytes)>>);

/// The number of agents that had answered the call of an award when it was made, and of those that
/// had proposed.
pub(crate) struct Award {
    pub(crate) answers: usize,
    pub(crate) proposals: usize,
}

impl Overheard {
    fn note(&self, subject: &Subject, payload: &Bytes) {
        use Performative::{AcceptProposal, Agree, Refuse};
        if let Subject::Message(said @ (Agree | Refuse | AcceptProposal)) = subject {
            let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            all.push((*said, payload.clone()));
        }
    }

    /// Returns all awards since the last call.
    pub(crate) fn awards(&self) -> Vec<Award> {
        let all = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        let mut answers: BTreeMap<ReplyToken, BTreeSet<AgentId>> = BTreeMap::new();
        let mut proposals = answers.clone();
        let mut awards = Vec::new();
        for (said, payload) in all {
            let Ok(message) = acl::decode(&payload) else { continue };
            let Some(call) = message.in_reply_to.clone() else { continue };
            if said == Performative::AcceptProposal {
                let count = |of: &BTreeMap<_, BTreeSet<_>>| of.get(&call).map_or(0, BTreeSet::len);
                awards.push(Award { answers: count(&answers), proposals: count(&proposals) });
                continue;
            }
            let proposes = message.content_as::<Bid>().is_ok_and(|bid| !bid.proposals.is_empty());
            if said == Performative::Agree && proposes {
                proposals.entry(call.clone()).or_default().insert(message.sender.clone());
            }
            answers.entry(call).or_default().insert(message.sender);
        }
        awards
    }
}

/// The inbound side: records messages from the substrate.
pub(crate) struct Inward {
    router: Arc<MessageRouter>,
    overheard: Arc<Overheard>,
}

impl Inward {
    pub(crate) fn new(router: &Arc<MessageRouter>, overheard: &Arc<Overheard>) -> Arc<Inward> {
        let (router, overheard) = (Arc::clone(router), Arc::clone(overheard));
        Arc::new(Inward { router, overheard })
    }
}

impl Inbound for Inward {
    fn deliver(&self, delivery: Delivery) {
        if let Destination::To(_, subject) = &delivery.destination {
            self.overheard.note(subject, &delivery.payload);
        }
        self.router.deliver(delivery);
    }

    fn presence(&self, presence: Presence) {
        self.router.presence(presence);
    }

    fn receive_query(&self, question: ReceivedQuery) {
        self.router.receive_query(question);
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.router.rejected(rejected);
    }

    fn accepts_answer(&self, answer: &Answer<'_>) -> bool {
        self.router.accepts_answer(answer)
    }
}

/// The outbound side: records messages to the substrate.
struct Outward {
    wire: Arc<dyn Substrate>,
    overheard: Arc<Overheard>,
}

/// Wraps a substrate so that messages to it are recorded.
pub(crate) fn outward(wire: Arc<dyn Substrate>, overheard: &Arc<Overheard>) -> Arc<dyn Substrate> {
    Arc::new(Outward { wire, overheard: Arc::clone(overheard) })
}

impl ForwardingSubstrate for Outward {
    fn inner(&self) -> &dyn Substrate {
        &*self.wire
    }

    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.overheard.note(&subject, &payload);
        self.wire.send(to, subject, payload)
    }
}
