//! Compiled conditions, expressions and effects: the lifted tree with slots for variables and numbers
//! for names, evaluated without comparing strings.
//!
//! Negations are at the leaves. Every quantifier is a [`Query`]: a search for bindings under which all
//! of several parts hold. A `forall` requires that its negation has no binding.

use std::sync::Arc;

use pddl::{Assignment, Comparison, FluentTerm, Operator};

use super::symbols::{Extension, Object, Relation};

/// Index of a variable in a frame. Each variable of a compiled text has its own slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot(pub(super) u32);

/// An argument: a variable or an object.
#[derive(Clone, Copy, Debug)]
pub(super) enum Argument {
    Slot(Slot),
    Object(Object),
}

/// A predicate or a function applied to arguments.
#[derive(Clone, Debug)]
pub(super) struct Fact {
    pub(super) relation: Relation,
    pub(super) arguments: Box<[Argument]>,
}

/// A condition.
#[derive(Clone, Debug)]
pub(super) enum Node {
    Constant(bool),
    /// The fact has this truth value.
    Fact(Fact, bool),
    /// Whether the arguments are the same object has this truth value.
    Equal(Argument, Argument, bool),
    /// Whether the comparison holds has this truth value. It does not hold if a side is undefined.
    Compare(Box<Compare>, bool),
    All(Vec<Node>),
    Any(Vec<Node>),
    /// Whether the query has a binding has this truth value.
    Exists(Box<Query>, bool),
}

/// A comparison of numbers.
#[derive(Clone, Debug)]
pub(super) struct Compare {
    pub(super) comparison: Comparison,
    pub(super) left: Expression,
    pub(super) right: Expression,
}

/// A conjunctive query: variables, and the parts that must hold for them.
#[derive(Clone, Debug)]
pub(super) struct Query {
    pub(super) variables: Vec<Variable>,
    /// At most [`PARTS_MAX`] parts, cheap ones first.
    pub(super) parts: Vec<Part>,
}

/// Maximal number of parts: the evaluation keeps its open parts as the bits of one `u64`.
pub(super) const PARTS_MAX: usize = 64;

/// A variable of a query.
#[derive(Clone, Debug)]
pub(super) struct Variable {
    pub(super) slot: Slot,
    pub(super) extension: Arc<Extension>,
}

/// A conjunct of a query.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) node: Node,
    /// Variables of the query that occur in the part.
    pub(super) slots: Box<[Slot]>,
}

/// A numeric expression.
#[derive(Clone, Debug)]
pub(super) enum Expression {
    Number(f64),
    Fluent(Box<Fluent>),
    Negate(Box<Expression>),
    Apply(Operator, Vec<Expression>),
    TotalTime,
    /// A time that only durative actions have; it is undefined here.
    Unknown(Box<FluentTerm>),
}

/// A function applied to arguments.
#[derive(Clone, Debug)]
pub(super) struct Fluent {
    /// Number of the function; `None` if no fluent of this name and arity can have a value.
    pub(super) function: Option<Relation>,
    pub(super) arguments: Box<[Argument]>,
    /// The fluent as it is written in the text.
    pub(super) told: FluentTerm,
}

/// An effect.
#[derive(Clone, Debug)]
pub(super) enum Change {
    All(Vec<Change>),
    /// Sets the truth value of a fact.
    Set(Fact, bool),
    Assign(Box<Assign>),
    When(Box<(Node, Change)>),
    /// The change for every binding under which all parts hold.
    Each(Box<(Query, Change)>),
}

/// A numeric effect.
#[derive(Clone, Debug)]
pub(super) struct Assign {
    pub(super) assignment: Assignment,
    pub(super) fluent: Fluent,
    pub(super) value: Expression,
}

/// An action's schema.
#[derive(Debug)]
pub(super) struct Schema {
    /// Types of the parameters. Their slots come first.
    pub(super) parameters: Vec<Arc<Extension>>,
    pub(super) precondition: Node,
    pub(super) effect: Change,
    pub(super) slot_count: usize,
}

// === impl Argument ===

impl Argument {
    /// Returns the object that it stands for; [`Object::UNBOUND`] if it is an unbound variable.
    pub(super) fn value(self, frame: &[Object]) -> Object {
        match self {
            Argument::Slot(slot) => frame[slot.index()],
            Argument::Object(object) => object,
        }
    }
}

// === impl Slot ===

impl Slot {
    pub(super) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl Node ===

impl Node {
    /// Returns the conjunction, flattened and simplified.
    pub(super) fn all(nodes: impl IntoIterator<Item = Node>) -> Node {
        let mut flat = Vec::new();
        for node in nodes {
            match node {
                Node::Constant(true) => (),
                Node::Constant(false) => return node,
                Node::All(parts) => flat.extend(parts),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => Node::Constant(true),
            1 => flat.remove(0),
            _ => Node::All(flat),
        }
    }

    /// Returns the disjunction, flattened and simplified.
    pub(super) fn any(nodes: impl IntoIterator<Item = Node>) -> Node {
        let mut flat = Vec::new();
        for node in nodes {
            match node {
                Node::Constant(false) => (),
                Node::Constant(true) => return node,
                Node::Any(parts) => flat.extend(parts),
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => Node::Constant(false),
            1 => flat.remove(0),
            _ => Node::Any(flat),
        }
    }

    /// Returns the node that holds if and only if this one does not. This is not the negation of PDDL:
    /// if a number is undefined, neither a comparison nor its negation holds.
    pub(super) fn complement(self) -> Node {
        match self {
            Node::Constant(truth) => Node::Constant(!truth),
            Node::Fact(fact, positive) => Node::Fact(fact, !positive),
            Node::Equal(left, right, positive) => Node::Equal(left, right, !positive),
            Node::Compare(compare, positive) => Node::Compare(compare, !positive),
            Node::All(parts) => Node::any(parts.into_iter().map(Node::complement)),
            Node::Any(parts) => Node::all(parts.into_iter().map(Node::complement)),
            Node::Exists(query, exists) => Node::Exists(query, !exists),
        }
    }

    /// Returns the conjuncts.
    pub(super) fn into_parts(self) -> Vec<Node> {
        match self {
            Node::All(parts) => parts,
            Node::Constant(true) => Vec::new(),
            other => vec![other],
        }
    }

    /// Calls `visit` for every argument, including those inside quantifiers.
    pub(super) fn arguments(&self, visit: &mut dyn FnMut(Argument)) {
        match self {
            Node::Constant(_) => (),
            Node::Fact(fact, _) => fact.arguments.iter().copied().for_each(visit),
            Node::Equal(left, right, _) => [*left, *right].into_iter().for_each(visit),
            Node::Compare(compare, _) => {
                compare.left.arguments(visit);
                compare.right.arguments(visit);
            }
            Node::All(parts) | Node::Any(parts) => {
                parts.iter().for_each(|part| part.arguments(visit));
            }
            Node::Exists(query, _) => {
                query.parts.iter().for_each(|part| part.node.arguments(visit));
            }
        }
    }

    /// Calls `visit` for the relation of every fact.
    pub(super) fn relations(&self, visit: &mut dyn FnMut(Relation)) {
        match self {
            Node::Constant(_) | Node::Equal(..) | Node::Compare(..) => (),
            Node::Fact(fact, _) => visit(fact.relation),
            Node::All(parts) | Node::Any(parts) => {
                parts.iter().for_each(|part| part.relations(visit));
            }
            Node::Exists(query, _) => {
                query.parts.iter().for_each(|part| part.node.relations(visit));
            }
        }
    }

    /// Returns a rough rank of the work to evaluate the node.
    fn effort(&self) -> u8 {
        match self {
            Node::Constant(_) | Node::Equal(..) => 0,
            Node::Fact(..) => 1,
            Node::Compare(..) => 2,
            Node::All(_) | Node::Any(_) => 3,
            Node::Exists(..) => 4,
        }
    }
}

// === impl Expression ===

impl Expression {
    fn arguments(&self, visit: &mut dyn FnMut(Argument)) {
        match self {
            Expression::Number(_) | Expression::TotalTime | Expression::Unknown(_) => (),
            Expression::Fluent(fluent) => fluent.arguments.iter().copied().for_each(visit),
            Expression::Negate(inner) => inner.arguments(visit),
            Expression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.arguments(visit));
            }
        }
    }
}

// === impl Query ===

impl Query {
    pub(super) fn new(variables: Vec<Variable>, mut nodes: Vec<Node>) -> Query {
        nodes.sort_by_key(Node::effort);
        if nodes.len() > PARTS_MAX {
            let rest = nodes.split_off(PARTS_MAX - 1);
            nodes.push(Node::All(rest));
        }
        let part = |node: Node| {
            let mut slots = Vec::new();
            node.arguments(&mut |argument| {
                if let Argument::Slot(slot) = argument
                    && variables.iter().any(|variable| variable.slot == slot)
                    && !slots.contains(&slot)
                {
                    slots.push(slot);
                }
            });
            Part { node, slots: slots.into() }
        };
        let parts = nodes.into_iter().map(part).collect();
        Query { variables, parts }
    }

    /// Whether the object is of the type of the variable in this slot.
    pub(super) fn accepts(&self, slot: Slot, object: Object) -> bool {
        let variable = self.variables.iter().find(|variable| variable.slot == slot);
        variable.is_some_and(|variable| variable.extension.contains(object))
    }
}
