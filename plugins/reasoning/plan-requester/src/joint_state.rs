//! The state of joint planning for one goal, and the answers to the agents of a joint plan.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::content::{Choice, value};
use acl::{AgentId, Incarnation, Performative, ReplyToken};
use agent::{Context, TimerId, WorkHandle};
use goal_lifecycle::Attempt;
use pddl::Condition;
use planner::Cancel;

use crate::PlanRequester;
use crate::explanations::listed;
use crate::joint_plans::JointPlan;
use crate::planning_snapshot::PlanningSnapshot;

/// The gap between the proposals for a goal and the goal.
pub(crate) struct BiddingGap {
    /// The conjuncts that no proposal covers.
    pub(crate) missing: Vec<String>,
    /// The reasons why the examined sets of proposals do not work.
    pub(crate) problems: Vec<String>,
    /// The reasons of agents that refused, other than that they cannot reach anything.
    pub(crate) refusals: BTreeMap<AgentId, String>,
    /// Agents that did not answer.
    pub(crate) silent: BTreeSet<AgentId>,
}

/// State of joint planning for one goal.
pub(crate) struct JointPlanState {
    pub(crate) attempt: Attempt,
    pub(crate) known: Arc<PlanningSnapshot>,
    /// The goal, together with the kept goals that must not be undone.
    pub(crate) wanted: Condition,
    /// The agents that may act, with their incarnations.
    pub(crate) members: BTreeMap<AgentId, Incarnation>,
    pub(crate) gap: BiddingGap,
    /// The reasons, as text for a person, why agents were left out.
    pub(crate) declined: Vec<String>,
    /// The reason of an agent whose state of the world differs from `known`; `None` if there is none.
    pub(crate) differing: Option<String>,
    /// Number of joint plans that were searched.
    pub(crate) plans: u32,
    pub(crate) phase: JointPhase,
}

#[derive(Default)]
pub(crate) enum JointPhase {
    /// The next search has not begun.
    #[default]
    Idle,
    Searching(#[expect(dead_code, reason = "ends the search when it is dropped")] JointSearch),
    Agreeing(PendingAgreements),
}

/// A search for a joint plan in the background. Dropping it cancels the search.
pub(crate) struct JointSearch {
    pub(crate) cancel: Cancel,
    pub(crate) _work: WorkHandle,
}

/// The agreements to one joint plan.
pub(crate) struct PendingAgreements {
    pub(crate) joint: JointPlan,
    /// Agents that have not answered, each with the exchange of its call.
    pub(crate) awaited: BTreeMap<AgentId, ReplyToken>,
    pub(crate) agreed: BTreeMap<AgentId, ReplyToken>,
    /// Timer that ends the wait for agreements.
    pub(crate) timer: TimerId,
    /// Timer that repeats the calls that are not answered.
    pub(crate) reminder: TimerId,
}

impl Drop for JointSearch {
    fn drop(&mut self) {
        self.cancel.set();
    }
}

// === impl BiddingGap ===

impl BiddingGap {
    /// Returns, as text for a person, why the proposals do not suffice, and which agents do not take
    /// part in the joint plan.
    pub(crate) fn describe(&self, declined: &[String]) -> String {
        let missing = self.missing.iter().map(|conjunct| format!("`{conjunct}`"));
        let missing = listed(missing.collect(), " and ");
        let mut text = match self.problems.first().filter(|_| self.missing.is_empty()) {
            Some(problem) => format!("the proposals do not work together ({problem})"),
            None => format!("no agent reaches {missing} by itself"),
        };
        let refused = self.refusals.iter().map(|(agent, why)| format!("`{agent}` refused: {why}"));
        let silent = self.silent.iter().map(|agent| format!("`{agent}` did not answer"));
        let others: Vec<String> = refused.chain(silent).chain(declined.iter().cloned()).collect();
        if !others.is_empty() {
            text += &format!(" ({})", listed(others, "; "));
        }
        text
    }
}

// === impl PendingAgreements ===

impl PendingAgreements {
    /// Accepts all agreements, and returns the joint plan.
    pub(crate) fn accept(
        self,
        conjuncts: Vec<String>,
        ctx: &mut Context<PlanRequester>,
    ) -> JointPlan {
        let detail = "every agent of the joint plan agrees to its part".to_owned();
        let choice = value(&Choice::new(conjuncts, detail));
        self.settle(Performative::AcceptProposal, &choice, ctx)
    }

    /// Rejects all agreements that were given, and returns the joint plan.
    pub(crate) fn reject(self, why: &str, ctx: &mut Context<PlanRequester>) -> JointPlan {
        let choice = value(&Choice::new(Vec::new(), why.to_owned()));
        self.settle(Performative::RejectProposal, &choice, ctx)
    }

    fn settle(
        self,
        verdict: Performative,
        choice: &serde_json::Value,
        ctx: &mut Context<PlanRequester>,
    ) -> JointPlan {
        ctx.cancel_timer(self.timer);
        ctx.cancel_timer(self.reminder);
        for (agent, token) in &self.agreed {
            ctx.send_turn(token, agent, verdict, choice.clone());
        }
        // The exchanges of agents that have not answered stay open until their time limit, so that an
        // agreement that comes late is rejected, and holds its agent no longer.
        self.agreed.values().for_each(|token| ctx.close(token));
        self.joint
    }
}
