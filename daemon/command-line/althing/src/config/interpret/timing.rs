//! The settings of all agents of an ecosystem: its times and bounds, with checks that they are
//! consistent with each other, and the names of its reasoning agents.

use acl::AgentId;
use agent::{AgentSettings, RoleNames, TimingRule};
use pddl::Diagnostic;

use super::Interpreter;
use crate::config::DEFAULTS_NAME;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::{RawLimits, RawTiming};

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the settings that all agents use. Reports times that are inconsistent.
    pub(super) fn settings(
        &mut self,
        timing: &RawTiming,
        limits: &RawLimits,
        agents: &[AgentEntry],
    ) -> AgentSettings {
        let (roles, privacy) = (role_names(agents), self.privacy);
        let settings = AgentSettings { roles, privacy, ..settings(timing, limits) };
        for rule in settings.timing_rules() {
            self.rule(&rule);
        }
        settings
    }

    fn rule(&mut self, rule: &TimingRule) {
        if rule.holds() {
            return;
        }
        // Reports the value that the user has written. The other one may be a default that the user
        // has never seen.
        let path = |key: &str| format!("timing.{key}");
        let is_default = |key: &str| {
            self.place(&path(key)).is_none_or(|(source, _)| source.name == DEFAULTS_NAME)
        };
        let blamed = if is_default(rule.longer) { rule.shorter } else { rule.longer };
        let message = rule.to_string();
        self.about_value(&path(blamed), |span| {
            Diagnostic::error(span, message).with_help(rule.reason)
        });
    }
}

fn settings(timing: &RawTiming, limits: &RawLimits) -> AgentSettings {
    // No `..`, so that a new key cannot be overlooked here.
    let RawTiming {
        heartbeat_period,
        heartbeat_lease,
        grace,
        removal,
        retry_first,
        retry_max,
        proposals_deadline,
        planning_deadline,
        answer_deadline,
    } = *timing;
    let RawLimits { mailbox_messages_max, outbox_messages_max } = *limits;
    AgentSettings {
        heartbeat_period,
        heartbeat_lease,
        grace,
        removal,
        retry_first,
        retry_max,
        proposals_deadline,
        planning_deadline,
        answer_deadline,
        mailbox_messages_max: mailbox_messages_max as usize,
        outbox_messages_max: outbox_messages_max as usize,
        ..AgentSettings::default()
    }
}

/// Returns the names of the reasoning agents. The `config` of the Plan Requester may name the
/// agents that it works with. Otherwise the first agent with the respective plugin has the role.
fn role_names(agents: &[AgentEntry]) -> RoleNames {
    let entry =
        |plugin: &str| agents.iter().find(|entry| entry.is_built_in() && entry.plugin == plugin);
    let requester = entry("plan-requester");
    let name = |plugin: &str, default: AgentId| {
        let chosen = requester.and_then(|entry| entry.config.get(plugin)?.as_str());
        let chosen = chosen.and_then(|name| AgentId::new(name).ok());
        chosen.or_else(|| Some(entry(plugin)?.name.clone())).unwrap_or(default)
    };
    let default = RoleNames::default();
    RoleNames {
        domain_maintainer: name("domain-maintainer", default.domain_maintainer),
        plan_requester: requester.map_or(default.plan_requester, |entry| entry.name.clone()),
        planning_agent: name("planning-agent", default.planning_agent),
        plan_executor: name("plan-executor", default.plan_executor),
    }
}
