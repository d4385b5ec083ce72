//! Checks the roles of the reasoning agents: if a role is missing, no goal is ever reached.

use agent::Mode;
use pddl::{Diagnostic, Span};

use super::Reviewer;
use crate::config::AgentEntry;

/// Each role of a reasoning agent: its plugin; the consequence if no agent has the role; and
/// whether the agent must have the name of the plugin. The name matters if other agents address the
/// agent by that name unless their `config` gives another.
const ROLES: &[(&str, &str, bool)] = &[
    ("domain-maintainer", "no agent keeps the domain and the known facts", true),
    ("plan-requester", "no agent takes goals", false),
    ("plan-executor", "no agent carries plans out", false),
];

/// The role that only the centralised planning mode needs: its plugin, the consequence if no agent
/// has the role, and whether the agent must have the name of the plugin.
const CENTRAL: (&str, &str, bool) =
    ("planning-agent", "no agent plans in the mode \"centralized\"", false);

impl Reviewer<'_> {
    /// Warns about roles that no agent has, and about an agent with a name by which other agents do
    /// not find it in its role.
    pub(super) fn roles(&mut self) {
        // A file without agents is probably unfinished.
        if self.ecosystem.agents.is_empty() || !self.is_complete {
            return;
        }
        let central = (self.ecosystem.mode == Mode::Centralized).then_some(&CENTRAL);
        let roles = || ROLES.iter().chain([&CENTRAL]).map(|(plugin, ..)| *plugin);
        let reasons =
            |entry: &AgentEntry| entry.is_built_in() && roles().any(|it| it == entry.plugin);
        if !self.ecosystem.agents.iter().any(reasons) {
            return self.no_reasoning();
        }
        for (plugin, lack, is_by_name) in ROLES.iter().chain(central) {
            let entries = &self.ecosystem.agents;
            let has_role = |entry: &&AgentEntry| entry.is_built_in() && entry.plugin == *plugin;
            let Some(entry) = entries.iter().find(has_role) else {
                self.missing_role(plugin, lack);
                continue;
            };
            let is_found =
                entries.iter().filter(has_role).any(|each| each.name.as_str() == *plugin);
            if *is_by_name && !is_found {
                let message = format!(
                    "a `{plugin}` is looked for by the name `{plugin}`, and this one is called `{}`",
                    entry.name
                );
                let (path, help) =
                    (format!("{}.name", entry.path), format!("write name = \"{plugin}\""));
                self.report_value(
                    &path,
                    Diagnostic::warning(Span::default(), message).with_help(help),
                );
            }
        }
    }

    /// Warns that no agent of the file reasons. The help suggests a daemon of the file.
    fn no_reasoning(&mut self) {
        let message = "no agent of the file plans, so it takes no goals";
        let daemon = self.ecosystem.daemons.first().map_or("NAME", |daemon| daemon.as_str());
        let help = format!(
            "write reasoning = \"{daemon}\" under [ecosystem], with the daemon that is to host the \
             agents that plan"
        );
        let found = Diagnostic::warning(Span::default(), message).with_help(help);
        self.report_key("ecosystem", found);
    }

    fn missing_role(&mut self, plugin: &str, lack: &str) {
        let message = format!("{lack}: the file has no agent with plugin = \"{plugin}\"");
        // The help suggests the daemon that hosts another reasoning agent.
        let roles = || ROLES.iter().chain([&CENTRAL]).map(|(plugin, ..)| *plugin);
        let beside = self.ecosystem.agents.iter().find(|entry| {
            entry.is_built_in()
                && !entry.daemons.is_empty()
                && roles().any(|role| role == entry.plugin)
        });
        let daemon = beside.and_then(|entry| entry.daemons.first());
        let daemon = daemon.map_or_else(String::new, |name| format!("\ndaemon = \"{name}\""));
        let help = format!("write\n[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"{daemon}");
        let found = Diagnostic::warning(Span::default(), message).with_help(help);
        self.report_key("ecosystem", found);
    }
}
