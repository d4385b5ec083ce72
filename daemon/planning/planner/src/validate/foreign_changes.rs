//! Changes of a state by steps that the domain of the state does not contain: the steps of other
//! agents, of which only the changes are known.

use std::sync::Arc;

use pddl::{Atom, FluentTerm, InitElement, Name, Number, TOTAL_COST};

use super::symbols::{Object, RelationId};
use super::world::{World, by_name};

impl World {
    /// Returns what differs in the state `later` of the same domain and problem: the facts that
    /// became true, the facts that became false, and the new values of functions. Derived facts and
    /// the value of `total-cost` are left out.
    pub fn changes_to(&self, later: &World) -> Vec<InitElement> {
        let news = |from: &World, to: &World| {
            to.claimed_where(|relation, tuple| {
                let known = from.facts.get(relation.index());
                !known.is_some_and(|facts| facts.contains(|column| tuple[column]))
            })
        };
        let added = news(self, later).into_iter().map(InitElement::Atom);
        let deleted = news(later, self).into_iter().map(InitElement::Not);
        added.chain(deleted).chain(self.new_values(later)).collect()
    }

    /// Returns the values of functions that differ in the state `later`, without `total-cost`.
    fn new_values(&self, later: &World) -> Vec<InitElement> {
        let mut changed = Vec::new();
        for function in self.model.functions.iter() {
            let name = self.model.functions.name(function);
            // The cost of a plan is no fact about the world.
            if *name == *TOTAL_COST {
                continue;
            }
            for (tuple, value) in later.values[function.index()].iter() {
                let before = self.values[function.index()].get(|column| tuple[column]);
                if before != Some(value) {
                    changed.extend(self.named(name, tuple).map(|fluent| (fluent, value)));
                }
            }
        }
        changed.sort_by(|(left, _), (right, _)| by_name(left, right));
        let element = |(Atom { predicate: function, arguments, span }, value)| {
            InitElement::Assign(FluentTerm { function, arguments, span }, Number(value))
        };
        changed.into_iter().map(element).collect()
    }

    /// Makes changes by others: facts that became true or false, and new values of functions.
    /// Leaves out what names a predicate, a function or an object that this state does not have.
    pub fn take_changes(&mut self, changes: &[InitElement]) {
        let model = Arc::clone(&self.model);
        for change in changes {
            match change {
                InitElement::Atom(atom) | InitElement::Not(atom) => {
                    let relation = model.predicates.find(&atom.predicate, atom.arguments.len());
                    let names = atom.arguments.iter().map(pddl::Term::name);
                    let Some((relation, tuple)) = self.found(relation, names) else { continue };
                    let facts = &mut self.facts[relation.index()];
                    let has_changed = match change {
                        InitElement::Not(_) => facts.remove(&tuple),
                        _ => facts.insert(&tuple),
                    };
                    if has_changed {
                        self.invalidate(model.axioms.fact_readers(relation));
                    }
                }
                InitElement::Assign(fluent, number) => {
                    let relation = model.functions.find(&fluent.function, fluent.arguments.len());
                    let names = fluent.arguments.iter().map(pddl::Term::name);
                    let Some((relation, tuple)) = self.found(relation, names) else { continue };
                    self.values[relation.index()].set(&tuple, number.0);
                    self.invalidate(model.axioms.value_readers(relation));
                }
                InitElement::Unknown(_) | InitElement::At(..) => (),
            }
        }
    }

    /// Returns a known relation with the known objects of these names; `None` if one is not known.
    fn found<'n>(
        &self,
        relation: Option<RelationId>,
        names: impl Iterator<Item = &'n Name>,
    ) -> Option<(RelationId, Vec<Object>)> {
        let objects = names.map(|name| self.model.objects.find(name));
        Some((relation?, objects.collect::<Option<_>>()?))
    }
}
