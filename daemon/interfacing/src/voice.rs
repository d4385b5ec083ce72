//! What speaks for an ecosystem in another: an ordinary Keyboard Agent, as a person's would be.
//!
//! So an action is asked of the other's own Plan Executor, and a goal of its own Plan Requester,
//! with the tokens, the receipts and the checks that they give to everybody: nobody acts there but
//! by their rules, and no id of one ecosystem is ever heard in the other.

use std::collections::{BTreeMap, VecDeque};

use acl::content::{Outcome, Reason, Refusal, Report};
use acl::{ConversationId, Message, Performative};
use keyboard::{Heard, Said, Terminal, Wish};
use tokio::sync::mpsc;

/// Orders, and news of one order, that may wait.
const ORDERS_MAX: usize = 256;
const NEWS_MAX: usize = 64;

/// A hold on the voice. Clones speak with the same one.
#[derive(Clone, Debug)]
pub struct Voice(mpsc::Sender<Order>);

#[derive(Debug)]
enum Order {
    Ask(Said, mpsc::Sender<Heard>),
    Cancel(ConversationId),
}

/// Something that was asked for. Dropped before its end, it is taken back.
pub struct Asked {
    voice: Voice,
    news: mpsc::Receiver<Heard>,
    conversation: Option<ConversationId>,
    /// Whether it is taken back when nobody waits for it any more.
    revocable: bool,
}

/// What became of it.
#[derive(Clone, Debug)]
pub enum News {
    /// How it stands.
    Report(Report),
    /// It was declined.
    Refused(Refusal),
    /// Nobody took it.
    Unanswered,
}

impl Voice {
    /// A voice that speaks through this terminal; the future carries what is said.
    pub fn new(terminal: Terminal) -> (Voice, impl Future<Output = ()> + Send + 'static) {
        let (orders, heard) = mpsc::channel(ORDERS_MAX);
        let speaker =
            Speaker { terminal, orders: heard, said: VecDeque::new(), open: BTreeMap::new() };
        (Voice(orders), speaker.run())
    }

    /// Asks for one action.
    pub async fn act(&self, action: String, revocable: bool) -> Asked {
        self.ask(Said::Act(action), revocable).await
    }

    /// Asks for a goal.
    pub async fn wish(&self, wish: Wish, revocable: bool) -> Asked {
        self.ask(Said::Wish(wish), revocable).await
    }

    /// Gives something up.
    pub async fn cancel(&self, conversation: ConversationId) {
        // A voice that has ended has given up everything.
        let _ = self.0.send(Order::Cancel(conversation)).await;
    }

    /// Says something that is answered.
    pub async fn ask(&self, said: Said, revocable: bool) -> Asked {
        let (tell, news) = mpsc::channel(NEWS_MAX);
        // A voice that has ended drops the sender: then nothing is heard, which is an answer.
        let _ = self.0.send(Order::Ask(said, tell)).await;
        Asked { voice: self.clone(), news, conversation: None, revocable }
    }
}

impl Asked {
    /// Its conversation, once it has one.
    pub fn conversation(&self) -> Option<&ConversationId> {
        self.conversation.as_ref()
    }

    /// The next news; the last is final.
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
            // A voice with no room for it has ended, or stops at its own deadlines.
            let _ = self.voice.0.try_send(Order::Cancel(conversation));
        }
    }
}

impl News {
    /// Whether nothing more follows.
    pub fn is_final(&self) -> bool {
        match self {
            News::Report(report) => report.outcome.is_final(),
            News::Refused(_) | News::Unanswered => true,
        }
    }

    /// How it stands, in words of our own: what they say over there stays over there.
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

/// What an answer to a message that was sent as it was written says of its end.
fn news_of(message: &Message, is_final: bool) -> Option<News> {
    match message.performative {
        Performative::Confirm => message.content_as().ok().map(News::Report),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as().ok().map(News::Refused)
        }
        _ => is_final.then(|| News::Report(Report::new(Outcome::Done, "answered"))),
    }
}

/// The task that holds the terminal.
struct Speaker {
    terminal: Terminal,
    orders: mpsc::Receiver<Order>,
    /// What was said and has no conversation yet: the keyboard names them in this order.
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
        // A keyboard that has ended is noticed by what it does not say any more.
        let _ = self.terminal.say.send(said).await;
    }

    async fn hear(&mut self, heard: Heard) {
        if let Heard::Asked(conversation) = &heard {
            let Some(tell) = self.said.pop_front() else { return };
            if tell.is_closed() {
                // Nobody waited for as long as it took to say it.
                return self.say(Order::Cancel(conversation.clone())).await;
            }
            self.open.insert(conversation.clone(), tell);
        }
        let Some(conversation) = heard.conversation().cloned() else { return };
        let is_final = heard.is_final();
        if let Some(tell) = self.open.get(&conversation) {
            // Progress that nobody reads in time is lost; for the end there is always room.
            if is_final || tell.capacity() > 1 {
                let _ = tell.try_send(heard);
            }
        }
        if is_final {
            self.open.remove(&conversation);
        }
    }
}
