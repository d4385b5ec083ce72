//! The simulated driver: moves in the simulated building, as fast and as far as that lets it.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::MobileBase;

struct Simulated {
    building: Arc<BuildingHandle>,
    robot: String,
}

pub(crate) fn base(blueprint: &Blueprint) -> Result<Arc<dyn MobileBase>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, robot: blueprint.id.to_string() }))
}

impl MobileBase for Simulated {
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), String>> {
        let (building, robot) = (Arc::clone(&self.building), self.robot.clone());
        let place = place.to_owned();
        Box::pin(async move {
            building.navigate(&robot, &place).await.map_err(|error| error.to_string())
        })
    }

    fn place(&self) -> BoxFuture<Result<String, String>> {
        let (building, robot) = (Arc::clone(&self.building), self.robot.clone());
        Box::pin(async move { building.place_of(&robot).await.map_err(|error| error.to_string()) })
    }
}
