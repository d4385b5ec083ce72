//! Metric-FF: its command line, and the meaning of its output.
//!
//! The exit code of Metric-FF does not show whether a plan was found, so its output is parsed.
//! Metric-FF prints names in upper case (`A-MOVE O-ROBOT`) and adds a last step `REACH-GOAL` for
//! disjunctive goals. Its costs are computed in single precision and are not used.

use pddl::{Name, Plan, PlanStep};

use crate::engine::ExternalEngine;
use crate::job::{EngineJob, EngineResult, PlanningAim};
use crate::outcome::{Ending, EngineError};
use crate::process::EngineRun;

/// Option value for the search configuration of Metric-FF that ignores costs: enforced
/// hill-climbing, then best-first search. This configuration is complete.
const WITHOUT_COSTS: &str = "0";

/// Option value for the search configuration of Metric-FF that respects costs: enforced
/// hill-climbing and best-first search, then A*epsilon. Metric-FF stops before A*epsilon if it does
/// not support the metric.
const WITH_COSTS: &str = "5";

/// Line that Metric-FF prints before a plan.
const FOUND: &str = "found legal plan as follows";

/// Text that Metric-FF prints if the initial state satisfies the goal.
const TRUE_ALREADY: &str = "goal can be simplified to TRUE";

/// Texts that Metric-FF prints if it finds no plan, each with the ending of planning that it means.
///
/// The last text alone is no proof that no plan exists: a search that prunes unpromising states
/// prints it, too.
const NO_PLAN: &[(&str, Ending)] = &[
    ("goal can be simplified to FALSE", Ending::Unsolvable { before_search: true }),
    (
        "will never have a defined value. Problem unsolvable",
        Ending::Unsolvable { before_search: true },
    ),
    ("problem proven unsolvable", Ending::Unsolvable { before_search: false }),
    ("search space empty", Ending::Exhausted),
];

/// Texts that Metric-FF prints if it does not support the task.
const BEYOND: &[&str] =
    &["This is not a linear task", "increase MAX_", "can't be handled by this version"];

/// Name of the last step that Metric-FF adds to plans for goals that are not conjunctions.
const REACH_GOAL: &str = "reach-goal";

/// Runs Metric-FF and reads the result. If Metric-FF does not support the metric, runs it a second
/// time without costs.
pub(crate) fn answer(job: &EngineJob<'_>) -> Result<EngineResult, EngineError> {
    if job.options.aim == PlanningAim::CheapestPlan {
        let said = "none of its searches proves that a plan is the cheapest".to_owned();
        return Err(EngineError::Beyond { engine: ExternalEngine::MetricFf, said });
    }
    let folder = job.folder()?;
    let search = |configuration| {
        let arguments = ["-o", "domain.pddl", "-f", "problem.pddl", "-s", configuration];
        job.run(folder.path(), &arguments)
    };
    let mut run = search(if job.lowered.has_metric { WITH_COSTS } else { WITHOUT_COSTS })?;
    if job.lowered.has_metric && rejects_metric(&run) {
        run = search(WITHOUT_COSTS)?;
    }
    read(job, &run)
}

/// Whether Metric-FF's output shows that it does not support the metric (“A*epsilon not defined for
/// plan length …”).
fn rejects_metric(run: &EngineRun) -> bool {
    run.stdout.contains("not defined")
}

fn read(job: &EngineJob<'_>, run: &EngineRun) -> Result<EngineResult, EngineError> {
    let answer = |ending, plans| Ok(EngineResult { ending, plans, proven_optimal: false });
    if run.stdout.contains(TRUE_ALREADY) {
        return answer(Ending::GoalReached, vec![Plan::default()]);
    }
    if let Some((_, said)) = run.stdout.split_once(FOUND) {
        // If Metric-FF was killed while it printed the plan, the plan is incomplete.
        let ending = if run.code().is_some() { Ending::GoalReached } else { job.unexplained(run)? };
        return answer(ending, vec![steps(job, said)?]);
    }
    if let Some(ending) = run.code().and_then(|_| no_plan(&run.stdout)) {
        return answer(ending, Vec::new());
    }
    let said = run.stdout.lines().chain(run.stderr.lines());
    let mut beyond = said.filter(|line| BEYOND.iter().any(|sign| line.contains(sign)));
    if let Some(line) = beyond.next().filter(|_| run.code().is_some()) {
        let said = line.trim().to_owned();
        return Err(EngineError::Beyond { engine: ExternalEngine::MetricFf, said });
    }
    answer(job.unexplained(run)?, Vec::new())
}

fn no_plan(said: &str) -> Option<Ending> {
    NO_PLAN.iter().find(|(sign, _)| said.contains(sign)).map(|(_, ending)| *ending)
}

/// Parses the steps of a plan in Metric-FF's output. The first line is `step    0: OP A B`, the
/// others are `        1: OP A B`.
fn steps(job: &EngineJob<'_>, said: &str) -> Result<Plan, EngineError> {
    let lines = said.lines().filter_map(|line| step(line.trim()));
    let steps: Vec<PlanStep> = lines.filter(|step| step.action != REACH_GOAL).collect();
    job.lowered.names.restore_names(Plan { steps, cost: None }).map_err(|name| {
        let problem = format!("the task has no action or object `{name}`");
        EngineError::UnreadablePlan { engine: ExternalEngine::MetricFf, problem }
    })
}

/// Parses one line of a plan, `[step] NUMBER: OP NAME*`; `None` if the line has another form.
fn step(line: &str) -> Option<PlanStep> {
    let line = line.strip_prefix("step").unwrap_or(line).trim_start();
    let (number, call) = line.split_once(':')?;
    number.parse::<u32>().ok()?;
    let mut words = call.split_whitespace();
    let action = Name::new(words.next()?);
    Some(PlanStep::new(action, words.map(Name::new)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_step_lines_are_parsed() {
        let step = |line| step(line).map(|step| step.to_string());
        assert_eq!(step("step    0: A-MOVE O-R O-X").as_deref(), Some("(A-MOVE O-R O-X)"));
        assert_eq!(step("12: A-GO").as_deref(), Some("(A-GO)"));
        for other in ["", "plan cost: 12.000000", "time spent:    0.00 seconds", "step", "3:"] {
            assert_eq!(step(other), None, "{other}");
        }
    }

    #[test]
    fn a_proof_is_distinguished_from_giving_up() {
        let unsolvable = |before_search| Some(Ending::Unsolvable { before_search });
        for (said, expected) in [
            ("ff: goal can be simplified to FALSE. No plan will solve it", unsolvable(true)),
            ("best first search space empty! problem proven unsolvable.", unsolvable(false)),
            ("Enforced Hill-climbing failed !\nsearch space empty", Some(Ending::Exhausted)),
            ("ff: parsing domain file", None),
        ] {
            assert_eq!(no_plan(said), expected, "{said}");
        }
    }
}
