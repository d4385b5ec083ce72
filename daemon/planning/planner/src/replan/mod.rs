//! Replanning: a planner that keeps its ground problem between calls, and reuses an old plan where
//! possible.
//!
//! - Removed objects and actions are masked, additions are grounded, and the rest is kept
//!   ([`crate::ground::IncrementalGrounding`]). If this is not possible, the texts are grounded
//!   again. [`GroundingReuse`] in the result shows which of these happened.
//! - The rest of the old plan is checked from the present state. If it fails, the search may use
//!   its suffixes as macro operators (`repair`), in addition to all other operators.
//! - The result is the same as that of [`crate::plan()`], except that another of several equally
//!   good plans may be returned. Every plan is validated against the present texts.

mod known_texts;
mod repair;

use pddl::{Condition, Diagnostic, Domain, Plan, PlanStep, Problem};

use self::known_texts::{KnownTexts, TextAdditions};
use self::repair::ResumableTask;
use crate::ground::{IncrementalGrounding, InitialState, NeedsRegrounding, PresenceMask};
use crate::limits::Cancel;
use crate::normalize::{normalize_named, refuse_nonclassical};
use crate::options::Options;
use crate::outcome::{PlanError, PlanningOutcome, Statistics, StopReason};
use crate::plan::{
    PlanJudge, is_decomposed, refuse_mistakes, refuse_mistakes_of_goal, refuse_mistakes_of_problem,
};
use crate::search::SearchProgress;
use crate::solve::Solver;
use crate::task::Task;
use crate::validate::World;

/// A planner for texts that differ little from one call to the next.
///
/// ```
/// let domain = pddl::parse_domain(
///     "(define (domain d) (:predicates (open ?door))
///        (:action push :parameters (?door) :effect (open ?door)))",
/// ).into_result().unwrap();
/// let problem = |objects: &str| pddl::parse_problem(&format!(
///     "(define (problem p) (:domain d) (:objects {objects})
///        (:goal (forall (?door) (open ?door))))",
/// )).into_result().unwrap();
/// let mut replanner = planner::Replanner::default();
/// let mut plan = |objects| {
///     let found = replanner.plan(
///         &domain, &problem(objects), &[], &Default::default(), &Default::default(),
///     ).unwrap();
///     (found.outcome.plan.unwrap().steps.len(), found.grounding_reuse)
/// };
/// assert_eq!(plan("front"), (1, planner::GroundingReuse::Full));
/// assert_eq!(plan("front back"), (2, planner::GroundingReuse::Extended));
/// assert_eq!(plan("back"), (1, planner::GroundingReuse::Kept));
/// ```
#[derive(Debug, Default)]
pub struct Replanner {
    retained: Option<RetainedState>,
}

/// Result of one call of the replanner, with the reused parts.
#[derive(Clone, Debug)]
pub struct Replanned {
    /// Outcome of planning, as in [`crate::plan()`].
    pub outcome: PlanningOutcome,
    /// Use of the old plan in the new plan.
    pub plan_reuse: PlanReuse,
    /// How much of the ground problem of the last call was reused.
    pub grounding_reuse: GroundingReuse,
}

/// Use of the old plan in the new plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanReuse {
    /// The new plan is the rest of the old plan.
    Kept,
    /// The new plan ends with steps of the old plan.
    Repaired {
        /// Number of steps of the old plan at the end of the new plan.
        kept: usize,
    },
    /// No step of the old plan is reused: one of the plans does not exist, or they differ in the
    /// last step.
    Planned,
}

/// Use of the ground problem from earlier calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundingReuse {
    /// The whole ground problem was reused; some of its parts may be masked.
    Kept,
    /// The whole ground problem was reused, and additions were grounded.
    Extended,
    /// All texts were grounded, because there was no ground problem or it was not usable.
    Full,
    /// No ground problem was needed for the result.
    Unneeded,
}

/// State that the replanner keeps between calls.
#[derive(Debug)]
struct RetainedState {
    known: KnownTexts,
    incremental: IncrementalGrounding,
    /// Last goal without mistakes, with the mask of its check; `None` if there is none.
    checked: Option<(Condition, PresenceMask)>,
    /// Mask and initial state of the last call; `None` if there is none.
    last: Option<(PresenceMask, World)>,
}

/// Difference between the present texts and the state kept by the replanner.
struct TextDifference {
    additions: TextAdditions,
    present: PresenceMask,
    /// Initial state of the problem; `None` if there are additions, or if the kept ground problem
    /// lacks a fact of this state.
    now: Option<InitialState>,
}

/// A ground problem for planning from one initial state.
struct PreparedGrounding {
    now: InitialState,
    present: PresenceMask,
    grounding: GroundingReuse,
}

/// State of one call of the replanner.
struct ReplanningCall<'c> {
    domain: &'c Domain,
    problem: &'c Problem,
    options: &'c Options,
    cancel: &'c Cancel,
    statistics: Statistics,
    judge: PlanJudge<'c>,
}

// === impl Replanner ===

impl Replanner {
    /// Plans for the present texts. `rest` is the rest of the plan that is being executed, and is
    /// returned if it still reaches the goal. With an empty `rest`, the best plan is searched for.
    ///
    /// As in [`crate::plan()`], planning reads no clock and writes nothing. The same sequence of
    /// calls gives the same results.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`crate::plan()`].
    pub fn plan(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        rest: &[PlanStep],
        options: &Options,
        cancel: &Cancel,
    ) -> Result<Replanned, PlanError> {
        refuse_nonclassical(domain, problem)?;
        let mut difference = self.difference(domain, problem)?;
        let mut call = ReplanningCall::new(domain, problem, options, cancel);
        if let (Some(held), Some(difference)) = (&mut self.retained, &difference) {
            call.judge.world = held.world(difference, problem);
        }
        if let Some(kept) = call.rest(rest) {
            if let (Some(held), Some(difference)) = (&mut self.retained, difference) {
                held.last = call.judge.world.map(|world| (difference.present, world));
            }
            return Ok(kept);
        }
        loop {
            let (mut held, ready) = match self.ready(&mut call, difference.take()) {
                Ok(ready) => ready,
                // The kept ground problem corresponds to the texts without splitting. A problem
                // that is grounded only once can be split.
                Err(GroundFailure::Stopped(reason))
                    if reason.is_limit_of_grounding() && is_decomposed(domain, problem)? =>
                {
                    return call.once();
                }
                Err(GroundFailure::Stopped(reason)) => {
                    return Ok(call.nothing(reason, GroundingReuse::Full, Vec::new()));
                }
                Err(GroundFailure::Refused(error)) => return Err(error),
            };
            let PreparedGrounding { now, present, grounding } = ready;
            let warnings = held.incremental.warnings().to_vec();
            let goal = &problem.goal;
            let task = held.incremental.task(&now, &present, goal, options.budget, cancel);
            match task {
                // For example, the goal uses numbers that are not part of the state. They are after
                // regrounding.
                Ok(Err(NeedsRegrounding)) if grounding != GroundingReuse::Full => (),
                Ok(Err(NeedsRegrounding)) => return call.once(),
                Ok(Ok(task)) => {
                    let Some(task) = task else {
                        self.retained = Some(held);
                        let reason = StopReason::Unsolvable { before_search: true };
                        return Ok(call.nothing(reason, grounding, warnings));
                    };
                    let (replanned, world) = call.solve(&task, rest, grounding, warnings);
                    held.last = world.map(|world| (present, world));
                    self.retained = Some(held);
                    return replanned;
                }
                Err(reason) => return Ok(call.nothing(reason, grounding, warnings)),
            }
        }
    }

    /// Returns the positions of the conditions that are unreachable facts.
    ///
    /// This function finds fewer unreachable conditions than [`crate::goal::unreachable`], but is
    /// much cheaper: one pass covers all facts, so it can be used for a large goal. Conditions that
    /// are not single facts are never returned. The goal of the problem is ignored.
    ///
    /// # Errors
    ///
    /// Returns [`PlanError::Unsupported`] if the texts use a feature that this planner does not
    /// support, and [`PlanError::BadInput`] if they contain mistakes.
    pub fn facts_out_of_reach(
        &mut self,
        domain: &Domain,
        problem: &Problem,
        conditions: &[&Condition],
        options: &Options,
        cancel: &Cancel,
    ) -> Result<Vec<usize>, PlanError> {
        let together = Condition::And(conditions.iter().copied().cloned().collect());
        let problem = &Problem { goal: together, ..problem.clone() };
        refuse_nonclassical(domain, problem)?;
        let difference = self.difference(domain, problem)?;
        let mut call = ReplanningCall::new(domain, problem, options, cancel);
        let (mut held, ready) = match self.ready(&mut call, difference) {
            Ok(ready) => ready,
            // A limit ended grounding, so there is no proof.
            Err(GroundFailure::Stopped(_)) => return Ok(Vec::new()),
            Err(GroundFailure::Refused(error)) => return Err(error),
        };
        let (positions, facts): (Vec<_>, Vec<_>) = { conditions.iter().enumerate() }
            .filter_map(|(position, one)| Some((position, held.incremental.fact(one)?)))
            .unzip();
        let reached = held.incremental.reaches(&ready.now, &ready.present, &facts);
        self.retained = Some(held);
        let missing = positions.into_iter().zip(reached).filter(|(_, is_reached)| !is_reached);
        Ok(missing.map(|(position, _)| position).collect())
    }

    /// Checks the new parts of the texts for mistakes. Returns the difference from the kept state;
    /// `None` if there is no kept state or it cannot be updated by the difference.
    fn difference(
        &mut self,
        domain: &Domain,
        problem: &Problem,
    ) -> Result<Option<TextDifference>, PlanError> {
        let Some(held) = &mut self.retained else {
            return refuse_mistakes(domain, problem).map(|()| None);
        };
        let Some(difference) = held.difference(domain, problem) else {
            return refuse_mistakes(domain, problem).map(|()| None);
        };
        let TextDifference { additions, present, now } = &difference;
        let checked = held.checked.as_ref();
        let has_domain = checked.is_some_and(|(_, then)| {
            then.schemas == present.schemas && then.predicates == present.predicates
        });
        let has_state = checked.is_some_and(|(_, then)| then == present)
            && now.as_ref().is_some_and(|now| held.incremental.has_known_values(now));
        let has_goal = checked.is_some_and(|(goal, _)| *goal == problem.goal);
        let has_problem = has_state && has_goal;
        if !has_domain || !additions.are_objects_only() {
            refuse_mistakes(domain, problem)?;
        } else if !has_state {
            refuse_mistakes_of_problem(domain, problem)?;
        } else if !has_goal {
            refuse_mistakes_of_goal(domain, problem)?;
        }
        if !has_problem {
            let is_all = additions.is_empty();
            held.checked = is_all.then(|| (problem.goal.clone(), present.clone()));
        }
        Ok(Some(difference))
    }

    /// Prepares the ground problem: updates the kept state by a difference, or grounds the texts
    /// again.
    fn ready(
        &mut self,
        call: &mut ReplanningCall<'_>,
        difference: Option<TextDifference>,
    ) -> Result<(RetainedState, PreparedGrounding), GroundFailure> {
        if let (Some(difference), Some(mut held)) = (difference, self.retained.take())
            && let Some(ready) = held.follow(difference, call)?
        {
            return Ok((held, ready));
        }
        let ReplanningCall { domain, problem, options, cancel, .. } = *call;
        let known = KnownTexts::of(domain, problem);
        let (union, state) = known.texts(problem);
        let (lifted, symbols) = normalize_named(union, &state)?;
        let steps = &mut call.statistics.join_steps;
        let mut standing =
            IncrementalGrounding::new(lifted, symbols, options.budget, cancel, steps)?;
        let present = known.everything();
        let now = standing.convert_initial_state(problem).unwrap_or_default();
        let checked = Some((problem.goal.clone(), present.clone()));
        let held = RetainedState { known, incremental: standing, checked, last: None };
        Ok((held, PreparedGrounding { now, present, grounding: GroundingReuse::Full }))
    }
}

// === impl RetainedState ===

impl RetainedState {
    /// Returns the difference between the texts and the known texts; `None` if additions and masks
    /// cannot express it.
    fn difference(&mut self, domain: &Domain, problem: &Problem) -> Option<TextDifference> {
        let (additions, present) = self.known.compare(domain, problem, &self.incremental).ok()?;
        let now = if additions.is_empty() {
            self.incremental.convert_initial_state(problem)
        } else {
            None
        };
        Some(TextDifference { additions, present, now })
    }

    /// Returns the initial state of a problem, with the model of the last call. Returns `None` if
    /// other parts of the texts than the problem's state have changed.
    fn world(&mut self, difference: &TextDifference, problem: &Problem) -> Option<World> {
        let (last, world) = self.last.take()?;
        let is_same = difference.additions.is_empty() && difference.present == last;
        if is_same { world.with_problem(problem) } else { None }
    }

    /// Updates the kept state by a difference. Returns `None` if the texts must be grounded again.
    fn follow(
        &mut self,
        difference: TextDifference,
        call: &mut ReplanningCall<'_>,
    ) -> Result<Option<PreparedGrounding>, GroundFailure> {
        let mut grounding = GroundingReuse::Kept;
        let TextDifference { additions, mut present, mut now } = difference;
        if now.is_none() {
            grounding = GroundingReuse::Extended;
            self.known.add_texts(additions, &mut present);
            if !self.extend(call)? {
                return Ok(None);
            }
            now = self.incremental.convert_initial_state(call.problem);
        }
        let fits = |now: &InitialState| {
            (self.incremental.can_mask_objects() || !present.objects.contains(&false))
                && self.incremental.keeps_operators_valid(now, &present)
        };
        Ok(now.filter(fits).map(|now| PreparedGrounding { now, present, grounding }))
    }

    /// Grounds the additions to the texts. Returns `false` if this is not possible.
    fn extend(&mut self, call: &mut ReplanningCall<'_>) -> Result<bool, GroundFailure> {
        let (union, state) = self.known.texts(call.problem);
        let Ok((lifted, symbols)) = normalize_named(union, &state) else { return Ok(false) };
        let (budget, steps) = (call.options.budget, &mut call.statistics.join_steps);
        Ok(self.incremental.extend(lifted, symbols, budget, call.cancel, steps)?.is_ok())
    }
}

// === impl ReplanningCall ===

impl<'c> ReplanningCall<'c> {
    fn new(
        domain: &'c Domain,
        problem: &'c Problem,
        options: &'c Options,
        cancel: &'c Cancel,
    ) -> ReplanningCall<'c> {
        let judge = PlanJudge::new(domain, problem, options.budget, cancel);
        let statistics = Statistics::default();
        ReplanningCall { domain, problem, options, cancel, statistics, judge }
    }

    /// Plans without the kept state, as [`crate::plan()`] does.
    fn once(&self) -> Result<Replanned, PlanError> {
        let outcome = crate::plan(self.domain, self.problem, self.options, self.cancel)?;
        Ok(Replanned {
            outcome,
            plan_reuse: PlanReuse::Planned,
            grounding_reuse: GroundingReuse::Full,
        })
    }

    /// Returns the rest of the old plan as the result, if it is not empty and still reaches the
    /// goal; otherwise `None`.
    fn rest(&mut self, rest: &[PlanStep]) -> Option<Replanned> {
        if rest.is_empty() {
            return None;
        }
        self.judge.submit(Plan { steps: rest.to_vec(), cost: None }, &mut |_| ());
        // An old plan that is no longer valid is not a defect of the planner.
        self.judge.defect = None;
        let plan = Some(self.judge.best.take()?);
        let (stop_reason, statistics) = (StopReason::GoalReached, self.statistics);
        Some(Replanned {
            outcome: PlanningOutcome {
                plan,
                stop_reason,
                unproven: None,
                unprovable: None,
                statistics,
                warnings: Vec::new(),
            },
            plan_reuse: PlanReuse::Kept,
            grounding_reuse: GroundingReuse::Unneeded,
        })
    }

    /// Searches for a plan. Returns the result, and the initial state from which plans were
    /// validated, if one was computed.
    fn solve(
        mut self,
        task: &Task,
        rest: &[PlanStep],
        grounding: GroundingReuse,
        warnings: Vec<Diagnostic>,
    ) -> (Result<Replanned, PlanError>, Option<World>) {
        self.statistics.facts = task.fact_count;
        self.statistics.operators = task.operator_count();
        let losses = pddl::rounding_losses();
        let judge = &mut self.judge;
        let mut resumes = false;
        let resumable = ResumableTask::new(task, rest);
        let searched = resumable.as_ref().map_or(task, |resumable| &resumable.task);
        let mut solver = Solver::new(searched, self.options, self.cancel, &mut self.statistics);
        let reason = solver.run(&mut |told| {
            let SearchProgress::Found(operators) = told else { return };
            let (plan, is_resumed) = match &resumable {
                Some(resumable) => resumable.plan(operators),
                None => (task.plan(operators), false),
            };
            if judge.submit(plan, &mut |_| ()) {
                resumes = is_resumed;
            }
        });
        // The plan may have the least cost, but no plan of equal cost with fewer steps was searched
        // for.
        let is_rounded = pddl::rounding_losses() > losses;
        self.statistics.proven_optimal &= !resumes && !is_rounded;
        let reason = reason.if_rounded(is_rounded);
        let world = self.judge.world.take();
        let effort = self.options.effort;
        let outcome =
            self.judge.outcome(reason, effort, self.statistics, task.unprovable, warnings);
        let replanned = outcome.map(|outcome| {
            let steps = outcome.plan.as_ref().map_or(&[][..], |plan| &plan.steps);
            let pairs = steps.iter().rev().zip(rest.iter().rev());
            let course = match pairs.take_while(|(new, old)| new == old).count() {
                0 => PlanReuse::Planned,
                kept => PlanReuse::Repaired { kept },
            };
            Replanned { outcome, plan_reuse: course, grounding_reuse: grounding }
        });
        (replanned, world)
    }

    fn nothing(
        self,
        stop_reason: StopReason,
        grounding: GroundingReuse,
        warnings: Vec<Diagnostic>,
    ) -> Replanned {
        let statistics = self.statistics;
        let (unproven, unprovable) = (None, None);
        let outcome =
            PlanningOutcome { plan: None, stop_reason, unproven, unprovable, statistics, warnings };
        Replanned { outcome, plan_reuse: PlanReuse::Planned, grounding_reuse: grounding }
    }
}

/// Reason why a call has no ground problem.
enum GroundFailure {
    Stopped(StopReason),
    Refused(PlanError),
}

impl From<StopReason> for GroundFailure {
    fn from(reason: StopReason) -> GroundFailure {
        GroundFailure::Stopped(reason)
    }
}

impl From<PlanError> for GroundFailure {
    fn from(error: PlanError) -> GroundFailure {
        GroundFailure::Refused(error)
    }
}
