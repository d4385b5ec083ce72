//! Cancels orphan plans: plans that another replica of the Plan Requester made for goals that have
//! ended or already hold. That replica was cut off or has crashed, and its plans may still run
//! (docs/design.md, “Fail-over”).

use acl::content::{CancelPlan, Execute, Request, value};
use acl::{ConversationId, Performative, Protocol};
use agent::{Context, ExchangeOpening};

use crate::PlanRequester;
use crate::execution::running_plan_of_refusal;

/// Maximum number of further orphan plans of one goal that are cancelled after the first one. The
/// Plan Executor may answer each cancellation with another running plan of the same goal.
const TIMES_MAX: u32 = 4;

impl PlanRequester {
    /// Requests the Plan Executor to cancel an orphan plan. `times` is the number of orphan plans
    /// that were already cancelled for the goal.
    pub(crate) fn cancel_orphan(
        &mut self,
        id: &ConversationId,
        plan: &Execute,
        times: u32,
        ctx: &mut Context<Self>,
    ) {
        let opening = ExchangeOpening {
            to: Some(self.config.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: id.clone(),
            content: value(&Request::CancelPlan(CancelPlan { term: plan.term, round: plan.round })),
        };
        let (called_off, patience) = (id.clone(), ctx.settings().answer_deadline * 2);
        ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            if let Ok(plan) = running_plan_of_refusal(answer)
                && times < TIMES_MAX
                && !requester.runs(&called_off, &plan)
            {
                requester.cancel_orphan(&called_off, &plan, times + 1, ctx);
            }
        });
    }

    /// Returns `true` if `plan` is the plan that this replica runs for the goal. The replica may
    /// have adopted this plan after the cancellation was decided.
    fn runs(&self, id: &ConversationId, plan: &Execute) -> bool {
        let running = self.goals.get(id).filter(|goal| goal.state.phase().is_running());
        let own = running.and_then(|goal| goal.plan.as_deref());
        own.is_some_and(|own| (own.term, own.round) == (plan.term, plan.round))
    }
}
