//! The proposals of actuators for one goal: selects a set of them, and sends acceptances and
//! rejections to the bidders.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::content::{Choice, value};
use acl::{AgentId, Performative, ReplyToken};
use agent::{Context, TimerId};
use goal_lifecycle::Attempt;
use pddl::{Condition, Plan};

use crate::PlanRequester;
use crate::planning_snapshot::PlanningSnapshot;
use crate::selection::{Bids, Selection, selections};

/// State of an open call for proposals.
pub(crate) struct ContractNetState {
    pub(crate) attempt: Attempt,
    pub(crate) known: Arc<PlanningSnapshot>,
    pub(crate) conjuncts: Vec<String>,
    /// Called agents that have not answered in this round, each with the exchange of its call.
    pub(crate) awaited: BTreeMap<AgentId, ReplyToken>,
    pub(crate) bids: Bids,
    pub(crate) refusals: BTreeMap<AgentId, String>,
    pub(crate) silent: BTreeSet<AgentId>,
    /// Agents with bids that use actions which the Domain Maintainer does not list for these agents
    /// yet.
    pub(crate) ahead: BTreeSet<AgentId>,
    /// Agent and conjuncts of each proposal, with the exchange of the proposal.
    pub(crate) made_in: Vec<(AgentId, Vec<String>, ReplyToken)>,
    pub(crate) tokens: Vec<ReplyToken>,
    /// Timer that closes the round at its deadline.
    pub(crate) timer: TimerId,
    /// Timer that repeats the call to agents that have not answered.
    pub(crate) reminder: TimerId,
    pub(crate) is_second_round: bool,
}

impl ContractNetState {
    /// Returns the cheapest valid set of proposals that together reach the goal, with the combined
    /// plan and its cost.
    ///
    /// # Errors
    ///
    /// Returns the reasons, as texts for a person, why each of the examined sets is not valid.
    pub(crate) fn cheapest_valid(
        &mut self,
        wanted: &Condition,
    ) -> Result<(Selection, Plan, f64), Vec<String>> {
        let problems = match self.first_valid(wanted) {
            Ok(valid) => return Ok(valid),
            Err(problems) => problems,
        };
        // A proposal that does not reach its own conjuncts may have crowded valid sets out of the
        // limited number of examined sets.
        if !self.drop_unsound() {
            return Err(problems);
        }
        self.first_valid(wanted).map_err(|more| problems.into_iter().chain(more).collect())
    }

    fn first_valid(&self, wanted: &Condition) -> Result<(Selection, Plan, f64), Vec<String>> {
        let mut problems = Vec::new();
        for selection in selections(&self.conjuncts, &self.bids) {
            let plans: Vec<&str> =
                selection.chosen.iter().map(|(_, proposal)| proposal.plan.as_str()).collect();
            match self.known.combine(&plans, wanted) {
                Ok((plan, cost)) => return Ok((selection, plan, cost)),
                Err(problem) => problems.push(problem),
            }
        }
        Err(problems)
    }

    /// Drops each proposal with a plan that does not reach all conjuncts that the proposal covers.
    /// Returns `true` if any proposal was dropped.
    fn drop_unsound(&mut self) -> bool {
        let count = |bids: &Bids| bids.values().map(Vec::len).sum::<usize>();
        let before = count(&self.bids);
        let known = &self.known;
        self.bids.values_mut().for_each(|bids| bids.retain(|proposal| known.is_sound(proposal)));
        count(&self.bids) < before
    }

    /// Rejects all proposals of the call and closes the exchanges with the bidders.
    pub(crate) fn reject_all(self, why: &str, ctx: &mut Context<PlanRequester>) {
        self.award(None, why, ctx);
    }

    /// Accepts the chosen proposals, rejects all others with the reason `why`, and closes the
    /// exchanges with the bidders.
    pub(crate) fn award(
        self,
        chosen: Option<&Selection>,
        why: &str,
        ctx: &mut Context<PlanRequester>,
    ) {
        ctx.cancel_timer(self.timer);
        ctx.cancel_timer(self.reminder);
        let mut judged = BTreeSet::new();
        for (agent, covers, token) in &self.made_in {
            let is_chosen = chosen.is_some_and(|selection| {
                selection
                    .chosen
                    .iter()
                    .any(|(winner, proposal)| winner == agent && proposal.covers == *covers)
            });
            if is_chosen {
                let detail = "this proposal is in the cheapest set of proposals".to_owned();
                let choice = value(&Choice::new(covers.clone(), detail));
                ctx.send_turn(token, agent, Performative::AcceptProposal, choice);
                judged.insert((agent.clone(), token.clone()));
            }
        }
        let mut rejected: BTreeMap<&ReplyToken, Vec<AgentId>> = BTreeMap::new();
        for (agent, _, token) in &self.made_in {
            if judged.insert((agent.clone(), token.clone())) {
                rejected.entry(token).or_default().push(agent.clone());
            }
        }
        for (token, agents) in rejected {
            let choice = value(&Choice::new(Vec::new(), why.to_owned()));
            match agents.as_slice() {
                [agent] => ctx.send_turn(token, agent, Performative::RejectProposal, choice),
                // A rejection is the same for all receivers, so that one multicast is enough.
                _ => ctx.multicast_turn(token, agents, Performative::RejectProposal, choice),
            }
        }
        for token in &self.tokens {
            ctx.close(token);
        }
    }
}
