//! Carrying a plan out, and planning anew when it fails: the same in both flows.

use std::time::Duration;

use acl::content::{Execute, Keep, Outcome, Refusal, Report, Request, value};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Answer, Context, Opening};
use pddl::Plan;

use crate::PlanRequester;
use crate::goal::Phase;
use crate::known::Known;

impl PlanRequester {
    /// Tells the user the plan and asks the Plan Executor to execute it.
    pub(crate) fn execute(
        &mut self,
        id: &ConversationId,
        known: &Known,
        plan: &Plan,
        cost: f64,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.rounds += 1;
        let offers = known.offers_of(plan);
        let timeouts: Duration = offers
            .values()
            .flat_map(|actions| actions.values())
            .filter_map(|offer| offer.method.as_ref().map(|method| method.timeout.0))
            .max()
            .unwrap_or_default();
        // No step may take longer than the longest method and two answers; each report of
        // progress gives the next step its time.
        let patience = timeouts + ctx.settings().answer_deadline * 3;
        let execute = Execute {
            domain: known.domain_text.clone(),
            problem: known.problem_of(&goal.condition).to_string(),
            plan: plan.to_string(),
            epoch: known.epoch,
            round: goal.rounds,
            offers,
        };
        let steps = plan.steps.len();
        let mut report =
            Report::new(Outcome::Progress, format!("a plan of {steps} steps, cost {cost}"));
        report.plan = Some(known.outside(plan).to_string());
        report.cost = Some(cost);
        self.tell(id, report, ctx);
        let opening = Opening {
            to: Some(self.config.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: id.clone(),
            content: value(&Request::Execute(Box::new(execute))),
        };
        let executed = id.clone();
        let token = ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            requester.executor_answered(&executed, patience, answer, ctx);
        });
        if let Some(goal) = self.goals.get_mut(id) {
            goal.phase = Phase::Executing(token);
        }
    }

    fn executor_answered(
        &mut self,
        id: &ConversationId,
        patience: Duration,
        answer: Answer,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get(id) else { return };
        let is_cancelling = matches!(goal.phase, Phase::Cancelling(_));
        let (Phase::Executing(token) | Phase::Cancelling(token)) = &goal.phase else { return };
        let token = token.clone();
        let message = match answer {
            Answer::Message(message) => message,
            _ if is_cancelling => {
                let detail = "cancelled; the Plan Executor did not confirm it";
                return self.end(id, Outcome::Cancelled, detail, ctx);
            }
            Answer::Silence => {
                let why = "the Plan Executor fell silent".to_owned();
                return self.retry(id, why, crate::ASK_AGAIN, ctx);
            }
            Answer::Undelivered(why) => {
                let why = format!("the Plan Executor could not be reached: {why}");
                return self.retry(id, why, crate::ASK_AGAIN, ctx);
            }
        };
        let Ok(report) = message.content_as::<Report>() else {
            let why = message.content_as::<Refusal>().map(|refusal| refusal.detail);
            let why = format!("the Plan Executor declined: {}", why.unwrap_or_default());
            return self.retry(id, why, crate::BUSY, ctx);
        };
        match report.outcome {
            Outcome::Progress | Outcome::Holds => {
                if !is_cancelling {
                    ctx.extend(&token, patience);
                }
                self.tell(id, report, ctx);
            }
            Outcome::Cancelled if is_cancelling => {
                self.end(id, Outcome::Cancelled, "cancelled as asked", ctx);
            }
            Outcome::Done if is_cancelling => {
                self.end(id, Outcome::Done, "it was done before the cancel came", ctx);
            }
            _ if is_cancelling => self.end(id, Outcome::Cancelled, report.detail, ctx),
            Outcome::Done => self.carried_out(id, ctx),
            Outcome::Failed | Outcome::Cancelled => self.execution_failed(id, report, ctx),
        }
    }

    fn carried_out(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.failures = 0;
        match goal.keep {
            Keep::Achieve => self.end(id, Outcome::Done, "the goal holds", ctx),
            // Looked at once more before it is said to hold: an agent may have left meanwhile.
            Keep::Maintain => {
                goal.phase = Phase::Holding;
                self.settle(id, ctx);
                self.next(ctx);
            }
        }
    }

    /// A plan failed: what failed is avoided for a while, and another plan is made at once.
    fn execution_failed(&mut self, id: &ConversationId, report: Report, ctx: &mut Context<Self>) {
        let now = ctx.now();
        let Some(goal) = self.goals.get_mut(id) else { return };
        if let Some((agent, action)) = report.action.as_deref().and_then(blamed) {
            goal.avoid(agent, action, now);
        }
        self.retry(id, report.detail, Duration::ZERO, ctx);
    }
}

/// Who failed with what: of the ground action, its first argument and its name.
fn blamed(action: &str) -> Option<(AgentId, String)> {
    let step = pddl::parse_step(action).into_result().ok()?;
    let agent = AgentId::new(step.arguments.first()?.as_str()).ok()?;
    Some((agent, step.action.as_str().to_owned()))
}
