//! Compiled conditions, expressions and effects. Variables are replaced by slots and names by
//! numbers, so that the evaluation compares no strings.
//!
//! Negation occurs only at the leaves. Every quantifier is a [`Query`]: a search for bindings under
//! which several parts hold together. A `forall` holds if its negation has no binding.

use std::sync::Arc;

use pddl::{Assignment, Comparison, FluentTerm, Operator};

use super::symbols::{Extension, Object, RelationId};

/// Index of a variable in a frame, which is the array of all bindings. Each variable of a compiled
/// text has its own slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FrameSlot(pub(super) u32);

/// An argument of a predicate or function.
#[derive(Clone, Copy, Debug)]
pub(super) enum Argument {
    Slot(FrameSlot),
    Object(Object),
}

/// A predicate applied to arguments.
#[derive(Clone, Debug)]
pub(super) struct Fact {
    pub(super) relation: RelationId,
    pub(super) arguments: Box<[Argument]>,
}

/// A compiled condition, in negation normal form.
#[derive(Clone, Debug)]
pub(super) enum CompiledCondition {
    Constant(bool),
    /// Holds if the truth value of the fact is the given one.
    Fact(Fact, bool),
    /// Equality: holds if the two arguments are the same object. If the value is `false`, holds if
    /// they are different objects.
    Equal(Argument, Argument, bool),
    /// Holds if the comparison holds; if the value is `false`, holds if the comparison does not. A
    /// comparison with an undefined side does not hold.
    Compare(Box<CompiledComparison>, bool),
    All(Vec<CompiledCondition>),
    Any(Vec<CompiledCondition>),
    /// Holds if the query has a binding; if the value is `false`, holds if the query has none.
    Exists(Box<Query>, bool),
}

/// A comparison of numbers.
#[derive(Clone, Debug)]
pub(super) struct CompiledComparison {
    pub(super) comparison: Comparison,
    pub(super) left: CompiledExpression,
    pub(super) right: CompiledExpression,
}

/// A conjunctive query: variables, and conditions that must all hold for the same binding.
#[derive(Clone, Debug)]
pub(super) struct Query {
    pub(super) variables: Vec<Variable>,
    /// Conditions of the query, at most [`PARTS_MAX`], the cheapest to evaluate first.
    pub(super) parts: Vec<QueryPart>,
}

/// Maximum number of parts of a query; the parts beyond it are joined to one conjunction. The
/// evaluation represents the set of parts not yet evaluated as the bits of one `u64`.
pub(super) const PARTS_MAX: usize = 64;

/// A variable of a query.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    pub(super) slot: FrameSlot,
    pub(super) extension: Arc<Extension>,
}

/// A conjunct of a query.
#[derive(Clone, Debug)]
pub(super) struct QueryPart {
    pub(super) node: CompiledCondition,
    /// Variables of the query that occur in this part.
    pub(super) slots: Box<[FrameSlot]>,
}

/// A compiled numeric expression.
#[derive(Clone, Debug)]
pub(super) enum CompiledExpression {
    Number(f64),
    Fluent(Box<Fluent>),
    Negate(Box<CompiledExpression>),
    Apply(Operator, Vec<CompiledExpression>),
    TotalTime,
    /// A value such as `?duration`, which only durative actions have. Durative actions are not
    /// compiled, so the value is undefined.
    Unknown(Box<FluentTerm>),
}

/// A function applied to arguments.
#[derive(Clone, Debug)]
pub(super) struct Fluent {
    /// Number of the function. It is `None` if the texts contain no function of this name and
    /// number of arguments, so that the fluent has no value.
    pub(super) function: Option<RelationId>,
    pub(super) arguments: Box<[Argument]>,
    /// The fluent as written in the text, for error messages.
    pub(super) source_term: FluentTerm,
}

/// A compiled effect.
#[derive(Clone, Debug)]
pub(super) enum CompiledEffect {
    All(Vec<CompiledEffect>),
    /// Sets the truth value of a fact.
    Set(Fact, bool),
    Assign(Box<CompiledAssign>),
    When(Box<(CompiledCondition, CompiledEffect)>),
    /// Applies the effect for every binding of the query's variables under which all parts of the
    /// query hold.
    Each(Box<(Query, CompiledEffect)>),
}

/// A compiled numeric effect.
#[derive(Clone, Debug)]
pub(super) struct CompiledAssign {
    pub(super) assignment: Assignment,
    pub(super) fluent: Fluent,
    pub(super) value: CompiledExpression,
}

/// A compiled action schema.
#[derive(Debug)]
pub(super) struct CompiledAction {
    /// Objects allowed for each parameter. The parameters have the first slots of the frame.
    pub(super) parameters: Vec<Arc<Extension>>,
    pub(super) precondition: CompiledCondition,
    pub(super) effect: CompiledEffect,
    pub(super) slot_count: usize,
}

// === impl Argument ===

impl Argument {
    /// Returns the object to which the argument refers; [`Object::UNBOUND`] if the argument is an
    /// unbound variable.
    pub(super) fn value(self, frame: &[Object]) -> Object {
        match self {
            Argument::Slot(slot) => frame[slot.index()],
            Argument::Object(object) => object,
        }
    }
}

// === impl FrameSlot ===

impl FrameSlot {
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl CompiledCondition ===

impl CompiledCondition {
    /// Returns the conjunction of conditions, flattened and simplified.
    pub(super) fn all(nodes: impl IntoIterator<Item = CompiledCondition>) -> CompiledCondition {
        let mut flat = Vec::new();
        for node in nodes {
            match node {
                CompiledCondition::Constant(true) => (),
                CompiledCondition::Constant(false) => return node,
                CompiledCondition::All(parts) => flat.extend(parts),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => CompiledCondition::Constant(true),
            1 => flat.remove(0),
            _ => CompiledCondition::All(flat),
        }
    }

    /// Returns the disjunction of conditions, flattened and simplified.
    pub(super) fn any(nodes: impl IntoIterator<Item = CompiledCondition>) -> CompiledCondition {
        let mut flat = Vec::new();
        for node in nodes {
            match node {
                CompiledCondition::Constant(false) => (),
                CompiledCondition::Constant(true) => return node,
                CompiledCondition::Any(parts) => flat.extend(parts),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => CompiledCondition::Constant(false),
            1 => flat.remove(0),
            _ => CompiledCondition::Any(flat),
        }
    }

    /// Returns the logical complement: it holds if and only if this condition does not. This
    /// differs from `not` in PDDL: if a number is undefined, neither a comparison nor its PDDL
    /// negation holds.
    pub(super) fn complement(self) -> CompiledCondition {
        match self {
            CompiledCondition::Constant(truth) => CompiledCondition::Constant(!truth),
            CompiledCondition::Fact(fact, positive) => CompiledCondition::Fact(fact, !positive),
            CompiledCondition::Equal(left, right, positive) => {
                CompiledCondition::Equal(left, right, !positive)
            }
            CompiledCondition::Compare(compare, positive) => {
                CompiledCondition::Compare(compare, !positive)
            }
            CompiledCondition::All(parts) => {
                CompiledCondition::any(parts.into_iter().map(CompiledCondition::complement))
            }
            CompiledCondition::Any(parts) => {
                CompiledCondition::all(parts.into_iter().map(CompiledCondition::complement))
            }
            CompiledCondition::Exists(query, exists) => CompiledCondition::Exists(query, !exists),
        }
    }

    /// Splits the condition into its conjuncts.
    pub(super) fn into_parts(self) -> Vec<CompiledCondition> {
        match self {
            CompiledCondition::All(parts) => parts,
            CompiledCondition::Constant(true) => Vec::new(),
            other => vec![other],
        }
    }

    /// Calls `visit` for every argument in the condition, including those inside quantifiers.
    pub(super) fn arguments(&self, visit: &mut dyn FnMut(Argument)) {
        match self {
            CompiledCondition::Constant(_) => (),
            CompiledCondition::Fact(fact, _) => fact.arguments.iter().copied().for_each(visit),
            CompiledCondition::Equal(left, right, _) => [*left, *right].into_iter().for_each(visit),
            CompiledCondition::Compare(compare, _) => {
                compare.left.arguments(visit);
                compare.right.arguments(visit);
            }
            CompiledCondition::All(parts) | CompiledCondition::Any(parts) => {
                parts.iter().for_each(|part| part.arguments(visit));
            }
            CompiledCondition::Exists(query, _) => {
                query.parts.iter().for_each(|part| part.node.arguments(visit));
            }
        }
    }

    /// Calls `visit` for the predicate of every fact in the condition.
    pub(super) fn relations(&self, visit: &mut dyn FnMut(RelationId)) {
        match self {
            CompiledCondition::Constant(_)
            | CompiledCondition::Equal(..)
            | CompiledCondition::Compare(..) => (),
            CompiledCondition::Fact(fact, _) => visit(fact.relation),
            CompiledCondition::All(parts) | CompiledCondition::Any(parts) => {
                parts.iter().for_each(|part| part.relations(visit));
            }
            CompiledCondition::Exists(query, _) => {
                query.parts.iter().for_each(|part| part.node.relations(visit));
            }
        }
    }

    /// Returns a rough rank of the cost of evaluating the condition; 0 is the cheapest.
    fn effort(&self) -> u8 {
        match self {
            CompiledCondition::Constant(_) | CompiledCondition::Equal(..) => 0,
            CompiledCondition::Fact(..) => 1,
            CompiledCondition::Compare(..) => 2,
            CompiledCondition::All(_) | CompiledCondition::Any(_) => 3,
            CompiledCondition::Exists(..) => 4,
        }
    }
}

// === impl CompiledExpression ===

impl CompiledExpression {
    fn arguments(&self, visit: &mut dyn FnMut(Argument)) {
        match self {
            CompiledExpression::Number(_)
            | CompiledExpression::TotalTime
            | CompiledExpression::Unknown(_) => (),
            CompiledExpression::Fluent(fluent) => fluent.arguments.iter().copied().for_each(visit),
            CompiledExpression::Negate(inner) => inner.arguments(visit),
            CompiledExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.arguments(visit));
            }
        }
    }
}

// === impl Query ===

impl Query {
    pub(super) fn new(variables: Vec<Variable>, mut nodes: Vec<CompiledCondition>) -> Query {
        nodes.sort_by_key(CompiledCondition::effort);
        if nodes.len() > PARTS_MAX {
            let rest = nodes.split_off(PARTS_MAX - 1);
            nodes.push(CompiledCondition::All(rest));
        }
        let part = |node: CompiledCondition| {
            let mut slots = Vec::new();
            node.arguments(&mut |argument| {
                if let Argument::Slot(slot) = argument
                    && variables.iter().any(|variable| variable.slot == slot)
                    && !slots.contains(&slot)
                {
                    slots.push(slot);
                }
            });
            QueryPart { node, slots: slots.into() }
        };
        let parts = nodes.into_iter().map(part).collect();
        Query { variables, parts }
    }

    /// Whether the variable with this slot belongs to the query and has a type that contains the
    /// object.
    pub(super) fn accepts(&self, slot: FrameSlot, object: Object) -> bool {
        let variable = self.variables.iter().find(|variable| variable.slot == slot);
        variable.is_some_and(|variable| variable.extension.contains(object))
    }
}
