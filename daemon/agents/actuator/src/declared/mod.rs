//! Support for actuators with an action model in the ecosystem file: parsing the model, tracking the
//! facts that its actions change, storing these facts so that they outlive the daemon, and finding the
//! placeholders in what the actions run or ask for.
//!
//! What carries out the actions is the matter of the plugin: a program, an action of ROS 2.

mod facts;
mod file;
mod placeholders;

use agent::{Blueprint, BuildError};
use pddl::{ActionModel, Diagnostic, Domain};

pub use facts::{AgentFacts, UncertainEffect, check_effect};
pub use file::FactFile;
pub use placeholders::{misspelt_placeholder, placeholders};

/// Returns the file of an agent's facts, and its facts: those that are stored, otherwise those of the
/// model.
///
/// # Errors
///
/// Returns an error if the file exists and cannot be read.
pub fn stored_facts(
    blueprint: &Blueprint,
    model: &ActionModel,
) -> Result<(FactFile, AgentFacts), BuildError> {
    let file = FactFile::of(blueprint, model);
    let stored = file.read().map_err(|problem| blueprint.problem(problem))?;
    let facts = AgentFacts::new(stored.unwrap_or_else(|| model.init.clone()));
    Ok((file, facts))
}

/// Parses the action model in the `config` of an agent, and checks it against the ontology.
///
/// # Errors
///
/// Returns an error if the model has a mistake, with its line, or is for another agent or domain.
pub fn declared_model(blueprint: &Blueprint, text: &str) -> Result<ActionModel, BuildError> {
    let (model, found) = checked_model(&blueprint.host.ontology, blueprint.id.as_str(), text);
    if let Some(first) = found.iter().find(|found| found.is_error()) {
        return Err(blueprint.problem(format!("model:{}", first.located(text))));
    }
    model.ok_or_else(|| blueprint.problem("model: it is empty"))
}

/// Parses an action model for the agent `agent`, and checks it against the ontology. Returns the model
/// as far as it can be parsed, and what is found in it, with places in `text`.
pub fn checked_model(
    ontology: &Domain,
    agent: &str,
    text: &str,
) -> (Option<ActionModel>, Vec<Diagnostic>) {
    let parsed = pddl::parse_action_model(text);
    let is_broken = parsed.diagnostics.iter().any(Diagnostic::is_error);
    let Some(model) = parsed.value.filter(|_| !is_broken) else {
        return (None, parsed.diagnostics);
    };
    let domain = &ontology.name;
    let mut found = Vec::new();
    if model.agent.as_str() != agent {
        let message = format!("it is for `{}`", model.agent);
        let help = format!("write (define (agent {agent}) …");
        found.push(Diagnostic::error(model.agent.span(), message).with_help(help));
    }
    if model.domain != *domain {
        let message = format!("it is for the domain `{}`", model.domain);
        let help = format!("write (:domain {domain}), as the ecosystem has it");
        found.push(Diagnostic::error(model.domain.span(), message).with_help(help));
    }
    if found.is_empty() {
        found = pddl::check_action_model(ontology, &model);
    }
    if let Some(action) = model.durative_actions.first() {
        let message = "durative actions are not built yet";
        let help = "describe it as an `:action`";
        found.push(Diagnostic::error(action.name.span(), message).with_help(help));
    }
    (Some(model), found)
}
