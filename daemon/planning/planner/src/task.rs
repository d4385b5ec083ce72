//! The ground planning task: facts, operators, axioms and goal, with the original names.
//!
//! - `ground` builds the task, and all search code reads it. The task never changes afterwards.

pub(crate) use crate::ground_terms::{
    FactId, GroundComparison, GroundExpression, Literal, NumericChange, ObjectId, OperatorId,
};
pub(crate) use crate::operators::{Changes, ConditionalEffect, GroundOperator, OperatorTable};

use pddl::{Name, Number, Plan, PlanStep};

use crate::outcome::Unprovable;

/// A ground axiom: if the body holds, the head is true.
#[derive(Clone, Debug)]
pub(crate) struct GroundAxiom {
    pub(crate) head: FactId,
    pub(crate) body: Box<[Literal]>,
    pub(crate) stratum: u32,
}

/// The atoms of the basic facts of a task: the predicate and the arguments of each fact, in the
/// order of the facts.
#[derive(Clone, Debug)]
pub(crate) struct Atoms {
    predicates: Vec<u32>,
    /// Bounds of the facts in `arguments`: the arguments of fact `i` are those from `ends[i]` to
    /// `ends[i + 1]`. The first entry is zero.
    ends: Vec<u32>,
    arguments: Vec<ObjectId>,
}

/// A ground planning task.
#[derive(Clone, Debug, Default)]
pub(crate) struct Task {
    /// Number of facts of all three kinds: basic facts, comparisons and derived facts.
    pub(crate) fact_count: usize,
    /// Number of basic facts, which have the lowest indices.
    pub(crate) basic_count: usize,
    /// Atoms of the basic facts.
    pub(crate) atoms: Atoms,
    /// Comparisons. The indices of their facts follow those of the basic facts.
    pub(crate) comparisons: Vec<GroundComparison>,
    pub(crate) operators: OperatorTable,
    /// Axioms, sorted by stratum.
    pub(crate) axioms: Vec<GroundAxiom>,
    pub(crate) goal: Vec<Literal>,
    /// Basic facts that are true in the initial state.
    pub(crate) initial: Vec<FactId>,
    /// Initial values of the numeric fluents; NaN for an undefined fluent.
    pub(crate) values: Vec<f64>,
    /// Value of one unit of [`GroundOperator::cost`], in units of the metric.
    pub(crate) cost_unit: f64,
    /// Reason why the costs allow no proof of optimality. If `None`, every cost is a whole multiple
    /// of [`Task::cost_unit`], and no step has a negative cost.
    pub(crate) unprovable: Option<Unprovable>,
    /// Whether all operators have the same cost, and this cost is greater than zero.
    pub(crate) costs_equal: bool,
    pub(crate) schema_names: Vec<Name>,
    pub(crate) object_names: Vec<Name>,
}

// === impl Atoms ===

impl Default for Atoms {
    fn default() -> Atoms {
        Atoms { predicates: Vec::new(), ends: vec![0], arguments: Vec::new() }
    }
}

impl Atoms {
    /// Adds the atom of the next fact.
    pub(crate) fn push(&mut self, predicate: u32, arguments: &[ObjectId]) {
        self.predicates.push(predicate);
        self.arguments.extend_from_slice(arguments);
        self.ends.push(self.arguments.len() as u32);
    }

    /// Returns the number of basic facts, which are those with an atom.
    pub(crate) fn len(&self) -> usize {
        self.predicates.len()
    }

    fn bytes(&self) -> usize {
        let numbers = self.predicates.capacity() + self.ends.capacity();
        numbers * size_of::<u32>() + self.arguments.capacity() * size_of::<ObjectId>()
    }

    /// Returns the number of the predicate of a basic fact, and the arguments of the fact.
    pub(crate) fn get(&self, fact: FactId) -> (u32, &[ObjectId]) {
        let (start, end) = (self.ends[fact.index()], self.ends[fact.index() + 1]);
        (self.predicates[fact.index()], &self.arguments[start as usize..end as usize])
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

    /// Returns the number of bytes of the operators, facts and axioms.
    pub(crate) fn bytes(&self) -> usize {
        let body = |axiom: &GroundAxiom| axiom.body.len() * size_of::<Literal>();
        self.operators.bytes()
            + self.atoms.bytes()
            + self.axioms.len() * size_of::<GroundAxiom>()
            + self.axioms.iter().map(body).sum::<usize>()
            + self.comparisons.len() * size_of::<GroundComparison>()
    }

    /// Returns an operator as a step of a plan, with the names of the PDDL texts.
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

    /// Returns a copy of the task with `operators` instead of its own operators.
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
