//! Walks over conditions and effects: the variables that they use, and the functions.

use std::collections::BTreeSet;

use pddl::{Condition, Effect, Expression, FluentTerm, Name, Term, Typed};

/// What a condition or an effect uses.
#[derive(Default)]
pub(crate) struct UsedTerms {
    /// Variables, bound ones included.
    pub(crate) variables: BTreeSet<Name>,
    /// Objects that are named.
    pub(crate) objects: BTreeSet<Name>,
    pub(crate) functions: BTreeSet<Name>,
    /// The variables that quantifiers declare.
    pub(crate) declared: Vec<Typed>,
}

// === impl UsedTerms ===

impl UsedTerms {
    pub(crate) fn terms(&mut self, terms: &[Term]) {
        for term in terms {
            match term {
                Term::Variable(name) => self.variables.insert(name.clone()),
                Term::Object(name) => self.objects.insert(name.clone()),
            };
        }
    }

    pub(crate) fn fluent(&mut self, fluent: &FluentTerm) {
        self.functions.insert(fluent.function.clone());
        self.terms(&fluent.arguments);
    }

    pub(crate) fn expression(&mut self, expression: &Expression) {
        match expression {
            Expression::Fluent(fluent) => self.fluent(fluent),
            Expression::Negate(inner) => self.expression(inner),
            Expression::Apply(_, operands) => {
                operands.iter().for_each(|operand| self.expression(operand));
            }
            Expression::Number(_)
            | Expression::Duration(_)
            | Expression::ContinuousTime(_)
            | Expression::TotalTime(_) => (),
        }
    }

    pub(crate) fn condition(&mut self, condition: &Condition) {
        match condition {
            Condition::Atom(atom) => self.terms(&atom.arguments),
            Condition::Equal(left, right, _) => self.terms(&[left.clone(), right.clone()]),
            Condition::Compare(compare) => {
                self.expression(&compare.left);
                self.expression(&compare.right);
            }
            Condition::Not(inner) => self.condition(inner),
            Condition::Exists(variables, inner) | Condition::Forall(variables, inner) => {
                self.declared.extend(variables.iter().cloned());
                self.condition(inner);
            }
            Condition::And(parts) | Condition::Or(parts) => {
                parts.iter().for_each(|part| self.condition(part));
            }
            Condition::Imply(left, right) => {
                self.condition(left);
                self.condition(right);
            }
        }
    }

    pub(crate) fn effect(&mut self, effect: &Effect) {
        match effect {
            Effect::And(parts) => parts.iter().for_each(|part| self.effect(part)),
            Effect::Add(atom) | Effect::Delete(atom) => self.terms(&atom.arguments),
            Effect::Assign(assign) => {
                self.fluent(&assign.fluent);
                self.expression(&assign.value);
            }
            Effect::Forall(variables, inner) => {
                self.declared.extend(variables.iter().cloned());
                self.effect(inner);
            }
            Effect::When(condition, inner) => {
                self.condition(condition);
                self.effect(inner);
            }
        }
    }
}

/// Returns what a condition uses.
pub(crate) fn used_by(condition: &Condition) -> UsedTerms {
    let mut used = UsedTerms::default();
    used.condition(condition);
    used
}
