//! The things that are added to an ecosystem file.

use crate::setting::SettingText;

/// One thing that is added to an ecosystem file.
#[derive(Clone, Debug, PartialEq)]
pub enum EcosystemAddition {
    /// A room, or another place.
    Room(RoomAddition),
    /// A door between two places.
    Door(DoorAddition),
    /// An agent.
    Agent(AgentAddition),
    /// A goal with a name.
    Goal(GoalAddition),
}

/// A place of the building.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomAddition {
    /// Name of the place.
    pub name: String,
    /// Type of the place in the ontology; `None` for a room.
    pub kind: Option<String>,
    /// Number of its floor.
    pub floor: Option<i64>,
    /// Area in square meters.
    pub area: Option<f64>,
    /// Further keys, as they are to be written.
    pub settings: Vec<SettingText>,
}

/// A door, through which robots pass from a place to another.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DoorAddition {
    /// Place on one side.
    pub from: String,
    /// Place on the other side.
    pub to: String,
    /// Length of the way in meters; `None` if it is not known.
    pub length: Option<f64>,
    /// Whether the door leads from `from` to `to` only.
    pub is_one_way: bool,
}

/// An agent: an entry `[[agent]]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AgentAddition {
    /// Name of the agent.
    pub name: String,
    /// Plugin that builds the agent.
    pub plugin: String,
    /// Daemons that host the agent; empty if the file names none for it.
    pub daemons: Vec<String>,
    /// Driver of the plugin; `None` for the plugin's default.
    pub driver: Option<String>,
    /// Keys of the agent's `config`.
    pub config: Vec<SettingText>,
}

/// A goal with a name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GoalAddition {
    /// Name of the goal.
    pub name: String,
    /// Text of the goal.
    pub goal: String,
    /// Whether the goal is kept, and asked for by the agent that leads.
    pub is_kept: bool,
    /// Further keys, such as `every`.
    pub settings: Vec<SettingText>,
}
