//! Builds every agent of an ecosystem without letting it live, to say what is wrong with the
//! plugins' own part of each entry, and where.

use std::collections::BTreeMap;
use std::sync::Arc;

use ::building::{Building, Layout};
use acl::AgentId;
use agent::{BuildError, Host, Rehearsal, Resources};
use pddl::{ActionModel, Diagnostic, Span};
use serde_json::Value;
use terminal::report::Report;

use super::{HostError, supervisor};
use crate::config::{AgentEntry, Ecosystem};

/// What is wrong with the agents' entries, said as `up` would say it.
///
/// Nothing is opened and nothing written; files that only an agent's own machine has are not read.
pub(crate) fn rehearse(ecosystem: &Ecosystem) -> Report {
    let mut report = Report::default();
    let host = host(ecosystem);
    for (index, entry) in ecosystem.agents.iter().enumerate() {
        // What a package brings, only the machine knows that has the package.
        if entry.is_built_in()
            && let Err(error) = supervisor::rehearse(entry, &host).map(drop)
        {
            let path = culprit(entry, &host, &error);
            report_at(ecosystem, &format!("agent.{index}.config{path}"), &error, &mut report);
        }
    }
    if !report.has_errors()
        && let Err(error) = super::simulate(ecosystem)
    {
        report.add_failure(error);
    }
    report
}

/// The action models of an ecosystem's agents, as far as they can be built: what each would say
/// of itself when it comes.
pub(crate) fn models(ecosystem: &Ecosystem) -> BTreeMap<AgentId, ActionModel> {
    let host = host(ecosystem);
    let model = |entry: &AgentEntry| {
        let text = supervisor::rehearse(entry, &host).ok()?.model()?;
        let model = pddl::parse_action_model(&text).into_result().ok()?;
        Some((entry.name.clone(), model))
    };
    ecosystem.agents.iter().filter(|entry| entry.is_built_in()).filter_map(model).collect()
}

/// What agents are built with that do not live.
fn host(ecosystem: &Ecosystem) -> Arc<Host> {
    let mut resources = Resources::default();
    resources.insert(Rehearsal);
    // Drivers take it in hand, and nobody acts: what is in it does not matter.
    let building = Building::new(Layout::new(), 1.0);
    building.into_iter().for_each(|building| resources.insert(building.handle()));
    Arc::new(Host {
        ontology: Arc::clone(&ecosystem.domain),
        map: Arc::clone(&ecosystem.problem),
        mode: ecosystem.mode,
        settings: ecosystem.settings.clone(),
        journals: ecosystem.journals().cloned().collect(),
        resources,
    })
}

fn report_at(ecosystem: &Ecosystem, path: &str, error: &HostError, report: &mut Report) {
    let message = match error {
        HostError::Build(BuildError::Config { agent, source }) => {
            format!("config of `{agent}`: {source}")
        }
        HostError::Build(BuildError::Other { agent, problem }) => {
            format!("config of `{agent}`: {problem}")
        }
        error => format!("failed to {error}"),
    };
    match ecosystem.places.find(path) {
        Some((source, place, is_it)) => {
            // An unknown key is wrong itself; elsewhere it is the value.
            let is_unknown =
                ["unknown field", "has no key"].iter().any(|say| message.contains(say));
            let is_key = !is_it || is_unknown;
            let span = if is_key { place.key } else { place.value };
            report.add(&source, [Diagnostic::error(span, message)]);
        }
        None => report.add_general(Diagnostic::error(Span::default(), message)),
    }
}

/// The key of an entry's `config` that a mistake is about, as `.key.key`: the one without which
/// there is no mistake, or another. Empty where something is missing.
fn culprit(entry: &AgentEntry, host: &Arc<Host>, error: &HostError) -> String {
    let built = |config: Value| {
        let entry = AgentEntry { config: config.into(), ..entry.clone() };
        supervisor::rehearse(&entry, host).map_err(|error| error.to_string())
    };
    let (is_shape, told) =
        (matches!(error, HostError::Build(BuildError::Config { .. })), error.to_string());
    let mut path: Vec<String> = Vec::new();
    loop {
        let within = path.iter().try_fold(&*entry.config, |value, key| value.get(key));
        let Some(Value::Object(table)) = within else { break };
        let outcome = |key: &String| {
            let path: Vec<&String> = path.iter().chain([key]).collect();
            built(without(Value::clone(&entry.config), &path))
        };
        let is_right = |key: &&String| outcome(key).is_ok();
        // What is needed is missed when it is taken away, which does not blame it.
        let is_other = |key: &&String| {
            outcome(key).is_err_and(|now| {
                now != told && (is_shape || !now.contains(&format!("missing field `{key}`")))
            })
        };
        let next = table.keys().find(is_right).or_else(|| table.keys().find(is_other)).cloned();
        match next {
            Some(key) => path.push(key),
            None => break,
        }
    }
    path.iter().map(|key| format!(".{key}")).collect()
}

/// A value without what stands at this path in it.
fn without(mut value: Value, path: &[&String]) -> Value {
    if let Some((last, tables)) = path.split_last() {
        let within = tables.iter().try_fold(&mut value, |value, key| value.get_mut(key.as_str()));
        if let Some(Value::Object(table)) = within {
            table.remove(last.as_str());
        }
    }
    value
}
