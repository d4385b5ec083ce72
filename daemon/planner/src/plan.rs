//! The planner's front door: from texts to a validated plan.
//!
//! normalize → ground → [`crate::solve`] → validation. Every plan passes the independent validator;
//! one that fails is reported as our defect.

use pddl::{Diagnostic, Domain, Number, Plan, Problem};

use crate::ground::{GroundError, ground};
use crate::limits::{Cancel, Options};
use crate::normalize::normalize;
use crate::outcome::{Outcome, PlanError, Statistics, StopReason};
use crate::solve::Solver;
use crate::validate::{Verdict, validate};

/// Plans for a problem.
///
/// Pure: reads no clock, opens nothing, writes nothing. Left alone, the same texts and budget give
/// the same outcome on every machine; a caller with a deadline sets `cancel`.
pub fn plan(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
) -> Result<Outcome, PlanError> {
    plan_and_tell(domain, problem, options, cancel, &mut |_| ())
}

/// As [`plan()`], and tells every plan as soon as it is found and validated: each is cheaper than
/// the one before. There is more than one only where [`Options::effort`] asks for it.
pub fn plan_and_tell(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
    found: &mut dyn FnMut(&Plan),
) -> Result<Outcome, PlanError> {
    refuse_mistakes(domain, problem)?;
    let lifted = normalize(domain, problem)?;
    let mut statistics = Statistics::default();
    let grounded = match ground(&lifted, options.budget, cancel, &mut statistics.join_steps) {
        Ok(grounded) => grounded,
        Err(GroundError::Unsupported(unsupported)) => return Err(unsupported.into()),
        Err(GroundError::Stopped(reason)) => {
            return Ok(without_plan(reason, statistics, Vec::new()));
        }
    };
    let Some(task) = grounded.task else {
        let reason = StopReason::Unsolvable { before_search: true };
        return Ok(without_plan(reason, statistics, grounded.warnings));
    };
    statistics.facts = task.fact_count;
    statistics.operators = task.operator_count();
    let (mut best, mut defect) = (None, None);
    let solved =
        Solver::new(&task, options, cancel, &mut statistics).run(&mut |operators| match validated(
            domain,
            problem,
            task.plan(operators),
        ) {
            // Where costs depend on the state, the search may take a dearer plan for a cheaper one.
            Ok(plan) => {
                if best.as_ref().is_none_or(|best| cost(&plan) < cost(best)) {
                    found(&plan);
                    best = Some(plan);
                }
            }
            Err(err) => defect = defect.take().or(Some(err)),
        });
    match (best, defect, solved) {
        (Some(plan), None, _) => Ok(Outcome {
            plan: Some(plan),
            stop_reason: StopReason::GoalReached,
            statistics,
            warnings: grounded.warnings,
        }),
        (_, Some(err), _) => Err(err),
        (None, None, reason) => Ok(without_plan(reason, statistics, grounded.warnings)),
    }
}

/// Refuses texts that make no sense; those of the domain come first and alone, so that all
/// diagnostics of one answer speak of one text.
pub(crate) fn refuse_mistakes(domain: &Domain, problem: &Problem) -> Result<(), PlanError> {
    let mut mistakes = pddl::check_domain(domain);
    mistakes.retain(Diagnostic::is_error);
    if mistakes.is_empty() {
        mistakes = pddl::check_problem(domain, problem);
        mistakes.retain(Diagnostic::is_error);
    }
    if mistakes.is_empty() { Ok(()) } else { Err(PlanError::BadInput(mistakes)) }
}

fn without_plan(
    stop_reason: StopReason,
    statistics: Statistics,
    warnings: Vec<Diagnostic>,
) -> Outcome {
    Outcome { plan: None, stop_reason, statistics, warnings }
}

/// What a validated plan costs.
fn cost(plan: &Plan) -> f64 {
    plan.cost.map_or(f64::INFINITY, |cost| cost.0)
}

/// The plan with the cost that the validator finds.
fn validated(domain: &Domain, problem: &Problem, plan: Plan) -> Result<Plan, PlanError> {
    match validate(domain, problem, &plan) {
        Verdict::Valid { cost, .. } => Ok(Plan { cost: Some(Number(cost)), ..plan }),
        Verdict::Fault(fault) => Err(PlanError::Internal(fault)),
        Verdict::BadInput(diagnostics) => Err(PlanError::BadInput(diagnostics)),
    }
}
