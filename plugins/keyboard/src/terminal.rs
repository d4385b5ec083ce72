//! The terminal: the channels between a person and a Keyboard Agent, and their messages.

use acl::content::{ChangeState, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// A goal that a person requests.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Wish {
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
pub enum Said {
    /// Requests a goal.
    Wish(Wish),
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
    Send(Draft),
}

/// A message as a person wrote it; the keyboard adds the rest of the envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
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
pub enum Heard {
    /// A request was sent, in this conversation.
    Asked(ConversationId),
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
    pub say: mpsc::Sender<Said>,
    /// Outputs to the person.
    pub hear: mpsc::Receiver<Heard>,
}

// === impl Heard ===

impl Heard {
    /// Returns the conversation that this is about; `None` for questions.
    pub fn conversation(&self) -> Option<&ConversationId> {
        match self {
            Heard::Asked(about)
            | Heard::Report(about, _)
            | Heard::Refused(about, _)
            | Heard::Unanswered(about, _) => Some(about),
            Heard::Answered(message) => Some(&message.conversation_id),
            Heard::Question(_) | Heard::QuestionClosed(..) => None,
        }
    }

    /// Whether no more outputs follow about its conversation.
    pub fn is_final(&self) -> bool {
        match self {
            Heard::Asked(_) | Heard::Question(_) | Heard::QuestionClosed(..) => false,
            Heard::Report(_, report) => report.outcome.is_final(),
            Heard::Refused(..) | Heard::Unanswered(..) => true,
            Heard::Answered(message) => is_last(message),
        }
    }

    /// Whether the request has ended well, or the goal holds.
    pub fn is_success(&self) -> bool {
        match self {
            Heard::Report(_, Report { outcome, .. }) => {
                matches!(outcome, Outcome::Done | Outcome::Holds)
            }
            Heard::Answered(message) => {
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
