//! State machine of one exchange: one initiator, one participant, one protocol.

use acl::content::Report;
use acl::{AgentId, Incarnation, Message, Performative, Protocol};

use crate::turn::{ExchangePhase, ExchangeRole, PROTOCOLS};

/// Error: a message that the protocol does not allow at this point.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{performative}` of the {role:?} does not follow in {protocol:?} at {phase:?}")]
pub struct ProtocolViolation {
    /// Protocol of the exchange.
    pub protocol: Protocol,
    /// Phase in which the exchange was when the message came.
    pub phase: ExchangePhase,
    /// Role of the agent that sent the message.
    pub role: ExchangeRole,
    /// Performative of the message that is not allowed.
    pub performative: Performative,
}

/// State of one exchange. A broadcast opens one exchange with every participant that answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    protocol: Protocol,
    initiator: AgentId,
    /// Incarnation of the initiator. It distinguishes the initiator from a participant of the same
    /// name, because a replica may open an exchange with another.
    incarnation: Incarnation,
    phase: ExchangePhase,
}

impl Exchange {
    /// Creates the state of an exchange before its first message, which the `incarnation` of
    /// `initiator` will send.
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

    /// Returns the agent that opened the exchange.
    pub fn initiator(&self) -> &AgentId {
        &self.initiator
    }

    /// Whether the exchange is over.
    pub fn is_closed(&self) -> bool {
        self.phase == ExchangePhase::Closed
    }

    /// Whether a message that the protocol does not allow now may be allowed later. The message before
    /// it, from the same sender or from the other agent, may still be on its way.
    pub fn may_follow_later(&self, message: &Message) -> bool {
        let role = self.role(message);
        let mut reached = vec![self.phase];
        let mut index = 0;
        while let Some(phase) = reached.get(index).copied() {
            index += 1;
            for turn in PROTOCOLS.iter().filter(|turn| turn.applies_to(self.protocol, phase)) {
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

    /// Advances the exchange by the next message, and returns the new phase.
    ///
    /// # Errors
    ///
    /// Returns an error if the protocol does not allow the message now; the phase stays as it was.
    pub fn advance(&mut self, message: &Message) -> Result<ExchangePhase, ProtocolViolation> {
        let role = self.role(message);
        let performative = message.performative;
        let next = PROTOCOLS
            .iter()
            .find(|turn| {
                turn.applies_to(self.protocol, self.phase)
                    && turn.role == role
                    && turn.performative == performative
            })
            .map(|turn| turn.next)
            .ok_or(ProtocolViolation {
                protocol: self.protocol,
                phase: self.phase,
                role,
                performative,
            })?;
        if !is_progress(message) {
            self.phase = next;
        }
        Ok(self.phase)
    }

    fn role(&self, message: &Message) -> ExchangeRole {
        let is_initiator =
            message.sender == self.initiator && message.incarnation == self.incarnation;
        if is_initiator { ExchangeRole::Initiator } else { ExchangeRole::Participant }
    }
}

/// Whether `message` is a `confirm` without a final outcome, which leaves the exchange in the phase
/// that it is in.
fn is_progress(message: &Message) -> bool {
    message.performative == Performative::Confirm
        && message.content_as::<Report>().is_ok_and(|report| !report.outcome.is_final())
}
