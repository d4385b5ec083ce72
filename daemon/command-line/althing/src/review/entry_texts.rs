//! Checks facts and goals in the `config` of agents against the ontology, the map, and the action
//! models of all agents in the file, because a plugin knows its own agent only. Also checks that an
//! agent with safeguards has actions.

use std::collections::{BTreeMap, BTreeSet};
use std::slice;

use acl::AgentId;
use actuator::placeholders;
use pddl::{ActionModel, Diagnostic, Domain, Problem, Severity, Span};
use serde_json::Value;

use super::Reviewer;
use super::goals::explained_action;
use crate::config::AgentEntry;
use crate::hosting::{self, DryRun};

/// The plugins with facts and with goals in their `config`.
const TELLS_FACTS: &str = "ros2";
const REQUESTS_GOALS: &str = "ptz-camera";

/// Beginning of the name that stands in a fact for the object of a placeholder.
const SAMPLE: &str = "object-of-placeholder-";

/// A fact or a goal in the `config` of an agent.
struct EntryText<'e> {
    entry: &'e AgentEntry,
    /// Path of the text in the ecosystem file.
    path: String,
    /// The text as it is written.
    written: &'e str,
    /// The text without placeholders.
    filled: String,
}

/// The names that the ontology, the map and the agents of the file bring.
struct ComposedNames {
    models: BTreeMap<AgentId, ActionModel>,
    domain: Domain,
    problem: Problem,
    /// Names of the agents without a known action model.
    agents: BTreeSet<String>,
}

impl Reviewer<'_> {
    /// Reports names that nothing declares, and wrong arguments, in facts and goals of entries.
    pub(super) fn entry_texts(&mut self) {
        let ecosystem = self.ecosystem;
        let of = |plugin: &'static str| {
            let entries = ecosystem.agents.iter().filter(|entry| entry.is_built_in());
            entries.filter(move |entry| entry.plugin == plugin)
        };
        let facts: Vec<EntryText<'_>> = of(TELLS_FACTS).flat_map(facts_of).collect();
        let goals: Vec<EntryText<'_>> = of(REQUESTS_GOALS).filter_map(goal_of).collect();
        if facts.is_empty() && goals.is_empty() {
            return;
        }
        let models = hosting::models(ecosystem);
        let (domain, problem) = self.widened(&models);
        let agents = self.agents(&models);
        let known = ComposedNames { models, domain, problem, agents };
        // An entry that cannot be built is reported already.
        let is_built = |text: &&EntryText<'_>| known.models.contains_key(&text.entry.name);
        for fact in facts.iter().filter(is_built) {
            self.told_fact(fact, &known);
        }
        for goal in goals.iter().filter(is_built) {
            self.requested_goal(goal, &known);
        }
    }

    fn told_fact(&mut self, text: &EntryText<'_>, known: &ComposedNames) {
        let Ok(fact) = pddl::parse_init_element(&text.filled).into_result() else { return };
        let mistakes =
            pddl::check_init_elements(&known.domain, &known.problem, slice::from_ref(&fact));
        for mut found in known.without_agents(mistakes, text) {
            let is_sample = found.message.contains(&format!("`{SAMPLE}"));
            if is_sample || !found.is_error() {
                continue;
            }
            if found.message.starts_with("unknown ") && found.help.is_none() {
                // An entry that could not be understood may bring it.
                if !self.is_complete {
                    continue;
                }
                found.severity = Severity::Warning;
                let help = "neither the map nor an agent of this file brings it; if it is an object \
                            of this agent, declare it in (:objects …) of `model`";
                found.help = Some(help.to_owned());
            }
            self.say_of_text(text, found);
        }
    }

    fn requested_goal(&mut self, text: &EntryText<'_>, known: &ComposedNames) {
        let Ok(goal) = pddl::parse_condition(&text.filled).into_result() else { return };
        let mistakes = pddl::check_condition(&known.domain, &known.problem, &goal);
        for found in known.without_agents(mistakes, text) {
            let found = match found.message.starts_with("unknown variable `") {
                true => Some(found.with_help("write `?l` for the place of the motion")),
                false => self.softened(explained_action(found, &known.models)),
            };
            found.into_iter().for_each(|found| self.say_of_text(text, found));
        }
    }

    fn say_of_text(&mut self, text: &EntryText<'_>, found: Diagnostic) {
        let EntryText { entry, path, written, .. } = text;
        let Diagnostic { severity, message, help, .. } = found;
        let message = format!("config of `{}`: `{written}`: {message}", entry.name);
        let found = Diagnostic { severity, help, ..Diagnostic::error(Span::default(), message) };
        self.report_value(path, found);
    }

    /// Reports the safeguards of agents that have no actions.
    pub(super) fn safeguarded_agents(&mut self) {
        let ecosystem = self.ecosystem;
        let stage = DryRun::of(ecosystem);
        for name in ecosystem.safeguards.0.keys() {
            let entry = ecosystem.agents.iter().find(|entry| entry.name == *name);
            let entry = entry.filter(|entry| entry.is_built_in());
            // An entry that cannot be built is reported already.
            let Some(Ok(agent)) = entry.map(|entry| stage.build(entry)) else { continue };
            if agent.model().is_some() {
                continue;
            }
            let message = format!("`{name}` has no actions, and nothing to safeguard");
            let robot = entry.and_then(|entry| entry.config["robot"].as_str());
            let help = match robot {
                Some(robot) => format!("`{robot}` acts: name its actions in [safeguards.{robot}]"),
                None => "name the agent that acts".to_owned(),
            };
            let found = Diagnostic::error(Span::default(), message).with_help(help);
            self.report_key(&format!("safeguards.{name}"), found);
        }
    }
}

impl ComposedNames {
    /// Removes the mistakes about names of agents: the model of another agent may be unknown here.
    fn without_agents(&self, mut found: Vec<Diagnostic>, text: &EntryText<'_>) -> Vec<Diagnostic> {
        found.retain(|found| {
            let word = text.filled.get(found.span.range()).unwrap_or("");
            !self.agents.contains(&word.to_lowercase())
        });
        found
    }
}

/// Returns the facts that an entry tells: those of topics, and those of the results of actions.
fn facts_of(entry: &AgentEntry) -> Vec<EntryText<'_>> {
    let topics = entry.config["topics"].as_array().into_iter().flatten().enumerate();
    let topics = topics.map(|(index, topic)| (format!("topics.{index}"), topic));
    let actions = entry.config["actions"].as_object().into_iter().flatten();
    let actions = actions.map(|(name, action)| (format!("actions.{name}"), action));
    let mut found = Vec::new();
    for (path, table) in topics.chain(actions) {
        for (index, fact) in table["facts"].as_array().into_iter().flatten().enumerate() {
            let path = format!("{}.config.{path}.facts.{index}", entry.path);
            let (path, written) = match fact {
                Value::String(text) => (path, text.as_str()),
                table => (format!("{path}.fact"), table["fact"].as_str().unwrap_or_default()),
            };
            found.push(EntryText { entry, path, written, filled: filled(written) });
        }
    }
    found
}

/// Returns a fact with a number in the place of each field, and a sample in that of each variable.
fn filled(fact: &str) -> String {
    placeholders(fact).fold(fact.to_owned(), |text, name| {
        let value = match name.contains('.') {
            true => "1".to_owned(),
            false => format!("{SAMPLE}{name}"),
        };
        text.replace(&format!("{{{name}}}"), &value)
    })
}

/// Returns the goal that a camera requests after motion.
fn goal_of(entry: &AgentEntry) -> Option<EntryText<'_>> {
    let written = entry.config["on-motion"]["goal"].as_str()?;
    let filled = ptz_camera::goal_at(written, entry.config["location"].as_str()?);
    let path = format!("{}.config.on-motion.goal", entry.path);
    Some(EntryText { entry, path, written, filled })
}
