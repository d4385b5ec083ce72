//! Entry point of the planner: computes a validated plan for PDDL texts.
//!
//! The pipeline is: normalize → ground → [`crate::solve`] → validate. The independent validator
//! checks every plan. A plan that it rejects is reported as a defect of the planner.

use pddl::{Diagnostic, Domain, MetricDirection, Number, Plan, Problem};

use crate::ground::{Grounded, ground};
use crate::limits::{Budget, Cancel};
use crate::normalize::lifted::Lifted;
use crate::normalize::{Piecewise, is_wide, normalize, split_wide};
use crate::options::{Effort, Options};
use crate::outcome::{
    PlanError, PlanningOutcome, PlanningProgress, Statistics, StopReason, Unprovable, Unsupported,
};
use crate::search::SearchProgress;
use crate::solve::Solver;
use crate::validate::{Fault, FaultPlace, FaultReason, World, cost_from};

/// Searches for a plan for a problem.
///
/// The function is pure: it reads no clock, opens no file and writes nothing. Unless `cancel` is
/// set, the same texts and budget give the same outcome on every machine. A caller with a deadline
/// sets `cancel` at the deadline.
///
/// # Errors
///
/// Returns [`PlanError::BadInput`] if the texts contain mistakes, [`PlanError::Unsupported`] if
/// they use a feature that this planner does not support, and [`PlanError::Internal`] if the
/// validator rejects the plan. An unsolvable problem and a reached limit are outcomes, not errors.
pub fn plan(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
) -> Result<PlanningOutcome, PlanError> {
    plan_with_progress(domain, problem, options, cancel, &mut |_| ())
}

/// Plans as [`plan()`] does. Calls `tell` with the progress, and with every plan as soon as it is
/// found and validated.
///
/// # Errors
///
/// Returns the errors of [`plan()`].
pub fn plan_with_progress(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
    tell: &mut dyn FnMut(PlanningProgress<'_>),
) -> Result<PlanningOutcome, PlanError> {
    refuse_mistakes(domain, problem)?;
    let losses = pddl::rounding_losses();
    let is_rounded = || pddl::rounding_losses() > losses;
    let mut lifted = normalize(domain, problem)?;
    split_wide(&mut lifted);
    let mut statistics = Statistics::default();
    let ground =
        ground_whole_or_piecewise(&lifted, options.budget, cancel, &mut statistics.join_steps);
    let (grounded, piecewise) = match ground {
        Ok(ground) => ground,
        Err(reason) => {
            return Ok(without_plan(reason.if_rounded(is_rounded()), statistics, Vec::new()));
        }
    };
    let Some(task) = grounded.task else {
        let reason = StopReason::Unsolvable { before_search: true }.if_rounded(is_rounded());
        return Ok(without_plan(reason, statistics, grounded.warnings));
    };
    statistics.facts = task.fact_count;
    statistics.operators = task.operator_count();
    tell(PlanningProgress::Ground { facts: statistics.facts, operators: statistics.operators });
    let mut judge = PlanJudge::new(domain, problem, options.budget, cancel);
    let mut solver = Solver::new(&task, options, cancel, &mut statistics);
    let reason = solver.run(&mut |told| match told {
        SearchProgress::Searching(expansions) => tell(PlanningProgress::Searching { expansions }),
        SearchProgress::Found(operators) => {
            let mut plan = task.plan(operators);
            if let Some(piecewise) = &piecewise {
                plan = piecewise.whole(plan);
            }
            judge.submit(plan, &mut |plan| tell(PlanningProgress::Plan(plan)));
        }
    });
    statistics.proven_optimal &= !is_rounded();
    let reason = reason.if_rounded(is_rounded());
    judge.outcome(reason, options.effort, statistics, task.unprovable, grounded.warnings)
}

/// Grounds a task. If the task has wide actions (actions with many parameters) and grounding
/// reaches a limit, the task is grounded again in a form that applies these actions piecewise, one
/// parameter at a time. That form is returned with the ground task; `None` if the first grounding
/// is used.
fn ground_whole_or_piecewise(
    lifted: &Lifted,
    budget: Budget,
    cancel: &Cancel,
    join_steps: &mut u64,
) -> Result<(Grounded, Option<Piecewise>), StopReason> {
    if !is_wide(lifted) {
        return Ok((ground(lifted, budget, cancel, join_steps)?, None));
    }
    // The first attempt uses half the budget, because the piecewise form needs the rest.
    let half = Budget {
        join_steps_max: budget.join_steps_max / 2,
        memory_max_bytes: budget.memory_max_bytes / 2,
        ..budget
    };
    match ground(lifted, half, cancel, join_steps) {
        Err(reason) if reason.is_limit_of_grounding() => {
            let piecewise = Piecewise::new(lifted);
            let mut more = 0;
            let grounded = ground(&piecewise.lifted, budget, cancel, &mut more);
            *join_steps += more;
            Ok((grounded?, Some(piecewise)))
        }
        ended => Ok((ended?, None)),
    }
}

/// Whether [`plan()`] decomposes, or may decompose, actions or conditions of the texts because they
/// have too many variables.
pub(crate) fn is_decomposed(domain: &Domain, problem: &Problem) -> Result<bool, PlanError> {
    let mut lifted = normalize(domain, problem)?;
    let axioms = lifted.axioms.len();
    split_wide(&mut lifted);
    Ok(lifted.axioms.len() > axioms || is_wide(&lifted))
}

/// Validates plans against the PDDL texts, and keeps the best valid plan by the metric.
pub(crate) struct PlanJudge<'j> {
    domain: &'j Domain,
    problem: &'j Problem,
    /// Initial state of the problem; `None` before its first use.
    pub(crate) world: Option<World>,
    pub(crate) best: Option<Plan>,
    pub(crate) defect: Option<PlanError>,
    /// Maximum number of evaluation steps for one plan. A plan that needs more is not returned.
    work_max: u64,
    cancel: &'j Cancel,
    /// Reason why the validation of a plan was not completed; `None` if all were completed.
    stopped: Option<StopReason>,
}

// === impl PlanJudge ===

impl<'j> PlanJudge<'j> {
    pub(crate) fn new(
        domain: &'j Domain,
        problem: &'j Problem,
        budget: Budget,
        cancel: &'j Cancel,
    ) -> PlanJudge<'j> {
        let work_max = budget.join_steps_max;
        let (world, best, defect, stopped) = (None, None, None, None);
        PlanJudge { domain, problem, world, best, defect, work_max, cancel, stopped }
    }

    /// Validates a plan. If it is the best so far, stores it, calls `found` with it and returns
    /// `true`.
    pub(crate) fn submit(&mut self, plan: Plan, found: &mut dyn FnMut(&Plan)) -> bool {
        match self.validated(plan) {
            // If costs depend on the state, the search may report a plan that is actually more
            // expensive.
            Ok(plan) if self.best.as_ref().is_none_or(|best| self.is_better(&plan, best)) => {
                found(&plan);
                self.best = Some(plan);
                true
            }
            Ok(_) => false,
            Err(PlanError::Internal(fault)) if is_stop(&fault) => {
                self.stopped = Some(match self.cancel.is_set() {
                    true => StopReason::Cancelled,
                    false => StopReason::ValidationLimit { limit: self.work_max },
                });
                false
            }
            Err(error) => {
                self.defect.get_or_insert(error);
                false
            }
        }
    }

    /// Validates a plan, and returns it with the cost computed by the validator.
    fn validated(&mut self, plan: Plan) -> Result<Plan, PlanError> {
        let world = match self.world.take() {
            Some(world) => world,
            None => World::initial(self.domain, self.problem).map_err(PlanError::BadInput)?,
        };
        let world = self.world.insert(world.limit_work(self.work_max, Some(self.cancel)));
        match cost_from(world, &plan.steps, &self.problem.goal) {
            Ok(cost) => Ok(Plan { cost: Some(Number(cost)), ..plan }),
            Err(fault) if fault.place == FaultPlace::Metric => {
                let feature = "a metric that has no value after some plan";
                Err(Unsupported::in_problem(feature, fault.span).into())
            }
            Err(fault) => Err(PlanError::Internal(fault)),
        }
    }

    /// Whether `plan` is better than `best` by the metric of the problem.
    fn is_better(&self, plan: &Plan, best: &Plan) -> bool {
        let metric = self.problem.metric.as_ref();
        match metric.is_some_and(|metric| metric.direction == MetricDirection::Maximize) {
            true => cost(plan) > cost(best),
            false => cost(plan) < cost(best),
        }
    }

    /// Builds the outcome of a planning call after a search that ended with `reason`.
    pub(crate) fn outcome(
        self,
        reason: StopReason,
        effort: Effort,
        statistics: Statistics,
        unprovable: Option<Unprovable>,
        warnings: Vec<Diagnostic>,
    ) -> Result<PlanningOutcome, PlanError> {
        match (self.best, self.defect) {
            (_, Some(error)) => Err(error),
            (Some(plan), None) => {
                let stop_reason = StopReason::GoalReached;
                let is_missed = effort == Effort::Optimal && !statistics.proven_optimal;
                let unproven = is_missed.then_some(match reason {
                    StopReason::GoalReached => StopReason::Exhausted,
                    limit => limit,
                });
                // No single cost prevents a proof, and still there is none. The sum of the costs is
                // therefore too large.
                let is_in_vain = unproven == Some(StopReason::Exhausted);
                let unprovable = unprovable.or(is_in_vain.then_some(Unprovable::TooLarge));
                let plan = Some(plan);
                Ok(PlanningOutcome {
                    plan,
                    stop_reason,
                    unproven,
                    unprovable,
                    statistics,
                    warnings,
                })
            }
            (None, None) => Ok(without_plan(self.stopped.unwrap_or(reason), statistics, warnings)),
        }
    }
}

/// Whether a limit or the caller ended the validation; the plan may then be valid.
fn is_stop(fault: &Fault) -> bool {
    matches!(fault.reason, FaultReason::WorkLimit { .. })
}

/// Returns an error if one of the texts contains mistakes. If the domain has any, only those are
/// returned, so that all diagnostics of an answer refer to one text.
pub(crate) fn refuse_mistakes(domain: &Domain, problem: &Problem) -> Result<(), PlanError> {
    refuse(pddl::check_domain(domain))?;
    refuse_mistakes_of_problem(domain, problem)
}

/// Checks the texts as [`refuse_mistakes`] does, without the domain, which must have been checked
/// before.
pub(crate) fn refuse_mistakes_of_problem(
    domain: &Domain,
    problem: &Problem,
) -> Result<(), PlanError> {
    refuse(pddl::check_problem(domain, problem))
}

/// Checks the goal only. The domain and the problem must have been checked before with another
/// goal.
pub(crate) fn refuse_mistakes_of_goal(domain: &Domain, problem: &Problem) -> Result<(), PlanError> {
    refuse(pddl::check::check_condition(domain, problem, &problem.goal))
}

fn refuse(mut mistakes: Vec<Diagnostic>) -> Result<(), PlanError> {
    mistakes.retain(Diagnostic::is_error);
    if mistakes.is_empty() { Ok(()) } else { Err(PlanError::BadInput(mistakes)) }
}

fn without_plan(
    stop_reason: StopReason,
    statistics: Statistics,
    warnings: Vec<Diagnostic>,
) -> PlanningOutcome {
    debug_assert_ne!(stop_reason, StopReason::GoalReached, "a goal is reached by a plan");
    PlanningOutcome {
        plan: None,
        stop_reason,
        unproven: None,
        unprovable: None,
        statistics,
        warnings,
    }
}

/// Returns the cost of a validated plan.
fn cost(plan: &Plan) -> f64 {
    plan.cost.map_or(f64::INFINITY, |cost| cost.0)
}
