//! Result of a planning call: a plan or the reason why there is none, and statistics.
//!
//! “Unsolvable” (proved) and “gave up” (limit reached) are different reasons: only
//! [`StopReason::Unsolvable`] is a proof.

use std::fmt;

use pddl::{Diagnostic, Plan, Span};

use crate::validate::Fault;

/// Result of one planning call, with its stop reason and statistics.
#[derive(Clone, Debug)]
pub struct PlanningOutcome {
    /// Plan with its cost, which the independent validator has accepted; `None` if no plan was
    /// found.
    pub plan: Option<Plan>,
    /// Reason why the call ended; [`StopReason::GoalReached`] if and only if there is a plan.
    pub stop_reason: StopReason,
    /// Reason why the plan is not proved to be optimal although [`crate::Effort::Optimal`] was
    /// requested: a limit, or [`StopReason::Exhausted`] if the costs allow no proof. `None` if the
    /// plan is proved to be optimal, if there is no plan, or if no proof was requested.
    pub unproven: Option<StopReason>,
    /// Property of the costs that makes a proof of optimality impossible; `None` if there is no
    /// such property. Always set if [`PlanningOutcome::unproven`] is [`StopReason::Exhausted`]
    /// because of this property.
    pub unprovable: Option<Unprovable>,
    /// Amount of work of the planning call.
    pub statistics: Statistics,
    /// Warnings about constructs in the domain or the problem that the author probably did not
    /// intend.
    pub warnings: Vec<Diagnostic>,
}

/// Progress event of a running planning call.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PlanningProgress<'n> {
    /// Grounding is finished; the search begins.
    Ground {
        /// Number of facts, as in [`Statistics::facts`].
        facts: usize,
        /// Number of operators, as in [`Statistics::operators`].
        operators: usize,
    },
    /// The search is running; this event is repeated.
    Searching {
        /// Number of states that the current search has expanded. The count starts again with each
        /// search; there are several if better plans are requested.
        expansions: u64,
    },
    /// A validated plan was found that is cheaper than all earlier plans. The event occurs more
    /// than once only if [`crate::Options::effort`] requests better plans.
    Plan(&'n Plan),
}

/// Reason why a planning call ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopReason {
    /// A goal state was reached.
    GoalReached,
    /// No plan exists. This is a proof.
    Unsolvable {
        /// Whether the proof needed no search, because even the delete relaxation of the initial
        /// state has no plan.
        before_search: bool,
    },
    /// No state was left to expand, but pruning or a cost bound had excluded some states. This is
    /// *not* a proof that no plan exists.
    Exhausted,
    /// The limit on expansions was reached.
    ExpansionLimit {
        /// The limit that was reached: the number of states that may be expanded.
        limit: u64,
    },
    /// The limit on the work of grounding was reached.
    JoinStepLimit {
        /// The limit that was reached: the number of candidate tuples that the joins of grounding
        /// may visit.
        limit: u64,
    },
    /// The limit on memory was reached.
    MemoryLimit {
        /// The limit that was reached, in bytes.
        limit: usize,
    },
    /// The limit on the work of validating a plan was reached, so the plan is not returned.
    ValidationLimit {
        /// The limit that was reached: the number of steps that the evaluation of conditions may
        /// take while a plan is validated.
        limit: u64,
    },
    /// The search ended without a plan, but numbers were rounded on the way: with all of their digits
    /// there may be one.
    Rounded,
    /// The caller set the [`crate::Cancel`] flag.
    Cancelled,
}

/// Property of a task's costs that makes a proof of optimality impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unprovable {
    /// The metric is not a weighted sum.
    NoSum,
    /// The cost of a step depends on the state.
    Varies,
    /// A step has a negative cost, so a plan with more steps may be cheaper.
    NegativeCosts,
    /// A cost has more than six decimal places.
    TooFine,
    /// Costs are too large to be added without rounding.
    TooLarge,
}

/// Amount of work of a planning call. All values are counts, not times, and are the same in every
/// run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Number of facts of the ground task, without facts that cannot change.
    pub facts: usize,
    /// Number of operators of the ground task.
    pub operators: usize,
    /// Number of candidate tuples that the joins of grounding visited.
    pub join_steps: u64,
    /// Number of states that the first search expanded.
    pub expansions: u64,
    /// Number of states that the first search evaluated.
    pub evaluations: u64,
    /// Number of states that the optimal search expanded after the first search.
    pub optimal_expansions: u64,
    /// Whether the search has proved that no plan is cheaper than the returned plan, and that no
    /// plan of the same cost has fewer steps.
    pub proven_optimal: bool,
}

/// Error that ended a planning call without an outcome.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum PlanError {
    /// The texts use a feature that this planner does not support. Such a feature is never ignored.
    Unsupported(Unsupported),
    /// The texts contain mistakes. Those of the problem are reported only if the domain has none.
    BadInput(Vec<Diagnostic>),
    /// The validator rejected a plan of this planner, which is a defect of the planner.
    Internal(Box<Fault>),
}

/// A feature of PDDL that this planner does not support.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unsupported {
    /// Name of the unsupported feature, in the terms of PDDL.
    pub feature: String,
    /// Place in the text where the feature is used.
    pub span: Span,
    /// Text that `span` refers to: the domain or the problem.
    pub text: InputText,
}

/// One of the two input texts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputText {
    /// The text of the domain.
    Domain,
    /// The text of the problem.
    Problem,
}

// === impl PlanningOutcome ===

impl PlanningOutcome {
    /// Returns the process exit code for the outcome. The codes are those of Fast Downward, except
    /// if a plan lacks the requested proof of optimality. The code is then 1 if a memory limit was
    /// the reason, 2 if the call was cancelled, and 4 otherwise.
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
    /// Returns the reason for a planning call in which sums lost digits, if `is_rounded`: what is
    /// proven with rounded numbers is not proven.
    pub(crate) fn if_rounded(self, is_rounded: bool) -> StopReason {
        match self {
            StopReason::Unsolvable { .. } if is_rounded => StopReason::Rounded,
            reason => reason,
        }
    }

    /// Whether the stop reason is a limit that grounding can reach.
    pub(crate) fn is_limit_of_grounding(self) -> bool {
        matches!(self, StopReason::MemoryLimit { .. } | StopReason::JoinStepLimit { .. })
    }

    /// Returns the process exit code for the stop reason, as in Fast Downward.
    pub fn exit_code(self) -> u8 {
        match self {
            StopReason::GoalReached => 0,
            StopReason::Unsolvable { before_search: true } => 10,
            StopReason::Unsolvable { before_search: false } => 11,
            StopReason::Exhausted
            | StopReason::Rounded
            | StopReason::ExpansionLimit { .. }
            | StopReason::JoinStepLimit { .. }
            | StopReason::ValidationLimit { .. } => 12,
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
            StopReason::Rounded => f.write_str(
                "ended without a plan; this is no proof, because sums were rounded to fifteen digits",
            ),
            StopReason::ExpansionLimit { limit } => write!(f, "stopped at {limit} expansions"),
            StopReason::JoinStepLimit { limit } => {
                write!(f, "stopped at {limit} join steps of grounding")
            }
            StopReason::ValidationLimit { limit } => {
                write!(f, "stopped at {limit} steps of validating a plan")
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
            Unprovable::NegativeCosts => {
                "some step improves the metric, so that a plan with more steps may be better"
            }
            Unprovable::TooFine => "the cost of a step has more than six decimal places",
            Unprovable::TooLarge => "the costs are too large to be added without rounding",
        })
    }
}

// === impl PlanError ===

impl PlanError {
    /// Returns the exit code of `althing plan` for this error.
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
            PlanError::Internal(fault) => write!(f, "confirm a plan of this planner: {fault}"),
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
    /// Whether the name of the feature is a plural, so that a sentence about it uses `are`.
    pub fn is_plural(&self) -> bool {
        let is_one = self.feature.starts_with("a ") || self.feature.starts_with("an ");
        self.feature.ends_with('s') && !is_one
    }

    pub(crate) fn in_domain(feature: impl Into<String>, span: Span) -> Unsupported {
        Unsupported { feature: feature.into(), span, text: InputText::Domain }
    }

    pub(crate) fn in_problem(feature: impl Into<String>, span: Span) -> Unsupported {
        Unsupported { feature: feature.into(), span, text: InputText::Problem }
    }
}

impl fmt::Display for Unsupported {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "plan with {}: not supported", self.feature)
    }
}

impl std::error::Error for Unsupported {}
