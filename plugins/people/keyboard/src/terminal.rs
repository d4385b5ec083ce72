//! The terminal of a Keyboard Agent: two channels between the agent and a person, one for requests
//! and one for outputs. Each request has a number, and each output about the request repeats that
//! number, so that the loss of an output does not change the meaning of the others.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use acl::content::{
    ChangeState, GoalTimes, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report,
};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// Capacity of each of the two channels, in requests or outputs.
const CHANNEL_CAPACITY: usize = 1_024;

/// Places in the channel of outputs that progress reports may not take. They keep room for the
/// beginning and the end of requests, even if the person reads nothing for a while.
const PLACES_FOR_ENDS: usize = CHANNEL_CAPACITY / 2;

/// A goal that a person requests.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct GoalRequest {
    /// The condition to be reached, in PDDL.
    pub goal: String,
    /// Whether the goal is to be achieved once or kept.
    #[serde(default)]
    pub keep: Keep,
    /// Priority of the goal; a goal of greater priority takes precedence.
    #[serde(default)]
    pub priority: i32,
    /// Handling of the goal during a partition of the ecosystem.
    #[serde(default)]
    pub partition: Partition,
}

/// An input of the person at the terminal.
#[derive(Clone, Debug)]
pub enum UserRequest {
    /// Requests a goal.
    RequestGoal(GoalRequest),
    /// Requests a goal at these times.
    ScheduleGoal(GoalRequest, Box<GoalTimes>),
    /// Cancels a goal or an action.
    Cancel(ConversationId),
    /// Requests one ground action, written in PDDL.
    Act(String),
    /// Changes facts of the known state.
    Set(ChangeState),
    /// Selects the planning mode (centralised or decentralised) for future plans.
    Mode(Mode),
    /// Answers a question that this keyboard or another one keeps.
    Answer {
        /// The keyboard that keeps the question.
        keyboard: AgentId,
        /// Number of the question at the keyboard that keeps it.
        question: u64,
        /// Text of the answer.
        text: String,
        /// Key for encrypting the answer, as given in the question. May be `None` for a question
        /// that this keyboard keeps, because this keyboard has the key itself.
        seal_to: Option<String>,
    },
    /// Sends a message that the person has written.
    Send(MessageDraft),
}

/// A message written by a person; the keyboard adds the rest of the envelope.
#[derive(Clone, Debug, PartialEq)]
pub struct MessageDraft {
    /// Receiver of the message; `None` for all agents.
    pub to: Option<AgentId>,
    /// Performative of the message; it must open an exchange of the protocol.
    pub performative: Performative,
    /// Protocol of the exchange that the message opens.
    pub protocol: Protocol,
    /// Conversation of the message; `None` starts a new one.
    pub conversation: Option<ConversationId>,
    /// Content of the message.
    pub content: Value,
    /// Time for which the keyboard waits for answers to the message.
    pub patience: std::time::Duration,
}

/// Number of a request among the requests of one terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestId(u64);

/// Reference from an output to its request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RequestRef {
    /// Number of the request; `None` if it was not made at the terminal.
    pub id: Option<RequestId>,
    /// Conversation of the request.
    pub conversation: ConversationId,
}

/// An output to the person at the terminal.
#[derive(Clone, Debug)]
pub enum UserEvent {
    /// A request of the person was sent.
    Sent(RequestRef),
    /// A report about the progress or outcome of a request.
    Report(RequestRef, Report),
    /// The request was refused.
    Refused(RequestRef, Refusal),
    /// No agent accepted the request, or no agent answered in time. The text is the reason.
    Unanswered(RequestRef, String),
    /// An answer to a message that the person has written.
    Answered(Option<RequestId>, Box<Message>),
    /// A question of an agent to the person.
    Question(OpenQuestion),
    /// The question with this number was closed, for the reason in the text.
    QuestionClosed(u64, String),
}

/// The person's ends of the two channels to a Keyboard Agent.
pub struct Terminal {
    /// Inputs of the person.
    pub requests: RequestSender,
    /// Outputs to the person.
    pub events: mpsc::Receiver<UserEvent>,
}

/// The Keyboard Agent's ends of the two channels.
pub struct TerminalPeer {
    /// Inputs of the person, each with its number.
    pub requests: mpsc::Receiver<(RequestId, UserRequest)>,
    /// Outputs to the person.
    pub events: EventSender,
}

/// Sender of requests to a Keyboard Agent. Clones share the numbers of the requests.
#[derive(Clone, Debug)]
pub struct RequestSender {
    to: mpsc::Sender<(RequestId, UserRequest)>,
    last: Arc<AtomicU64>,
}

/// A place for one request in the channel to a Keyboard Agent.
pub struct RequestPermit {
    permit: mpsc::OwnedPermit<(RequestId, UserRequest)>,
    id: RequestId,
}

/// Error for a request that did not get into the channel to the Keyboard Agent. The text of the
/// error completes “failed to …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("reach the keyboard agent: it has ended, or too many requests wait for it")]
pub struct RequestNotSent;

/// Sender of outputs to the person at a terminal.
#[derive(Clone, Debug)]
pub struct EventSender(mpsc::Sender<UserEvent>);

// === impl Terminal ===

impl Terminal {
    /// Creates a terminal, and the Keyboard Agent's ends of its channels.
    pub fn open() -> (Terminal, TerminalPeer) {
        let (to, requests) = mpsc::channel(CHANNEL_CAPACITY);
        let (tell, events) = mpsc::channel(CHANNEL_CAPACITY);
        let sender = RequestSender { to, last: Arc::default() };
        let peer = TerminalPeer { requests, events: EventSender(tell) };
        (Terminal { requests: sender, events }, peer)
    }
}

// === impl RequestSender ===

impl RequestSender {
    /// Sends a request, and returns its number. Waits while the channel is full.
    ///
    /// # Errors
    ///
    /// Returns an error if the Keyboard Agent has ended.
    pub async fn send(&self, request: UserRequest) -> Result<RequestId, RequestNotSent> {
        Ok(self.reserve().await?.send(request))
    }

    /// Sends a request at once, and returns its number.
    ///
    /// # Errors
    ///
    /// Returns an error if the channel is full or the Keyboard Agent has ended.
    pub fn try_send(&self, request: UserRequest) -> Result<RequestId, RequestNotSent> {
        let permit = self.to.clone().try_reserve_owned().map_err(|_| RequestNotSent)?;
        Ok(self.numbered(permit).send(request))
    }

    /// Waits for a place in the channel, and takes it.
    ///
    /// # Errors
    ///
    /// Returns an error if the Keyboard Agent has ended.
    pub async fn reserve(&self) -> Result<RequestPermit, RequestNotSent> {
        let permit = self.to.clone().reserve_owned().await.map_err(|_| RequestNotSent)?;
        Ok(self.numbered(permit))
    }

    fn numbered(&self, permit: mpsc::OwnedPermit<(RequestId, UserRequest)>) -> RequestPermit {
        RequestPermit { permit, id: RequestId(self.last.fetch_add(1, Ordering::Relaxed) + 1) }
    }
}

impl RequestPermit {
    /// Returns the number of the request to be sent.
    pub fn id(&self) -> RequestId {
        self.id
    }

    /// Sends a request, and returns its number.
    pub fn send(self, request: UserRequest) -> RequestId {
        self.permit.send((self.id, request));
        self.id
    }
}

// === impl EventSender ===

impl EventSender {
    /// Sends an output. Returns `false` if the output is lost, because too many earlier outputs are
    /// unread, or because the terminal is closed. Progress reports are lost first.
    pub fn send(&self, event: UserEvent) -> bool {
        let has_room = !event.is_progress() || self.0.capacity() > PLACES_FOR_ENDS;
        has_room && self.0.try_send(event).is_ok()
    }
}

// === impl UserEvent ===

impl UserEvent {
    /// Returns the number of the request that this output is about; `None` for an output about a
    /// question, or about a request that was not made at the terminal.
    pub fn request(&self) -> Option<RequestId> {
        match self {
            UserEvent::Sent(about)
            | UserEvent::Report(about, _)
            | UserEvent::Refused(about, _)
            | UserEvent::Unanswered(about, _) => about.id,
            UserEvent::Answered(id, _) => *id,
            UserEvent::Question(_) | UserEvent::QuestionClosed(..) => None,
        }
    }

    /// Returns the conversation that this output is about; `None` for an output about a question.
    pub fn conversation(&self) -> Option<&ConversationId> {
        match self {
            UserEvent::Sent(about)
            | UserEvent::Report(about, _)
            | UserEvent::Refused(about, _)
            | UserEvent::Unanswered(about, _) => Some(&about.conversation),
            UserEvent::Answered(_, message) => Some(&message.conversation_id),
            UserEvent::Question(_) | UserEvent::QuestionClosed(..) => None,
        }
    }

    /// Whether this output is the last one in its conversation.
    pub fn is_final(&self) -> bool {
        match self {
            UserEvent::Sent(_) | UserEvent::Question(_) | UserEvent::QuestionClosed(..) => false,
            UserEvent::Report(_, report) => report.outcome.is_final(),
            UserEvent::Refused(..) | UserEvent::Unanswered(..) => true,
            UserEvent::Answered(_, message) => is_last(message),
        }
    }

    /// Whether this output reports progress of a request, as opposed to its beginning or its end.
    fn is_progress(&self) -> bool {
        matches!(self, UserEvent::Report(..) | UserEvent::Answered(..)) && !self.is_final()
    }

    /// Whether this output reports that the request has succeeded, or that the goal holds.
    pub fn is_success(&self) -> bool {
        match self {
            UserEvent::Report(_, Report { outcome, .. }) => {
                matches!(outcome, Outcome::Done | Outcome::Holds)
            }
            UserEvent::Answered(_, message) => {
                !matches!(message.performative, Performative::Refuse | Performative::NotUnderstood)
            }
            _ => false,
        }
    }
}

/// Whether `message` is the last one that its sender sends in an exchange. A bid (`agree` to a
/// `cfp`) counts as the last one, because a message that a person wrote is never followed by an
/// acceptance or a rejection.
fn is_last(message: &Message) -> bool {
    match message.performative {
        Performative::Confirm => {
            message.content_as::<Report>().map_or(true, |report| report.outcome.is_final())
        }
        Performative::Agree => message.protocol == Some(Protocol::ContractNet),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about(terminal: &Terminal, peer: &mut TerminalPeer) -> RequestRef {
        let id = terminal.requests.try_send(UserRequest::Act("(go)".to_owned())).expect("room");
        let (received, _) = peer.requests.try_recv().expect("a request");
        assert_eq!(received, id);
        RequestRef { id: Some(id), conversation: ConversationId::new("c") }
    }

    /// If a person reads nothing for a while, progress reports are lost, and the ends arrive.
    #[test]
    fn progress_leaves_places_for_ends() {
        let (mut terminal, mut peer) = Terminal::open();
        let about = about(&terminal, &mut peer);
        let progress = || UserEvent::Report(about.clone(), Report::new(Outcome::Progress, ""));
        let sent = (0..CHANNEL_CAPACITY).filter(|_| peer.events.send(progress())).count();
        assert_eq!(sent, CHANNEL_CAPACITY - PLACES_FOR_ENDS);
        assert!(peer.events.send(UserEvent::Sent(about.clone())));
        assert!(peer.events.send(UserEvent::Report(about.clone(), Report::new(Outcome::Done, ""))));
        let mut last = None;
        while let Ok(event) = terminal.events.try_recv() {
            last = Some(event);
        }
        assert!(last.is_some_and(|event| event.is_final() && event.request() == about.id));
    }

    #[test]
    fn clones_share_the_numbers_of_requests() {
        let (terminal, mut peer) = Terminal::open();
        let other = terminal.requests.clone();
        let first = terminal.requests.try_send(UserRequest::Act("(a)".to_owned()));
        let second = other.try_send(UserRequest::Act("(b)".to_owned()));
        assert_ne!(first, second);
        assert_eq!(peer.requests.try_recv().ok().map(|(id, _)| id), first.ok());
    }
}
