//! The values of the configuration after its layers have been merged, before they are interpreted:
//! `interpret` turns them into an ecosystem.
//!
//! A field is always set if its key has a default in `defaults.toml`; other fields may be missing.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Keep, Partition};
use serde::Deserialize;
use serde_json::Value;

use super::duration;

/// The values of the whole configuration.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawConfig {
    #[serde(default)]
    pub(super) ecosystem: RawEcosystem,
    #[serde(default)]
    pub(super) rooms: BTreeMap<String, Value>,
    #[serde(default)]
    pub(super) doors: BTreeMap<String, Value>,
    #[serde(default)]
    pub(super) zenoh: Value,
    #[serde(default)]
    pub(super) agent: Vec<RawAgentEntry>,
    #[serde(default)]
    pub(super) interface: Vec<RawInterface>,
    #[serde(default)]
    pub(super) goals: BTreeMap<String, RawNamedGoal>,
    pub(super) timing: RawTiming,
    pub(super) limits: RawLimits,
    pub(super) security: RawSecurity,
    pub(super) rights: RawRights,
    #[serde(default)]
    pub(super) people: RawPeople,
    #[serde(default)]
    pub(super) safeguards: BTreeMap<String, BTreeMap<String, RawSafeguard>>,
    #[serde(default)]
    pub(super) hardware_stops: BTreeMap<String, RawHardwareStop>,
    pub(super) plugins: RawPlugins,
    #[serde(default)]
    pub(super) metrics: RawMetrics,
    #[serde(default)]
    pub(super) web: RawWeb,
    pub(super) building: RawBuilding,
    #[serde(default)]
    pub(super) words: Value,
}

/// The values of one action in `[safeguards]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawSafeguard {
    pub(super) confirm: bool,
    #[serde(deserialize_with = "duration::deserialize_some")]
    pub(super) patience: Option<Duration>,
    pub(super) at_most: Option<u32>,
    #[serde(deserialize_with = "duration::deserialize_some")]
    pub(super) per: Option<Duration>,
}

/// The values of one sensor in `[hardware-stops]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawHardwareStop {
    /// Empty if the key is missing.
    pub(super) stops: Vec<String>,
    pub(super) pressed: Option<String>,
    pub(super) release: Option<String>,
    pub(super) fail_safe: Option<bool>,
}

/// The values of one goal in `[goals]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawNamedGoal {
    pub(super) goal: Option<String>,
    #[serde(default)]
    pub(super) keep: Keep,
    #[serde(default)]
    pub(super) priority: i32,
    #[serde(default)]
    pub(super) partition: Partition,
    #[serde(default)]
    pub(super) ask: Option<String>,
    #[serde(flatten)]
    pub(super) times: RawGoalTimes,
}

/// The values of one goal in `[goals]` that say when it is asked for.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct RawGoalTimes {
    pub(super) at: Option<String>,
    pub(super) by: Option<String>,
    pub(super) every: Option<String>,
    pub(super) on: Option<String>,
    pub(super) between: Option<String>,
    pub(super) until: Option<String>,
    #[serde(rename = "for")]
    pub(super) lasts: Option<String>,
}

/// The values of `[ecosystem]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawEcosystem {
    pub(super) name: Option<String>,
    pub(super) domain: Option<String>,
    pub(super) problem: Option<String>,
    pub(super) vocabulary: Option<String>,
    /// Empty if the key is missing.
    pub(super) reasoning: Vec<String>,
    pub(super) mode: agent::Mode,
    pub(super) privacy: agent::ModelPrivacy,
    pub(super) daemons: Vec<String>,
    pub(super) time_zone: Option<String>,
}

/// The values of one `[[agent]]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawAgentEntry {
    pub(super) name: Option<String>,
    pub(super) plugin: Option<String>,
    pub(super) package: Option<String>,
    /// Names of the daemons that host the agent; empty if the key is missing.
    pub(super) daemon: Vec<String>,
    pub(super) driver: Option<String>,
    pub(super) config: Value,
    pub(super) actions: Option<Vec<String>>,
}

/// The values of one `[[interface]]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawInterface {
    pub(super) ecosystem: Option<String>,
    pub(super) daemon: Option<String>,
    #[serde(rename = "as")]
    pub(super) called: Option<String>,
    pub(super) rate: Option<f64>,
    pub(super) types: BTreeMap<String, String>,
    pub(super) predicates: BTreeMap<String, String>,
    pub(super) functions: BTreeMap<String, String>,
    pub(super) objects: BTreeMap<String, String>,
    pub(super) import: Vec<RawRule>,
    pub(super) export: Vec<RawRule>,
}

/// The values of one `[[interface.import]]` or `[[interface.export]]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawRule {
    pub(super) agent: Option<String>,
    #[serde(rename = "as")]
    pub(super) called: Option<String>,
    pub(super) performatives: Option<Vec<String>>,
    pub(super) actions: BTreeMap<String, String>,
    pub(super) costs: BTreeMap<String, f64>,
    pub(super) goals: Vec<String>,
}

/// The values of `[timing]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawTiming {
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) heartbeat_period: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) heartbeat_lease: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) grace: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) removal: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) retry_first: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) retry_max: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) proposals_deadline: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) planning_deadline: Duration,
    #[serde(deserialize_with = "duration::deserialize")]
    pub(super) answer_deadline: Duration,
}

/// The values of `[limits]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawLimits {
    pub(super) mailbox_messages_max: u32,
    pub(super) outbox_messages_max: u32,
}

/// The values of `[security]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawSecurity {
    #[serde(default)]
    pub(super) folder: Option<String>,
    pub(super) warn_days: u32,
    pub(super) messages_per_second_max: u32,
}

/// The values of `[rights]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawRights {
    pub(super) guests: Vec<String>,
    pub(super) newcomers: Vec<String>,
    pub(super) goals: Vec<String>,
    pub(super) changes: Vec<String>,
    pub(super) history: Vec<String>,
    pub(super) private: Vec<String>,
}

/// The values of `[people]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawPeople {
    pub(super) file: Option<String>,
}

/// The values of `[plugins]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawPlugins {
    #[serde(default)]
    pub(super) folder: Option<String>,
    pub(super) admit: String,
    pub(super) confinement: String,
}

/// The values of `[metrics]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawMetrics {
    pub(super) listen: Option<String>,
}

/// The values of `[web]`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub(super) struct RawWeb {
    pub(super) listen: Option<String>,
    /// Empty if the key is missing.
    pub(super) daemons: Vec<String>,
    pub(super) names: Vec<String>,
    pub(super) certificate: Option<String>,
    pub(super) key: Option<String>,
}

/// The values of `[building]`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RawBuilding {
    #[serde(default)]
    pub(super) temperatures: BTreeMap<String, f64>,
    #[serde(default)]
    pub(super) conditions: BTreeMap<String, BTreeMap<String, f64>>,
    pub(super) time_scale: f64,
    #[serde(default)]
    pub(super) socket: Option<String>,
}
