//! What comes of an engine's run: a plan that works, or the reason why there is none.
//!
//! An ending tells proof from resignation, and resignation from a limit of ours.

use std::fmt;
use std::path::PathBuf;

use pddl::{Diagnostic, Plan};
use planner::{Fault, Unsupported};

use crate::planning::Engine;

/// The result of one run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A plan in the task's own names that the independent validator has accepted, with the cost
    /// that the validator finds.
    pub plan: Option<Plan>,
    /// Why the run ended.
    pub ending: Ending,
    /// Whether no cheaper plan exists. The engine's proof, where it was asked for one.
    pub proven_optimal: bool,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// A goal state was reached.
    GoalReached,
    /// No plan exists, and the engine has proven it.
    Unsolvable {
        /// Whether its translation of the task already showed it.
        before_search: bool,
    },
    /// The engine gave up: it searched all it wanted to, which is *not* a proof.
    Exhausted,
    /// The limit on memory was reached.
    OutOfMemory,
    /// The limit on time was reached.
    OutOfTime,
    /// The caller set [`planner::Cancel`].
    Cancelled,
}

/// Why there is no outcome at all. Messages complete “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The texts do not make sense.
    #[error("read the domain and the problem{}", Listed(.0))]
    BadInput(Vec<Diagnostic>),
    /// The text means something that this engine does not do.
    #[error("plan with {}: {engine} does not support it", unsupported.feature)]
    Unsupported {
        /// Which engine.
        engine: Engine,
        /// What, and where.
        unsupported: Unsupported,
    },
    /// The engine itself says that the task is beyond it; it knows no place.
    #[error("plan with {engine}, which says: {said}")]
    Beyond {
        /// Which engine.
        engine: Engine,
        /// In its words.
        said: String,
    },
    /// The engine is not installed.
    #[error("find {engine}{}", At(configured))]
    NotFound {
        /// Which engine.
        engine: Engine,
        /// Where it was configured to be, if it was.
        configured: Option<PathBuf>,
    },
    /// The engine or its folder could not be set up.
    #[error("run {engine}")]
    Run {
        /// Which engine.
        engine: Engine,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The engine broke down.
    #[error("get an answer from {engine}, which ended with {status}{}", Said(said))]
    BrokeDown {
        /// Which engine.
        engine: Engine,
        /// Its exit code or signal.
        status: String,
        /// The last it said.
        said: String,
    },
    /// The engine's plan does not work. It is not returned.
    #[error("confirm the plan of {engine}: {fault}")]
    WrongPlan {
        /// Which engine.
        engine: Engine,
        /// What does not hold.
        fault: Box<Fault>,
    },
    /// The engine's plan is not one that can be read.
    #[error("read the plan of {engine}: {problem}")]
    UnreadablePlan {
        /// Which engine.
        engine: Engine,
        /// What is wrong with it.
        problem: String,
    },
}

// === impl Ending ===

impl Ending {
    /// The exit code that the field's planners use for it; of a cancelled run there is none.
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
    /// What to do about it, where there is something.
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

/// `; MISTAKE` for each.
struct Listed<'e>(&'e [Diagnostic]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|mistake| write!(f, "; {mistake}"))
    }
}

/// ` at PATH`, if there is one.
struct At<'e>(&'e Option<PathBuf>);

impl fmt::Display for At<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|path| write!(f, " at `{}`", path.display()))
    }
}

/// `: WORDS`, if there are any.
struct Said<'e>(&'e str);

impl fmt::Display for Said<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, ": {}", self.0) }
    }
}
