//! Checks of action models against the ontology that they build on.

use super::Checker;
use super::facts::UndeclaredSymbols;
use crate::diagnostic::Diagnostic;
use crate::tree::{ActionModel, Domain, Name, Typed};

impl<'t> Checker<'_, 't> {
    pub(super) fn model(&mut self, ontology: &'t Domain, model: &'t ActionModel) {
        self.foreign_types = Some(&ontology.types);
        self.domain_name(&model.domain, &ontology.name);
        self.requirements(&model.requirements);
        self.types(&model.types);
        self.types_once(&model.types);
        self.model_predicates(ontology, model);
        self.model_functions(ontology, model);
        self.objects(ontology, &model.objects);
        self.init(&model.init, UndeclaredSymbols::Declared);
        self.derived(&model.derived);
        self.actions(&model.actions, &model.durative_actions);
        self.has_itself(model);
    }

    fn model_predicates(&mut self, ontology: &'t Domain, model: &'t ActionModel) {
        self.signatures("predicate", model.predicates.iter().map(|it| (&it.name, &*it.parameters)));
        for own in &model.predicates {
            let shared = ontology.predicates.iter().find(|shared| shared.name == own.name);
            if let Some(shared) = shared.filter(|it| !unify(&it.parameters, &own.parameters)) {
                self.declared_otherwise(&own.name, shared.to_string());
            }
        }
    }

    fn model_functions(&mut self, ontology: &'t Domain, model: &'t ActionModel) {
        self.signatures("function", model.functions.iter().map(|it| (&it.name, &*it.parameters)));
        for own in &model.functions {
            self.named_like_a_predicate(&own.name);
            let shared = ontology.functions.iter().find(|shared| shared.name == own.name);
            if let Some(shared) = shared.filter(|it| !unify(&it.parameters, &own.parameters)) {
                self.declared_otherwise(&own.name, shared.to_string());
            }
        }
    }

    fn declared_otherwise(&mut self, name: &'t Name, shared: String) {
        let message = format!("the ontology declares `{name}` differently, and takes precedence");
        self.report(Diagnostic::warning(name.span(), message).with_rule(shared));
    }

    /// Checks that the model of an agent with actions declares the agent as an object, because the
    /// agent is an argument of its actions.
    fn has_itself(&mut self, model: &'t ActionModel) {
        let acts = model.actions.iter().any(|action| action.agent.is_some())
            || model.durative_actions.iter().any(|action| action.agent.is_some());
        let is_object = |object: &Typed| object.name == model.agent;
        if acts && !model.objects.iter().any(|declaration| is_object(&declaration.object)) {
            let message = format!("the agent `{}` is not among its objects", model.agent);
            let help = format!("add `(:objects {} - TYPE)`", model.agent);
            self.report(Diagnostic::warning(model.agent.span(), message).with_help(help));
        }
    }
}

/// Whether two declarations are equal except for the names of their variables.
fn unify(left: &[Typed], right: &[Typed]) -> bool {
    left.iter().map(|typed| &typed.ty).eq(right.iter().map(|typed| &typed.ty))
}
