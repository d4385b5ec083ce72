//! The simulated driver, which uses a screen of the simulated building.

use std::sync::Arc;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use building::BuildingHandle;

use crate::{Content, Display, DisplayState};

#[derive(Clone)]
struct Simulated {
    building: Arc<BuildingHandle>,
    screen: String,
}

pub(crate) fn display(blueprint: &Blueprint) -> Result<Arc<dyn Display>, BuildError> {
    let building = blueprint.host.resources.get::<BuildingHandle>().ok_or_else(|| {
        blueprint.problem("a simulated driver needs a simulated building, and there is none")
    })?;
    Ok(Arc::new(Simulated { building, screen: blueprint.id.to_string() }))
}

impl Display for Simulated {
    fn allocate(&self) -> BoxFuture<Result<u32, String>> {
        let Simulated { building, screen } = self.clone();
        Box::pin(async move { building.allocate(&screen).await.map_err(|error| error.to_string()) })
    }

    fn show(&self, content: Option<&Content>) -> BoxFuture<Result<(), String>> {
        let Simulated { building, screen } = self.clone();
        let text = content.map(|content| content.written().to_owned());
        Box::pin(async move {
            building.show(&screen, text.as_deref()).await.map_err(|error| error.to_string())
        })
    }

    fn panel(&self) -> BoxFuture<Result<DisplayState, String>> {
        let Simulated { building, screen } = self.clone();
        Box::pin(async move {
            let panel = building.panel(&screen).await.map_err(|error| error.to_string())?;
            let building::ScreenState { channel, text } = panel;
            Ok(DisplayState { channel, shown: text })
        })
    }
}
