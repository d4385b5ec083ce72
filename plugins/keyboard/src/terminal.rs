//! The terminal of a Keyboard Agent: two channels between the agent and a person, and the messages in
//! them.

use acl::content::{ChangeState, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// A goal that a person requests.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct GoalRequest {
    /// The condition to be reached, in PDDL.
    pub goal: String,
    /// Whether the goal is to be achieved once or kept.
    #[serde(default)]
    pub keep: Keep,
    /// Priority of the goal; a goal of greater priority goes first.
    #[serde(default)]
    pub priority: i32,
    /// What happens to the goal during a partition of the ecosystem.
    #[serde(default)]
    pub partition: Partition,
}

/// An input of the person at the terminal.
#[derive(Clone, Debug)]
pub enum UserRequest {
    /// Requests a goal.
    RequestGoal(GoalRequest),
    /// Cancels a goal or an action.
    Cancel(ConversationId),
    /// Requests one ground action, written in PDDL.
    Act(String),
    /// Changes facts of the known state.
    Set(ChangeState),
    /// Selects the planning mode (centralised or decentralised) in which plans are made from now on.
    Mode(Mode),
    /// Answers a question that this keyboard or another one keeps.
    Answer {
        /// The keyboard that keeps the question.
        keyboard: AgentId,
        /// Number of the question at the keyboard that keeps it.
        question: u64,
        /// Text of the answer.
        text: String,
        /// Key that the answer is encrypted to, as the question gives it. May be `None` for a question
        /// that this keyboard keeps, because the keyboard then knows the key.
        seal_to: Option<String>,
    },
    /// Sends a message as the person wrote it.
    Send(MessageDraft),
}

/// A message as a person wrote it; the keyboard adds the rest of the envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageDraft {
    /// Receiver of the message; with `None` it is sent to all agents.
    pub to: Option<AgentId>,
    /// Performative of the message; it must open an exchange of the protocol.
    pub performative: Performative,
    /// Protocol of the exchange that the message opens.
    pub protocol: Protocol,
    /// Conversation of the message; `None` starts a new one.
    pub conversation: Option<ConversationId>,
    /// Content of the message.
    pub content: Value,
    /// How long the keyboard waits for answers to the message.
    pub patience: std::time::Duration,
}

/// An output to the person at the terminal.
#[derive(Clone, Debug)]
pub enum UserEvent {
    /// A request of the person was sent, in the conversation given here.
    Sent(ConversationId),
    /// A report about the progress or outcome of the request in a conversation.
    Report(ConversationId, Report),
    /// The request in a conversation was refused.
    Refused(ConversationId, Refusal),
    /// No agent took the request in a conversation, or none answered in time. The text is the reason.
    Unanswered(ConversationId, String),
    /// An answer to a message that was sent as the person wrote it.
    Answered(Box<Message>),
    /// An agent asks the person a question.
    Question(OpenQuestion),
    /// The question with this number was closed, for the reason in the text.
    QuestionClosed(u64, String),
}

/// The ends of the two channels to a Keyboard Agent that belong to the person.
pub struct Terminal {
    /// Inputs of the person.
    pub requests: mpsc::Sender<UserRequest>,
    /// Outputs to the person.
    pub events: mpsc::Receiver<UserEvent>,
}

// === impl UserEvent ===

impl UserEvent {
    /// Returns the conversation that this output is about; `None` for an output about a question.
    pub fn conversation(&self) -> Option<&ConversationId> {
        match self {
            UserEvent::Sent(about)
            | UserEvent::Report(about, _)
            | UserEvent::Refused(about, _)
            | UserEvent::Unanswered(about, _) => Some(about),
            UserEvent::Answered(message) => Some(&message.conversation_id),
            UserEvent::Question(_) | UserEvent::QuestionClosed(..) => None,
        }
    }

    /// Whether no more outputs follow in the conversation that this output is about.
    pub fn is_final(&self) -> bool {
        match self {
            UserEvent::Sent(_) | UserEvent::Question(_) | UserEvent::QuestionClosed(..) => false,
            UserEvent::Report(_, report) => report.outcome.is_final(),
            UserEvent::Refused(..) | UserEvent::Unanswered(..) => true,
            UserEvent::Answered(message) => is_last(message),
        }
    }

    /// Whether this output reports that the request has ended well, or that the goal holds.
    pub fn is_success(&self) -> bool {
        match self {
            UserEvent::Report(_, Report { outcome, .. }) => {
                matches!(outcome, Outcome::Done | Outcome::Holds)
            }
            UserEvent::Answered(message) => {
                !matches!(message.performative, Performative::Refuse | Performative::NotUnderstood)
            }
            _ => false,
        }
    }
}

/// Whether `message` is the last one that its sender sends in an exchange. A bid (`agree` to a `cfp`)
/// counts as the last one, because a message that a person wrote is never followed by an acceptance or
/// a rejection.
fn is_last(message: &Message) -> bool {
    match message.performative {
        Performative::Confirm => {
            message.content_as::<Report>().map_or(true, |report| report.outcome.is_final())
        }
        Performative::Agree => message.protocol == Some(Protocol::ContractNet),
        _ => true,
    }
}
