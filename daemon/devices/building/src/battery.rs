//! The batteries of robots: each meter that a robot drives drains its battery, and the dock
//! recharges it.
//!
//! A robot without a battery in the layout has no limit of distance. The functions of [`Truth`] in
//! this file change the state at once; those of [`Building`] take time.

use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{BatteryAnswer, BatteryAsk, DriverAnswer, DriverRequest};
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{Layout, RobotBattery};
use crate::truth::{BuildingEvent, Truth};

/// Maximum range of a full battery (100 km, in meters), and maximum time to recharge one (a day, in
/// seconds).
const RANGE_MAX: f64 = 100_000.0;
const RECHARGE_MAX: f64 = 24.0 * 3_600.0;

// === impl Layout ===

impl Layout {
    /// Equips `robot` with a battery, which replaces an earlier one.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot or dock, or if a figure of the battery is out of
    /// range.
    pub fn equip(
        &mut self,
        robot: &str,
        battery: RobotBattery,
    ) -> Result<&mut Layout, LayoutError> {
        self.check_carrier(robot)?;
        self.check_location(&battery.dock)?;
        let RobotBattery { range, charge, recharge_time, .. } = &battery;
        let fits = (0.0..=RANGE_MAX).contains(range)
            && (0.0..=*range).contains(charge)
            && (0.0..=RECHARGE_MAX).contains(recharge_time);
        if !fits {
            return Err(LayoutError::BadBattery { robot: robot.to_owned() });
        }
        self.batteries.insert(robot.to_owned(), battery);
        Ok(self)
    }

    /// Returns the battery of a robot; `None` if the robot has no battery.
    pub fn battery(&self, robot: &str) -> Option<&RobotBattery> {
        self.batteries.get(robot)
    }
}

// === impl Truth ===

impl Truth {
    /// Returns the remaining range of a robot, in meters; `None` if the robot has no battery.
    pub fn charge(&self, robot: &str) -> Option<f64> {
        self.charges.get(robot).copied()
    }

    pub(crate) fn require_charge(
        &self,
        robot: &str,
        to: &str,
        meters: f64,
    ) -> Result<(), DeviceError> {
        if self.charge(robot).is_some_and(|charge| charge < meters) {
            let (device, to) = (robot.to_owned(), to.to_owned());
            return Err(DeviceError::EmptyBattery { device, to });
        }
        Ok(())
    }

    pub(crate) fn drain(&mut self, robot: &str, meters: f64) {
        if let Some(charge) = self.charges.get_mut(robot) {
            *charge = (*charge - meters).max(0.0);
        }
    }

    /// Begins to recharge a robot. Returns the duration of the recharging.
    fn begin_recharging(&mut self, robot: &str) -> Result<Duration, DeviceError> {
        let slowness = self.begin_use(robot)?;
        let battery = self.require_dock(robot)?;
        let charge = self.charge(robot).unwrap_or_default();
        // A battery with range 0 is always full.
        let missing = if battery.range > 0.0 { 1.0 - charge / battery.range } else { 0.0 };
        Ok(Duration::from_secs_f64(battery.recharge_time * missing.clamp(0.0, 1.0)) + slowness)
    }

    fn finish_recharging(&mut self, robot: &str) -> Result<(), DeviceError> {
        self.require_unbroken(robot)?;
        let RobotBattery { dock, range, .. } = self.require_dock(robot)?;
        self.charges.insert(robot.to_owned(), range);
        self.log.record(BuildingEvent::Recharged { robot: robot.to_owned(), at: dock });
        Ok(())
    }

    /// Returns the battery of a robot; an error if the robot is not at its dock or has no battery.
    fn require_dock(&self, robot: &str) -> Result<RobotBattery, DeviceError> {
        self.require_robot(robot)?;
        let Some(battery) = self.layout.battery(robot) else {
            let (device, dock) = (robot.to_owned(), None);
            return Err(DeviceError::NotAtDock { device, dock });
        };
        if self.require_place(robot)? != battery.dock {
            let (device, dock) = (robot.to_owned(), Some(battery.dock.clone()));
            return Err(DeviceError::NotAtDock { device, dock });
        }
        Ok(battery.clone())
    }

    fn set_charge(&mut self, robot: &str, meters: f64) -> Result<(), LayoutError> {
        self.require_known(robot)?;
        let range = self.layout.battery(robot).map(|battery| battery.range);
        if !range.is_some_and(|range| (0.0..=range).contains(&meters)) {
            return Err(LayoutError::BadBattery { robot: robot.to_owned() });
        }
        self.charges.insert(robot.to_owned(), meters);
        self.log.record(BuildingEvent::ChargeSet { robot: robot.to_owned(), meters });
        Ok(())
    }
}

// === impl Building ===

impl Building {
    /// Recharges a robot's battery; the robot must be at its dock.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, if it has no battery, if it is broken, or if it
    /// is not at its dock.
    pub async fn recharge(&self, robot: &str) -> Result<(), DeviceError> {
        let takes = self.change(|truth| truth.begin_recharging(robot))?;
        self.work(robot, takes, |truth| truth.finish_recharging(robot)).await
    }

    /// Returns the remaining range of a robot, in meters; `None` if the robot has no battery.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot.
    pub fn charge_of(&self, robot: &str) -> Result<Option<f64>, DeviceError> {
        let truth = self.subscribe();
        let truth = truth.borrow();
        truth.require_robot(robot)?;
        Ok(truth.charge(robot))
    }

    /// Sets the remaining range of a robot, in meters. For tests and scenarios.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, if it has no battery, or if `meters` is not
    /// between 0 and the range of a full battery.
    pub fn set_charge(&self, robot: &str, meters: f64) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_charge(robot, meters))
    }

    async fn battery(&self, ask: BatteryAsk) -> Result<BatteryAnswer, DeviceError> {
        match ask {
            BatteryAsk::Recharge { robot } => {
                self.recharge(&robot).await.map(|()| BatteryAnswer::Full)
            }
            BatteryAsk::Charge { robot } => self.charge_of(&robot).map(BatteryAnswer::Charge),
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Recharges a robot's battery; the robot must be at its dock.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::recharge`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn recharge(&self, robot: &str) -> Result<(), DeviceError> {
        match self.battery(BatteryAsk::Recharge { robot: robot.to_owned() }).await? {
            BatteryAnswer::Full => Ok(()),
            other => Err(DriverAnswer::Battery(other).unexpected()),
        }
    }

    /// Returns the remaining range of a robot, in meters; `None` if the robot has no battery.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::charge_of`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn charge_of(&self, robot: &str) -> Result<Option<f64>, DeviceError> {
        match self.battery(BatteryAsk::Charge { robot: robot.to_owned() }).await? {
            BatteryAnswer::Charge(charge) => Ok(charge),
            other => Err(DriverAnswer::Battery(other).unexpected()),
        }
    }

    pub(crate) async fn battery(&self, ask: BatteryAsk) -> Result<BatteryAnswer, DeviceError> {
        match self.local() {
            Ok(building) => building.battery(ask).await,
            Err(remote) => match remote.ask(DriverRequest::Battery(ask)).await? {
                DriverAnswer::Battery(answer) => Ok(answer),
                other => Err(other.unexpected()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use expect_test::expect;
    use tokio::time::Instant;

    use crate::fixture::log_lines;
    use crate::{Building, Layout, RobotBattery};

    fn office_with_battery(charge: f64) -> Building {
        let mut layout = Layout::seeded(0).layout;
        let dock = "corridor".to_owned();
        let battery = RobotBattery { dock, range: 10.0, charge, recharge_time: 60.0 };
        layout.equip("turtlebot-1", battery).unwrap();
        Building::new(layout, 1.0).unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn a_battery_drains_by_the_meter_and_fills_at_the_dock_only() {
        let building = office_with_battery(10.0);
        let charge = || building.truth().charge("turtlebot-1").unwrap();
        building.navigate("turtlebot-1", "office1").await.unwrap();
        assert_eq!(charge(), 6.0);
        let away = building.recharge("turtlebot-1").await.unwrap_err().to_string();
        assert_eq!(away, "recharge `turtlebot-1`: it does not stand at its dock `corridor`");
        building.navigate("turtlebot-1", "corridor").await.unwrap();
        let empty = building.navigate("turtlebot-1", "office1").await.unwrap_err().to_string();
        assert_eq!(empty, "drive `turtlebot-1` to `office1`: its battery does not last so far");
        let began = Instant::now();
        building.recharge("turtlebot-1").await.unwrap();
        assert_eq!(began.elapsed(), Duration::from_secs(48), "four fifths of a minute");
        assert_eq!(charge(), 10.0);
        expect![[r#"
            turtlebot-1 departs corridor office1
            turtlebot-1 moves corridor office1
            turtlebot-1 departs office1 corridor
            turtlebot-1 moves office1 corridor
            turtlebot-1 is recharged at corridor"#]]
        .assert_eq(&log_lines(&building.truth()).join("\n"));
    }

    #[tokio::test(start_paused = true)]
    async fn a_cancelled_trip_drains_no_battery() {
        let building = office_with_battery(10.0);
        let soon = Duration::from_secs(5);
        let _ = tokio::time::timeout(soon, building.navigate("turtlebot-1", "office1")).await;
        assert_eq!(building.truth().charge("turtlebot-1"), Some(10.0));
    }

    #[test]
    fn a_battery_out_of_range_is_refused() {
        for (range, charge, fits) in
            [(10.0, 10.0, true), (10.0, 11.0, false), (-1.0, 0.0, false), (f64::NAN, 0.0, false)]
        {
            let mut layout = Layout::seeded(0).layout;
            let dock = "corridor".to_owned();
            let battery = RobotBattery { dock, range, charge, recharge_time: 1.0 };
            assert_eq!(layout.equip("turtlebot-1", battery).is_ok(), fits, "{range} {charge}");
        }
    }
}
