//! From reachable tuples to operators and axioms over raw facts.
//!
//! A *raw* fact is a row of a relation, a comparison, or an auxiliary; `finish` keeps those that
//! matter and numbers them anew.

use pddl::{Assignment, Diagnostic};
use rustc_hash::FxHashMap;

use super::GroundError;
use super::join::{JoinPlan, Work};
use super::node::{COMPARISONS_MAX, Grounder, Node, enumeration};
use super::reach::action_relation;
use super::relation::Relation;
use super::tree::{Auxiliaries, RawAxiom, Tree};
use super::values::{Grounded, Values};
use crate::normalize::lifted::{
    Closed, Formula, FunctionIndex, Lifted, LiftedEffect, LiftedNumeric, Schema, Slot, objects,
};
use crate::outcome::{StopReason, Unsupported};
use crate::task::{
    FactId, GroundComparison, GroundExpression, Literal, NumericChange, ObjectId, Operators,
};

/// Ways to satisfy one precondition before disjunctions in it become facts of their own.
const PRECONDITION_ALTERNATIVES_MAX: usize = 8;

/// The same for the condition of an effect; each way repeats the effect.
const CONDITION_ALTERNATIVES_MAX: usize = 4;

/// The ground task over raw facts.
pub(super) struct Raw {
    pub(super) operators: Operators,
    /// Per operator, in units of the metric.
    pub(super) costs: Vec<f64>,
    pub(super) axioms: Vec<RawAxiom>,
    pub(super) comparisons: Vec<GroundComparison>,
    /// `None` where the goal cannot hold.
    pub(super) goal: Option<Vec<Literal>>,
    pub(super) layout: Layout,
    pub(super) warnings: Vec<Diagnostic>,
}

/// Which raw facts are what.
pub(super) struct Layout {
    /// The raw fact of each predicate's first row, and one past the last of all.
    pub(super) offsets: Vec<usize>,
    pub(super) comparison_offset: usize,
    pub(super) auxiliary_offset: usize,
    /// One past the last auxiliary.
    pub(super) end: usize,
}

struct Instantiation<'g, 'w, 'c> {
    grounder: Grounder<'g>,
    auxiliaries: Auxiliaries,
    work: &'w mut Work<'c>,
    /// The stratum after those of all axioms: for facts that stand for parts of preconditions.
    top: usize,
    operators: Operators,
    costs: Vec<f64>,
    bytes: usize,
    warnings: Vec<Diagnostic>,
}

/// Called for every instance of an effect whose condition can hold.
type Instance<'f, I> = &'f mut dyn FnMut(&mut I, Tree, &[ObjectId]) -> Result<(), GroundError>;

/// A schema ready for grounding.
struct Ready<'s> {
    index: usize,
    schema: &'s Schema,
    precondition: Node,
    effects: Vec<(JoinPlan, Node, &'s LiftedEffect)>,
    numeric: Vec<(JoinPlan, Node, &'s LiftedNumeric)>,
}

/// One action under one binding, before its precondition is flattened.
struct Draft {
    precondition: Vec<Tree>,
    /// By condition; the first has none.
    effects: Vec<(Vec<Literal>, DraftChanges)>,
    positions: FxHashMap<Vec<Literal>, usize>,
    cost: f64,
}

/// Changes in the making.
#[derive(Clone, Default)]
struct DraftChanges {
    adds: Vec<FactId>,
    deletes: Vec<FactId>,
    numeric: Vec<NumericChange>,
}

/// Grounds every schema, axiom and the goal over what was reached.
pub(super) fn instantiate(
    lifted: &Lifted,
    relations: &mut [Relation],
    values: &mut Values,
    work: &mut Work<'_>,
) -> Result<Raw, GroundError> {
    let ready: Vec<Ready<'_>> = lifted
        .schemas
        .iter()
        .enumerate()
        .map(|(index, schema)| Ready::new(lifted, relations, index, schema))
        .collect();
    let bodies: Vec<Node> = lifted
        .axioms
        .iter()
        .map(|axiom| {
            ready_formula(lifted, relations, &axiom.body, axiom.parameter_count, axiom.frame.len())
        })
        .collect();
    let Closed { frame, formula } = &lifted.goal;
    let goal = ready_formula(lifted, relations, formula, 0, frame.len());

    let mut offsets = vec![0];
    for relation in &relations[..lifted.predicates.len()] {
        offsets.push(offsets[offsets.len() - 1] + relation.len());
    }
    let comparison_offset = offsets[offsets.len() - 1];
    let auxiliary_offset = comparison_offset + COMPARISONS_MAX;
    let mut comparisons = Vec::new();
    let grounder = Grounder {
        lifted,
        relations,
        offsets: &offsets,
        values,
        comparisons: &mut comparisons,
        comparison_ids: FxHashMap::default(),
        comparison_offset,
    };
    let mut instantiation = Instantiation {
        grounder,
        auxiliaries: Auxiliaries::new(auxiliary_offset),
        work,
        top: lifted.axioms.iter().map(|axiom| axiom.stratum + 1).max().unwrap_or(0),
        operators: Operators::default(),
        costs: Vec::new(),
        bytes: 0,
        warnings: Vec::new(),
    };
    for schema in &ready {
        instantiation.schema(schema)?;
    }
    for (index, body) in bodies.iter().enumerate() {
        instantiation.axiom(index, body)?;
    }
    let goal = instantiation.goal(&goal, frame.len())?;
    let Instantiation { auxiliaries, operators, costs, warnings, .. } = instantiation;
    let end = auxiliaries.end();
    let layout = Layout { offsets, comparison_offset, auxiliary_offset, end };
    Ok(Raw { operators, costs, axioms: auxiliaries.axioms, comparisons, goal, layout, warnings })
}

fn ready_formula(
    lifted: &Lifted,
    relations: &mut [Relation],
    formula: &Formula,
    parameter_count: usize,
    frame_len: usize,
) -> Node {
    let mut bound = vec![false; frame_len];
    bound[..parameter_count].fill(true);
    Node::compile(lifted, relations, formula, &mut bound)
}

// === impl Ready ===

impl<'s> Ready<'s> {
    fn new(
        lifted: &Lifted,
        relations: &mut [Relation],
        index: usize,
        schema: &'s Schema,
    ) -> Ready<'s> {
        let (count, frame_len) = (schema.parameter_count, schema.frame.len());
        let precondition = ready_formula(lifted, relations, &schema.precondition, count, frame_len);
        let mut guarded = |variables: &[Slot], condition: &Formula| {
            let mut bound = vec![false; frame_len];
            bound[..count].fill(true);
            let plan = enumeration(lifted, relations, variables, condition, true, &mut bound);
            (plan, Node::compile(lifted, relations, condition, &mut bound))
        };
        let mut effects = Vec::new();
        for effect in &schema.effects {
            let (plan, condition) = guarded(&effect.variables, &effect.condition);
            effects.push((plan, condition, effect));
        }
        let mut numeric = Vec::new();
        for change in &schema.numeric {
            let (plan, condition) = guarded(&change.variables, &change.condition);
            numeric.push((plan, condition, change));
        }
        Ready { index, schema, precondition, effects, numeric }
    }
}

// === impl Instantiation ===

impl Instantiation<'_, '_, '_> {
    fn schema(&mut self, ready: &Ready<'_>) -> Result<(), GroundError> {
        let relations = self.grounder.relations;
        let relation = &relations[action_relation(self.grounder.lifted, ready.index)];
        let mut binding = vec![ObjectId::from_index(0); ready.schema.frame.len()];
        for row in 0..relation.len() {
            let arguments = relation.row(row);
            binding[..arguments.len()].copy_from_slice(arguments);
            self.operator(ready, arguments, &mut binding)?;
        }
        Ok(())
    }

    fn operator(
        &mut self,
        ready: &Ready<'_>,
        arguments: &[ObjectId],
        binding: &mut [ObjectId],
    ) -> Result<(), GroundError> {
        let frame = &ready.schema.frame;
        let precondition = self.grounder.tree(&ready.precondition, frame, binding, self.work)?;
        if precondition == Tree::False {
            return Ok(());
        }
        let mut draft = Draft::new(precondition);
        for (plan, condition, effect) in &ready.effects {
            self.effect(plan, condition, effect, frame, binding, &mut draft)?;
        }
        for (plan, condition, change) in &ready.numeric {
            self.numeric(plan, condition, change, ready, binding, &mut draft)?;
        }
        if draft.cost < 0.0 {
            let feature = format!("a negative cost of `{}`", ready.schema.name);
            return Err(Unsupported::in_domain(feature, ready.schema.span).into());
        }
        let whole = Tree::and(std::mem::take(&mut draft.precondition));
        for preconditions in
            self.auxiliaries.conjunctions(&whole, PRECONDITION_ALTERNATIVES_MAX, self.top)
        {
            draft.operator(ready.index, arguments, preconditions, &mut self.operators);
            self.work.check_memory(self.bytes + self.operators.bytes())?;
            self.costs.push(draft.cost);
        }
        Ok(())
    }

    fn effect(
        &mut self,
        plan: &JoinPlan,
        condition: &Node,
        effect: &LiftedEffect,
        frame: &[usize],
        binding: &mut [ObjectId],
        draft: &mut Draft,
    ) -> Result<(), GroundError> {
        self.each(plan, condition, frame, binding, &mut |this, tree, binding| {
            let Some(fact) = this.grounder.fact(&effect.atom, binding) else { return Ok(()) };
            for conditions in
                this.auxiliaries.conjunctions(&tree, CONDITION_ALTERNATIVES_MAX, this.top)
            {
                let changes = draft.under(conditions);
                if effect.adds { changes.adds.push(fact) } else { changes.deletes.push(fact) }
            }
            Ok(())
        })
    }

    fn numeric(
        &mut self,
        plan: &JoinPlan,
        condition: &Node,
        change: &LiftedNumeric,
        ready: &Ready<'_>,
        binding: &mut [ObjectId],
        draft: &mut Draft,
    ) -> Result<(), GroundError> {
        let lifted = self.grounder.lifted;
        let function = change.fluent.function;
        // Two changes of one fluent may contradict each other; then both must be followed.
        let rivals = ready.numeric.iter().filter(|(_, _, other)| other.fluent.function == function);
        let is_followed = lifted.functions[function].is_numeric_fluent() || rivals.count() > 1;
        let weights = lifted.costs.weights.as_deref().unwrap_or_default();
        let is_counted = weights.iter().any(|(weighted, ..)| *weighted == function);
        self.each(plan, condition, &ready.schema.frame, binding, &mut |this, tree, binding| {
            let arguments: Vec<ObjectId> = objects(&change.fluent.arguments, binding).collect();
            let value = this.grounder.values.ground(&change.value, binding);
            let is_defined = change.assignment == Assignment::Assign
                || lifted.functions[function].is_numeric_fluent()
                || this.grounder.values.initially(function, &arguments).is_some();
            if value == Grounded::Undefined || !is_defined {
                this.warn_undefined(change, ready.schema);
                draft.precondition.push(tree.negated());
                return Ok(());
            }
            if let (true, Grounded::Fixed(amount)) = (is_counted, &value) {
                draft.cost += cost(lifted, function, &arguments, change.assignment, *amount);
            }
            let follow = (is_followed && (lifted.functions[function].read || !is_counted))
                || matches!(value, Grounded::Varying(_));
            if follow {
                let value = match value {
                    Grounded::Fixed(number) => GroundExpression::Number(number),
                    Grounded::Varying(expression) => expression,
                    Grounded::Undefined => return Ok(()),
                };
                let fluent = this.grounder.values.fluent(&change.fluent, binding);
                let change = NumericChange { fluent, assignment: change.assignment, value };
                // One alternative only: increasing twice is not increasing once.
                for conditions in this.auxiliaries.conjunctions(&tree, 1, this.top) {
                    draft.under(conditions).numeric.push(change.clone());
                }
            }
            Ok(())
        })
    }

    /// Grounds the condition of an effect under every binding of its variables; calls `found` where
    /// it can hold.
    fn each(
        &mut self,
        plan: &JoinPlan,
        condition: &Node,
        frame: &[usize],
        binding: &mut [ObjectId],
        found: Instance<'_, Self>,
    ) -> Result<(), GroundError> {
        if binding.is_empty() {
            let tree = self.grounder.tree(condition, frame, binding, self.work)?;
            return if tree == Tree::False { Ok(()) } else { found(self, tree, binding) };
        }
        let mut bindings = Vec::new();
        self.grounder.bindings(plan, frame, binding, self.work, &mut bindings)?;
        for inside in bindings.chunks_exact_mut(binding.len()) {
            let tree = self.grounder.tree(condition, frame, inside, self.work)?;
            if tree != Tree::False {
                found(self, tree, inside)?;
            }
        }
        Ok(())
    }

    fn axiom(&mut self, index: usize, body: &Node) -> Result<(), GroundError> {
        let lifted = self.grounder.lifted;
        let axiom = &lifted.axioms[index];
        let relation = &self.grounder.relations[axiom.head];
        let mut binding = vec![ObjectId::from_index(0); axiom.frame.len()];
        for row in 0..relation.len() {
            let arguments = relation.row(row);
            let types = &axiom.frame[..arguments.len()];
            if arguments.iter().zip(types).any(|(object, ty)| !lifted.types[*ty].contains(*object))
            {
                continue;
            }
            binding[..arguments.len()].copy_from_slice(arguments);
            let head = FactId::from_index(self.grounder.offsets[axiom.head] + row);
            let tree = self.grounder.tree(body, &axiom.frame, &mut binding, self.work)?;
            let (max, stratum) = (PRECONDITION_ALTERNATIVES_MAX, axiom.stratum);
            for body in self.auxiliaries.conjunctions(&tree, max, stratum) {
                self.bytes += size_of::<RawAxiom>() + body.len() * size_of::<Literal>();
                self.auxiliaries.axioms.push(RawAxiom { head, body, stratum });
            }
            self.work.check_memory(self.bytes)?;
        }
        Ok(())
    }

    fn goal(&mut self, goal: &Node, frame_len: usize) -> Result<Option<Vec<Literal>>, StopReason> {
        let mut binding = vec![ObjectId::from_index(0); frame_len];
        let frame = &self.grounder.lifted.goal.frame;
        let tree = self.grounder.tree(goal, frame, &mut binding, self.work)?;
        Ok(self.auxiliaries.conjunctions(&tree, 1, self.top).pop())
    }

    fn warn_undefined(&mut self, change: &LiftedNumeric, schema: &Schema) {
        let message = format!(
            "some instances of `{}` never apply: they use a function value that :init leaves out",
            schema.name
        );
        let warning = Diagnostic::warning(change.span, message);
        let is_same = |other: &Diagnostic| {
            other.span.range() == change.span.range() && other.message == warning.message
        };
        if !self.warnings.iter().any(is_same) {
            self.warnings.push(warning);
        }
    }
}

/// What changing a fluent by an amount adds to the cost of a plan.
fn cost(
    lifted: &Lifted,
    function: FunctionIndex,
    arguments: &[ObjectId],
    assignment: Assignment,
    amount: f64,
) -> f64 {
    let weights = lifted.costs.weights.as_deref().unwrap_or_default();
    let sign = if assignment == Assignment::Decrease { -1.0 } else { 1.0 };
    let matching = weights
        .iter()
        .filter(|(weighted, objects, _)| *weighted == function && objects.as_slice() == arguments);
    matching.map(|(_, _, weight)| weight * sign * amount).sum()
}

// === impl Draft ===

impl Draft {
    fn new(precondition: Tree) -> Draft {
        let mut draft = Draft {
            precondition: vec![precondition],
            effects: Vec::new(),
            positions: FxHashMap::default(),
            cost: 0.0,
        };
        draft.under(Vec::new());
        draft
    }

    /// The changes under a condition.
    fn under(&mut self, conditions: Vec<Literal>) -> &mut DraftChanges {
        let next = self.effects.len();
        let position = *self.positions.entry(conditions).or_insert_with_key(|conditions| {
            self.effects.push((conditions.clone(), DraftChanges::default()));
            next
        });
        &mut self.effects[position].1
    }

    /// Adds the operator with one of the ways to satisfy the precondition.
    fn operator(
        &self,
        schema: usize,
        arguments: &[ObjectId],
        preconditions: Vec<Literal>,
        operators: &mut Operators,
    ) {
        // What the precondition says need not be asked again, and what contradicts it cannot happen.
        let mut always = DraftChanges::default();
        let mut conditional = Vec::new();
        for (conditions, changes) in &self.effects {
            if conditions
                .iter()
                .any(|literal| preconditions.binary_search(&literal.negated()).is_ok())
            {
                continue;
            }
            let mut conditions = conditions.clone();
            conditions.retain(|literal| preconditions.binary_search(literal).is_err());
            if conditions.is_empty() {
                always.extend(changes);
            } else {
                conditional.push((conditions, changes.clone()));
            }
        }
        always.tidy(&[]);
        operators.push(schema as u32, arguments.iter().copied(), preconditions);
        for (conditions, mut changes) in conditional {
            changes.tidy(&always.adds);
            if !changes.is_empty() {
                let DraftChanges { adds, deletes, numeric } = changes;
                operators.push_conditional(conditions, adds, deletes, numeric);
            }
        }
        operators.set_effect(always.adds, always.deletes, always.numeric);
    }
}

// === impl DraftChanges ===

impl DraftChanges {
    fn extend(&mut self, other: &DraftChanges) {
        self.adds.extend(&other.adds);
        self.deletes.extend(&other.deletes);
        self.numeric.extend(other.numeric.iter().cloned());
    }

    /// Sorts, and leaves out deletes that an add overrules; `added` is added in any case.
    fn tidy(&mut self, added: &[FactId]) {
        self.adds.retain(|fact| added.binary_search(fact).is_err());
        self.adds.sort_unstable();
        self.adds.dedup();
        self.deletes.sort_unstable();
        self.deletes.dedup();
        let adds = &self.adds;
        self.deletes
            .retain(|fact| adds.binary_search(fact).is_err() && added.binary_search(fact).is_err());
    }

    fn is_empty(&self) -> bool {
        self.adds.is_empty() && self.deletes.is_empty() && self.numeric.is_empty()
    }
}
