//! Notes the answers to calls for proposals that a daemon of this process hears, and the awards that it
//! makes, as they pass between its switchboard and its wire: nobody else has to listen, which would
//! cost time. What they say is read when the clock has stopped.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use acl::content::Bid;
use acl::{AgentId, Performative, ReplyToken};
use agent::{Presence, Switchboard};
use bytes::Bytes;
use substrate::{
    Address, Addressed, Answer, Delivery, Inbound, Question, Rejected, SendError, Subject,
    Substrate, Through,
};

/// What was said, in its order.
#[derive(Default)]
pub(crate) struct Overheard(Mutex<Vec<(Performative, Bytes)>>);

/// How many have answered the call of an award when it was made, and how many of them proposed.
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

    /// All awards since this was asked last.
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

/// What comes from the wire.
pub(crate) struct Inward {
    switchboard: Arc<Switchboard>,
    overheard: Arc<Overheard>,
}

impl Inward {
    pub(crate) fn new(switchboard: &Arc<Switchboard>, overheard: &Arc<Overheard>) -> Arc<Inward> {
        let (switchboard, overheard) = (Arc::clone(switchboard), Arc::clone(overheard));
        Arc::new(Inward { switchboard, overheard })
    }
}

impl Inbound for Inward {
    fn deliver(&self, delivery: Delivery) {
        if let Addressed::To(_, subject) = &delivery.addressed {
            self.overheard.note(subject, &delivery.payload);
        }
        self.switchboard.deliver(delivery);
    }

    fn presence(&self, presence: Presence) {
        self.switchboard.presence(presence);
    }

    fn question(&self, question: Question) {
        self.switchboard.question(question);
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.switchboard.rejected(rejected);
    }

    fn admits(&self, answer: &Answer<'_>) -> bool {
        self.switchboard.admits(answer)
    }
}

/// What goes to the wire.
struct Outward {
    wire: Arc<dyn Substrate>,
    overheard: Arc<Overheard>,
}

/// A wire on which what is said is noted.
pub(crate) fn outward(wire: Arc<dyn Substrate>, overheard: &Arc<Overheard>) -> Arc<dyn Substrate> {
    Arc::new(Outward { wire, overheard: Arc::clone(overheard) })
}

impl Through for Outward {
    fn wire(&self) -> &dyn Substrate {
        &*self.wire
    }

    fn send(&self, to: &Address, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.overheard.note(&subject, &payload);
        self.wire.send(to, subject, payload)
    }
}
