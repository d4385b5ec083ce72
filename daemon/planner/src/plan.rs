//! The planner's front door: from texts to a validated plan.
//!
//! normalize → ground → greedy search → action elimination → optimal search, if the task is small →
//! validation. Every plan passes the independent validator; one that fails is reported as our defect.

use pddl::{Diagnostic, Domain, Number, Plan, Problem};

use crate::ground::{GroundError, ground};
use crate::heuristic::{HEURISTICS, Heuristic, Relaxation, Weights, heuristic};
use crate::limits::{Budget, Cancel, Options};
use crate::normalize::normalize;
use crate::outcome::{Outcome, PlanError, Statistics, StopReason};
use crate::search::greedy::Greedy;
use crate::search::optimal::{AStar, weight};
use crate::search::{Search, improve, run};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};
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
    match solve(&task, options, cancel, &mut statistics) {
        Err(reason) => Ok(without_plan(reason, statistics, grounded.warnings)),
        Ok(operators) => Ok(Outcome {
            plan: Some(validated(domain, problem, task.plan(&operators))?),
            stop_reason: StopReason::GoalReached,
            statistics,
            warnings: grounded.warnings,
        }),
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

/// The plan with the cost that the validator finds.
fn validated(domain: &Domain, problem: &Problem, plan: Plan) -> Result<Plan, PlanError> {
    match validate(domain, problem, &plan) {
        Verdict::Valid { cost, .. } => Ok(Plan { cost: Some(Number(cost)), ..plan }),
        Verdict::Fault(fault) => Err(PlanError::Internal(fault)),
        Verdict::BadInput(diagnostics) => Err(PlanError::BadInput(diagnostics)),
    }
}

/// Finds a plan, then a better one.
fn solve(
    task: &Task,
    options: &Options,
    cancel: &Cancel,
    statistics: &mut Statistics,
) -> Result<Vec<OperatorId>, StopReason> {
    let generator = SuccessorGenerator::new(task);
    let first = {
        let mut search = Greedy::new(task, &generator, (entry("ff").build)(task));
        let result = run(&mut search, options.budget, cancel);
        statistics.expansions = search.expansions();
        statistics.evaluations = search.evaluations();
        result?
    };
    let first = improve::eliminate(task, first, cancel);
    Ok(cheapest(task, &generator, first, options, cancel, statistics))
}

/// Work of one optimal search: explorations times the size of what each looks at. That is about a
/// tenth of a second, and covers a building's problems.
const OPTIMAL_WORK_MAX: u64 = 5_000_000;

/// The cheapest plan, where it can be found with little work; otherwise the given one.
fn cheapest(
    task: &Task,
    generator: &SuccessorGenerator,
    first: Vec<OperatorId>,
    options: &Options,
    cancel: &Cancel,
    statistics: &mut Statistics,
) -> Vec<OperatorId> {
    let size = Relaxation::new(task, Weights::CostThenSteps).size().max(1) as u64;
    let explorations_max = OPTIMAL_WORK_MAX / size;
    if options.optimal_expansions_max == 0 || explorations_max == 0 {
        return first;
    }
    let bound = weight(task, &first);
    let mut search =
        AStar::new(task, generator, (entry("lmcut").build)(task), bound, explorations_max);
    let budget = Budget { expansions_max: options.optimal_expansions_max, ..options.budget };
    let result = run(&mut search, budget, cancel);
    statistics.optimal_expansions = search.expansions();
    // Rounded costs prove nothing about the true ones.
    let is_exact = task.costs_exact && bound < u64::MAX;
    match result {
        Ok(better) => {
            statistics.proven_optimal = is_exact;
            better
        }
        Err(reason) => {
            statistics.proven_optimal = is_exact && reason == StopReason::Exhausted;
            first
        }
    }
}

fn entry(name: &str) -> &'static Heuristic {
    heuristic(name).unwrap_or(&HEURISTICS[0])
}
