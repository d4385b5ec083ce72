//! Composes the action models of all agents as the Domain Maintainer does, and reports what it would
//! leave out: an agent loses an action, or a goal a word, and no other check sees it.

use std::collections::BTreeMap;

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use capability::{
    Announcement, Conflict, Maintainer, MaintainerScope, ModelPartKind, Timestamp, model_digest,
};
use pddl::{ActionModel, Diagnostic, Span, nearest};

use super::Reviewer;
use super::config_value::keys_called;
use super::models::{declarations_of, type_in_declaration, written_model};
use crate::config::AgentEntry;

/// Plugins that bring agents with models of their own, which are known only while they run.
const GATEWAYS: &[&str] = &["mqtt"];

/// Words of a conflict about a name that nothing declares. A model that is not known here may declare it.
const UNDECLARED: &[&str] = &["which is not declared", "which is not here"];

impl Reviewer<'_> {
    /// Warns of each part of an action model that is left out of the composed domain.
    pub(super) fn composition(&mut self, models: &BTreeMap<AgentId, ActionModel>) {
        let ecosystem = self.ecosystem;
        let (map, ontology) = (ecosystem.problem.clone(), ecosystem.domain.clone());
        let mut maintainer = Maintainer::new(ontology, map, MaintainerScope::Everything);
        let now = Timestamp::default();
        // The agents join in the order of the file: of two that disagree, the first one is right.
        for entry in &ecosystem.agents {
            let Some(model) = models.get(&entry.name) else { continue };
            let (methods, digest) = (Methods::new(), model.to_string());
            let digest = model_digest(&digest, &methods);
            let (name, model) = (entry.name.clone(), model.clone());
            let joins = Announcement::new(name, Incarnation::default(), model, methods, &digest);
            if let Err(declined) = maintainer.add_model(joins, now) {
                let message = format!("the model of `{}` is left out: {declined}", entry.name);
                let found = Diagnostic::warning(Span::default(), message);
                self.report_value(&format!("{}.name", entry.path), found);
            }
        }
        let conflicts = maintainer.compose_added(now).conflicts;
        let knows_all = self.knows_all_models();
        let is_certain = |conflict: &&Conflict| {
            knows_all || !UNDECLARED.iter().any(|words| conflict.detail.contains(words))
        };
        let causes = conflicts.iter().filter(is_certain);
        let causes: Vec<&Conflict> = causes.filter(|it| !is_consequence(it, &conflicts)).collect();
        causes.into_iter().for_each(|conflict| self.say_of_conflict(conflict));
    }

    /// Whether no agent beside those of the file may declare a name.
    fn knows_all_models(&self) -> bool {
        let is_known =
            |entry: &AgentEntry| entry.is_built_in() && !GATEWAYS.contains(&entry.plugin.as_str());
        self.ecosystem.interfaces.is_empty() && self.ecosystem.agents.iter().all(is_known)
    }

    /// Reports a part that is left out: in the text of the model, at the key of the `config` that brings
    /// the object, or at the name of the agent.
    fn say_of_conflict(&mut self, conflict: &Conflict) {
        let Some(loser) = conflict.agents.last() else { return };
        let mut entries = self.ecosystem.agents.iter();
        let Some(entry) = entries.find(|entry| entry.name == *loser) else { return };
        let name = conflict.subject.name.as_str();
        let message = format!("{} of `{loser}` is left out: {}", conflict.subject, conflict.detail);
        let mut found = Diagnostic::warning(Span::default(), message);
        let unknown = undeclared_type(conflict);
        let suggested = unknown.and_then(|ty| self.similar_type(entry, ty));
        found.help = match (suggested, conflict.subject.kind) {
            (Some(near), _) => Some(format!("did you mean `{near}`?")),
            (None, ModelPartKind::Action) => None,
            (None, _) if unknown.is_some() => Some("declare the type under `:types`".to_owned()),
            (None, ModelPartKind::Object) => Some(format!("give `{name}` another name")),
            (None, _) => Some("declare it in the same way, or give it another name".to_owned()),
        };
        if let Some(model) = written_model(entry) {
            let place = unknown.and_then(|ty| type_in_declaration(&model, name, ty));
            let declared = declarations_of(&model, name);
            let place = place.or_else(|| declared.first().map(|declared| declared.span()));
            found.span = place.unwrap_or_else(|| model.agent.span());
            return self.say_in_model(entry, found);
        }
        match keys_called(&entry.config, name).first() {
            Some(key) => {
                self.report_key(&format!("{}.config.{}", entry.path, key.join(".")), found);
            }
            None => self.report_value(&format!("{}.name", entry.path), found),
        }
    }

    /// Returns the type of the ontology or of the entry's model that was probably meant by `ty`.
    fn similar_type(&self, entry: &AgentEntry, ty: &str) -> Option<String> {
        let model = written_model(entry);
        let own = model.iter().flat_map(|model| &model.types);
        let types: Vec<_> = own.chain(&self.ecosystem.domain.types).collect();
        nearest(ty, types.iter().map(|typed| typed.name.as_str())).map(str::to_owned)
    }
}

/// Whether a part is left out only because another part of the same model is, which it uses.
fn is_consequence(conflict: &Conflict, all: &[Conflict]) -> bool {
    let is_use = matches!(conflict.subject.kind, ModelPartKind::Action | ModelPartKind::Axiom);
    is_use
        && all.iter().any(|cause| {
            cause.subject != conflict.subject
                && cause.agents.last() == conflict.agents.last()
                && conflict.detail.contains(&format!("`{}`", cause.subject.name))
        })
}

/// Returns the type that nothing declares, according to a conflict.
fn undeclared_type(conflict: &Conflict) -> Option<&str> {
    let (_, rest) = conflict.detail.split_once("it uses the type `")?;
    rest.strip_suffix("`, which is not declared")
}
