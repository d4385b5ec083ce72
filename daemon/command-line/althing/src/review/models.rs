//! Action models in the ecosystem file: shows what is found in them at its own place in the text.

use actuator::checked_model;
use pddl::{ActionModel, Diagnostic, Name, Severity, Span};

use super::Reviewer;
use crate::config::{AgentEntry, moved_goal};

/// The key of an entry's `config` with the text of an action model.
const MODEL: &str = "model";

impl Reviewer<'_> {
    /// Reports the mistakes in the action model of an entry, each at its place in the text. Returns
    /// `false` if the entry has no model, or one without mistakes.
    pub(super) fn say_of_model(&mut self, entry: &AgentEntry, severity: Severity) -> bool {
        let Some(text) = entry.config[MODEL].as_str() else { return false };
        let (_, found) = checked_model(&self.ecosystem.domain, entry.name.as_str(), text);
        let mut mistakes: Vec<Diagnostic> =
            found.into_iter().filter(Diagnostic::is_error).collect();
        let is_wrong = !mistakes.is_empty();
        self.is_complete &= !is_wrong || severity != Severity::Error;
        for found in &mut mistakes {
            found.severity = severity;
            found.message = format!("model of `{}`: {}", entry.name, found.message);
        }
        mistakes.into_iter().for_each(|found| self.say_in_model(entry, found));
        is_wrong
    }

    /// Reports what is found in the action model of an entry; its span is that in the text of the
    /// model.
    pub(super) fn say_in_model(&mut self, entry: &AgentEntry, found: Diagnostic) {
        let path = format!("{}.config.{MODEL}", entry.path);
        let text = entry.config[MODEL].as_str().unwrap_or_default();
        match self.ecosystem.places.find(&path) {
            Some((source, place, true)) => {
                let found = moved_goal(found, &source, place, text);
                self.report.add(&source, [found]);
            }
            _ => self.report_value(&path, found),
        }
    }
}

/// Returns the action model of an entry as its text declares it; `None` if there is none.
pub(super) fn written_model(entry: &AgentEntry) -> Option<ActionModel> {
    pddl::parse_action_model(entry.config[MODEL].as_str()?).into_result().ok()
}

/// Returns the places at which a model declares what has this name, or names the type `name`.
pub(super) fn declarations_of<'m>(model: &'m ActionModel, name: &str) -> Vec<&'m Name> {
    let types = model.types.iter().map(|typed| &typed.name);
    let predicates = model.predicates.iter().map(|it| &it.name);
    let functions = model.functions.iter().map(|it| &it.name);
    let objects = model.objects.iter().map(|it| &it.object.name);
    let actions = model.actions.iter().map(|it| &it.name);
    let axioms = model.derived.iter().map(|it| &it.predicate);
    let all = types.chain(predicates).chain(functions).chain(objects).chain(actions).chain(axioms);
    all.filter(|own| own.as_str() == name).collect()
}

/// Returns the place of the type `ty` in the declarations of a model that are called `name`.
pub(super) fn type_in_declaration(model: &ActionModel, name: &str, ty: &str) -> Option<Span> {
    let predicates = model.predicates.iter().map(|it| (&it.name, &*it.parameters));
    let functions = model.functions.iter().map(|it| (&it.name, &*it.parameters));
    let objects =
        model.objects.iter().map(|it| (&it.object.name, std::slice::from_ref(&it.object)));
    let types = model.types.iter().map(|it| (&it.name, std::slice::from_ref(it)));
    let all = predicates.chain(functions).chain(objects).chain(types);
    let named = all.filter(|(own, _)| own.as_str() == name);
    let mut types = named.flat_map(|(_, typed)| typed).flat_map(|typed| &typed.ty.alternatives);
    types.find(|own| own.as_str() == ty).map(Name::span)
}
