//! The simulated driver: sweeps in the simulated building.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::Broom;

struct Simulated {
    building: Arc<BuildingHandle>,
    robot: String,
}

/// Returns the broom of a simulated robot.
pub(crate) fn broom(blueprint: &Blueprint) -> Result<Arc<dyn Broom>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, robot: blueprint.id.to_string() }))
}

impl Broom for Simulated {
    fn places(&self) -> Option<Vec<String>> {
        None
    }

    fn sweep(&self, _place: &str) -> BoxFuture<Result<String, String>> {
        let (building, robot) = (Arc::clone(&self.building), self.robot.clone());
        Box::pin(async move { building.sweep(&robot).await.map_err(|error| error.to_string()) })
    }
}
