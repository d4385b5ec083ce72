//! The normalized lifted task: names are replaced by numbers, negations occur at the leaves only,
//! and effects are in a flat list.
//!
//! All variables of a schema, including those of its quantifiers, are slots of one *frame*. A
//! binding is therefore an array, and no quantifier hides a variable of another.

use pddl::{Assignment, Comparison, Name, Operator as Arithmetic, Span};

use crate::task::ObjectId;

/// Index of a variable in a frame.
pub(crate) type SlotIndex = u32;

/// Index of a predicate.
pub(crate) type PredicateIndex = usize;

/// Index of a function.
pub(crate) type FunctionIndex = usize;

/// Index of the set of objects of a type expression.
pub(crate) type TypeIndex = usize;

/// A variable or an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum LiftedTerm {
    Variable(SlotIndex),
    Object(ObjectId),
}

/// A predicate applied to terms.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct LiftedAtom {
    pub(crate) predicate: PredicateIndex,
    pub(crate) arguments: Vec<LiftedTerm>,
}

/// A function applied to terms.
#[derive(Clone, Debug)]
pub(crate) struct LiftedFluent {
    pub(crate) function: FunctionIndex,
    pub(crate) arguments: Vec<LiftedTerm>,
}

/// A numeric expression over numbered functions.
#[derive(Clone, Debug)]
pub(crate) enum LiftedExpression {
    Number(f64),
    Fluent(LiftedFluent),
    Negate(Box<LiftedExpression>),
    Apply(Arithmetic, Vec<LiftedExpression>),
}

/// A condition in negation normal form. The default is the empty conjunction, which always holds.
#[derive(Clone, Debug)]
pub(crate) enum Formula {
    Constant(bool),
    Literal {
        positive: bool,
        atom: LiftedAtom,
    },
    Equal {
        positive: bool,
        left: LiftedTerm,
        right: LiftedTerm,
    },
    /// A comparison of two numbers. It is false if one of the numbers is undefined.
    Compare {
        comparison: Comparison,
        sides: Box<(LiftedExpression, LiftedExpression)>,
    },
    And(Vec<Formula>),
    Or(Vec<Formula>),
    Exists(Vec<SlotIndex>, Box<Formula>),
    Forall(Vec<SlotIndex>, Box<Formula>),
}

/// A normalized action with variables for its parameters.
#[derive(Clone, Debug)]
pub(crate) struct LiftedSchema {
    pub(crate) name: Name,
    /// Name of the action in the text, if this schema is only one piece of that action (see
    /// [`Piecewise`](super::Piecewise)); otherwise `None`.
    pub(crate) piece_of: Option<Name>,
    /// Number of parameters, which are the first slots of the frame. If the action has an agent, it
    /// is the first parameter.
    pub(crate) parameter_count: usize,
    pub(crate) frame: Vec<TypeIndex>,
    pub(crate) precondition: Formula,
    pub(crate) effects: Vec<LiftedEffect>,
    pub(crate) numeric: Vec<LiftedNumeric>,
    pub(crate) span: Span,
}

/// A conditional effect on a fact: `(forall (variables) (when condition literal))`.
#[derive(Clone, Debug)]
pub(crate) struct LiftedEffect {
    pub(crate) variables: Vec<SlotIndex>,
    pub(crate) condition: Formula,
    pub(crate) adds: bool,
    pub(crate) atom: LiftedAtom,
}

/// A conditional effect on a number: `(forall (variables) (when condition (assignment fluent
/// value)))`.
#[derive(Clone, Debug)]
pub(crate) struct LiftedNumeric {
    pub(crate) variables: Vec<SlotIndex>,
    pub(crate) condition: Formula,
    pub(crate) assignment: Assignment,
    pub(crate) fluent: LiftedFluent,
    pub(crate) value: LiftedExpression,
    pub(crate) span: Span,
}

/// An axiom. The parameters of its head are the first slots of the frame.
#[derive(Clone, Debug)]
pub(crate) struct LiftedAxiom {
    pub(crate) head: PredicateIndex,
    pub(crate) parameter_count: usize,
    pub(crate) frame: Vec<TypeIndex>,
    pub(crate) body: Formula,
    pub(crate) stratum: usize,
}

/// A condition without parameters, with the frame for the variables of its quantifiers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Closed {
    pub(crate) frame: Vec<TypeIndex>,
    pub(crate) formula: Formula,
}

/// The set of objects of a type expression.
#[derive(Clone, Debug, Default)]
pub(crate) struct TypeSet {
    pub(crate) members: Vec<ObjectId>,
    /// One bit per object: whether the object is in the set.
    bits: Vec<u64>,
}

/// A predicate, and whether actions or axioms can change its facts.
#[derive(Clone, Debug)]
pub(crate) struct PredicateUse {
    pub(crate) name: Name,
    pub(crate) arity: usize,
    pub(crate) added: bool,
    pub(crate) deleted: bool,
    pub(crate) derived: bool,
}

/// A function, and whether its values must be part of the state.
#[derive(Clone, Debug)]
pub(crate) struct FunctionUse {
    pub(crate) name: Name,
    pub(crate) arity: usize,
    /// Whether an effect changes the function.
    pub(crate) changed: bool,
    /// Whether a condition depends on the function, directly or because the function is used to
    /// compute a value that a condition depends on.
    pub(crate) read: bool,
}

/// Computation of the cost of a plan, as given by the metric.
#[derive(Clone, Debug)]
pub(crate) struct Costs {
    /// Weights of ground fluents in the cost of a plan. Each entry is the function, its arguments
    /// and the weight. `None` if every step costs one.
    pub(crate) weights: Option<Vec<(FunctionIndex, Vec<ObjectId>, f64)>>,
    /// Additional cost of every step: the weight of `total-time` in the metric. A sequential plan
    /// takes one unit of time per step.
    pub(crate) per_step: f64,
    /// Whether the cost of any step depends on the state.
    pub(crate) varies: bool,
    /// Whether the metric is a weighted sum of fluents.
    pub(crate) is_sum: bool,
}

/// A whole task after normalization and before grounding.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lifted {
    pub(crate) objects: Vec<Name>,
    pub(crate) predicates: Vec<PredicateUse>,
    pub(crate) functions: Vec<FunctionUse>,
    pub(crate) types: Vec<TypeSet>,
    pub(crate) schemas: Vec<LiftedSchema>,
    pub(crate) axioms: Vec<LiftedAxiom>,
    pub(crate) goal: Closed,
    pub(crate) init: Vec<(PredicateIndex, Vec<ObjectId>)>,
    pub(crate) values: Vec<(FunctionIndex, Vec<ObjectId>, f64)>,
    pub(crate) costs: Costs,
}

// === impl Costs ===

impl Default for Costs {
    fn default() -> Costs {
        Costs { weights: None, per_step: 0.0, varies: false, is_sum: true }
    }
}

// === impl TypeSet ===

impl TypeSet {
    pub(crate) fn new(members: Vec<ObjectId>, object_count: usize) -> TypeSet {
        let mut bits = vec![0; object_count.div_ceil(64)];
        for member in &members {
            bits[member.index() / 64] |= 1 << (member.index() % 64);
        }
        TypeSet { members, bits }
    }

    /// Returns the set of the objects with a one in `bits`.
    pub(crate) fn from_bits(bits: Vec<u64>) -> TypeSet {
        let all = (0..bits.len() * 64).filter(|index| bits[index / 64] >> (index % 64) & 1 == 1);
        TypeSet { members: all.map(ObjectId::from_index).collect(), bits }
    }

    #[inline]
    pub(crate) fn contains(&self, object: ObjectId) -> bool {
        self.bits[object.index() / 64] >> (object.index() % 64) & 1 == 1
    }

    /// Returns the set as bits, one per object.
    pub(crate) fn bits(&self) -> &[u64] {
        &self.bits
    }
}

// === impl PredicateUse ===

impl PredicateUse {
    /// Whether the facts of this predicate never change, because no action and no axiom changes
    /// them.
    pub(crate) fn is_static(&self) -> bool {
        !self.added && !self.deleted && !self.derived
    }
}

// === impl FunctionUse ===

impl FunctionUse {
    /// Whether an effect changes the function or a condition depends on it.
    pub(crate) fn matters(&self) -> bool {
        self.changed || self.read
    }

    /// Whether the values of this function are part of the state.
    pub(crate) fn is_numeric_fluent(&self) -> bool {
        self.changed && self.read
    }
}

// === impl LiftedTerm ===

impl LiftedTerm {
    /// Returns the object of the term under `binding`, which must have an object for each slot.
    #[inline]
    pub(crate) fn object(self, binding: &[ObjectId]) -> ObjectId {
        match self {
            LiftedTerm::Variable(slot) => binding[slot as usize],
            LiftedTerm::Object(object) => object,
        }
    }
}

/// Returns the objects of terms under `binding`, which must have an object for each slot.
pub(crate) fn objects<'a>(
    terms: &'a [LiftedTerm],
    binding: &'a [ObjectId],
) -> impl Iterator<Item = ObjectId> + 'a {
    terms.iter().map(|term| term.object(binding))
}

impl LiftedSchema {
    /// Returns the name of the action in the text, even if this schema is only a piece of it.
    pub(crate) fn action(&self) -> &Name {
        self.piece_of.as_ref().unwrap_or(&self.name)
    }
}

impl LiftedEffect {
    /// Whether the effect occurs whenever its action is applied.
    pub(crate) fn is_unconditional(&self) -> bool {
        self.variables.is_empty() && self.condition.is_true()
    }
}

impl Default for Formula {
    fn default() -> Formula {
        Formula::And(Vec::new())
    }
}

impl Formula {
    /// Whether the formula is trivially true.
    pub(crate) fn is_true(&self) -> bool {
        match self {
            Formula::Constant(truth) => *truth,
            Formula::And(parts) => parts.iter().all(Formula::is_true),
            _ => false,
        }
    }

    /// Calls `visit` for every literal of the formula, with `true` for a positive literal and with
    /// its atom.
    pub(crate) fn literals(&self, visit: &mut dyn FnMut(bool, &LiftedAtom)) {
        match self {
            Formula::Literal { positive, atom } => visit(*positive, atom),
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter().for_each(|part| part.literals(visit));
            }
            Formula::Exists(_, inner) | Formula::Forall(_, inner) => inner.literals(visit),
            Formula::Constant(_) | Formula::Equal { .. } | Formula::Compare { .. } => (),
        }
    }

    /// Returns the free variables of the formula; the list may contain duplicates.
    pub(crate) fn free_slots(&self) -> Vec<SlotIndex> {
        let mut free = Vec::new();
        let mut term = |term: &LiftedTerm| match term {
            LiftedTerm::Variable(slot) => free.push(*slot),
            LiftedTerm::Object(_) => (),
        };
        match self {
            Formula::Constant(_) => (),
            Formula::Literal { atom, .. } => atom.arguments.iter().for_each(term),
            Formula::Equal { left, right, .. } => [left, right].into_iter().for_each(term),
            Formula::Compare { sides, .. } => {
                sides.0.terms(&mut term);
                sides.1.terms(&mut term);
            }
            Formula::And(parts) | Formula::Or(parts) => {
                free.extend(parts.iter().flat_map(Formula::free_slots));
            }
            Formula::Exists(slots, inner) | Formula::Forall(slots, inner) => {
                free = inner.free_slots();
                free.retain(|slot| !slots.contains(slot));
            }
        }
        free
    }

    /// Calls `visit` for every occurrence of a variable in the formula, including variables that
    /// quantifiers bind.
    pub(crate) fn slots_mut(&mut self, visit: &mut dyn FnMut(&mut SlotIndex)) {
        let mut term = |term: &mut LiftedTerm| {
            if let LiftedTerm::Variable(slot) = term {
                visit(slot);
            }
        };
        match self {
            Formula::Constant(_) => (),
            Formula::Literal { atom, .. } => atom.arguments.iter_mut().for_each(term),
            Formula::Equal { left, right, .. } => [left, right].into_iter().for_each(term),
            Formula::Compare { sides, .. } => {
                sides.0.terms_mut(&mut term);
                sides.1.terms_mut(&mut term);
            }
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter_mut().for_each(|part| part.slots_mut(visit));
            }
            Formula::Exists(slots, inner) | Formula::Forall(slots, inner) => {
                slots.iter_mut().for_each(&mut *visit);
                inner.slots_mut(visit);
            }
        }
    }

    /// Calls `visit` for every function in the formula.
    pub(crate) fn functions(&self, visit: &mut dyn FnMut(FunctionIndex)) {
        match self {
            Formula::Compare { sides, .. } => {
                sides.0.functions(visit);
                sides.1.functions(visit);
            }
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter().for_each(|part| part.functions(visit));
            }
            Formula::Exists(_, inner) | Formula::Forall(_, inner) => inner.functions(visit),
            Formula::Constant(_) | Formula::Equal { .. } | Formula::Literal { .. } => (),
        }
    }
}

impl LiftedExpression {
    /// Whether the expression contains a division.
    pub(crate) fn divides(&self) -> bool {
        match self {
            LiftedExpression::Number(_) | LiftedExpression::Fluent(_) => false,
            LiftedExpression::Negate(inner) => inner.divides(),
            LiftedExpression::Apply(Arithmetic::Divide, _) => true,
            LiftedExpression::Apply(_, operands) => operands.iter().any(Self::divides),
        }
    }

    /// Calls `visit` for every term in the expression.
    pub(crate) fn terms(&self, visit: &mut dyn FnMut(&LiftedTerm)) {
        match self {
            LiftedExpression::Number(_) => (),
            LiftedExpression::Fluent(fluent) => fluent.arguments.iter().for_each(visit),
            LiftedExpression::Negate(inner) => inner.terms(visit),
            LiftedExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.terms(visit));
            }
        }
    }

    /// Does the same as [`LiftedExpression::terms`], with mutable terms.
    pub(crate) fn terms_mut(&mut self, visit: &mut dyn FnMut(&mut LiftedTerm)) {
        match self {
            LiftedExpression::Number(_) => (),
            LiftedExpression::Fluent(fluent) => fluent.arguments.iter_mut().for_each(visit),
            LiftedExpression::Negate(inner) => inner.terms_mut(visit),
            LiftedExpression::Apply(_, operands) => {
                operands.iter_mut().for_each(|operand| operand.terms_mut(visit));
            }
        }
    }

    /// Calls `visit` for every function in the expression.
    pub(crate) fn functions(&self, visit: &mut dyn FnMut(FunctionIndex)) {
        match self {
            LiftedExpression::Number(_) => (),
            LiftedExpression::Fluent(fluent) => visit(fluent.function),
            LiftedExpression::Negate(inner) => inner.functions(visit),
            LiftedExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.functions(visit));
            }
        }
    }
}
