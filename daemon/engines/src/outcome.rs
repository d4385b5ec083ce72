//! The result of an engine's run: a valid plan, or the reason why there is none.
//!
//! An ending distinguishes a proof from giving up, and giving up from reaching a limit.

use std::fmt;
use std::path::PathBuf;

use pddl::{Diagnostic, Plan};
use planner::{Fault, Unsupported};

use crate::planning::ExternalEngine;

/// The result of one run.
#[derive(Clone, Debug)]
pub struct EngineOutcome {
    /// A plan with the task's own names that the independent validator has accepted, with the cost that
    /// the validator computes.
    pub plan: Option<Plan>,
    /// Why the run ended.
    pub ending: Ending,
    /// Whether it is proved that no cheaper plan exists: by the engine, if it was asked for a proof.
    pub proven_optimal: bool,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// A goal state was reached.
    GoalReached,
    /// No plan exists, which the engine has proved.
    Unsolvable {
        /// Whether this was found while the task was translated, before the search.
        before_search: bool,
    },
    /// The engine gave up: it searched as far as its search goes, which is *not* a proof.
    Exhausted,
    /// The limit on memory was reached.
    OutOfMemory,
    /// The limit on time was reached.
    OutOfTime,
    /// The caller set [`planner::Cancel`].
    Cancelled,
}

/// The reason why there is no outcome at all. Messages complete “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The texts have mistakes.
    #[error("read the domain and the problem{}", MistakeSuffix(.0))]
    BadInput(Vec<Diagnostic>),
    /// The task has a feature that this engine does not support.
    #[error("plan with {}: {engine} does not support it", unsupported.feature)]
    Unsupported {
        /// The engine.
        engine: ExternalEngine,
        /// The feature and its place.
        unsupported: Unsupported,
    },
    /// The engine itself reports that the task is beyond it, without a place.
    #[error("plan with {engine}, which says: {said}")]
    Beyond {
        /// The engine.
        engine: ExternalEngine,
        /// The engine's message.
        said: String,
    },
    /// The engine is not installed.
    #[error("find {engine}{}", PathSuffix(configured))]
    NotFound {
        /// The engine.
        engine: ExternalEngine,
        /// The configured path, if there is one.
        configured: Option<PathBuf>,
    },
    /// The engine or its folder could not be set up.
    #[error("run {engine}")]
    Run {
        /// The engine.
        engine: ExternalEngine,
        /// The cause.
        #[source]
        source: std::io::Error,
    },
    /// The engine failed.
    #[error("get an answer from {engine}, which ended with {status}{}", TextSuffix(said))]
    BrokeDown {
        /// The engine.
        engine: ExternalEngine,
        /// Its exit code or signal.
        status: String,
        /// The last line of its output.
        said: String,
    },
    /// The engine's plan is not valid. It is not returned.
    #[error("confirm the plan of {engine}: {fault}")]
    WrongPlan {
        /// The engine.
        engine: ExternalEngine,
        /// The fault that the validator found.
        fault: Box<Fault>,
    },
    /// The engine's plan cannot be parsed.
    #[error("read the plan of {engine}: {problem}")]
    UnreadablePlan {
        /// The engine.
        engine: ExternalEngine,
        /// The mistake in it.
        problem: String,
    },
}

// === impl Ending ===

impl Ending {
    /// Returns the exit code that planners in the field use for it; `None` for a cancelled run.
    pub fn exit_code(self) -> Option<u8> {
        match self {
            Ending::GoalReached => Some(0),
            Ending::Unsolvable { before_search: true } => Some(10),
            Ending::Unsolvable { before_search: false } => Some(11),
            Ending::Exhausted => Some(12),
            Ending::OutOfMemory => Some(22),
            Ending::OutOfTime => Some(23),
            Ending::Cancelled => None,
        }
    }
}

impl fmt::Display for Ending {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Ending::GoalReached => "goal reached",
            Ending::Unsolvable { before_search: true } => "proven unsolvable before search",
            Ending::Unsolvable { before_search: false } => "proven unsolvable",
            Ending::Exhausted => "search ended without a plan or a proof",
            Ending::OutOfMemory => "out of memory",
            Ending::OutOfTime => "out of time",
            Ending::Cancelled => "cancelled",
        })
    }
}

// === impl EngineError ===

impl EngineError {
    /// Returns advice for the user; `None` if there is none.
    pub fn help(&self) -> Option<String> {
        match self {
            EngineError::NotFound { engine, .. } => Some(engine.how_to_get().to_owned()),
            EngineError::Unsupported { .. } | EngineError::Beyond { .. } => {
                Some("the embedded engine may be able to".to_owned())
            }
            _ => None,
        }
    }
}

/// Formats each mistake as `; MISTAKE`.
struct MistakeSuffix<'e>(&'e [Diagnostic]);

impl fmt::Display for MistakeSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|mistake| write!(f, "; {mistake}"))
    }
}

/// Formats the path as ` at PATH`, if there is one.
struct PathSuffix<'e>(&'e Option<PathBuf>);

impl fmt::Display for PathSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|path| write!(f, " at `{}`", path.display()))
    }
}

/// Formats the text as `: TEXT`, if it is not empty.
struct TextSuffix<'e>(&'e str);

impl fmt::Display for TextSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, ": {}", self.0) }
    }
}
