//! The simulated driver: measures in the simulated building, whose truth the planner never sees.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;
use tokio::time::Instant;

use crate::{Measurement, Thermometer};

struct Simulated {
    building: Arc<BuildingHandle>,
    sensor: String,
}

pub(crate) fn thermometer(blueprint: &Blueprint) -> Result<Arc<dyn Thermometer>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, sensor: blueprint.id.to_string() }))
}

impl Thermometer for Simulated {
    fn measure(&self) -> BoxFuture<Result<Measurement, String>> {
        let (building, sensor) = (Arc::clone(&self.building), self.sensor.clone());
        Box::pin(async move {
            let reading = building.read_temperature(&sensor).await;
            let reading = reading.map_err(|error| error.to_string())?;
            Ok(Measurement { celsius: reading.celsius, at: Instant::now() })
        })
    }
}
