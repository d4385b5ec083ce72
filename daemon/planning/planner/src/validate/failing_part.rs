//! Finds the part of a condition that does not hold, and replaces its variables by objects.

use pddl::{Condition, Typed};

use super::bindings::Bindings;
use super::compile::CompilationScope;
use super::compiled::{CompiledCondition, Variable};
use super::model::Model;
use super::query::WorldView;
use super::symbols::Object;
use super::world::World;

/// Search for the part of a condition that does not hold. Every binding is stored twice: by the
/// name of its variable, and by its slot.
pub(super) struct FailingPartSearch<'w> {
    view: WorldView<'w>,
    model: &'w Model,
    scope: CompilationScope<'w>,
    frame: Vec<Object>,
    bindings: Bindings,
}

impl<'w> FailingPartSearch<'w> {
    pub(super) fn new(world: &'w World) -> FailingPartSearch<'w> {
        let model = &*world.model;
        let (view, scope) = (WorldView::of(world), CompilationScope::new(model));
        FailingPartSearch { view, model, scope, frame: Vec::new(), bindings: Bindings::default() }
    }

    /// Binds variables to the objects with the given names.
    pub(super) fn bind<'n>(
        &mut self,
        variables: impl Iterator<Item = (&'n Typed, &'n pddl::Name)>,
    ) {
        for (variable, name) in variables {
            let slots = self.scope.declare(std::slice::from_ref(variable));
            self.frame.resize(self.scope.slot_count(), Object::UNBOUND);
            for declared in slots {
                if let Some(object) = self.model.objects.find(name) {
                    self.frame[declared.slot.index()] = object;
                }
            }
            self.bindings.bind(&variable.name, name.clone());
        }
    }

    /// Returns the smallest part that makes a condition fail, with bound variables replaced by
    /// objects. Returns `None` if the condition holds.
    pub(super) fn part(&mut self, condition: &Condition) -> Option<Condition> {
        let holds = self.holds(condition);
        if self.view.world.work.is_exhausted() {
            return Some(self.bindings.substitute(condition));
        }
        if holds {
            return None;
        }
        let smaller = match condition {
            Condition::And(parts) => parts.iter().find_map(|part| self.part(part)),
            Condition::Or(parts) if parts.len() == 1 => self.part(&parts[0]),
            Condition::Imply(_, right) => self.part(right),
            Condition::Forall(variables, inner) => self.instance(variables, inner),
            _ => None,
        };
        smaller.or_else(|| Some(self.bindings.substitute(condition)))
    }

    fn holds(&mut self, condition: &Condition) -> bool {
        let node = self.compiled(condition);
        self.view.holds(&node, &mut self.frame)
    }

    fn compiled(&mut self, condition: &Condition) -> CompiledCondition {
        let node = self.scope.node(condition, true);
        self.frame.resize(self.scope.slot_count(), Object::UNBOUND);
        node
    }

    /// Returns the failing part of the first instance of a quantified condition that does not hold;
    /// `None` if all instances hold. The order of the instances follows the order of the objects in
    /// the texts.
    fn instance(&mut self, variables: &[Typed], inner: &Condition) -> Option<Condition> {
        let declared = self.scope.declare(variables);
        let node = self.compiled(inner);
        let mut found = None;
        // Enumerates all bindings; the last variable changes fastest.
        let mut at = vec![0; declared.len()];
        let is_possible = declared.iter().all(|variable| variable.extension.len() > 0);
        let mut counting = is_possible.then_some(0);
        while let Some(first) = counting {
            for (variable, at) in declared.iter().zip(&at).skip(first) {
                let object = variable.extension.get(*at).unwrap_or(Object::UNBOUND);
                self.frame[variable.slot.index()] = object;
            }
            if !self.view.world.work.spend(1) {
                break;
            }
            if !self.view.holds(&node, &mut self.frame) {
                found = self.named(variables, &declared, inner);
                break;
            }
            counting = (0..at.len()).rev().find(|index| {
                at[*index] = (at[*index] + 1) % declared[*index].extension.len();
                at[*index] > 0
            });
        }
        for variable in &declared {
            self.frame[variable.slot.index()] = Object::UNBOUND;
        }
        self.scope.forget(variables.len());
        found
    }

    /// Returns the failing part of one instance of a condition: that of the bindings in the frame.
    fn named(
        &mut self,
        variables: &[Typed],
        declared: &[Variable],
        inner: &Condition,
    ) -> Option<Condition> {
        for (variable, declared) in variables.iter().zip(declared) {
            let name = self.model.objects.name(self.frame[declared.slot.index()]);
            let name = name.expect("invariant: what a type has is declared by name");
            self.bindings.bind(&variable.name, name.clone());
        }
        let found = self.part(inner);
        variables.iter().for_each(|_| self.bindings.unbind());
        found
    }
}
