//! Hill climbing, which comes before the search because many problems are easy. Each round applies
//! the relaxed plan, or the part of it that decreases the estimate (Vidal, 2004). If this fails,
//! the round is a step of enforced hill climbing (Hoffmann and Nebel, 2001).
//!
//! Neither method is complete; both give up after little work.

use crate::heuristic::{Evaluator, FastForward};
use crate::limits::Cancel;
use crate::progression::Progression;
use crate::state::{State, StateId, StateSpace, all_hold};
use crate::task::{OperatorId, Task};

/// Maximum number of states that one breadth-first search for a better state expands. After them,
/// hill climbing gives up.
const PLATEAU_MAX: usize = 100;

/// Limit on the work of a climb before it looks for another better state: the number of evaluations
/// times the size of the relaxation. When it is exceeded, hill climbing gives up. The limit allows
/// some hundredths of a second. One breadth-first search may exceed it by as much again.
const WORK_MAX: usize = 20_000_000;

/// Number of evaluations that a search for a better state may make even if they exceed [`WORK_MAX`],
/// unless they exceed [`EXTENDED_WORK_MAX`].
const EVALUATIONS_MIN: u64 = 1_000;

/// Limit on the work of [`EVALUATIONS_MIN`] evaluations. In a task with a million operators, fewer of
/// them are made. The limit allows some tenths of a second.
const EXTENDED_WORK_MAX: usize = 400_000_000;

/// Hill climbing from the initial state of a task towards the goal.
pub(crate) struct HillClimbing<'t, 'h> {
    task: &'t Task,
    ff: &'h mut FastForward<'t>,
    progression: Progression<'t>,
    /// Number of evaluations after which a climb does not look for another better state.
    evaluations_max: u64,
    /// Number of evaluations after which a search for a better state gives up.
    evaluations_in_all_max: u64,
    /// Number of states evaluated so far.
    pub(crate) evaluations: u64,
    /// Number of states expanded so far.
    pub(crate) expansions: u64,
}

/// Operators to apply, the state after them, and the heuristic estimate of that state.
type ClimbingStep = (Vec<OperatorId>, Vec<u64>, u64);

/// Result of hill climbing.
pub(crate) enum ClimbingOutcome {
    /// Hill climbing has found a plan: these operators lead to the goal.
    Plan(Vec<OperatorId>),
    /// The goal is unreachable in the delete relaxation, which proves that no plan exists.
    DeadEnd,
    /// No plan was found within the limits, but a plan may exist.
    GaveUp,
}

// === impl HillClimbing ===

impl<'t, 'h> HillClimbing<'t, 'h> {
    pub(crate) fn new(task: &'t Task, ff: &'h mut FastForward<'t>) -> HillClimbing<'t, 'h> {
        let size = ff.size().max(1);
        let evaluations_max = (WORK_MAX / size) as u64;
        let allowed = EVALUATIONS_MIN.min((EXTENDED_WORK_MAX / size) as u64);
        HillClimbing {
            task,
            ff,
            evaluations_max,
            evaluations_in_all_max: evaluations_max.saturating_mul(2).max(allowed),
            progression: Progression::new(task),
            evaluations: 0,
            expansions: 0,
        }
    }

    pub(crate) fn run(&mut self, cancel: &Cancel) -> ClimbingOutcome {
        let mut state = self.progression.initial();
        if all_hold(&state, &self.task.goal) {
            return ClimbingOutcome::Plan(Vec::new());
        }
        let Some(mut estimate) = self.evaluate(&state) else { return ClimbingOutcome::DeadEnd };
        let mut plan = Vec::new();
        loop {
            let preferred = self.ff.preferred().to_vec();
            let found = self.apply_relaxed_plan(&state, estimate);
            let found =
                found.or_else(|| self.search_better_state(&state, preferred, estimate, cancel));
            let Some((steps, next, better)) = found else { return ClimbingOutcome::GaveUp };
            plan.extend(steps);
            (state, estimate) = (next, better);
            if all_hold(&state, &self.task.goal) {
                return ClimbingOutcome::Plan(plan);
            }
            if self.evaluations > self.evaluations_max {
                return ClimbingOutcome::GaveUp;
            }
        }
    }

    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.evaluations += 1;
        self.ff.evaluate(state)
    }

    /// Applies the operators of the last relaxed plan, as long as one of them is applicable.
    /// Returns `None` if the resulting state has no better estimate.
    fn apply_relaxed_plan(&mut self, from: &State, estimate: u64) -> Option<ClimbingStep> {
        let mut plan: Vec<OperatorId> = self.ff.relaxed_plan().to_vec();
        plan.sort_by_key(|operator| (self.ff.depth(*operator), *operator));
        // An operator may be repeated a thousand times.
        let runs = plan.chunk_by(|one, next| one == next).map(|run| (run[0], run.len()));
        let mut left: Vec<(OperatorId, usize)> = runs.collect();
        let (mut state, mut next) = (from.to_vec(), Vec::new());
        let mut steps = Vec::with_capacity(plan.len());
        while let Some(position) = left.iter().position(|(id, _)| {
            let operator = self.task.operator(*id);
            all_hold(&state, operator.preconditions)
                && self.progression.apply(operator, &state, &mut next)
        }) {
            let (operator, times) = &mut left[position];
            steps.push(*operator);
            *times -= 1;
            if *times == 0 {
                left.remove(position);
            }
            std::mem::swap(&mut state, &mut next);
            if all_hold(&state, &self.task.goal) {
                self.expansions += steps.len() as u64;
                return Some((steps, state, 0));
            }
        }
        // A single step is not evaluated here, because `search_better_state` tries it anyway.
        let better = if steps.len() > 1 { self.evaluate(&state)? } else { estimate };
        if better >= estimate {
            return None;
        }
        self.expansions += steps.len() as u64;
        Some((steps, state, better))
    }

    /// Searches breadth-first for a state with a better estimate, using preferred operators only.
    fn search_better_state(
        &mut self,
        from: &State,
        preferred: Vec<OperatorId>,
        estimate: u64,
        cancel: &Cancel,
    ) -> Option<ClimbingStep> {
        let mut space = StateSpace::new(from);
        let mut preferred = vec![preferred];
        let mut successor = Vec::new();
        let mut next = 0;
        while let Some(operators) = preferred.get(next).cloned() {
            let parent = StateId(next as u32);
            self.expansions += 1;
            next += 1;
            for id in operators {
                let is_over = self.evaluations > self.evaluations_in_all_max;
                if next > PLATEAU_MAX || is_over || cancel.is_set() {
                    return None;
                }
                let operator = self.task.operator(id);
                if !self.progression.apply(operator, space.state(parent), &mut successor) {
                    continue;
                }
                let (child, is_new) = space.insert(&successor, parent, id);
                if !is_new {
                    continue;
                }
                let reached = all_hold(&successor, &self.task.goal);
                let found = if reached { Some(0) } else { self.evaluate(&successor) };
                if found.is_some_and(|found| found < estimate) {
                    return Some((space.path(child), successor, found.unwrap_or(0)));
                }
                // A dead end has no operators, but is pushed so that the index stays equal to the
                // state's id.
                preferred.push(found.map_or_else(Vec::new, |_| self.ff.preferred().to_vec()));
            }
        }
        None
    }
}
