//! The simulated driver, which measures in the simulated building, at the true location of the
//! base.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;
use tokio::time::Instant;

use crate::{InfraredThermometer, IrMeasurement};

struct Simulated {
    building: Arc<BuildingHandle>,
    sensor: String,
}

pub(crate) fn thermometer(
    blueprint: &Blueprint,
) -> Result<Arc<dyn InfraredThermometer>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, sensor: blueprint.id.to_string() }))
}

impl InfraredThermometer for Simulated {
    fn measure(&self) -> BoxFuture<Result<IrMeasurement, String>> {
        let (building, sensor) = (Arc::clone(&self.building), self.sensor.clone());
        Box::pin(async move {
            let reading = building.read_temperature(&sensor).await;
            let reading = reading.map_err(|error| error.to_string())?;
            let at = Instant::now();
            Ok(IrMeasurement { location: reading.location, celsius: reading.celsius, at })
        })
    }
}
