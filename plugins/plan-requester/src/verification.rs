//! Verification: whether a goal holds after its plan was carried out.
//!
//! The plan's effects are only expectations; the known state decides whether the goal holds: a lamp of
//! another agent may still be on in the room, or a measured value may be too low.

use acl::ConversationId;
use acl::content::{Outcome, Snapshot};
use agent::{Context, Resource};

use crate::PlanRequester;
use crate::goal::GoalPhase;
use crate::planning_snapshot::PlanningSnapshot;

/// Number of checks of the goal before its plan counts as carried out in vain. An agent's last
/// heartbeat may still be on its way.
const LOOKS_MAX: u32 = 3;

impl PlanRequester {
    /// Checks whether a goal that is to be achieved once holds, now that its plan was carried out.
    /// `look` counts the checks.
    pub(crate) fn verify(&mut self, id: &ConversationId, look: u32, ctx: &mut Context<Self>) {
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let verified = id.clone();
        let work = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            requester.verified(&verified, look, snapshot, ctx);
        });
        if let Some(goal) = self.goals.get_mut(id) {
            goal.phase = GoalPhase::Verifying(Some(work));
        }
    }

    fn verified(
        &mut self,
        id: &ConversationId,
        look: u32,
        snapshot: Option<Snapshot>,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get(id) else { return };
        let Some(snapshot) = snapshot else {
            self.release_agents(id);
            let why = "no Domain Maintainer answers".to_owned();
            return self.wait(id, why, crate::ASK_AGAIN, ctx);
        };
        let known = PlanningSnapshot::read(snapshot);
        let unmet = known.and_then(|known| {
            let open = known.open_conjuncts(&goal.condition)?;
            Ok(open.first().map(|conjunct| known.describe_status(conjunct)))
        });
        match unmet {
            Ok(None) => self.end(id, Outcome::Done, "the goal holds", ctx),
            Ok(Some(_)) if look < LOOKS_MAX => self.verify_later(id, look + 1, ctx),
            Ok(Some(unmet)) => {
                self.release_agents(id);
                let why = format!("every step is done, and {unmet}");
                self.retry(id, why, std::time::Duration::ZERO, ctx);
            }
            Err(problem) => self.end(id, Outcome::Failed, problem, ctx),
        }
    }

    fn verify_later(&mut self, id: &ConversationId, look: u32, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.phase = GoalPhase::Verifying(None);
        let (round, verified) = (goal.rounds, id.clone());
        ctx.after(crate::SETTLE_DELAY, move |requester: &mut Self, ctx| {
            let is_still = requester.goals.get(&verified).is_some_and(|goal| {
                goal.rounds == round && matches!(goal.phase, GoalPhase::Verifying(None))
            });
            if is_still {
                requester.verify(&verified, look, ctx);
            }
        });
    }
}
