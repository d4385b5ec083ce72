//! The terminal of a Keyboard Agent: two channels between the agent and a person, and the messages in
//! them. Each request has a number, and each output about it repeats that number: so an output that is
//! lost changes the meaning of no other.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use acl::content::{ChangeState, Keep, Mode, OpenQuestion, Outcome, Partition, Refusal, Report};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use serde::Deserialize;
use serde_json::Value;
use tokio::sync::mpsc;

/// Capacity in messages of each of the two channels.
const CHANNEL_CAPACITY: usize = 1_024;

/// Places in the channel of outputs that progress may not take, so that the beginning and the end of
/// requests arrive even if the person reads nothing for a while.
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

/// Number of a request among the requests of one terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestId(u64);

/// The request that an output is about.
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
    /// No agent took the request, or none answered in time. The text is the reason.
    Unanswered(RequestRef, String),
    /// An answer to a message that was sent as the person wrote it.
    Answered(Option<RequestId>, Box<Message>),
    /// An agent asks the person a question.
    Question(OpenQuestion),
    /// The question with this number was closed, for the reason in the text.
    QuestionClosed(u64, String),
}

/// The ends of the two channels to a Keyboard Agent that belong to the person.
pub struct Terminal {
    /// Inputs of the person.
    pub requests: RequestSender,
    /// Outputs to the person.
    pub events: mpsc::Receiver<UserEvent>,
}

/// The ends of the two channels that belong to the Keyboard Agent.
pub struct TerminalPeer {
    /// Inputs of the person, each with its number.
    pub requests: mpsc::Receiver<(RequestId, UserRequest)>,
    /// Outputs to the person.
    pub events: EventSender,
}

/// Sends requests to a Keyboard Agent. Clones share the numbers of the requests.
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

/// A request did not get into the channel to the Keyboard Agent. Completes “failed to …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("reach the keyboard agent: it has ended, or too many requests wait for it")]
pub struct RequestNotSent;

/// Sends outputs to the person at a terminal.
#[derive(Clone, Debug)]
pub struct EventSender(mpsc::Sender<UserEvent>);

// === impl Terminal ===

impl Terminal {
    /// Creates a terminal, and the ends of its channels that belong to the Keyboard Agent.
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
    /// Returns the number that the request will have.
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
    /// Sends an output. Returns `false` if it is lost, because the person has not read many earlier
    /// ones, or because the terminal is closed. Progress is lost first.
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

    /// Whether no more outputs follow in the conversation that this output is about.
    pub fn is_final(&self) -> bool {
        match self {
            UserEvent::Sent(_) | UserEvent::Question(_) | UserEvent::QuestionClosed(..) => false,
            UserEvent::Report(_, report) => report.outcome.is_final(),
            UserEvent::Refused(..) | UserEvent::Unanswered(..) => true,
            UserEvent::Answered(_, message) => is_last(message),
        }
    }

    /// Whether this output reports progress of a request: neither its beginning nor its end.
    fn is_progress(&self) -> bool {
        matches!(self, UserEvent::Report(..) | UserEvent::Answered(..)) && !self.is_final()
    }

    /// Whether this output reports that the request has ended well, or that the goal holds.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn about(terminal: &Terminal, peer: &mut TerminalPeer) -> RequestRef {
        let id = terminal.requests.try_send(UserRequest::Act("(go)".to_owned())).expect("room");
        let (received, _) = peer.requests.try_recv().expect("a request");
        assert_eq!(received, id);
        RequestRef { id: Some(id), conversation: ConversationId::new("c") }
    }

    /// A person that reads nothing for a while loses progress, and learns the ends.
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
    fn clones_number_their_requests_together() {
        let (terminal, mut peer) = Terminal::open();
        let other = terminal.requests.clone();
        let first = terminal.requests.try_send(UserRequest::Act("(a)".to_owned()));
        let second = other.try_send(UserRequest::Act("(b)".to_owned()));
        assert_ne!(first, second);
        assert_eq!(peer.requests.try_recv().ok().map(|(id, _)| id), first.ok());
    }
}
