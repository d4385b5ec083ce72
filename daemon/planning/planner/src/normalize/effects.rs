//! Flattens effects: converts the syntax tree of an effect to a list of conditional literals and
//! numeric changes.

use pddl::{ActionSchema, Assign, Effect};

use super::formula::FormulaScope;
use super::lifted::{Formula, LiftedEffect, LiftedNumeric, LiftedSchema, SlotIndex};
use super::symbols::SymbolTable;

/// Context of an effect: the variables of the `forall`s and the conditions of the `when`s around
/// it.
#[derive(Clone, Default)]
struct EffectContext {
    variables: Vec<SlotIndex>,
    conditions: Vec<Formula>,
}

/// Normalizes an action: converts its precondition and effects to numbered symbols.
pub(super) fn schema(symbols: &mut SymbolTable, action: &ActionSchema) -> LiftedSchema {
    let mut scope = FormulaScope::new(symbols, action.all_parameters());
    let parameter_count = scope.frame.len();
    let precondition = scope.rearranged(&action.precondition);
    let mut flat = EffectFlattener { scope, effects: Vec::new(), numeric: Vec::new() };
    flat.effect(&action.effect, &EffectContext::default());
    LiftedSchema {
        name: action.name.clone(),
        piece_of: None,
        parameter_count,
        frame: flat.scope.frame,
        precondition,
        effects: flat.effects,
        numeric: flat.numeric,
        span: action.span,
    }
}

struct EffectFlattener<'s> {
    scope: FormulaScope<'s>,
    effects: Vec<LiftedEffect>,
    numeric: Vec<LiftedNumeric>,
}

// === impl EffectFlattener ===

impl EffectFlattener<'_> {
    fn effect(&mut self, effect: &Effect, guard: &EffectContext) {
        match effect {
            Effect::And(parts) => parts.iter().for_each(|part| self.effect(part, guard)),
            Effect::Add(atom) => self.literal(atom, true, guard),
            Effect::Delete(atom) => self.literal(atom, false, guard),
            Effect::Assign(assign) => self.numeric(assign, guard),
            Effect::When(condition, inner) => {
                let mut guard = guard.clone();
                guard.conditions.push(self.scope.rearranged(condition));
                self.effect(inner, &guard);
            }
            Effect::Forall(variables, inner) => {
                let (outside, slots) = self.scope.enter(variables);
                let mut guard = guard.clone();
                guard.variables.extend(slots);
                self.effect(inner, &guard);
                self.scope.leave(outside);
            }
        }
    }

    fn literal(&mut self, atom: &pddl::Atom, adds: bool, guard: &EffectContext) {
        if let Some(atom) = self.scope.atom(atom) {
            self.effects.push(LiftedEffect {
                variables: guard.variables.clone(),
                condition: Formula::And(guard.conditions.clone()),
                adds,
                atom,
            });
        }
    }

    fn numeric(&mut self, assign: &Assign, guard: &EffectContext) {
        let fluent = self.scope.fluent(&assign.fluent);
        if let (Some(fluent), Some(value)) = (fluent, self.scope.expression(&assign.value)) {
            self.numeric.push(LiftedNumeric {
                variables: guard.variables.clone(),
                condition: Formula::And(guard.conditions.clone()),
                assignment: assign.assignment,
                fluent,
                value,
                span: assign.span,
            });
        }
    }
}
