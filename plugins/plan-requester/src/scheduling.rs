//! Scheduling of several goals: which goal is planned for next, which agents each goal uses, which
//! plans may run side by side, and which goal yields.
//!
//! - One goal is planned for at a time, by priority; plans run side by side.
//! - A plan is first made without the agents that act in other plans ([`PlanningMode::Cooperative`]),
//!   then also with the agents that act for goals of lower priority, which yield
//!   ([`PlanningMode::Preemptive`]). If neither succeeds, the goal waits.
//! - A plan must not undo kept goals of at least the priority of its own goal. If there is no such
//!   plan, one is made without this constraint, only to explain which goals conflict
//!   ([`PlanningMode::DiagnoseConflict`]).
//! - When an agent joins that would make a running plan much cheaper, the goal of that plan is planned
//!   for again. For a small gain the running plan is not given up.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Keep, Outcome, Report, Snapshot};
use acl::{AgentId, ConversationId, Performative};
use agent::{Context, Resource, WorkHandle};
use pddl::{Condition, Plan};
use planner::{Budget, Cancel, Options};
use tokio::time::Instant;

use crate::PlanRequester;
use crate::goal::{Goal, GoalPhase};
use crate::planning_snapshot::PlanningSnapshot;

/// A running plan is replaced only by a plan that costs at most this share of the running plan's
/// remaining cost: steps that have begun are lost, and two plans of about the same cost must not
/// alternate.
const WORTH_CHANGING: f64 = 0.8;

/// How long a goal counts as blocked by agents that other goals use, without planning for it again.
/// After this time planning is tried again, because the state may have changed.
const STILL_BLOCKED: Duration = Duration::from_secs(5);

/// Maximum number of goals that are listed by name in a message about what blocks a goal.
const BLOCKERS_TOLD: usize = 3;

/// The other plans and goals that a round of planning must respect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PlanningMode {
    /// The new plan respects all running plans and all kept goals.
    #[default]
    Cooperative,
    /// The new plan respects only goals of at least the priority of its own goal; the other goals
    /// yield.
    Preemptive,
    /// The new plan respects no other plan or goal. It is not executed; it only explains a conflict.
    DiagnoseConflict,
}

/// Background computation of the reason why there is no plan for a goal; cancelled when it is dropped.
pub(crate) struct ExplanationTask {
    cancel: Cancel,
    _work: WorkHandle,
}

impl Drop for ExplanationTask {
    fn drop(&mut self) {
        self.cancel.set();
    }
}

/// Decision about what is done with a plan that was found.
pub(crate) enum PlanDecision {
    /// Execute the plan at once.
    Run,
    /// Execute the plan after the goals listed here have yielded.
    Preempt(Vec<ConversationId>),
    /// Do not execute the plan yet: wait for the goals listed here.
    WaitFor(Vec<ConversationId>),
    /// Do not execute the plan: it would undo the kept goals named in this text.
    Conflict(String),
}

impl PlanRequester {
    // === before planning ===

    /// Whether a goal may be planned for now. If another goal is being planned for, puts this goal into
    /// the queue.
    pub(crate) fn is_its_turn(&mut self, id: &ConversationId) -> bool {
        let is_busy = self.goals.values().any(|other| other.phase.is_planning());
        let Some(goal) = self.goals.get_mut(id) else { return false };
        if goal.phase.is_planning() || goal.phase.is_running() {
            return false;
        }
        if is_busy {
            goal.phase = GoalPhase::Queued;
        }
        !is_busy
    }

    /// Whether planning would find the goal blocked again, because all agents that blocked it last are
    /// still in use. This check saves rounds of planning when many goals share few agents.
    pub(crate) fn is_still_blocked(&mut self, id: &ConversationId, now: Instant) -> bool {
        let reserved = self.agents_in_use(id);
        let Some(goal) = self.goals.get_mut(id) else { return false };
        let is_still = goal.blocked_by_agents.as_ref().is_some_and(|(under, until)| {
            now < *until && !under.is_empty() && under.is_subset(&reserved)
        });
        if is_still {
            goal.phase = GoalPhase::WaitingForAgents(goal.blocked_by.clone());
        }
        is_still
    }

    /// Makes the goal wait if all agents that offer any action are in use by other goals, and none of
    /// these goals has a lower priority. No search is needed to see that there is no plan. Returns
    /// whether the goal waits.
    pub(crate) fn wait_if_all_in_use(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        ctx: &mut Context<Self>,
    ) -> bool {
        let Some(goal) = self.goals.get(id) else { return false };
        let (priority, is_beside) =
            (goal.priority, goal.planning_mode == PlanningMode::Cooperative);
        let is_taken = known.offers.is_empty() && !known.spared.is_empty();
        if !is_taken || !is_beside {
            return false;
        }
        if self.running_beside(id).any(|(_, other)| other.priority < priority) {
            return false;
        }
        let others: Vec<_> = self.running_beside(id).map(|(other, _)| other.clone()).collect();
        self.lacks(id, known, &others, ctx);
        true
    }

    /// Returns the agents that other goals use and that the goal's present [`PlanningMode`] leaves to
    /// them.
    pub(crate) fn agents_in_use(&self, id: &ConversationId) -> BTreeSet<AgentId> {
        let Some(goal) = self.goals.get(id) else { return BTreeSet::new() };
        let respects = |other: &Goal| match goal.planning_mode {
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
        if goal.planning_mode != PlanningMode::DiagnoseConflict {
            conditions.extend(self.kept_beside(id, known).map(|(_, kept)| kept.condition.clone()));
        }
        Some(if conditions.len() == 1 {
            goal.condition.clone()
        } else {
            Condition::And(conditions)
        })
    }

    /// Returns the other kept goals that hold and have at least the priority of a goal.
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
        self.goals.iter().filter(move |(other, goal)| *other != id && goal.phase.is_running())
    }

    // === a plan ===

    /// Decides what is done with a plan that was found for a goal.
    pub(crate) fn decide(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        plan: &Plan,
    ) -> PlanDecision {
        let Some(goal) = self.goals.get(id) else { return PlanDecision::WaitFor(Vec::new()) };
        if goal.planning_mode == PlanningMode::DiagnoseConflict {
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
            // All plans are checked at once; blockers are searched only if that check fails.
            return PlanDecision::Run;
        }
        let is_in_the_way = |(_, other): &(_, &Goal)| {
            !known.can_run_beside(plan, &other.steps_left, [&other.condition])
        };
        let in_the_way: Vec<_> = self.running_beside(id).filter(is_in_the_way).collect();
        let ids = in_the_way.iter().map(|(other, _)| (*other).clone()).collect();
        if in_the_way.is_empty() {
            PlanDecision::Run
        } else if in_the_way.iter().all(|(_, other)| other.priority < goal.priority) {
            PlanDecision::Preempt(ids)
        } else {
            PlanDecision::WaitFor(ids)
        }
    }

    /// Carries out the decision about a plan.
    pub(crate) fn apply_decision(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        (plan, cost): (&Plan, f64),
        verdict: PlanDecision,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.planning_mode = PlanningMode::Cooperative;
        goal.no_plan_since =
            goal.no_plan_since.filter(|_| matches!(verdict, PlanDecision::Conflict(_)));
        match verdict {
            PlanDecision::Run => self.execute(id, known, plan, cost, ctx),
            PlanDecision::Preempt(others) => {
                let text = format!("gives way to `{}`", goal.text);
                self.block(id, &others, ctx);
                for other in others {
                    self.preempt(&other, &text, ctx);
                }
            }
            PlanDecision::WaitFor(others) => self.block(id, &others, ctx),
            PlanDecision::Conflict(kept) => {
                let why = format!("every plan for it would undo {kept}, which is kept");
                self.no_plan(id, why, ctx);
            }
        }
    }

    /// Handles that the present attempt found no plan. Computes in the background the reason, and
    /// whether the agents of other goals would help; this computation takes tens of milliseconds in a
    /// large building.
    pub(crate) fn explain_missing_plan(
        &mut self,
        id: &ConversationId,
        known: PlanningSnapshot,
        why: impl FnOnce(&PlanningSnapshot, &Cancel) -> String + Send + 'static,
        ctx: &mut Context<Self>,
    ) {
        let is_alone = self.goals.len() == 1;
        let Some(goal) = self.goals.get_mut(id) else { return };
        let (condition, cancel) = (goal.condition.clone(), Cancel::new());
        let (flag, unplanned) = (cancel.clone(), id.clone());
        let look = move || {
            let why = why(&known, &flag);
            // A goal may wait only if there is hope: it must be reachable with the actions of all
            // agents.
            let has_hope = !is_alone && !known.is_hopeless(&condition, &flag);
            (known, why, has_hope)
        };
        let work = ctx.compute(look, move |requester: &mut Self, (known, why, has_hope), ctx| {
            requester.explained(&unplanned, &known, (why, has_hope), ctx);
        });
        goal.phase = GoalPhase::Explaining(ExplanationTask { cancel, _work: work });
    }

    /// Continues when the reason for the missing plan is known: tries the next attempt, waits for other
    /// goals, or reports the reason.
    fn explained(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        (why, has_hope): (String, bool),
        ctx: &mut Context<Self>,
    ) {
        let is_free_again = !known.spared.is_subset(&self.agents_in_use(id));
        if let Some(goal) = self.goals.get_mut(id).filter(|_| is_free_again) {
            // The search left out agents that are free now.
            goal.phase = GoalPhase::Queued;
            return self.schedule_next(ctx);
        }
        let Some(goal) = self.goals.get(id) else { return };
        let (attempt, priority) = (goal.planning_mode, goal.priority);
        let (lower, others): (Vec<_>, Vec<_>) =
            self.running_beside(id).partition(|(_, other)| other.priority < priority);
        let blocking: Vec<_> = others.iter().map(|(other, _)| (*other).clone()).collect();
        let next = match attempt {
            PlanningMode::Cooperative if has_hope && !lower.is_empty() => {
                Some(PlanningMode::Preemptive)
            }
            PlanningMode::Cooperative | PlanningMode::Preemptive
                if has_hope && !blocking.is_empty() =>
            {
                return self.lacks(id, known, &blocking, ctx);
            }
            PlanningMode::Cooperative | PlanningMode::Preemptive
                if has_hope && self.kept_beside(id, known).next().is_some() =>
            {
                Some(PlanningMode::DiagnoseConflict)
            }
            _ => None,
        };
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.planning_mode = next.unwrap_or_default();
        match next {
            Some(_) => {
                goal.phase = GoalPhase::Queued;
                self.consider(id, ctx);
            }
            None => self.no_plan(id, why, ctx),
        }
    }

    // === preemption ===

    /// Makes a goal wait for agents that other goals use.
    fn lacks(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        others: &[ConversationId],
        ctx: &mut Context<Self>,
    ) {
        self.block(id, others, ctx);
        if let Some(goal) = self.goals.get_mut(id) {
            goal.blocked_by_agents = Some((known.spared.clone(), ctx.now() + STILL_BLOCKED));
        }
    }

    /// Makes a goal wait until the plan of one of the goals `others` no longer runs.
    fn block(&mut self, id: &ConversationId, others: &[ConversationId], ctx: &mut Context<Self>) {
        let texts: Vec<_> = others
            .iter()
            .filter_map(|other| self.goals.get(other))
            .map(|other| format!("`{}`", other.text))
            .collect();
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.planning_mode = PlanningMode::Cooperative;
        goal.blocked_by_agents = None;
        let why = match texts.split_at(texts.len().min(BLOCKERS_TOLD)) {
            (told, []) => format!("needs what {} is using", told.join(" and ")),
            (told, more) => {
                format!("needs what {} and {} more are using", told.join(", "), more.len())
            }
        };
        let is_news = goal.blocked_by != why;
        goal.blocked_by.clone_from(&why);
        goal.phase = GoalPhase::WaitingForAgents(why.clone());
        if is_news {
            self.send_report(id, Report::new(Outcome::Progress, format!("waiting: it {why}")), ctx);
        }
        self.schedule_next(ctx);
    }

    /// Asks the Plan Executor to cancel the plan of a goal; the goal is planned for again afterwards.
    fn preempt(&mut self, id: &ConversationId, why: &str, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let GoalPhase::Executing(token) = &goal.phase else { return };
        let token = token.clone();
        goal.phase = GoalPhase::Preempted(token.clone());
        let executor = self.config.plan_executor.clone();
        ctx.send_turn(&token, &executor, Performative::Cancel, serde_json::Value::Null);
        ctx.extend(&token, ctx.settings().answer_deadline * 2);
        self.send_report(id, Report::new(Outcome::Progress, why), ctx);
    }

    /// Frees the agents that were in use by the plan of a goal which no longer runs; goals that waited
    /// for these agents may be planned for.
    pub(crate) fn release_agents(&mut self, id: &ConversationId) {
        if let Some(goal) = self.goals.get_mut(id) {
            goal.steps_left.clear();
        }
        for goal in self.goals.values_mut() {
            if matches!(goal.phase, GoalPhase::WaitingForAgents(_)) {
                goal.phase = GoalPhase::Queued;
            }
        }
    }

    /// Plans for the queued goal of the greatest priority.
    pub(crate) fn schedule_next(&mut self, ctx: &mut Context<Self>) {
        let first = self
            .goals
            .iter()
            .filter(|(_, goal)| matches!(goal.phase, GoalPhase::Queued))
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
        let is_executing = |goal: &Goal| matches!(goal.phase, GoalPhase::Executing(_));
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

    /// Estimates in the background what the plan of each running goal would cost if it were made now.
    fn compare(&mut self, snapshot: &Snapshot, joined: &str, ctx: &mut Context<Self>) {
        let Ok(known) = PlanningSnapshot::read(snapshot.clone()) else { return };
        let executing = self.goals.iter().filter(|(_, goal)| {
            matches!(goal.phase, GoalPhase::Executing(_)) && !goal.steps_left.is_empty()
        });
        let mut candidates = Vec::new();
        for (id, goal) in executing {
            let others = self.running_beside(id).flat_map(|(_, other)| other.acting()).collect();
            let Some(rest) = known.cost_of_rest(&goal.steps_left, &goal.condition) else {
                continue;
            };
            let known =
                known.clone().without_avoided(goal.avoided(ctx.now())).without_agents(&others);
            candidates.push((id.clone(), known.problem_of(&goal.condition), rest, goal.rounds));
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
                    if requester.goals.get(&id).is_some_and(|goal| goal.rounds == round) {
                        requester.preempt(&id, &why, ctx);
                    }
                }
            }));
    }
}
