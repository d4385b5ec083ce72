//! Settings of all agents of an ecosystem: the times and bounds that the ecosystem file may change,
//! each with the reason for its value, and the names of the reasoning agents.

use std::fmt;
use std::time::Duration;

use capability::SilenceLimit;
use serde::Deserialize;

use crate::retry_backoff::RetryBackoff;
use crate::role_names::RoleNames;

/// Lease of Zenoh's links. The value repeats `substrate_zenoh::LEASE`, because this crate does not
/// depend on that one.
const LINK_LEASE: Duration = Duration::from_secs(4);

/// Time until all daemons have noticed that a link was silent for its lease.
const DETECTION: Duration = Duration::from_secs(2);

/// From which agents the parts of action models are kept that are declared `:private`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelPrivacy {
    /// From those of other ecosystems. Each agent announces its whole model in its own ecosystem.
    #[default]
    Ecosystem,
    /// From all other agents, also from the Domain Maintainer and the planners.
    Agents,
}

/// Times, bounds and names that apply to every agent of a daemon.
#[derive(Clone, Debug, PartialEq)]
pub struct AgentSettings {
    /// Names of the reasoning agents.
    pub roles: RoleNames,
    /// From which agents the `:private` declarations of action models are kept.
    pub privacy: ModelPrivacy,
    /// Period of an actuator's heartbeat. One second serves the paper's plug and play: a change
    /// that only a heartbeat reveals is seen within a second.
    pub heartbeat_period: Duration,
    /// Silence after which the actions and facts of an actuator leave the domain: three and a half
    /// heartbeat periods. One heartbeat may be lost and one may be late. The half period is a
    /// margin for a third heartbeat that is sent in time.
    pub heartbeat_lease: Duration,
    /// How long a running plan tolerates the absence of an agent that it needs, before the plan is
    /// repaired. A restarted router is back in half a second. A shorter grace breaks plans because
    /// of a brief gap; a longer one loses time after a real failure.
    pub grace: Duration,
    /// How long the objects and facts of an agent stay in the domain model after the agent has
    /// left. At least as long as the grace, so that the plans that need them are repaired first.
    pub removal: Duration,
    /// First wait for a receipt before a message is sent again. After some equal waits it doubles at
    /// each retry, up to [`AgentSettings::retry_max`]. A round trip on a LAN takes below a
    /// millisecond; a busy board may take fifty.
    pub retry_first: Duration,
    /// Longest wait between two retries. A second loses little time when a link comes back.
    pub retry_max: Duration,
    /// How long bidders may take to propose, in the decentralised planning mode. Planning takes
    /// milliseconds; a second is enough for a board that is busy. The round closes earlier when all
    /// bidders have answered.
    pub proposals_deadline: Duration,
    /// How long the Planning Agent may search for a plan, in the centralised planning mode.
    pub planning_deadline: Duration,
    /// How long another agent may take to answer a question that needs no planning.
    pub answer_deadline: Duration,
    /// Maximum number of messages in a mailbox; further messages are refused. A hundred agents that
    /// each send one request at the same instant fit.
    pub mailbox_messages_max: usize,
    /// Maximum number of messages of an agent that wait for a receipt. Sending a further message
    /// fails, and no exchange begins while half of this number waits.
    pub outbox_messages_max: usize,
    /// Size of the duplicate window, in message ids. Must exceed the number of messages that a peer
    /// can have under way while it retries any of them.
    pub heard_messages_max: usize,
    /// Number of commands that an actuator remembers as begun. The plan of a goal has tens of
    /// steps, so ten thousand commands are days of work. A command that is no longer remembered is
    /// rejected if it belongs to an older plan of a goal with remembered commands.
    pub tokens_max: usize,
}

impl Default for AgentSettings {
    fn default() -> AgentSettings {
        AgentSettings {
            roles: RoleNames::default(),
            privacy: ModelPrivacy::default(),
            heartbeat_period: Duration::from_millis(1_000),
            heartbeat_lease: Duration::from_millis(3_500),
            grace: Duration::from_millis(500),
            removal: Duration::from_millis(1_000),
            retry_first: Duration::from_millis(80),
            retry_max: Duration::from_millis(1_000),
            proposals_deadline: Duration::from_millis(1_000),
            planning_deadline: Duration::from_secs(10),
            answer_deadline: Duration::from_secs(2),
            mailbox_messages_max: 256,
            outbox_messages_max: 1_024,
            heard_messages_max: 4_096,
            tokens_max: 10_000,
        }
    }
}

impl AgentSettings {
    /// Returns how long an agent may be silent: the heartbeat lease, scaled to the heartbeat period
    /// that the agent itself states.
    pub fn silence_limit(&self) -> SilenceLimit {
        SilenceLimit::new(self.heartbeat_lease, self.heartbeat_period)
    }

    /// Returns the waits between the repetitions of a message to which there is no answer.
    pub fn retry_backoff(&self) -> RetryBackoff {
        RetryBackoff::new(self.retry_first, self.retry_max)
    }

    /// Returns how long an agent that starts waits until its name is free. The agents of a daemon
    /// that was killed behind a cut link keep their names until both leases have passed and all
    /// daemons have noticed that.
    pub(crate) fn name_awaited(&self) -> Duration {
        self.heartbeat_lease.max(LINK_LEASE) + DETECTION
    }

    /// Returns the rules that the times of these settings must follow.
    pub fn timing_rules(&self) -> [TimingRule; 3] {
        let rule = |longer, shorter, may_be_equal, reason| {
            let ((longer, long), (shorter, short)) = (longer, shorter);
            TimingRule { longer, long, shorter, short, may_be_equal, reason }
        };
        [
            rule(
                ("heartbeat-lease", self.heartbeat_lease),
                ("heartbeat-period", self.heartbeat_period),
                false,
                "or an agent is declared gone between two of its heartbeats",
            ),
            rule(
                ("removal", self.removal),
                ("grace", self.grace),
                true,
                "or what an agent knew is forgotten before the plans that need it are repaired",
            ),
            rule(
                ("retry-max", self.retry_max),
                ("retry-first", self.retry_first),
                true,
                "waits between retries begin with one and grow to the other",
            ),
        ]
    }
}

/// Rule that one time of the settings must be longer than another. Its text is the error message
/// for settings that break the rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimingRule {
    /// Key in the ecosystem file of the time that must be longer.
    pub longer: &'static str,
    /// Value of the time that must be longer.
    pub long: Duration,
    /// Key in the ecosystem file of the time that must be shorter.
    pub shorter: &'static str,
    /// Value of the time that must be shorter.
    pub short: Duration,
    /// Whether both times may be equal.
    pub may_be_equal: bool,
    /// Reason for the rule.
    pub reason: &'static str,
}

impl TimingRule {
    /// Whether the values follow the rule.
    pub fn holds(&self) -> bool {
        self.long > self.short || self.may_be_equal && self.long == self.short
    }
}

impl fmt::Display for TimingRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TimingRule { longer, long, shorter, short, may_be_equal, .. } = self;
        let or_equal = if *may_be_equal { " or equal" } else { "" };
        write!(f, "`{longer}` ({long:?}) must be longer than{or_equal} `{shorter}` ({short:?})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broken(settings: &AgentSettings) -> Vec<String> {
        let rules = settings.timing_rules();
        rules.iter().filter(|rule| !rule.holds()).map(TimingRule::to_string).collect()
    }

    #[test]
    fn the_defaults_follow_the_rules() {
        let settings = AgentSettings::default();
        assert_eq!(broken(&settings), [""; 0]);
        assert_eq!(settings.silence_limit(), SilenceLimit::default());
    }

    #[test]
    fn each_rule_can_be_broken() {
        let second = Duration::from_secs(1);
        let settings = AgentSettings {
            heartbeat_period: second,
            heartbeat_lease: second,
            removal: second,
            grace: second * 2,
            retry_first: second * 3,
            retry_max: second,
            ..AgentSettings::default()
        };
        let expected = [
            "`heartbeat-lease` (1s) must be longer than `heartbeat-period` (1s)",
            "`removal` (1s) must be longer than or equal `grace` (2s)",
            "`retry-max` (1s) must be longer than or equal `retry-first` (3s)",
        ];
        assert_eq!(broken(&settings), expected);
    }
}
