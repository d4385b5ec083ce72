//! The agents that a file gets if it names none that reasons: those that plan, a Journal, and a
//! Keyboard.

use std::collections::BTreeSet;

use acl::{AgentId, DaemonId};
use pddl::{Diagnostic, Span};
use serde_json::Value;

use super::Interpreter;
use super::files::PddlFiles;
use super::rights::{LimitedActions, limited_actions};
use crate::config::ecosystem::{AgentEntry, DEFAULT_AGENTS};
use crate::config::raw::{RawAgentEntry, RawInterface, RawWeb};

/// The plugins of the reasoning agents; each agent has the name of its plugin. A file that names one
/// of them names all that it needs.
const REASONING: [&str; 4] =
    ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];

/// The plugin of the agents that keep goals and plans on disk, and of the one that speaks for
/// people.
const JOURNAL: &str = "journal";
const KEYBOARD: &str = "keyboard";

/// The values of a file that name daemons, apart from those of agents.
pub(super) struct FileHosts<'f> {
    /// The daemons that are to host the reasoning agents.
    pub(super) reasoning: Vec<String>,
    pub(super) interface: &'f [RawInterface],
    pub(super) daemons: &'f [String],
    pub(super) web: &'f RawWeb,
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the agents of the file with correct entries and those that are there by themselves, and
    /// the actions that some of them may offer.
    pub(super) fn all_agents(
        &mut self,
        agents: Vec<RawAgentEntry>,
        hosts: &FileHosts<'_>,
        files: Option<&PddlFiles>,
    ) -> (Vec<AgentEntry>, LimitedActions) {
        let (defaults, limited) = (self.default_agents(&agents, hosts), limited_actions(&agents));
        let mut all = self.agents(agents, files);
        all.extend(defaults);
        (all, limited)
    }

    /// Returns the reasoning agents for a file that names none of them, on the daemons that the key
    /// `reasoning` names. Without this key, the machine hosts them, if the file names no daemon at
    /// all.
    fn default_agents(
        &mut self,
        agents: &[RawAgentEntry],
        hosts: &FileHosts<'_>,
    ) -> Vec<AgentEntry> {
        let FileHosts { reasoning, interface, daemons, web } = hosts;
        let is_known = |plugin: &&str| self.known_plugins.iter().any(|it| it.name == *plugin);
        if !REASONING.iter().chain(&[JOURNAL, KEYBOARD]).all(is_known) {
            return Vec::new();
        }
        let reasons = |agent: &&RawAgentEntry| {
            let plugin = agent.plugin.as_deref().unwrap_or_default();
            agent.package.is_none() && REASONING.contains(&plugin)
        };
        if let Some(one) = agents.iter().find(reasons) {
            self.needless_reasoning(reasoning, one.plugin.as_deref().unwrap_or_default());
            return Vec::new();
        }
        let names_daemon = agents.iter().any(|agent| !agent.daemon.is_empty())
            || interface.iter().any(|interface| interface.daemon.is_some())
            || !daemons.is_empty()
            || !web.daemons.is_empty();
        if reasoning.is_empty() && names_daemon {
            // `review` warns that no agent takes goals.
            return Vec::new();
        }
        let Some(hosts) = self.reasoning_hosts(reasoning) else { return Vec::new() };
        let names = agents.iter().filter_map(|agent| agent.name.as_deref());
        let taken: BTreeSet<&str> = names.collect();
        let mut entries: Vec<(String, &str, Vec<DaemonId>)> =
            REASONING.iter().map(|plugin| ((*plugin).to_owned(), *plugin, hosts.clone())).collect();
        entries.extend(journals(&hosts, agents));
        if !agents.iter().any(|agent| is_of(agent, KEYBOARD)) {
            let first = hosts.first().cloned().into_iter().collect();
            entries.push((KEYBOARD.to_owned(), KEYBOARD, first));
        }
        let free = entries.into_iter().filter(|(name, ..)| !self.is_taken(&taken, agents, name));
        let free: Vec<_> = free.collect();
        free.into_iter().filter_map(|(name, plugin, hosts)| entry(&name, plugin, hosts)).collect()
    }

    /// Whether an agent of the file has the name of a reasoning agent. Reports that as a mistake.
    fn is_taken(&mut self, taken: &BTreeSet<&str>, agents: &[RawAgentEntry], name: &str) -> bool {
        if !taken.contains(name) {
            return false;
        }
        let index = agents.iter().position(|agent| agent.name.as_deref() == Some(name));
        let path = format!("agent.{}.name", index.unwrap_or_default());
        let message = format!("`{name}` is the name of an agent that every ecosystem needs");
        let help = "give this agent another name; the agents that reason are there by themselves";
        self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
        true
    }

    fn needless_reasoning(&mut self, reasoning: &[String], plugin: &str) {
        if reasoning.is_empty() {
            return;
        }
        let message = format!(
            "`reasoning` is for a file without agents that reason, and this one has a `{plugin}`"
        );
        let help = "take the key out, or the entries of the domain-maintainer, the plan-requester, \
                    the planning-agent and the plan-executor";
        self.about_key(DEFAULT_AGENTS, |span| Diagnostic::error(span, message).with_help(help));
    }

    /// Returns the daemons of the reasoning agents; `None` if one of the names is invalid, which is
    /// reported.
    fn reasoning_hosts(&mut self, names: &[String]) -> Option<Vec<DaemonId>> {
        let mut hosts = Vec::new();
        for (index, name) in names.iter().enumerate() {
            let path = format!("{DEFAULT_AGENTS}.{index}");
            match DaemonId::new(name) {
                Ok(daemon) if hosts.contains(&daemon) => self.about_value(&path, |span: Span| {
                    Diagnostic::warning(span, format!("daemon `{daemon}` is listed twice"))
                }),
                Ok(daemon) => hosts.push(daemon),
                Err(err) => {
                    self.invalid_name(&path, &err);
                    return None;
                }
            }
        }
        Some(hosts)
    }
}

fn is_of(agent: &RawAgentEntry, plugin: &str) -> bool {
    agent.plugin.as_deref() == Some(plugin)
}

/// Returns one Journal for each daemon on which the file has none: its name, its plugin and its
/// daemon. The Journal of a machine that is alone has no daemon.
fn journals(
    hosts: &[DaemonId],
    agents: &[RawAgentEntry],
) -> Vec<(String, &'static str, Vec<DaemonId>)> {
    let mut own = agents.iter().filter(|agent| is_of(agent, JOURNAL));
    if hosts.is_empty() {
        let lacks = own.next().is_none();
        return lacks.then(|| (JOURNAL.to_owned(), JOURNAL, Vec::new())).into_iter().collect();
    }
    let hosted: BTreeSet<&str> =
        own.flat_map(|agent| agent.daemon.iter().map(String::as_str)).collect();
    let lacking = hosts.iter().filter(|daemon| !hosted.contains(daemon.as_str()));
    let name = |daemon: &DaemonId| match hosts {
        [_] => JOURNAL.to_owned(),
        _ => format!("{JOURNAL}-{daemon}"),
    };
    lacking.map(|daemon| (name(daemon), JOURNAL, vec![daemon.clone()])).collect()
}

fn entry(name: &str, plugin: &str, daemons: Vec<DaemonId>) -> Option<AgentEntry> {
    // The name of a Journal is too long if that of its daemon is nearly so.
    let name = AgentId::new(name).ok()?;
    Some(AgentEntry {
        path: DEFAULT_AGENTS.to_owned(),
        name,
        plugin: plugin.to_owned(),
        package: None,
        daemons,
        driver: None,
        config: Value::Null.into(),
    })
}
