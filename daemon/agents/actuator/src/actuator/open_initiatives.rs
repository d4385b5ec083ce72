//! Execution of a device's initiatives: events are announced at once, goals are requested as users
//! request them, and people are asked questions.
//!
//! - A device reports events by [`Device::next_event`] and answers each with [`Initiative`]s. News
//!   about an initiative is passed to [`Device::receive_news`].
//! - A goal stays requested until it ends or is withdrawn. If the Plan Requester was absent or was
//!   restarted, the goal is requested when the Plan Requester joins.
//! - The first answer to a question counts, and the question is then withdrawn at all keyboards. If
//!   one keyboard declines the question, the others may still answer.
//!
//! [`Device::next_event`]: crate::Device::next_event
//! [`Device::receive_news`]: crate::Device::receive_news

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Achieve, Inform, Question, Reason, Refusal, Request, Withdrawal, value};
use acl::{ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{
    Context, DeliveryError, ExchangeEvent, ExchangeOpening, Presence, Resident, WorkHandle,
};
use credentials::AnswerKey;
use serde_json::Value;

use super::Actuator;
use super::event_pacing::EventPacing;
use crate::initiative::{Initiative, InitiativeUpdate};

/// How long a requested goal may go without any report: a year, because a kept goal may hold for so
/// long.
const GOAL_PATIENCE: Duration = Duration::from_secs(365 * 24 * 3_600);

/// Delay before a goal is requested again after the Plan Requester's mailbox was full. A burst of
/// messages is over by then.
const FULL: Duration = Duration::from_secs(1);

/// First delay before a failed goal that the device insists on is requested again. The delay
/// doubles with each failure, from the time that another agent needs to start up to the time that a
/// repair takes.
const INSISTING_FIRST: Duration = Duration::from_secs(1);
const INSISTING_MAX: Duration = Duration::from_secs(300);

/// Maximum number of open goals, and of open questions, of one device; further ones are refused. A
/// camera has one or two of them.
const OPEN_MAX: usize = 32;

/// The open goals and questions of a device.
#[derive(Default)]
pub(crate) struct OpenInitiatives {
    event_watch: Option<WorkHandle>,
    event_pacing: EventPacing,
    goals: BTreeMap<String, WantedGoal>,
    questions: BTreeMap<String, ReplyToken>,
    /// Number of requests so far. The number identifies each request, so that answers to an earlier
    /// request of the same name are recognised.
    request_count: u64,
}

/// A goal that the device has requested and not withdrawn.
struct WantedGoal {
    goal: Achieve,
    /// Conversation of the goal. The conversation stays the same when another Plan Requester
    /// becomes the leader, so that repeated requests count as one goal. After a failure the goal
    /// gets a new conversation.
    conversation: ConversationId,
    insists: bool,
    /// Number of failures of the goal in a row.
    failures: u32,
    /// The open request for the goal; `None` while no Plan Requester is present.
    open_request: Option<PendingRequest>,
}

struct PendingRequest {
    request_number: u64,
    exchange: ReplyToken,
    addressee: Resident,
}

/// Returns the refusal of a further goal or question.
fn too_many() -> Refusal {
    Refusal::new(Reason::Busy, format!("{OPEN_MAX} requests are open already"))
}

impl Actuator {
    // === watching ===

    /// Stores the task that reads the device's state for the first time. The device's events are
    /// watched once this task has ended.
    pub(crate) fn looks(&mut self, work: WorkHandle) {
        self.initiatives.event_watch = Some(work);
    }

    pub(crate) fn watch_events(&mut self, ctx: &mut Context<Self>) {
        let Some(next) = self.device.next_event() else { return };
        let work = ctx.run(next, |actuator: &mut Self, stir, ctx| {
            let initiatives = stir(&mut *actuator.device);
            // The heartbeat comes first: an agent that receives the goal may query the state at
            // once.
            actuator.send_news(ctx);
            actuator.carry_out(initiatives, ctx);
            match actuator.initiatives.event_pacing.pause_after_event(ctx.now()) {
                Duration::ZERO => actuator.watch_events(ctx),
                pause => {
                    ctx.after(pause, |actuator: &mut Self, ctx| actuator.watch_events(ctx));
                }
            }
        });
        self.initiatives.event_watch = Some(work);
    }

    fn carry_out(&mut self, initiatives: Vec<Initiative>, ctx: &mut Context<Self>) {
        for initiative in initiatives {
            match initiative {
                Initiative::RequestGoal { name, goal, insists } => {
                    self.request_goal(name, goal, insists, ctx)
                }
                Initiative::Withdraw { name } => {
                    self.withdraw_goal(&name, ctx);
                    self.withdraw_question(
                        &name,
                        "the answer is not needed any more".to_owned(),
                        ctx,
                    );
                }
                Initiative::AskPeople { name, question, patience } => {
                    self.ask_people(name, &question, patience, ctx);
                }
            }
        }
    }

    /// Passes news about a goal or a question that the device requested to the device.
    fn deliver_update(&mut self, name: &str, news: &InitiativeUpdate, ctx: &mut Context<Self>) {
        // A person's answer is not logged: it may be a secret.
        let word = match news {
            InitiativeUpdate::Report(report) => report.detail.as_str(),
            InitiativeUpdate::Refused(refusal) => refusal.detail.as_str(),
            InitiativeUpdate::Answer(_) => "an answer came",
            InitiativeUpdate::Unanswered(why) => why.as_str(),
        };
        tracing::info!(initiative = name, word, "news of an initiative");
        if self.receive_consent(name, news) {
            return;
        }
        let initiatives = self.device.receive_news(name, news);
        self.send_news(ctx);
        self.carry_out(initiatives, ctx);
    }

    fn refuse_initiative(&mut self, name: String, refusal: Refusal, ctx: &mut Context<Self>) {
        let news = InitiativeUpdate::Refused(refusal);
        // The news is delivered later, because the device is still in a callback.
        ctx.after(Duration::ZERO, move |actuator: &mut Self, ctx| {
            actuator.deliver_update(&name, &news, ctx)
        });
    }

    // === goals ===

    fn request_goal(
        &mut self,
        name: String,
        goal: Achieve,
        insists: bool,
        ctx: &mut Context<Self>,
    ) {
        if self.initiatives.goals.get(&name).is_some_and(|wanted| wanted.goal == goal) {
            return;
        }
        self.withdraw_goal(&name, ctx);
        if self.initiatives.goals.len() >= OPEN_MAX {
            return self.refuse_initiative(name, too_many(), ctx);
        }
        let confidentiality = self.confidentiality.as_ref();
        if confidentiality.is_some_and(|it| it.is_about_private(&goal.goal)) {
            let detail = "the goal is about something private (privacy = \"agents\")".to_owned();
            return self.refuse_initiative(name, Refusal::new(Reason::Conflict, detail), ctx);
        }
        let conversation = ctx.new_conversation();
        let wanted = WantedGoal { goal, conversation, insists, failures: 0, open_request: None };
        self.initiatives.goals.insert(name.clone(), wanted);
        if let Some(requester) = ctx.find(&ctx.settings().roles.plan_requester) {
            self.request(&name, requester, ctx);
        }
    }

    fn request(&mut self, name: &str, of: Resident, ctx: &mut Context<Self>) {
        self.initiatives.request_count += 1;
        let asking = self.initiatives.request_count;
        let Some(wanted) = self.initiatives.goals.get_mut(name) else { return };
        let opening = ExchangeOpening {
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
        wanted.open_request =
            Some(PendingRequest { request_number: asking, exchange, addressee: of });
    }

    fn requester_answered(
        &mut self,
        name: &str,
        asking: u64,
        answer: &ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(wanted) = self.initiatives.goals.get_mut(name) else { return };
        if wanted.open_request.as_ref().is_none_or(|asked| asked.request_number != asking) {
            return;
        }
        let news = match answer {
            ExchangeEvent::Undelivered(DeliveryError::Left | DeliveryError::Restarted) => {
                wanted.open_request = None;
                return;
            }
            ExchangeEvent::Undelivered(why) => InitiativeUpdate::Unanswered(why.to_string()),
            ExchangeEvent::TimedOut => {
                InitiativeUpdate::Unanswered("no answer came within a year".to_owned())
            }
            ExchangeEvent::Message(message) => match read(message) {
                Ok(news) => news,
                Err(error) => return ctx.not_understood(message, error),
            },
        };
        let is_full = |refusal: &Refusal| refusal.reason == Reason::MailboxFull;
        if matches!(&news, InitiativeUpdate::Refused(refusal) if is_full(refusal)) {
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
        self.deliver_update(name, &news, ctx);
    }

    /// Requests a goal again after `wait`, if the device has not withdrawn it. Called when the
    /// request was refused by a full mailbox, or when the goal failed.
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
            let asked = wanted.open_request.as_ref().filter(|asked| asked.request_number == asking);
            if let Some(of) = asked.map(|asked| asked.addressee.clone()) {
                wanted.conversation = ctx.new_conversation();
                actuator.request(&name, of, ctx);
            }
        });
    }

    fn withdraw_goal(&mut self, name: &str, ctx: &mut Context<Self>) {
        let wanted = self.initiatives.goals.remove(name);
        let Some(PendingRequest { exchange, addressee: of, .. }) =
            wanted.and_then(|wanted| wanted.open_request)
        else {
            return;
        };
        ctx.send_turn(&exchange, &of.agent, Performative::Cancel, Value::Null);
        // The Plan Requester answers after its executor has, which may wait for an actuator.
        ctx.extend(&exchange, ctx.settings().answer_deadline * 4);
    }

    /// Whether the device has goals that must be requested from a Plan Requester when it joins.
    pub(crate) fn has_wanted_goals(&self) -> bool {
        !self.initiatives.goals.is_empty()
    }

    /// Requests all goals from a Plan Requester that has joined, because that agent has no record
    /// of them.
    pub(crate) fn plan_requester_joined(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Joined(resident) = presence else { return };
        if resident.agent != ctx.settings().roles.plan_requester {
            return;
        }
        let unasked = |wanted: &WantedGoal| {
            let asked = wanted.open_request.as_ref();
            asked.is_none_or(|asked| asked.addressee.incarnation != resident.incarnation)
        };
        let goals = self.initiatives.goals.iter();
        let names: Vec<_> =
            goals.filter(|(_, wanted)| unasked(wanted)).map(|(name, _)| name.clone()).collect();
        for name in names {
            let wanted = self.initiatives.goals.get_mut(&name);
            if let Some(earlier) = wanted.and_then(|wanted| wanted.open_request.take()) {
                ctx.close(&earlier.exchange);
            }
            self.request(&name, resident.clone(), ctx);
        }
    }

    /// Withdraws all goals and questions of the device, because the daemon is stopping.
    pub(crate) fn withdraw_all(&mut self, ctx: &mut Context<Self>) {
        self.initiatives.event_watch = None;
        let names: Vec<_> = self.initiatives.goals.keys().cloned().collect();
        for name in names {
            self.withdraw_goal(&name, ctx);
        }
        let names: Vec<_> = self.initiatives.questions.keys().cloned().collect();
        for name in names {
            self.withdraw_question(&name, format!("`{}` is stopping", ctx.id()), ctx);
        }
    }

    // === questions ===

    pub(super) fn ask_people(
        &mut self,
        name: String,
        question: &Question,
        patience: Duration,
        ctx: &mut Context<Self>,
    ) {
        self.withdraw_question(&name, format!("`{}` asks something else", ctx.id()), ctx);
        if self.initiatives.questions.len() >= OPEN_MAX {
            return self.refuse_initiative(name, too_many(), ctx);
        }
        let key = AnswerKey::new();
        let question = Question { seal_to: Some(key.public()), ..question.clone() };
        let opening = ExchangeOpening {
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

    /// Withdraws a question of the device, if the question is open.
    pub(super) fn withdraw_question(
        &mut self,
        name: &str,
        detail: String,
        ctx: &mut Context<Self>,
    ) {
        if let Some(exchange) = self.initiatives.questions.remove(name) {
            ctx.cancel(&exchange, &Withdrawal { detail });
        }
    }

    fn person_answered(
        &mut self,
        name: &str,
        patience: Duration,
        (key, answer): (&AnswerKey, &ExchangeEvent),
        ctx: &mut Context<Self>,
    ) {
        let news = match answer {
            ExchangeEvent::Message(message) if message.performative == Performative::Inform => {
                match message.content_as::<Inform>() {
                    Ok(Inform::Answer(answer)) => match answer.sealed.map(|text| key.open(&text)) {
                        None => InitiativeUpdate::Answer(answer.text),
                        Some(Ok(text)) => InitiativeUpdate::Answer(text),
                        Some(Err(error)) => {
                            return ctx.not_understood(message, format!("the answer {error}"));
                        }
                    },
                    Ok(_) => return ctx.not_understood(message, "this does not answer a question"),
                    Err(error) => return ctx.not_understood(message, error.to_string()),
                }
            }
            ExchangeEvent::Message(message) => {
                tracing::debug!(from = %message.sender, "declines; another may answer");
                return;
            }
            ExchangeEvent::TimedOut => {
                InitiativeUpdate::Unanswered(format!("no answer came within {patience:?}"))
            }
            ExchangeEvent::Undelivered(why) => InitiativeUpdate::Unanswered(why.to_string()),
        };
        let detail = match answer {
            ExchangeEvent::Message(message) => format!("answered at `{}`", message.sender),
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => {
                "no answer came in time".to_owned()
            }
        };
        self.withdraw_question(name, detail, ctx);
        self.deliver_update(name, &news, ctx);
    }
}

/// Reads a message of the Plan Requester about a goal as news for the device that requested the
/// goal.
fn read(message: &Message) -> Result<InitiativeUpdate, String> {
    match message.performative {
        Performative::Confirm => message.content_as().map(InitiativeUpdate::Report),
        _ => message.content_as().map(InitiativeUpdate::Refused),
    }
    .map_err(|error| error.to_string())
}
