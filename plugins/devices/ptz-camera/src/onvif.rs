//! The ONVIF driver, for cameras of the network.
//!
//! - One task per camera connects, follows the direction and the motion events, and connects again
//!   after a failure. The driver compares the state that this task sees with the state that the
//!   agent knows.
//! - The driver turns the camera to presets that are stored in the camera, or to positions if the
//!   camera stores no presets.
//! - A camera that reports neither its position nor whether it moves counts as arrived after the
//!   time `settle`.

mod follower;
mod turning;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use onvif_link::{CameraAccess, CameraPreset, LinkError, OnvifCamera, Position};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::Instant;

use crate::driver::{Camera, FileContent, News, PartFile, RecordedFile, SharedKnown, Step, View};
use crate::recording;
use crate::seen::{Seen, first_connection, next_news};

/// Time limit for turning, which is also that for taking a picture: that of a whole turn of a slow
/// camera, and the requests for it.
const ACTING_TIME_MAX: Duration = Duration::from_secs(40);

/// Settings of the driver.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OnvifSettings {
    pub(crate) access: CameraAccess,
    /// Targets of the camera, by the names of presets in the config.
    pub(crate) targets: BTreeMap<String, Target>,
    /// Time after which a camera counts as arrived if it does not report whether it moves.
    pub(crate) settle: Duration,
    pub(crate) watches_motion: bool,
}

/// Target to which a camera turns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Target {
    /// The preset of this name in the camera.
    Preset(String),
    /// A position.
    Position(Position),
}

impl Target {
    /// Returns the stored preset with the name of this target, or else with that name as its token.
    /// Returns `None` if there is none, or if the target is a position.
    fn stored<'p>(&self, presets: &'p [CameraPreset]) -> Option<&'p CameraPreset> {
        let Target::Preset(name) = self else { return None };
        let by_name = presets.iter().find(|preset| preset.name.trim() == name);
        by_name.or_else(|| presets.iter().find(|preset| preset.token == *name))
    }
}

/// A camera of the network.
#[derive(Clone)]
struct OnvifDriver {
    shared: Arc<Shared>,
    /// The task that follows the camera; it starts at the first use, and ends with the driver.
    follower: Arc<Mutex<Option<FollowerTask>>>,
}

struct FollowerTask(JoinHandle<()>);

impl Drop for FollowerTask {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Data that the driver's methods and its follower share.
struct Shared {
    settings: OnvifSettings,
    /// The connection; `None` until it is made, and after it failed.
    link: tokio::sync::Mutex<Option<Arc<OnvifCamera>>>,
    seen: watch::Sender<Seen>,
    pose: Mutex<Pose>,
}

/// Knowledge about the direction of the camera.
#[derive(Clone, Debug, Default)]
struct Pose {
    /// Presets that were stored in the camera when they were last read.
    stored: Vec<CameraPreset>,
    /// Position of the camera at the present preset; `None` if it is unknown, or if the direction
    /// is not a preset.
    arrived_at: Option<Position>,
    is_turning: bool,
    /// End of the last movement.
    turned_at: Option<Instant>,
}

pub(crate) fn camera(settings: OnvifSettings) -> Arc<dyn Camera> {
    let shared = Shared {
        settings,
        link: tokio::sync::Mutex::new(None),
        seen: watch::Sender::default(),
        pose: Mutex::default(),
    };
    Arc::new(OnvifDriver { shared: Arc::new(shared), follower: Arc::default() })
}

impl OnvifDriver {
    /// Starts the task that follows the camera, if it does not run.
    fn follow(&self) {
        let mut follower = lock(&self.follower);
        if follower.is_none() {
            let shared = Arc::clone(&self.shared);
            *follower = Some(FollowerTask(tokio::spawn(follower::follow(shared))));
        }
    }
}

impl Shared {
    /// Returns the connection, and makes it if there is none.
    async fn camera(&self) -> Result<Arc<OnvifCamera>, LinkError> {
        let mut link = self.link.lock().await;
        if let Some(camera) = &*link {
            return Ok(Arc::clone(camera));
        }
        let camera = Arc::new(OnvifCamera::connect(&self.settings.access).await?);
        *link = Some(Arc::clone(&camera));
        Ok(camera)
    }

    /// Drops a connection that has failed, so that the next use makes a new one.
    async fn forget(&self) {
        *self.link.lock().await = None;
    }

    fn pose(&self) -> MutexGuard<'_, Pose> {
        lock(&self.pose)
    }

    /// Returns the name in the config of the preset at a position; `None` if there is none, or if
    /// there are several.
    fn preset_at(&self, position: Position) -> Option<String> {
        let pose = self.pose();
        let mut at = self.settings.targets.iter().filter(|(_, target)| {
            let expected = match target {
                Target::Position(position) => Some(*position),
                Target::Preset(_) => target.stored(&pose.stored).and_then(|stored| stored.position),
            };
            expected.is_some_and(|expected| expected.is(&position))
        });
        let only = at.next().map(|(name, _)| name.clone());
        only.filter(|_| at.next().is_none())
    }
}

impl Camera for OnvifDriver {
    fn connect(&self) -> Option<BoxFuture<()>> {
        let driver = self.clone();
        Some(Box::pin(async move {
            driver.follow();
            first_connection(driver.shared.seen.subscribe()).await;
        }))
    }

    fn acting_time_max(&self) -> Duration {
        ACTING_TIME_MAX
    }

    fn look_at(&self, preset: &str) -> BoxFuture<Result<View, String>> {
        let (shared, preset) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move { turning::look_at(&shared, preset).await.map_err(text) })
    }

    fn move_by(&self, step: Step) -> BoxFuture<Result<View, String>> {
        let shared = Arc::clone(&self.shared);
        Box::pin(async move { turning::move_by(&shared, step).await.map_err(text) })
    }

    fn take_picture(&self, preset: &str) -> BoxFuture<Result<RecordedFile, String>> {
        let (shared, preset) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move {
            turning::check_view(&shared, &preset).await?;
            let camera = shared.camera().await.map_err(text)?;
            let picture = camera.snapshot().await.map_err(text)?;
            // Somebody may have turned the camera meanwhile.
            turning::check_view(&shared, &preset).await?;
            let caption = format!("{} kB", picture.content.len().div_ceil(1_000));
            let content = FileContent::Made(Box::new(move || picture.content.to_vec()));
            Ok(RecordedFile { extension: picture.extension, content, caption })
        })
    }

    fn can_record(&self) -> bool {
        recording::is_possible()
    }

    fn record(
        &self,
        preset: &str,
        lasts: Duration,
        part: PartFile,
    ) -> BoxFuture<Result<RecordedFile, String>> {
        let (shared, preset) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move {
            turning::check_view(&shared, &preset).await?;
            let camera = shared.camera().await.map_err(text)?;
            let stream = camera.video_stream().await.map_err(text)?;
            let recorded = recording::record(&stream, lasts, part).await?;
            // Somebody may have turned the camera meanwhile.
            turning::check_view(&shared, &preset).await?;
            Ok(recorded)
        })
    }

    fn notice(&self, known: SharedKnown) -> BoxFuture<News> {
        let driver = self.clone();
        Box::pin(async move {
            driver.follow();
            let shared = &driver.shared;
            next_news(shared.seen.subscribe(), known, || shared.pose().is_turning).await
        })
    }
}

fn text(error: LinkError) -> String {
    error.to_string()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
