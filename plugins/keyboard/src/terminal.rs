//! The terminal: the channels between a person and a Keyboard Agent, and their messages.

use acl::content::{ChangeState, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// A goal that a person requests.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct GoalRequest {
    /// The goal, a PDDL condition.
    pub goal: String,
    /// Whether it is to be achieved once or kept.
    #[serde(default)]
    pub keep: Keep,
    /// Priority; greater goes first.
    #[serde(default)]
    pub priority: i32,
    /// Behaviour during a partition of the ecosystem.
    #[serde(default)]
    pub partition: Partition,
}

/// An input of the person.
#[derive(Clone, Debug)]
pub enum UserRequest {
    /// Requests a goal.
    RequestGoal(GoalRequest),
    /// Cancels a goal or an action.
    Cancel(ConversationId),
    /// Requests one ground action.
    Act(String),
    /// Changes the state.
    Set(ChangeState),
    /// Selects the flow by which plans are made from now on.
    Mode(Mode),
    /// Answers a question of this keyboard or of another.
    Answer {
        /// The keyboard that keeps the question.
        keyboard: AgentId,
        /// Number of the question at that keyboard.
        question: u64,
        /// Text of the answer.
        text: String,
        /// Key that the answer is encrypted to, as named by the question. May be `None` for this
        /// keyboard's own questions: it knows their keys.
        seal_to: Option<String>,
    },
    /// Sends a message as written.
    Send(MessageDraft),
}

/// A message as a person wrote it; the keyboard adds the rest of the envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageDraft {
    /// Receiver; `None` sends to all agents.
    pub to: Option<AgentId>,
    /// Performative; it must open an exchange of the protocol.
    pub performative: Performative,
    /// Protocol of the exchange.
    pub protocol: Protocol,
    /// Conversation; `None` starts a new one.
    pub conversation: Option<ConversationId>,
    /// Content of the message.
    pub content: Value,
    /// How long answers are waited for.
    pub patience: std::time::Duration,
}

/// An output to the person.
#[derive(Clone, Debug)]
pub enum UserEvent {
    /// A request was sent, in this conversation.
    Sent(ConversationId),
    /// Progress or outcome of a request.
    Report(ConversationId, Report),
    /// The request was refused.
    Refused(ConversationId, Refusal),
    /// No agent took the request, or none answered in time; with the reason.
    Unanswered(ConversationId, String),
    /// An answer to a message that was sent as written.
    Answered(Box<Message>),
    /// An agent asks a question.
    Question(OpenQuestion),
    /// A question was closed, for this reason.
    QuestionClosed(u64, String),
}

/// The person's end of the channels.
pub struct Terminal {
    /// Inputs of the person.
    pub requests: mpsc::Sender<UserRequest>,
    /// Outputs to the person.
    pub events: mpsc::Receiver<UserEvent>,
}

// === impl UserEvent ===

impl UserEvent {
    /// Returns the conversation that this is about; `None` for questions.
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

    /// Whether no more outputs follow about its conversation.
    pub fn is_final(&self) -> bool {
        match self {
            UserEvent::Sent(_) | UserEvent::Question(_) | UserEvent::QuestionClosed(..) => false,
            UserEvent::Report(_, report) => report.outcome.is_final(),
            UserEvent::Refused(..) | UserEvent::Unanswered(..) => true,
            UserEvent::Answered(message) => is_last(message),
        }
    }

    /// Whether the request has ended well, or the goal holds.
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

/// Whether this message ends the exchange from the sender's side. A bid (`agree` to a `cfp`) counts as
/// the end, because a message sent as written is never followed by an acceptance or a rejection.
fn is_last(message: &Message) -> bool {
    match message.performative {
        Performative::Confirm => {
            message.content_as::<Report>().map_or(true, |report| report.outcome.is_final())
        }
        Performative::Agree => message.protocol == Some(Protocol::ContractNet),
        _ => true,
    }
}
