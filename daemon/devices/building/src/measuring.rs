//! Quantities other than temperature: their true values, how tests set the values, and how sensors
//! measure them.
//!
//! As with temperature, a driver can access only the values at the true location of its sensor. A
//! driver awaits a change, such as motion, with [`Building::await_change`], which returns at the
//! moment of the change, without the duration of a measurement.

use std::time::Duration;

use crate::building::Building;
use crate::driver_requests::{DriverAnswer, DriverRequest, MeasuredValue};
use crate::error::{DeviceError, LayoutError};
use crate::handle::{BuildingAccess, BuildingHandle};
use crate::layout::BuildingDevice;
use crate::quantity::Quantity;
use crate::truth::{BuildingEvent, DeviceFault, Truth};
use crate::world::MEASURING;

// === impl Building ===

impl Building {
    /// Measures a quantity at the true location of the sensor.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device, if it does not measure the quantity, or if it
    /// is broken.
    pub async fn measure(
        &self,
        sensor: &str,
        quantity: Quantity,
    ) -> Result<MeasuredValue, DeviceError> {
        let takes = self.change(|truth| truth.begin_measuring(sensor, quantity))?;
        self.work(sensor, takes, |truth| truth.finish_measuring(sensor, quantity)).await
    }

    /// Waits until the quantity at the true location of the sensor differs from `known`, and
    /// measures it.
    ///
    /// The wait lasts while the value does not change or the sensor hangs, possibly forever. The
    /// caller sets a deadline and drops the future.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such device, if it does not measure the quantity, or if it
    /// is broken or breaks during the wait.
    pub async fn await_change(
        &self,
        sensor: &str,
        quantity: Quantity,
        known: f64,
    ) -> Result<MeasuredValue, DeviceError> {
        let mut truth = self.subscribe();
        truth.borrow().require_measuring(sensor, quantity)?;
        loop {
            let noticed = {
                let now = truth.borrow_and_update();
                now.require_unbroken(sensor)?;
                let hangs = now.fault_of(sensor) == Some(DeviceFault::Hangs);
                !hangs && now.measurable(sensor, quantity)?.value != known
            };
            if noticed {
                return self.change(|truth| truth.finish_measuring(sensor, quantity));
            }
            truth.changed().await.expect("invariant: `self` holds the sender");
        }
    }

    /// Sets the true value of a quantity in a location, and wakes the callers that wait for its
    /// change.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such location, or if the value is out of the range of the
    /// quantity.
    pub fn set(&self, location: &str, quantity: Quantity, value: f64) -> Result<(), LayoutError> {
        self.change(|truth| truth.set(location, quantity, value))
    }
}

// === impl Truth ===

impl Truth {
    /// Returns the true value of a quantity in a location. If no value was set, returns the usual
    /// value of the quantity. Returns `None` if there is no such location.
    pub fn value(&self, location: &str, quantity: Quantity) -> Option<f64> {
        self.layout.location(location)?;
        let said = self.conditions.get(&quantity).and_then(|places| places.get(location));
        Some(said.copied().unwrap_or(quantity.usual()))
    }

    fn set(&mut self, location: &str, quantity: Quantity, value: f64) -> Result<(), LayoutError> {
        if self.layout.location(location).is_none() {
            let nearest = self.layout.nearest_location(location);
            return Err(LayoutError::UnknownLocation { name: location.to_owned(), nearest });
        }
        let (min, max) = quantity.bounds();
        let location = location.to_owned();
        if !(min..=max).contains(&value) {
            return Err(LayoutError::BadValue { location, quantity, value });
        }
        self.conditions.entry(quantity).or_default().insert(location.clone(), value);
        self.log.record(BuildingEvent::ValueSet { location, quantity, value });
        Ok(())
    }

    /// Begins a measurement. Returns the duration of the measurement.
    fn begin_measuring(
        &mut self,
        sensor: &str,
        quantity: Quantity,
    ) -> Result<Duration, DeviceError> {
        self.require_measuring(sensor, quantity)?;
        self.log.record(BuildingEvent::Asked { sensor: sensor.to_owned() });
        self.spring_trap(sensor);
        self.require_unbroken(sensor)?;
        Ok(MEASURING + self.slowness(sensor))
    }

    fn finish_measuring(
        &mut self,
        sensor: &str,
        quantity: Quantity,
    ) -> Result<MeasuredValue, DeviceError> {
        self.require_unbroken(sensor)?;
        let measured = self.measurable(sensor, quantity)?;
        let MeasuredValue { location, value, .. } = measured.clone();
        self.log.record(BuildingEvent::Measured {
            sensor: sensor.to_owned(),
            location,
            quantity,
            value,
        });
        Ok(measured)
    }

    /// Returns the true value that the sensor would measure at this moment.
    fn measurable(&self, sensor: &str, quantity: Quantity) -> Result<MeasuredValue, DeviceError> {
        let location = self.require_place(sensor)?;
        let value = self
            .value(&location, quantity)
            .expect("invariant: a device is at a location, and each location has all quantities");
        Ok(MeasuredValue { location, quantity, value })
    }

    /// Returns an error unless the device `sensor` measures this quantity.
    fn require_measuring(&self, sensor: &str, quantity: Quantity) -> Result<(), DeviceError> {
        match self.require_device(sensor)? {
            BuildingDevice::Sensor { quantity: own, .. } if *own == quantity => Ok(()),
            // The fixed thermometers have a hygrometer on the same board.
            BuildingDevice::FixedSensor { .. } if quantity == Quantity::Humidity => Ok(()),
            other => Err(DeviceError::WrongKind {
                device: sensor.to_owned(),
                is: other.is().to_owned(),
                wanted: format!("{} sensor", quantity.name()),
            }),
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Measures a quantity at the true location of the sensor; see [`Building::measure`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::measure`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn measure(
        &self,
        sensor: &str,
        quantity: Quantity,
    ) -> Result<MeasuredValue, DeviceError> {
        match &self.access {
            BuildingAccess::InProcess(building) => building.measure(sensor, quantity).await,
            BuildingAccess::Socket(remote) => measured(
                remote.ask(DriverRequest::Measure { sensor: sensor.to_owned(), quantity }).await?,
            ),
        }
    }

    /// Waits until the quantity at the true location of the sensor differs from `known`, and
    /// measures it; see [`Building::await_change`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::await_change`], and if the server of the
    /// building cannot be reached or refuses the request.
    pub async fn await_change(
        &self,
        sensor: &str,
        quantity: Quantity,
        known: f64,
    ) -> Result<MeasuredValue, DeviceError> {
        match &self.access {
            BuildingAccess::InProcess(building) => {
                building.await_change(sensor, quantity, known).await
            }
            BuildingAccess::Socket(remote) => {
                let ask = DriverRequest::AwaitChange { sensor: sensor.to_owned(), quantity, known };
                measured(remote.ask(ask).await?)
            }
        }
    }
}

fn measured(answer: DriverAnswer) -> Result<MeasuredValue, DeviceError> {
    match answer {
        DriverAnswer::Measured(measured) => Ok(measured),
        other => Err(other.unexpected()),
    }
}

#[cfg(test)]
mod tests;
