//! Client in another ecosystem: an ordinary Keyboard Agent, as a person's would be.
//!
//! An action is requested from that ecosystem's own Plan Executor, and a goal from its own Plan Requester,
//! with the tokens, the receipts and the checks that apply to all requests. So the actions there follow the
//! rules of that ecosystem, and no identifier of one ecosystem ever appears in the other.

use std::collections::{BTreeMap, VecDeque};

use acl::content::{Outcome, Reason, Refusal, Report};
use acl::{ConversationId, Message, Performative};
use keyboard::{Heard, Said, Terminal, Wish};
use tokio::sync::mpsc;

/// Maximum number of queued requests, and of queued reports of one request.
const ORDERS_MAX: usize = 256;
const NEWS_MAX: usize = 64;

/// Handle of the client. Clones share one client.
#[derive(Clone, Debug)]
pub struct Voice(mpsc::Sender<Order>);

#[derive(Debug)]
enum Order {
    Ask(Said, mpsc::Sender<Heard>),
    Cancel(ConversationId),
}

/// A request that was sent. If it is dropped before its end, it is cancelled.
pub struct Asked {
    voice: Voice,
    news: mpsc::Receiver<Heard>,
    conversation: Option<ConversationId>,
    /// Whether it is cancelled when it is dropped.
    revocable: bool,
}

/// Progress or end of a request.
#[derive(Clone, Debug)]
pub enum News {
    /// A report of its state.
    Report(Report),
    /// The request was refused.
    Refused(Refusal),
    /// No agent answered.
    Unanswered,
}

impl Voice {
    /// Returns a client that uses this terminal; the future runs it.
    pub fn new(terminal: Terminal) -> (Voice, impl Future<Output = ()> + Send + 'static) {
        let (orders, heard) = mpsc::channel(ORDERS_MAX);
        let speaker =
            Speaker { terminal, orders: heard, said: VecDeque::new(), open: BTreeMap::new() };
        (Voice(orders), speaker.run())
    }

    /// Requests one action.
    pub async fn act(&self, action: String, revocable: bool) -> Asked {
        self.ask(Said::Act(action), revocable).await
    }

    /// Requests a goal.
    pub async fn wish(&self, wish: Wish, revocable: bool) -> Asked {
        self.ask(Said::Wish(wish), revocable).await
    }

    /// Cancels a request.
    pub async fn cancel(&self, conversation: ConversationId) {
        // A client that has ended has cancelled everything.
        let _ = self.0.send(Order::Cancel(conversation)).await;
    }

    /// Sends a request that is answered.
    pub async fn ask(&self, said: Said, revocable: bool) -> Asked {
        let (tell, news) = mpsc::channel(NEWS_MAX);
        // A client that has ended drops the sender; [`Asked::next`] then returns [`News::Unanswered`].
        let _ = self.0.send(Order::Ask(said, tell)).await;
        Asked { voice: self.clone(), news, conversation: None, revocable }
    }
}

impl Asked {
    /// Returns its conversation; `None` until it has one.
    pub fn conversation(&self) -> Option<&ConversationId> {
        self.conversation.as_ref()
    }

    /// Waits for the next report; the last one is final.
    pub async fn next(&mut self) -> News {
        loop {
            let Some(heard) = self.news.recv().await else {
                self.revocable = false;
                return News::Unanswered;
            };
            let is_final = heard.is_final();
            if is_final {
                self.revocable = false;
            }
            match heard {
                Heard::Asked(conversation) => self.conversation = Some(conversation),
                Heard::Report(_, report) => return News::Report(report),
                Heard::Refused(_, refusal) => return News::Refused(refusal),
                Heard::Unanswered(..) => return News::Unanswered,
                Heard::Answered(message) => {
                    if let Some(news) = news_of(&message, is_final) {
                        return news;
                    }
                }
                Heard::Question(_) | Heard::QuestionClosed(..) => (),
            }
        }
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        if let Some(conversation) = self.conversation.take().filter(|_| self.revocable) {
            // If there is no room for the order, the client has ended, or the request stops at its own
            // deadlines.
            let _ = self.voice.0.try_send(Order::Cancel(conversation));
        }
    }
}

impl News {
    /// Whether no further report follows.
    pub fn is_final(&self) -> bool {
        match self {
            News::Report(report) => report.outcome.is_final(),
            News::Refused(_) | News::Unanswered => true,
        }
    }

    /// Returns why the request did not succeed; `None` if it did or still runs. Only the reason crosses,
    /// not the other ecosystem's text.
    pub fn reason(&self) -> Option<Reason> {
        match self {
            News::Refused(refusal) => Some(refusal.reason),
            News::Report(report) if report.outcome == Outcome::Failed => {
                Some(report.declined.unwrap_or(Reason::Incapable))
            }
            News::Report(_) => None,
            News::Unanswered => Some(Reason::Unanswered),
        }
    }
}

/// Returns the report that follows from an answer to a message that was sent literally.
fn news_of(message: &Message, is_final: bool) -> Option<News> {
    match message.performative {
        Performative::Confirm => message.content_as().ok().map(News::Report),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as().ok().map(News::Refused)
        }
        _ => is_final.then(|| News::Report(Report::new(Outcome::Done, "answered"))),
    }
}

/// Task that owns the terminal.
struct Speaker {
    terminal: Terminal,
    orders: mpsc::Receiver<Order>,
    /// Requests that have no conversation yet; the keyboard assigns conversations in this order.
    said: VecDeque<mpsc::Sender<Heard>>,
    open: BTreeMap<ConversationId, mpsc::Sender<Heard>>,
}

impl Speaker {
    async fn run(mut self) {
        loop {
            tokio::select! {
                biased;
                order = self.orders.recv() => match order {
                    Some(order) => self.say(order).await,
                    None => return,
                },
                heard = self.terminal.hear.recv() => match heard {
                    Some(heard) => self.hear(heard).await,
                    // The keyboard has ended with its daemon.
                    None => return,
                },
            }
        }
    }

    async fn say(&mut self, order: Order) {
        let said = match order {
            Order::Ask(said, tell) => {
                self.said.push_back(tell);
                said
            }
            Order::Cancel(conversation) => Said::Cancel(conversation),
        };
        // An end of the keyboard is noticed when it sends no more events.
        let _ = self.terminal.say.send(said).await;
    }

    async fn hear(&mut self, heard: Heard) {
        if let Heard::Asked(conversation) = &heard {
            let Some(tell) = self.said.pop_front() else { return };
            if tell.is_closed() {
                // The requester stopped waiting before the request had a conversation.
                return self.say(Order::Cancel(conversation.clone())).await;
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
