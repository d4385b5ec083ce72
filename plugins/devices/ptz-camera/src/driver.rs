//! The trait of drivers: the actions of a camera, by the names of presets.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use tokio::time::Instant;

pub use crate::album::PartFile;

/// The driver of a camera. Error texts complete “failed to …”.
pub trait Camera: Send + Sync + 'static {
    /// Returns a future that connects to the camera, so that its state is known; `None` if the
    /// state needs no connection. The future ends within a bounded time.
    fn connect(&self) -> Option<BoxFuture<()>> {
        None
    }

    /// Returns the time limit for turning, which is also that for taking a picture.
    fn acting_time_max(&self) -> Duration;

    /// Whether the camera can be turned. A camera that cannot looks at its only preset.
    fn can_turn(&self) -> bool {
        true
    }

    /// Turns the camera to the preset with this name in the config. Dropping the future stops the
    /// camera.
    fn look_at(&self, preset: &str) -> BoxFuture<Result<View, String>>;

    /// Turns and zooms the camera by a step, within its limits. Dropping the future stops the
    /// camera.
    fn move_by(&self, step: Step) -> BoxFuture<Result<View, String>>;

    /// Takes a picture. Returns an error if the camera does not look at the preset.
    fn take_picture(&self, preset: &str) -> BoxFuture<Result<RecordedFile, String>>;

    /// Whether the camera can record videos.
    fn can_record(&self) -> bool;

    /// Records a video of a length. Returns an error if the camera does not look at the preset, or
    /// the video is not complete. A driver that does not make the video in memory writes it into
    /// `part`. Dropping the future ends the recording.
    fn record(
        &self,
        preset: &str,
        lasts: Duration,
        part: PartFile,
    ) -> BoxFuture<Result<RecordedFile, String>>;

    /// Waits until the state of the camera differs from `known`, or there is motion.
    fn notice(&self, known: SharedKnown) -> BoxFuture<News>;
}

/// The direction of a camera after a turn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct View {
    /// Name of the preset in the config; `None` if the direction is not a preset, or is unknown.
    pub preset: Option<String>,
    /// Description of the direction for a person.
    pub detail: String,
}

/// A step by which a person turns a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Step to the right, in degrees; negative to the left.
    pub pan: f64,
    /// Step up, in degrees; negative down.
    pub tilt: f64,
    /// Factor by which the magnification changes.
    pub zoom: f64,
}

/// A picture or a video of a camera.
pub struct RecordedFile {
    /// Extension of the file.
    pub extension: &'static str,
    /// Content of the file.
    pub content: FileContent,
    /// Description of the content for a person, in one line.
    pub caption: String,
}

/// The content of a picture or a video.
pub enum FileContent {
    /// Function that returns the content. Called on a thread for blocking work.
    Made(Box<dyn FnOnce() -> Vec<u8> + Send>),
    /// A file that is complete.
    Written(PartFile),
}

/// The known state of a camera.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// Preset that the camera looks at; `None` if its direction is not a preset, or is unknown.
    pub preset: Option<String>,
    /// Time until which motion in the present place is not announced again.
    pub quiet_until: Instant,
    /// Reason why the camera cannot be used; `None` if it can.
    pub problem: Option<String>,
    /// Presets of the config that the camera does not have.
    pub missing: BTreeSet<String>,
}

/// The known state of a camera, which the driver reads while it waits for news.
#[derive(Clone, Debug)]
pub struct SharedKnown(Arc<Mutex<Known>>);

impl SharedKnown {
    /// Returns the state at the start: nothing is known.
    pub fn new() -> SharedKnown {
        SharedKnown(Arc::new(Mutex::new(Known {
            preset: None,
            quiet_until: Instant::now(),
            problem: None,
            missing: BTreeSet::new(),
        })))
    }

    /// Returns the state that is known at present.
    pub fn get(&self) -> Known {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the known state.
    pub fn set(&self, known: Known) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = known;
    }
}

impl Default for SharedKnown {
    fn default() -> SharedKnown {
        SharedKnown::new()
    }
}

/// News of a camera: its state, because it differs from the known one or because there is motion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct News {
    /// Preset that the camera looks at; `None` if its direction is not a preset, or is unknown.
    pub preset: Option<String>,
    /// Whether there is motion in the picture.
    pub has_motion: bool,
    /// Reason why the camera cannot be used; `None` if it can.
    pub problem: Option<String>,
    /// Presets of the config that the camera does not have.
    pub missing: BTreeSet<String>,
}
