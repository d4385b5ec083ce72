//! The terminal: what a person says to a Keyboard Agent, and what the person hears.

use acl::content::{ChangeState, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// What a person wants.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Wish {
    /// A PDDL condition.
    pub goal: String,
    /// Reach it once, or keep it.
    #[serde(default)]
    pub keep: Keep,
    /// Greater goes first.
    #[serde(default)]
    pub priority: i32,
    /// What happens to it while the ecosystem is in pieces.
    #[serde(default)]
    pub partition: Partition,
}

/// What a person says.
#[derive(Clone, Debug)]
pub enum Said {
    /// I want this.
    Wish(Wish),
    /// Give this goal or this action up.
    Cancel(ConversationId),
    /// Do this one ground action.
    Act(String),
    /// The world is different.
    Set(ChangeState),
    /// Plan by this flow from now on.
    Mode(Mode),
    /// My answer to a question that this keyboard, or another, keeps.
    Answer {
        /// The keyboard that keeps it.
        keyboard: AgentId,
        /// Its number there.
        question: u64,
        /// What I say.
        text: String,
        /// The key that it is sealed to, which the question names; the keyboard knows that of its own
        /// questions.
        seal_to: Option<String>,
    },
    /// Send this message.
    Send(Draft),
}

/// A message as a person wrote it; the keyboard gives it the rest of its envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
    /// To whom; nobody means all.
    pub to: Option<AgentId>,
    /// With which act; one that opens an exchange of the protocol.
    pub performative: Performative,
    /// By which protocol.
    pub protocol: Protocol,
    /// About what; nothing means something new.
    pub conversation: Option<ConversationId>,
    /// What is said.
    pub content: Value,
    /// How long answers are waited for.
    pub patience: std::time::Duration,
}

/// What a person hears.
#[derive(Clone, Debug)]
pub enum Heard {
    /// Something was asked for; this is its conversation.
    Asked(ConversationId),
    /// How it stands.
    Report(ConversationId, Report),
    /// It was declined.
    Refused(ConversationId, Refusal),
    /// Nobody took it.
    Unanswered(ConversationId, String),
    /// An answer to a message that was sent as it was written.
    Answered(Box<Message>),
    /// An agent asks.
    Question(OpenQuestion),
    /// A question is open no longer, and why.
    QuestionClosed(u64, String),
}

/// The person's side of a keyboard.
pub struct Terminal {
    /// What the person says.
    pub say: mpsc::Sender<Said>,
    /// What the person hears.
    pub hear: mpsc::Receiver<Heard>,
}

// === impl Heard ===

impl Heard {
    /// The conversation it is about.
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

    /// Whether nothing more will be heard about its conversation.
    pub fn is_final(&self) -> bool {
        match self {
            Heard::Asked(_) | Heard::Question(_) | Heard::QuestionClosed(..) => false,
            Heard::Report(_, report) => report.outcome.is_final(),
            Heard::Refused(..) | Heard::Unanswered(..) => true,
            Heard::Answered(message) => is_last(message),
        }
    }

    /// Whether it is the good end of what was asked for, or the goal holds.
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

/// Whether its sender has nothing to add to an answer. A bid waits for a choice, which a person
/// who only looks does not make.
fn is_last(message: &Message) -> bool {
    match message.performative {
        Performative::Confirm => {
            message.content_as::<Report>().map_or(true, |report| report.outcome.is_final())
        }
        Performative::Agree => message.protocol == Some(Protocol::ContractNet),
        _ => true,
    }
}
