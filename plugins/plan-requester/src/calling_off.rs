//! Plans of goals that have ended, or hold, which another Plan Requester made: it was cut off, or died,
//! and they may run still (design, “No single point of failure”).

use acl::content::{CallOff, Execute, Request, value};
use acl::{ConversationId, Performative, Protocol};
use agent::{Context, Opening};

use crate::PlanRequester;
use crate::executing::under_way;

/// How often another plan of the same goal may turn out to be under way instead.
const TIMES_MAX: u32 = 4;

impl PlanRequester {
    /// Has the executor give up a plan that nobody needs any more.
    pub(crate) fn call_off(
        &mut self,
        id: &ConversationId,
        plan: &Execute,
        times: u32,
        ctx: &mut Context<Self>,
    ) {
        let opening = Opening {
            to: Some(self.config.plan_executor.clone()),
            performative: Performative::Request,
            protocol: Protocol::Execution,
            conversation: id.clone(),
            content: value(&Request::CallOff(CallOff { term: plan.term, round: plan.round })),
        };
        let (called_off, patience) = (id.clone(), ctx.settings().answer_deadline * 2);
        ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            if let Ok(plan) = under_way(answer)
                && times < TIMES_MAX
                && !requester.runs(&called_off, &plan)
            {
                requester.call_off(&called_off, &plan, times + 1, ctx);
            }
        });
    }

    /// Whether this plan is the one that runs for a goal here: it may have been begun meanwhile.
    fn runs(&self, id: &ConversationId, plan: &Execute) -> bool {
        let running = self.goals.get(id).filter(|goal| goal.phase.is_running());
        let own = running.and_then(|goal| goal.plan.as_deref());
        own.is_some_and(|own| (own.term, own.round) == (plan.term, plan.round))
    }
}
