//! The times and bounds of an ecosystem: checks that they are consistent with each other.

use agent::{AgentSettings, TimingRule};
use pddl::Diagnostic;

use super::Interpreter;
use crate::config::DEFAULTS_NAME;
use crate::config::raw::{RawLimits, RawTiming};

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the times and bounds that all agents use. Reports those that are inconsistent.
    pub(super) fn settings(&mut self, timing: &RawTiming, limits: &RawLimits) -> AgentSettings {
        let settings = settings(timing, limits);
        for rule in settings.timing_rules() {
            self.rule(&rule);
        }
        settings
    }

    fn rule(&mut self, rule: &TimingRule) {
        if rule.holds() {
            return;
        }
        // Reports the value that the user has written, not a default that the user may not know.
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
