//! Tables: two robots carry one together, and neither of them alone.
//!
//! - Both robots stand where the table stands, and lift it within [`LIFTED_WITHIN`]. Then they drive at
//!   the speed of the slower one.
//! - They arrive at the same moment, with the table. If one lets go before, because it breaks or its
//!   driver gives up, all three stay where they were.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::ParcelAsk;
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::Layout;
use crate::lifted_table::{LiftedTable, LiftingTrip};
use crate::parcels::impossible;
use crate::truth::{BuildingEvent, DeviceFault, Truth};

/// Longest time between the moments at which two robots lift a table; in real time, whatever the time
/// scale of the building.
const LIFTED_WITHIN: Duration = Duration::from_secs(1);

// === impl Layout ===

impl Layout {
    /// Puts a table into a location.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, or if there is no such location.
    pub fn add_table(&mut self, name: &str, location: &str) -> Result<&mut Layout, LayoutError> {
        self.check_new_name(name)?;
        self.check_location(location)?;
        self.tables.insert(name.to_owned(), location.to_owned());
        Ok(self)
    }

    /// Returns the location of each table at the start, by the table's name.
    pub fn tables(&self) -> &BTreeMap<String, String> {
        &self.tables
    }
}

// === impl Truth ===

impl Truth {
    /// Returns the location of a table; `None` if there is no such table.
    pub fn table(&self, table: &str) -> Option<&str> {
        self.tables.get(table).map(String::as_str)
    }

    /// Lets a robot lift a table at one end. Returns the number of its trip.
    fn lift(
        &mut self,
        (robot, other): (&str, &str),
        table: &str,
        to: &str,
    ) -> Result<u64, DeviceError> {
        self.require_robot(robot)?;
        self.require_robot(other)?;
        if robot == other {
            return Err(impossible(robot, format!("`{table}` needs two robots")));
        }
        let here = self.require_place(robot)?;
        if self.table(table) != Some(here.as_str()) {
            return Err(impossible(robot, format!("`{table}` is not at `{here}`")));
        }
        if let Some(carried) = self.carried_by(robot) {
            return Err(impossible(robot, format!("it carries `{carried}`")));
        }
        let is_other = |lifted: &LiftedTable| {
            let is_of_both =
                [robot, other].iter().all(|it| lifted.robots.iter().any(|by| by == it));
            lifted.has_arrived || lifted.to != to || !is_of_both
        };
        if self.lifted_tables.get(table).is_some_and(is_other) {
            return Err(impossible(robot, format!("others carry `{table}`")));
        }
        let Some(trip) = self.begin_trip(robot, to)? else {
            return Err(impossible(robot, format!("`{table}` is at `{to}` already")));
        };
        let lifted = self.lifted_tables.entry(table.to_owned()).or_insert_with(|| LiftedTable {
            robots: [robot.to_owned(), other.to_owned()],
            to: to.to_owned(),
            trips: BTreeMap::new(),
            has_arrived: false,
        });
        let (errand, takes) = (trip.errand, trip.takes);
        lifted.trips.insert(robot.to_owned(), LiftingTrip { errand, takes });
        Ok(errand)
    }

    fn is_lifted(&self, table: &str, robot: &str, errand: u64) -> bool {
        self.lifted_tables.get(table).is_some_and(|lifted| lifted.is_lifted_by(robot, errand))
    }

    /// Returns how long both robots take with a table: as long as the slower one takes alone.
    fn carrying_time(&self, table: &str) -> Duration {
        let trips = self.lifted_tables.get(table).into_iter().flat_map(|it| it.trips.values());
        trips.map(|trip| trip.takes).max().unwrap_or_default()
    }

    /// Ends a trip with a table: both robots arrive with it, or none. Returns `false` if they have not
    /// arrived, because the other robot hangs.
    fn arrive(&mut self, robot: &str, table: &str) -> Result<bool, DeviceError> {
        let Some(lifted) = self.lifted_tables.get(table).cloned() else {
            return Err(released_by_other(robot, table));
        };
        if lifted.has_arrived {
            return Ok(true);
        }
        if lifted.robots.iter().any(|by| self.fault_of(by) == Some(DeviceFault::Hangs)) {
            return Ok(false);
        }
        for by in &lifted.robots {
            self.require_unbroken(by).map_err(|error| match by == robot {
                true => error,
                false => released_by_other(robot, table),
            })?;
        }
        let from = self.table(table).unwrap_or_default().to_owned();
        for (by, trip) in &lifted.trips {
            self.finish_trip(by, &lifted.to, trip.errand)?;
        }
        self.tables.insert(table.to_owned(), lifted.to.clone());
        let (robots, table, to) = (lifted.robots.clone(), table.to_owned(), lifted.to.clone());
        if let Some(lifted) = self.lifted_tables.get_mut(&table) {
            lifted.has_arrived = true;
        }
        self.log.record(BuildingEvent::TableCarried { robots, table, from, to });
        Ok(true)
    }

    /// Lets a robot release a table. Both robots release a table that has not arrived.
    fn let_go(&mut self, robot: &str, table: &str, errand: u64) {
        self.end_errand(robot, errand);
        let Some(lifted) = self.lifted_tables.get_mut(table) else { return };
        if !lifted.is_lifted_by(robot, errand) {
            return;
        }
        lifted.trips.remove(robot);
        if !lifted.has_arrived || lifted.trips.is_empty() {
            self.lifted_tables.remove(table);
        }
    }
}

fn released_by_other(robot: &str, table: &str) -> DeviceError {
    DeviceError::LetGo { device: robot.to_owned(), table: table.to_owned() }
}

// === impl Building ===

/// A table that a robot has lifted. Dropping this value lets go of it.
struct Grasp<'a> {
    building: &'a Building,
    robot: &'a str,
    table: &'a str,
    errand: u64,
}

impl Drop for Grasp<'_> {
    fn drop(&mut self) {
        self.building.change(|truth| truth.let_go(self.robot, self.table, self.errand));
    }
}

impl Building {
    /// Lets `robot` carry a table with the robot `other` to a neighbor of their location. The drivers of
    /// both robots must ask for it. Dropping the future releases the table.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, table or place, if the robot is broken, drives, carries
    /// a parcel or is elsewhere, if no unlocked door leads there, or if the other robot does not lift
    /// the table with it, or lets go.
    pub async fn carry_table(
        &self,
        (robot, other): (&str, &str),
        table: &str,
        to: &str,
    ) -> Result<(), DeviceError> {
        let errand = self.change(|truth| truth.lift((robot, other), table, to))?;
        let _grasp = Grasp { building: self, robot, table, errand };
        let mut truth = self.subscribe();
        let is_decided = |truth: &Truth| match truth.lifted_tables.get(table) {
            Some(lifted) => lifted.is_complete() || !lifted.is_lifted_by(robot, errand),
            None => true,
        };
        let decided = tokio::time::timeout(LIFTED_WITHIN, truth.wait_for(is_decided)).await.is_ok();
        if !decided {
            let reason = format!("`{other}` does not lift `{table}` with it");
            return Err(DeviceError::LiftedAlone { device: robot.to_owned(), reason });
        }
        let is_let_go = |truth: &Truth| !truth.is_lifted(table, robot, errand);
        // `self` holds the sender, so there is no error.
        let let_go = async { drop(truth.wait_for(is_let_go).await) };
        let takes = self.change(|truth| truth.carrying_time(table));
        let arriving = async {
            let mut seen = self.subscribe();
            let mut takes = takes;
            while !self.work(robot, takes, |truth| truth.arrive(robot, table)).await? {
                let goes_on = |truth: &Truth| {
                    let hangs = |by: &str| truth.fault_of(by) == Some(DeviceFault::Hangs);
                    !hangs(robot) && !hangs(other)
                };
                drop(seen.wait_for(goes_on).await);
                takes = Duration::ZERO;
            }
            Ok(())
        };
        tokio::select! {
            biased;
            arrived = arriving => arrived,
            () = let_go => {
                Err(released_by_other(robot, table))
            }
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Lets a robot carry a table together with another one; see [`Building::carry_table`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::carry_table`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn carry_table(
        &self,
        (robot, other): (&str, &str),
        table: &str,
        to: &str,
    ) -> Result<(), DeviceError> {
        let (robot, other) = (robot.to_owned(), other.to_owned());
        let (table, to) = (table.to_owned(), to.to_owned());
        self.parcel(ParcelAsk::CarryTable { robot, other, table, to }).await.map(drop)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    const BOTH: (&str, &str) = ("mover-1", "mover-2");
    const OTHER: (&str, &str) = ("mover-2", "mover-1");

    fn house() -> Building {
        let mut layout = Layout::new();
        layout.add_room("store", 18.0).and_then(|it| it.add_room("hall", 19.0)).expect("places");
        layout.connect("store", "hall", 10.0).expect("a way");
        layout.add_robot("mover-1", "store", 1.0).expect("a robot");
        layout.add_robot("mover-2", "store", 0.5).expect("a robot");
        layout.add_table("table-1", "store").expect("a table");
        Building::new(layout, 1.0).expect("a building")
    }

    fn places(building: &Building) -> [String; 3] {
        let truth = building.truth();
        let place = |robot| truth.place_of(robot).expect("a place").to_owned();
        [place("mover-1"), place("mover-2"), truth.table("table-1").expect("it is there").into()]
    }

    #[tokio::test(start_paused = true)]
    async fn two_robots_arrive_together_at_the_speed_of_the_slower() {
        let building = house();
        let began = tokio::time::Instant::now();
        let (one, other) = tokio::join!(
            building.carry_table(BOTH, "table-1", "hall"),
            building.carry_table(OTHER, "table-1", "hall"),
        );
        assert_eq!((one, other), (Ok(()), Ok(())));
        assert_eq!(began.elapsed().as_secs(), 20);
        assert_eq!(places(&building), ["hall", "hall", "hall"]);
        let carried = |event: &BuildingEvent| matches!(event, BuildingEvent::TableCarried { .. });
        assert_eq!(building.truth().occurrences().filter(|it| carried(&it.event)).count(), 1);
        let back = tokio::join!(
            building.carry_table(BOTH, "table-1", "store"),
            building.carry_table(OTHER, "table-1", "store"),
        );
        assert_eq!(back, (Ok(()), Ok(())));
    }

    #[tokio::test(start_paused = true)]
    async fn one_robot_alone_lifts_no_table() {
        let building = house();
        let alone = building.carry_table(BOTH, "table-1", "hall").await.expect_err("alone");
        assert!(matches!(alone, DeviceError::LiftedAlone { .. }), "{alone}");
        assert_eq!(places(&building), ["store", "store", "store"]);
        building.navigate("mover-1", "hall").await.expect("it is free again");
        let there = building.carry_table(OTHER, "table-1", "hall").await.expect_err("elsewhere");
        assert!(matches!(there, DeviceError::LiftedAlone { .. }), "{there}");
        let away = building.carry_table(BOTH, "table-1", "store").await.expect_err("elsewhere");
        assert!(away.to_string().contains("`table-1` is not at `hall`"), "{away}");
    }

    #[tokio::test(start_paused = true)]
    async fn if_one_hangs_the_other_waits_for_it() {
        let building = house();
        let repair = async {
            building.break_device("mover-2", DeviceFault::Hangs).expect("it is there");
            tokio::time::sleep(Duration::from_secs(60)).await;
            assert_eq!(places(&building), ["store", "store", "store"]);
            building.repair("mover-2").expect("it is there");
        };
        let (one, other, ()) = tokio::join!(
            building.carry_table(BOTH, "table-1", "hall"),
            building.carry_table(OTHER, "table-1", "hall"),
            repair,
        );
        assert_eq!((one, other), (Ok(()), Ok(())));
        assert_eq!(places(&building), ["hall", "hall", "hall"]);
    }

    #[tokio::test(start_paused = true)]
    async fn if_one_lets_go_or_breaks_all_stay() {
        let building = house();
        let fault = async {
            tokio::time::sleep(Duration::from_secs(5)).await;
            building.break_device("mover-2", DeviceFault::Fails).expect("it is there");
        };
        let (one, other, ()) = tokio::join!(
            building.carry_table(BOTH, "table-1", "hall"),
            building.carry_table(OTHER, "table-1", "hall"),
            fault,
        );
        assert!(matches!(one, Err(DeviceError::LetGo { .. })), "{one:?}");
        assert!(matches!(other, Err(DeviceError::Broken { .. })), "{other:?}");
        assert_eq!(places(&building), ["store", "store", "store"]);

        let building = house();
        let given_up = Duration::from_secs(5);
        let (one, other) = tokio::join!(
            building.carry_table(BOTH, "table-1", "hall"),
            tokio::time::timeout(given_up, building.carry_table(OTHER, "table-1", "hall")),
        );
        assert!(matches!(one, Err(DeviceError::LetGo { .. })), "{one:?}");
        assert!(other.is_err(), "its driver gave up");
        assert_eq!(places(&building), ["store", "store", "store"]);
    }
}
