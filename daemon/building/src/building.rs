//! The building at work: operations that take time, and the hand of fate.
//!
//! - Drivers' operations begin in one instant and end in another; in between the
//!   truth may change, and they notice. A future that is dropped is called off.
//! - Fate's operations are instants. Each that changes something wakes whoever
//!   waits in [`Building::wait_for`], so tests await events and never sleep.
//! - The instants themselves are in `world`; the socket is in `server`.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{Device, Layout};
use crate::truth::{Fault, Reading, Truth};

/// The slowest that time may pass; with the layout's bounds, no trip overflows.
const TIME_SCALE_MAX: f64 = 1_000.0;

/// A simulated building. Cloning it gives another hold on the same building.
#[derive(Clone, Debug)]
pub struct Building {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    time_scale: f64,
    opened: Instant,
    truth: watch::Sender<Truth>,
}

impl Building {
    /// Opens a building in which every duration is multiplied by `time_scale`:
    /// 1.0 is real time, 0.1 ten times as fast, 0.0 without any waiting.
    ///
    /// Durations run on Tokio's clock, so they stand still when it is paused.
    pub fn new(layout: Layout, time_scale: f64) -> Result<Building, LayoutError> {
        if !(0.0..=TIME_SCALE_MAX).contains(&time_scale) {
            return Err(LayoutError::BadTimeScale { time_scale });
        }
        let truth = watch::Sender::new(Truth::of(layout));
        Ok(Building { shared: Arc::new(Shared { time_scale, opened: Instant::now(), truth }) })
    }

    /// What a driver in this process holds: the devices without the truth.
    pub fn handle(&self) -> BuildingHandle {
        BuildingHandle::in_process(self.clone())
    }
}

// === impl Building: drivers ===

impl Building {
    /// Measures the temperature where the sensor truly is.
    pub async fn read_temperature(&self, sensor: &str) -> Result<Reading, DeviceError> {
        let takes = self.change(|truth| truth.begin_reading(sensor))?;
        self.work(sensor, takes, |truth| truth.finish_reading(sensor)).await
    }

    /// Drives a robot to a location next to where it truly is.
    ///
    /// Dropping the future calls the trip off: the robot then stands where it
    /// started, or has arrived, never between. Two robots may pass each other.
    pub async fn navigate(&self, robot: &str, to: &str) -> Result<(), DeviceError> {
        let Some(trip) = self.change(|truth| truth.begin_trip(robot, to))? else {
            return Ok(());
        };
        let _errand = Errand { building: self, robot, id: trip.errand };
        self.work(robot, trip.takes, |truth| truth.finish_trip(robot, to, trip.errand)).await
    }

    /// Where a device truly is: robots localize themselves, sensors are labeled.
    pub fn place_of(&self, device: &str) -> Result<String, DeviceError> {
        self.shared.truth.borrow().require_place(device)
    }
}

// === impl Building: fate ===

impl Building {
    /// Makes a location warmer or colder.
    pub fn set_temperature(&self, location: &str, celsius: f64) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_temperature(location, celsius))
    }

    /// Breaks a device now; returns the sequence number of that occurrence.
    pub fn break_device(&self, device: &str, fault: Fault) -> Result<u64, LayoutError> {
        self.change(|truth| truth.break_device(device, fault))
    }

    /// Lets a device break in the instant when it is used next, so that it dies
    /// after somebody began to rely on it and before it did anything.
    pub fn break_at_next_use(&self, device: &str, fault: Fault) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_trap(device, fault))
    }

    /// Breaks a device and changes a temperature in one instant; returns the
    /// sequence number of the break.
    pub(crate) fn break_and_set_temperature(
        &self,
        device: &str,
        fault: Fault,
        location: &str,
        celsius: f64,
    ) -> Result<u64, LayoutError> {
        self.change(|truth| {
            let broken = truth.break_device(device, fault)?;
            truth.set_temperature(location, celsius)?;
            Ok(broken)
        })
    }

    /// Makes a device work again. What hung on it goes on.
    pub fn repair(&self, device: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.repair(device))
    }

    /// Locks the door between two locations, in both directions. A robot that is
    /// on its way through finds it locked at the end, and stays where it was.
    pub fn lock_door(&self, a: &str, b: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_locked(a, b, true))
    }

    /// Unlocks the door between two locations.
    pub fn unlock_door(&self, a: &str, b: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.set_locked(a, b, false))
    }

    /// Brings a device into the building.
    pub fn add_device(&self, device: Device) -> Result<(), LayoutError> {
        self.change(|truth| truth.add_device(device))
    }

    /// Takes a device out of the building, and with a robot what it carries.
    pub fn remove_device(&self, device: &str) -> Result<(), LayoutError> {
        self.change(|truth| truth.remove_device(device))
    }

    /// The whole truth at this moment.
    pub fn truth(&self) -> Truth {
        self.shared.truth.borrow().clone()
    }

    /// Follows the truth. Borrow from it briefly: the building waits meanwhile.
    pub fn subscribe(&self) -> watch::Receiver<Truth> {
        self.shared.truth.subscribe()
    }

    /// Waits until the truth satisfies `predicate`, and returns it as it then is.
    ///
    /// May wait for ever: whoever calls it has a deadline, and drops the future.
    pub async fn wait_for(&self, predicate: impl FnMut(&Truth) -> bool) -> Truth {
        let mut truth = self.subscribe();
        let satisfied = truth.wait_for(predicate).await;
        satisfied.expect("invariant: `self` holds the sender").clone()
    }
}

// === impl Building: time ===

impl Building {
    /// Changes the truth in one instant, and wakes the waiting if something
    /// happened, that is, if it stands in the log.
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

    /// Keeps a device busy for `takes`, then runs `finish`. Ends early where the
    /// device breaks or leaves; goes on when one that hangs is repaired.
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
                now.fault_of(device) == Some(Fault::Hangs)
            };
            tokio::select! {
                // Changes first: a device that broke in the last instant is broken.
                biased;
                changed = truth.changed() => {
                    changed.expect("invariant: `self` holds the sender");
                    continue;
                }
                () = tokio::time::sleep_until(due), if !hangs => (),
            }
            // It may have begun to hang since it was looked at; then look again.
            let finished = self.change(|truth| match truth.fault_of(device) {
                Some(Fault::Hangs) => None,
                _ => Some(finish(truth)),
            });
            if let Some(outcome) = finished {
                return outcome;
            }
        }
    }
}

/// A robot's errand. Dropped before its end, it leaves the robot where it stood.
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
