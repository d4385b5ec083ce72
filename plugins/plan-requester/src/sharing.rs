//! Several goals at once: whose turn it is to be planned for, who needs which agents, which plan
//! may run beside others, and which goal gives way.
//!
//! - One goal is planned for at a time, the one of greatest priority first; plans run side by
//!   side.
//! - A plan is made first without the agents that act in others ([`Attempt::Beside`]), then with
//!   those of goals of lower priority, which give way ([`Attempt::Instead`]). What is left waits.
//! - A plan keeps what other goals of at least its priority keep. If there is none, one is made
//!   that does not, only to say which goals undo each other ([`Attempt::Regardless`]).
//! - When an agent joins with which a running plan would be much cheaper, the goal is planned for
//!   anew; a little cheaper is not worth what is under way.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{Keep, Outcome, Report, Snapshot};
use acl::{AgentId, ConversationId, Performative};
use agent::{Context, Resource, Work};
use pddl::{Condition, Plan};
use planner::{Budget, Cancel, Options};
use tokio::time::Instant;

use crate::PlanRequester;
use crate::goal::{Goal, Phase};
use crate::known::Known;

/// A running plan is given up for one that costs at most this part of what is left of it: what has
/// been begun is lost, and two plans that cost about the same must not take turns.
const WORTH_CHANGING: f64 = 0.8;

/// How long it is believed that a goal needs agents which others need: what is known changes.
const STILL_BLOCKED: Duration = Duration::from_secs(5);

/// Goals that are told by name where they use what another needs.
const BLOCKERS_TOLD: usize = 3;

/// What a round of planning has to respect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Attempt {
    /// Everything that runs, and everything that is kept.
    #[default]
    Beside,
    /// Only what is of at least its own priority; the rest gives way.
    Instead,
    /// Nothing; the plan is not carried out, it only explains.
    Regardless,
}

/// Looks why there is no plan, until it is dropped.
pub(crate) struct Explaining {
    cancel: Cancel,
    _work: Work,
}

impl Drop for Explaining {
    fn drop(&mut self) {
        self.cancel.set();
    }
}

/// What may be done with a plan that was found.
pub(crate) enum Verdict {
    /// Carry it out.
    Go,
    /// Carry it out when these have given way.
    After(Vec<ConversationId>),
    /// Wait for these.
    Behind(Vec<ConversationId>),
    /// Leave it: it undoes goals that are kept.
    Undoes(String),
}

impl PlanRequester {
    // === before planning ===

    /// Whether a goal may be planned for now; if another is, it waits for its turn.
    pub(crate) fn is_its_turn(&mut self, id: &ConversationId) -> bool {
        let is_busy = self.goals.values().any(|other| other.phase.is_planning());
        let Some(goal) = self.goals.get_mut(id) else { return false };
        if goal.phase.is_planning() || goal.phase.is_running() {
            return false;
        }
        if is_busy {
            goal.phase = Phase::Queued;
        }
        !is_busy
    }

    /// Whether a goal would be blocked again: others need all the agents that they needed when it
    /// was blocked last. Where many goals share few agents, nearly all of them would be.
    pub(crate) fn is_still_blocked(&mut self, id: &ConversationId, now: Instant) -> bool {
        let reserved = self.reserved(id);
        let Some(goal) = self.goals.get_mut(id) else { return false };
        let is_still = goal.blocked_under.as_ref().is_some_and(|(under, until)| {
            now < *until && !under.is_empty() && under.is_subset(&reserved)
        });
        if is_still {
            goal.phase = Phase::Blocked(goal.blocked_by.clone());
        }
        is_still
    }

    /// Where others need everyone who offers anything, a goal that is not above any of them waits
    /// for them: no planner need look for that.
    pub(crate) fn waits_for_everyone(
        &mut self,
        id: &ConversationId,
        known: &Known,
        ctx: &mut Context<Self>,
    ) -> bool {
        let Some(goal) = self.goals.get(id) else { return false };
        let (priority, is_beside) = (goal.priority, goal.attempt == Attempt::Beside);
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

    /// The agents that other goals need, as far as this attempt respects them.
    pub(crate) fn reserved(&self, id: &ConversationId) -> BTreeSet<AgentId> {
        let Some(goal) = self.goals.get(id) else { return BTreeSet::new() };
        let respects = |other: &Goal| match goal.attempt {
            Attempt::Beside => true,
            Attempt::Instead => other.priority >= goal.priority,
            Attempt::Regardless => false,
        };
        self.running_beside(id)
            .filter(|(_, other)| respects(other))
            .flat_map(|(_, other)| other.acting())
            .collect()
    }

    /// The goal, and what others keep that it may not undo.
    pub(crate) fn wanted(&self, id: &ConversationId, known: &Known) -> Option<Condition> {
        let goal = self.goals.get(id)?;
        let mut conditions = vec![goal.condition.clone()];
        if goal.attempt != Attempt::Regardless {
            conditions.extend(self.kept_beside(id, known).map(|(_, kept)| kept.condition.clone()));
        }
        Some(if conditions.len() == 1 {
            goal.condition.clone()
        } else {
            Condition::And(conditions)
        })
    }

    /// Other goals of at least this one's priority that are kept and hold.
    fn kept_beside<'a>(
        &'a self,
        id: &'a ConversationId,
        known: &'a Known,
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

    /// What may be done with a plan.
    pub(crate) fn verdict(&self, id: &ConversationId, known: &Known, plan: &Plan) -> Verdict {
        let Some(goal) = self.goals.get(id) else { return Verdict::Behind(Vec::new()) };
        if goal.attempt == Attempt::Regardless {
            let is_undone = |kept: &Goal| !known.can_run_beside(plan, [], [&kept.condition]);
            let undone = self.kept_beside(id, known).filter(|(_, kept)| is_undone(kept));
            let undone: Vec<_> = undone.map(|(_, kept)| format!("`{}`", kept.text)).collect();
            if !undone.is_empty() {
                return Verdict::Undoes(undone.join(" and "));
            }
        }
        let steps = self.running_beside(id).flat_map(|(_, other)| &other.steps_left);
        let conditions = self.running_beside(id).map(|(_, other)| &other.condition);
        if known.can_run_beside(plan, steps, conditions) {
            // Of all of them at once; who is in the way is looked for only where somebody is.
            return Verdict::Go;
        }
        let is_in_the_way = |(_, other): &(_, &Goal)| {
            !known.can_run_beside(plan, &other.steps_left, [&other.condition])
        };
        let in_the_way: Vec<_> = self.running_beside(id).filter(is_in_the_way).collect();
        let ids = in_the_way.iter().map(|(other, _)| (*other).clone()).collect();
        if in_the_way.is_empty() {
            Verdict::Go
        } else if in_the_way.iter().all(|(_, other)| other.priority < goal.priority) {
            Verdict::After(ids)
        } else {
            Verdict::Behind(ids)
        }
    }

    /// Does with a plan what its verdict says.
    pub(crate) fn follow(
        &mut self,
        id: &ConversationId,
        known: &Known,
        (plan, cost): (&Plan, f64),
        verdict: Verdict,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.attempt = Attempt::Beside;
        goal.unsolved_since = goal.unsolved_since.filter(|_| matches!(verdict, Verdict::Undoes(_)));
        match verdict {
            Verdict::Go => self.execute(id, known, plan, cost, ctx),
            Verdict::After(others) => {
                let text = format!("gives way to `{}`", goal.text);
                self.block(id, &others, ctx);
                for other in others {
                    self.yield_way(&other, &text, ctx);
                }
            }
            Verdict::Behind(others) => self.block(id, &others, ctx),
            Verdict::Undoes(kept) => {
                let why = format!("every plan for it would undo {kept}, which is kept");
                self.no_plan(id, why, ctx);
            }
        }
    }

    /// There is no plan in this attempt. Why, and whether others' agents would help, is looked for
    /// aside: it takes tens of milliseconds in a large building.
    pub(crate) fn unplanned(
        &mut self,
        id: &ConversationId,
        known: Known,
        why: impl FnOnce(&Known, &Cancel) -> String + Send + 'static,
        ctx: &mut Context<Self>,
    ) {
        let is_alone = self.goals.len() == 1;
        let Some(goal) = self.goals.get_mut(id) else { return };
        let (condition, cancel) = (goal.condition.clone(), Cancel::new());
        let (flag, unplanned) = (cancel.clone(), id.clone());
        let look = move || {
            let why = why(&known, &flag);
            // Who waits must have something to wait for: with everyone's agents it can be reached.
            let has_hope = !is_alone && !known.is_hopeless(&condition, &flag);
            (known, why, has_hope)
        };
        let work = ctx.compute(look, move |requester: &mut Self, (known, why, has_hope), ctx| {
            requester.explained(&unplanned, &known, (why, has_hope), ctx);
        });
        goal.phase = Phase::Explaining(Explaining { cancel, _work: work });
    }

    /// It is clear why there is no plan in this attempt: try the next, wait for others, or say so.
    fn explained(
        &mut self,
        id: &ConversationId,
        known: &Known,
        (why, has_hope): (String, bool),
        ctx: &mut Context<Self>,
    ) {
        let is_free_again = !known.spared.is_subset(&self.reserved(id));
        if let Some(goal) = self.goals.get_mut(id).filter(|_| is_free_again) {
            // It was looked for without agents that nobody needs any more.
            goal.phase = Phase::Queued;
            return self.next(ctx);
        }
        let Some(goal) = self.goals.get(id) else { return };
        let (attempt, priority) = (goal.attempt, goal.priority);
        let (lower, others): (Vec<_>, Vec<_>) =
            self.running_beside(id).partition(|(_, other)| other.priority < priority);
        let blocking: Vec<_> = others.iter().map(|(other, _)| (*other).clone()).collect();
        let next = match attempt {
            Attempt::Beside if has_hope && !lower.is_empty() => Some(Attempt::Instead),
            Attempt::Beside | Attempt::Instead if has_hope && !blocking.is_empty() => {
                return self.lacks(id, known, &blocking, ctx);
            }
            Attempt::Beside | Attempt::Instead
                if has_hope && self.kept_beside(id, known).next().is_some() =>
            {
                Some(Attempt::Regardless)
            }
            _ => None,
        };
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.attempt = next.unwrap_or_default();
        match next {
            Some(_) => {
                goal.phase = Phase::Queued;
                self.consider(id, ctx);
            }
            None => self.no_plan(id, why, ctx),
        }
    }

    // === giving way ===

    /// A goal waits for agents that the others need.
    fn lacks(
        &mut self,
        id: &ConversationId,
        known: &Known,
        others: &[ConversationId],
        ctx: &mut Context<Self>,
    ) {
        self.block(id, others, ctx);
        if let Some(goal) = self.goals.get_mut(id) {
            goal.blocked_under = Some((known.spared.clone(), ctx.now() + STILL_BLOCKED));
        }
    }

    /// A goal waits until one of the others no longer runs.
    fn block(&mut self, id: &ConversationId, others: &[ConversationId], ctx: &mut Context<Self>) {
        let texts: Vec<_> = others
            .iter()
            .filter_map(|other| self.goals.get(other))
            .map(|other| format!("`{}`", other.text))
            .collect();
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.attempt = Attempt::Beside;
        goal.blocked_under = None;
        let why = match texts.split_at(texts.len().min(BLOCKERS_TOLD)) {
            (told, []) => format!("needs what {} is using", told.join(" and ")),
            (told, more) => {
                format!("needs what {} and {} more are using", told.join(", "), more.len())
            }
        };
        let is_news = goal.blocked_by != why;
        goal.blocked_by.clone_from(&why);
        goal.phase = Phase::Blocked(why.clone());
        if is_news {
            self.tell(id, Report::new(Outcome::Progress, format!("waiting: it {why}")), ctx);
        }
        self.next(ctx);
    }

    /// Asks the Plan Executor to give up a plan; its goal is planned for again afterwards.
    fn yield_way(&mut self, id: &ConversationId, why: &str, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let Phase::Executing(token) = &goal.phase else { return };
        let token = token.clone();
        goal.phase = Phase::Yielding(token.clone());
        let executor = self.config.plan_executor.clone();
        ctx.go_on(&token, &executor, Performative::Cancel, serde_json::Value::Null);
        ctx.extend(&token, ctx.settings().answer_deadline * 2);
        self.tell(id, Report::new(Outcome::Progress, why), ctx);
    }

    /// A plan runs no more: who waited for its agents may be planned for.
    pub(crate) fn release(&mut self, id: &ConversationId) {
        if let Some(goal) = self.goals.get_mut(id) {
            goal.steps_left.clear();
        }
        for goal in self.goals.values_mut() {
            if matches!(goal.phase, Phase::Blocked(_)) {
                goal.phase = Phase::Queued;
            }
        }
    }

    /// Gives the turn to the goal of greatest priority that waits for it.
    pub(crate) fn next(&mut self, ctx: &mut Context<Self>) {
        let first = self
            .goals
            .iter()
            .filter(|(_, goal)| matches!(goal.phase, Phase::Queued))
            .max_by_key(|(id, goal)| (goal.priority, std::cmp::Reverse((*id).clone())))
            .map(|(id, _)| id.clone());
        if let Some(id) = first {
            ctx.after(Duration::ZERO, move |requester: &mut Self, ctx| {
                requester.consider(&id, ctx);
            });
        }
    }

    // === better plans ===

    /// Agents have joined: looks whether running plans would be much cheaper with them.
    pub(crate) fn look_for_better(&mut self, joined: &[AgentId], ctx: &mut Context<Self>) {
        let is_executing = |goal: &Goal| matches!(goal.phase, Phase::Executing(_));
        if joined.is_empty() || !self.goals.values().any(is_executing) {
            return;
        }
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let names: Vec<_> = joined.iter().map(|agent| format!("`{agent}`")).collect();
        let joined = names.join(", ");
        self.comparing = Some(ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            if let Some(snapshot) = snapshot {
                requester.compare(&snapshot, &joined, ctx);
            }
        }));
    }

    /// Estimates aside what each running goal would cost if it were planned for now.
    fn compare(&mut self, snapshot: &Snapshot, joined: &str, ctx: &mut Context<Self>) {
        let Ok(known) = Known::read(snapshot.clone()) else { return };
        let executing = self.goals.iter().filter(|(_, goal)| {
            matches!(goal.phase, Phase::Executing(_)) && !goal.steps_left.is_empty()
        });
        let mut candidates = Vec::new();
        for (id, goal) in executing {
            let others = self.running_beside(id).flat_map(|(_, other)| other.acting()).collect();
            let Some(rest) = known.cost_of_rest(&goal.steps_left, &goal.condition) else {
                continue;
            };
            let known = known.clone().avoiding(goal.avoided(ctx.now())).sparing(&others);
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
        self.comparing = Some(ctx.compute(estimate, move |requester: &mut Self, better, ctx| {
            for (id, _, _, round) in better {
                if requester.goals.get(&id).is_some_and(|goal| goal.rounds == round) {
                    requester.yield_way(&id, &why, ctx);
                }
            }
        }));
    }
}
