//! The security settings of an ecosystem, and the rights of its agents and daemons.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{AgentRights, AllowedNames, AllowedRequesters, Rights};
use pddl::Diagnostic;

use super::Interpreter;
use crate::config::ecosystem::{AgentEntry, SecuritySettings};
use crate::config::raw::{RawAgentEntry, RawRights, RawSecurity};
use crate::config::search_paths;

/// The word in rights that stands for all daemons or all agents.
const ALL: &str = "*";
/// The word in rights that stands for all agents that the ecosystem file does not name.
const GUESTS: &str = "guests";

/// The plugins of the reasoning agents, which carry out the requests of other agents.
const REASONING: &[&str] =
    &["domain-maintainer", "journal", "plan-executor", "plan-requester", "planning-agent"];

/// The unit of `warn-days`.
const DAY: Duration = Duration::from_secs(24 * 3_600);

/// The actions that single agents may offer, by agent; agents without a limit are missing.
pub(super) type LimitedActions = BTreeMap<String, BTreeSet<String>>;

/// Returns the actions that each agent may offer, by the name of the agent. Contains only agents
/// that have the key `actions` in their entries.
pub(super) fn limited_actions(agents: &[RawAgentEntry]) -> LimitedActions {
    let lower = |actions: &Vec<String>| actions.iter().map(|each| each.to_lowercase()).collect();
    let limited = agents.iter().filter_map(|RawAgentEntry { name, actions, .. }| {
        Some((name.clone()?, actions.as_ref().map(lower)?))
    });
    limited.collect()
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the security settings; `None` unless the ecosystem file has the table `[security]`.
    pub(super) fn security(
        &mut self,
        raw: RawSecurity,
        name: Option<&EcosystemId>,
    ) -> Option<SecuritySettings> {
        let RawSecurity { folder, warn_days, messages_per_second_max } = raw;
        if !self.is_in_file("security") {
            return None;
        }
        let beside = |folder: String| self.file.parent().unwrap_or(Path::new("")).join(folder);
        let default = || name.map_or_else(PathBuf::new, search_paths::credentials_folder);
        Some(SecuritySettings {
            folder: folder.map_or_else(default, beside),
            warn_before: DAY * warn_days,
            messages_per_second_max,
        })
    }

    /// Returns the rights of agents and daemons, and reports mistakes in them.
    pub(super) fn rights(
        &mut self,
        raw: &RawRights,
        agents: &[AgentEntry],
        limited: &LimitedActions,
    ) -> Rights {
        let RawRights { guests, newcomers, goals, changes, history, private } = raw;
        self.warn_unenforced_rights(agents.len());
        let rights = |entry: &AgentEntry| AgentRights {
            daemons: entry.daemons.iter().cloned().collect(),
            actions: limited.get(entry.name.as_str()).cloned(),
            reasons: entry.is_built_in() && REASONING.contains(&entry.plugin.as_str()),
        };
        Rights {
            agents: agents.iter().map(|entry| (entry.name.clone(), rights(entry))).collect(),
            guests: self.allowed_daemons("guests", guests),
            newcomers: self.allowed_daemons("newcomers", newcomers),
            goals: self.askers("goals", goals, agents),
            changes: self.askers("changes", changes, agents),
            history: self.askers("history", history, agents),
            private: self.askers("private", private, agents),
        }
    }

    /// Warns if the file defines rights although the ecosystem is not secured: then they are not
    /// enforced.
    fn warn_unenforced_rights(&mut self, agents: usize) {
        if self.is_in_file("security") {
            return;
        }
        let mut limits = vec!["rights".to_owned()];
        limits.extend((0..agents).map(|index| format!("agent.{index}.actions")));
        for path in limits {
            if self.is_in_file(&path) {
                let message = "rights are not enforced in an ecosystem that is not secured";
                let help = "write [security], and make certificates with `althing cert`";
                self.about_key(&path, |span| Diagnostic::warning(span, message).with_help(help));
            }
        }
    }

    fn allowed_daemons(&mut self, key: &str, names: &[String]) -> AllowedNames<DaemonId> {
        let mut these = BTreeSet::new();
        for (index, name) in names.iter().enumerate() {
            match DaemonId::new(name) {
                _ if name == ALL => return AllowedNames::All,
                Ok(daemon) => {
                    these.insert(daemon);
                }
                Err(error) => self.invalid_name(&format!("rights.{key}.{index}"), &error),
            }
        }
        AllowedNames::These(these)
    }

    fn askers(&mut self, key: &str, names: &[String], agents: &[AgentEntry]) -> AllowedRequesters {
        let (mut these, mut guests) = (BTreeSet::new(), false);
        for (index, name) in names.iter().enumerate() {
            match name.as_str() {
                ALL => return AllowedRequesters::All,
                GUESTS => guests = true,
                name => match agents.iter().find(|entry| entry.name.as_str() == name) {
                    Some(entry) => {
                        these.insert(entry.name.clone());
                    }
                    None => self.unknown_asker(&format!("rights.{key}.{index}"), name, agents),
                },
            }
        }
        AllowedRequesters::These { agents: these, guests }
    }

    fn unknown_asker(&mut self, path: &str, name: &str, agents: &[AgentEntry]) {
        let known = agents.iter().map(|entry| AgentId::as_str(&entry.name)).chain([GUESTS]);
        let help = match pddl::nearest(name, known) {
            Some(nearest) => format!("did you mean `{nearest}`?"),
            None => "write the name of an agent of this file, \"guests\" for all others, or \"*\""
                .to_owned(),
        };
        let message = format!("there is no agent `{name}`");
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    /// Whether the ecosystem file sets the key at `path`.
    pub(super) fn is_in_file(&self, path: &str) -> bool {
        self.layers.get(1).is_some_and(|file| file.places.contains_key(path))
    }
}
