//! Support for actuators with an action model in the ecosystem file: parsing the model, tracking the
//! facts that its actions change, storing these facts so that they outlive the daemon, and finding the
//! placeholders in what the actions run or ask for.
//!
//! What carries out the actions is the matter of the plugin: a program, an action of ROS 2.

mod facts;
mod file;
mod placeholders;

use agent::{Blueprint, BuildError};
use pddl::ActionModel;

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
    let parsed = pddl::parse_action_model(text);
    if let Some(first) = parsed.diagnostics.iter().find(|found| found.is_error()) {
        return Err(blueprint.problem(format!("model:{}", first.located(text))));
    }
    let nothing = || blueprint.problem("model: it is empty");
    let model = parsed.value.ok_or_else(nothing)?;
    let (id, domain) = (blueprint.id.as_str(), &blueprint.host.ontology.name);
    if model.agent.as_str() != id {
        let problem = format!("model: it is for `{}`; write (define (agent {id}) …", model.agent);
        return Err(blueprint.problem(problem));
    }
    if model.domain != *domain {
        let problem = format!("model: write (:domain {domain}), as the ecosystem has it");
        return Err(blueprint.problem(problem));
    }
    let found = pddl::check_action_model(&blueprint.host.ontology, &model);
    if let Some(first) = found.iter().find(|found| found.is_error()) {
        return Err(blueprint.problem(format!("model:{}", first.located(text))));
    }
    if !model.durative_actions.is_empty() {
        return Err(blueprint.problem("model: durative actions are not built yet"));
    }
    Ok(model)
}
