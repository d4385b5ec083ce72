//! A building in operation: operations of drivers, which take time, and control by tests and
//! scenarios.
//!
//! - An operation of a driver begins at one moment and ends at another. The truth may change in
//!   between, and the operation takes the change into account. Dropping the future of an operation
//!   cancels it.
//! - An operation of a test or a scenario happens at one moment. If the operation changes
//!   something, all callers of [`Building::wait_for`] are woken, so that tests await events instead
//!   of sleeping.
//! - The changes of the truth are in `world`; the Unix socket for drivers in other processes is in
//!   `server`.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use crate::error::{DeviceError, LayoutError};
use crate::layout::{BuildingDevice, Layout};
use crate::truth::{DeviceFault, TemperatureReading, Truth};

/// Maximum time scale; 1.0 is real time. With the bounds of the layout, no duration of a trip
/// overflows.
const TIME_SCALE_MAX: f64 = 1_000.0;

/// A simulated building. Clones refer to the same building.
#[derive(Clone, Debug)]
pub struct Building {
    shared: Arc<SharedBuilding>,
}

#[derive(Debug)]
struct SharedBuilding {
    time_scale: f64,
    opened: Instant,
    truth: watch::Sender<Truth>,
}

impl Building {
    /// Opens a building in which every duration is multiplied by `time_scale`:
    /// 1.0 is real time, 0.1 ten times as fast, 0.0 without any waiting.
    ///
    /// Durations are measured by Tokio's clock: while that clock is paused, no time passes.
    ///
    /// # Errors
    ///
    /// Returns an error if the time scale is out of range.
    pub fn new(layout: Layout, time_scale: f64) -> Result<Building, LayoutError> {
        if !(0.0..=TIME_SCALE_MAX).contains(&time_scale) {
            return Err(LayoutError::BadTimeScale { time_scale });
        }
        let truth = watch::Sender::new(Truth::of(layout));
        Ok(Building {
            shared: Arc::new(SharedBuilding { time_scale, opened: Instant::now(), truth }),
        })
    }
}

// === impl Building: drivers ===

impl Building {
    /// Measures the temperature at the true location of the sensor.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device, if it is no temperature sensor, or if it is
    /// broken.
    pub async fn read_temperature(&self, sensor: &str) -> Result<TemperatureReading, DeviceError> {
        let takes = self.change(|truth| truth.begin_reading(sensor))?;
        self.work(sensor, takes, |truth| truth.finish_reading(sensor)).await
    }

    /// Drives a robot to a neighbor of its true location.
    ///
    /// Dropping the future cancels the trip: the robot is then either at its start or at `to`,
    /// never in between. Two robots may pass each other.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device or place, if the device is no robot, is broken,
    /// or has another trip under way, if no unlocked door leads there, or if the battery does not
    /// last.
    pub async fn navigate(&self, robot: &str, to: &str) -> Result<(), DeviceError> {
        let Some(trip) = self.change(|truth| truth.begin_trip(robot, to))? else {
            return Ok(());
        };
        let _errand = Errand { building: self, robot, id: trip.errand };
        self.work(robot, trip.takes, |truth| truth.finish_trip(robot, to, trip.errand)).await
    }

    /// Returns the true location of a device. A driver may request it, because a real robot
    /// localizes itself, and the location of a real sensor is written on the sensor.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device.
    pub fn place_of(&self, device: &str) -> Result<String, DeviceError> {
        self.shared.truth.borrow().require_place(device)
    }
}

// === impl Building: control by tests and scenarios ===

impl Building {
    /// Sets the true temperature of a location, in °C.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, or if the temperature is out of range.
    pub fn set_temperature(&self, location: &str, celsius: f64) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_temperature(location, celsius))
    }

    /// Breaks a device now. Returns the sequence number of the break in the log.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device.
    pub fn break_device(&self, device: &str, fault: DeviceFault) -> Result<u64, LayoutError> {
        self.change(|truth| truth.break_device(device, fault))
    }

    /// Breaks a device at its next use: after an agent has begun to rely on the device, and before
    /// the device has done anything.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device.
    pub fn break_at_next_use(&self, device: &str, fault: DeviceFault) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_trap(device, fault))
    }

    /// Breaks a device and changes a temperature in one instant. Returns the sequence number of the
    /// break in the log.
    pub(crate) fn break_and_set_temperature(
        &self,
        device: &str,
        fault: DeviceFault,
        location: &str,
        celsius: f64,
    ) -> Result<u64, LayoutError> {
        self.change(|truth| {
            let broken = truth.break_device(device, fault)?;
            truth.set_temperature(location, celsius)?;
            Ok(broken)
        })
    }

    /// Repairs a device. Operations that waited because the device hung continue.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device.
    pub fn repair(&self, device: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.repair(device))
    }

    /// Locks the door between two locations, in both directions. A robot that is on its way through
    /// the door finds the door locked at the end of its trip, and stays at the start.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, or no door between the two.
    pub fn lock_door(&self, a: &str, b: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_locked(a, b, true))
    }

    /// Unlocks the door between two locations.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, or no door between the two.
    pub fn unlock_door(&self, a: &str, b: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_locked(a, b, false))
    }

    /// Adds a device to the building.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Layout::add_device`].
    pub fn add_device(&self, device: BuildingDevice) -> Result<(), LayoutError> {
        self.change(|truth| truth.add_device(device))
    }

    /// Removes a device from the building. If the device is a robot, the devices that it carries
    /// are removed with it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device.
    pub fn remove_device(&self, device: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.remove_device(device))
    }

    /// Returns a copy of the whole truth at this moment.
    pub fn truth(&self) -> Truth {
        self.shared.truth.borrow().clone()
    }

    /// Returns a receiver of the truth. A `borrow` of the receiver must be short, because nothing
    /// in the building can change while the truth is borrowed.
    pub fn subscribe(&self) -> watch::Receiver<Truth> {
        self.shared.truth.subscribe()
    }

    /// Waits until the truth satisfies `predicate`, and returns the truth of that moment.
    ///
    /// The wait may last forever: the caller sets a deadline and drops the future.
    pub async fn wait_for(&self, predicate: impl FnMut(&Truth) -> bool) -> Truth {
        let mut truth = self.subscribe();
        let satisfied = truth.wait_for(predicate).await;
        satisfied.expect("invariant: `self` holds the sender").clone()
    }
}

// === impl Building: time ===

impl Building {
    /// Changes the truth in one step by `act`. Wakes the callers that wait if `act` added an
    /// occurrence to the log.
    pub(crate) fn change<T>(&self, act: impl FnOnce(&mut Truth) -> T) -> T {
        let mut outcome = None;
        self.shared.truth.send_if_modified(|truth| {
            let before = truth.next_sequence();
            truth.log.now = self.shared.opened.elapsed();
            outcome = Some(act(truth));
            truth.next_sequence() != before
        });
        outcome.expect("invariant: `send_if_modified` calls its closure once")
    }

    /// Keeps a device busy for `takes`, then runs `finish`. Returns an error as soon as the device
    /// fails or is removed. While the device hangs, waits until it is repaired.
    pub(crate) async fn work<T>(
        &self,
        device: &str,
        takes: Duration,
        finish: impl Fn(&mut Truth) -> Result<T, DeviceError>,
    ) -> Result<T, DeviceError> {
        let mut truth = self.subscribe();
        let due = Instant::now() + takes.mul_f64(self.shared.time_scale);
        loop {
            let hangs = {
                let now = truth.borrow_and_update();
                now.require_unbroken(device)?;
                now.fault_of(device) == Some(DeviceFault::Hangs)
            };
            tokio::select! {
                // Changes are handled first, so that a device that broke at the last moment counts
                // as broken.
                biased;
                changed = truth.changed() => {
                    changed.expect("invariant: `self` holds the sender");
                    continue;
                }
                () = tokio::time::sleep_until(due), if !hangs => (),
            }
            // The device may have begun to hang since the check above; then the loop continues.
            let finished = self.change(|truth| match truth.fault_of(device) {
                Some(DeviceFault::Hangs) => None,
                _ => Some(finish(truth)),
            });
            if let Some(outcome) = finished {
                return outcome;
            }
        }
    }
}

/// A trip of a robot that is under way. Dropping this value before the trip has ended cancels the
/// trip, and the robot stays at the start of the trip.
struct Errand<'a> {
    building: &'a Building,
    robot: &'a str,
    id: u64,
}

impl Drop for Errand<'_> {
    fn drop(&mut self) {
        self.building.change(|truth| truth.end_errand(self.robot, self.id));
    }
}

#[cfg(test)]
mod tests;
