//! Fast Downward: its command line, and what its exit codes mean.
//!
//! Source of the codes: its documentation, “Exit codes”. A plan goes to a file; searches that go on
//! after the first number the files (`plan.1`, `plan.2`, …), the best last.

use std::path::{Path, PathBuf};

use pddl::Plan;

use crate::outcome::{Ending, EngineError};
use crate::planning::{Aim, Answer, Engine, Job};
use crate::process::Run;

/// The file that plans are written to.
const PLAN: &str = "plan";

/// A* with landmark cut: the field's common choice.
const LANDMARK_CUT: &str = "astar(lmcut())";

/// A* without a heuristic, for what landmark cut refuses: axioms, conditional effects.
const BLIND: &str = "astar(blind())";

/// “Unsupported”: the search refuses a feature of the task.
const UNSUPPORTED: i32 = 34;

/// Runs it and reads what it left.
pub(crate) fn answer(job: &Job<'_>) -> Result<Answer, EngineError> {
    let folder = job.folder()?;
    let files = ["domain.pddl", "problem.pddl"];
    let writing = ["--plan-file", PLAN];
    let optimally =
        |search| job.run(folder.path(), &[&writing[..], &files, &["--search", search]].concat());
    let run = match job.options.aim {
        Aim::Plan => {
            job.run(folder.path(), &[&writing[..], &["--alias", "lama-first"], &files].concat())?
        }
        Aim::CheapestPlan if is_refused_anyway(job) => optimally(BLIND)?,
        Aim::CheapestPlan => match optimally(LANDMARK_CUT)? {
            refused if refused.code() == Some(UNSUPPORTED) => optimally(BLIND)?,
            run => run,
        },
    };
    let mut ending = ending(job, &run)?;
    let plans = plans(job, folder.path(), ending)?;
    if plans.is_empty() && matches!(run.code(), Some(1..=3)) {
        // A Python that breaks down ends with 1 too.
        ending = job.unexplained(&run)?;
    }
    // 1, 2 and 3 are plans too, without a proof.
    let proven_optimal = job.options.aim == Aim::CheapestPlan && run.code() == Some(0);
    Ok(Answer { ending, plans, proven_optimal })
}

/// Whether landmark cut need not be asked. Where it refuses what the translator made of a task that
/// looks harmless here, it is asked in vain.
fn is_refused_anyway(job: &Job<'_>) -> bool {
    ["(:derived ", "(when "].iter().any(|word| job.lowered.domain.contains(word))
}

/// What the exit code says.
fn ending(job: &Job<'_>, run: &Run) -> Result<Ending, EngineError> {
    let engine = Engine::FastDownward;
    match run.code() {
        // 1, 2 and 3: a plan was found, then a limit was reached.
        Some(0..=3) => Ok(Ending::GoalReached),
        Some(10) => Ok(Ending::Unsolvable { before_search: true }),
        Some(11) => Ok(Ending::Unsolvable { before_search: false }),
        // 13: unsolvable within a bound, and bounds prove nothing.
        Some(12 | 13) => Ok(Ending::Exhausted),
        // 20: in the translator; 24: of memory or of time.
        Some(20 | 22 | 24) => Ok(Ending::OutOfMemory),
        Some(21 | 23) => Ok(Ending::OutOfTime),
        Some(UNSUPPORTED) => Err(EngineError::Beyond { engine, said: run.last_words() }),
        _ => job.unexplained(run),
    }
}

/// The plans that were written, best last. Those that cannot be read are told only where there
/// should be one: a plan may be half written when its author is killed.
fn plans(job: &Job<'_>, folder: &Path, ending: Ending) -> Result<Vec<Plan>, EngineError> {
    let mut plans = Vec::new();
    let mut unreadable = None;
    for file in files(folder) {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        let parsed = pddl::parse_plan(&text);
        let problem = parsed.diagnostics.iter().find(|found| found.is_error());
        match (problem, parsed.value) {
            (None, Some(plan)) => match job.lowered.names.raise(plan) {
                Ok(plan) => plans.push(plan),
                Err(name) => unreadable = Some(format!("nothing is called `{name}`")),
            },
            (problem, _) => unreadable = problem.map(ToString::to_string).or(unreadable),
        }
    }
    match unreadable {
        Some(problem) if plans.is_empty() && ending == Ending::GoalReached => {
            Err(EngineError::UnreadablePlan { engine: Engine::FastDownward, problem })
        }
        _ => Ok(plans),
    }
}

/// `plan`, `plan.1`, `plan.2`, …, as far as they are there.
fn files(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let single = folder.join(PLAN);
    let folder = folder.to_owned();
    let numbered = (1..).map(move |number| folder.join(format!("{PLAN}.{number}")));
    single.is_file().then_some(single).into_iter().chain(numbered.take_while(|file| file.is_file()))
}
