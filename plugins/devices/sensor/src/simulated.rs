//! The simulated driver, which measures in the simulated building. The planner has no access to the
//! building.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::{BuildingHandle, DeviceError};
use tokio::time::Instant;

use crate::{Measurement, Probe};

#[derive(Clone)]
struct Simulated {
    building: Arc<BuildingHandle>,
    sensor: String,
}

pub(crate) fn probe(blueprint: &Blueprint) -> Result<Arc<dyn Probe>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, sensor: blueprint.id.to_string() }))
}

impl Probe for Simulated {
    fn measure(&self, quantity: &'static str) -> BoxFuture<Result<Measurement, String>> {
        let Simulated { building, sensor } = self.clone();
        Box::pin(async move {
            if quantity == "temperature" {
                let reading = building.read_temperature(&sensor).await;
                return now(reading.map(|reading| reading.celsius));
            }
            let measured = building.measure(&sensor, simulated(quantity)?).await;
            now(measured.map(|measured| measured.value))
        })
    }

    fn notice(&self, quantity: &'static str, known: f64) -> BoxFuture<Result<Measurement, String>> {
        let Simulated { building, sensor } = self.clone();
        Box::pin(async move {
            let measured = building.await_change(&sensor, simulated(quantity)?, known).await;
            now(measured.map(|measured| measured.value))
        })
    }
}

/// Returns the quantity of the simulated building with this name.
fn simulated(quantity: &str) -> Result<building::Quantity, String> {
    let known = building::Quantity::named(quantity);
    known.ok_or_else(|| format!("find `{quantity}` in the simulated building"))
}

fn now(value: Result<f64, DeviceError>) -> Result<Measurement, String> {
    let value = value.map_err(|error| error.to_string())?;
    Ok(Measurement { value, at: Instant::now() })
}
