//! All turns of all protocols, as a table.

use acl::{Performative, Protocol};

/// Phase of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExchangePhase {
    /// The exchange has no message yet.
    Opening,
    /// The initiator has sent its first message; the participant has not answered.
    Open,
    /// The participant has made a proposal, which the initiator has not accepted or rejected yet.
    Proposed,
    /// The participant has agreed to the request.
    Committed,
    /// The initiator has sent `cancel`, and the participant has not answered it.
    Cancelling,
    /// The exchange is over.
    Closed,
}

/// Role of an agent in an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExchangeRole {
    /// The agent that opened the exchange.
    Initiator,
    /// The agent that answers the initiator.
    Participant,
}

/// Turn of a protocol: in the phase `phase`, the agent with the role `role` may send a message with
/// the performative `performative`, which leads to the phase `next`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProtocolTurn {
    /// Protocol that the turn belongs to.
    pub protocol: Protocol,
    /// Phase of the exchange before the message.
    pub phase: ExchangePhase,
    /// Role of the agent that sends the message.
    pub role: ExchangeRole,
    /// Performative of the message.
    pub performative: Performative,
    /// Phase of the exchange after the message.
    pub next: ExchangePhase,
}

impl ProtocolTurn {
    /// Whether the turn is allowed in an exchange of `protocol` at `phase`.
    pub(crate) fn applies_to(&self, protocol: Protocol, phase: ExchangePhase) -> bool {
        self.protocol == protocol && self.phase == phase
    }
}

const fn turn(
    protocol: Protocol,
    phase: ExchangePhase,
    role: ExchangeRole,
    performative: Performative,
    next: ExchangePhase,
) -> ProtocolTurn {
    ProtocolTurn { protocol, phase, role, performative, next }
}

use ExchangePhase::{Cancelling, Closed, Committed, Open, Opening, Proposed};
use ExchangeRole::{Initiator, Participant};
use Performative::{
    AcceptProposal, Agree, Cancel, Cfp, Confirm, Inform, NotUnderstood, Propose, QueryRef, Refuse,
    RejectProposal, Request,
};
use Protocol::{Action, ContractNet, Execution, Goal, Planning, Query, StateChange};

/// All turns of all protocols. A `confirm` without a final outcome does not change the phase; see
/// [`Exchange`].
///
/// [`Exchange`]: crate::Exchange
pub const PROTOCOLS: &[ProtocolTurn] = &[
    // A user requests a goal. The Plan Requester reports progress, then the outcome.
    turn(Goal, Opening, Initiator, Request, Open),
    turn(Goal, Open, Participant, Refuse, Closed),
    turn(Goal, Open, Participant, NotUnderstood, Closed),
    turn(Goal, Open, Participant, Confirm, Closed),
    turn(Goal, Open, Initiator, Cancel, Cancelling),
    turn(Goal, Cancelling, Participant, Confirm, Closed),
    turn(Goal, Cancelling, Participant, Refuse, Closed),
    // Another user cancels a goal by its conversation.
    turn(Goal, Opening, Initiator, Cancel, Cancelling),
    turn(Goal, Cancelling, Participant, NotUnderstood, Closed),
    // The Plan Requester requests a plan from the Planning Agent (centralised).
    turn(Planning, Opening, Initiator, Request, Open),
    turn(Planning, Open, Participant, Refuse, Closed),
    turn(Planning, Open, Participant, NotUnderstood, Closed),
    turn(Planning, Open, Participant, Propose, Proposed),
    turn(Planning, Open, Initiator, Cancel, Cancelling),
    turn(Planning, Cancelling, Participant, Propose, Closed),
    turn(Planning, Cancelling, Participant, Refuse, Closed),
    turn(Planning, Proposed, Initiator, AcceptProposal, Closed),
    turn(Planning, Proposed, Initiator, RejectProposal, Closed),
    // The Plan Requester calls for proposals, and each actuator answers on its own (decentralised).
    turn(ContractNet, Opening, Initiator, Cfp, Open),
    turn(ContractNet, Open, Participant, Agree, Proposed),
    turn(ContractNet, Open, Participant, Refuse, Closed),
    turn(ContractNet, Open, Participant, NotUnderstood, Closed),
    turn(ContractNet, Proposed, Initiator, AcceptProposal, Closed),
    turn(ContractNet, Proposed, Initiator, RejectProposal, Closed),
    // The Plan Requester requests the execution of a plan from the Plan Executor.
    turn(Execution, Opening, Initiator, Request, Open),
    turn(Execution, Open, Participant, Refuse, Closed),
    turn(Execution, Open, Participant, NotUnderstood, Closed),
    turn(Execution, Open, Participant, Confirm, Closed),
    turn(Execution, Open, Initiator, Cancel, Cancelling),
    turn(Execution, Cancelling, Participant, Confirm, Closed),
    turn(Execution, Cancelling, Participant, Refuse, Closed),
    // The Plan Executor requests an action from an actuator.
    turn(Action, Opening, Initiator, Request, Open),
    turn(Action, Open, Participant, Agree, Committed),
    turn(Action, Open, Participant, Refuse, Closed),
    turn(Action, Open, Participant, NotUnderstood, Closed),
    turn(Action, Open, Initiator, Cancel, Cancelling),
    // All agents of a joint action have agreed, and they begin; or all of them have done their parts.
    turn(Action, Committed, Initiator, AcceptProposal, Committed),
    turn(Action, Committed, Participant, Confirm, Closed),
    turn(Action, Committed, Initiator, Cancel, Cancelling),
    // The actuator may have agreed before it read the `cancel`.
    turn(Action, Cancelling, Participant, Agree, Cancelling),
    turn(Action, Cancelling, Participant, Confirm, Closed),
    turn(Action, Cancelling, Participant, Refuse, Closed),
    // Any agent requests a change of the state from the Domain Maintainer or a change of the
    // planning mode from the Plan Requester, gives a Keyboard Agent a person's answer, or requests
    // a page of the history from a history agent.
    turn(StateChange, Opening, Initiator, Request, Open),
    turn(StateChange, Open, Participant, Confirm, Closed),
    turn(StateChange, Open, Participant, Refuse, Closed),
    turn(StateChange, Open, Participant, NotUnderstood, Closed),
    // Any agent asks a person a question. If it gets the answer elsewhere first, it withdraws the
    // question.
    turn(Query, Opening, Initiator, QueryRef, Open),
    turn(Query, Open, Initiator, Cancel, Closed),
    turn(Query, Open, Participant, Inform, Closed),
    turn(Query, Open, Participant, Refuse, Closed),
    turn(Query, Open, Participant, NotUnderstood, Closed),
];
