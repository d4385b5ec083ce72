//! Interfaces to other ecosystems: checks the names and references in their entries, and that each
//! vocabulary can be translated in both directions.

use std::collections::BTreeMap;
use std::path::Path;

use acl::{AgentId, DaemonId};
use pddl::Diagnostic;

use super::Interpreter;
use super::files::PddlFiles;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::{RawInterface, RawRule};
use crate::config::{InterfaceEntry, RuleEntry};

/// Default for the number of messages per second that may pass an interface. A robot that drives
/// needs two or three, and an interface that lends ten robots lends many.
const RATE: f64 = 20.0;

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the interfaces with correct entries. Reports the mistakes in the other entries.
    pub(super) fn interfaces(
        &mut self,
        raw: Vec<RawInterface>,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> Vec<InterfaceEntry> {
        let given = agents.iter().any(|agent| !agent.daemons.is_empty());
        let mut interfaces = Vec::new();
        for (index, raw) in raw.into_iter().enumerate() {
            let path = format!("interface.{index}");
            if given && raw.daemon.is_none() {
                let help = "the machine that is to join both ecosystems, such as daemon = \"gate\"";
                self.about_key(&path, |span| {
                    Diagnostic::error(span, "`daemon` is missing in `interface`").with_help(help)
                });
            }
            interfaces.extend(self.interface(&path, raw, agents, files));
        }
        interfaces
    }

    fn interface(
        &mut self,
        path: &str,
        raw: RawInterface,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> Option<InterfaceEntry> {
        let RawInterface { ecosystem, daemon, called, rate, import, export, .. } = raw;
        let RawInterface { types, predicates, functions, objects, .. } = raw;
        let sorts = [
            ("types", &types),
            ("predicates", &predicates),
            ("functions", &functions),
            ("objects", &objects),
        ];
        for (sort, words) in sorts {
            self.both_ways(&format!("{path}.{sort}"), words);
        }
        if ecosystem.is_none() {
            self.missing(path, "ecosystem", "house.toml");
        }
        if called.is_none() {
            self.missing(path, "as", "office");
        }
        let daemon = match daemon.as_deref().map(DaemonId::new).transpose() {
            Ok(daemon) => daemon,
            Err(err) => {
                self.invalid_name(&format!("{path}.daemon"), &err);
                None
            }
        };
        let called = self.agent_called(&format!("{path}.as"), called.as_deref());
        let imports =
            self.rules(&format!("{path}.import"), import, RuleSide::Theirs, agents, files);
        let exports = self.rules(&format!("{path}.export"), export, RuleSide::Ours, agents, files);
        let file = self.file.parent().unwrap_or(Path::new("")).join(ecosystem?);
        let (called, rate) = (called?, rate.unwrap_or(RATE));
        Some(InterfaceEntry {
            file,
            daemon,
            remote_name: called,
            rate,
            types: lowered(types),
            predicates: lowered(predicates),
            functions: lowered(functions),
            objects: lowered(objects),
            imports,
            exports,
        })
    }

    /// Reports each word of the other ecosystem that stands for two words of this ecosystem,
    /// because it could not be translated back.
    fn both_ways(&mut self, path: &str, words: &BTreeMap<String, String>) {
        let mut first: BTreeMap<String, &str> = BTreeMap::new();
        for (ours, theirs) in words {
            let Some(other) = first.insert(theirs.to_lowercase(), ours) else { continue };
            let message = format!("`{other}` stands for `{theirs}` already");
            let help = "it could not be translated back: give each a name of its own";
            self.about_value(&format!("{path}.{ours}"), |span| {
                Diagnostic::error(span, message).with_help(help)
            });
        }
    }

    fn rules(
        &mut self,
        path: &str,
        raw: Vec<RawRule>,
        side: RuleSide,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> Vec<RuleEntry> {
        let rule =
            |(index, raw)| self.passage(&format!("{path}.{index}"), raw, side, agents, files);
        raw.into_iter().enumerate().filter_map(rule).collect()
    }

    fn passage(
        &mut self,
        path: &str,
        raw: RawRule,
        side: RuleSide,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) -> Option<RuleEntry> {
        let RawRule { agent, called, performatives, actions, costs, goals } = raw;
        self.both_ways(&format!("{path}.actions"), &actions);
        if agent.is_some() != goals.is_empty() {
            let message = "a rule is about an agent or about goals";
            let help = "write agent = \"sweeper-1\", or goals = [\"swept\"] and a name under `as`";
            self.about_key(path, |span| Diagnostic::error(span, message).with_help(help));
            return None;
        }
        if agent.is_none() && called.is_none() {
            self.missing(path, "as", "house-desk");
            return None;
        }
        let agent_path = format!("{path}.agent");
        let called_path = if called.is_some() { format!("{path}.as") } else { agent_path.clone() };
        let called = called.or_else(|| agent.clone());
        let called = self.agent_called(&called_path, called.as_deref())?;
        let agent = match agent {
            Some(agent) => Some(self.agent_called(&agent_path, Some(&agent))?),
            None => None,
        };
        match side {
            RuleSide::Theirs => self.is_free(&called_path, &called, agents, files),
            RuleSide::Ours => {
                agent.iter().for_each(|agent| self.is_ours(&agent_path, agent, agents))
            }
        }
        let performatives = match performatives {
            Some(names) => names.iter().filter_map(|name| name.parse().ok()).collect(),
            None => interfacing::PASSABLE_PERFORMATIVES.into(),
        };
        Some(RuleEntry {
            agent,
            proxy_name: called,
            performatives,
            actions: lowered(actions),
            costs: costs.into_iter().map(|(name, cost)| (name.to_lowercase(), cost)).collect(),
            goals: goals.into_iter().map(|goal| goal.to_lowercase()).collect(),
        })
    }

    fn agent_called(&mut self, path: &str, name: Option<&str>) -> Option<AgentId> {
        AgentId::new(name?).map_err(|err| self.invalid_name(path, &err)).ok()
    }

    /// Reports the name that a rule gives to an imported agent if this ecosystem uses that name
    /// already.
    fn is_free(
        &mut self,
        path: &str,
        name: &AgentId,
        agents: &[AgentEntry],
        files: Option<&PddlFiles>,
    ) {
        let taken = if agents.iter().any(|agent| agent.name == *name) {
            "an agent of this ecosystem"
        } else if files.is_some_and(|files| files.has_object(name.as_str())) {
            "on the map"
        } else {
            return;
        };
        let message = format!("`{name}` is {taken} already");
        let help = "give it another name here: as = \"…\"";
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    fn is_ours(&mut self, path: &str, name: &AgentId, agents: &[AgentEntry]) {
        if agents.iter().any(|agent| agent.name == *name) {
            return;
        }
        let near = pddl::nearest(name.as_str(), agents.iter().map(|agent| agent.name.as_str()));
        let message = format!("there is no agent `{name}` in this file");
        self.about_value(path, |span| Diagnostic::warning(span, message).with_suggestion(near));
    }
}

/// The ecosystem in which the agents that a rule lends run.
#[derive(Clone, Copy)]
enum RuleSide {
    Ours,
    Theirs,
}

/// Converts the words of a vocabulary to lower case, because PDDL ignores case.
fn lowered(words: BTreeMap<String, String>) -> BTreeMap<String, String> {
    words.into_iter().map(|(ours, theirs)| (ours.to_lowercase(), theirs.to_lowercase())).collect()
}
