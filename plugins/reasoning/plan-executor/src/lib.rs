//! The Plan Executor (the paper, “Plan Executor”): converts a plan into requests to actuators, and
//! follows each request to its `confirm`.
//!
//! - Receives a plan as a `request` from the Plan Requester. Sends a `request` (an action) to an
//!   actuator as soon as the steps that the action depends on are done. Steps run in parallel where
//!   the order permits it.
//! - Notifies the Domain Maintainer of the effects of each confirmed action. Reports every step and
//!   the outcome to the Plan Requester.
//! - Monitors running plans: when the known state or the action models change, checks whether the
//!   rest of each plan still reaches its goal. Rejects a `confirm` that the agent's next heartbeat
//!   contradicts.
//! - Does not replan. On a failure it cancels the running steps and reports to the Plan Requester,
//!   which decides about replanning.
//!
//! The execution of each plan is the state machine of the crate `plan-execution`. Start reading at
//! `PlanExecutor::handle`, which calls that state machine.

mod monitoring;
mod takeover;

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    Act, ActionToken, Agreement, Choice, Execute, Outcome, Reason, Refusal, Report, Request, value,
};
use acl::{AgentId, Incarnation, Message, Millis, Performative, Protocol, ReplyToken};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, ExchangeEvent, ExchangeOpening,
    LaunchableAgent, Participation, PluginEntry, Presence, Resident, StepOutcome, TimerId,
    WorkHandle,
};
use plan_execution::{
    ActionRequest, ExecutionCommand, ExecutionEvent, ExecutionPhase, LastHeartbeats, PlanState,
    StepPart,
};
use serde::Deserialize;

use crate::takeover::{FinishedPlans, PlanId, Subscribers};

/// Maximum number of plans that run in parallel; further plans are refused. Each plan keeps a copy
/// of the state. A building has few goals at a time.
const EXECUTIONS_MAX: usize = 64;

/// The entry of the Plan Executor in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "plan-executor",
    about: "carries plans out, step by step, and watches them",
    drivers: &[],
    has_replicas: true,
    build,
};

/// The `config` of a Plan Executor in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct Config {
    /// Name of the Domain Maintainer that the Plan Executor notifies and queries.
    domain_maintainer: AgentId,
}

impl Default for Config {
    fn default() -> Config {
        let domain_maintainer =
            AgentId::new("domain-maintainer").expect("invariant: a literal that is a name");
        Config { domain_maintainer }
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let Config { domain_maintainer } = blueprint.config_as()?;
    let (words, running, ended) =
        (LastHeartbeats::default(), BTreeMap::new(), FinishedPlans::default());
    Ok(Box::new(PlanExecutor {
        domain_maintainer,
        last_heartbeats: words,
        running_plans: running,
        finished_plans: ended,
        departure_timer: None,
    }))
}

struct PlanExecutor {
    domain_maintainer: AgentId,
    last_heartbeats: LastHeartbeats,
    /// Running plans, by the exchange of the first request for the plan.
    running_plans: BTreeMap<ReplyToken, RunningPlan>,
    finished_plans: FinishedPlans,
    /// Timer that runs during the grace period after the last departure of an agent; `None` at all
    /// other times.
    departure_timer: Option<TimerId>,
}

/// A running plan.
struct RunningPlan {
    /// Exchanges in which the plan was requested. All reports about the plan are sent in each of
    /// these exchanges.
    subscribers: Subscribers,
    plan: PlanId,
    /// The request for the plan, as the Plan Requester sent it.
    original_request: Box<Execute>,
    state: PlanState,
    /// Exchanges with the actuators that carry out a step.
    step_exchanges: BTreeMap<StepPart, StepExchange>,
    check_timer: Option<TimerId>,
    state_query: Option<WorkHandle>,
    /// Timer that limits the time for which a completed plan waits for the heartbeats that verify
    /// its effects.
    verification_timer: Option<TimerId>,
}

/// The exchange with an actuator about its part of a step.
#[derive(Clone)]
struct StepExchange {
    exchange: ReplyToken,
    agent: AgentId,
    /// Time limit of the method.
    timeout: Duration,
    /// How long the agent waits for the other agents of a joint action; zero if it acts alone.
    ready_for: Duration,
    /// Incarnation of the agent that received the request for the step; `None` if the agent was not
    /// present.
    agent_incarnation: Option<Incarnation>,
}

impl Agent for PlanExecutor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
            .on_broadcast(Performative::Inform, Self::informed)
    }

    fn leadership_changed(&mut self, is_leading: bool, ctx: &mut Context<Self>) {
        if !is_leading {
            self.abandon_all(ctx);
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        match presence {
            Presence::Left(resident) => {
                self.last_heartbeats.remove_agent(&resident.agent);
                let grace = ctx.settings().grace;
                let borne =
                    ctx.after(grace, |executor: &mut Self, _| executor.departure_timer = None);
                self.departure_timer
                    .replace(borne)
                    .into_iter()
                    .for_each(|former| ctx.cancel_timer(former));
            }
            Presence::Joined(resident) => self.repeat_requests(resident, ctx),
        }
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        let is_other = |resident: &Resident| resident.incarnation != ctx.incarnation();
        if ctx.directory().all(ctx.id()).iter().any(is_other) {
            // The standby continues the running plans.
            self.abandon_all(ctx);
            return true;
        }
        let running: Vec<_> = self.running_plans.keys().cloned().collect();
        for token in running {
            self.give_up(&token, Report::new(Outcome::Cancelled, "the daemon is stopping"), ctx);
        }
        self.running_plans.is_empty()
    }
}

impl PlanExecutor {
    // === requests ===

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let execute = match message.content_as::<Request>() {
            Ok(Request::Execute(execute)) => execute,
            Ok(Request::CancelPlan(plan)) => return self.called_off(&participation, plan, ctx),
            Ok(_) => {
                let detail = "a Plan Executor executes plans; ask the Plan Requester for goals";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        let plan = PlanId::of(&participation.conversation, &execute);
        if self.answer_if_known(&participation, &plan, ctx) {
            return;
        }
        if self.running_plans.len() >= EXECUTIONS_MAX {
            let detail = format!("{EXECUTIONS_MAX} plans are being executed");
            return ctx.refuse(&participation, Reason::Busy, detail);
        }
        match PlanState::new(&execute, agent::knowledge(&execute.knowledge)) {
            Ok(state) => self.begin(participation, state, (plan, execute), ctx),
            Err(detail) => ctx.refuse(&participation, Reason::BadContent, detail),
        }
    }

    fn begin(
        &mut self,
        participation: Participation,
        state: PlanState,
        (plan, asked): (PlanId, Box<Execute>),
        ctx: &mut Context<Self>,
    ) {
        let token = participation.exchange.clone();
        let running = RunningPlan {
            subscribers: Subscribers::new(participation),
            plan,
            original_request: asked,
            state,
            step_exchanges: BTreeMap::new(),
            check_timer: None,
            state_query: None,
            verification_timer: None,
        };
        self.running_plans.insert(token.clone(), running);
        self.handle(&token, ExecutionEvent::Started, ctx);
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let asked = |running: &RunningPlan| running.subscribers.has(message.exchange());
        let token = self.running_plans.iter().find(|(_, running)| asked(running));
        if let Some(token) = token.map(|(token, _)| token.clone()) {
            self.give_up(&token, Report::new(Outcome::Cancelled, "cancelled as asked"), ctx);
        }
    }

    fn give_up(&mut self, token: &ReplyToken, report: Report, ctx: &mut Context<Self>) {
        self.handle(token, ExecutionEvent::CancelRequested(report), ctx);
    }

    // === the state machine ===

    /// Gives an event to the state machine of a running plan, and carries out the commands that
    /// follow.
    fn handle(&mut self, token: &ReplyToken, event: ExecutionEvent, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let commands = running.state.handle(event, &self.last_heartbeats);
        let (mut abandoned, mut begun) = (Vec::new(), Vec::new());
        for command in commands {
            match command {
                ExecutionCommand::RequestStep(part, request) => {
                    self.request_step(token, part, *request, ctx)
                }
                ExecutionCommand::BeginStep(part) => begun.push(part),
                ExecutionCommand::CompleteStep(part) => self.complete_step(token, part, ctx),
                ExecutionCommand::CancelStep(part) => {
                    abandoned.extend(self.cancel_step(token, part, ctx));
                }
                ExecutionCommand::CloseStep(part) => self.close_step(token, part, ctx),
                ExecutionCommand::SendChange(change) => self.send_change(token, change, ctx),
                ExecutionCommand::Report(report) => self.report(token, &report, ctx),
                ExecutionCommand::ScheduleCheck(delay) => self.schedule_check(token, delay, ctx),
                ExecutionCommand::QueryState => self.query_state(token, ctx),
                ExecutionCommand::DropQuery => {
                    if let Some(running) = self.running_plans.get_mut(token) {
                        running.state_query = None;
                    }
                }
                ExecutionCommand::AwaitEffects => self.await_effects(token, ctx),
                ExecutionCommand::End(report) => self.end(token, report, ctx),
            }
        }
        match begun.iter().find(|part| !self.is_here(token, part, ctx)) {
            Some(part) => {
                let problem = "one of its agents has left".to_owned();
                self.handle(token, ExecutionEvent::StepAbsent(*part, problem), ctx);
            }
            None => begun.into_iter().for_each(|part| self.begin_step(token, part, ctx)),
        }
        for part in abandoned {
            self.handle(token, ExecutionEvent::StepAbandoned(part), ctx);
        }
    }

    fn request_step(
        &mut self,
        token: &ReplyToken,
        part: StepPart,
        request: ActionRequest,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let PlanId { conversation, term, round } = running.plan.clone();
        let ActionRequest { agent, action, method, arguments, timeout, ready_for } = request;
        let act = Act {
            action,
            method,
            arguments,
            token: ActionToken {
                term,
                conversation: conversation.clone(),
                round,
                step: u32::try_from(part.step).unwrap_or(u32::MAX),
            },
            // Requests and answers take time, too, and are repeated if they are lost.
            ready_for: ready_for.map(|wait| Millis(wait + ctx.settings().answer_deadline)),
        };
        tracing::info!(%conversation, action = act.action, %agent, "dispatches");
        let opening = ExchangeOpening {
            to: Some(agent.clone()),
            performative: Performative::Request,
            protocol: Protocol::Action,
            conversation,
            content: value(&Request::Act(Box::new(act))),
        };
        let plan = token.clone();
        let ready_for = ready_for.unwrap_or_default();
        let patience = ctx.settings().answer_deadline + ready_for;
        let exchange = ctx.open(opening, patience, move |executor: &mut Self, answer, ctx| {
            executor.answered(&plan, part, answer, ctx);
        });
        let agent_incarnation = ctx.find(&agent).map(|resident| resident.incarnation);
        let exchange = StepExchange { exchange, agent, timeout, ready_for, agent_incarnation };
        running.step_exchanges.insert(part, exchange);
    }

    /// Tells the actuator of a part that all agents of its joint action have done their parts.
    fn complete_step(&mut self, token: &ReplyToken, part: StepPart, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get(token) else { return };
        if let Some(done) = running.step_exchanges.get(&part) {
            let detail = "all of its agents have done their parts";
            let choice = Choice { are_parts_done: true, ..Choice::new(Vec::new(), detail) };
            let (exchange, agent) = (&done.exchange, &done.agent);
            ctx.send_turn(exchange, agent, Performative::AcceptProposal, value(&choice));
            ctx.extend(&done.exchange, ctx.settings().answer_deadline * 2);
        }
    }

    /// Whether the agent of a part is present, in the incarnation that has agreed.
    fn is_here(&self, token: &ReplyToken, part: &StepPart, ctx: &Context<Self>) -> bool {
        let running = self.running_plans.get(token);
        let asked = running.and_then(|running| running.step_exchanges.get(part));
        asked.is_some_and(|asked| {
            let here = ctx.find(&asked.agent).map(|resident| resident.incarnation);
            here.is_some() && here == asked.agent_incarnation
        })
    }

    /// Tells the actuator of a part that all agents of its joint action are ready, and that it begins.
    fn begin_step(&mut self, token: &ReplyToken, part: StepPart, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get(token) else { return };
        if let Some(begun) = running.step_exchanges.get(&part) {
            let choice = Choice::new(Vec::new(), "all of its agents are ready");
            let (exchange, agent) = (&begun.exchange, &begun.agent);
            ctx.send_turn(exchange, agent, Performative::AcceptProposal, value(&choice));
            ctx.extend(&begun.exchange, begun.timeout + ctx.settings().answer_deadline);
        }
    }

    fn answered(
        &mut self,
        token: &ReplyToken,
        part: StepPart,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        // What a plan that is given up still waits for has a time limit already.
        let is_active = running.state.phase() != ExecutionPhase::GivingUp;
        let Some(asked) = running.step_exchanges.get_mut(&part) else { return };
        if let ExchangeEvent::Message(message) = &answer {
            // The agent was absent when it was asked.
            asked.agent_incarnation.get_or_insert(message.incarnation);
        }
        let StepExchange { exchange, agent, timeout, ready_for, .. } = asked;
        let event = match answer {
            ExchangeEvent::TimedOut => {
                ExecutionEvent::StepLost(part, format!("`{agent}` did not answer in time"))
            }
            ExchangeEvent::Undelivered(why) => {
                ExecutionEvent::StepAbsent(part, format!("`{agent}` could not be reached: {why}"))
            }
            ExchangeEvent::Message(message) => match message.performative {
                Performative::Agree => {
                    // The agent has agreed; from now on the time limit is that of its method.
                    let margin = ctx.settings().answer_deadline;
                    // In a joint action it waits for the others first, and each wait has its margin.
                    let wait = match ready_for.is_zero() {
                        true => Duration::ZERO,
                        false => *ready_for + margin,
                    };
                    if is_active {
                        ctx.extend(exchange, wait + *timeout + margin);
                    }
                    let agreement = message.content_as::<Agreement>();
                    let has_begun = agreement.is_ok_and(|agreement| agreement.has_begun);
                    ExecutionEvent::StepAgreed { part, has_begun }
                }
                Performative::Confirm => match message.content_as::<Report>() {
                    Ok(report) => {
                        if report.is_part_done && is_active {
                            let margin = ctx.settings().answer_deadline;
                            ctx.extend(exchange, *ready_for + margin * 2);
                        }
                        if report.outcome.is_final() {
                            running.step_exchanges.remove(&part);
                        }
                        ExecutionEvent::StepReported(part, report)
                    }
                    Err(error) => {
                        ctx.not_understood(&message, error.to_string());
                        let problem = "sent a confirmation that cannot be read";
                        ExecutionEvent::StepLost(part, format!("`{agent}` {problem}"))
                    }
                },
                _ => {
                    let unread = |_| Refusal::new(Reason::Other, "without a reason");
                    ExecutionEvent::StepRefused(part, message.content_as().unwrap_or_else(unread))
                }
            },
        };
        if let Some(outcome) = outcome_of(&event) {
            ctx.activity().count_step(outcome);
        }
        self.handle(token, event, ctx);
    }

    /// Requests the actuator of a part to cancel the action. Returns the part if the actuator is
    /// absent. An absent actuator receives the `cancel` when it returns soon, and its answer is not
    /// awaited.
    fn cancel_step(
        &mut self,
        token: &ReplyToken,
        part: StepPart,
        ctx: &mut Context<Self>,
    ) -> Option<StepPart> {
        let running = self.running_plans.get_mut(token)?;
        let Some(asked) = running.step_exchanges.get(&part) else { return Some(part) };
        let StepExchange { exchange, agent, .. } = asked.clone();
        ctx.send_turn(&exchange, &agent, Performative::Cancel, serde_json::Value::Null);
        if ctx.find(&agent).is_some() {
            ctx.extend(&exchange, ctx.settings().answer_deadline);
            return None;
        }
        running.step_exchanges.remove(&part);
        ctx.close(&exchange);
        Some(part)
    }

    fn close_step(&mut self, token: &ReplyToken, part: StepPart, ctx: &mut Context<Self>) {
        let running = self.running_plans.get_mut(token);
        if let Some(it) = running.and_then(|running| running.step_exchanges.remove(&part)) {
            ctx.close(&it.exchange);
        }
    }

    /// Sends the effects of a confirmed action to the Domain Maintainer.
    fn send_change(
        &mut self,
        token: &ReplyToken,
        change: acl::content::ChangeState,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get(token) else { return };
        let opening = ExchangeOpening {
            to: Some(self.domain_maintainer.clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: running.plan.conversation.clone(),
            content: value(&Request::ChangeState(change)),
        };
        let told = token.clone();
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |executor: &mut Self, _, ctx| {
            executor.handle(&told, ExecutionEvent::ChangeAnswered, ctx);
        });
    }

    fn end(&mut self, token: &ReplyToken, report: Report, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.remove(token) else { return };
        for timer in [running.check_timer, running.verification_timer].into_iter().flatten() {
            ctx.cancel_timer(timer);
        }
        tracing::info!(conversation = %running.plan.conversation, outcome = %report.outcome,
            detail = report.detail, "ends");
        running.subscribers.send_to_all(&report, ctx);
        self.finished_plans.store_outcome(running.plan, report);
    }

    fn report(&mut self, token: &ReplyToken, report: &Report, ctx: &mut Context<Self>) {
        if let Some(running) = self.running_plans.get(token) {
            running.subscribers.send_to_all(report, ctx);
        }
    }
}

/// Returns the outcome of a step that this event ends; `None` if the step goes on.
fn outcome_of(event: &ExecutionEvent) -> Option<StepOutcome> {
    match event {
        ExecutionEvent::StepReported(_, report) => StepOutcome::of(report.outcome),
        ExecutionEvent::StepRefused(..) => Some(StepOutcome::Refused),
        ExecutionEvent::StepLost(..) | ExecutionEvent::StepAbsent(..) => Some(StepOutcome::Lost),
        _ => None,
    }
}
