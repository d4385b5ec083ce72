//! Planning again: a planner that keeps what it has ground, and an old plan where it can.
//!
//! - What left is masked, what came is ground, and all else stays ([`crate::ground::Standing`]). Where
//!   that cannot be, the texts are ground afresh; the answer says which it was.
//! - The rest of the old plan is checked from the state as it is; then suffixes of it are among the
//!   steps that a search may take (`repair`), beside all others.
//! - What is answered is what [`crate::plan()`] would answer, but for which of several equally good
//!   plans: every plan passes the validator, on the texts as they are.

mod known;
mod repair;

use pddl::{Condition, Diagnostic, Domain, Plan, PlanStep, Problem};

use self::known::{Additions, Known};
use self::repair::Resumable;
use crate::ground::{Now, Outgrown, Present, Standing};
use crate::limits::{Cancel, Options};
use crate::normalize::{normalize_named, refuse_nonclassical};
use crate::outcome::{Outcome, PlanError, Statistics, StopReason};
use crate::plan::{
    Judge, is_taken_apart, refuse_mistakes, refuse_mistakes_of_goal, refuse_mistakes_of_problem,
};
use crate::search::Told;
use crate::solve::Solver;
use crate::task::Task;
use crate::validate::World;

/// A planner for texts that change little from one call to the next.
///
/// ```
/// let domain = pddl::parse_domain(
///     "(define (domain d) (:predicates (open ?door))
///        (:action push :parameters (?door) :effect (open ?door)))",
/// ).into_result().unwrap();
/// let problem = |objects: &str| pddl::parse_problem(&format!(
///     "(define (problem p) (:domain d) (:objects {objects}) (:goal (forall (?door) (open ?door))))",
/// )).into_result().unwrap();
/// let mut replanner = planner::Replanner::default();
/// let mut plan = |objects| {
///     let found = replanner.plan(
///         &domain, &problem(objects), &[], &Default::default(), &Default::default(),
///     ).unwrap();
///     (found.outcome.plan.unwrap().steps.len(), found.grounding)
/// };
/// assert_eq!(plan("front"), (1, planner::Grounding::Afresh));
/// assert_eq!(plan("front back"), (2, planner::Grounding::Extended));
/// assert_eq!(plan("back"), (1, planner::Grounding::Kept));
/// ```
#[derive(Debug, Default)]
pub struct Replanner {
    held: Option<Held>,
}

/// What is answered, and how it was come by.
#[derive(Clone, Debug)]
pub struct Replanned {
    /// As of [`crate::plan()`].
    pub outcome: Outcome,
    /// How much of the old plan is in the new one.
    pub course: Course,
    /// How much of the ground problem was there already.
    pub grounding: Grounding,
}

/// How much of the old plan is in the new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// The rest of the old plan is the plan.
    Kept,
    /// The plan ends with steps of the old one.
    Repaired {
        /// How many.
        kept: usize,
    },
    /// There is no old plan, no plan, or the last step is another.
    Planned,
}

/// How much of the ground problem was there already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grounding {
    /// Everything; some of it may be masked.
    Kept,
    /// Everything but what is new.
    Extended,
    /// Nothing, or nothing that could be used.
    Afresh,
    /// It was not asked for.
    Unneeded,
}

/// What is kept.
#[derive(Debug)]
struct Held {
    known: Known,
    standing: Standing,
    /// The goal that was looked at last, and found to make sense with what was there.
    checked: Option<(Condition, Present)>,
    /// What was there then, and the state it was in.
    last: Option<(Present, World)>,
}

/// How texts differ from what is held.
struct Difference {
    additions: Additions,
    present: Present,
    /// The state, if all its facts are known.
    now: Option<Now>,
}

/// A ground problem in a state.
struct Ready {
    now: Now,
    present: Present,
    grounding: Grounding,
}

/// One call.
struct Call<'c> {
    domain: &'c Domain,
    problem: &'c Problem,
    options: &'c Options,
    cancel: &'c Cancel,
    statistics: Statistics,
    judge: Judge<'c>,
}

// === impl Replanner ===

impl Replanner {
    /// Plans for the texts as they are now. `rest` is what is left of the plan so far, or nothing:
    /// whoever would rather have the best plan than the one that is under way leaves it out.
    ///
    /// As [`crate::plan()`], it reads no clock and writes nothing; the same calls in the same order
    /// give the same answers.
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
        let mut call = Call::new(domain, problem, options, cancel);
        if let (Some(held), Some(difference)) = (&mut self.held, &difference) {
            call.judge.world = held.world(difference, problem);
        }
        if let Some(kept) = call.rest(rest) {
            if let (Some(held), Some(difference)) = (&mut self.held, difference) {
                held.last = call.judge.world.map(|world| (difference.present, world));
            }
            return Ok(kept);
        }
        loop {
            let (mut held, ready) = match self.ready(&mut call, difference.take()) {
                Ok(ready) => ready,
                // What is held grows with the texts and is not taken apart; what is asked once is.
                Err(GroundFailure::Stopped(reason))
                    if reason.is_limit_of_grounding() && is_taken_apart(domain, problem)? =>
                {
                    return call.once();
                }
                Err(GroundFailure::Stopped(reason)) => {
                    return Ok(call.nothing(reason, Grounding::Afresh, Vec::new()));
                }
                Err(GroundFailure::Refused(error)) => return Err(error),
            };
            let Ready { now, present, grounding } = ready;
            let warnings = held.standing.warnings().to_vec();
            let goal = &problem.goal;
            let task = held.standing.task(&now, &present, goal, options.budget, cancel);
            match task {
                // The goal is over numbers that nobody has followed, say; afresh, they are.
                Ok(Err(Outgrown)) if grounding != Grounding::Afresh => (),
                Ok(Err(Outgrown)) => return call.once(),
                Ok(Ok(task)) => {
                    let Some(task) = task else {
                        self.held = Some(held);
                        let reason = StopReason::Unsolvable { before_search: true };
                        return Ok(call.nothing(reason, grounding, warnings));
                    };
                    let (replanned, world) = call.solve(&task, rest, grounding, warnings);
                    held.last = world.map(|world| (present, world));
                    self.held = Some(held);
                    return replanned;
                }
                Err(reason) => return Ok(call.nothing(reason, grounding, warnings)),
            }
        }
    }

    /// Which of the conditions are facts that cannot hold at any time: their positions.
    ///
    /// Weaker than [`crate::goal::unreachable`], and much cheaper: one pass looks at all of them, so
    /// it can be asked about the whole of a large goal. Conditions that are no single facts are never
    /// listed. The problem's own goal does not matter.
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
        let mut call = Call::new(domain, problem, options, cancel);
        let (mut held, ready) = match self.ready(&mut call, difference) {
            Ok(ready) => ready,
            // Without an end there is no proof.
            Err(GroundFailure::Stopped(_)) => return Ok(Vec::new()),
            Err(GroundFailure::Refused(error)) => return Err(error),
        };
        let (positions, facts): (Vec<_>, Vec<_>) = { conditions.iter().enumerate() }
            .filter_map(|(position, one)| Some((position, held.standing.fact(one)?)))
            .unzip();
        let reached = held.standing.reaches(&ready.now, &ready.present, &facts);
        self.held = Some(held);
        let missing = positions.into_iter().zip(reached).filter(|(_, is_reached)| !is_reached);
        Ok(missing.map(|(position, _)| position).collect())
    }

    /// Refuses texts that make no sense, of which only what is new is looked at; and how they differ
    /// from what is held, if that can be followed.
    fn difference(
        &mut self,
        domain: &Domain,
        problem: &Problem,
    ) -> Result<Option<Difference>, PlanError> {
        let Some(held) = &mut self.held else {
            return refuse_mistakes(domain, problem).map(|()| None);
        };
        let Some(difference) = held.difference(domain, problem) else {
            return refuse_mistakes(domain, problem).map(|()| None);
        };
        let Difference { additions, present, now } = &difference;
        let checked = held.checked.as_ref();
        let has_domain = checked.is_some_and(|(_, then)| {
            then.schemas == present.schemas && then.predicates == present.predicates
        });
        let has_state = checked.is_some_and(|(_, then)| then == present)
            && now.as_ref().is_some_and(|now| held.standing.knows_values(now));
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

    /// What is held, once it has followed a difference, or anew.
    fn ready(
        &mut self,
        call: &mut Call<'_>,
        difference: Option<Difference>,
    ) -> Result<(Held, Ready), GroundFailure> {
        if let (Some(difference), Some(mut held)) = (difference, self.held.take())
            && let Some(ready) = held.follow(difference, call)?
        {
            return Ok((held, ready));
        }
        let Call { domain, problem, options, cancel, .. } = *call;
        let known = Known::of(domain, problem);
        let (union, state) = known.texts(problem);
        let (lifted, symbols) = normalize_named(union, &state)?;
        let steps = &mut call.statistics.join_steps;
        let mut standing = Standing::new(lifted, symbols, options.budget, cancel, steps)?;
        let present = known.everything();
        let now = standing.now(problem).unwrap_or_default();
        let checked = Some((problem.goal.clone(), present.clone()));
        let held = Held { known, standing, checked, last: None };
        Ok((held, Ready { now, present, grounding: Grounding::Afresh }))
    }
}

// === impl Held ===

impl Held {
    /// How texts differ from what is known, if that can be followed.
    fn difference(&mut self, domain: &Domain, problem: &Problem) -> Option<Difference> {
        let (additions, present) = self.known.compare(domain, problem, &self.standing).ok()?;
        let now = if additions.is_empty() { self.standing.now(problem) } else { None };
        Some(Difference { additions, present, now })
    }

    /// The state of a problem, by the texts of the last one, if they say the same else.
    fn world(&mut self, difference: &Difference, problem: &Problem) -> Option<World> {
        let (last, world) = self.last.take()?;
        let is_same = difference.additions.is_empty() && difference.present == last;
        if is_same { world.again(problem) } else { None }
    }

    /// Follows the texts to what they say now; `None` if that takes a new beginning.
    fn follow(
        &mut self,
        difference: Difference,
        call: &mut Call<'_>,
    ) -> Result<Option<Ready>, GroundFailure> {
        let mut grounding = Grounding::Kept;
        let Difference { additions, mut present, mut now } = difference;
        if now.is_none() {
            grounding = Grounding::Extended;
            self.known.learn(additions, &mut present);
            if !self.extend(call)? {
                return Ok(None);
            }
            now = self.standing.now(call.problem);
        }
        let fits = |now: &Now| {
            (self.standing.can_mask_objects() || !present.objects.contains(&false))
                && self.standing.agrees(now, &present)
        };
        Ok(now.filter(fits).map(|now| Ready { now, present, grounding }))
    }

    /// Grounds what is new; whether that could be.
    fn extend(&mut self, call: &mut Call<'_>) -> Result<bool, GroundFailure> {
        let (union, state) = self.known.texts(call.problem);
        let Ok((lifted, symbols)) = normalize_named(union, &state) else { return Ok(false) };
        let (budget, steps) = (call.options.budget, &mut call.statistics.join_steps);
        Ok(self.standing.extend(lifted, symbols, budget, call.cancel, steps)?.is_ok())
    }
}

// === impl Call ===

impl<'c> Call<'c> {
    fn new(
        domain: &'c Domain,
        problem: &'c Problem,
        options: &'c Options,
        cancel: &'c Cancel,
    ) -> Call<'c> {
        let (statistics, judge) = (Statistics::default(), Judge::new(domain, problem));
        Call { domain, problem, options, cancel, statistics, judge }
    }

    /// As if it were asked once and never again.
    fn once(&self) -> Result<Replanned, PlanError> {
        let outcome = crate::plan(self.domain, self.problem, self.options, self.cancel)?;
        Ok(Replanned { outcome, course: Course::Planned, grounding: Grounding::Afresh })
    }

    /// The rest of the old plan, if there is one and it still leads to the goal.
    fn rest(&mut self, rest: &[PlanStep]) -> Option<Replanned> {
        if rest.is_empty() {
            return None;
        }
        self.judge.hear(Plan { steps: rest.to_vec(), cost: None }, &mut |_| ());
        // That it does not is nobody's fault.
        self.judge.defect = None;
        let plan = Some(self.judge.best.take()?);
        let (stop_reason, statistics) = (StopReason::GoalReached, self.statistics);
        Some(Replanned {
            outcome: Outcome {
                plan,
                stop_reason,
                unproven: None,
                unprovable: None,
                statistics,
                warnings: Vec::new(),
            },
            course: Course::Kept,
            grounding: Grounding::Unneeded,
        })
    }

    /// What is found, and the state that it was held against.
    fn solve(
        mut self,
        task: &Task,
        rest: &[PlanStep],
        grounding: Grounding,
        warnings: Vec<Diagnostic>,
    ) -> (Result<Replanned, PlanError>, Option<World>) {
        self.statistics.facts = task.fact_count;
        self.statistics.operators = task.operator_count();
        let judge = &mut self.judge;
        let mut resumes = false;
        let resumable = Resumable::new(task, rest);
        let searched = resumable.as_ref().map_or(task, |resumable| &resumable.task);
        let mut solver = Solver::new(searched, self.options, self.cancel, &mut self.statistics);
        let reason = solver.run(&mut |told| {
            let Told::Found(operators) = told else { return };
            let (plan, is_resumed) = match &resumable {
                Some(resumable) => resumable.plan(operators),
                None => (task.plan(operators), false),
            };
            if judge.hear(plan, &mut |_| ()) {
                resumes = is_resumed;
            }
        });
        // It may be the cheapest, but nobody has looked for a shorter one.
        self.statistics.proven_optimal &= !resumes;
        let world = self.judge.world.take();
        let effort = self.options.effort;
        let outcome =
            self.judge.outcome(reason, effort, self.statistics, task.unprovable, warnings);
        let replanned = outcome.map(|outcome| {
            let steps = outcome.plan.as_ref().map_or(&[][..], |plan| &plan.steps);
            let pairs = steps.iter().rev().zip(rest.iter().rev());
            let course = match pairs.take_while(|(new, old)| new == old).count() {
                0 => Course::Planned,
                kept => Course::Repaired { kept },
            };
            Replanned { outcome, course, grounding }
        });
        (replanned, world)
    }

    fn nothing(
        self,
        stop_reason: StopReason,
        grounding: Grounding,
        warnings: Vec<Diagnostic>,
    ) -> Replanned {
        let statistics = self.statistics;
        let (unproven, unprovable) = (None, None);
        let outcome =
            Outcome { plan: None, stop_reason, unproven, unprovable, statistics, warnings };
        Replanned { outcome, course: Course::Planned, grounding }
    }
}

/// Why there is no ground problem.
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
