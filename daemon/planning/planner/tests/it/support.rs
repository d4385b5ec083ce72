//! Helpers that call the planner's API, so that the other tests are mostly data.

use expect_test::Expect;
use pddl::{Domain, Problem};
use planner::{Cancel, Options, PlanError, PlanningOutcome, plan};

/// Parses a domain and a problem.
#[track_caller]
pub(crate) fn parse(domain: &str, problem: &str) -> (Domain, Problem) {
    let domain = pddl::parse_domain(domain).into_result().expect("the domain parses");
    let problem = pddl::parse_problem(problem).into_result().expect("the problem parses");
    (domain, problem)
}

/// Plans without limits.
#[track_caller]
pub(crate) fn outcome(domain: &str, problem: &str) -> Result<PlanningOutcome, PlanError> {
    let (domain, problem) = parse(domain, problem);
    plan(&domain, &problem, &Options::default(), &Cancel::new())
}

/// Plans, and compares the formatted result with `expected`.
#[track_caller]
pub(crate) fn check(domain: &str, problem: &str, expected: Expect) {
    expected.assert_eq(&describe(outcome(domain, problem), domain, problem));
}

/// Returns a problem of the domain `d`, made from its parts.
pub(crate) fn problem(parts: &str) -> String {
    format!("(define (problem p) (:domain d) {parts})")
}

/// Returns a domain `d`, made from its parts.
pub(crate) fn domain(parts: &str) -> String {
    format!("(define (domain d) {parts})")
}

fn describe(result: Result<PlanningOutcome, PlanError>, domain: &str, problem: &str) -> String {
    let mut text = String::new();
    match result {
        Err(PlanError::Unsupported(unsupported)) => {
            let source =
                if unsupported.text == planner::InputText::Domain { domain } else { problem };
            let place = source.get(unsupported.span.range()).unwrap_or("?");
            text += &format!("unsupported: {}\nat {place}\n", unsupported.feature);
        }
        Err(PlanError::BadInput(diagnostics)) => {
            for diagnostic in diagnostics {
                text += &format!("{diagnostic}\n");
            }
        }
        Err(err) => text += &format!("defect: {err}\n"),
        Ok(outcome) => {
            for warning in &outcome.warnings {
                text += &format!("{warning}\n");
            }
            match &outcome.plan {
                None => text += &format!("{}\n", outcome.stop_reason),
                Some(plan) => {
                    for step in &plan.steps {
                        text += &format!("{step}\n");
                    }
                    let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
                    let proof =
                        if outcome.statistics.proven_optimal { "optimal" } else { "unproven" };
                    text += &format!("cost {cost}, {proof}\n");
                }
            }
        }
    }
    text
}
