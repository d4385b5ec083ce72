//! The result of an engine's run: a valid plan, or the reason why there is none.
//!
//! An [`Ending`] distinguishes three cases without a plan: a proof that none exists, a search that
//! gave up, and a limit that was reached.

use std::fmt;
use std::path::PathBuf;

use pddl::{Diagnostic, Plan};
use planner::{Fault, Unsupported};

use crate::engine::ExternalEngine;

/// Result of one run of an engine.
#[derive(Clone, Debug)]
pub struct EngineOutcome {
    /// A plan with the task's own names that the validator of `planner` has accepted, with the cost
    /// that this validator computed; `None` if there is no plan.
    pub plan: Option<Plan>,
    /// Reason why the run of the engine ended.
    pub ending: Ending,
    /// Whether the engine has proved that no cheaper plan exists. A proof is attempted only if the
    /// caller requests it.
    pub proven_optimal: bool,
}

/// Reason why a run of an engine ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The engine reached a goal state, so there is a plan.
    GoalReached,
    /// The engine has proved that no plan exists.
    Unsolvable {
        /// Whether the engine proved this during the translation of the task, before the search.
        before_search: bool,
    },
    /// The search of the engine ended without a plan. This is *not* a proof that none exists.
    Exhausted,
    /// The engine reached the limit on memory.
    OutOfMemory,
    /// The engine reached the limit on time.
    OutOfTime,
    /// The run was cancelled: the caller set [`planner::Cancel`].
    Cancelled,
}

/// Reason why a run has no outcome. The text of each variant completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The texts of the domain and the problem have mistakes.
    #[error("read the domain and the problem{}", MistakeSuffix(.0))]
    BadInput(Vec<Diagnostic>),
    /// The task has a feature that this engine does not support.
    #[error("plan with {}: {engine} does not support it", unsupported.feature)]
    Unsupported {
        /// The engine that does not support the feature.
        engine: ExternalEngine,
        /// Name and place of the unsupported feature.
        unsupported: Unsupported,
    },
    /// The engine reported that it does not support the task, without a place in the task.
    #[error("plan with {engine}, which says: {said}")]
    Beyond {
        /// The engine that does not support the task.
        engine: ExternalEngine,
        /// The message that the engine printed.
        said: String,
    },
    /// The engine is not installed.
    #[error("find {engine}{}", PathSuffix(configured))]
    NotFound {
        /// The engine that is not installed.
        engine: ExternalEngine,
        /// The configured path of the engine, if there is one.
        configured: Option<PathBuf>,
    },
    /// The engine or its folder could not be set up.
    #[error("run {engine}")]
    Run {
        /// The engine that could not be set up.
        engine: ExternalEngine,
        /// The error of the system.
        #[source]
        source: std::io::Error,
    },
    /// The engine failed: it ended without a result.
    #[error("get an answer from {engine}, which ended with {status}{}", TextSuffix(said))]
    BrokeDown {
        /// The engine that failed.
        engine: ExternalEngine,
        /// The exit code or signal with which the engine ended.
        status: String,
        /// The last line of the engine's output.
        said: String,
    },
    /// The validator rejected the engine's plan, which is therefore not returned.
    #[error("confirm the plan of {engine}: {fault}")]
    WrongPlan {
        /// The engine that returned the invalid plan.
        engine: ExternalEngine,
        /// The fault that the validator found in the plan.
        fault: Box<Fault>,
    },
    /// The engine's plan cannot be parsed.
    #[error("read the plan of {engine}: {problem}")]
    UnreadablePlan {
        /// The engine that returned the unreadable plan.
        engine: ExternalEngine,
        /// The mistake in the plan.
        problem: String,
    },
}

// === impl Ending ===

impl Ending {
    /// Returns the exit code that planners in the field use for this ending; `None` for a cancelled
    /// run.
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
    /// Returns advice for the user on this error; `None` if there is none.
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

/// Formats each mistake as `; MISTAKE`, as a suffix of an error's text.
struct MistakeSuffix<'e>(&'e [Diagnostic]);

impl fmt::Display for MistakeSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|mistake| write!(f, "; {mistake}"))
    }
}

/// Formats a path as ` at PATH`, as a suffix of an error's text; empty without a path.
struct PathSuffix<'e>(&'e Option<PathBuf>);

impl fmt::Display for PathSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|path| write!(f, " at `{}`", path.display()))
    }
}

/// Formats a text as `: TEXT`, as a suffix of an error's text; empty for an empty text.
struct TextSuffix<'e>(&'e str);

impl fmt::Display for TextSuffix<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, ": {}", self.0) }
    }
}
