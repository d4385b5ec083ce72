//! Client that makes requests in another ecosystem: an ordinary Keyboard Agent, as a person uses
//! one.
//!
//! An action is requested from the Plan Executor of the other ecosystem, and a goal from its Plan
//! Requester. All tokens, receipts and checks of the other ecosystem apply to these requests. No
//! identifier of one ecosystem ever appears in the other.
//!
//! The terminal numbers the requests, and each answer carries the number of its request. The loss
//! of an answer therefore affects one request only, which ends at its deadline.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Outcome, Reason, Refusal, Report};
use acl::{ConversationId, Message, Performative};
use keyboard::{GoalRequest, RequestId, Terminal, UserEvent, UserRequest};
use tokio::sync::{Notify, mpsc};
use tokio::time::Instant;

/// Maximum number of requests that wait in the client's queue; a further request waits for room.
/// `UPDATES_MAX` is the maximum number of reports on one request that wait; further reports are
/// lost.
const COMMANDS_MAX: usize = 256;
const UPDATES_MAX: usize = 64;

/// Maximum time for which a request may be without a conversation. The Keyboard Agent, which is in
/// this process, assigns a conversation at once. If this time passes, the notice of the
/// conversation is lost, or the Keyboard Agent does not run.
const START_DEADLINE: Duration = Duration::from_secs(30);

/// Handle of a client that makes requests in another ecosystem. Clones share one client.
#[derive(Clone, Debug)]
pub struct RemoteClient {
    commands: mpsc::Sender<OpenRequest>,
    /// Notified when a handle of a request is dropped.
    abandoned: Arc<Notify>,
}

/// A request that was sent to another ecosystem. If this handle is dropped before the request has
/// ended, the request is cancelled, if it is revocable.
pub struct RemoteRequest {
    updates: mpsc::Receiver<UserEvent>,
    conversation: Option<ConversationId>,
    /// Deadline for the assignment of a conversation; the request is given up if it has none by
    /// then.
    started_by: Instant,
    /// Maximum duration of the request, and the time at which that duration is over; `None` if the
    /// duration is not limited.
    ended_by: Option<(Duration, Instant)>,
    abandoned: Arc<Notify>,
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
    /// The request was given up, because it had not ended within this time.
    DeadlinePassed(Duration),
}

// === impl RemoteClient ===

impl RemoteClient {
    /// Returns a client that sends its requests through `terminal`, and a future that must be run
    /// for the client to work.
    pub fn new(terminal: Terminal) -> (RemoteClient, impl Future<Output = ()> + Send + 'static) {
        let (send, commands) = mpsc::channel(COMMANDS_MAX);
        let abandoned = Arc::new(Notify::new());
        let task = ClientTask {
            terminal,
            commands,
            abandoned: Arc::clone(&abandoned),
            outgoing: VecDeque::new(),
            open: BTreeMap::new(),
        };
        (RemoteClient { commands: send, abandoned }, task.run())
    }

    /// Requests one action, and gives up after the time `within`. If `revocable` is true, the
    /// action is cancelled at that time, or when the returned handle is dropped earlier.
    pub async fn request_action(
        &self,
        action: String,
        revocable: bool,
        within: Duration,
    ) -> RemoteRequest {
        self.send_request(UserRequest::Act(action), revocable, Some(within)).await
    }

    /// Requests a goal. If `revocable` is true, the goal is cancelled when the returned handle is
    /// dropped before the goal has ended. There is no time limit, because a goal may be kept for
    /// ever.
    pub async fn request_goal(&self, wish: GoalRequest, revocable: bool) -> RemoteRequest {
        self.send_request(UserRequest::RequestGoal(wish), revocable, None).await
    }

    /// Sends a request of any kind, and returns a handle that receives the answers.
    pub async fn send_request(
        &self,
        request: UserRequest,
        revocable: bool,
        within: Option<Duration>,
    ) -> RemoteRequest {
        let (updates, news) = mpsc::channel(UPDATES_MAX);
        let conversation = None;
        let request = Some(request);
        // A client that has ended drops the sender; [`RemoteRequest::next`] then returns
        // [`RemoteUpdate::Unanswered`].
        let _ = self.commands.send(OpenRequest { request, updates, revocable, conversation }).await;
        let now = Instant::now();
        RemoteRequest {
            updates: news,
            conversation: None,
            started_by: now + START_DEADLINE,
            // A time beyond the range of the clock means no deadline.
            ended_by: within.and_then(|within| Some((within, now.checked_add(within)?))),
            abandoned: Arc::clone(&self.abandoned),
        }
    }
}

// === impl RemoteRequest ===

impl RemoteRequest {
    /// Returns the conversation of the request; `None` until the request has one.
    pub fn conversation(&self) -> Option<&ConversationId> {
        self.conversation.as_ref()
    }

    /// Waits for the next report on the request; the last report is final.
    pub async fn next(&mut self) -> RemoteUpdate {
        loop {
            let heard = match self.deadline() {
                None => self.updates.recv().await,
                Some((within, at)) => {
                    match tokio::time::timeout_at(at, self.updates.recv()).await {
                        Ok(heard) => heard,
                        Err(_) => return self.give_up(within),
                    }
                }
            };
            let Some(heard) = heard else { return RemoteUpdate::Unanswered };
            if self.conversation.is_none() {
                self.conversation = heard.conversation().cloned();
            }
            let is_final = heard.is_final();
            match heard {
                UserEvent::Report(_, report) => return RemoteUpdate::Report(report),
                UserEvent::Refused(_, refusal) => return RemoteUpdate::Refused(refusal),
                UserEvent::Unanswered(..) => return RemoteUpdate::Unanswered,
                UserEvent::Answered(_, message) => {
                    if let Some(news) = update_of(&message, is_final) {
                        return news;
                    }
                }
                UserEvent::Sent(_) | UserEvent::Question(_) | UserEvent::QuestionClosed(..) => (),
            }
        }
    }

    /// Returns the next deadline of the request, and the length of the time limit that ends there.
    /// Returns `None` if no deadline applies.
    fn deadline(&self) -> Option<(Duration, Instant)> {
        let start = (START_DEADLINE, self.started_by);
        let start = self.conversation.is_none().then_some(start);
        start.into_iter().chain(self.ended_by).min_by_key(|(_, at)| *at)
    }

    fn give_up(&mut self, within: Duration) -> RemoteUpdate {
        // To the client, a closed channel means that the handle of the request was dropped.
        self.updates.close();
        self.abandoned.notify_one();
        RemoteUpdate::DeadlinePassed(within)
    }
}

impl Drop for RemoteRequest {
    fn drop(&mut self) {
        self.updates.close();
        self.abandoned.notify_one();
    }
}

// === impl RemoteUpdate ===

impl RemoteUpdate {
    /// Whether no further report on the request follows this one.
    pub fn is_final(&self) -> bool {
        match self {
            RemoteUpdate::Report(report) => report.outcome.is_final(),
            RemoteUpdate::Refused(_)
            | RemoteUpdate::Unanswered
            | RemoteUpdate::DeadlinePassed(_) => true,
        }
    }

    /// Returns the reason why the request did not succeed; `None` if it succeeded or still runs.
    /// The text of the other ecosystem is not included.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            RemoteUpdate::Refused(refusal) => Some(refusal.reason),
            RemoteUpdate::Report(report) if report.outcome == Outcome::Failed => {
                Some(report.declined.unwrap_or(Reason::Incapable))
            }
            RemoteUpdate::Report(_) => None,
            RemoteUpdate::Unanswered => Some(Reason::Unanswered),
            RemoteUpdate::DeadlinePassed(_) => Some(Reason::TimedOut),
        }
    }
}

/// Converts an answer to a request that was typed as a whole message. Returns `None` if the answer
/// contains nothing about the state of the request.
fn update_of(message: &Message, is_final: bool) -> Option<RemoteUpdate> {
    match message.performative {
        Performative::Confirm => message.content_as().ok().map(RemoteUpdate::Report),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as().ok().map(RemoteUpdate::Refused)
        }
        _ => is_final.then(|| RemoteUpdate::Report(Report::new(Outcome::Done, "answered"))),
    }
}

/// A request from the time at which it was made until its end.
#[derive(Debug)]
struct OpenRequest {
    /// The request; `None` after it was sent.
    request: Option<UserRequest>,
    /// Channel for the answers; closed when the requester waits no longer.
    updates: mpsc::Sender<UserEvent>,
    revocable: bool,
    /// Conversation of the request; `None` until the Keyboard Agent has assigned one.
    conversation: Option<ConversationId>,
}

/// Task that sends the requests of a client through the terminal, and passes the answers on.
struct ClientTask {
    terminal: Terminal,
    commands: mpsc::Receiver<OpenRequest>,
    abandoned: Arc<Notify>,
    /// Messages that wait for a place in the channel to the keyboard: cancellations, and at most
    /// one request.
    outgoing: VecDeque<Outgoing>,
    open: BTreeMap<RequestId, OpenRequest>,
}

enum Outgoing {
    Request(OpenRequest),
    Cancel(ConversationId),
}

impl ClientTask {
    /// Works until the keyboard has ended, or until no handle of the client is left. The loop
    /// always receives from the keyboard too, so that the channel for the keyboard's answers does
    /// not fill up.
    async fn run(mut self) {
        loop {
            tokio::select! {
                biased;
                heard = self.terminal.events.recv() => match heard {
                    Some(heard) => self.handle_event(heard),
                    // The keyboard has ended with its daemon.
                    None => return,
                },
                () = self.abandoned.notified() => self.cancel_abandoned(),
                place = self.terminal.requests.reserve(), if !self.outgoing.is_empty() => {
                    let Ok(place) = place else { return };
                    match self.outgoing.pop_front() {
                        Some(Outgoing::Cancel(conversation)) => {
                            place.send(UserRequest::Cancel(conversation));
                        }
                        Some(Outgoing::Request(mut open)) => {
                            if let Some(request) = open.request.take() {
                                self.open.insert(place.send(request), open);
                            }
                        }
                        None => (),
                    }
                }
                command = self.commands.recv(), if self.outgoing.is_empty() => match command {
                    Some(open) if open.updates.is_closed() => (),
                    Some(open) => self.outgoing.push_back(Outgoing::Request(open)),
                    None => return,
                },
            }
        }
    }

    /// Ends the requests with a dropped handle. A request that was not sent yet is removed. A sent
    /// request with a conversation is removed, and cancelled if it is revocable. A sent request
    /// without a conversation stays; `handle_event` cancels it once its conversation is known.
    fn cancel_abandoned(&mut self) {
        self.outgoing
            .retain(|next| !matches!(next, Outgoing::Request(open) if open.updates.is_closed()));
        let outgoing = &mut self.outgoing;
        self.open.retain(|_, open| {
            let Some(conversation) =
                open.conversation.as_ref().filter(|_| open.updates.is_closed())
            else {
                return true;
            };
            if open.revocable {
                outgoing.push_back(Outgoing::Cancel(conversation.clone()));
            }
            false
        });
    }

    fn handle_event(&mut self, heard: UserEvent) {
        // An event without a known number belongs to a question, or to a request that has ended.
        let Some(id) = heard.request() else { return };
        let Some(open) = self.open.get_mut(&id) else { return };
        let is_final = heard.is_final();
        if open.conversation.is_none() {
            open.conversation = heard.conversation().cloned();
            if let Some(conversation) =
                open.conversation.clone().filter(|_| open.updates.is_closed())
            {
                self.open.remove(&id);
                if !is_final {
                    self.outgoing.push_back(Outgoing::Cancel(conversation));
                }
                return;
            }
        }
        // A progress report is dropped if the channel is nearly full; one place is kept free for
        // the final report.
        if is_final || open.updates.capacity() > 1 {
            let _ = open.updates.try_send(heard);
        }
        if is_final {
            self.open.remove(&id);
        }
    }
}

#[cfg(test)]
mod tests {
    use acl::content::Keep;
    use keyboard::{RequestRef, TerminalPeer};

    use super::*;

    /// Starts a client. The returned ends of its terminal stand for the Keyboard Agent.
    fn client() -> (RemoteClient, TerminalPeer) {
        let (terminal, keyboard) = Terminal::open();
        let (client, work) = RemoteClient::new(terminal);
        tokio::spawn(work);
        (client, keyboard)
    }

    fn goal(text: &str) -> GoalRequest {
        let partition = Default::default();
        GoalRequest { goal: text.to_owned(), keep: Keep::Achieve, priority: 0, partition }
    }

    /// Receives the next request at the keyboard, and gives it the conversation `name`.
    async fn receive(keyboard: &mut TerminalPeer, name: &str) -> (RequestRef, UserRequest) {
        let (id, request) = keyboard.requests.recv().await.expect("a request");
        (RequestRef { id: Some(id), conversation: ConversationId::new(name) }, request)
    }

    fn done(about: &RequestRef) -> UserEvent {
        UserEvent::Report(about.clone(), Report::new(Outcome::Done, about.conversation.as_str()))
    }

    #[track_caller]
    fn assert_done(update: &RemoteUpdate, detail: &str) {
        assert!(
            matches!(update, RemoteUpdate::Report(report) if report.detail == detail),
            "{detail}: {update:?}"
        );
    }

    /// The channel to the client is full when the first goal begins, so the notice of it is lost.
    /// The second goal gets its own answers, and the first one ends with the reason.
    #[tokio::test(start_paused = true)]
    async fn a_lost_notice_gives_no_answer_to_another_request() {
        let (client, mut keyboard) = client();
        let mut lost = client.request_goal(goal("(lost)"), true).await;
        let mut heard = client.request_goal(goal("(heard)"), true).await;
        let (first, _) = receive(&mut keyboard, "first").await;
        let (second, _) = receive(&mut keyboard, "second").await;
        let closed = UserEvent::QuestionClosed(1, "of no interest".to_owned());
        while keyboard.events.send(closed.clone()) {}
        assert!(!keyboard.events.send(UserEvent::Sent(first)));
        tokio::task::yield_now().await;
        assert!(keyboard.events.send(UserEvent::Sent(second.clone())));
        assert!(keyboard.events.send(done(&second)));
        assert_done(&heard.next().await, "second");
        assert_eq!(heard.conversation(), Some(&second.conversation));
        let ended = lost.next().await;
        assert!(matches!(ended, RemoteUpdate::DeadlinePassed(START_DEADLINE)), "{ended:?}");
        assert_eq!(ended.reason(), Some(Reason::TimedOut));
    }

    /// Without the notice, a later answer still belongs to its request.
    #[tokio::test(start_paused = true)]
    async fn an_answer_needs_no_notice() {
        let (client, mut keyboard) = client();
        let mut first = client.request_goal(goal("(a)"), true).await;
        let mut second = client.request_goal(goal("(b)"), true).await;
        let (about_first, _) = receive(&mut keyboard, "first").await;
        let (about_second, _) = receive(&mut keyboard, "second").await;
        assert!(keyboard.events.send(done(&about_second)));
        assert!(keyboard.events.send(done(&about_first)));
        assert_done(&first.next().await, "first");
        assert_done(&second.next().await, "second");
    }

    #[tokio::test(start_paused = true)]
    async fn a_lost_end_is_replaced_at_the_deadline() {
        let within = Duration::from_secs(60);
        for revocable in [true, false] {
            let (client, mut keyboard) = client();
            let began = Instant::now();
            let mut action = client.request_action("(go)".to_owned(), revocable, within).await;
            let (about, _) = receive(&mut keyboard, "action").await;
            assert!(keyboard.events.send(UserEvent::Sent(about.clone())));
            let ended = action.next().await;
            assert!(matches!(ended, RemoteUpdate::DeadlinePassed(passed) if passed == within));
            assert!(began.elapsed() >= within);
            // A cancellation, if there is one, comes before the next request.
            let next = client.request_goal(goal("(next)"), true).await;
            let (_, request) = receive(&mut keyboard, "later").await;
            let is_cancelled =
                matches!(request, UserRequest::Cancel(it) if it == about.conversation);
            assert_eq!(is_cancelled, revocable);
            drop(next);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_request_that_is_dropped_before_it_began_is_cancelled_when_it_begins() {
        let (client, mut keyboard) = client();
        let dropped = client.request_action("(go)".to_owned(), false, Duration::from_secs(1)).await;
        let (about, _) = receive(&mut keyboard, "action").await;
        drop(dropped);
        assert!(keyboard.events.send(UserEvent::Sent(about.clone())));
        let (_, request) = receive(&mut keyboard, "cancellation").await;
        assert!(matches!(request, UserRequest::Cancel(it) if it == about.conversation));
    }
}
