//! Cleaning: a robot sweeps its true location.
//!
//! The building has no model of dirt. A sweep is only an occurrence in the log, for tests to check.

use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{CleaningAnswer, CleaningAsk, DriverAnswer, DriverRequest};
use crate::error::DeviceError;
use crate::handle::BuildingHandle;
use crate::truth::{BuildingEvent, Truth};

/// Duration of a sweep. All places take equally long, because the layout has no sizes.
const SWEEPING: Duration = Duration::from_secs(20);

// === impl Truth ===

impl Truth {
    /// Returns the number of sweeps of a place in the occurrences that the log still has.
    pub fn swept_count(&self, location: &str) -> usize {
        let is_it = |event: &BuildingEvent| matches!(event, BuildingEvent::Swept { location: place, .. } if place == location);
        self.occurrences().filter(|occurrence| is_it(&occurrence.event)).count()
    }

    /// Begins to sweep the location of the robot. Returns the location and the duration of the
    /// sweep.
    fn begin_sweeping(&mut self, robot: &str) -> Result<(String, Duration), DeviceError> {
        self.require_robot(robot)?;
        let slowness = self.begin_use(robot)?;
        Ok((self.require_place(robot)?, SWEEPING + slowness))
    }

    fn finish_sweeping(&mut self, robot: &str, begun_at: &str) -> Result<String, DeviceError> {
        self.require_unbroken(robot)?;
        let location = self.require_place(robot)?;
        if location != begun_at {
            return Err(DeviceError::Busy { device: robot.to_owned() });
        }
        let robot = robot.to_owned();
        self.log.record(BuildingEvent::Swept { robot, location: location.clone() });
        Ok(location)
    }
}

// === impl Building ===

impl Building {
    /// Sweeps the location of a robot, and returns the name of the location. Dropping the future
    /// cancels the sweep, which then does not count.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such robot, if it is broken, or if it was driven away during
    /// the sweep.
    pub async fn sweep(&self, robot: &str) -> Result<String, DeviceError> {
        let (location, takes) = self.change(|truth| truth.begin_sweeping(robot))?;
        self.work(robot, takes, |truth| truth.finish_sweeping(robot, &location)).await
    }

    async fn cleaning(&self, ask: CleaningAsk) -> Result<CleaningAnswer, DeviceError> {
        let CleaningAsk::Sweep { robot } = ask;
        self.sweep(&robot).await.map(CleaningAnswer::Swept)
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Sweeps the location of a robot; see [`Building::sweep`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::sweep`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn sweep(&self, robot: &str) -> Result<String, DeviceError> {
        let CleaningAnswer::Swept(location) =
            self.cleaning(CleaningAsk::Sweep { robot: robot.to_owned() }).await?;
        Ok(location)
    }

    pub(crate) async fn cleaning(&self, ask: CleaningAsk) -> Result<CleaningAnswer, DeviceError> {
        match self.local() {
            Ok(building) => building.cleaning(ask).await,
            Err(remote) => match remote.ask(DriverRequest::Cleaning(ask)).await? {
                DriverAnswer::Cleaning(answer) => Ok(answer),
                other => Err(other.unexpected()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use crate::{Building, DeviceFault, Layout};

    #[tokio::test(start_paused = true)]
    async fn a_cancelled_or_failed_sweep_does_not_count() {
        let building = Building::new(Layout::seeded(0).layout, 1.0).unwrap();
        assert_eq!(building.sweep("turtlebot-1").await.unwrap(), "corridor");
        let soon = Duration::from_secs(5);
        let _ = tokio::time::timeout(soon, building.sweep("turtlebot-1")).await;
        assert_eq!(building.truth().swept_count("corridor"), 1, "called off");
        building.break_at_next_use("turtlebot-1", DeviceFault::Fails).unwrap();
        assert!(building.sweep("turtlebot-1").await.is_err());
        assert_eq!(building.truth().swept_count("corridor"), 1);
        assert!(building.sweep("thermometer-office2").await.is_err(), "it does not clean");
    }
}
