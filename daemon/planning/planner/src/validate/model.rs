//! The constant part of a [`super::World`]: names and their numbers, types, objects, axioms and
//! actions. Each action is compiled on first use.
//!
//! Only the validator uses this module. Grounding and search have tables of their own, so that one
//! mistake cannot affect both.

use std::sync::{Arc, OnceLock};

use pddl::{
    ActionSchema, Derived, Diagnostic, Domain, Effect, Metric, Name, Problem, Term, TypeExpr, Types,
};
use rustc_hash::FxHashMap;

use super::axioms::AxiomComponents;
use super::compile;
use super::compiled::CompiledAction;
use super::symbols::{Extension, Objects, RelationTable};

/// The constant part of a [`super::World`], shared by all states of the same domain and problem.
#[derive(Debug)]
pub(crate) struct Model {
    pub(super) actions: Vec<ActionSchema>,
    pub(super) derived: Vec<Derived>,
    durative: Vec<Name>,
    pub(super) metric: Option<Metric>,
    pub(super) objects: Objects,
    pub(super) predicates: RelationTable,
    pub(super) functions: RelationTable,
    pub(super) axioms: AxiomComponents,
    types: Types,
    /// Objects of each declared type, computed on first use.
    extensions: FxHashMap<Name, OnceLock<Arc<Extension>>>,
    /// For each action in `actions`: its compiled form.
    schemas: Vec<OnceLock<CompiledAction>>,
    /// For each name: the positions in `actions` of the actions with that name. Several actions may
    /// share one name.
    actions_by_name: FxHashMap<Name, Vec<usize>>,
}

// === impl Model ===

impl Model {
    pub(crate) fn new(domain: &Domain, problem: &Problem) -> Result<Model, Vec<Diagnostic>> {
        let types = Types::of(domain);
        let mut model = Model {
            actions: domain.actions.clone(),
            derived: domain.derived.clone(),
            durative: domain.durative_actions.iter().map(|action| action.name.clone()).collect(),
            metric: problem.metric.clone(),
            objects: Objects::default(),
            predicates: RelationTable::default(),
            functions: RelationTable::default(),
            axioms: AxiomComponents::default(),
            extensions: types.iter().map(|ty| (ty.clone(), OnceLock::new())).collect(),
            types,
            schemas: domain.actions.iter().map(|_| OnceLock::new()).collect(),
            actions_by_name: FxHashMap::default(),
        };
        for (index, action) in domain.actions.iter().enumerate() {
            model.actions_by_name.entry(action.name.clone()).or_default().push(index);
        }
        model.number(domain, problem);
        model.axioms = AxiomComponents::of(domain, &model.predicates, &model.functions)?;
        Ok(model)
    }

    /// Returns all objects of a type, without duplicates, in the order of the texts.
    pub(crate) fn members(&self, ty: &TypeExpr) -> Vec<Name> {
        let extension = self.extension(ty);
        extension.iter().filter_map(|object| self.objects.name(object)).cloned().collect()
    }

    /// Whether the object is declared and belongs to the type.
    pub(crate) fn is_a(&self, object: &Name, ty: &TypeExpr) -> bool {
        let object = self.objects.declared(object);
        object.is_some_and(|object| self.extension(ty).contains(object))
    }

    pub(super) fn extension(&self, ty: &TypeExpr) -> Arc<Extension> {
        let known = match ty.alternatives.as_slice() {
            [one] => self.extensions.get(one),
            _ => None,
        };
        let found = || self.objects.extension(ty, &self.types);
        known.map_or_else(found, |known| Arc::clone(known.get_or_init(found)))
    }

    /// Returns the positions of the actions with this name, in the order of the texts.
    pub(super) fn named(&self, name: &Name) -> &[usize] {
        self.actions_by_name.get(name).map_or(&[], Vec::as_slice)
    }

    /// Whether a durative action has this name.
    pub(super) fn is_durative(&self, name: &Name) -> bool {
        self.durative.contains(name)
    }

    /// Returns the compiled form of the action at this position.
    pub(super) fn schema(&self, index: usize) -> &CompiledAction {
        let compiled = || compile::schema(self, &self.actions[index]);
        self.schemas[index].get_or_init(compiled)
    }

    /// Returns the axioms that derive a predicate. The list is empty if the predicate depends on
    /// itself.
    pub(crate) fn definitions(&self, predicate: &Name) -> Vec<&Derived> {
        let of = |name: &Name| {
            let name = name.clone();
            self.derived.iter().filter(move |axiom| axiom.predicate == name)
        };
        let mut below: Vec<&Name> = vec![predicate];
        let mut at = 0;
        while at < below.len() {
            for axiom in of(below[at]) {
                for used in axiom.condition.atoms().map(|atom| &atom.predicate) {
                    if used == predicate {
                        return Vec::new();
                    }
                    if !below.contains(&used) {
                        below.push(used);
                    }
                }
            }
            at += 1;
        }
        of(predicate).collect()
    }

    /// Whether a predicate is static: no action adds or deletes its facts, and no axiom derives it.
    pub(crate) fn is_static(&self, predicate: &Name) -> bool {
        let is_change = |part: &Effect| match part {
            Effect::Add(atom) | Effect::Delete(atom) => atom.predicate == *predicate,
            _ => false,
        };
        let changes = |action: &ActionSchema| action.effect.parts().any(is_change);
        !self.derived.iter().any(|axiom| axiom.predicate == *predicate)
            && !self.actions.iter().any(changes)
    }

    /// Assigns numbers to the objects, and to the predicates and functions that the domain declares
    /// or that effects change.
    fn number(&mut self, domain: &Domain, problem: &Problem) {
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        domain.constants.iter().chain(declared).for_each(|object| self.objects.declare(object));
        for predicate in &domain.predicates {
            self.predicates.insert(&predicate.name, predicate.parameters.len());
        }
        for axiom in &domain.derived {
            self.predicates.insert(&axiom.predicate, axiom.parameters.len());
        }
        domain.actions.iter().for_each(|action| self.number_effect(&action.effect));
    }

    fn number_effect(&mut self, effect: &Effect) {
        match effect {
            Effect::And(parts) => parts.iter().for_each(|part| self.number_effect(part)),
            Effect::When(_, inner) | Effect::Forall(_, inner) => self.number_effect(inner),
            Effect::Add(atom) | Effect::Delete(atom) => {
                self.predicates.insert(&atom.predicate, atom.arguments.len());
                self.number_objects(&atom.arguments);
            }
            Effect::Assign(assign) => {
                self.functions.insert(&assign.fluent.function, assign.fluent.arguments.len());
                self.number_objects(&assign.fluent.arguments);
            }
        }
    }

    fn number_objects(&mut self, terms: &[Term]) {
        for term in terms {
            if let Term::Object(name) = term {
                self.objects.insert(name);
            }
        }
    }
}
