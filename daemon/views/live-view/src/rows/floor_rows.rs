//! The floor plan: rooms, ways between them, and the robots that move there.

use acl::{AgentId, ConversationId};
use serde::Serialize;

/// The rooms of the building as a graph with a layout.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FloorPlan {
    /// The rooms, sorted by name.
    pub rooms: Vec<FloorRoom>,
    /// The ways between the rooms.
    pub ways: Vec<FloorWay>,
    /// The robots, sorted by name.
    pub robots: Vec<FloorRobot>,
    /// Number of further rooms, which are not listed.
    pub more_rooms: u64,
    /// Why the plan has no rooms, as one sentence; empty if it has some.
    pub empty_because: String,
}

/// One room, or any other place where robots can be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FloorRoom {
    /// Name of the room.
    pub name: String,
    /// Column of the room, from 0 (left) to 1 (right). Rooms of one column have equal values.
    pub x: f32,
    /// Row of the room, from 0 (top) to 1 (bottom).
    pub y: f32,
    /// The robots that are in the room.
    pub robots: Vec<AgentId>,
    /// Further facts about the room alone, short and without the room: `temperature 21.5`.
    pub facts: Vec<String>,
    /// Whether one of these facts is stale or unknown.
    pub is_stale: bool,
    /// Whether a stop concerns the room.
    pub is_stopped: bool,
}

/// A way between two rooms.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FloorWay {
    /// The room at one end.
    pub from: String,
    /// The room at the other end.
    pub to: String,
    /// Whether the way can be taken in both directions.
    pub both_ways: bool,
}

/// A robot in the building.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FloorRobot {
    /// The robot.
    pub agent: AgentId,
    /// The room in which the robot is; `None` if that is not known.
    pub room: Option<String>,
    /// The room to which the robot moves now; `None` if it does not move.
    pub moves_to: Option<String>,
    /// The rooms that the remaining steps of running plans lead through, in order, without the
    /// room in which the robot is.
    pub path: Vec<String>,
    /// The goal that the robot moves for; `None` if it does not move.
    pub conversation: Option<ConversationId>,
    /// Whether the robot is gone or silent, so that its room may be wrong.
    pub is_stale: bool,
    /// Whether a stop concerns the robot or its room.
    pub is_stopped: bool,
}
