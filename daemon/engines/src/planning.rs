//! The entry point: the engines, and the function that plans with one of them.
//!
//! The order of work is: check → lower → run → read → validate. The engine gets the lowered task, which
//! is the task translated to its dialect. The engine's plan is translated back to the task's own names
//! and validated on the original task, so that a mistake in `lower` cannot go unnoticed.

use std::fmt;
use std::time::{Duration, Instant};

use pddl::{Diagnostic, Domain, Number, Plan, Problem};
use planner::{Cancel, Verdict, validate};

use crate::find::Installation;
use crate::lower::{Dialect, Lowered, lower};
use crate::outcome::{Ending, EngineError, EngineOutcome};
use crate::process::{EngineEnd, EngineRun};
use crate::{fast_downward, metric_ff};

/// A planner that runs as a process of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExternalEngine {
    /// Fast Downward. It supports all of ADL, axioms and action costs, but no other numbers.
    FastDownward,
    /// Metric-FF. It supports all of ADL and linear arithmetic, but no axioms.
    MetricFf,
}

/// What kind of plan the engine is to find.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanningAim {
    /// Any plan, as soon as possible.
    #[default]
    Plan,
    /// A plan that is proved to be the cheapest. Only Fast Downward supports this aim.
    CheapestPlan,
}

/// Limits on the time and the memory of an engine's run, and the aim of planning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineOptions {
    /// Limit on the wall-clock time of planning, from the call on; `None` for no limit.
    pub time_limit: Option<Duration>,
    /// Limit on the address space of each of the engine's processes, in bytes; `None` for no limit.
    pub memory_limit: Option<u64>,
    /// What kind of plan the engine is to find.
    pub aim: PlanningAim,
}

impl Default for EngineOptions {
    /// Returns the default options: no limit on time; 2 GiB of memory, as for the embedded planner; any
    /// plan, as soon as possible.
    fn default() -> EngineOptions {
        EngineOptions { time_limit: None, memory_limit: Some(2 << 30), aim: PlanningAim::Plan }
    }
}

/// The result that is read from an engine's run: why the run ended, and the plans that were written,
/// the best last.
pub(crate) struct EngineResult {
    pub(crate) ending: Ending,
    pub(crate) plans: Vec<Plan>,
    pub(crate) proven_optimal: bool,
}

/// Plans for a task with an external engine.
///
/// This function blocks until the engine has ended; set `cancel` to end the engine sooner. When the
/// function returns, no process and no file of the run is left.
///
/// # Errors
///
/// Returns an error if the texts contain errors or use a feature that the engine does not support, if
/// the engine cannot be run or answers nothing that can be read, or if the validator rejects all of its
/// plans.
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

/// Context of one run of an engine, for the modules of the engines.
pub(crate) struct EngineJob<'j> {
    pub(crate) installation: &'j Installation,
    pub(crate) lowered: &'j Lowered,
    pub(crate) options: &'j EngineOptions,
    pub(crate) deadline: Option<Instant>,
    pub(crate) cancel: &'j Cancel,
}

/// Returns an error if the texts have mistakes. If the domain has mistakes, only those are returned, as
/// in `planner`.
fn refuse_mistakes(domain: &Domain, problem: &Problem) -> Result<(), EngineError> {
    let errors = |mut found: Vec<Diagnostic>| {
        found.retain(Diagnostic::is_error);
        if found.is_empty() { Ok(()) } else { Err(EngineError::BadInput(found)) }
    };
    errors(pddl::check_domain(domain))?;
    errors(pddl::check_problem(domain, problem))
}

/// Returns the best valid plan among those that an engine wrote, with the cost that the validator
/// computes.
///
/// If an engine that ended on its own wrote an invalid plan, that is an error. If the engine was ended
/// by this process, its last plan may be incomplete and is only used if it is valid.
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

// === impl ExternalEngine ===

impl ExternalEngine {
    /// Returns the environment variable that names the engine's program.
    pub fn variable(self) -> &'static str {
        match self {
            ExternalEngine::FastDownward => "ALTHING_FAST_DOWNWARD",
            ExternalEngine::MetricFf => "ALTHING_METRIC_FF",
        }
    }

    /// Returns the names that the engine's program may have on `PATH`.
    pub(crate) fn programs(self) -> &'static [&'static str] {
        match self {
            ExternalEngine::FastDownward => &["fast-downward.py", "fast-downward"],
            ExternalEngine::MetricFf => &["metric-ff", "ff"],
        }
    }

    /// Returns advice for installing the engine.
    pub(crate) fn how_to_get(self) -> &'static str {
        match self {
            ExternalEngine::FastDownward => {
                "`pip install up-fast-downward` is enough; or put `fast-downward.py` on PATH, or \
                 name it in ALTHING_FAST_DOWNWARD"
            }
            ExternalEngine::MetricFf => {
                "build version 2.1 from its author's page and put `metric-ff` or `ff` on PATH, or \
                 name it in ALTHING_METRIC_FF"
            }
        }
    }
}

impl fmt::Display for ExternalEngine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ExternalEngine::FastDownward => "Fast Downward",
            ExternalEngine::MetricFf => "Metric-FF",
        })
    }
}

// === impl EngineJob ===

impl EngineJob<'_> {
    /// Creates a temporary folder with `domain.pddl` and `problem.pddl` in it.
    pub(crate) fn folder(&self) -> Result<tempfile::TempDir, EngineError> {
        let folder = tempfile::Builder::new().prefix("althing-engine-").tempdir();
        let folder = folder.map_err(|source| self.failed(source))?;
        for (name, text) in
            [("domain.pddl", &self.lowered.domain), ("problem.pddl", &self.lowered.problem)]
        {
            std::fs::write(folder.path().join(name), text).map_err(|err| self.failed(err))?;
        }
        Ok(folder)
    }

    /// Runs the engine with these arguments in a folder.
    pub(crate) fn run(
        &self,
        folder: &std::path::Path,
        arguments: &[&str],
    ) -> Result<EngineRun, EngineError> {
        let mut command = self.installation.command.clone();
        command.extend(arguments.iter().map(Into::into));
        let launch = crate::process::EngineLaunch {
            command: &command,
            folder,
            deadline: self.deadline,
            memory_limit: self.options.memory_limit,
        };
        let run = crate::process::run(&launch, self.cancel).map_err(|err| self.failed(err))?;
        match run.code() {
            // The shell could not execute the engine, for another reason than memory.
            Some(126 | 127) if !run.wants_memory() => {
                Err(self.failed(std::io::Error::other(run.last_output_line())))
            }
            _ => Ok(run),
        }
    }

    /// Returns the ending of a run in the case that the engine's own exit code and output do not
    /// explain it: the run reached a limit or was cancelled. Returns an error if the engine failed.
    pub(crate) fn unexplained(&self, run: &EngineRun) -> Result<Ending, EngineError> {
        match run.end {
            EngineEnd::OutOfTime => Ok(Ending::OutOfTime),
            EngineEnd::Cancelled => Ok(Ending::Cancelled),
            EngineEnd::Itself(_) if self.options.memory_limit.is_some() && run.wants_memory() => {
                Ok(Ending::OutOfMemory)
            }
            EngineEnd::Itself(_) => Err(EngineError::BrokeDown {
                engine: self.installation.engine,
                status: run.status(),
                said: run.last_output_line(),
            }),
        }
    }

    fn failed(&self, source: std::io::Error) -> EngineError {
        EngineError::Run { engine: self.installation.engine, source }
    }
}
