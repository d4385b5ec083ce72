//! The entry point: the function that plans with an external engine.
//!
//! The steps are: check, lower, run, read, validate. The engine receives the lowered task, a
//! translation to its dialect. The engine's plan is translated back to the task's own names and
//! validated on the original task, so that a defect in `lower` is detected.

use std::time::Instant;

use pddl::{Diagnostic, Domain, Number, Plan, Problem};
use planner::{Cancel, Verdict, validate};

use crate::engine::ExternalEngine;
use crate::find::Installation;
use crate::job::{EngineJob, EngineOptions, EngineResult};
use crate::lower::{Dialect, lower};
use crate::outcome::{Ending, EngineError, EngineOutcome};
use crate::{fast_downward, metric_ff};

/// Plans for a task with an external engine.
///
/// This function blocks until the engine has ended. Setting `cancel` ends the engine sooner. When
/// the function returns, no process and no file of the run is left.
///
/// # Errors
///
/// Returns an error if the texts contain mistakes or use a feature that the engine does not
/// support, if the engine cannot be run or its output cannot be read, or if the validator rejects
/// all of its plans.
pub fn plan(
    installation: &Installation,
    domain: &Domain,
    problem: &Problem,
    options: &EngineOptions,
    cancel: &Cancel,
) -> Result<EngineOutcome, EngineError> {
    let deadline = options.time_limit.and_then(|limit| Instant::now().checked_add(limit));
    let engine = installation.engine;
    refuse_mistakes(domain, problem)?;
    let dialect = match engine {
        ExternalEngine::FastDownward => Dialect::FAST_DOWNWARD,
        ExternalEngine::MetricFf => Dialect::METRIC_FF,
    };
    let lowered = lower(domain, problem, dialect)
        .map_err(|unsupported| EngineError::Unsupported { engine, unsupported })?;
    let job = EngineJob { installation, lowered: &lowered, options, deadline, cancel };
    let answer = match engine {
        ExternalEngine::FastDownward => fast_downward::answer(&job)?,
        ExternalEngine::MetricFf => metric_ff::answer(&job)?,
    };
    best_valid_plan(engine, domain, problem, answer, lowered.costs_exact)
}

/// Returns an error if the texts have mistakes. If the domain has mistakes, only these are
/// returned, as in `planner`.
fn refuse_mistakes(domain: &Domain, problem: &Problem) -> Result<(), EngineError> {
    let errors = |mut found: Vec<Diagnostic>| {
        found.retain(Diagnostic::is_error);
        if found.is_empty() { Ok(()) } else { Err(EngineError::BadInput(found)) }
    };
    errors(pddl::check_domain(domain))?;
    errors(pddl::check_problem(domain, problem))
}

/// Returns the best valid plan of an engine, with the cost that the validator computes.
///
/// An invalid plan is an error if the engine ended on its own. If this process ended the engine,
/// the last plan may be incomplete and is skipped if it is invalid.
fn best_valid_plan(
    engine: ExternalEngine,
    domain: &Domain,
    problem: &Problem,
    answer: EngineResult,
    costs_exact: bool,
) -> Result<EngineOutcome, EngineError> {
    let EngineResult { ending, plans, proven_optimal } = answer;
    let mut fault = None;
    for plan in plans.into_iter().rev() {
        match validate(domain, problem, &plan) {
            Verdict::Valid { cost, .. } => {
                return Ok(EngineOutcome {
                    plan: Some(Plan { cost: Some(Number(cost)), ..plan }),
                    ending: Ending::GoalReached,
                    proven_optimal: proven_optimal && costs_exact,
                });
            }
            Verdict::Fault(found) => fault = fault.or(Some(found)),
            Verdict::BadInput(mistakes) => return Err(EngineError::BadInput(mistakes)),
        }
    }
    match (ending, fault) {
        (Ending::GoalReached, Some(fault)) => Err(EngineError::WrongPlan { engine, fault }),
        (Ending::GoalReached, None) => {
            let problem = "it reports a plan, and wrote none".to_owned();
            Err(EngineError::UnreadablePlan { engine, problem })
        }
        (ending, _) => Ok(EngineOutcome { plan: None, ending, proven_optimal: false }),
    }
}

// === impl EngineJob ===
