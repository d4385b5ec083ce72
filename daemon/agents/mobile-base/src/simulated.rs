//! The simulated driver, which moves a robot in the simulated building, at the robot's speed and
//! within the range of its battery.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::{BaseDriver, BasePlace, BaseReading, DriveFailure};

#[derive(Clone)]
struct Simulated {
    building: Arc<BuildingHandle>,
    robot: String,
}

pub(crate) fn base(blueprint: &Blueprint) -> Result<Arc<dyn BaseDriver>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, robot: blueprint.id.to_string() }))
}

impl BaseDriver for Simulated {
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), DriveFailure>> {
        let (Simulated { building, robot }, place) = (self.clone(), place.to_owned());
        Box::pin(async move {
            let moved = building.navigate(&robot, &place).await;
            moved.map_err(|error| DriveFailure::Other(error.to_string()))
        })
    }

    fn recharge(&self) -> BoxFuture<Result<(), String>> {
        let Simulated { building, robot } = self.clone();
        Box::pin(async move { building.recharge(&robot).await.map_err(|error| error.to_string()) })
    }

    fn read(&self) -> BoxFuture<Result<BaseReading, String>> {
        let Simulated { building, robot } = self.clone();
        Box::pin(async move {
            let place = building.place_of(&robot).await.map_err(|error| error.to_string())?;
            let charge = building.charge_of(&robot).await.map_err(|error| error.to_string())?;
            Ok(BaseReading { place: BasePlace::At(place), charge })
        })
    }
}
