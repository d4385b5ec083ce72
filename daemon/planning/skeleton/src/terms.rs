//! The variables, objects and functions that conditions and effects use.

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
    pub(crate) fn terms<'t>(&mut self, terms: impl IntoIterator<Item = &'t Term>) {
        for term in terms {
            match term {
                Term::Variable(name) => self.variables.insert(name.clone()),
                Term::Object(name) => self.objects.insert(name.clone()),
            };
        }
    }

    fn fluent(&mut self, fluent: &FluentTerm) {
        self.functions.insert(fluent.function.clone());
        self.terms(&fluent.arguments);
    }

    pub(crate) fn expression(&mut self, expression: &Expression) {
        expression.fluents().for_each(|fluent| self.fluent(fluent));
    }

    pub(crate) fn condition(&mut self, condition: &Condition) {
        for part in condition.parts() {
            match part {
                Condition::Atom(atom) => self.terms(&atom.arguments),
                Condition::Equal(left, right, _) => self.terms([left, right]),
                Condition::Compare(compare) => {
                    self.expression(&compare.left);
                    self.expression(&compare.right);
                }
                Condition::Exists(variables, _) | Condition::Forall(variables, _) => {
                    self.declared.extend(variables.iter().cloned());
                }
                _ => (),
            }
        }
    }

    pub(crate) fn effect(&mut self, effect: &Effect) {
        for part in effect.parts() {
            match part {
                Effect::Add(atom) | Effect::Delete(atom) => self.terms(&atom.arguments),
                Effect::Assign(assign) => {
                    self.fluent(&assign.fluent);
                    self.expression(&assign.value);
                }
                Effect::Forall(variables, _) => self.declared.extend(variables.iter().cloned()),
                Effect::When(condition, _) => self.condition(condition),
                Effect::And(_) => (),
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
