//! Scheduling of several goals: selects the goal that is planned for next, the agents for each
//! goal, the plans that may run in parallel, and the goals that must yield.
//!
//! - One goal is planned for at a time, by priority; plans run in parallel.
//! - The first attempt plans without the agents that act in other plans
//!   ([`PlanningMode::Cooperative`]). The second attempt also uses the agents that act for goals of
//!   lower priority; these goals yield ([`PlanningMode::Preemptive`]). If neither attempt finds a
//!   plan, the goal waits.
//! - A plan must not undo kept goals of at least the same priority. If there is no such plan, a
//!   plan is made without this constraint, only to explain which goals conflict
//!   ([`PlanningMode::DiagnoseConflict`]).
//! - If an agent joins that would make a running plan much cheaper, the goal of that plan is
//!   planned for again. A running plan is not given up for a small gain.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{GoalPhase, Keep, Snapshot};
use acl::{AgentId, ConversationId};
use agent::{Context, Resource};
use goal_lifecycle::{Attempt, Blockers, GoalEvent, MissingPlan, PlanDecision, PlanningMode};
use pddl::{Condition, Plan};
use planner::{Budget, Cancel, Options};

use crate::PlanRequester;
use crate::goal::{ExplanationTask, Goal, Work};
use crate::planning_snapshot::PlanningSnapshot;

/// Maximum cost of a plan that replaces a running plan, as a share of the running plan's remaining
/// cost. The share is less than 1, because steps that have begun are lost, and because two plans of
/// about the same cost must not replace each other repeatedly.
const WORTH_CHANGING: f64 = 0.8;

impl PlanRequester {
    // === before planning ===

    /// Returns `true` if any goal is being planned for. Only one goal is planned for at a time.
    pub(crate) fn is_planning_busy(&self) -> bool {
        self.goals.values().any(|goal| goal.state.phase().is_planning())
    }

    /// Returns the goals that use all agents with any action, if none of these goals has a lower
    /// priority than the goal `id`; otherwise `None`. In this case there is no plan, and no search
    /// is needed.
    pub(crate) fn all_in_use(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
    ) -> Option<Blockers> {
        let goal = self.goals.get(id)?;
        let is_taken = known.offers.is_empty() && !known.spared.is_empty();
        if !is_taken || goal.state.planning_mode() != PlanningMode::Cooperative {
            return None;
        }
        if self.running_beside(id).any(|(_, other)| other.priority < goal.priority) {
            return None;
        }
        let goals = self.running_beside(id).map(|(_, other)| other.text.clone()).collect();
        Some(Blockers { goals, agents: known.spared.clone() })
    }

    /// Returns the agents that are in use by other goals and that the goal's present
    /// [`PlanningMode`] leaves to those goals.
    pub(crate) fn agents_in_use(&self, id: &ConversationId) -> BTreeSet<AgentId> {
        let Some(goal) = self.goals.get(id) else { return BTreeSet::new() };
        let respects = |other: &Goal| match goal.state.planning_mode() {
            PlanningMode::Cooperative => true,
            PlanningMode::Preemptive => other.priority >= goal.priority,
            PlanningMode::DiagnoseConflict => false,
        };
        self.running_beside(id)
            .filter(|(_, other)| respects(other))
            .flat_map(|(_, other)| other.acting())
            .collect()
    }

    /// Returns the goal together with the kept goals that it must not undo.
    pub(crate) fn combined_goal(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
    ) -> Option<Condition> {
        let goal = self.goals.get(id)?;
        let mut conditions = vec![goal.condition.clone()];
        if goal.state.planning_mode() != PlanningMode::DiagnoseConflict {
            conditions.extend(self.kept_beside(id, known).map(|(_, kept)| kept.condition.clone()));
        }
        Some(if conditions.len() == 1 {
            goal.condition.clone()
        } else {
            Condition::And(conditions)
        })
    }

    /// Returns the kept goals other than `id` that hold and have at least the priority of the goal
    /// `id`, each with its conversation.
    fn kept_beside<'a>(
        &'a self,
        id: &'a ConversationId,
        known: &'a PlanningSnapshot,
    ) -> impl Iterator<Item = (&'a ConversationId, &'a Goal)> {
        let priority = self.goals.get(id).map_or(i32::MIN, |goal| goal.priority);
        self.goals
            .iter()
            .filter(move |(other_id, _)| *other_id != id)
            .filter(move |(_, other)| other.keep == Keep::Maintain && other.priority >= priority)
            .filter(|(_, other)| known.holds(&other.condition))
    }

    fn running_beside<'a>(
        &'a self,
        id: &'a ConversationId,
    ) -> impl Iterator<Item = (&'a ConversationId, &'a Goal)> {
        self.goals
            .iter()
            .filter(move |(other, goal)| *other != id && goal.state.phase().is_running())
    }

    // === a plan ===

    /// Decides whether a plan that was found for a goal runs, or waits for other goals.
    pub(crate) fn decide(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        plan: &Plan,
    ) -> PlanDecision {
        let Some(goal) = self.goals.get(id) else {
            return PlanDecision::WaitFor(Blockers::default());
        };
        if goal.state.planning_mode() == PlanningMode::DiagnoseConflict {
            let is_undone = |kept: &Goal| !known.can_run_beside(plan, [], [&kept.condition]);
            let undone = self.kept_beside(id, known).filter(|(_, kept)| is_undone(kept));
            let undone: Vec<_> = undone.map(|(_, kept)| format!("`{}`", kept.text)).collect();
            if !undone.is_empty() {
                return PlanDecision::Conflict(undone.join(" and "));
            }
        }
        let steps = self.running_beside(id).flat_map(|(_, other)| &other.steps_left);
        let conditions = self.running_beside(id).map(|(_, other)| &other.condition);
        if known.can_run_beside(plan, steps, conditions) {
            // All plans are checked at once; blocking plans are searched for only if that check
            // fails.
            return PlanDecision::Run;
        }
        let is_in_the_way = |(_, other): &(_, &Goal)| {
            !known.can_run_beside(plan, &other.steps_left, [&other.condition])
        };
        let in_the_way: Vec<_> = self.running_beside(id).filter(is_in_the_way).collect();
        let goals = in_the_way.iter().map(|(_, other)| other.text.clone()).collect();
        let blockers = Blockers { goals, ..Blockers::default() };
        if in_the_way.is_empty() {
            PlanDecision::Run
        } else if in_the_way.iter().all(|(_, other)| other.priority < goal.priority) {
            let ids = in_the_way.iter().map(|(other, _)| (*other).clone()).collect();
            PlanDecision::Preempt(ids, blockers)
        } else {
            PlanDecision::WaitFor(blockers)
        }
    }

    /// Handles a valid plan that was found for a goal, and the decision about the plan.
    pub(crate) fn plan_found(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        found: (Plan, f64),
        decision: PlanDecision,
        ctx: &mut Context<Self>,
    ) {
        if let Some(goal) = self.goals.get_mut(id) {
            goal.views_differ_since = None;
            if let Some(round) = &mut goal.round {
                round.found = Some(found);
            }
        }
        self.handle(id, GoalEvent::PlanFound(attempt, decision), ctx);
    }

    /// Handles the failure of the present attempt to find a plan. `why` computes the reason, as
    /// text for a person.
    pub(crate) fn plan_missing(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        why: impl FnOnce(&PlanningSnapshot, &Cancel) -> String + Send + 'static,
        ctx: &mut Context<Self>,
    ) {
        if let Some(round) = self.goals.get_mut(id).and_then(|goal| goal.round.as_mut()) {
            round.why_missing = Some(Box::new(why));
        }
        self.handle(id, GoalEvent::PlanMissing(attempt), ctx);
    }

    /// Returns the conjuncts of a goal that did not hold when its round of planning began.
    pub(crate) fn open_conjuncts(&self, id: &ConversationId) -> Vec<Condition> {
        let round = self.goals.get(id).and_then(|goal| goal.round.as_ref());
        round.map(|round| round.open.clone()).unwrap_or_default()
    }

    /// Computes in the background the reason why there is no plan for a goal, and whether the goal
    /// could be reached with the agents of other goals. This computation takes tens of milliseconds
    /// in a large building.
    pub(crate) fn explain_missing_plan(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        ctx: &mut Context<Self>,
    ) {
        let is_alone = self.goals.len() == 1;
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Some(round) = &mut goal.round else { return };
        let Some(why) = round.why_missing.take() else { return };
        let (known, condition) = (Arc::clone(&round.known), goal.condition.clone());
        let (cancel, unplanned) = (Cancel::new(), id.clone());
        let flag = cancel.clone();
        let look = move || {
            let why = why(&known, &flag);
            // A goal may wait only if it could be reached with the actions of all agents.
            let has_hope = !is_alone && !known.is_hopeless(&condition, &flag);
            (known, why, has_hope)
        };
        let work = ctx.compute(look, move |requester: &mut Self, (known, why, has_hope), ctx| {
            let missing = requester.missing_plan(&unplanned, &known, (why, has_hope));
            requester.handle(&unplanned, GoalEvent::Explained(attempt, missing), ctx);
        });
        goal.work = Work::Explanation(ExplanationTask { cancel, _work: work });
    }

    /// Returns the reason why there is no plan for a goal, and the other goals that are relevant to
    /// it.
    fn missing_plan(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        (why, has_hope): (String, bool),
    ) -> MissingPlan {
        let priority = self.goals.get(id).map_or(i32::MIN, |goal| goal.priority);
        let (lower, others): (Vec<_>, Vec<_>) =
            self.running_beside(id).partition(|(_, other)| other.priority < priority);
        let goals = others.iter().map(|(_, other)| other.text.clone()).collect();
        MissingPlan {
            why,
            has_hope,
            are_agents_free_again: !known.spared.is_subset(&self.agents_in_use(id)),
            can_preempt: !lower.is_empty(),
            blockers: Blockers { goals, agents: known.spared.clone() },
            has_kept_goals: has_hope && self.kept_beside(id, known).next().is_some(),
        }
    }

    // === preemption ===

    /// Makes other goals yield to a goal.
    pub(crate) fn preempt(
        &mut self,
        id: &ConversationId,
        others: &[ConversationId],
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get(id) else { return };
        let why = format!("gives way to `{}`", goal.text);
        for other in others {
            self.handle(other, GoalEvent::Yielded(why.clone()), ctx);
        }
    }

    /// Frees the agents that were in use by the plan of a goal that does not run any more. Goals
    /// that waited for these agents may be planned for.
    pub(crate) fn release_agents(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if let Some(goal) = self.goals.get_mut(id) {
            goal.steps_left.clear();
        }
        let goals: Vec<_> = self.goals.keys().cloned().collect();
        for id in goals {
            self.handle(&id, GoalEvent::AgentsReleased, ctx);
        }
    }

    /// Starts planning for the queued goal of the greatest priority.
    pub(crate) fn schedule_next(&mut self, ctx: &mut Context<Self>) {
        let first = self
            .goals
            .iter()
            .filter(|(_, goal)| goal.state.phase() == GoalPhase::Queued)
            .max_by_key(|(id, goal)| (goal.priority, std::cmp::Reverse((*id).clone())))
            .map(|(id, _)| id.clone());
        if let Some(id) = first {
            ctx.after(Duration::ZERO, move |requester: &mut Self, ctx| {
                requester.consider(&id, ctx);
            });
        }
    }

    // === better plans ===

    /// Checks whether running plans would be much cheaper with the agents `joined`, which have just
    /// joined.
    pub(crate) fn check_for_cheaper_plans(&mut self, joined: &[AgentId], ctx: &mut Context<Self>) {
        let is_executing = |goal: &Goal| goal.state.phase() == GoalPhase::Executing;
        if joined.is_empty() || !self.goals.values().any(is_executing) {
            return;
        }
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let names: Vec<_> = joined.iter().map(|agent| format!("`{agent}`")).collect();
        let joined = names.join(", ");
        self.cheaper_plan_check =
            Some(ctx.run(asked, move |requester: &mut Self, answers, ctx| {
                let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
                if let Some(snapshot) = snapshot {
                    requester.compare(&snapshot, &joined, ctx);
                }
            }));
    }

    /// Estimates in the background the cost of a new plan for each running goal. Plans again for a
    /// goal if the new plan would be much cheaper.
    fn compare(&mut self, snapshot: &Snapshot, joined: &str, ctx: &mut Context<Self>) {
        let Ok(known) = PlanningSnapshot::read(snapshot.clone()) else { return };
        let now = self.elapsed(ctx);
        let executing = self.goals.iter().filter(|(_, goal)| {
            goal.state.phase() == GoalPhase::Executing && !goal.steps_left.is_empty()
        });
        let mut candidates = Vec::new();
        for (id, goal) in executing {
            let others = self.running_beside(id).flat_map(|(_, other)| other.acting()).collect();
            let Some(rest) = known.cost_of_rest(&goal.steps_left, &goal.condition) else {
                continue;
            };
            let avoided = goal.state.backoffs().avoided(now);
            let known = known.clone().without_avoided(avoided).without_agents(&others);
            let problem = known.problem_of(&goal.condition);
            candidates.push((id.clone(), problem, rest, goal.state.rounds()));
        }
        let (domain, cancel) = (known.domain, Cancel::new());
        let deadline = cancel.clone();
        ctx.after(ctx.settings().proposals_deadline, move |_: &mut Self, _| deadline.set());
        let memory_max_bytes = agent::computation_bytes_max();
        let budget = Budget { memory_max_bytes, ..Budget::default() };
        let options = Options { budget, ..Options::default() };
        let estimate = move || {
            let mut candidates = candidates;
            candidates.retain(|(_, problem, rest, _)| {
                let outcome = planner::plan(&domain, problem, &options, &cancel);
                let plan = outcome.ok().and_then(|outcome| outcome.plan);
                let cost = plan.and_then(|plan| plan.cost).map(|cost| cost.0);
                cost.is_some_and(|cost| cost <= rest * WORTH_CHANGING)
            });
            candidates
        };
        let why = format!("planning anew: with {joined} there is a much cheaper plan");
        self.cheaper_plan_check =
            Some(ctx.compute(estimate, move |requester: &mut Self, better, ctx| {
                for (id, _, _, round) in better {
                    if requester.goals.get(&id).is_some_and(|goal| goal.state.rounds() == round) {
                        requester.handle(&id, GoalEvent::Yielded(why.clone()), ctx);
                    }
                }
            }));
    }
}
