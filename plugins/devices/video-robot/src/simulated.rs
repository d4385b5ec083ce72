//! The simulated driver, which moves the robot in the simulated building, and shows texts on the
//! robot's screen there.

use std::sync::Arc;

use actuator::{BaseDriver, BoxFuture};
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::ScreenDriver;

#[derive(Clone)]
struct Simulated {
    building: Arc<BuildingHandle>,
    robot: String,
}

/// The drivers of the mobile base and of the robot's screen.
type VideoDrivers = (Arc<dyn BaseDriver>, Arc<dyn ScreenDriver>);

/// Returns the drivers of a simulated robot.
pub(crate) fn robot(blueprint: &Blueprint) -> Result<VideoDrivers, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    let robot = Simulated { building, robot: blueprint.id.to_string() };
    Ok((Arc::new(robot.clone()), Arc::new(robot)))
}

impl BaseDriver for Simulated {
    fn navigate_to(&self, place: &str) -> BoxFuture<Result<(), String>> {
        let (Simulated { building, robot }, place) = (self.clone(), place.to_owned());
        Box::pin(async move {
            building.navigate(&robot, &place).await.map_err(|error| error.to_string())
        })
    }

    fn recharge(&self) -> BoxFuture<Result<(), String>> {
        let Simulated { building, robot } = self.clone();
        Box::pin(async move { building.recharge(&robot).await.map_err(|error| error.to_string()) })
    }

    fn place(&self) -> BoxFuture<Result<String, String>> {
        let Simulated { building, robot } = self.clone();
        Box::pin(async move { building.place_of(&robot).await.map_err(|error| error.to_string()) })
    }

    fn charge(&self) -> BoxFuture<Result<Option<f64>, String>> {
        let Simulated { building, robot } = self.clone();
        Box::pin(async move { building.charge_of(&robot).await.map_err(|error| error.to_string()) })
    }
}

impl ScreenDriver for Simulated {
    fn show(&self, text: Option<&str>) -> BoxFuture<Result<(), String>> {
        let (Simulated { building, robot }, text) = (self.clone(), text.map(str::to_owned));
        // In the building, the screen is a device of its own that is mounted on the robot.
        let screen = format!("{robot}-screen");
        Box::pin(async move {
            building.show(&screen, text.as_deref()).await.map_err(|error| error.to_string())
        })
    }
}
