//! Verification: checks whether a goal holds after its plan was carried out.
//!
//! The plan's effects are only expectations, and the known state decides whether the goal holds.
//! For example, a lamp of another agent may still be on in the room, or a measured value may be too
//! low.

use std::time::Duration;

use acl::ConversationId;
use acl::content::Snapshot;
use agent::{Context, Resource};
use goal_lifecycle::{Attempt, GoalEvent, GoalVerdict};

use crate::PlanRequester;
use crate::goal::{Goal, Work};
use crate::planning_snapshot::PlanningSnapshot;

impl PlanRequester {
    /// Checks, after the time `wait`, whether a goal that is to be achieved once holds after its
    /// plan was carried out.
    pub(crate) fn verify(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        wait: Duration,
        ctx: &mut Context<Self>,
    ) {
        if wait.is_zero() {
            return self.verify_now(id, attempt, ctx);
        }
        let verified = id.clone();
        ctx.after(wait, move |requester: &mut Self, ctx| {
            requester.verify_now(&verified, attempt, ctx);
        });
    }

    fn verify_now(&mut self, id: &ConversationId, attempt: Attempt, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id).filter(|goal| goal.is_current(attempt)) else {
            return;
        };
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let verified = id.clone();
        let work = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            let Some(goal) = requester.goals.get(&verified) else { return };
            let verdict =
                snapshot.map_or(GoalVerdict::Unanswered, |snapshot| verdict(goal, snapshot));
            requester.handle(&verified, GoalEvent::Verified(attempt, verdict), ctx);
        });
        goal.work = Work::Question(work);
    }
}

/// Compares a goal with the known state.
fn verdict(goal: &Goal, snapshot: Snapshot) -> GoalVerdict {
    let unmet = PlanningSnapshot::read(snapshot).and_then(|known| {
        let open = known.open_conjuncts(&goal.condition)?;
        Ok(open.first().map(|conjunct| known.describe_status(conjunct)))
    });
    match unmet {
        Ok(None) => GoalVerdict::Holds,
        Ok(Some(unmet)) => GoalVerdict::Unmet(unmet),
        Err(problem) => GoalVerdict::Unusable(problem),
    }
}
