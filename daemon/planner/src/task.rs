//! The ground planning task: facts, operators, axioms and goal, with the original names.
//!
//! - The task is built by `ground` and read by all search code. It is never changed afterwards.
//! - A [`FactId`] or [`OperatorId`] is valid in one task only. It is never sent in a message.

pub(crate) use crate::operators::{Changes, ConditionalEffect, GroundOperator, OperatorTable};

use pddl::{Comparison, Name, Number, Operator as Arithmetic, Plan, PlanStep};

use crate::outcome::Unprovable;

/// Index of an object in one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct ObjectId(u32);

/// Index of a ground fact in one task. The indices of *basic* facts, which operators change, come
/// first; then those of *comparisons*, which follow from numbers; then those of *derived* facts, which
/// follow from axioms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct FactId(pub(crate) u32);

/// Index of an operator in one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct OperatorId(pub(crate) u32);

/// A literal: a fact that must be true, or a fact that must be false.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Literal(u32);

/// A change of one numeric fluent.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NumericChange {
    pub(crate) fluent: u32,
    pub(crate) assignment: pddl::Assignment,
    pub(crate) value: GroundExpression,
}

/// An expression over the values of numeric fluents.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum GroundExpression {
    Number(f64),
    Fluent(u32),
    Negate(Box<GroundExpression>),
    Apply(Arithmetic, Vec<GroundExpression>),
}

/// A comparison of two numeric expressions. Its truth is a fact of the task.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GroundComparison {
    pub(crate) comparison: Comparison,
    pub(crate) left: GroundExpression,
    pub(crate) right: GroundExpression,
}

/// A ground axiom: the head is true if the body holds.
#[derive(Clone, Debug)]
pub(crate) struct GroundAxiom {
    pub(crate) head: FactId,
    pub(crate) body: Box<[Literal]>,
    pub(crate) stratum: u32,
}

/// The atoms of the basic facts of a task: predicate and arguments of each fact.
#[derive(Clone, Debug)]
pub(crate) struct Atoms {
    predicates: Vec<u32>,
    /// Per fact: the end of its arguments. The first entry is a sentinel of zero.
    ends: Vec<u32>,
    arguments: Vec<ObjectId>,
}

/// A ground planning task.
#[derive(Clone, Debug, Default)]
pub(crate) struct Task {
    /// Number of facts of all three kinds: basic facts, comparisons and derived facts.
    pub(crate) fact_count: usize,
    /// Number of basic facts; their indices are the lowest.
    pub(crate) basic_count: usize,
    /// Atoms of the basic facts.
    pub(crate) atoms: Atoms,
    /// Comparisons; the indices of their facts follow those of the basic facts.
    pub(crate) comparisons: Vec<GroundComparison>,
    pub(crate) operators: OperatorTable,
    /// Axioms, sorted by stratum.
    pub(crate) axioms: Vec<GroundAxiom>,
    pub(crate) goal: Vec<Literal>,
    /// Basic facts that are true in the initial state.
    pub(crate) initial: Vec<FactId>,
    /// Initial values of the numeric fluents; NaN where a fluent is undefined.
    pub(crate) values: Vec<f64>,
    /// Size of one unit of [`GroundOperator::cost`], in units of the metric.
    pub(crate) cost_unit: f64,
    /// Reason why the costs allow no proof that a plan is a cheapest one. If `None`, every cost is a
    /// whole multiple of [`Task::cost_unit`], and no step has a negative cost.
    pub(crate) unprovable: Option<Unprovable>,
    /// Whether all operators have the same cost, and this cost is greater than zero.
    pub(crate) costs_equal: bool,
    pub(crate) schema_names: Vec<Name>,
    pub(crate) object_names: Vec<Name>,
}

// === impl ObjectId ===

impl ObjectId {
    pub(crate) fn from_index(index: usize) -> ObjectId {
        ObjectId(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl FactId ===

impl FactId {
    pub(crate) fn from_index(index: usize) -> FactId {
        FactId(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

impl OperatorId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl Literal ===

impl Literal {
    pub(crate) fn new(fact: FactId, positive: bool) -> Literal {
        Literal(fact.0 << 1 | u32::from(!positive))
    }

    pub(crate) fn fact(self) -> FactId {
        FactId(self.0 >> 1)
    }

    pub(crate) fn is_positive(self) -> bool {
        self.0 & 1 == 0
    }

    pub(crate) fn negated(self) -> Literal {
        Literal(self.0 ^ 1)
    }

    /// Returns the literal with this index: twice the fact's index, plus one if the literal is
    /// negative.
    pub(crate) fn from_index(index: usize) -> Literal {
        Literal(u32::try_from(index).unwrap_or(u32::MAX))
    }

    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

// === impl Atoms ===

impl Default for Atoms {
    fn default() -> Atoms {
        Atoms { predicates: Vec::new(), ends: vec![0], arguments: Vec::new() }
    }
}

impl Atoms {
    /// Adds the atom of the fact that follows the last one.
    pub(crate) fn push(&mut self, predicate: u32, arguments: &[ObjectId]) {
        self.predicates.push(predicate);
        self.arguments.extend_from_slice(arguments);
        self.ends.push(self.arguments.len() as u32);
    }

    /// Returns the number of facts that have an atom: the basic facts.
    pub(crate) fn len(&self) -> usize {
        self.predicates.len()
    }

    /// Returns the predicate and arguments of a basic fact.
    pub(crate) fn get(&self, fact: FactId) -> (u32, &[ObjectId]) {
        let (start, end) = (self.ends[fact.index()], self.ends[fact.index() + 1]);
        (self.predicates[fact.index()], &self.arguments[start as usize..end as usize])
    }
}

// === impl GroundExpression ===

impl GroundExpression {
    /// Returns the value of the expression, given the values of the fluents. The value is NaN if a
    /// fluent is undefined or a division is by zero.
    pub(crate) fn evaluate(&self, values: &dyn Fn(u32) -> f64) -> f64 {
        match self {
            GroundExpression::Number(number) => *number,
            GroundExpression::Fluent(fluent) => values(*fluent),
            GroundExpression::Negate(inner) => -inner.evaluate(values),
            GroundExpression::Apply(operator, operands) => {
                let mut operands = operands.iter().map(|operand| operand.evaluate(values));
                let first = operands.next().unwrap_or(f64::NAN);
                let value = operands.fold(first, |left, right| operator.apply(left, right));
                if value.is_finite() { value } else { f64::NAN }
            }
        }
    }

    /// Whether the value of the expression may be undefined although all its fluents are defined.
    pub(crate) fn may_fail(&self) -> bool {
        match self {
            GroundExpression::Number(_) | GroundExpression::Fluent(_) => false,
            GroundExpression::Negate(inner) => inner.may_fail(),
            GroundExpression::Apply(Arithmetic::Divide, _) => true,
            GroundExpression::Apply(_, operands) => operands.iter().any(Self::may_fail),
        }
    }

    /// Calls `visit` for every fluent in the expression.
    pub(crate) fn fluents(&self, visit: &mut dyn FnMut(u32)) {
        match self {
            GroundExpression::Number(_) => (),
            GroundExpression::Fluent(fluent) => visit(*fluent),
            GroundExpression::Negate(inner) => inner.fluents(visit),
            GroundExpression::Apply(_, operands) => {
                operands.iter().for_each(|operand| operand.fluents(visit));
            }
        }
    }
}

// === impl Task ===

impl Task {
    #[inline]
    pub(crate) fn operator(&self, id: OperatorId) -> GroundOperator<'_> {
        self.operators.get(id.index())
    }

    pub(crate) fn operator_count(&self) -> usize {
        self.operators.len()
    }

    /// Returns the operator as a step of a plan, with the names that the PDDL texts use.
    pub(crate) fn step(&self, id: OperatorId) -> PlanStep {
        let operator = self.operator(id);
        let arguments =
            operator.arguments.iter().map(|object| self.object_names[object.index()].clone());
        PlanStep::new(self.schema_names[operator.schema as usize].clone(), arguments)
    }

    /// Returns a sequence of operators as a plan with its cost.
    pub(crate) fn plan(&self, operators: &[OperatorId]) -> Plan {
        let steps = operators.iter().map(|id| self.step(*id)).collect();
        Plan { steps, cost: Some(Number(self.cost(operators) as f64 * self.cost_unit)) }
    }

    /// Returns a copy of the task with `operators` in place of its own operators.
    pub(crate) fn with_operators(&self, operators: OperatorTable) -> Task {
        Task {
            fact_count: self.fact_count,
            basic_count: self.basic_count,
            atoms: self.atoms.clone(),
            comparisons: self.comparisons.clone(),
            operators,
            axioms: self.axioms.clone(),
            goal: self.goal.clone(),
            initial: self.initial.clone(),
            values: self.values.clone(),
            cost_unit: self.cost_unit,
            unprovable: self.unprovable,
            costs_equal: self.costs_equal,
            schema_names: self.schema_names.clone(),
            object_names: self.object_names.clone(),
        }
    }

    /// Returns the cost of a sequence of operators, in units of [`Task::cost_unit`].
    pub(crate) fn cost(&self, operators: &[OperatorId]) -> u64 {
        operators.iter().fold(0, |sum: u64, id| sum.saturating_add(self.operator(*id).cost))
    }
}
