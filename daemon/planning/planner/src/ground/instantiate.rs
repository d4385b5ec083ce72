//! Instantiation: each tuple of a schema becomes an operator, and each binding of an axiom's
//! variables becomes a ground axiom.

use std::sync::Arc;

use pddl::{Assignment, Diagnostic, Operator as Arithmetic};

use super::action_relation;
use super::conjunction_template::{ConjunctionTemplate, tidy};
use super::draft::OperatorDraft;
use super::formula_template::{FormulaGrounder, FormulaTemplate, enumeration};
use super::ground_fluents::ExpressionValue;
use super::ground_formula::{Auxiliaries, GroundFormula, RawAxiom};
use super::grounding_meter::GroundingMeter;
use super::join::{Catalog, JoinPlan};
use crate::normalize::lifted::{
    Formula, Lifted, LiftedEffect, LiftedFluent, LiftedNumeric, LiftedSchema, SlotIndex, TypeIndex,
};
use crate::outcome::StopReason;
use crate::task::{FactId, Literal, NumericChange, ObjectId, OperatorTable};

/// Maximum number of conjunctions that a precondition is expanded into. If there would be more,
/// disjunctions in the precondition become auxiliary facts.
const PRECONDITION_ALTERNATIVES_MAX: usize = 8;

/// Maximum number of conjunctions that the condition of an effect is expanded into; the effect is
/// repeated for each. If there would be more, disjunctions in the condition become auxiliary facts.
const CONDITION_ALTERNATIVES_MAX: usize = 4;

/// State of the instantiation: the inputs, the outputs, and reused buffers.
pub(super) struct Instantiation<'g, 'w, 'c> {
    pub(super) grounder: FormulaGrounder<'g>,
    pub(super) auxiliaries: &'g mut Auxiliaries,
    pub(super) operators: &'g mut OperatorTable,
    pub(super) axioms: &'g mut Vec<RawAxiom>,
    pub(super) warnings: &'g mut Vec<Diagnostic>,
    pub(super) work: &'w mut GroundingMeter<'c>,
    /// Stratum of the auxiliary facts of preconditions: one above the strata of all axioms.
    pub(super) top: usize,
    /// Number of bytes of the ground axioms.
    pub(super) bytes: usize,
    pub(super) draft: OperatorDraft,
    pub(super) literals: Vec<Literal>,
    pub(super) bindings: Vec<ObjectId>,
}

/// Callback for each binding of the variables of an effect.
type BindingCallback<'f, I> = &'f mut dyn FnMut(&mut I, &mut [ObjectId]) -> Result<(), StopReason>;

/// An action schema, compiled for instantiation.
pub(super) struct SchemaTemplate<'s> {
    pub(super) index: usize,
    schema: &'s LiftedSchema,
    precondition: ConjunctionTemplate,
    effects: Vec<EffectTemplate<'s, LiftedEffect>>,
    numeric: Vec<EffectTemplate<'s, LiftedNumeric>>,
}

/// A part of a schema's effect, with the condition of that part.
struct EffectTemplate<'s, T> {
    /// Join that finds the bindings of the variables that the effect itself quantifies; `None` if
    /// it quantifies none.
    plan: Option<JoinPlan>,
    condition: ConjunctionTemplate,
    part: &'s T,
}

/// One compiled alternative of an axiom's body. Each binding of the axiom's parameters and of the
/// outermost `exists` gives a ground axiom.
pub(super) struct AxiomTemplate {
    head: usize,
    parameter_count: usize,
    /// Types of the variables, shared by all alternatives of one axiom.
    frame: Arc<[TypeIndex]>,
    plan: JoinPlan,
    body: ConjunctionTemplate,
    stratum: usize,
}

/// Compiles every disjunct of every axiom's body as an alternative. The outermost `exists` of the
/// disjunct is removed, and a join binds its variables instead.
pub(super) fn ready_axioms(catalog: &mut Catalog<'_>) -> Vec<AxiomTemplate> {
    let mut ready = Vec::new();
    for axiom in &catalog.lifted.axioms {
        let whole = std::slice::from_ref(&axiom.body);
        let alternatives = match &axiom.body {
            Formula::Or(alternatives) => alternatives.as_slice(),
            _ => whole,
        };
        let frame: Arc<[TypeIndex]> = axiom.frame.as_slice().into();
        for alternative in alternatives {
            let (slots, body) = open(alternative);
            let parameters = 0..axiom.parameter_count as SlotIndex;
            let slots: Vec<SlotIndex> = parameters.chain(slots).collect();
            let mut bound = vec![false; axiom.frame.len()];
            let plan = enumeration(catalog, &axiom.frame, &slots, &body, true, &mut bound);
            ready.push(AxiomTemplate {
                head: axiom.head,
                parameter_count: axiom.parameter_count,
                frame: Arc::clone(&frame),
                plan,
                body: ConjunctionTemplate::compile(catalog, &axiom.frame, &body, &mut bound, false),
                stratum: axiom.stratum,
            });
        }
    }
    ready
}

/// Removes the `exists` from a formula that is an `exists`, or the first `exists` from a
/// conjunction. Returns the variables of the `exists`, and the formula without it. Without an
/// `exists`, returns no variables and the formula itself.
fn open(formula: &Formula) -> (Vec<SlotIndex>, Formula) {
    match formula {
        Formula::Exists(slots, inner) => (slots.clone(), inner.as_ref().clone()),
        Formula::And(parts) => {
            let mut parts = parts.clone();
            let at = parts.iter().position(|part| matches!(part, Formula::Exists(..)));
            let Some(at) = at else { return (Vec::new(), formula.clone()) };
            match parts.swap_remove(at) {
                Formula::Exists(slots, inner) => {
                    parts.push(*inner);
                    (slots, Formula::And(parts))
                }
                _ => (Vec::new(), formula.clone()),
            }
        }
        _ => (Vec::new(), formula.clone()),
    }
}

// === impl SchemaTemplate ===

impl<'s> SchemaTemplate<'s> {
    pub(super) fn new(
        catalog: &mut Catalog<'_>,
        index: usize,
        schema: &'s LiftedSchema,
    ) -> SchemaTemplate<'s> {
        let frame = &schema.frame;
        let mut bound = vec![false; frame.len()];
        bound[..schema.parameter_count].fill(true);
        let precondition = ConjunctionTemplate::compile(
            catalog,
            frame,
            &schema.precondition,
            &mut bound.clone(),
            true,
        );
        let mut guard = |variables: &[SlotIndex], condition: &Formula| {
            let mut bound = bound.clone();
            let plan = (!variables.is_empty())
                .then(|| enumeration(catalog, frame, variables, condition, true, &mut bound));
            (plan, ConjunctionTemplate::compile(catalog, frame, condition, &mut bound, false))
        };
        let mut effects = Vec::new();
        for part in &schema.effects {
            let (plan, condition) = guard(&part.variables, &part.condition);
            effects.push(EffectTemplate { plan, condition, part });
        }
        let mut numeric = Vec::new();
        for part in &schema.numeric {
            let (plan, condition) = guard(&part.variables, &part.condition);
            numeric.push(EffectTemplate { plan, condition, part });
        }
        SchemaTemplate { index, schema, precondition, effects, numeric }
    }
}

// === impl Instantiation ===

impl Instantiation<'_, '_, '_> {
    pub(super) fn schema(
        &mut self,
        ready: &SchemaTemplate<'_>,
        first_row: usize,
    ) -> Result<(), StopReason> {
        let relations = self.grounder.relations;
        let relation = &relations[action_relation(self.grounder.lifted, ready.index)];
        let mut binding = vec![ObjectId::from_index(0); ready.schema.frame.len().max(1)];
        let mut draft = std::mem::take(&mut self.draft);
        for row in first_row..relation.len() {
            self.work.count_unit()?;
            let arguments = relation.row(row);
            binding[..arguments.len()].copy_from_slice(arguments);
            self.operator(ready, arguments, &mut binding, &mut draft)?;
            self.work.check_memory(self.bytes + self.operators.bytes())?;
        }
        self.draft = draft;
        Ok(())
    }

    fn operator(
        &mut self,
        ready: &SchemaTemplate<'_>,
        arguments: &[ObjectId],
        binding: &mut [ObjectId],
        draft: &mut OperatorDraft,
    ) -> Result<(), StopReason> {
        draft.clear();
        if ready.schema.piece_of.is_none() {
            draft.cost = self.grounder.lifted.costs.per_step;
        }
        let frame = &ready.schema.frame;
        let Instantiation { grounder, work, .. } = self;
        let mut rest =
            ready.precondition.ground(grounder, frame, binding, work, &mut draft.preconditions)?;
        if rest == GroundFormula::False {
            return Ok(());
        }
        for guarded in &ready.effects {
            self.effect(guarded, frame, binding, draft)?;
        }
        for guarded in &ready.numeric {
            self.numeric(guarded, ready, binding, draft, &mut rest)?;
        }
        if self.grounder.lifted.costs.varies {
            // In the initial state the step may even have a negative cost, and its later cost is
            // unknown.
            draft.cost = draft.cost.max(0.0);
        }
        let schema = ready.index as u32;
        match rest {
            GroundFormula::False => (),
            GroundFormula::True => {
                let preconditions = std::mem::take(&mut draft.preconditions);
                draft.operator(schema, arguments, &preconditions, self.operators);
                draft.preconditions = preconditions;
            }
            rest => {
                let max = PRECONDITION_ALTERNATIVES_MAX;
                for mut preconditions in self.auxiliaries.conjunctions(&rest, max, self.top) {
                    preconditions.extend_from_slice(&draft.preconditions);
                    if tidy(&mut preconditions) {
                        draft.operator(schema, arguments, &preconditions, self.operators);
                    }
                }
            }
        }
        Ok(())
    }

    fn effect(
        &mut self,
        guarded: &EffectTemplate<'_, LiftedEffect>,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        draft: &mut OperatorDraft,
    ) -> Result<(), StopReason> {
        let EffectTemplate { plan, condition, part } = guarded;
        self.each(plan.as_ref(), frame, binding, &mut |this, binding| {
            let Some(fact) = this.grounder.fact(&part.atom, binding) else { return Ok(()) };
            let tree = this.condition(condition, frame, binding)?;
            let mut add = |conditions: &[Literal]| {
                let changes = draft.under(conditions);
                if part.adds { changes.adds.push(fact) } else { changes.deletes.push(fact) }
            };
            match tree {
                GroundFormula::False => (),
                GroundFormula::True => add(&this.literals),
                tree => {
                    let max = CONDITION_ALTERNATIVES_MAX;
                    for mut conditions in this.auxiliaries.conjunctions(&tree, max, this.top) {
                        conditions.extend_from_slice(&this.literals);
                        if tidy(&mut conditions) {
                            add(&conditions);
                        }
                    }
                }
            }
            Ok(())
        })
    }

    /// Grounds a condition. Stores its literals in `self.literals` and returns its other parts.
    fn condition(
        &mut self,
        condition: &ConjunctionTemplate,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
    ) -> Result<GroundFormula, StopReason> {
        let Instantiation { grounder, work, literals, .. } = self;
        literals.clear();
        condition.ground(grounder, frame, binding, work, literals)
    }

    fn numeric(
        &mut self,
        guarded: &EffectTemplate<'_, LiftedNumeric>,
        ready: &SchemaTemplate<'_>,
        binding: &mut [ObjectId],
        draft: &mut OperatorDraft,
        rest: &mut GroundFormula,
    ) -> Result<(), StopReason> {
        let lifted = self.grounder.lifted;
        let EffectTemplate { plan, condition, part: change } = guarded;
        let frame = &ready.schema.frame;
        let function = change.fluent.function;
        // Two changes of one fluent may contradict each other, so both must stay numeric changes.
        let rivals = ready.numeric.iter().filter(|other| other.part.fluent.function == function);
        let is_fluent = lifted.functions[function].is_numeric_fluent();
        let is_followed = is_fluent || rivals.count() > 1;
        let mut weights = lifted.costs.weights.iter().flatten();
        let is_counted = weights.any(|(weighted, ..)| *weighted == function);
        self.each(plan.as_ref(), frame, binding, &mut |this, binding| {
            let tree = this.condition(condition, frame, binding)?;
            if tree == GroundFormula::False {
                return Ok(());
            }
            let values = &mut this.grounder.values;
            let mut value = values.ground(&change.value, binding);
            if change.assignment == Assignment::ScaleDown && value == ExpressionValue::Fixed(0.0) {
                value = ExpressionValue::Undefined;
            }
            let is_defined = change.assignment == Assignment::Assign
                || is_fluent
                || values.initially(&change.fluent, binding).is_some();
            if value == ExpressionValue::Undefined || !is_defined {
                this.warn_undefined(change, ready.schema);
                let before = std::mem::replace(rest, GroundFormula::True);
                *rest = GroundFormula::and([before, this.whole(tree).negated()]);
                return Ok(());
            }
            let at_first = match &value {
                ExpressionValue::Fixed(amount) => Some(*amount),
                ExpressionValue::Varying(amount) => values.initial_value(amount),
                ExpressionValue::Undefined => None,
            };
            if let (true, Some(amount)) = (is_counted, at_first) {
                let more = cost(lifted, &change.fluent, binding, change.assignment, amount);
                draft.cost = Arithmetic::Add.apply(draft.cost, more);
            }
            let is_uncertain = match &value {
                ExpressionValue::Varying(_) if !is_counted || at_first.is_none() => true,
                ExpressionValue::Varying(amount) => amount.may_fail(),
                value => may_outgrow(change.assignment, value),
            };
            let is_read = lifted.functions[function].read || !is_counted;
            let may_conflict = change.assignment == Assignment::Assign;
            if is_uncertain || (is_followed && (may_conflict || is_read)) {
                let Some(value) = value.into_expression() else { return Ok(()) };
                let fluent = this.grounder.values.fluent(&change.fluent, binding);
                let change = NumericChange { fluent, assignment: change.assignment, value };
                let whole = this.whole(tree);
                // One conjunction only: the amount could otherwise be added several times.
                for conditions in this.auxiliaries.conjunctions(&whole, 1, this.top) {
                    draft.under(&conditions).numeric.push(change.clone());
                }
            }
            Ok(())
        })
    }

    /// Returns the condition that was grounded last as one tree: the literals in `self.literals`,
    /// and its other parts in `rest`.
    fn whole(&self, rest: GroundFormula) -> GroundFormula {
        let literals = self.literals.iter().map(|literal| GroundFormula::Literal(*literal));
        GroundFormula::and(literals.chain([rest]))
    }

    /// Calls `found` for every binding of the variables of an effect.
    fn each(
        &mut self,
        plan: Option<&JoinPlan>,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        found: BindingCallback<'_, Self>,
    ) -> Result<(), StopReason> {
        let Some(plan) = plan else { return found(self, binding) };
        let mut bindings = std::mem::take(&mut self.bindings);
        bindings.clear();
        self.grounder.bindings(plan, frame, binding, self.work, &mut bindings)?;
        for inside in bindings.chunks_exact_mut(binding.len()) {
            found(self, inside)?;
        }
        self.bindings = bindings;
        Ok(())
    }

    pub(super) fn axiom(&mut self, axiom: &AxiomTemplate) -> Result<(), StopReason> {
        let relation = &self.grounder.relations[axiom.head];
        // The binding has at least one entry, so that a join without variables also yields a chunk.
        let mut binding = vec![ObjectId::from_index(0); axiom.frame.len().max(1)];
        let mut bindings = Vec::new();
        let AxiomTemplate { plan, body, frame, stratum, .. } = axiom;
        self.grounder.bindings(plan, frame, &mut binding, self.work, &mut bindings)?;
        for inside in bindings.chunks_exact_mut(binding.len()) {
            self.work.count_unit()?;
            let Some(row) = relation.find(&inside[..axiom.parameter_count]) else { continue };
            let head = FactId::from_index(self.grounder.offsets[axiom.head] + row);
            let tree = self.condition(body, frame, inside)?;
            let bodies = match tree {
                GroundFormula::False => Vec::new(),
                GroundFormula::True => vec![self.literals.clone()],
                tree => {
                    let whole = self.whole(tree);
                    self.auxiliaries.conjunctions(&whole, PRECONDITION_ALTERNATIVES_MAX, *stratum)
                }
            };
            for body in bodies {
                self.bytes += size_of::<RawAxiom>() + body.len() * size_of::<Literal>();
                self.axioms.push(RawAxiom { head, body, stratum: *stratum });
            }
            self.work.check_memory(self.bytes)?;
        }
        Ok(())
    }

    pub(super) fn goal(
        &mut self,
        goal: &FormulaTemplate,
        frame: &[TypeIndex],
    ) -> Result<Option<Vec<Literal>>, StopReason> {
        let mut binding = vec![ObjectId::from_index(0); frame.len().max(1)];
        let tree = self.grounder.tree(goal, frame, &mut binding, self.work)?;
        Ok(self.auxiliaries.conjunctions(&tree, 1, self.top).pop())
    }

    fn warn_undefined(&mut self, change: &LiftedNumeric, schema: &LiftedSchema) {
        let or = match change.assignment == Assignment::ScaleDown || change.value.divides() {
            true => ", or divide by zero",
            false => "",
        };
        let message = format!(
            "some instances of `{}` never apply: they use a function value that :init leaves out{or}",
            schema.action()
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

/// Whether a fluent can leave the range of `f64` if a plan repeats this change as often as fits
/// into memory. The change then remains a numeric effect, even if it only adds to the cost of a
/// plan: an operator with an undefined result is not applicable.
fn may_outgrow(assignment: Assignment, amount: &ExpressionValue) -> bool {
    let &ExpressionValue::Fixed(amount) = amount else { return false };
    match assignment {
        Assignment::Assign => false,
        Assignment::Increase | Assignment::Decrease => amount.abs() > 1e290,
        Assignment::ScaleUp => amount.abs() > 1.0,
        Assignment::ScaleDown => amount.abs() < 1.0,
    }
}

/// Returns the cost that a change of a fluent by `amount` adds to a plan. An assignment or a
/// scaling adds none.
fn cost(
    lifted: &Lifted,
    fluent: &LiftedFluent,
    binding: &[ObjectId],
    assignment: Assignment,
    amount: f64,
) -> f64 {
    let weights = lifted.costs.weights.as_deref().unwrap_or_default();
    let sign = match assignment {
        Assignment::Increase => 1.0,
        Assignment::Decrease => -1.0,
        Assignment::Assign | Assignment::ScaleUp | Assignment::ScaleDown => return 0.0,
    };
    let is_it = |objects: &[ObjectId]| {
        let arguments = fluent.arguments.iter().map(|term| term.object(binding));
        objects.iter().copied().eq(arguments)
    };
    let matching = weights.iter().filter(|one| one.0 == fluent.function && is_it(&one.1));
    matching.map(|(_, _, weight)| weight * sign * amount).sum()
}
