//! The physics of the building: each change of the truth, as one step.
//!
//! Every method here is one step: it is synchronous, and either complete or without effect. Each
//! event is recorded in the log. [`Building`](crate::Building) waits between the beginning and the
//! end of an operation.

use std::time::Duration;

use crate::error::{DeviceError, LayoutError};
use crate::layout::{BuildingDevice, Layout, check_temperature};
use crate::truth::{BuildingEvent, DeviceFault, OccurrenceLog, TemperatureReading, Truth, sides};

/// Duration of a measurement: about the time in which a thermopile settles.
pub(crate) const MEASURING: Duration = Duration::from_millis(100);

/// Maximum delay that a fault can add to one use of a device. With this bound, adding durations
/// cannot overflow.
const SLOW_MAX: Duration = Duration::from_secs(24 * 60 * 60);

/// A trip of a robot that has begun and not yet ended.
pub(crate) struct PendingTrip {
    /// Sequence number of the departure, which identifies the trip.
    pub(crate) errand: u64,
    /// Duration of the trip, in the building's time.
    pub(crate) takes: Duration,
}

impl Truth {
    pub(crate) fn of(layout: Layout) -> Truth {
        let temperatures =
            layout.locations().iter().map(|place| (place.name.clone(), place.celsius)).collect();
        let robots = layout.devices().iter().filter_map(|device| match device {
            BuildingDevice::Robot { name, start, .. } => Some((name.clone(), start.clone())),
            _ => None,
        });
        let charges =
            layout.batteries.iter().map(|(robot, battery)| (robot.clone(), battery.charge));
        let mut truth = Truth {
            robots: robots.collect(),
            charges: charges.collect(),
            temperatures,
            conditions: Default::default(),
            faults: Default::default(),
            people: Default::default(),
            locations_with_motion: Default::default(),
            aims: Default::default(),
            channels: Default::default(),
            shown: Default::default(),
            locked: Default::default(),
            log: OccurrenceLog::default(),
            traps: Default::default(),
            errands: Default::default(),
            cabins: Default::default(),
            parcels: Default::default(),
            tables: Default::default(),
            lifted_tables: Default::default(),
            layout,
        };
        truth.furnish();
        truth
    }
}

// === impl Truth: operations of drivers ===

impl Truth {
    /// Begins a temperature measurement. Returns the duration of the measurement.
    pub(crate) fn begin_reading(&mut self, sensor: &str) -> Result<Duration, DeviceError> {
        self.require_sensor(sensor)?;
        self.log.record(BuildingEvent::Asked { sensor: sensor.to_owned() });
        self.spring_trap(sensor);
        self.require_unbroken(sensor)?;
        Ok(MEASURING + self.slowness(sensor))
    }

    /// Ends a temperature measurement. Returns the measured temperature and the sensor's location.
    pub(crate) fn finish_reading(
        &mut self,
        sensor: &str,
    ) -> Result<TemperatureReading, DeviceError> {
        self.require_unbroken(sensor)?;
        let location = self.require_place(sensor)?;
        let celsius = self
            .temperature(&location)
            .expect("invariant: a device is at a location, and each location has a temperature");
        self.log.record(BuildingEvent::Read {
            sensor: sensor.to_owned(),
            location: location.clone(),
            celsius,
        });
        Ok(TemperatureReading { location, celsius })
    }

    /// Begins a trip to a neighbor of the robot's location. Returns `None` if the robot is already
    /// at the destination, because a request that is repeated after the loss of its answer must
    /// succeed.
    pub(crate) fn begin_trip(
        &mut self,
        robot: &str,
        to: &str,
    ) -> Result<Option<PendingTrip>, DeviceError> {
        let meters_per_second = self.require_robot(robot)?;
        self.require_location(to)?;
        if self.errands.contains_key(robot) {
            return Err(DeviceError::Busy { device: robot.to_owned() });
        }
        self.spring_trap(robot);
        self.require_unbroken(robot)?;
        let from = self.require_place(robot)?;
        if from == to {
            return Ok(None);
        }
        let meters = self.require_way(&from, to)?;
        self.require_charge(robot, to, meters)?;
        let departed = BuildingEvent::Departed { robot: robot.to_owned(), from, to: to.to_owned() };
        let errand = self.log.record(departed);
        self.errands.insert(robot.to_owned(), errand);
        let takes = Duration::from_secs_f64(meters / meters_per_second) + self.slowness(robot);
        Ok(Some(PendingTrip { errand, takes }))
    }

    /// Ends a trip: the robot arrives, unless it broke, was replaced, or finds the door locked.
    pub(crate) fn finish_trip(
        &mut self,
        robot: &str,
        to: &str,
        errand: u64,
    ) -> Result<(), DeviceError> {
        self.require_unbroken(robot)?;
        if self.errands.get(robot) != Some(&errand) {
            // The robot was removed meanwhile, and another robot with the same name was added.
            return Err(DeviceError::UnknownDevice { device: robot.to_owned(), nearest: None });
        }
        let from = self.require_place(robot)?;
        let meters = self.require_way(&from, to)?;
        self.drain(robot, meters);
        self.errands.remove(robot);
        self.robots.insert(robot.to_owned(), to.to_owned());
        self.log.record(BuildingEvent::Moved { robot: robot.to_owned(), from, to: to.to_owned() });
        Ok(())
    }

    /// Ends the trip `errand` of a robot. A robot that has not arrived stays at the start of the
    /// trip.
    pub(crate) fn end_errand(&mut self, robot: &str, errand: u64) {
        if self.errands.get(robot) != Some(&errand) {
            return;
        }
        self.errands.remove(robot);
        if let Some(at) = self.robots.get(robot).cloned() {
            self.log.record(BuildingEvent::Stayed { robot: robot.to_owned(), at });
        }
    }
}

// === impl Truth: control by tests and scenarios ===

impl Truth {
    pub(crate) fn set_temperature(
        &mut self,
        location: &str,
        celsius: f64,
    ) -> Result<(), LayoutError> {
        check_temperature(location, celsius)?;
        let Some(temperature) = self.temperatures.get_mut(location) else {
            return Err(self.unknown_location(location));
        };
        *temperature = celsius;
        self.log.record(BuildingEvent::TemperatureSet { location: location.to_owned(), celsius });
        Ok(())
    }

    pub(crate) fn break_device(
        &mut self,
        device: &str,
        fault: DeviceFault,
    ) -> Result<u64, LayoutError> {
        self.require_known(device)?;
        self.traps.remove(device);
        self.faults.insert(device.to_owned(), fault);
        Ok(self.log.record(BuildingEvent::Broken { device: device.to_owned(), fault }))
    }

    pub(crate) fn set_trap(&mut self, device: &str, fault: DeviceFault) -> Result<(), LayoutError> {
        self.require_known(device)?;
        self.traps.insert(device.to_owned(), fault);
        Ok(())
    }

    pub(crate) fn repair(&mut self, device: &str) -> Result<(), LayoutError> {
        self.require_known(device)?;
        self.traps.remove(device);
        if self.faults.remove(device).is_some() {
            self.log.record(BuildingEvent::Repaired { device: device.to_owned() });
        }
        Ok(())
    }

    pub(crate) fn set_locked(&mut self, a: &str, b: &str, lock: bool) -> Result<(), LayoutError> {
        for place in [a, b] {
            if self.layout.location(place).is_none() {
                return Err(self.unknown_location(place));
            }
        }
        if self.layout.meters(a, b).or(self.layout.meters(b, a)).is_none() {
            return Err(LayoutError::NoDoor { a: a.to_owned(), b: b.to_owned() });
        }
        let (a, b) = sides(a, b);
        let door = (a.clone(), b.clone());
        if lock && self.locked.insert(door.clone()) {
            self.log.record(BuildingEvent::Locked { a, b });
        } else if !lock && self.locked.remove(&door) {
            self.log.record(BuildingEvent::Unlocked { a, b });
        }
        Ok(())
    }

    pub(crate) fn add_device(&mut self, device: BuildingDevice) -> Result<(), LayoutError> {
        self.layout.add_device(device.clone())?;
        if let BuildingDevice::Robot { name, start, .. } = &device {
            self.robots.insert(name.clone(), start.clone());
        }
        if let BuildingDevice::Lift { name, landings } = &device {
            self.cabins.extend(landings.first().map(|landing| (name.clone(), landing.clone())));
        }
        self.store_parcels(&device);
        self.log.record(BuildingEvent::Added { device: device.name().to_owned() });
        Ok(())
    }

    pub(crate) fn remove_device(&mut self, device: &str) -> Result<(), LayoutError> {
        self.require_known(device)?;
        for name in self.layout.remove_device(device) {
            self.robots.remove(&name);
            self.cabins.remove(&name);
            self.charges.remove(&name);
            self.faults.remove(&name);
            self.aims.remove(&name);
            self.channels.remove(&name);
            self.shown.remove(&name);
            self.traps.remove(&name);
            self.errands.remove(&name);
            self.log.record(BuildingEvent::Removed { device: name });
        }
        Ok(())
    }
}

// === impl Truth: preconditions ===

impl Truth {
    /// Begins to use a device. Returns the delay that a fault of the device adds to this use.
    pub(crate) fn begin_use(&mut self, device: &str) -> Result<Duration, DeviceError> {
        self.require_device(device)?;
        self.spring_trap(device);
        self.require_unbroken(device)?;
        Ok(self.slowness(device))
    }

    pub(crate) fn spring_trap(&mut self, device: &str) {
        if let Some(fault) = self.traps.remove(device) {
            self.faults.insert(device.to_owned(), fault);
            self.log.record(BuildingEvent::Broken { device: device.to_owned(), fault });
        }
    }

    pub(crate) fn slowness(&self, device: &str) -> Duration {
        match self.fault_of(device) {
            Some(DeviceFault::Slow(longer)) => longer.min(SLOW_MAX),
            _ => Duration::ZERO,
        }
    }

    pub(crate) fn require_device(&self, device: &str) -> Result<&BuildingDevice, DeviceError> {
        self.layout.device(device).ok_or_else(|| DeviceError::UnknownDevice {
            device: device.to_owned(),
            nearest: self.layout.nearest_device(device),
        })
    }

    fn require_sensor(&self, device: &str) -> Result<(), DeviceError> {
        match self.require_device(device)? {
            BuildingDevice::FixedSensor { .. } | BuildingDevice::MountedSensor { .. } => Ok(()),
            other => Err(wrong_kind(other, "sensor")),
        }
    }

    /// Returns the robot's speed, in meters per second. Returns an error if the device is not a
    /// robot.
    pub(crate) fn require_robot(&self, device: &str) -> Result<f64, DeviceError> {
        match self.require_device(device)? {
            BuildingDevice::Robot { meters_per_second, .. } => Ok(*meters_per_second),
            other => Err(wrong_kind(other, "robot")),
        }
    }

    /// Returns an error if the device has failed or was removed. A device that hangs or is slow is
    /// no error.
    pub(crate) fn require_unbroken(&self, device: &str) -> Result<(), DeviceError> {
        self.require_device(device)?;
        match self.fault_of(device) {
            Some(DeviceFault::Fails) => Err(DeviceError::Broken { device: device.to_owned() }),
            Some(DeviceFault::Hangs | DeviceFault::Slow(_)) | None => Ok(()),
        }
    }

    /// Returns the location of the device.
    pub(crate) fn require_place(&self, device: &str) -> Result<String, DeviceError> {
        self.require_device(device)?;
        let place = self.place_of(device);
        Ok(place.expect("invariant: every device in the layout is somewhere").to_owned())
    }

    fn require_location(&self, location: &str) -> Result<(), DeviceError> {
        if self.layout.location(location).is_some() {
            return Ok(());
        }
        let nearest = self.layout.nearest_location(location);
        Err(DeviceError::UnknownLocation { location: location.to_owned(), nearest })
    }

    /// Returns the length of the way from `from` to its neighbor `to`, in meters. Returns an error
    /// if `to` is not a neighbor or the door is locked.
    fn require_way(&self, from: &str, to: &str) -> Result<f64, DeviceError> {
        let (from_name, to_name) = (from.to_owned(), to.to_owned());
        let Some(meters) = self.layout.meters(from, to) else {
            let ways = self.layout.neighbors(from).map(str::to_owned).collect();
            return Err(DeviceError::NoWay { from: from_name, to: to_name, ways });
        };
        if self.is_locked(from, to) {
            return Err(DeviceError::Locked { from: from_name, to: to_name });
        }
        Ok(meters)
    }

    pub(crate) fn require_known(&self, device: &str) -> Result<(), LayoutError> {
        if self.layout.device(device).is_some() {
            return Ok(());
        }
        let nearest = self.layout.nearest_device(device);
        Err(LayoutError::UnknownDevice { name: device.to_owned(), nearest })
    }

    pub(crate) fn unknown_location(&self, name: &str) -> LayoutError {
        let nearest = self.layout.nearest_location(name);
        LayoutError::UnknownLocation { name: name.to_owned(), nearest }
    }
}

pub(crate) fn wrong_kind(device: &BuildingDevice, wanted: &str) -> DeviceError {
    DeviceError::WrongKind {
        device: device.name().to_owned(),
        is: device.is().to_owned(),
        wanted: wanted.to_owned(),
    }
}
