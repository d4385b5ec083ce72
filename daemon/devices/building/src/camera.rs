//! Cameras that turn: the aim of each camera, and the places, people and robots that it sees.
//!
//! The layout gives the direction of each place from the camera. A camera sees a place if the
//! middle of the place is within the field of view. Names for directions (presets) belong to the
//! agents, not to the building.

use std::time::Duration;

use crate::building::Building;
use crate::camera_aim::CameraAim;
use crate::driver_requests::{
    CameraAnswer, CameraAsk, CameraView, DriverAnswer, DriverRequest, SeenPlace,
};
use crate::error::{DeviceError, LayoutError};
use crate::handle::BuildingHandle;
use crate::layout::{BuildingDevice, Layout, PlaceDirection};
use crate::truth::{BuildingEvent, Truth};

/// Turning speed, in degrees per second.
const TURNING: f64 = 90.0;

/// Maximum number of views of one camera, and of people and of robots that it reports per place. A
/// layout with more views is invalid, and further people and robots are left out. With these
/// bounds, an answer fits into one line on the socket.
const VIEWS_MAX: usize = 16;
const SEEN_MAX: usize = 8;

// === impl Layout ===

impl Layout {
    /// Adds a camera that is mounted in `location` and can see the places of `views`.
    ///
    /// # Errors
    ///
    /// Returns an error if the name is invalid or taken, if there is no such location, or if a view
    /// is not possible.
    pub fn add_camera(
        &mut self,
        name: &str,
        location: &str,
        views: Vec<PlaceDirection>,
    ) -> Result<&mut Layout, LayoutError> {
        let (name, location) = (name.to_owned(), location.to_owned());
        self.add_device(BuildingDevice::Camera { name, location, views })
    }

    pub(crate) fn check_views(
        &self,
        camera: &str,
        views: &[PlaceDirection],
    ) -> Result<(), LayoutError> {
        for PlaceDirection { location, pan, tilt } in views {
            self.check_location(location)?;
            let aim = CameraAim { pan: *pan, tilt: *tilt, zoom: 1.0 };
            if views.len() > VIEWS_MAX || !aim.is_possible() {
                return Err(LayoutError::BadView { camera: camera.to_owned() });
            }
        }
        Ok(())
    }
}

// === impl Truth ===

impl Truth {
    /// Returns the aim of a camera; `None` if there is no such camera. A camera that was never
    /// turned has the default aim.
    pub fn aim_of(&self, camera: &str) -> Option<CameraAim> {
        matches!(self.layout.device(camera)?, BuildingDevice::Camera { .. })
            .then(|| self.aims.get(camera).copied().unwrap_or_default())
    }

    /// Returns the places in a camera's field of view; none if there is no such camera.
    pub fn seen_by(&self, camera: &str) -> Vec<&str> {
        let (Some(BuildingDevice::Camera { views, .. }), Some(aim)) =
            (self.layout.device(camera), self.aim_of(camera))
        else {
            return Vec::new();
        };
        views.iter().filter(|view| aim.sees(view).is_some()).map(|v| v.location.as_str()).collect()
    }

    fn begin_aiming(&mut self, camera: &str, aim: CameraAim) -> Result<Duration, DeviceError> {
        let before = self.require_camera(camera)?;
        let slowness = self.begin_use(camera)?;
        if !aim.is_possible() {
            return Err(DeviceError::OutOfReach { device: camera.to_owned() });
        }
        let degrees = (aim.pan - before.pan).abs().max((aim.tilt - before.tilt).abs());
        Ok(Duration::from_secs_f64(degrees / TURNING) + slowness)
    }

    fn finish_aiming(&mut self, camera: &str, aim: CameraAim) -> Result<(), DeviceError> {
        self.require_unbroken(camera)?;
        self.aims.insert(camera.to_owned(), aim);
        self.log.record(BuildingEvent::Aimed { camera: camera.to_owned(), aim });
        Ok(())
    }

    fn sight(&self, camera: &str) -> Result<CameraView, DeviceError> {
        self.require_unbroken(camera)?;
        let aim = self.require_camera(camera)?;
        let Some(BuildingDevice::Camera { views, .. }) = self.layout.device(camera) else {
            return Ok(CameraView { aim, places: Vec::new(), at: self.log.now });
        };
        let place = |view: &PlaceDirection| {
            let (right, up) = aim.sees(view)?;
            let location = view.location.as_str();
            let here = |(robot, at): (&String, &String)| (at == location).then(|| robot.clone());
            Some(SeenPlace {
                location: location.to_owned(),
                right,
                up,
                people: self.people_in(location).take(SEEN_MAX).map(str::to_owned).collect(),
                robots: self.robots.iter().filter_map(here).take(SEEN_MAX).collect(),
                stirs: self.has_motion(location),
            })
        };
        let mut places: Vec<SeenPlace> = Vec::new();
        for seen in views.iter().filter_map(place) {
            // Two views may show the same place; it is reported once.
            if places.iter().all(|other| other.location != seen.location) {
                places.push(seen);
            }
        }
        Ok(CameraView { aim, places, at: self.log.now })
    }

    /// Returns the aim of the camera `device`; an error if the device is not a camera.
    fn require_camera(&self, device: &str) -> Result<CameraAim, DeviceError> {
        let found = self.require_device(device)?;
        self.aim_of(device).ok_or_else(|| crate::world::wrong_kind(found, "camera"))
    }
}

// === impl Building ===

impl Building {
    /// Turns a camera to `aim`. The duration follows from the camera's turning speed.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such camera, if it is broken, or if the aim is beyond the
    /// limits of a camera.
    pub async fn aim(&self, camera: &str, aim: CameraAim) -> Result<(), DeviceError> {
        let takes = self.change(|truth| truth.begin_aiming(camera, aim))?;
        self.work(camera, takes, |truth| truth.finish_aiming(camera, aim)).await
    }

    /// Returns the places, people and robots that a camera sees now.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such camera, or if it is broken.
    pub async fn look(&self, camera: &str) -> Result<CameraView, DeviceError> {
        let takes = self.change(|truth| truth.begin_use(camera))?;
        self.work(camera, takes, |truth| truth.sight(camera)).await
    }

    async fn camera(&self, ask: CameraAsk) -> Result<CameraAnswer, DeviceError> {
        match ask {
            CameraAsk::Aim { camera, aim } => {
                self.aim(&camera, aim).await.map(|()| CameraAnswer::Aimed)
            }
            CameraAsk::Look { camera } => self.look(&camera).await.map(CameraAnswer::Sight),
        }
    }
}

// === impl BuildingHandle ===

impl BuildingHandle {
    /// Turns a camera; see [`Building::aim`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::aim`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn aim(&self, camera: &str, aim: CameraAim) -> Result<(), DeviceError> {
        match self.camera(CameraAsk::Aim { camera: camera.to_owned(), aim }).await? {
            CameraAnswer::Aimed => Ok(()),
            other => Err(DriverAnswer::Camera(other).unexpected()),
        }
    }

    /// Returns the places, people and robots that a camera sees now; see [`Building::look`].
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`Building::look`], and if the server of the building
    /// cannot be reached or refuses the request.
    pub async fn look(&self, camera: &str) -> Result<CameraView, DeviceError> {
        match self.camera(CameraAsk::Look { camera: camera.to_owned() }).await? {
            CameraAnswer::Sight(sight) => Ok(sight),
            other => Err(DriverAnswer::Camera(other).unexpected()),
        }
    }

    pub(crate) async fn camera(&self, ask: CameraAsk) -> Result<CameraAnswer, DeviceError> {
        match self.local() {
            Ok(building) => building.camera(ask).await,
            Err(remote) => match remote.ask(DriverRequest::Camera(ask)).await? {
                DriverAnswer::Camera(answer) => Ok(answer),
                other => Err(other.unexpected()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::time::Instant;

    use super::{CameraAim, PlaceDirection};
    use crate::{Building, Layout};

    fn view(location: &str, pan: f64) -> PlaceDirection {
        PlaceDirection { location: location.to_owned(), pan, tilt: 0.0 }
    }

    fn watched_office() -> Building {
        let mut layout = Layout::seeded(0).layout;
        let views = vec![view("corridor", 0.0), view("office1", 90.0)];
        layout.add_camera("camera-1", "corridor", views).unwrap();
        Building::new(layout, 1.0).unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn a_camera_sees_the_people_and_robots_in_its_view() {
        let building = watched_office();
        building.enter("alice", "corridor").unwrap();
        building.enter("bob", "office1").unwrap();
        let sight = building.look("camera-1").await.unwrap();
        assert_eq!(sight.places.len(), 1);
        let corridor = &sight.places[0];
        assert_eq!(corridor.people, ["alice"]);
        assert_eq!(corridor.robots, ["turtlebot-1"]);
        let began = Instant::now();
        let aim = CameraAim { pan: 80.0, tilt: 5.0, zoom: 2.0 };
        building.aim("camera-1", aim).await.unwrap();
        assert!(began.elapsed() > Duration::from_millis(880), "it turns 90 degrees a second");
        assert_eq!(building.truth().seen_by("camera-1"), ["office1"]);
        let sight = building.look("camera-1").await.unwrap();
        assert_eq!(sight.places[0].people, ["bob"]);
        assert!(sight.places[0].right > 0.6, "{sight:?}");
        building.leave("bob");
        assert!(building.look("camera-1").await.unwrap().places[0].people.is_empty());
    }

    #[tokio::test(start_paused = true)]
    async fn a_camera_refuses_an_aim_beyond_its_limits() {
        let building = watched_office();
        let aim = CameraAim { pan: 171.0, ..CameraAim::default() };
        assert!(building.aim("camera-1", aim).await.is_err());
        assert!(building.aim("turtlebot-1", CameraAim::default()).await.is_err());
        assert_eq!(building.truth().aim_of("camera-1"), Some(CameraAim::default()));
    }
}
