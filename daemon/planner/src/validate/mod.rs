//! An independent check of plans: does every step apply, and does the goal hold at the end?
//!
//! - Reads the lifted texts directly: all of ADL, axioms, numbers. It shares no code with grounding
//!   and search, so a mistake there is caught here.
//! - Every plan of this crate passes through it before anybody sees it.
//! - Leaves out time: durative actions and timed initial literals are faults.

mod axioms;
pub(crate) mod bindings;
mod compile;
mod compiled;
mod effects;
mod failing;
mod footprint;
pub(crate) mod model;
mod numbers;
mod query;
mod rules;
mod steps;
mod symbols;
mod table;
mod world;

pub(crate) use footprint::Footprint;

use std::fmt;

use pddl::{
    Condition, Diagnostic, Domain, FluentTerm, Name, Plan, PlanStep, Problem, Span, TypeExpr,
};

pub use world::World;

/// What the check found.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Every step applies and the goal holds at the end.
    Valid {
        /// What the metric says; the number of steps where there is none.
        cost: f64,
        /// How many steps.
        steps: usize,
    },
    /// Something does not hold.
    Fault(Box<Fault>),
    /// The texts have no initial state to start from.
    BadInput(Vec<Diagnostic>),
}

/// Why a plan does not work.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Where in the plan.
    pub place: Place,
    /// Why.
    pub reason: FaultReason,
    /// The step in the plan's text, or the metric in the problem's.
    pub span: Span,
}

/// A place in a plan.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// A step.
    Step {
        /// Its position, from 0.
        index: usize,
        /// Itself.
        step: PlanStep,
    },
    /// The end, where the goal must hold.
    Goal,
    /// The end, where the metric is read.
    Metric,
}

/// Why a step does not apply, or the end is not the wanted one.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FaultReason {
    /// No action has this name.
    UnknownAction,
    /// The action is durative; this check knows no time.
    Durative,
    /// Too few or too many arguments.
    ArgumentCount {
        /// What the action has, its agent included.
        expected: usize,
        /// What the step has.
        found: usize,
    },
    /// No object has this name.
    UnknownObject(Name),
    /// The object is of another type.
    WrongType {
        /// The object.
        object: Name,
        /// The parameter's type.
        expected: TypeExpr,
    },
    /// The smallest part of the precondition that does not hold, with objects for variables.
    Precondition(Condition),
    /// The smallest part of the goal that does not hold.
    Goal(Condition),
    /// A fluent is read or changed that has no value, or whose value is no finite number.
    Undefined(FluentTerm),
    /// An effect divides a fluent by zero, or takes it beyond the greatest number.
    NotFinite(FluentTerm),
    /// Effects of one step contradict each other on a fluent.
    Conflict(FluentTerm),
}

/// Checks a plan.
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

/// What steps cost that lead from a state to a goal: what the metric says, or their number where there
/// is none.
pub fn cost_from(world: &World, steps: &[PlanStep], goal: &Condition) -> Result<f64, Box<Fault>> {
    run(world.clone(), steps, goal).and_then(|end| end.cost())
}

/// Whether the rest of a plan still leads from a state to a goal.
pub fn rest_reaches(world: &World, steps: &[PlanStep], goal: &Condition) -> Result<(), Box<Fault>> {
    run(world.clone(), steps, goal).map(|_| ())
}

fn run(mut world: World, steps: &[PlanStep], goal: &Condition) -> Result<World, Box<Fault>> {
    for step in steps {
        world.apply(step)?;
    }
    match world.failing(goal) {
        None => Ok(world),
        Some(condition) => Err(Box::new(Fault {
            place: Place::Goal,
            reason: FaultReason::Goal(condition),
            span: Span::default(),
        })),
    }
}

// === impl Fault ===

impl std::error::Error for Fault {}

impl Fault {
    /// The same with the part of the goal or precondition that does not hold in other words.
    #[must_use]
    pub fn map(self, words: impl FnOnce(&Condition) -> Condition) -> Fault {
        let reason = match &self.reason {
            FaultReason::Precondition(part) => FaultReason::Precondition(words(part)),
            FaultReason::Goal(part) => FaultReason::Goal(words(part)),
            _ => return self,
        };
        Fault { reason, ..self }
    }

    /// The part of the goal or precondition that does not hold, if that is the reason.
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

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Step { index, step } => write!(f, "step {} {step}", index + 1),
            Place::Goal => f.write_str("goal"),
            Place::Metric => f.write_str("metric"),
        }
    }
}

impl fmt::Display for FaultReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FaultReason::UnknownAction => f.write_str("no action has this name"),
            FaultReason::Durative => f.write_str("durative actions are not checked"),
            FaultReason::ArgumentCount { expected, found } => {
                write!(f, "takes {expected} arguments, not {found}")
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
        }
    }
}
