//! The simulated driver, which shows texts on the robot's screen in the simulated building.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::ScreenDriver;

struct Simulated {
    building: Arc<BuildingHandle>,
    screen: String,
}

/// Returns the screen of a simulated robot.
pub(crate) fn screen(blueprint: &Blueprint) -> Result<Arc<dyn ScreenDriver>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    // In the building, the screen is a device of its own that is mounted on the robot.
    Ok(Arc::new(Simulated { building, screen: format!("{}-screen", blueprint.id) }))
}

impl ScreenDriver for Simulated {
    fn show(&self, text: Option<&str>) -> BoxFuture<Result<(), String>> {
        let (building, screen) = (Arc::clone(&self.building), self.screen.clone());
        let text = text.map(str::to_owned);
        Box::pin(async move {
            building.show(&screen, text.as_deref()).await.map_err(|error| error.to_string())
        })
    }
}
