//! Plans for any bytes (a domain, a zero byte, and a problem) and checks the result. The fuzz
//! target and the tests supply the bytes.

use pddl::{Document, Domain, Plan, Problem, parse_document, text_from_bytes};
use planner::{
    Budget, CONFIGURATIONS, Cancel, Effort, Options, PlanError, PlanningOutcome, Replanner,
    StopReason, Verdict, plan, validate,
};

/// Limits that are sufficient for a small building; larger tasks end at a limit.
const BUDGET: Budget =
    Budget { expansions_max: 2_000, join_steps_max: 200_000, memory_max_bytes: 64 << 20 };

/// Stage that the processing of the bytes reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// The bytes are not a domain and a problem.
    Unreadable,
    /// The texts contain errors, or use a feature that the planner does not support.
    Refused,
    /// A limit was reached, or there is a proof that there is no plan.
    NoPlan,
    /// A plan that the validator accepts.
    Planned,
}

/// Parses, plans and validates. Then replans twice with a kept ground problem: with every second
/// fact removed, and with all facts again.
///
/// # Panics
///
/// Panics if the planner contradicts itself, which is a defect of the planner, not of the text.
pub(crate) fn answer(bytes: &[u8]) -> Answer {
    let (domain, problem) = match bytes.iter().position(|byte| *byte == 0) {
        Some(end) => (&bytes[..end], &bytes[end + 1..]),
        None => (bytes, &[][..]),
    };
    let read = |bytes: &[u8]| parse_document(&text_from_bytes(bytes)).into_result();
    let (Ok(Document::Domain(domain)), Ok(Document::Problem(problem))) =
        (read(domain), read(problem))
    else {
        return Answer::Unreadable;
    };
    let efforts = [Effort::First, Effort::Anytime, Effort::Optimal];
    let options = Options {
        budget: BUDGET,
        optimal_expansions_max: 100,
        configuration: &CONFIGURATIONS[bytes.len() % CONFIGURATIONS.len()],
        effort: efforts[bytes.len() / CONFIGURATIONS.len() % efforts.len()],
        threads: 1,
    };
    let Some(outcome) = planned(&domain, &problem, &options) else { return Answer::Refused };
    replan(&domain, &problem, &options);
    if outcome.plan.is_some() { Answer::Planned } else { Answer::NoPlan }
}

/// Plans, and checks any plan in the outcome. Returns `None` if the texts are rejected.
fn planned(domain: &Domain, problem: &Problem, options: &Options) -> Option<PlanningOutcome> {
    judged(domain, problem, plan(domain, problem, options, &Cancel::new()))
}

fn judged(
    domain: &Domain,
    problem: &Problem,
    answer: Result<PlanningOutcome, PlanError>,
) -> Option<PlanningOutcome> {
    let outcome = match answer {
        Ok(outcome) => outcome,
        Err(err @ PlanError::Internal(_)) => panic!("{err}\n{domain}\n{problem}"),
        Err(_) => return None,
    };
    if let Some(plan) = &outcome.plan {
        let verdict = validate::validate(domain, problem, plan);
        assert!(matches!(verdict, Verdict::Valid { .. }), "{verdict:?}\n{domain}\n{problem}");
    }
    Some(outcome)
}

/// Replans with one planner for changed problems, and compares each result with that of a new
/// planner.
fn replan(domain: &Domain, problem: &Problem, options: &Options) {
    let mut less = problem.clone();
    let mut place = 0;
    less.init.retain(|_| {
        place += 1;
        place % 2 == 0
    });
    let mut replanner = Replanner::default();
    let mut rest = Plan { steps: Vec::new(), cost: None };
    for problem in [problem, &less, problem] {
        let again = replanner.plan(domain, problem, &rest.steps, options, &Cancel::new());
        let again = judged(domain, problem, again.map(|replanned| replanned.outcome));
        let (Some(again), Some(anew)) = (again, planned(domain, problem, options)) else { return };
        for (one, other) in [(&again, &anew), (&anew, &again)] {
            let is_proof = matches!(one.stop_reason, StopReason::Unsolvable { .. });
            assert!(!is_proof || other.plan.is_none(), "a proof and a plan\n{domain}\n{problem}");
        }
        // Continue as if the first step of the plan had been executed.
        let steps = again.plan.into_iter().flat_map(|plan| plan.steps).skip(1);
        rest.steps = steps.collect();
    }
}
