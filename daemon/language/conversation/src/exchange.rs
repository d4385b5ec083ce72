//! State machine of one exchange: one initiator, one participant, one protocol.

use acl::content::Report;
use acl::{AgentId, Incarnation, Message, Performative, Protocol};

use crate::turn::{ExchangePhase, ExchangeRole, PROTOCOLS};

/// Error for a message that the protocol does not allow at this point.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{performative}` of the {role:?} does not follow in {protocol:?} at {phase:?}")]
pub struct ProtocolViolation {
    /// Protocol of the exchange.
    pub protocol: Protocol,
    /// Phase of the exchange when the message arrived.
    pub phase: ExchangePhase,
    /// Role of the sender of the message.
    pub role: ExchangeRole,
    /// Performative of the message.
    pub performative: Performative,
}

/// State of one exchange. After a broadcast, there is one exchange with every participant that
/// answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    protocol: Protocol,
    initiator: AgentId,
    /// Incarnation of the initiator. It distinguishes the initiator from a participant of the same
    /// name, because a replica may open an exchange with another replica.
    incarnation: Incarnation,
    phase: ExchangePhase,
}

impl Exchange {
    /// Creates the state of an exchange before its first message, which the `incarnation` of
    /// `initiator` sends.
    pub fn new(protocol: Protocol, initiator: AgentId, incarnation: Incarnation) -> Exchange {
        Exchange { protocol, initiator, incarnation, phase: ExchangePhase::Opening }
    }

    /// Returns the phase that the exchange is in.
    pub fn phase(&self) -> ExchangePhase {
        self.phase
    }

    /// Returns the protocol of the exchange.
    pub fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Returns the agent that opens the exchange.
    pub fn initiator(&self) -> &AgentId {
        &self.initiator
    }

    /// Whether the exchange is over.
    pub fn is_closed(&self) -> bool {
        self.phase == ExchangePhase::Closed
    }

    /// Whether a message that the protocol does not allow now may be allowed later, because an
    /// earlier message of either agent may arrive after it.
    pub fn may_follow_later(&self, message: &Message) -> bool {
        let roles = self.roles(message);
        let mut reached = vec![self.phase];
        let mut index = 0;
        while let Some(phase) = reached.get(index).copied() {
            index += 1;
            for turn in PROTOCOLS.iter().filter(|turn| turn.applies_to(self.protocol, phase)) {
                if roles.contains(&turn.role) && turn.performative == message.performative {
                    return true;
                }
                if !reached.contains(&turn.next) {
                    reached.push(turn.next);
                }
            }
        }
        false
    }

    /// Advances the exchange by the next message, and returns the new phase.
    ///
    /// # Errors
    ///
    /// Returns an error if the protocol does not allow the message now. The phase is then
    /// unchanged.
    pub fn advance(&mut self, message: &Message) -> Result<ExchangePhase, ProtocolViolation> {
        let (roles, performative) = (self.roles(message), message.performative);
        let next_of = |role: &ExchangeRole| {
            let turn = PROTOCOLS.iter().find(|turn| {
                turn.applies_to(self.protocol, self.phase)
                    && turn.role == *role
                    && turn.performative == performative
            });
            turn.map(|turn| turn.next)
        };
        let next = roles.iter().find_map(next_of).ok_or(ProtocolViolation {
            protocol: self.protocol,
            phase: self.phase,
            role: roles[0],
            performative,
        })?;
        if !is_progress(message) {
            self.phase = next;
        }
        Ok(self.phase)
    }

    /// Returns the roles in which the sender of a message may have sent it: both, if an agent that
    /// has opened an exchange with itself sends to itself.
    fn roles(&self, message: &Message) -> &'static [ExchangeRole] {
        let is_initiator =
            message.sender == self.initiator && message.incarnation == self.incarnation;
        let is_to_itself = message.receiver.contains(&self.initiator);
        match (is_initiator, is_to_itself) {
            (true, true) => &[ExchangeRole::Initiator, ExchangeRole::Participant],
            (true, false) => &[ExchangeRole::Initiator],
            (false, _) => &[ExchangeRole::Participant],
        }
    }
}

/// Whether `message` is a `confirm` without a final outcome, which does not change the phase of the
/// exchange.
fn is_progress(message: &Message) -> bool {
    message.performative == Performative::Confirm
        && message.content_as::<Report>().is_ok_and(|report| !report.outcome.is_final())
}
