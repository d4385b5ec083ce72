//! Fast Downward: its command line, and the meaning of its exit codes.
//!
//! The exit codes are documented by Fast Downward under “Exit codes”. Fast Downward writes a plan
//! to a file. A search that continues after the first plan numbers the files (`plan.1`, `plan.2`,
//! …); the last plan is the best.

use std::path::{Path, PathBuf};

use pddl::Plan;

use crate::engine::ExternalEngine;
use crate::job::{EngineJob, EngineResult, PlanningAim};
use crate::outcome::{Ending, EngineError};
use crate::process::EngineRun;

/// Name of the file that Fast Downward writes plans to.
const PLAN: &str = "plan";

/// Search configuration for a cheapest plan: A* with landmark cut, the usual choice in the field.
const LANDMARK_CUT: &str = "astar(lmcut())";

/// Search configuration for a cheapest plan without a heuristic: A* that expands blindly. It is
/// used if landmark cut does not support the task because of axioms or conditional effects.
const BLIND: &str = "astar(blind())";

/// Exit code of Fast Downward for “unsupported”: the search does not support a feature of the task.
const UNSUPPORTED: i32 = 34;

/// Runs Fast Downward for a task and reads the result of the run.
pub(crate) fn answer(job: &EngineJob<'_>) -> Result<EngineResult, EngineError> {
    let folder = job.folder()?;
    let files = ["domain.pddl", "problem.pddl"];
    let writing = ["--plan-file", PLAN];
    let optimally =
        |search| job.run(folder.path(), &[&writing[..], &files, &["--search", search]].concat());
    let run = match job.options.aim {
        PlanningAim::Plan => {
            job.run(folder.path(), &[&writing[..], &["--alias", "lama-first"], &files].concat())?
        }
        PlanningAim::CheapestPlan if is_refused_anyway(job) => optimally(BLIND)?,
        PlanningAim::CheapestPlan => match optimally(LANDMARK_CUT)? {
            refused if refused.code() == Some(UNSUPPORTED) => optimally(BLIND)?,
            run => run,
        },
    };
    let mut ending = ending(job, &run)?;
    let plans = plans(job, folder.path(), ending)?;
    if plans.is_empty() && matches!(run.code(), Some(1..=3)) {
        // Python also exits with 1 if it fails.
        ending = job.unexplained(&run)?;
    }
    // The exit codes 1, 2 and 3 also come with a plan, but without a proof.
    let proven_optimal = job.options.aim == PlanningAim::CheapestPlan && run.code() == Some(0);
    Ok(EngineResult { ending, plans, proven_optimal })
}

/// Whether landmark cut certainly does not support the task, so that a run with it is useless. In
/// other tasks, too, Fast Downward's translator may produce features that landmark cut does not
/// support; these tasks are found by trying.
fn is_refused_anyway(job: &EngineJob<'_>) -> bool {
    ["(:derived ", "(when "].iter().any(|word| job.lowered.domain.contains(word))
}

/// Returns the meaning of Fast Downward's exit code.
fn ending(job: &EngineJob<'_>, run: &EngineRun) -> Result<Ending, EngineError> {
    let engine = ExternalEngine::FastDownward;
    match run.code() {
        // 1, 2 and 3: a plan was found, then a limit was reached.
        Some(0..=3) => Ok(Ending::GoalReached),
        Some(10) => Ok(Ending::Unsolvable { before_search: true }),
        Some(11) => Ok(Ending::Unsolvable { before_search: false }),
        // 13: unsolvable within a bound, which is not a proof.
        Some(12 | 13) => Ok(Ending::Exhausted),
        // 20: out of memory in the translator; 24: out of memory and time.
        Some(20 | 22 | 24) => Ok(Ending::OutOfMemory),
        Some(21 | 23) => Ok(Ending::OutOfTime),
        Some(UNSUPPORTED) => Err(EngineError::Beyond { engine, said: run.last_output_line() }),
        _ => job.unexplained(run),
    }
}

/// Returns the plans that Fast Downward wrote, the best last. A killed engine may leave an
/// incomplete plan. An unreadable plan is therefore an error only if the goal was reached and no
/// plan can be read.
fn plans(job: &EngineJob<'_>, folder: &Path, ending: Ending) -> Result<Vec<Plan>, EngineError> {
    let mut plans = Vec::new();
    let mut unreadable = None;
    for file in files(folder) {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        let parsed = pddl::parse_plan(&text);
        let problem = parsed.diagnostics.iter().find(|found| found.is_error());
        match (problem, parsed.value) {
            (None, Some(plan)) => match job.lowered.names.restore_names(plan) {
                Ok(plan) => plans.push(plan),
                Err(name) => {
                    unreadable = Some(format!("the task has no action or object `{name}`"));
                }
            },
            (problem, _) => unreadable = problem.map(ToString::to_string).or(unreadable),
        }
    }
    match unreadable {
        Some(problem) if plans.is_empty() && ending == Ending::GoalReached => {
            Err(EngineError::UnreadablePlan { engine: ExternalEngine::FastDownward, problem })
        }
        _ => Ok(plans),
    }
}

/// Returns the plan files that exist in `folder`, among `plan`, `plan.1`, `plan.2`, ….
fn files(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let single = folder.join(PLAN);
    let folder = folder.to_owned();
    let numbered = (1..).map(move |number| folder.join(format!("{PLAN}.{number}")));
    single.is_file().then_some(single).into_iter().chain(numbered.take_while(|file| file.is_file()))
}
