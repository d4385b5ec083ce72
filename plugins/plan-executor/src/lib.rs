//! The Plan Executor (the paper, “Plan Executor”): turns a plan into requests to actuators and follows
//! each one to its `confirm`.
//!
//! - Takes a plan by `request` from the Plan Requester. Sends a `request` (an action) to an actuator as
//!   soon as the steps that the action depends on are done; steps run side by side where the order
//!   allows it.
//! - Notifies the Domain Maintainer of the effects of each confirmed action. Reports every step and the
//!   outcome to the Plan Requester.
//! - Watches running plans: when the known state or the action models change, checks whether the rest
//!   of each plan still reaches its goal. Does not believe a `confirm` that the agent's next heartbeat
//!   contradicts.
//! - Does not replan: on failure it cancels the running steps and reports; the Plan Requester decides.

mod effect_check;
mod execution;
mod monitoring;
mod takeover;
mod translate;

use std::collections::BTreeMap;

use acl::content::{Act, ActionToken, Execute, Outcome, Reason, Refusal, Report, Request, value};
use acl::{AgentId, Incarnation, Message, Performative, Protocol, ReplyToken};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, ExchangeEvent, ExchangeOpening,
    LaunchableAgent, Participation, PluginEntry, Presence, Resident, TimerId, WorkHandle,
};
use serde::Deserialize;

use crate::effect_check::{LastHeartbeats, UnverifiedEffect};
use crate::execution::Execution;
use crate::takeover::{FinishedPlans, PlanId, Subscribers};

/// Maximum number of plans that run side by side. Each plan keeps a copy of the state. A building has
/// few goals at a time.
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
    /// Name of the Domain Maintainer that the Plan Executor works with.
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
    /// Running plans, by the exchange in which each was first requested.
    running_plans: BTreeMap<ReplyToken, RunningPlan>,
    finished_plans: FinishedPlans,
    /// Timer that runs while any agent has left less than the grace ago; `None` if there is no such
    /// agent.
    departure_timer: Option<TimerId>,
}

/// A running plan.
struct RunningPlan {
    /// Exchanges in which the plan was requested. All reports about the plan are sent in each of them.
    subscribers: Subscribers,
    plan: PlanId,
    /// The request for the plan, as the Plan Requester sent it.
    original_request: Box<Execute>,
    execution: Execution,
    /// The steps that actuators are carrying out, with the exchange of each, by the index of the step.
    running_steps: BTreeMap<usize, RunningStep>,
    /// Final report of a plan that is given up, sent when no agent acts any more; `None` while the plan
    /// is not given up.
    final_report: Option<Report>,
    /// Number of changes that were sent to the Domain Maintainer and that it has not confirmed yet.
    /// While the number is not zero, the Domain Maintainer's state is older than the state known here.
    unconfirmed_changes: usize,
    check_timer: Option<TimerId>,
    /// Timer that ends the wait (grace) for an agent that the plan needs and that is absent.
    grace_timer: Option<TimerId>,
    /// Whether the plan has waited for the grace since the last check that succeeded.
    grace_used: bool,
    state_query: Option<WorkHandle>,
    /// Number of checks of the plan that have failed in a row: 0 or 1. A failed check is repeated once
    /// before the plan is given up, because news may still be on their way.
    retries: u32,
    /// Confirmed changes that contradict the last heartbeat of their agents, kept until the next
    /// heartbeat of each agent.
    unverified_effects: BTreeMap<AgentId, UnverifiedEffect>,
    /// Timer that limits how long a completed plan waits for the heartbeats that verify its effects.
    verification_timer: Option<TimerId>,
}

/// A step that an actuator is carrying out.
#[derive(Clone)]
struct RunningStep {
    exchange: ReplyToken,
    agent: AgentId,
    /// Incarnation of the agent that was asked to carry out the step; `None` if the agent was not
    /// present.
    agent_incarnation: Option<Incarnation>,
    /// The ground action of the step, under the name that its agent uses.
    action: String,
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
        let engagement = Participation::of(&message);
        let execute = match message.content_as::<Request>() {
            Ok(Request::Execute(execute)) => execute,
            Ok(Request::CallOff(plan)) => return self.called_off(&engagement, plan, ctx),
            Ok(_) => {
                let detail = "a Plan Executor executes plans; ask the Plan Requester for goals";
                return ctx.refuse(&engagement, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        let plan = PlanId::of(&engagement.conversation, &execute);
        if self.answer_if_known(&engagement, &plan, ctx) {
            return;
        }
        if self.running_plans.len() >= EXECUTIONS_MAX {
            let detail = format!("{EXECUTIONS_MAX} plans are being executed");
            return ctx.refuse(&engagement, Reason::Busy, detail);
        }
        match Execution::new(&execute) {
            Ok(execution) => self.begin(engagement, execution, (plan, execute), ctx),
            Err(detail) => ctx.refuse(&engagement, Reason::BadContent, detail),
        }
    }

    fn begin(
        &mut self,
        engagement: Participation,
        execution: Execution,
        (plan, asked): (PlanId, Box<Execute>),
        ctx: &mut Context<Self>,
    ) {
        let token = engagement.exchange.clone();
        let running = RunningPlan {
            subscribers: Subscribers::new(engagement),
            plan,
            original_request: asked,
            execution,
            running_steps: BTreeMap::new(),
            final_report: None,
            unconfirmed_changes: 0,
            check_timer: None,
            grace_timer: None,
            grace_used: false,
            state_query: None,
            retries: 0,
            unverified_effects: BTreeMap::new(),
            verification_timer: None,
        };
        self.running_plans.insert(token.clone(), running);
        self.dispatch(&token, ctx);
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let asked = |running: &RunningPlan| running.subscribers.has(message.exchange());
        let token = self.running_plans.iter().find(|(_, running)| asked(running));
        if let Some(token) = token.map(|(token, _)| token.clone()) {
            self.give_up(&token, Report::new(Outcome::Cancelled, "cancelled as asked"), ctx);
        }
    }

    // === acting ===

    /// Sends a request to an actuator for every step with all predecessors done; ends the plan if no
    /// step is left.
    fn dispatch(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        if running.final_report.is_some() {
            return self.finish_if_idle(token, ctx);
        }
        if running.execution.is_complete() && !running.unverified_effects.is_empty() {
            return self.await_verification(token, ctx);
        }
        if running.execution.is_complete() {
            let outcome = match running.execution.unmet_goal() {
                None => Report::new(Outcome::Done, "the goal holds"),
                Some(unmet) => {
                    Report::new(Outcome::Failed, format!("every step is done, yet {unmet}"))
                }
            };
            running.final_report = Some(outcome);
            return self.finish_if_idle(token, ctx);
        }
        for step in running.execution.ready() {
            self.request_action(token, step, ctx);
        }
    }

    fn request_action(&mut self, token: &ReplyToken, step: usize, ctx: &mut Context<Self>) {
        let patience = ctx.settings().answer_deadline;
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let conversation = running.plan.conversation.clone();
        let order = match running.execution.start(step) {
            Ok(order) => order,
            Err(problem) => return self.give_up(token, failure(problem), ctx),
        };
        let PlanId { term, round, .. } = running.plan;
        let action = order.action.clone();
        let act = Act {
            action: order.action,
            method: order.method,
            arguments: order.arguments,
            token: ActionToken {
                epoch: term,
                conversation: conversation.clone(),
                round,
                step: u32::try_from(step).unwrap_or(u32::MAX),
            },
        };
        tracing::info!(%conversation, action = act.action, agent = %order.agent, "dispatches");
        let opening = ExchangeOpening {
            to: Some(order.agent.clone()),
            performative: Performative::Request,
            protocol: Protocol::Action,
            conversation,
            content: value(&Request::Act(Box::new(act))),
        };
        let (plan, timeout) = (token.clone(), order.timeout);
        let exchange = ctx.open(opening, patience, move |executor: &mut Self, answer, ctx| {
            executor.answered(&plan, step, timeout, answer, ctx);
        });
        let life = ctx.find(&order.agent).map(|resident| resident.incarnation);
        if let Some(running) = self.running_plans.get_mut(token) {
            running.running_steps.insert(
                step,
                RunningStep { exchange, agent: order.agent, agent_incarnation: life, action },
            );
        }
    }

    fn answered(
        &mut self,
        token: &ReplyToken,
        step: usize,
        timeout: std::time::Duration,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let Some(RunningStep { exchange, agent, .. }) = running.running_steps.get(&step).cloned()
        else {
            return;
        };
        let message = match answer {
            ExchangeEvent::Message(message) => message,
            ExchangeEvent::TimedOut => {
                let problem = format!("`{agent}` did not answer in time");
                return self.failed(token, step, problem, ctx);
            }
            ExchangeEvent::Undelivered(why) => {
                let problem = format!("`{agent}` could not be reached: {why}");
                return self.failed(token, step, problem, ctx);
            }
        };
        match message.performative {
            // The agent has agreed: from now on it has the time that its method may take.
            Performative::Agree => {
                let margin = ctx.settings().answer_deadline;
                ctx.extend(&exchange, timeout + margin);
            }
            Performative::Confirm => match message.content_as::<Report>() {
                Ok(report) => self.confirmed(token, step, &agent, report, ctx),
                Err(error) => {
                    ctx.not_understood(&message, error.to_string());
                    let problem = format!("`{agent}` sent a confirmation that cannot be read");
                    self.failed(token, step, problem, ctx);
                }
            },
            _ => {
                let refusal = message.content_as::<Refusal>();
                let refusal =
                    refusal.unwrap_or_else(|_| Refusal::new(Reason::Other, "without a reason"));
                // A busy agent has not failed: it can do the same action a moment later.
                let is_busy = matches!(refusal.reason, Reason::Busy | Reason::MailboxFull);
                if is_busy && let Some(acting) = self.running_step(token, step) {
                    acting.action.clear();
                }
                let problem = format!("`{agent}` declined: {}", refusal.detail);
                self.declined(token, step, problem, refusal.reason, ctx);
            }
        }
    }

    fn running_step(&mut self, token: &ReplyToken, step: usize) -> Option<&mut RunningStep> {
        self.running_plans.get_mut(token)?.running_steps.get_mut(&step)
    }

    fn confirmed(
        &mut self,
        token: &ReplyToken,
        step: usize,
        agent: &AgentId,
        report: Report,
        ctx: &mut Context<Self>,
    ) {
        match report.outcome {
            Outcome::Done => self.step_done(token, step, agent, report, ctx),
            Outcome::Failed => {
                if let Some(why @ (Reason::Uncertain | Reason::TimedOut)) = report.declined {
                    return self.step_uncertain((token, step), agent, (why, report), ctx);
                }
                self.failed(token, step, format!("`{agent}` failed: {}", report.detail), ctx);
            }
            Outcome::Cancelled => {
                self.failed(token, step, format!("`{agent}` gave up: {}", report.detail), ctx);
            }
            Outcome::Progress | Outcome::Holds => self.report(token, &report, ctx),
        }
    }

    /// Handles a step that is done: applies its effects, sends these effects to the Domain Maintainer,
    /// and goes on with the plan.
    fn step_done(
        &mut self,
        token: &ReplyToken,
        step: usize,
        agent: &AgentId,
        mut report: Report,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let action =
            running.running_steps.remove(&step).map(|acting| acting.action).unwrap_or_default();
        match running.execution.finish(step) {
            Ok(mut change) => {
                // Only the last heartbeat and the last action of an agent count.
                running.unverified_effects.remove(agent);
                let doubt = self.last_heartbeats.check_effect(agent, action, &change);
                running.unverified_effects.extend(doubt.map(|doubt| (agent.clone(), doubt)));
                change.owner = Some(agent.clone());
                self.send_change(token, change, ctx);
            }
            Err(problem) => return self.give_up(token, failure(problem), ctx),
        }
        report.outcome = Outcome::Progress;
        report.step = u32::try_from(step).ok();
        self.report(token, &report, ctx);
        self.dispatch(token, ctx);
    }

    /// Handles a step that may or may not have been done: the facts that the step would have changed
    /// become unknown, and the Plan Requester plans again. The action does not count as failed if its
    /// agent was restarted.
    fn step_uncertain(
        &mut self,
        (token, step): (&ReplyToken, usize),
        agent: &AgentId,
        (why, report): (Reason, Report),
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        let mut change = running.execution.uncertain(step);
        if why == Reason::Uncertain
            && let Some(acting) = running.running_steps.get_mut(&step)
        {
            acting.action.clear();
        }
        if !change.believe.is_empty() {
            change.owner = Some(agent.clone());
            self.send_change(token, change, ctx);
        }
        let problem = format!("`{agent}`: {}", report.detail);
        self.declined(token, step, problem, why, ctx);
    }

    /// Sends the effects of a confirmed action to the Domain Maintainer.
    fn send_change(
        &mut self,
        token: &ReplyToken,
        change: acl::content::ChangeState,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        running.unconfirmed_changes += 1;
        let opening = ExchangeOpening {
            to: Some(self.domain_maintainer.clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: running.plan.conversation.clone(),
            content: value(&Request::ChangeState(change)),
        };
        let told = token.clone();
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |executor: &mut Self, _, _| {
            if let Some(running) = executor.running_plans.get_mut(&told) {
                running.unconfirmed_changes = running.unconfirmed_changes.saturating_sub(1);
            }
        });
    }

    fn failed(
        &mut self,
        token: &ReplyToken,
        step: usize,
        problem: String,
        ctx: &mut Context<Self>,
    ) {
        self.fail(token, step, failure(problem), ctx);
    }

    fn declined(
        &mut self,
        token: &ReplyToken,
        step: usize,
        problem: String,
        reason: Reason,
        ctx: &mut Context<Self>,
    ) {
        let report = Report { declined: Some(reason), ..failure(problem) };
        self.fail(token, step, report, ctx);
    }

    fn fail(
        &mut self,
        token: &ReplyToken,
        step: usize,
        mut report: Report,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        report.detail = format!("{}: {}", running.execution.step_text(step), report.detail);
        if let Some(RunningStep { exchange, action, .. }) = running.running_steps.remove(&step) {
            ctx.close(&exchange);
            report.action = Some(action).filter(|action| !action.is_empty());
        }
        self.give_up(token, report, ctx);
    }

    // === ending ===

    /// Gives a plan up: cancels its running steps. The plan ends when no agent acts any more. An absent
    /// agent receives the `cancel` if it comes back soon, but the end of the plan does not wait for it.
    fn give_up(&mut self, token: &ReplyToken, report: Report, ctx: &mut Context<Self>) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        if running.final_report.is_none() {
            running.final_report = Some(report);
            let patience = ctx.settings().answer_deadline;
            running.running_steps.retain(|_, RunningStep { exchange, agent, .. }| {
                ctx.send_turn(exchange, agent, Performative::Cancel, serde_json::Value::Null);
                let is_here = ctx.find(agent).is_some();
                if is_here {
                    ctx.extend(exchange, patience);
                } else {
                    ctx.close(exchange);
                }
                is_here
            });
        }
        self.finish_if_idle(token, ctx);
    }

    fn finish_if_idle(&mut self, token: &ReplyToken, ctx: &mut Context<Self>) {
        let is_quiet = |running: &RunningPlan| {
            running.running_steps.is_empty() && running.final_report.is_some()
        };
        if !self.running_plans.get(token).is_some_and(is_quiet) {
            return;
        }
        let Some(running) = self.running_plans.remove(token) else { return };
        let Some(report) = running.final_report else { return };
        for timer in [running.check_timer, running.grace_timer, running.verification_timer]
            .into_iter()
            .flatten()
        {
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

fn failure(problem: String) -> Report {
    Report::new(Outcome::Failed, problem)
}
