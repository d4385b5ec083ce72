//! The Keyboard Agent (the paper, “User Interface”): a person's interface to the ecosystem.
//!
//! - Requests goals and single actions, changes the state and the planning mode (centralised or
//!   decentralised), and passes the outcomes back to the person.
//! - Cancels goals, also goals that another keyboard requested.
//! - Keeps the questions that agents put to a person (`query-ref`) until a person at this or
//!   another keyboard answers, or the asking agent withdraws them. A question that is still open at
//!   its deadline is refused with a reason.
//!
//! There is one Keyboard Agent per terminal. The owner of the [`Terminal`] decides what is shown.

mod questions;
mod single_action;
mod terminal;

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    Achieve, AnswerQuestion, ChangeState, GoalTimes, Inform, Mode, Outcome, PersonsAnswer,
    Question, Reason, Refusal, Report, Request, ScheduleGoal, SetMode, Withdrawal, value,
};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{
    Agent, AgentSettings, Blueprint, BuildError, Callbacks, Context, DeliveryError, ExchangeEvent,
    ExchangeOpening, LaunchableAgent, Participation, PluginEntry, Presence, Resource, WorkHandle,
};
use serde::Deserialize;
use tokio::sync::mpsc;
use tokio::time::Instant;

use crate::questions::Questions;
pub use crate::terminal::{
    EventSender, GoalRequest, MessageDraft, RequestId, RequestNotSent, RequestPermit, RequestRef,
    RequestSender, Terminal, TerminalPeer, UserEvent, UserRequest,
};

/// Time after which a goal without any report counts as unanswered. It is a year, because a kept
/// goal may hold that long.
const GOAL_TIMEOUT: Duration = Duration::from_secs(365 * 24 * 3_600);

/// How long a new leader of the Plan Requesters may take to report the goals that it has taken
/// over. It reads them from the Journals first. Afterwards this keyboard requests the goals again
/// that it has not reported.
const TAKEOVER_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a question without a deadline stays open. A person at the terminal sees the question
/// within this time.
const QUESTION_PATIENCE: Duration = Duration::from_secs(60);

/// How long before its deadline a question without an answer is refused, so that the asking agent
/// receives the reason while it still waits. If a tenth of the question's whole time is less, that
/// tenth is used.
const QUESTION_MARGIN: Duration = Duration::from_millis(500);

/// The entry of the Keyboard Agent in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "keyboard",
    about: "serves a person: sends goals, actions, changes and answers, shows reports",
    drivers: &[],
    has_replicas: false,
    build,
};

/// The `config` of a Keyboard Agent in the ecosystem file.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct Config {
    /// Goals that the keyboard requests when it is activated.
    goals: Vec<GoalRequest>,
}

/// How long a Plan Requester that left before it received a goal may stay away. `SEEK_INTERVAL` is
/// the interval of the checks whether it has returned, and `DEPARTURES_MAX` the maximum number of
/// such departures for one goal.
const RETURN_TIMEOUT: Duration = Duration::from_secs(5);
const SEEK_INTERVAL: Duration = Duration::from_millis(200);
const DEPARTURES_MAX: u32 = 5;

/// How long a keyboard that ends waits for the receipts of its last messages, such as the
/// confirmation of an answer that has just ended the command of the keyboard. A lost message is
/// repeated within this time.
const RECEIPTS_WITHIN: Duration = Duration::from_millis(500);

/// A goal that this keyboard has requested.
struct RequestedGoal {
    /// Number of the request at the terminal; `None` if the goal is in the ecosystem file.
    id: Option<RequestId>,
    exchange: ReplyToken,
    /// Time of the last report about the goal.
    last_report_at: Instant,
    /// The request for the goal, as it was sent to the Plan Requester.
    request: Request,
    /// Number of times that a Plan Requester has left before it had received this request.
    departures: u32,
}

/// The Keyboard Agent: a person's interface to the ecosystem.
pub struct Keyboard {
    startup_goals: Vec<GoalRequest>,
    /// Whether agents may put questions to a person at this keyboard.
    takes_questions: bool,
    questions: Questions,
    /// Requested actions that are in preparation: the domain is being fetched for each of them.
    actions_in_preparation: BTreeMap<ConversationId, (RequestId, WorkHandle)>,
    /// Requested goals that have not ended.
    goals: BTreeMap<ConversationId, RequestedGoal>,
    /// Running actions that the person requested singly, by conversation.
    running_actions: BTreeMap<ConversationId, ReplyToken>,
    user_requests: Option<mpsc::Receiver<(RequestId, UserRequest)>>,
    listening: Option<WorkHandle>,
    user_events: Option<EventSender>,
    /// When this keyboard ends also without the receipts of its last messages; `None` until it is to
    /// end.
    ends_at: Option<Instant>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { goals } = blueprint.config_as()?;
    Ok(Box::new(Keyboard { startup_goals: goals, ..Keyboard::without_terminal() }))
}

impl Keyboard {
    /// Creates a keyboard that takes no questions, and the terminal that is connected to it. Its
    /// owner sees the questions of other keyboards, and answers them by [`UserRequest::Answer`].
    pub fn for_requests() -> (Keyboard, Terminal) {
        let (keyboard, terminal) = Keyboard::with_terminal();
        (Keyboard { takes_questions: false, ..keyboard }, terminal)
    }

    /// Creates a keyboard without a terminal. It keeps questions until a person at another keyboard
    /// answers them.
    pub fn for_questions() -> Keyboard {
        Keyboard::without_terminal()
    }

    /// Creates a keyboard and the terminal that is connected to it.
    pub fn with_terminal() -> (Keyboard, Terminal) {
        let (terminal, TerminalPeer { requests, events }) = Terminal::open();
        let keyboard = Keyboard {
            user_requests: Some(requests),
            user_events: Some(events),
            ..Keyboard::without_terminal()
        };
        (keyboard, terminal)
    }

    fn without_terminal() -> Keyboard {
        Keyboard {
            startup_goals: Vec::new(),
            takes_questions: true,
            questions: Questions::default(),
            actions_in_preparation: BTreeMap::new(),
            goals: BTreeMap::new(),
            running_actions: BTreeMap::new(),
            user_requests: None,
            listening: None,
            user_events: None,
            ends_at: None,
        }
    }
}

impl Agent for Keyboard {
    fn callbacks(&self) -> Callbacks<Self> {
        if !self.takes_questions {
            return Callbacks::new();
        }
        Callbacks::new()
            .on(Performative::QueryRef, Self::question_asked)
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::question_withdrawn)
            .on_broadcast(Performative::QueryRef, Self::question_asked)
            .on_broadcast(Performative::Cancel, Self::question_withdrawn)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        for wish in std::mem::take(&mut self.startup_goals) {
            self.request_goal(wish, None, None, ctx);
        }
        self.listen(ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        if let Presence::Joined(resident) = presence
            && resident.agent == ctx.settings().roles.plan_requester
            && !self.goals.is_empty()
        {
            let came = ctx.now();
            ctx.after(TAKEOVER_TIMEOUT, move |keyboard: &mut Self, ctx| {
                keyboard.reopen_goals(came, ctx);
            });
        }
    }

    fn answer_query(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        if resource != Resource::Questions {
            return None;
        }
        serde_json::to_string(&self.questions.list(ctx.id(), ctx.now())).ok()
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        while let Some((_, question)) = self.questions.take_first() {
            let detail = format!("`{}` was closed before an answer came", ctx.id());
            ctx.refuse(&question.participation, Reason::Stopping, detail);
        }
        if !ctx.awaits_receipts() {
            return true;
        }
        let until = *self.ends_at.get_or_insert_with(|| {
            // The event of the timer has this function called again.
            ctx.after(RECEIPTS_WITHIN, |_, _| ());
            Instant::now() + RECEIPTS_WITHIN
        });
        Instant::now() >= until
    }
}

impl Keyboard {
    // === input of the person ===

    /// Waits for the next input of the person at the terminal.
    fn listen(&mut self, ctx: &mut Context<Self>) {
        let Some(mut said) = self.user_requests.take() else { return };
        let next = async move {
            let next = said.recv().await;
            (next, said)
        };
        self.listening = Some(ctx.run(next, |keyboard: &mut Self, (next, said), ctx| {
            // The terminal was dropped, so that there is no more input.
            let Some((id, request)) = next else { return };
            keyboard.handle_user_request(id, request, ctx);
            keyboard.user_requests = Some(said);
            keyboard.listen(ctx);
        }));
    }

    fn handle_user_request(&mut self, id: RequestId, said: UserRequest, ctx: &mut Context<Self>) {
        match said {
            UserRequest::RequestGoal(wish) => self.request_goal(wish, None, Some(id), ctx),
            UserRequest::ScheduleGoal(wish, times) => {
                self.request_goal(wish, Some(*times), Some(id), ctx);
            }
            UserRequest::Cancel(conversation) => self.cancel(conversation, id, ctx),
            UserRequest::Act(action) => self.prepare_action(action, id, ctx),
            UserRequest::Set(change) => self.change_state(change, id, ctx),
            UserRequest::Mode(mode) => self.set_mode(mode, id, ctx),
            UserRequest::Answer { keyboard, question, text, seal_to } => {
                let said = PersonsAnswer::plain(text);
                match seal_to.as_deref().map_or(Ok(said.clone()), |key| sealed(key, &said)) {
                    Ok(said) => {
                        self.give_answer(
                            keyboard,
                            AnswerQuestion { question, answer: said },
                            id,
                            ctx,
                        );
                    }
                    Err(refusal) => {
                        let about = self.begin(Some(id), ctx);
                        self.emit(UserEvent::Refused(about, refusal));
                    }
                }
            }
            UserRequest::Send(draft) => self.send(draft, id, ctx),
        }
    }

    /// Assigns a new conversation to a request, and notifies the person of it.
    fn begin(&self, id: Option<RequestId>, ctx: &mut Context<Self>) -> RequestRef {
        let about = RequestRef { id, conversation: ctx.new_conversation() };
        self.emit(UserEvent::Sent(about.clone()));
        about
    }

    /// Requests a goal: at once, or at its times.
    fn request_goal(
        &mut self,
        wish: GoalRequest,
        times: Option<GoalTimes>,
        id: Option<RequestId>,
        ctx: &mut Context<Self>,
    ) {
        let GoalRequest { goal, keep, priority, partition } = wish;
        let goal = Achieve { goal, keep, priority, partition };
        let is_at_once = times.as_ref().is_none_or(GoalTimes::is_at_once);
        let protocol = if is_at_once { Protocol::Goal } else { Protocol::StateChange };
        let request = match times {
            Some(times) => Request::Schedule(Box::new(ScheduleGoal { goal, times })),
            None => Request::Achieve(goal),
        };
        let to = ctx.settings().roles.plan_requester.clone();
        let (about, exchange) = self.request(to, protocol, &request, GOAL_TIMEOUT, id, ctx);
        let last_report_at = ctx.now();
        let goal = RequestedGoal { id, exchange, last_report_at, request, departures: 0 };
        self.goals.insert(about.conversation, goal);
    }

    /// Requests a goal again once a Plan Requester is present, because the former one left before
    /// it received the request, or seemed to have left because its daemon was busy. Reports a
    /// failure if no Plan Requester is present at the time `until`.
    fn request_on_return(
        &mut self,
        about: ConversationId,
        until: Instant,
        ctx: &mut Context<Self>,
    ) {
        let Some(asked) = self.goals.get(&about) else { return };
        let to = ctx.settings().roles.plan_requester.clone();
        if ctx.find(&to).is_none() {
            if ctx.now() < until {
                let again = move |keyboard: &mut Self, ctx: &mut Context<Self>| {
                    keyboard.request_on_return(about, until, ctx);
                };
                ctx.after(SEEK_INTERVAL, again);
            } else {
                let about = RequestRef { id: asked.id, conversation: about };
                self.goals.remove(&about.conversation);
                let why = format!("`{to}` could not be reached: it has left");
                self.emit(UserEvent::Unanswered(about, why));
            }
            return;
        }
        let is_goal = asked.request.goal().is_some();
        let opening = ExchangeOpening {
            to: Some(to),
            performative: Performative::Request,
            protocol: if is_goal { Protocol::Goal } else { Protocol::StateChange },
            conversation: about.clone(),
            content: value(&asked.request),
        };
        let exchange = self.open(opening, GOAL_TIMEOUT, asked.id, ctx);
        if let Some(asked) = self.goals.get_mut(&about) {
            asked.exchange = exchange;
        }
    }

    /// Requests those goals again about which the Plan Requester that has led since the time `came`
    /// has reported nothing. In that case no Journal had these goals.
    fn reopen_goals(&mut self, came: Instant, ctx: &mut Context<Self>) {
        for asked in self.goals.values().filter(|asked| asked.last_report_at < came) {
            ctx.reopen_with_leader(&asked.exchange);
        }
    }

    fn change_state(&mut self, change: ChangeState, id: RequestId, ctx: &mut Context<Self>) {
        let AgentSettings { roles, answer_deadline, .. } = ctx.settings();
        let (to, patience) = (roles.domain_maintainer.clone(), *answer_deadline * 2);
        let request = Request::ChangeState(change);
        self.request(to, Protocol::StateChange, &request, patience, Some(id), ctx);
    }

    fn set_mode(&mut self, mode: Mode, id: RequestId, ctx: &mut Context<Self>) {
        let AgentSettings { roles, answer_deadline, .. } = ctx.settings();
        let (to, patience) = (roles.plan_requester.clone(), *answer_deadline * 2);
        let request = Request::SetMode(SetMode { mode });
        self.request(to, Protocol::StateChange, &request, patience, Some(id), ctx);
    }

    fn request(
        &mut self,
        to: AgentId,
        protocol: Protocol,
        request: &Request,
        patience: Duration,
        id: Option<RequestId>,
        ctx: &mut Context<Self>,
    ) -> (RequestRef, ReplyToken) {
        let about = self.begin(id, ctx);
        let opening = ExchangeOpening {
            to: Some(to),
            performative: Performative::Request,
            protocol,
            conversation: about.conversation.clone(),
            content: value(request),
        };
        let exchange = self.open(opening, patience, id, ctx);
        (about, exchange)
    }

    /// Cancels a goal or an action. For an action of this keyboard, the report about the end of the
    /// action is the answer.
    fn cancel(&mut self, conversation: ConversationId, id: RequestId, ctx: &mut Context<Self>) {
        if let Some((action, _)) = self.actions_in_preparation.remove(&conversation) {
            let report = Report::new(Outcome::Cancelled, "cancelled before it was sent");
            let about = RequestRef { id: Some(action), conversation };
            return self.emit(UserEvent::Report(about, report));
        }
        let nothing = serde_json::Value::Null;
        if let Some(action) = self.running_actions.get(&conversation) {
            let executor = ctx.settings().roles.plan_executor.clone();
            return ctx.send_turn(action, &executor, Performative::Cancel, nothing);
        }
        let opening = ExchangeOpening {
            to: Some(ctx.settings().roles.plan_requester.clone()),
            performative: Performative::Cancel,
            protocol: Protocol::Goal,
            conversation,
            content: nothing,
        };
        self.open(opening, GOAL_TIMEOUT, Some(id), ctx);
    }

    // === one action ===

    /// Queries the composite domain, from which a plan of one step is built for an action that the
    /// person requested.
    fn prepare_action(&mut self, action: String, id: RequestId, ctx: &mut Context<Self>) {
        let about = self.begin(Some(id), ctx);
        let conversation = about.conversation.clone();
        let maintainer = ctx.settings().roles.domain_maintainer.clone();
        let asked = ctx.ask(Resource::Domain, &maintainer);
        let work = ctx.run(asked, move |keyboard: &mut Self, answers, ctx| {
            if keyboard.actions_in_preparation.remove(&about.conversation).is_none() {
                return;
            }
            match answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok()) {
                Some(snapshot) => keyboard.execute(about, snapshot, &action, ctx),
                None => {
                    let why = "no Domain Maintainer answers".to_owned();
                    keyboard.emit(UserEvent::Unanswered(about, why));
                }
            }
        });
        self.actions_in_preparation.insert(conversation, (id, work));
    }

    fn execute(
        &mut self,
        about: RequestRef,
        snapshot: acl::content::Snapshot,
        action: &str,
        ctx: &mut Context<Self>,
    ) {
        let (execute, timeout) = match single_action::one_step_plan(snapshot, action) {
            Ok(plan) => plan,
            Err(problem) => {
                let refusal = Refusal::new(Reason::BadContent, problem);
                return self.emit(UserEvent::Refused(about, refusal));
            }
        };
        let opening = ExchangeOpening {
            to: Some(ctx.settings().roles.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: about.conversation.clone(),
            content: value(&Request::Execute(Box::new(execute))),
        };
        // The time limit covers the actuator's agreement, its method, and the executor's report.
        let patience = timeout + ctx.settings().answer_deadline * 3;
        let token = self.open(opening, patience, about.id, ctx);
        self.running_actions.insert(about.conversation, token);
    }

    // === a message as the person wrote it ===

    fn send(&mut self, draft: MessageDraft, id: RequestId, ctx: &mut Context<Self>) {
        let MessageDraft { to, performative, protocol, conversation, content, patience } = draft;
        let conversation = conversation.unwrap_or_else(|| ctx.new_conversation());
        let about = RequestRef { id: Some(id), conversation: conversation.clone() };
        self.emit(UserEvent::Sent(about.clone()));
        let opening = ExchangeOpening { to, performative, protocol, conversation, content };
        ctx.open(opening, patience, move |keyboard: &mut Self, answer, _| {
            keyboard.emit(match answer {
                ExchangeEvent::Message(message) => UserEvent::Answered(about.id, message),
                ExchangeEvent::TimedOut => UserEvent::Unanswered(
                    about.clone(),
                    format!("no further answer within {patience:?}"),
                ),
                ExchangeEvent::Undelivered(why) => {
                    UserEvent::Unanswered(about.clone(), why.to_string())
                }
            });
        });
    }

    // === answers ===

    fn open(
        &mut self,
        opening: ExchangeOpening,
        patience: Duration,
        id: Option<RequestId>,
        ctx: &mut Context<Self>,
    ) -> ReplyToken {
        let about = RequestRef { id, conversation: opening.conversation.clone() };
        let to = opening.to.clone();
        let is_cancel = opening.performative == Performative::Cancel;
        ctx.open(opening, patience, move |keyboard: &mut Self, answer, ctx| match answer {
            // The goal continues; a failed cancellation must not cause the goal to be requested
            // again.
            ExchangeEvent::Undelivered(why) if is_cancel => {
                let who = to.as_ref().map_or("everyone", AgentId::as_str);
                let why = format!("`{who}` could not be reached to cancel it: {why}");
                keyboard.emit(UserEvent::Unanswered(about.clone(), why));
            }
            answer => keyboard.answered(about.clone(), to.as_ref(), answer, ctx),
        })
    }

    fn answered(
        &mut self,
        about: RequestRef,
        who: Option<&AgentId>,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let who = who.map(AgentId::as_str).unwrap_or("everyone");
        let heard = match answer {
            ExchangeEvent::Message(message) => match read(&message, about.id) {
                Ok(heard) => heard,
                Err(error) => return ctx.not_understood(&message, error),
            },
            ExchangeEvent::TimedOut => {
                UserEvent::Unanswered(about, format!("`{who}` did not answer in time"))
            }
            ExchangeEvent::Undelivered(DeliveryError::Left)
                if let Some(asked) = self.goals.get_mut(&about.conversation)
                    && asked.departures < DEPARTURES_MAX =>
            {
                asked.departures += 1;
                let until = ctx.now() + RETURN_TIMEOUT;
                return self.request_on_return(about.conversation, until, ctx);
            }
            ExchangeEvent::Undelivered(why) => {
                UserEvent::Unanswered(about, format!("`{who}` could not be reached: {why}"))
            }
        };
        if let Some(about) = heard.conversation() {
            if heard.is_final() {
                self.running_actions.remove(about);
                self.goals.remove(about);
            } else if let Some(asked) = self.goals.get_mut(about) {
                asked.last_report_at = ctx.now();
            }
        }
        self.emit(heard);
    }

    fn emit(&self, heard: UserEvent) {
        match &heard {
            UserEvent::Sent(about) => tracing::info!(conversation = %about.conversation, "asked"),
            UserEvent::Report(RequestRef { conversation, .. }, report) => {
                tracing::info!(%conversation, outcome = %report.outcome, "{}", report.detail);
            }
            // If there is a terminal, the event is shown there, and the log would repeat it.
            UserEvent::Refused(about, refusal) if self.user_events.is_none() => {
                tracing::warn!(conversation = %about.conversation, "refused: {}", refusal.detail);
            }
            UserEvent::Unanswered(about, why) if self.user_events.is_none() => {
                tracing::warn!(conversation = %about.conversation, "{why}");
            }
            UserEvent::Question(open) => {
                tracing::info!(question = open.question, from = %open.from, "{}", open.text);
            }
            UserEvent::QuestionClosed(question, why) => tracing::info!(question, "{why}"),
            UserEvent::Refused(..) | UserEvent::Unanswered(..) | UserEvent::Answered(..) => (),
        }
        if let Some(to) = &self.user_events
            && !to.send(heard)
        {
            tracing::warn!("the terminal does not keep up: a line is lost");
        }
    }

    // === questions to the person ===

    fn question_asked(&mut self, message: Message, ctx: &mut Context<Self>) {
        let question = match message.content_as::<Question>() {
            Ok(question) => question,
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        let participation = Participation::of(&message);
        let Some(number) = self.questions.next_number() else {
            let detail = "too many questions are open at this keyboard";
            return ctx.refuse(&participation, Reason::Busy, detail);
        };
        let asked = message.reply_within.map_or(QUESTION_PATIENCE, |by| by.0);
        let patience = asked - QUESTION_MARGIN.min(asked / 10);
        let timer =
            ctx.after(patience, move |keyboard: &mut Self, ctx| keyboard.expire(number, ctx));
        self.questions.store(participation, question, patience, timer, ctx.now());
        if let Some(open) = self.questions.find(ctx.id(), number, ctx.now()) {
            self.emit(UserEvent::Question(open));
        }
    }

    fn expire(&mut self, number: u64, ctx: &mut Context<Self>) {
        let Some(question) = self.questions.take(number) else { return };
        let patience = question.patience;
        let detail = match &self.user_events {
            Some(_) => format!("no answer at `{}` within {patience:?}", ctx.id()),
            None => format!(
                "`{}` has no terminal open, and no answer came from elsewhere in {patience:?}",
                ctx.id()
            ),
        };
        ctx.refuse(&question.participation, Reason::Unanswered, detail.clone());
        self.emit(UserEvent::QuestionClosed(number, detail));
    }

    /// Closes a question that the asking agent has withdrawn.
    fn question_withdrawn(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Some(exchange) = message.exchange() else { return };
        let Some((number, question)) = self.questions.take_by_exchange(&message.sender, exchange)
        else {
            return;
        };
        ctx.cancel_timer(question.timer);
        let why = message.content_as::<Withdrawal>().map(|withdrawal| withdrawal.detail);
        let why = why.unwrap_or_else(|_| "no reason is given".to_owned());
        self.emit(UserEvent::QuestionClosed(number, format!("withdrawn: {why}")));
    }

    /// Delivers a person's answer to a question: to the asking agent if this keyboard keeps the
    /// question, otherwise to the keyboard that keeps it.
    fn give_answer(
        &mut self,
        keyboard: AgentId,
        answer: AnswerQuestion,
        id: RequestId,
        ctx: &mut Context<Self>,
    ) {
        if keyboard != *ctx.id() {
            let patience = ctx.settings().answer_deadline * 2;
            let request = Request::AnswerQuestion(answer);
            self.request(keyboard, Protocol::StateChange, &request, patience, Some(id), ctx);
            return;
        }
        let about = self.begin(Some(id), ctx);
        let heard = match self.deliver_answer(answer, ctx) {
            Ok(report) => UserEvent::Report(about, report),
            Err(refusal) => UserEvent::Refused(about, refusal),
        };
        self.emit(heard);
    }

    /// Handles a request to this keyboard: an answer that a person has given at another keyboard,
    /// to a question that this keyboard keeps. Refuses any other request.
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let answer = match message.content_as::<Request>() {
            Ok(Request::AnswerQuestion(answer)) => answer,
            Ok(_) => {
                let detail = "a keyboard takes answers to its questions: `answer-question`";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        let number = answer.question;
        match self.deliver_answer(answer, ctx) {
            Ok(report) => {
                ctx.answer(&participation, Performative::Confirm, &report);
                let who = format!("answered by `{}`", message.sender);
                self.emit(UserEvent::QuestionClosed(number, who));
            }
            Err(refusal) => ctx.answer(&participation, Performative::Refuse, &refusal),
        }
    }

    fn deliver_answer(
        &mut self,
        answer: AnswerQuestion,
        ctx: &mut Context<Self>,
    ) -> Result<Report, Refusal> {
        let AnswerQuestion { question: number, answer: said } = answer;
        // The keyboard that sends the answer may not have the key.
        let said = match self.questions.seal_to(number).filter(|_| said.sealed.is_none()) {
            Some(key) => sealed(key, &said)?,
            None => said,
        };
        let Some(question) = self.questions.take(number) else {
            let open = self.questions.numbers();
            let detail = format!("`{}` has no open question {number}; open: {open}", ctx.id());
            return Err(Refusal::new(Reason::Unknown, detail));
        };
        ctx.cancel_timer(question.timer);
        let inform = Inform::Answer(said);
        ctx.answer(&question.participation, Performative::Inform, &inform);
        let asker = &question.participation.initiator;
        Ok(Report::new(Outcome::Done, format!("`{asker}` was told")))
    }
}

/// Returns a person's answer encrypted to the key of the question.
fn sealed(key: &str, said: &PersonsAnswer) -> Result<PersonsAnswer, Refusal> {
    match credentials::seal_answer(key, &said.text) {
        Ok(sealed) => Ok(PersonsAnswer { text: String::new(), sealed: Some(sealed) }),
        Err(error) => Err(Refusal::new(Reason::BadContent, format!("the answer {error}"))),
    }
}

/// Converts a message about a requested goal or action to an output to the person. Returns an error
/// if the content is invalid.
fn read(message: &Message, id: Option<RequestId>) -> Result<UserEvent, String> {
    let about = RequestRef { id, conversation: message.conversation_id.clone() };
    match message.performative {
        Performative::Confirm => {
            let report = message.content_as::<Report>().map_err(|error| error.to_string())?;
            Ok(UserEvent::Report(about, report))
        }
        _ => {
            let refusal = message.content_as::<Refusal>().map_err(|error| error.to_string())?;
            Ok(UserEvent::Refused(about, refusal))
        }
    }
}
