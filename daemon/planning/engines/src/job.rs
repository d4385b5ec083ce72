//! One run of an engine: its options, its process, and the result.

use std::time::{Duration, Instant};

use pddl::Plan;
use planner::Cancel;

use crate::find::Installation;
use crate::lower::Lowered;
use crate::outcome::{Ending, EngineError};
use crate::process::{EngineEnd, EngineLaunch, EngineRun};

/// Kind of plan that the engine must find.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlanningAim {
    /// Any plan, as soon as possible.
    #[default]
    Plan,
    /// A plan that is proved to be the cheapest. Only Fast Downward supports this aim.
    CheapestPlan,
}

/// Options of an engine's run: limits on time and memory, and the aim of planning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EngineOptions {
    /// Limit on the wall-clock time of planning, from the call on; `None` for no limit. An engine
    /// that still runs then is killed.
    pub time_limit: Option<Duration>,
    /// Limit on the address space of each of the engine's processes, in bytes; `None` for no limit.
    /// A process that needs more fails to allocate memory.
    pub memory_limit: Option<u64>,
    /// Kind of plan that the engine must find.
    pub aim: PlanningAim,
}

impl Default for EngineOptions {
    /// Returns the default options: no time limit, 2 GiB of memory as for the embedded planner, and
    /// any plan as soon as possible.
    fn default() -> EngineOptions {
        EngineOptions { time_limit: None, memory_limit: Some(2 << 30), aim: PlanningAim::Plan }
    }
}

/// Result of an engine's run: the reason why the run ended, and the plans, the best last.
pub(crate) struct EngineResult {
    pub(crate) ending: Ending,
    pub(crate) plans: Vec<Plan>,
    pub(crate) proven_optimal: bool,
}

/// Context of one run of an engine, for the modules of the different engines.
pub(crate) struct EngineJob<'j> {
    pub(crate) installation: &'j Installation,
    pub(crate) lowered: &'j Lowered,
    pub(crate) options: &'j EngineOptions,
    pub(crate) deadline: Option<Instant>,
    pub(crate) cancel: &'j Cancel,
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
        let launch = EngineLaunch {
            command: &command,
            folder,
            deadline: self.deadline,
            memory_limit: self.options.memory_limit,
        };
        let run = crate::process::run(&launch, self.cancel).map_err(|err| self.failed(err))?;
        match run.code() {
            // The shell could not execute the engine, for a reason other than memory.
            Some(126 | 127) if !run.wants_memory() => {
                Err(self.failed(std::io::Error::other(run.last_output_line())))
            }
            _ => Ok(run),
        }
    }

    /// Returns the ending of a run if the engine's exit code and output do not explain it: the run
    /// reached a limit or was cancelled. Returns an error if the engine failed.
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
