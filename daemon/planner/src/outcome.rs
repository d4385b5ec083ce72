//! What comes out of a planning call: a plan or the reason why there is none, and what it took.
//!
//! A reason tells proof from resignation: only [`StopReason::Unsolvable`] is a proof.

use std::fmt;

use pddl::{Diagnostic, Plan, Span};

use crate::validate::Fault;

/// The result of one call. There is always a reason and always statistics.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A plan that the independent validator has accepted, with its cost.
    pub plan: Option<Plan>,
    /// Why the call ended; [`StopReason::GoalReached`] if and only if there is a plan.
    pub stop_reason: StopReason,
    /// Why the plan is not proven to be the cheapest, where [`crate::Effort::Optimal`] asked for that:
    /// a limit, or [`StopReason::Exhausted`] where the costs allow no proof.
    pub unproven: Option<StopReason>,
    /// What of the costs allows no proof that a plan is the cheapest; set wherever that is why
    /// [`Outcome::unproven`] is [`StopReason::Exhausted`].
    pub unprovable: Option<Unprovable>,
    /// What it took.
    pub statistics: Statistics,
    /// What the author of the domain or problem may not have meant.
    pub warnings: Vec<Diagnostic>,
}

/// What a call tells while it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum News<'n> {
    /// The texts are ground; now they are solved.
    Ground {
        /// As [`Statistics::facts`].
        facts: usize,
        /// As [`Statistics::operators`].
        operators: usize,
    },
    /// A search goes on.
    Searching {
        /// States that this one has expanded; there are several where better plans are wanted.
        expansions: u64,
    },
    /// A validated plan, cheaper than those before it. There is more than one only where
    /// [`crate::Options::effort`] asks for it.
    Plan(&'n Plan),
}

/// Why a call ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopReason {
    /// A goal state was reached.
    GoalReached,
    /// No plan exists. This is a proof.
    Unsolvable {
        /// Whether the relaxation of the initial state already showed it.
        before_search: bool,
    },
    /// The search ran dry under pruning or a bound. This is *not* a proof.
    Exhausted,
    /// The cap on expansions was reached.
    ExpansionLimit {
        /// The cap.
        limit: u64,
    },
    /// The cap on grounding work was reached.
    JoinStepLimit {
        /// The cap.
        limit: u64,
    },
    /// The cap on memory was reached.
    MemoryLimit {
        /// The cap, in bytes.
        limit: usize,
    },
    /// The caller set [`crate::Cancel`].
    Cancelled,
}

/// What of a task's costs allows no proof that a plan is the cheapest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unprovable {
    /// The metric is more than a weighted sum.
    NoSum,
    /// What some step costs depends on the state.
    Varies,
    /// Some step costs less than nothing, so that a plan with more steps may be cheaper.
    Pays,
    /// Some cost has more than six decimal places.
    TooFine,
    /// Costs are too large to be added without rounding.
    TooLarge,
}

/// What a call took. Counts, not times: they repeat exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Facts of the ground task, after those that cannot change are gone.
    pub facts: usize,
    /// Operators of the ground task.
    pub operators: usize,
    /// Candidate tuples that grounding looked at.
    pub join_steps: u64,
    /// States expanded by the first search.
    pub expansions: u64,
    /// States evaluated by the first search.
    pub evaluations: u64,
    /// States expanded by the optimal search that followed.
    pub optimal_expansions: u64,
    /// Whether no cheaper plan exists, and no shorter one of the same cost. This is a proof.
    pub proven_optimal: bool,
}

/// Why a call could not plan at all.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// The text means something that this planner does not do; it never answers as if it did.
    Unsupported(Unsupported),
    /// The texts do not make sense: mistakes of the domain or, if it has none, of the problem.
    BadInput(Vec<Diagnostic>),
    /// The validator refused a plan of our own making: a defect of the planner.
    Internal(Box<Fault>),
}

/// A feature of PDDL that this planner does not do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unsupported {
    /// Its name, in the words of PDDL.
    pub feature: String,
    /// Where it is used.
    pub span: Span,
    /// In which of the two texts.
    pub text: Text,
}

/// Which of the two texts a place is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Text {
    /// The domain.
    Domain,
    /// The problem.
    Problem,
}

// === impl Outcome ===

impl Outcome {
    /// The exit code that the field's planners use for it. A plan that is not proven to be the
    /// cheapest, though that was asked for, has one of its own: 1 where memory was the limit, 2 where
    /// time was, 4 otherwise.
    pub fn exit_code(&self) -> u8 {
        match self.unproven {
            None => self.stop_reason.exit_code(),
            Some(StopReason::MemoryLimit { .. }) => 1,
            Some(StopReason::Cancelled) => 2,
            Some(_) => 4,
        }
    }
}

// === impl StopReason ===

impl StopReason {
    /// Whether grounding took more than it may.
    pub(crate) fn is_limit_of_grounding(self) -> bool {
        matches!(self, StopReason::MemoryLimit { .. } | StopReason::JoinStepLimit { .. })
    }

    /// The exit code that the field's planners use for it.
    pub fn exit_code(self) -> u8 {
        match self {
            StopReason::GoalReached => 0,
            StopReason::Unsolvable { before_search: true } => 10,
            StopReason::Unsolvable { before_search: false } => 11,
            StopReason::Exhausted
            | StopReason::ExpansionLimit { .. }
            | StopReason::JoinStepLimit { .. } => 12,
            StopReason::MemoryLimit { .. } => 22,
            StopReason::Cancelled => 23,
        }
    }
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StopReason::GoalReached => f.write_str("goal reached"),
            StopReason::Unsolvable { before_search: true } => {
                f.write_str("proven unsolvable before search")
            }
            StopReason::Unsolvable { before_search: false } => f.write_str("proven unsolvable"),
            StopReason::Exhausted => f.write_str("search ended without a plan or a proof"),
            StopReason::ExpansionLimit { limit } => write!(f, "stopped at {limit} expansions"),
            StopReason::JoinStepLimit { limit } => {
                write!(f, "stopped at {limit} join steps of grounding")
            }
            StopReason::MemoryLimit { limit } => write!(f, "stopped at {limit} bytes of memory"),
            StopReason::Cancelled => f.write_str("cancelled"),
        }
    }
}

impl fmt::Display for Unprovable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unprovable::NoSum => "the metric is not a weighted sum",
            Unprovable::Varies => "the cost of a step depends on the state",
            Unprovable::Pays => {
                "some step improves the metric, so that a plan with more steps may be better"
            }
            Unprovable::TooFine => "the cost of a step has more than six decimal places",
            Unprovable::TooLarge => "the costs are too large to be added without rounding",
        })
    }
}

// === impl PlanError ===

impl PlanError {
    /// The exit code of `althing plan` for it.
    pub fn exit_code(&self) -> u8 {
        match self {
            PlanError::Unsupported(_) => 34,
            PlanError::BadInput(_) => 33,
            PlanError::Internal(_) => 32,
        }
    }
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PlanError::Unsupported(unsupported) => unsupported.fmt(f),
            PlanError::BadInput(diagnostics) => {
                f.write_str("read the domain and the problem")?;
                diagnostics.iter().try_for_each(|diagnostic| write!(f, "; {diagnostic}"))
            }
            PlanError::Internal(fault) => write!(f, "confirm a plan of our own making: {fault}"),
        }
    }
}

impl std::error::Error for PlanError {}

impl From<Unsupported> for PlanError {
    fn from(unsupported: Unsupported) -> PlanError {
        PlanError::Unsupported(unsupported)
    }
}

// === impl Unsupported ===

impl Unsupported {
    /// Whether its name is a plural, so that a sentence about it says `are`.
    pub fn is_plural(&self) -> bool {
        let is_one = self.feature.starts_with("a ") || self.feature.starts_with("an ");
        self.feature.ends_with('s') && !is_one
    }

    pub(crate) fn in_domain(feature: impl Into<String>, span: Span) -> Unsupported {
        Unsupported { feature: feature.into(), span, text: Text::Domain }
    }

    pub(crate) fn in_problem(feature: impl Into<String>, span: Span) -> Unsupported {
        Unsupported { feature: feature.into(), span, text: Text::Problem }
    }
}

impl fmt::Display for Unsupported {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "plan with {}: not supported", self.feature)
    }
}

impl std::error::Error for Unsupported {}
