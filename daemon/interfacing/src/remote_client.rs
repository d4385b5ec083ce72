//! Client that makes requests in another ecosystem: an ordinary Keyboard Agent, as a person uses one.
//!
//! An action is requested from the Plan Executor of the other ecosystem, and a goal from its Plan
//! Requester, with the tokens, the receipts and the checks that apply to all requests. So the actions in
//! the other ecosystem follow the rules there, and no identifier of one ecosystem ever appears in the
//! other.

use std::collections::{BTreeMap, VecDeque};

use acl::content::{Outcome, Reason, Refusal, Report};
use acl::{ConversationId, Message, Performative};
use keyboard::{GoalRequest, Terminal, UserEvent, UserRequest};
use tokio::sync::mpsc;

/// Maximum number of requests that wait in the client's queue. `UPDATES_MAX` is the maximum number of
/// reports on one request that wait.
const COMMANDS_MAX: usize = 256;
const UPDATES_MAX: usize = 64;

/// Handle of a client that makes requests in another ecosystem. Clones share one client.
#[derive(Clone, Debug)]
pub struct RemoteClient(mpsc::Sender<RemoteCommand>);

#[derive(Debug)]
enum RemoteCommand {
    Ask(UserRequest, mpsc::Sender<UserEvent>),
    Cancel(ConversationId),
}

/// A request that was sent to another ecosystem. If this handle is dropped before the request has ended,
/// the request is cancelled, if it is revocable.
pub struct RemoteRequest {
    client: RemoteClient,
    updates: mpsc::Receiver<UserEvent>,
    conversation: Option<ConversationId>,
    /// Whether the request is cancelled when this handle is dropped.
    revocable: bool,
}

/// Progress or end of a request in another ecosystem.
#[derive(Clone, Debug)]
pub enum RemoteUpdate {
    /// A report of the state of the request.
    Report(Report),
    /// The request was refused, for this reason.
    Refused(Refusal),
    /// No agent answered the request.
    Unanswered,
}

impl RemoteClient {
    /// Returns a client that sends its requests through `terminal`, and a future that must be run for the
    /// client to work.
    pub fn new(terminal: Terminal) -> (RemoteClient, impl Future<Output = ()> + Send + 'static) {
        let (orders, heard) = mpsc::channel(COMMANDS_MAX);
        let speaker = ClientTask {
            terminal,
            commands: heard,
            awaiting_conversation: VecDeque::new(),
            open: BTreeMap::new(),
        };
        (RemoteClient(orders), speaker.run())
    }

    /// Requests one action. If `revocable` is true, the action is cancelled when the returned handle is
    /// dropped early.
    pub async fn request_action(&self, action: String, revocable: bool) -> RemoteRequest {
        self.send_request(UserRequest::Act(action), revocable).await
    }

    /// Requests a goal. If `revocable` is true, the goal is cancelled when the returned handle is dropped
    /// early.
    pub async fn request_goal(&self, wish: GoalRequest, revocable: bool) -> RemoteRequest {
        self.send_request(UserRequest::RequestGoal(wish), revocable).await
    }

    /// Cancels the request that has this conversation.
    pub async fn cancel(&self, conversation: ConversationId) {
        // A client that has ended has cancelled everything.
        let _ = self.0.send(RemoteCommand::Cancel(conversation)).await;
    }

    /// Sends a request of any kind, and returns a handle that receives the answers.
    pub async fn send_request(&self, said: UserRequest, revocable: bool) -> RemoteRequest {
        let (tell, news) = mpsc::channel(UPDATES_MAX);
        // A client that has ended drops the sender; [`RemoteRequest::next`] then returns [`RemoteUpdate::Unanswered`].
        let _ = self.0.send(RemoteCommand::Ask(said, tell)).await;
        RemoteRequest { client: self.clone(), updates: news, conversation: None, revocable }
    }
}

impl RemoteRequest {
    /// Returns the conversation of the request; `None` until the request has one.
    pub fn conversation(&self) -> Option<&ConversationId> {
        self.conversation.as_ref()
    }

    /// Waits for the next report on the request; the last report is final.
    pub async fn next(&mut self) -> RemoteUpdate {
        loop {
            let Some(heard) = self.updates.recv().await else {
                self.revocable = false;
                return RemoteUpdate::Unanswered;
            };
            let is_final = heard.is_final();
            if is_final {
                self.revocable = false;
            }
            match heard {
                UserEvent::Sent(conversation) => self.conversation = Some(conversation),
                UserEvent::Report(_, report) => return RemoteUpdate::Report(report),
                UserEvent::Refused(_, refusal) => return RemoteUpdate::Refused(refusal),
                UserEvent::Unanswered(..) => return RemoteUpdate::Unanswered,
                UserEvent::Answered(message) => {
                    if let Some(news) = update_of(&message, is_final) {
                        return news;
                    }
                }
                UserEvent::Question(_) | UserEvent::QuestionClosed(..) => (),
            }
        }
    }
}

impl Drop for RemoteRequest {
    fn drop(&mut self) {
        if let Some(conversation) = self.conversation.take().filter(|_| self.revocable) {
            // If there is no room for the order, the client has ended, or the request stops at its own
            // deadlines.
            let _ = self.client.0.try_send(RemoteCommand::Cancel(conversation));
        }
    }
}

impl RemoteUpdate {
    /// Whether no further report on the request follows this one.
    pub fn is_final(&self) -> bool {
        match self {
            RemoteUpdate::Report(report) => report.outcome.is_final(),
            RemoteUpdate::Refused(_) | RemoteUpdate::Unanswered => true,
        }
    }

    /// Returns the reason why the request did not succeed; `None` if it succeeded or still runs. The text
    /// of the other ecosystem is not included.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            RemoteUpdate::Refused(refusal) => Some(refusal.reason),
            RemoteUpdate::Report(report) if report.outcome == Outcome::Failed => {
                Some(report.declined.unwrap_or(Reason::Incapable))
            }
            RemoteUpdate::Report(_) => None,
            RemoteUpdate::Unanswered => Some(Reason::Unanswered),
        }
    }
}

/// Converts an answer to a message that was sent as it was written. Returns `None` if the answer says
/// nothing about the state of the request.
fn update_of(message: &Message, is_final: bool) -> Option<RemoteUpdate> {
    match message.performative {
        Performative::Confirm => message.content_as().ok().map(RemoteUpdate::Report),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as().ok().map(RemoteUpdate::Refused)
        }
        _ => is_final.then(|| RemoteUpdate::Report(Report::new(Outcome::Done, "answered"))),
    }
}

/// Task that sends the requests of a client through the terminal, and passes the answers on.
struct ClientTask {
    terminal: Terminal,
    commands: mpsc::Receiver<RemoteCommand>,
    /// Where to send the answers to requests that have no conversation yet. The keyboard assigns
    /// conversations in the order of this queue.
    awaiting_conversation: VecDeque<mpsc::Sender<UserEvent>>,
    open: BTreeMap<ConversationId, mpsc::Sender<UserEvent>>,
}

impl ClientTask {
    async fn run(mut self) {
        loop {
            tokio::select! {
                biased;
                order = self.commands.recv() => match order {
                    Some(order) => self.handle_command(order).await,
                    None => return,
                },
                heard = self.terminal.events.recv() => match heard {
                    Some(heard) => self.handle_event(heard).await,
                    // The keyboard has ended with its daemon.
                    None => return,
                },
            }
        }
    }

    async fn handle_command(&mut self, order: RemoteCommand) {
        let said = match order {
            RemoteCommand::Ask(said, tell) => {
                self.awaiting_conversation.push_back(tell);
                said
            }
            RemoteCommand::Cancel(conversation) => UserRequest::Cancel(conversation),
        };
        // An end of the keyboard is noticed when it sends no more events.
        let _ = self.terminal.requests.send(said).await;
    }

    async fn handle_event(&mut self, heard: UserEvent) {
        if let UserEvent::Sent(conversation) = &heard {
            let Some(tell) = self.awaiting_conversation.pop_front() else { return };
            if tell.is_closed() {
                // The requester stopped waiting before the request had a conversation.
                return self.handle_command(RemoteCommand::Cancel(conversation.clone())).await;
            }
            self.open.insert(conversation.clone(), tell);
        }
        let Some(conversation) = heard.conversation().cloned() else { return };
        let is_final = heard.is_final();
        if let Some(tell) = self.open.get(&conversation) {
            // Progress that is not read in time is lost; one place is kept free for the end.
            if is_final || tell.capacity() > 1 {
                let _ = tell.try_send(heard);
            }
        }
        if is_final {
            self.open.remove(&conversation);
        }
    }
}
