//! Times and bounds of an agent's life, each with its reason.

use std::time::Duration;

/// Times and bounds that every agent of a daemon lives by.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// How often an actuator says that it works. Once a second is the paper's plug and play:
    /// what a heartbeat alone reveals is seen within a second.
    pub heartbeat_period: Duration,
    /// How long an actuator may be silent before its capabilities leave the domain. Three and a
    /// half heartbeats: one may be lost and one may be late, and the half keeps a punctual third
    /// from racing the lease.
    pub heartbeat_lease: Duration,
    /// How long a running plan bears the absence of an agent it needs before it is repaired: a
    /// restarted router is back in half a second, so a shorter grace tears plans apart for a
    /// blink, and a longer one is time lost after a real death.
    pub grace: Duration,
    /// How long after an agent has left its objects and facts are still believed. Longer than
    /// the grace, so that what it knew is not forgotten before its plan is repaired.
    pub removal: Duration,
    /// First wait for a receipt; doubled at each retry up to [`Settings::retry_max`]. A round
    /// trip on a LAN takes below a millisecond, a busy board may take fifty.
    pub retry_first: Duration,
    /// Longest wait between two retries: a second loses little when a link comes back.
    pub retry_max: Duration,
    /// How long bidders have to propose (decentralised). Planning takes milliseconds; a second
    /// serves a board that is busy. The round closes earlier when all have answered.
    pub proposals_deadline: Duration,
    /// How long the central planner may search.
    pub planning_deadline: Duration,
    /// How long a question to another agent that needs no planning may take.
    pub answer_deadline: Duration,
    /// Messages a mailbox holds. What overflows is refused. A hundred agents that each ask once
    /// at one instant fit.
    pub mailbox_messages_max: usize,
    /// Commitments an agent has under way, unreceipted.
    pub outbox_messages_max: usize,
    /// Messages an agent remembers as heard: more than a peer has under way while it retries any of
    /// them.
    pub heard_messages_max: usize,
    /// Commands an actuator remembers to have begun. A goal's plan has tens of steps; ten thousand
    /// are days of work, and the order of plans guards what is older.
    pub tokens_max: usize,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            heartbeat_period: Duration::from_millis(1_000),
            heartbeat_lease: Duration::from_millis(3_500),
            grace: Duration::from_millis(500),
            removal: Duration::from_millis(1_000),
            retry_first: Duration::from_millis(100),
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

impl Settings {
    /// What is impossible about these settings, if anything: a lease within a heartbeat, a
    /// removal within the grace.
    pub fn problem(&self) -> Option<String> {
        if self.heartbeat_lease <= self.heartbeat_period {
            return Some(format!(
                "heartbeat-lease ({:?}) must be longer than heartbeat-period ({:?}), or an agent \
                 is declared gone between two of its heartbeats",
                self.heartbeat_lease, self.heartbeat_period
            ));
        }
        if self.removal < self.grace {
            return Some(format!(
                "removal ({:?}) must not be shorter than grace ({:?}), or what an agent knew is \
                 forgotten before the plans that need it are repaired",
                self.removal, self.grace
            ));
        }
        if self.mailbox_messages_max == 0 || self.outbox_messages_max == 0 {
            return Some("a mailbox and an outbox hold at least one message".to_owned());
        }
        None
    }
}
