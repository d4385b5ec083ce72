//! A camera that gives single frames, each with the direction of the camera. This module makes
//! pictures and videos of the frames, and finds motion by comparing them.
//!
//! Motion is a change of a large enough share of the picture between two frames of the same
//! direction.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use tokio::time::Instant;

use crate::PTZ;
use crate::driver::{Camera, FileContent, News, PartFile, RecordedFile, SharedKnown, Step, View};
use crate::frame::{Frame, y4m};
use crate::position::PtzPosition;

/// Pause between two frames of a camera that watches for motion. It is short, because a person
/// walking by is in the picture for only about a second.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);

/// Pause between two frames of a camera that does not watch for motion, or does not respond.
const LOOK_INTERVAL_IDLE: Duration = Duration::from_secs(5);

/// Time limit for turning, which is also that for taking a picture.
const ACTING_TIME_MAX: Duration = Duration::from_secs(15);

/// Number of pictures per second of a recording: enough to recognize a person.
const PER_SECOND: u32 = 5;

/// The source of single frames.
pub trait FrameSource: Send + Sync + 'static {
    /// Turns and zooms the camera. Error texts complete “failed to …”. Dropping the future stops
    /// the camera.
    fn aim(&self, aim: PtzPosition) -> BoxFuture<Result<(), String>>;

    /// Returns the present picture of the camera.
    fn frame(&self) -> BoxFuture<Result<Frame, String>>;
}

/// A camera that gives single frames.
#[derive(Clone)]
pub(crate) struct FrameCamera {
    source: Arc<dyn FrameSource>,
    presets: Arc<BTreeMap<String, PtzPosition>>,
    /// Share of the picture that must change to count as motion; `None` if the camera does not
    /// watch for motion.
    sensitivity: Option<f64>,
    /// The last picture, with which the next one is compared.
    last_frame: Arc<Mutex<Option<Frame>>>,
}

impl FrameCamera {
    pub(crate) fn new(
        source: Arc<dyn FrameSource>,
        presets: BTreeMap<String, PtzPosition>,
        sensitivity: Option<f64>,
    ) -> FrameCamera {
        let (presets, last_frame) = (Arc::new(presets), Arc::default());
        FrameCamera { source, presets, sensitivity, last_frame }
    }

    fn view(&self, aim: PtzPosition) -> View {
        let mut presets = self.presets.iter();
        let preset = presets.find(|(_, preset)| preset.is(&aim)).map(|(name, _)| name.clone());
        let PtzPosition { pan, tilt, zoom } = aim;
        let detail = format!("looks {pan:.0}° right, {tilt:.0}° up, zoom {zoom:.1}");
        View { preset, detail }
    }

    async fn turn(&self, aim: PtzPosition) -> Result<View, String> {
        self.source.aim(aim).await?;
        Ok(self.view(aim))
    }

    /// Returns the present frame of the camera. Returns an error if the camera does not look at the
    /// preset.
    async fn frame_of(&self, preset: &str) -> Result<Frame, String> {
        let aim = self.aim_of(preset)?;
        let frame = self.source.frame().await?;
        if frame.aim.is(&aim) {
            return Ok(frame);
        }
        Err(format!("see `{preset}`: the camera looks elsewhere"))
    }

    fn aim_of(&self, preset: &str) -> Result<PtzPosition, String> {
        let aim = self.presets.get(preset).copied();
        aim.ok_or_else(|| format!("find the preset `{preset}`"))
    }

    async fn next_news(self, known: SharedKnown) -> News {
        loop {
            // A camera that does not respond is detected at the next call of a method.
            let Ok(frame) = self.source.frame().await else {
                tokio::time::sleep(LOOK_INTERVAL_IDLE).await;
                continue;
            };
            let (preset, known) = (self.view(frame.aim).preset, known.get());
            let previous = lock(&self.last_frame).replace(frame.clone());
            let change = previous.map_or(0.0, |previous| frame.change_since(&previous));
            let has_motion = self.sensitivity.is_some_and(|sensitivity| change >= sensitivity);
            let is_news = has_motion && Instant::now() >= known.quiet_until;
            if is_news || preset != known.preset {
                return News { preset, has_motion: is_news, ..News::default() };
            }
            let pause = if self.sensitivity.is_some() { LOOK_INTERVAL } else { LOOK_INTERVAL_IDLE };
            tokio::time::sleep(pause).await;
        }
    }

    async fn film(self, preset: String, lasts: Duration) -> Result<RecordedFile, String> {
        let count = (lasts.as_secs_f64() * f64::from(PER_SECOND)).ceil() as usize;
        let mut tick = tokio::time::interval(Duration::from_secs_f64(1.0 / f64::from(PER_SECOND)));
        let mut frames = Vec::new();
        while frames.len() < count {
            tick.tick().await;
            frames.push(self.frame_of(&preset).await?);
        }
        let caption = format!("{} frames", frames.len());
        let content = FileContent::Made(Box::new(move || y4m(&frames, PER_SECOND)));
        Ok(RecordedFile { extension: "y4m", content, caption })
    }
}

impl Camera for FrameCamera {
    fn acting_time_max(&self) -> Duration {
        ACTING_TIME_MAX
    }

    fn look_at(&self, preset: &str) -> BoxFuture<Result<View, String>> {
        let (camera, aim) = (self.clone(), self.aim_of(preset));
        Box::pin(async move { camera.turn(aim?).await })
    }

    fn move_by(&self, step: Step) -> BoxFuture<Result<View, String>> {
        let camera = self.clone();
        Box::pin(async move {
            let now = camera.source.frame().await?.aim;
            let aim = PtzPosition {
                pan: (now.pan + step.pan).clamp(-PTZ.pan, PTZ.pan),
                tilt: (now.tilt + step.tilt).clamp(-PTZ.tilt, PTZ.tilt),
                zoom: (now.zoom * step.zoom).clamp(1.0, PTZ.zoom),
            };
            camera.turn(aim).await
        })
    }

    fn take_picture(&self, preset: &str) -> BoxFuture<Result<RecordedFile, String>> {
        let (camera, preset) = (self.clone(), preset.to_owned());
        Box::pin(async move {
            let frame = camera.frame_of(&preset).await?;
            let caption = frame.caption.clone();
            let content = FileContent::Made(Box::new(move || frame.ppm()));
            Ok(RecordedFile { extension: "ppm", content, caption })
        })
    }

    fn can_record(&self) -> bool {
        true
    }

    fn record(
        &self,
        preset: &str,
        lasts: Duration,
        _part: PartFile,
    ) -> BoxFuture<Result<RecordedFile, String>> {
        Box::pin(self.clone().film(preset.to_owned(), lasts))
    }

    fn notice(&self, known: SharedKnown) -> BoxFuture<News> {
        Box::pin(self.clone().next_news(known))
    }
}

fn lock(frame: &Mutex<Option<Frame>>) -> MutexGuard<'_, Option<Frame>> {
    frame.lock().unwrap_or_else(PoisonError::into_inner)
}
