//! The times and bounds of an ecosystem: checks that they are consistent with each other.

use std::time::Duration;

use agent::AgentSettings;
use pddl::Diagnostic;

use super::Interpreter;
use crate::config::DEFAULTS_NAME;
use crate::config::raw::{RawLimits, RawTiming};

/// A rule that one time must be longer than another: the key and value of the longer one, the key
/// and value of the shorter one, whether they may be equal, and the reason.
type TimingRule<'t> = (&'t str, Duration, &'t str, Duration, bool, &'t str);

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns the times and bounds that all agents use. Reports those that are inconsistent.
    pub(super) fn settings(&mut self, timing: &RawTiming, limits: &RawLimits) -> AgentSettings {
        let settings = settings(timing, limits);
        let errors_before = self.report.findings().len();
        for rule in rules(&settings) {
            self.rule(rule);
        }
        // Settings that `agent` rejects beyond these rules.
        if self.report.findings().len() == errors_before
            && let Some(problem) = settings.problem()
        {
            self.about_key("timing", |span| Diagnostic::error(span, problem));
        }
        settings
    }

    fn rule(&mut self, (longer, long, shorter, short, equal, why): TimingRule<'_>) {
        if long > short || equal && long == short {
            return;
        }
        // Reports the value that the user has written, not a default that the user may not know.
        let path = |key: &str| format!("timing.{key}");
        let is_default = |key: &str| {
            self.place(&path(key)).is_none_or(|(source, _)| source.name == DEFAULTS_NAME)
        };
        let blamed = if is_default(longer) { shorter } else { longer };
        let or_equal = if equal { " or equal" } else { "" };
        let message =
            format!("`{longer}` ({long:?}) must be longer than{or_equal} `{shorter}` ({short:?})");
        self.about_value(&path(blamed), |span| Diagnostic::error(span, message).with_help(why));
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

fn rules(settings: &AgentSettings) -> [TimingRule<'static>; 3] {
    let AgentSettings {
        heartbeat_period,
        heartbeat_lease,
        grace,
        removal,
        retry_first,
        retry_max,
        ..
    } = *settings;
    [
        (
            "heartbeat-lease",
            heartbeat_lease,
            "heartbeat-period",
            heartbeat_period,
            false,
            "or an agent is declared gone between two of its heartbeats",
        ),
        (
            "removal",
            removal,
            "grace",
            grace,
            true,
            "or what an agent knew is forgotten before the plans that need it are repaired",
        ),
        (
            "retry-max",
            retry_max,
            "retry-first",
            retry_first,
            true,
            "waits between retries begin with one and grow to the other",
        ),
    ]
}
