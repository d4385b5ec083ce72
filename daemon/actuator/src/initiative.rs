//! Initiatives of an actuator: it announces events of its device at once, requests goals as users do,
//! and asks people questions.
//!
//! - A device reports events by [`Device::watch`] and answers each with [`Initiative`]s. News of an
//!   initiative are passed to [`Device::heard`].
//! - A goal stays requested until it ends or is withdrawn. If the Plan Requester was absent or was
//!   restarted, the goal is requested (again) when it joins.
//! - The first answer to a question counts, and the question is then withdrawn at all keyboards. A
//!   refusal by one keyboard does not end the question.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    Achieve, Inform, Outcome, Question, Reason, Refusal, Report, Request, Withdrawal, value,
};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{Answer, Context, Opening, Presence, Resident, Undelivered, Work};
use credentials::AnswerKey;
use serde_json::Value;

use crate::actuator::Actuator;
use crate::device::Device;

/// Minimum time between two events of a device, so that a loose contact does not flood the ecosystem.
/// The first event is announced at once.
const REST: Duration = Duration::from_millis(100);

/// How long a goal may go without any report. A maintained goal may hold for a year.
const GOAL_PATIENCE: Duration = Duration::from_secs(365 * 24 * 3_600);

/// Delay before a goal is requested again after the Plan Requester's mailbox was full: a burst is over
/// by then.
const FULL: Duration = Duration::from_secs(1);

/// Delay before a failed goal that the device insists on is requested again. It doubles with each
/// failure, from the time another agent needs to start to the time a repair takes.
const INSISTING_FIRST: Duration = Duration::from_secs(1);
const INSISTING_MAX: Duration = Duration::from_secs(300);

/// Maximum number of open goals, and of open questions, of one device. A camera has one or two.
const OPEN_MAX: usize = 32;

/// An event of a device: changes the device and returns its initiatives.
pub type Stir<D> = Box<dyn FnOnce(&mut D) -> Vec<Initiative> + Send>;

/// An action that a device takes by itself. The device chooses the names, which identify its goals and
/// its questions.
#[derive(Clone, Debug, PartialEq)]
pub enum Initiative {
    /// Requests a goal from the Plan Requester. The same goal under the same name is requested once;
    /// another goal replaces the one before.
    Want {
        /// Its name.
        name: String,
        /// The goal.
        goal: Achieve,
        /// Whether the goal is requested again after a failure, at growing intervals, until it is
        /// withdrawn.
        insists: bool,
    },
    /// Withdraws the goal and the question of this name, if there are any. No more news of them follow.
    Withdraw {
        /// Its name.
        name: String,
    },
    /// Asks people at all keyboards, and takes the first answer. The answer may be a secret and is
    /// encrypted on its way here. Another question of the same name replaces this one.
    Ask {
        /// Its name.
        name: String,
        /// The question.
        question: Question,
        /// How long to wait for an answer.
        patience: Duration,
    },
}

/// News of an initiative.
#[derive(Clone, Debug, PartialEq)]
pub enum News {
    /// The state of the goal.
    Report(Report),
    /// The goal was refused.
    Refused(Refusal),
    /// A person's answer.
    Answer(String),
    /// No agent took the goal, or no person answered in time; with the reason.
    Unanswered(String),
}

impl News {
    /// Whether no more news follow, so that the name is free again.
    pub fn is_final(&self) -> bool {
        match self {
            News::Report(report) => report.outcome.is_final(),
            News::Refused(_) | News::Answer(_) | News::Unanswered(_) => true,
        }
    }

    /// Whether a goal failed, other than by a cancellation.
    fn has_failed(&self) -> bool {
        match self {
            News::Report(report) => report.outcome == Outcome::Failed,
            News::Refused(_) | News::Unanswered(_) => true,
            News::Answer(_) => false,
        }
    }

    fn holds(&self) -> bool {
        matches!(self, News::Report(report) if report.outcome == Outcome::Holds)
    }
}

/// The open goals and questions of a device.
#[derive(Default)]
pub(crate) struct Initiatives {
    watching: Option<Work>,
    goals: BTreeMap<String, Wanted>,
    questions: BTreeMap<String, ReplyToken>,
    /// Number of requests so far. Identifies each request, so that answers to an earlier one of the
    /// same name are recognised.
    askings: u64,
}

/// A goal that the device wants.
struct Wanted {
    goal: Achieve,
    /// Conversation of the goal, the same for every Plan Requester that leads, so that repeated
    /// requests mean one goal. A new one after a failure.
    conversation: ConversationId,
    insists: bool,
    /// Number of failures in a row.
    failures: u32,
    /// The open request; `None` while no Plan Requester is present.
    asked: Option<Asked>,
}

struct Asked {
    asking: u64,
    exchange: ReplyToken,
    of: Resident,
}

fn plan_requester() -> AgentId {
    AgentId::new("plan-requester").expect("invariant: a literal that is a name")
}

impl<D: Device> Actuator<D> {
    // === watching ===

    /// Stores the initial look at the device; the device is watched when it is done.
    pub(crate) fn looks(&mut self, work: Work) {
        self.initiatives.watching = Some(work);
    }

    pub(crate) fn watch(&mut self, ctx: &mut Context<Self>) {
        let Some(next) = self.device.watch() else { return };
        let work = ctx.run(next, |actuator: &mut Self, stir, ctx| {
            let initiatives = stir(&mut actuator.device);
            // Heartbeat first: an agent that receives the goal may query the state at once.
            actuator.beat(ctx);
            actuator.take(initiatives, ctx);
            ctx.after(REST, |actuator: &mut Self, ctx| actuator.watch(ctx));
        });
        self.initiatives.watching = Some(work);
    }

    fn take(&mut self, initiatives: Vec<Initiative>, ctx: &mut Context<Self>) {
        for initiative in initiatives {
            match initiative {
                Initiative::Want { name, goal, insists } => self.want(name, goal, insists, ctx),
                Initiative::Withdraw { name } => {
                    self.withdraw(&name, ctx);
                    self.unask(&name, "the answer is not needed any more".to_owned(), ctx);
                }
                Initiative::Ask { name, question, patience } => {
                    self.ask(name, &question, patience, ctx);
                }
            }
        }
    }

    /// Passes news of an initiative to the device.
    fn hear(&mut self, name: &str, news: &News, ctx: &mut Context<Self>) {
        // A person's answer is not logged: it may be a secret.
        let word = match news {
            News::Report(report) => report.detail.as_str(),
            News::Refused(refusal) => refusal.detail.as_str(),
            News::Answer(_) => "an answer came",
            News::Unanswered(why) => why.as_str(),
        };
        tracing::info!(initiative = name, word, "news of an initiative");
        let initiatives = self.device.heard(name, news);
        self.beat(ctx);
        self.take(initiatives, ctx);
    }

    fn decline(&mut self, name: String, ctx: &mut Context<Self>) {
        let detail = format!("{OPEN_MAX} requests are open already");
        let news = News::Refused(Refusal::new(Reason::Busy, detail));
        // Later, because the device is still being called.
        ctx.after(Duration::ZERO, move |actuator: &mut Self, ctx| actuator.hear(&name, &news, ctx));
    }

    // === goals ===

    fn want(&mut self, name: String, goal: Achieve, insists: bool, ctx: &mut Context<Self>) {
        if self.initiatives.goals.get(&name).is_some_and(|wanted| wanted.goal == goal) {
            return;
        }
        self.withdraw(&name, ctx);
        if self.initiatives.goals.len() >= OPEN_MAX {
            return self.decline(name, ctx);
        }
        let conversation = ctx.new_conversation();
        let wanted = Wanted { goal, conversation, insists, failures: 0, asked: None };
        self.initiatives.goals.insert(name.clone(), wanted);
        if let Some(requester) = ctx.find(&plan_requester()) {
            self.request(&name, requester, ctx);
        }
    }

    fn request(&mut self, name: &str, of: Resident, ctx: &mut Context<Self>) {
        self.initiatives.askings += 1;
        let asking = self.initiatives.askings;
        let Some(wanted) = self.initiatives.goals.get_mut(name) else { return };
        let opening = Opening {
            to: Some(of.agent.clone()),
            performative: Performative::Request,
            protocol: Protocol::Goal,
            conversation: wanted.conversation.clone(),
            content: value(&Request::Achieve(wanted.goal.clone())),
        };
        let about = name.to_owned();
        let exchange = ctx.open(opening, GOAL_PATIENCE, move |actuator: &mut Self, answer, ctx| {
            actuator.requester_answered(&about, asking, &answer, ctx);
        });
        wanted.asked = Some(Asked { asking, exchange, of });
    }

    fn requester_answered(
        &mut self,
        name: &str,
        asking: u64,
        answer: &Answer,
        ctx: &mut Context<Self>,
    ) {
        let Some(wanted) = self.initiatives.goals.get_mut(name) else { return };
        if wanted.asked.as_ref().is_none_or(|asked| asked.asking != asking) {
            return;
        }
        let news = match answer {
            Answer::Undelivered(Undelivered::Left | Undelivered::Restarted) => {
                wanted.asked = None;
                return;
            }
            Answer::Undelivered(why) => News::Unanswered(why.to_string()),
            Answer::Silence => News::Unanswered("no answer came within a year".to_owned()),
            Answer::Message(message) => match read(message) {
                Ok(news) => news,
                Err(error) => return ctx.not_understood(message, error),
            },
        };
        let is_full = |refusal: &Refusal| refusal.reason == Reason::MailboxFull;
        if matches!(&news, News::Refused(refusal) if is_full(refusal)) {
            return self.request_later(name.to_owned(), asking, FULL, ctx);
        }
        if news.has_failed() && wanted.insists {
            let wait = INSISTING_FIRST.saturating_mul(1 << wanted.failures.min(16));
            wanted.failures += 1;
            self.request_later(name.to_owned(), asking, wait.min(INSISTING_MAX), ctx);
        } else if news.is_final() {
            self.initiatives.goals.remove(name);
        } else if news.holds() {
            wanted.failures = 0;
        }
        self.hear(name, &news, ctx);
    }

    /// Requests a goal again after `wait`, if it is still wanted. The request was not read, or the goal
    /// failed.
    fn request_later(
        &mut self,
        name: String,
        asking: u64,
        wait: Duration,
        ctx: &mut Context<Self>,
    ) {
        tracing::info!(initiative = name, ?wait, "the goal is asked for again");
        ctx.after(wait, move |actuator: &mut Self, ctx| {
            let Some(wanted) = actuator.initiatives.goals.get_mut(&name) else { return };
            let asked = wanted.asked.as_ref().filter(|asked| asked.asking == asking);
            if let Some(of) = asked.map(|asked| asked.of.clone()) {
                wanted.conversation = ctx.new_conversation();
                actuator.request(&name, of, ctx);
            }
        });
    }

    fn withdraw(&mut self, name: &str, ctx: &mut Context<Self>) {
        let wanted = self.initiatives.goals.remove(name);
        let Some(Asked { exchange, of, .. }) = wanted.and_then(|wanted| wanted.asked) else {
            return;
        };
        ctx.go_on(&exchange, &of.agent, Performative::Cancel, Value::Null);
        // The Plan Requester answers after its executor has, which may wait for an actuator.
        ctx.extend(&exchange, ctx.settings().answer_deadline * 4);
    }

    /// Whether the device has goals that a joining Plan Requester must be asked for.
    pub(crate) fn wants_anything(&self) -> bool {
        !self.initiatives.goals.is_empty()
    }

    /// Requests all goals from a Plan Requester that has joined: it does not know them.
    pub(crate) fn met(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Joined(resident) = presence else { return };
        if resident.agent != plan_requester() {
            return;
        }
        let unasked = |wanted: &Wanted| {
            let asked = wanted.asked.as_ref();
            asked.is_none_or(|asked| asked.of.incarnation != resident.incarnation)
        };
        let goals = self.initiatives.goals.iter();
        let names: Vec<_> =
            goals.filter(|(_, wanted)| unasked(wanted)).map(|(name, _)| name.clone()).collect();
        for name in names {
            let wanted = self.initiatives.goals.get_mut(&name);
            if let Some(earlier) = wanted.and_then(|wanted| wanted.asked.take()) {
                ctx.close(&earlier.exchange);
            }
            self.request(&name, resident.clone(), ctx);
        }
    }

    /// Withdraws all goals and questions, because the daemon is stopping.
    pub(crate) fn withdraw_all(&mut self, ctx: &mut Context<Self>) {
        self.initiatives.watching = None;
        let names: Vec<_> = self.initiatives.goals.keys().cloned().collect();
        for name in names {
            self.withdraw(&name, ctx);
        }
        let names: Vec<_> = self.initiatives.questions.keys().cloned().collect();
        for name in names {
            self.unask(&name, format!("`{}` is stopping", ctx.id()), ctx);
        }
    }

    // === questions ===

    fn ask(
        &mut self,
        name: String,
        question: &Question,
        patience: Duration,
        ctx: &mut Context<Self>,
    ) {
        self.unask(&name, format!("`{}` asks something else", ctx.id()), ctx);
        if self.initiatives.questions.len() >= OPEN_MAX {
            return self.decline(name, ctx);
        }
        let key = AnswerKey::new();
        let question = Question { seal_to: Some(key.public()), ..question.clone() };
        let opening = Opening {
            to: None,
            performative: Performative::QueryRef,
            protocol: Protocol::Query,
            conversation: ctx.new_conversation(),
            content: value(&question),
        };
        let about = name.clone();
        let exchange = ctx.open(opening, patience, move |actuator: &mut Self, answer, ctx| {
            actuator.person_answered(&about, patience, (&key, &answer), ctx);
        });
        self.initiatives.questions.insert(name, exchange);
    }

    /// Withdraws a question, if it is open.
    fn unask(&mut self, name: &str, detail: String, ctx: &mut Context<Self>) {
        if let Some(exchange) = self.initiatives.questions.remove(name) {
            ctx.withdraw(&exchange, &Withdrawal { detail });
        }
    }

    fn person_answered(
        &mut self,
        name: &str,
        patience: Duration,
        (key, answer): (&AnswerKey, &Answer),
        ctx: &mut Context<Self>,
    ) {
        let news = match answer {
            Answer::Message(message) if message.performative == Performative::Inform => {
                match message.content_as::<Inform>() {
                    Ok(Inform::Answer(answer)) => match answer.sealed.map(|text| key.open(&text)) {
                        None => News::Answer(answer.text),
                        Some(Ok(text)) => News::Answer(text),
                        Some(Err(error)) => {
                            return ctx.not_understood(message, format!("the answer {error}"));
                        }
                    },
                    Ok(_) => return ctx.not_understood(message, "this does not answer a question"),
                    Err(error) => return ctx.not_understood(message, error.to_string()),
                }
            }
            Answer::Message(message) => {
                tracing::debug!(from = %message.sender, "declines; another may answer");
                return;
            }
            Answer::Silence => News::Unanswered(format!("no answer came within {patience:?}")),
            Answer::Undelivered(why) => News::Unanswered(why.to_string()),
        };
        let detail = match answer {
            Answer::Message(message) => format!("answered at `{}`", message.sender),
            Answer::Silence | Answer::Undelivered(_) => "no answer came in time".to_owned(),
        };
        self.unask(name, detail, ctx);
        self.hear(name, &news, ctx);
    }
}

/// Reads the Plan Requester's message about a goal.
fn read(message: &Message) -> Result<News, String> {
    match message.performative {
        Performative::Confirm => message.content_as().map(News::Report),
        _ => message.content_as().map(News::Refused),
    }
    .map_err(|error| error.to_string())
}
