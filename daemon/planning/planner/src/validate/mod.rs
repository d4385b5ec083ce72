//! Independent plan validation: checks that every step is applicable, and that the goal holds at
//! the end.
//!
//! - The validator interprets the parsed domain and problem directly, with all of ADL, axioms and
//!   numbers. It shares no code with grounding and search, so that a mistake there is detected
//!   here.
//! - Every plan of this crate is validated before it is returned.
//! - Time is not supported: durative actions and timed initial literals are faults.

mod axiom_rules;
mod axioms;
pub(crate) mod bindings;
mod compile;
mod compiled;
mod effects;
mod failing_part;
mod footprint;
mod foreign_changes;
pub(crate) mod model;
mod numeric_values;
mod query;
mod steps;
mod symbols;
mod tuple_table;
mod work_meter;
mod world;

pub(crate) use footprint::Footprint;

use std::fmt;

use pddl::{
    Condition, Diagnostic, Domain, FluentTerm, Name, Plan, PlanStep, Problem, Span, TypeExpr,
};

pub use world::World;

/// Result of validating a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The plan is valid: every step is applicable, and the goal holds at the end.
    Valid {
        /// Cost of the plan: the value of the metric, or the number of steps if there is no metric.
        cost: f64,
        /// Number of steps of the plan.
        steps: usize,
    },
    /// The plan is not valid.
    Fault(Box<Fault>),
    /// The texts do not define an initial state. The diagnostics give the reasons.
    BadInput(Vec<Diagnostic>),
}

/// Reason why a plan is not valid, and the step at which it fails.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Place in the plan at which the fault was found.
    pub place: FaultPlace,
    /// Reason why the plan is not valid.
    pub reason: FaultReason,
    /// Position in a text: of the step with the fault in the plan, or of the metric in the problem.
    pub span: Span,
}

/// A place in a plan at which a fault was found.
#[derive(Clone, Debug, PartialEq)]
pub enum FaultPlace {
    /// A step of the plan.
    Step {
        /// Position of the step in the plan, from 0.
        index: usize,
        /// The step.
        step: PlanStep,
    },
    /// The end of the plan, where the goal is checked.
    Goal,
    /// The end of the plan, where the metric is evaluated.
    Metric,
}

/// Reason why a step is not applicable, or why the state at the end does not satisfy the goal.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FaultReason {
    /// No action has the name given in the step.
    UnknownAction,
    /// The action of the step is durative; the validator does not support time.
    Durative,
    /// The step has a wrong number of arguments.
    ArgumentCount {
        /// Number of parameters of the action, including its agent.
        expected: usize,
        /// Number of arguments of the step.
        found: usize,
    },
    /// An argument of the step is not a declared object.
    UnknownObject(Name),
    /// An argument does not have the type of its parameter.
    WrongType {
        /// The object that is the argument.
        object: Name,
        /// The type of the parameter.
        expected: TypeExpr,
    },
    /// The precondition of the step does not hold. The value is its smallest failing part, with
    /// variables replaced by objects.
    Precondition(Condition),
    /// The goal does not hold at the end. The value is its smallest failing part, with variables
    /// replaced by objects.
    Goal(Condition),
    /// A numeric effect or the metric requires the value of a fluent or an expression that has no
    /// finite value.
    Undefined(FluentTerm),
    /// The new value of a fluent is not finite: a scaling divides by zero, or the number is out of
    /// range.
    NotFinite(FluentTerm),
    /// Several effects of one step give the same fluent values that contradict each other.
    Conflict(FluentTerm),
    /// The evaluation reached the limit of [`World::limit_work`] or was cancelled. It is not known
    /// whether the plan is valid.
    WorkLimit {
        /// The limit that was reached, in evaluation steps.
        limit: u64,
    },
}

/// Validates a plan from the initial state of the problem.
pub fn validate(domain: &Domain, problem: &Problem, plan: &Plan) -> Verdict {
    let world = match World::initial(domain, problem) {
        Ok(world) => world,
        Err(diagnostics) => return Verdict::BadInput(diagnostics),
    };
    match cost_from(&world, &plan.steps, &problem.goal) {
        Ok(cost) => Verdict::Valid { cost, steps: plan.steps.len() },
        Err(fault) => Verdict::Fault(fault),
    }
}

/// Returns the cost of executing `steps` from a state to a goal: the value of the metric, or the
/// number of steps if there is no metric.
///
/// # Errors
///
/// Returns a fault if a step is not applicable, if the goal does not hold at the end, or if the
/// metric has no value at the end.
pub fn cost_from(world: &World, steps: &[PlanStep], goal: &Condition) -> Result<f64, Box<Fault>> {
    run(world.clone(), steps, goal).and_then(|end| end.cost())
}

/// Checks that the remaining steps of a plan lead from the state `world` to the goal.
///
/// # Errors
///
/// Returns a fault if a step is not applicable, or if the goal does not hold at the end.
pub fn rest_reaches(world: &World, steps: &[PlanStep], goal: &Condition) -> Result<(), Box<Fault>> {
    run(world.clone(), steps, goal).map(|_| ())
}

fn run(mut world: World, steps: &[PlanStep], goal: &Condition) -> Result<World, Box<Fault>> {
    for step in steps {
        world.apply(step)?;
    }
    let failing = world.failing(goal);
    let reason = match (failing, world.work_limit_reached()) {
        (_, Some(limit)) => FaultReason::WorkLimit { limit },
        (None, None) => return Ok(world),
        (Some(condition), None) => FaultReason::Goal(condition),
    };
    Err(Box::new(Fault { place: FaultPlace::Goal, reason, span: Span::default() }))
}

// === impl Fault ===

impl std::error::Error for Fault {}

impl Fault {
    /// Returns the fault with the failing part of the goal or precondition replaced by the result
    /// of `words` for it.
    #[must_use]
    pub fn map(self, words: impl FnOnce(&Condition) -> Condition) -> Fault {
        let reason = match &self.reason {
            FaultReason::Precondition(part) => FaultReason::Precondition(words(part)),
            FaultReason::Goal(part) => FaultReason::Goal(words(part)),
            _ => return self,
        };
        Fault { reason, ..self }
    }

    /// Returns the part of the goal or precondition that does not hold; `None` for any other kind
    /// of fault.
    pub fn condition(&self) -> Option<&Condition> {
        match &self.reason {
            FaultReason::Precondition(condition) | FaultReason::Goal(condition) => Some(condition),
            _ => None,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.reason)
    }
}

impl fmt::Display for FaultPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FaultPlace::Step { index, step } => write!(f, "step {} {step}", index + 1),
            FaultPlace::Goal => f.write_str("goal"),
            FaultPlace::Metric => f.write_str("metric"),
        }
    }
}

impl fmt::Display for FaultReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FaultReason::UnknownAction => f.write_str("no action has this name"),
            FaultReason::Durative => f.write_str("durative actions are not checked"),
            FaultReason::ArgumentCount { expected, found } => {
                write!(f, "takes {}, not {found}", pddl::check::count(*expected, "argument"))
            }
            FaultReason::UnknownObject(name) => write!(f, "no object is called `{name}`"),
            FaultReason::WrongType { object, expected } => {
                write!(f, "`{object}` is not of type {expected}")
            }
            FaultReason::Precondition(condition) | FaultReason::Goal(condition) => {
                write!(f, "{condition} does not hold")
            }
            FaultReason::Undefined(fluent) => write!(f, "{fluent} has no value"),
            FaultReason::NotFinite(fluent) => {
                write!(f, "its effect on {fluent} has no value: a division by zero, or too large")
            }
            FaultReason::Conflict(fluent) => {
                write!(f, "effects contradict each other on {fluent}")
            }
            FaultReason::WorkLimit { limit } => {
                write!(f, "evaluating its quantifiers takes more than {limit} steps")
            }
        }
    }
}
