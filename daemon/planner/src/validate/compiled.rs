//! Conditions, expressions and effects of the texts with slots for variables and numbers for names:
//! the same lifted tree, read without comparing a string.
//!
//! Negations stand at the leaves, and every quantifier is a [`Query`]: the bindings under which all
//! of several parts hold. `forall` asks that there is none under which the negation does.

use std::sync::Arc;

use pddl::{Assignment, Comparison, FluentTerm, Operator};

use super::symbols::{Extension, Object, Relation};

/// A variable's place among the values of all variables, of which each has its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot(pub(super) u32);

/// What stands in argument position.
#[derive(Clone, Copy, Debug)]
pub(super) enum Argument {
    Slot(Slot),
    Object(Object),
}

/// A predicate applied to arguments, or a function.
#[derive(Clone, Debug)]
pub(super) struct Fact {
    pub(super) relation: Relation,
    pub(super) arguments: Box<[Argument]>,
}

/// A condition.
#[derive(Clone, Debug)]
pub(super) enum Node {
    Constant(bool),
    /// The fact is true, or false.
    Fact(Fact, bool),
    /// The arguments are one object, or two.
    Equal(Argument, Argument, bool),
    /// The comparison holds, or not; it does not where a side has no value.
    Compare(Box<Compare>, bool),
    All(Vec<Node>),
    Any(Vec<Node>),
    /// There is a binding, or there is none.
    Exists(Box<Query>, bool),
}

/// A comparison of numbers.
#[derive(Clone, Debug)]
pub(super) struct Compare {
    pub(super) comparison: Comparison,
    pub(super) left: Expression,
    pub(super) right: Expression,
}

/// What is asked of several variables together.
#[derive(Clone, Debug)]
pub(super) struct Query {
    pub(super) variables: Vec<Variable>,
    /// At most [`PARTS_MAX`], cheap ones first.
    pub(super) parts: Vec<Part>,
}

/// A query keeps the parts it still has to look at in as many bits.
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
    /// Those of the query's variables that it speaks of.
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
    /// Time that only durative actions know; it has no value here.
    Unknown(Box<FluentTerm>),
}

/// A function applied to arguments.
#[derive(Clone, Debug)]
pub(super) struct Fluent {
    /// `None` where no text gives any such fluent a value.
    pub(super) function: Option<Relation>,
    pub(super) arguments: Box<[Argument]>,
    /// As the author wrote it.
    pub(super) told: FluentTerm,
}

/// An effect.
#[derive(Clone, Debug)]
pub(super) enum Change {
    All(Vec<Change>),
    /// The fact becomes true, or false.
    Set(Fact, bool),
    Assign(Box<Assign>),
    When(Box<(Node, Change)>),
    /// For every binding under which the parts hold.
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
    /// The types of its parameters, whose slots come first.
    pub(super) parameters: Vec<Arc<Extension>>,
    pub(super) precondition: Node,
    pub(super) effect: Change,
    pub(super) slot_count: usize,
}

// === impl Argument ===

impl Argument {
    /// The object it stands for: [`Object::UNBOUND`] for a variable that has none yet.
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
    /// The conjunction, flat.
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

    /// The disjunction, flat.
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

    /// The node that holds where this one does not. That is not its negation as texts mean it: where a
    /// number has no value, neither a comparison nor its negation holds.
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

    /// The conjuncts.
    pub(super) fn into_parts(self) -> Vec<Node> {
        match self {
            Node::All(parts) => parts,
            Node::Constant(true) => Vec::new(),
            other => vec![other],
        }
    }

    /// Calls `visit` for every argument, those inside of quantifiers included.
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

    /// How much work it is to look, roughly.
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
