//! Execution of a plan, and replanning when it fails. Centralised and decentralised planning share this
//! module.

use std::time::Duration;

use acl::content::{Execute, Keep, Outcome, Refusal, Report, Request, value};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Context, DeliveryError, ExchangeEvent, ExchangeOpening};
use pddl::Plan;

use crate::PlanRequester;
use crate::goal::GoalPhase;
use crate::planning_snapshot::PlanningSnapshot;

impl PlanRequester {
    /// Reports the plan of a goal to the user and asks the Plan Executor to execute it.
    pub(crate) fn execute(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        plan: &Plan,
        cost: f64,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.rounds += 1;
        let execute = Execute {
            domain: known.domain_text.clone(),
            problem: known.problem_of(&goal.condition).to_string(),
            plan: plan.to_string(),
            epoch: known.epoch,
            term: self.keeper.term(),
            round: goal.rounds,
            done: Vec::new(),
            offers: known.offers_of(plan),
            knowledge: known.words.clone(),
        };
        goal.plan = Some(Box::new(execute));
        goal.steps_left = known.outside(plan).steps;
        goal.failed_steps.clear();
        goal.blocked_by.clear();
        goal.no_plan_because.clear();
        self.ask_executor(id, ctx);
        self.replicate_plan(id, ctx);
        let steps = match plan.steps.len() {
            1 => "1 step".to_owned(),
            count => format!("{count} steps"),
        };
        let mut report = Report::new(Outcome::Progress, format!("a plan of {steps}, cost {cost}"));
        report.plan = Some(known.outside(plan).to_string());
        report.cost = Some(cost);
        self.send_report(id, report, ctx);
        // The next goal may be planned for during execution.
        self.schedule_next(ctx);
    }

    /// Asks the Plan Executor to execute the goal's plan from the first step that is not done. The Plan
    /// Executor may already run this plan, for this replica or for another replica of the Plan
    /// Requester.
    pub(crate) fn ask_executor(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Some(execute) = goal.plan.clone() else { return };
        let offers = execute.offers.values().flat_map(|actions| actions.values());
        let timeouts = offers.filter_map(|offer| Some(offer.method.as_ref()?.timeout.0));
        // No step takes longer than the longest method and two answers. Each progress report restarts
        // this time.
        let patience = timeouts.max().unwrap_or_default() + ctx.settings().answer_deadline * 3;
        let opening = ExchangeOpening {
            to: Some(self.config.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: id.clone(),
            content: value(&Request::Execute(execute)),
        };
        if let GoalPhase::Executing(former) = &goal.phase {
            ctx.close(former);
        }
        let executed = id.clone();
        let token = ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            requester.executor_answered(&executed, patience, answer, ctx);
        });
        goal.phase = GoalPhase::Executing(token);
    }

    fn executor_answered(
        &mut self,
        id: &ConversationId,
        patience: Duration,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let (GoalPhase::Executing(token)
        | GoalPhase::Cancelling(token)
        | GoalPhase::Preempted(token)) = &goal.phase
        else {
            return;
        };
        let token = token.clone();
        let is_executing = matches!(goal.phase, GoalPhase::Executing(_));
        if is_executing && matches!(answer, ExchangeEvent::Undelivered(DeliveryError::Restarted)) {
            // The executor may have lost the plan, or another executor leads now: asks for the same
            // plan again.
            return self.ask_executor(id, ctx);
        }
        let answer = match running_plan_of_refusal(answer) {
            Ok(plan) => return self.adopt_running_plan(id, *plan, ctx),
            Err(answer) => answer,
        };
        let report = match read(answer) {
            Ok(report) if matches!(report.outcome, Outcome::Progress | Outcome::Holds) => {
                report.action.iter().for_each(|action| goal.step_done(action, report.step));
                if matches!(goal.phase, GoalPhase::Executing(_)) {
                    ctx.extend(&token, patience);
                }
                return self.send_report(id, report, ctx);
            }
            read => read,
        };
        let asked_to = std::mem::replace(&mut goal.phase, GoalPhase::Queued);
        if matches!(asked_to, GoalPhase::Executing(_)) {
            goal.failed_steps = std::mem::take(&mut goal.steps_left);
        }
        // Other goals wait until it is clear whether this goal is reached: their plans might undo it.
        let is_verified = goal.keep == Keep::Achieve
            && matches!(asked_to, GoalPhase::Executing(_))
            && report.as_ref().is_ok_and(|report| report.outcome == Outcome::Done);
        if !is_verified {
            self.release_agents(id);
        }
        match (asked_to, report) {
            (GoalPhase::Cancelling(_), report) => self.cancelled_in_execution(id, report, ctx),
            (_, Ok(report)) if report.outcome == Outcome::Done => self.carried_out(id, ctx),
            // The goal queues for its turn; the goal that it yielded to comes first.
            (GoalPhase::Preempted(_), _) => self.schedule_next(ctx),
            (_, Ok(report)) => self.execution_failed(id, report, ctx),
            (_, Err((why, wait))) => self.retry(id, why, wait, ctx),
        }
    }

    /// Adopts a plan of the goal that is already running, in place of the plan made here. Another
    /// replica of the Plan Requester made the running plan without the knowledge of this one.
    fn adopt_running_plan(&mut self, id: &ConversationId, plan: Execute, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let is_cancelled = matches!(goal.phase, GoalPhase::Cancelling(_));
        goal.rounds = goal.rounds.max(plan.round);
        let done = plan.done.clone();
        goal.adopt_plan(plan, done);
        self.ask_executor(id, ctx);
        if is_cancelled {
            return self.cancel(id, ctx);
        }
        self.replicate_plan(id, ctx);
        let detail = "another plan for the goal is under way, and goes on";
        self.send_report(id, Report::new(Outcome::Progress, detail), ctx);
    }

    fn cancelled_in_execution(
        &mut self,
        id: &ConversationId,
        report: Result<Report, (String, Duration)>,
        ctx: &mut Context<Self>,
    ) {
        let (outcome, detail) = match report {
            Ok(report) if report.outcome == Outcome::Done => {
                (Outcome::Done, "it was done before the cancel came".to_owned())
            }
            Ok(report) if report.outcome == Outcome::Cancelled => {
                (Outcome::Cancelled, "cancelled as asked".to_owned())
            }
            Ok(report) => (Outcome::Cancelled, report.detail),
            Err((why, _)) => (Outcome::Cancelled, format!("cancelled, not confirmed: {why}")),
        };
        self.end(id, outcome, detail, ctx);
    }

    fn carried_out(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        match goal.keep {
            Keep::Achieve => self.verify(id, 1, ctx),
            // Checked once more before it is reported to hold: an agent may have left meanwhile.
            Keep::Maintain => {
                goal.failures = 0;
                goal.phase = GoalPhase::Holding;
                self.recheck_soon(id, ctx);
                self.schedule_next(ctx);
            }
        }
    }

    /// Handles a failed plan: avoids the failed action for a while, and makes another plan for the goal
    /// at once.
    fn execution_failed(&mut self, id: &ConversationId, report: Report, ctx: &mut Context<Self>) {
        let now = ctx.now();
        let Some(goal) = self.goals.get_mut(id) else { return };
        if let Some(blamed) = report.action.as_deref().and_then(blamed) {
            goal.penalize(blamed, &report, now);
        }
        self.retry(id, report.detail, Duration::ZERO, ctx);
    }
}

/// Returns the plan that is running instead of the requested one, if the Plan Executor refused the
/// request for that reason; otherwise returns `answer` unchanged.
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

/// Returns the Plan Executor's report from `answer`. If the answer contains no report, returns the
/// reason and how long to wait before the next try.
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
    message.content_as::<Report>().map_err(|_| {
        let why = message.content_as::<Refusal>().map(|refusal| refusal.detail);
        (format!("the Plan Executor declined: {}", why.unwrap_or_default()), crate::BUSY)
    })
}

/// Returns the agent and the action name of a ground action that failed; `None` if `action` cannot be
/// parsed.
fn blamed(action: &str) -> Option<(AgentId, String)> {
    let step = pddl::parse_step(action).into_result().ok()?;
    let agent = AgentId::new(step.arguments.first()?.as_str()).ok()?;
    Some((agent, step.action.as_str().to_owned()))
}
