//! One initiator, one participant, one protocol: from the opening message to the last word.

use acl::content::Report;
use acl::{AgentId, Incarnation, Message, Performative, Protocol};

use crate::turn::PROTOCOLS;

/// Where an exchange stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Nothing has been said.
    Opening,
    /// Asked, not answered.
    Open,
    /// A proposal waits for its answer.
    Proposed,
    /// The participant has given its word.
    Committed,
    /// The initiator has asked to give it up.
    Cancelling,
    /// The last word has been said.
    Closed,
}

/// Who speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Who opened the exchange.
    Initiator,
    /// Who answers.
    Participant,
}

/// A turn that the protocol does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{performative}` of the {role:?} does not follow in {protocol:?} at {phase:?}")]
pub struct Violation {
    /// The protocol.
    pub protocol: Protocol,
    /// Where the exchange stands.
    pub phase: Phase,
    /// Who spoke.
    pub role: Role,
    /// What was said.
    pub performative: Performative,
}

/// One exchange. A broadcast opens one with every participant that answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    protocol: Protocol,
    initiator: AgentId,
    /// Which life of it: of several of a name, one may ask another.
    life: Incarnation,
    phase: Phase,
}

impl Exchange {
    /// An exchange in which nothing has been said, and this life of the initiator will speak first.
    pub fn new(protocol: Protocol, initiator: AgentId, life: Incarnation) -> Exchange {
        Exchange { protocol, initiator, life, phase: Phase::Opening }
    }

    /// Where it stands.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Its protocol.
    pub fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Who opened it.
    pub fn initiator(&self) -> &AgentId {
        &self.initiator
    }

    /// Whether the last word has been said.
    pub fn is_closed(&self) -> bool {
        self.phase == Phase::Closed
    }

    /// Whether a message that does not follow now may follow later: what it answers, or what its
    /// sender said before it, may still be on its way.
    pub fn may_come_to(&self, message: &Message) -> bool {
        let role = self.role(message);
        let mut reached = vec![self.phase];
        let mut index = 0;
        while let Some(phase) = reached.get(index).copied() {
            index += 1;
            for turn in PROTOCOLS.iter().filter(|turn| turn.is_of(self.protocol, phase)) {
                if turn.role == role && turn.performative == message.performative {
                    return true;
                }
                if !reached.contains(&turn.next) {
                    reached.push(turn.next);
                }
            }
        }
        false
    }

    /// Takes the next message.
    ///
    /// # Errors
    ///
    /// If the protocol has no such turn here; the exchange stays where it was.
    pub fn advance(&mut self, message: &Message) -> Result<Phase, Violation> {
        let role = self.role(message);
        let performative = message.performative;
        let next = PROTOCOLS
            .iter()
            .find(|turn| {
                turn.is_of(self.protocol, self.phase)
                    && turn.role == role
                    && turn.performative == performative
            })
            .map(|turn| turn.next)
            .ok_or(Violation { protocol: self.protocol, phase: self.phase, role, performative })?;
        if !is_progress(message) {
            self.phase = next;
        }
        Ok(self.phase)
    }

    fn role(&self, message: &Message) -> Role {
        let is_initiator = message.sender == self.initiator && message.incarnation == self.life;
        if is_initiator { Role::Initiator } else { Role::Participant }
    }
}

/// A `confirm` that is not the last word leaves the exchange where it is.
fn is_progress(message: &Message) -> bool {
    message.performative == Performative::Confirm
        && message.content_as::<Report>().is_ok_and(|report| !report.outcome.is_final())
}
