//! Execution of a plan, and replanning when the plan fails, for centralised and decentralised
//! planning.

use std::time::Duration;

use acl::content::{Execute, GoalPhase, Outcome, Refusal, Report, Request, value};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Context, DeliveryError, ExchangeEvent, ExchangeOpening};
use goal_lifecycle::{Attempt, ExecutionEnd, GoalEvent};

use crate::PlanRequester;
use crate::goal::{PlanningRound, Work};

impl PlanRequester {
    /// Reports the plan that was found for a goal to the user, and requests the Plan Executor to
    /// execute it.
    pub(crate) fn execute(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Some(PlanningRound { known, found: Some((plan, cost)), .. }) = goal.round.take() else {
            return;
        };
        let execute = Execute {
            domain: known.domain_text.clone(),
            problem: known.problem_of(&goal.condition).to_string(),
            plan: plan.to_string(),
            epoch: known.epoch,
            term: self.journal_client.term(),
            round: goal.state.rounds(),
            done: Vec::new(),
            offers: known.offers_of(&plan),
            knowledge: known.words.clone(),
        };
        goal.plan = Some(Box::new(execute));
        goal.steps_left = known.outside(&plan).steps;
        goal.failed_steps.clear();
        self.ask_executor(id, attempt, ctx);
        self.replicate_plan(id, ctx);
        let steps = match plan.steps.len() {
            1 => "1 step".to_owned(),
            count => format!("{count} steps"),
        };
        let mut report = Report::new(Outcome::Progress, format!("a plan of {steps}, cost {cost}"));
        report.plan = Some(known.outside(&plan).to_string());
        report.cost = Some(cost);
        self.send_report(id, report, ctx);
    }

    /// Requests the Plan Executor to execute the goal's plan from the first step that is not done.
    /// The Plan Executor may run this plan already, for this replica of the Plan Requester or for
    /// another one.
    pub(crate) fn ask_executor(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Some(execute) = goal.plan.clone() else { return };
        let offers = || execute.offers.values().flat_map(|actions| actions.values());
        let timeouts = offers().filter_map(|offer| Some(offer.method.as_ref()?.timeout.0));
        // An agent of a joint action may wait for the others as long as their methods take.
        let waits = if offers().any(|offer| offer.agents > 1) { 2 } else { 1 };
        // The time limit covers the longest method of a step and three answer deadlines. Each
        // progress report restarts it.
        let patience =
            timeouts.max().unwrap_or_default() * waits + ctx.settings().answer_deadline * 3;
        let opening = ExchangeOpening {
            to: Some(self.config.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: id.clone(),
            content: value(&Request::Execute(execute)),
        };
        if let Work::Execution(former) = &goal.work {
            ctx.close(former);
        }
        let executed = id.clone();
        let token = ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            requester.executor_answered(&executed, (attempt, patience), answer, ctx);
        });
        goal.work = Work::Execution(token);
    }

    fn executor_answered(
        &mut self,
        id: &ConversationId,
        (attempt, patience): (Attempt, Duration),
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id).filter(|goal| goal.is_current(attempt)) else {
            return;
        };
        let is_executing = goal.state.phase() == GoalPhase::Executing;
        if is_executing && matches!(answer, ExchangeEvent::Undelivered(DeliveryError::Restarted)) {
            // The executor may have lost the plan, or another executor may lead now.
            return self.handle(id, GoalEvent::ExecutorRestarted(attempt), ctx);
        }
        let answer = match running_plan_of_refusal(answer) {
            Ok(plan) => {
                let round = plan.round;
                goal.other_plan = Some(plan);
                return self.handle(id, GoalEvent::OtherPlanRuns(attempt, round), ctx);
            }
            Err(answer) => answer,
        };
        let end = match read(answer) {
            Ok(report) if matches!(report.outcome, Outcome::Progress | Outcome::Holds) => {
                report.action.iter().for_each(|action| goal.step_done(action, report.step));
                if is_executing && let Work::Execution(token) = &goal.work {
                    ctx.extend(token, patience);
                }
                return self.send_report(id, report, ctx);
            }
            Ok(report) => match report.outcome {
                Outcome::Done => ExecutionEnd::Done,
                Outcome::Cancelled => ExecutionEnd::Cancelled(report.detail),
                _ => {
                    let agent = report.agent.clone();
                    let blamed = report.action.as_deref().and_then(|it| blamed(it, agent));
                    ExecutionEnd::Failed(report, blamed)
                }
            },
            Err((why, wait)) => ExecutionEnd::Unknown(why, wait),
        };
        if is_executing {
            goal.failed_steps = std::mem::take(&mut goal.steps_left);
        }
        goal.work = Work::Nothing;
        self.handle(id, GoalEvent::ExecutionEnded(attempt, end), ctx);
    }

    /// Adopts a plan of the goal that already runs, instead of the plan made here. Another replica
    /// of the Plan Requester made the running plan.
    pub(crate) fn adopt_running_plan(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Some(plan) = goal.other_plan.take() else { return };
        let done = plan.done.clone();
        goal.adopt_plan(*plan, done);
        self.replicate_plan(id, ctx);
    }
}

/// Returns the plan of the goal that already runs, if `answer` is the refusal of the Plan Executor
/// because of that plan.
///
/// # Errors
///
/// Returns every other `answer` unchanged.
pub(crate) fn running_plan_of_refusal(
    answer: ExchangeEvent,
) -> Result<Box<Execute>, ExchangeEvent> {
    let ExchangeEvent::Message(message) = &answer else { return Err(answer) };
    if message.performative != Performative::Refuse {
        return Err(answer);
    }
    let refusal = message.content_as::<Refusal>().ok();
    refusal.and_then(|refusal| refusal.under_way).ok_or(answer)
}

/// Returns the Plan Executor's report from `answer`. A refusal for good is a report that the plan has
/// failed.
///
/// # Errors
///
/// If the end of the execution is not known, or the Plan Executor has no time, returns the reason and
/// the delay before the next attempt.
fn read(answer: ExchangeEvent) -> Result<Report, (String, Duration)> {
    let message = match answer {
        ExchangeEvent::Message(message) => message,
        ExchangeEvent::TimedOut => {
            return Err(("the Plan Executor stopped answering".to_owned(), crate::ASK_AGAIN));
        }
        ExchangeEvent::Undelivered(why) => {
            let why = format!("the Plan Executor could not be reached: {why}");
            return Err((why, crate::ASK_AGAIN));
        }
    };
    message.content_as::<Report>().or_else(|_| {
        let refusal = message.content_as::<Refusal>().ok();
        let detail = refusal.as_ref().map(|refusal| refusal.detail.as_str()).unwrap_or_default();
        let why = format!("the Plan Executor declined: {detail}");
        match refusal.map(|refusal| refusal.reason) {
            Some(reason) if crate::is_passing(reason) => Err((why, crate::BUSY)),
            declined => Ok(Report { declined, ..Report::new(Outcome::Failed, why) }),
        }
    })
}

/// Returns the agent that failed and the name of its action; `None` if `action` cannot be parsed. The
/// agent is the first argument, unless the report names one.
fn blamed(action: &str, agent: Option<AgentId>) -> Option<(AgentId, String)> {
    let step = pddl::parse_step(action).into_result().ok()?;
    let first = || AgentId::new(step.arguments.first()?.as_str()).ok();
    let agent = agent.or_else(first)?;
    Some((agent, step.action.as_str().to_owned()))
}
