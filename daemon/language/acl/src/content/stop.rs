//! Stops: actuators end what they do, and begin nothing until the stop is released.

use serde::{Deserialize, Serialize};

use crate::AgentId;

/// A stop of all actuators, or of some. An actuator that has received it ends its action and begins
/// none until this stop is released; other stops have no influence on that. Actuators repeat the
/// stops that they know in their heartbeats, so that a stop reaches agents that were cut off when
/// it was requested.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stop {
    /// Identifier of the stop, chosen by its requester; a release names it.
    pub id: String,
    /// Names of the agents and places that are stopped. An empty list stops everything. The name of
    /// a place stops the agents that are there, and every action that names the place.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scope: Vec<String>,
    /// The agent that requested the stop.
    pub by: AgentId,
    /// Reason of the stop, as text for a person; empty if none was given.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub why: String,
}

/// Release of stops. It ends only the stops that it names; others go on.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReleaseStops {
    /// Identifiers of the stops to end.
    pub ids: Vec<String>,
}

/// The stops that one actuator knows: its answer to a query.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StopState {
    /// The actuator.
    pub agent: AgentId,
    /// Stops that are in force at the actuator's daemon, the oldest first.
    pub stops: Vec<Stop>,
    /// Positions of the hardware stops of the ecosystem, as the actuator's daemon knows them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub buttons: Vec<ButtonReport>,
}

/// Position of one hardware stop, as a daemon knows it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ButtonReport {
    /// The agent of the hardware stop.
    pub button: AgentId,
    /// Its position.
    pub position: ButtonPosition,
}

/// Position of a hardware stop.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ButtonPosition {
    /// The hardware stop is pressed.
    Pressed,
    /// The hardware stop is not pressed.
    NotPressed,
    /// The position is not known for a moment, as after a start.
    Unknown,
    /// The agent of the hardware stop is absent, or does not know the position, for a while.
    Silent,
    /// The position is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// Effect of a stop on one actuator.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopEffect {
    /// The stop has ended an action, and the device stands still.
    Ended,
    /// The device did nothing; it begins nothing until the release.
    Still,
    /// The agent has done what it can, and its device has not confirmed that it stands still.
    Doubtful,
    /// The stop names neither the agent, nor a place where it is, nor an object of its action.
    Unconcerned,
    /// The effect is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// Longest identifier of a stop, in bytes.
pub const STOP_ID_BYTES_MAX: usize = 64;

/// Maximum number of names in the scope of a stop; a stop of more names stops everything.
pub const STOP_NAMES_MAX: usize = 64;

impl Stop {
    /// Whether the stop is one of everything.
    pub fn is_of_everything(&self) -> bool {
        self.scope.is_empty()
    }

    /// Whether the stop concerns `name`, which is that of an agent or a place.
    pub fn concerns(&self, name: &str) -> bool {
        self.is_of_everything() || self.scope.iter().any(|named| named.eq_ignore_ascii_case(name))
    }
}
