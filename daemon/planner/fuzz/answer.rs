//! What bytes get for an answer: the domain, a zero, the problem.
//!
//! Shared by the fuzz target and the tests, which bring the bytes.

use pddl::{Document, parse_document, text_from_bytes};
use planner::{
    Budget, CONFIGURATIONS, Cancel, Effort, Options, PlanError, Verdict, plan, validate,
};

/// Enough for a small building; what asks for more is told so.
const BUDGET: Budget =
    Budget { expansions_max: 2_000, join_steps_max: 200_000, memory_max_bytes: 64 << 20 };

/// How far the bytes came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// They are no domain and problem.
    Unreadable,
    /// Somebody's mistake, or more than the planner does.
    Refused,
    /// A limit, or a proof that there is no plan.
    NoPlan,
    /// A plan that the validator accepts.
    Planned,
}

/// Reads, plans and checks.
///
/// # Panics
///
/// If the planner contradicts itself: then it is the planner's mistake, not the text's.
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
    let outcome = match plan(&domain, &problem, &options, &Cancel::new()) {
        Ok(outcome) => outcome,
        Err(err @ PlanError::Internal(_)) => panic!("{err}\n{domain}\n{problem}"),
        Err(_) => return Answer::Refused,
    };
    let Some(plan) = outcome.plan else { return Answer::NoPlan };
    let verdict = validate::validate(&domain, &problem, &plan);
    assert!(matches!(verdict, Verdict::Valid { .. }), "{verdict:?}\n{domain}\n{problem}");
    Answer::Planned
}
