//! The front door: which engines there are, and how one of them is asked for a plan.
//!
//! check → lower → run → read → validate. The task goes to the engine lowered; the plan comes back
//! in the task's own names and is judged on the task as its author wrote it, so that no mistake of
//! `lower` can pass.

use std::fmt;
use std::time::{Duration, Instant};

use pddl::{Diagnostic, Domain, Number, Plan, Problem};
use planner::{Cancel, Verdict, validate};

use crate::find::Installation;
use crate::lower::{Dialect, Lowered, lower};
use crate::outcome::{Ending, EngineError, Outcome};
use crate::process::{End, Run};
use crate::{fast_downward, metric_ff};

/// A planner outside of this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Engine {
    /// Fast Downward: all of ADL, axioms, action costs; no numbers.
    FastDownward,
    /// Metric-FF: all of ADL, linear numbers; no axioms.
    MetricFf,
}

/// What the engine is to strive for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Aim {
    /// A plan, soon.
    #[default]
    Plan,
    /// A plan that is proven to be the cheapest. Fast Downward alone can.
    CheapestPlan,
}

/// What a run may spend, and what for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Wall-clock time, from the call on.
    pub time_limit: Option<Duration>,
    /// Bytes of address space of each of the engine's processes.
    pub memory_limit: Option<u64>,
    /// What the engine is to strive for.
    pub aim: Aim,
}

impl Default for Options {
    /// No limit on time; 2 GiB, as the embedded planner; a plan, soon.
    fn default() -> Options {
        Options { time_limit: None, memory_limit: Some(2 << 30), aim: Aim::Plan }
    }
}

/// What an engine brought back: its ending, and the plans it wrote, best last.
pub(crate) struct Answer {
    pub(crate) ending: Ending,
    pub(crate) plans: Vec<Plan>,
    pub(crate) proven_optimal: bool,
}

/// Asks an engine for a plan.
///
/// Blocks until the engine has ended; a caller who wants it to end sooner sets `cancel`. When this
/// returns, no process and no file of the run is left.
pub fn plan(
    installation: &Installation,
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
) -> Result<Outcome, EngineError> {
    let deadline = options.time_limit.and_then(|limit| Instant::now().checked_add(limit));
    let engine = installation.engine;
    refuse_mistakes(domain, problem)?;
    let dialect = match engine {
        Engine::FastDownward => Dialect::FAST_DOWNWARD,
        Engine::MetricFf => Dialect::METRIC_FF,
    };
    let lowered = lower(domain, problem, dialect)
        .map_err(|unsupported| EngineError::Unsupported { engine, unsupported })?;
    let job = Job { installation, lowered: &lowered, options, deadline, cancel };
    let answer = match engine {
        Engine::FastDownward => fast_downward::answer(&job)?,
        Engine::MetricFf => metric_ff::answer(&job)?,
    };
    judge(engine, domain, problem, answer, lowered.costs_exact)
}

/// One run, as the engines' modules see it.
pub(crate) struct Job<'j> {
    pub(crate) installation: &'j Installation,
    pub(crate) lowered: &'j Lowered,
    pub(crate) options: &'j Options,
    pub(crate) deadline: Option<Instant>,
    pub(crate) cancel: &'j Cancel,
}

/// Refuses texts that make no sense; those of the domain come first and alone, as `planner` has it.
fn refuse_mistakes(domain: &Domain, problem: &Problem) -> Result<(), EngineError> {
    let errors = |mut found: Vec<Diagnostic>| {
        found.retain(Diagnostic::is_error);
        if found.is_empty() { Ok(()) } else { Err(EngineError::BadInput(found)) }
    };
    errors(pddl::check_domain(domain))?;
    errors(pddl::check_problem(domain, problem))
}

/// The best plan that works, with the cost that the validator finds.
///
/// An engine that ended by itself and wrote a plan that does not work is wrong, and that is told. Of
/// one that we ended, the last plan may be half written: it counts where it works.
fn judge(
    engine: Engine,
    domain: &Domain,
    problem: &Problem,
    answer: Answer,
    costs_exact: bool,
) -> Result<Outcome, EngineError> {
    let Answer { ending, plans, proven_optimal } = answer;
    let mut fault = None;
    for plan in plans.into_iter().rev() {
        match validate(domain, problem, &plan) {
            Verdict::Valid { cost, .. } => {
                return Ok(Outcome {
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
            let problem = "it says that there is one, and wrote none".to_owned();
            Err(EngineError::UnreadablePlan { engine, problem })
        }
        (ending, _) => Ok(Outcome { plan: None, ending, proven_optimal: false }),
    }
}

// === impl Engine ===

impl Engine {
    /// The environment variable that names its program.
    pub fn variable(self) -> &'static str {
        match self {
            Engine::FastDownward => "ALTHING_FAST_DOWNWARD",
            Engine::MetricFf => "ALTHING_METRIC_FF",
        }
    }

    /// What its program may be called.
    pub(crate) fn programs(self) -> &'static [&'static str] {
        match self {
            Engine::FastDownward => &["fast-downward.py", "fast-downward"],
            Engine::MetricFf => &["metric-ff", "ff"],
        }
    }

    /// How to install it.
    pub(crate) fn how_to_get(self) -> &'static str {
        match self {
            Engine::FastDownward => {
                "`pip install up-fast-downward` is enough; or put `fast-downward.py` on PATH, or \
                 name it in ALTHING_FAST_DOWNWARD"
            }
            Engine::MetricFf => {
                "build version 2.1 from its author's page and put `metric-ff` or `ff` on PATH, or \
                 name it in ALTHING_METRIC_FF"
            }
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Engine::FastDownward => "Fast Downward",
            Engine::MetricFf => "Metric-FF",
        })
    }
}

// === impl Job ===

impl Job<'_> {
    /// A folder of its own with `domain.pddl` and `problem.pddl` in it.
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
    ) -> Result<Run, EngineError> {
        let mut command = self.installation.command.clone();
        command.extend(arguments.iter().map(Into::into));
        let launch = crate::process::Launch {
            command: &command,
            folder,
            deadline: self.deadline,
            memory_limit: self.options.memory_limit,
        };
        let run = crate::process::run(&launch, self.cancel).map_err(|err| self.failed(err))?;
        match run.code() {
            // The shell could not become the engine, for another reason than memory.
            Some(126 | 127) if !run.wants_memory() => {
                Err(self.failed(std::io::Error::other(run.last_words())))
            }
            _ => Ok(run),
        }
    }

    /// What became of a run that an engine's own signs do not explain.
    pub(crate) fn unexplained(&self, run: &Run) -> Result<Ending, EngineError> {
        match run.end {
            End::OutOfTime => Ok(Ending::OutOfTime),
            End::Cancelled => Ok(Ending::Cancelled),
            End::Itself(_) if self.options.memory_limit.is_some() && run.wants_memory() => {
                Ok(Ending::OutOfMemory)
            }
            End::Itself(_) => Err(EngineError::BrokeDown {
                engine: self.installation.engine,
                status: run.status(),
                said: run.last_words(),
            }),
        }
    }

    fn failed(&self, source: std::io::Error) -> EngineError {
        EngineError::Run { engine: self.installation.engine, source }
    }
}
