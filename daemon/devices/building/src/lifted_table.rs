//! A table that robots have lifted, as the truth of the building has it.

use std::collections::BTreeMap;
use std::time::Duration;

/// A table that is lifted.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LiftedTable {
    pub(crate) robots: [String; 2],
    pub(crate) to: String,
    /// The trip of each robot that has lifted it, by the robot's name.
    pub(crate) trips: BTreeMap<String, LiftingTrip>,
    /// Whether it has arrived.
    pub(crate) has_arrived: bool,
}

/// The trip of a robot that has lifted a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LiftingTrip {
    pub(crate) errand: u64,
    pub(crate) takes: Duration,
}

// === impl LiftedTable ===

impl LiftedTable {
    /// Whether both robots have lifted it.
    pub(crate) fn is_complete(&self) -> bool {
        self.has_arrived || self.trips.len() == self.robots.len()
    }

    pub(crate) fn is_lifted_by(&self, robot: &str, errand: u64) -> bool {
        self.trips.get(robot).is_some_and(|trip| trip.errand == errand)
    }
}
