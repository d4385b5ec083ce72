//! The driver `v4l2`: a USB camera of this machine.
//!
//! - One `ffmpeg` reads the camera all the time (`capture`): only one program can. It gives small
//!   gray pictures, whose differences are motion, and whole pictures, of which the last one is kept.
//! - A camera with motors is turned by its controls (`controls`). A camera without motors has one
//!   preset, which it always looks at.

mod capture;
mod controls;
mod differences;
mod multipart;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use onvif_link::Position;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::Instant;

use crate::driver::{Camera, FileContent, News, PartFile, RecordedFile, SharedKnown, Step, View};
use crate::seen::{Seen, first_connection, next_news};
use controls::Controls;

/// Time limit for turning and for taking a picture: longer than the longest time to settle.
const ACTING_TIME_MAX: Duration = Duration::from_secs(40);

/// Time limit for the next whole picture.
const PICTURE_TIME_MAX: Duration = Duration::from_secs(5);

/// Length of a step by which a person turns the camera: a share of its range.
const STEP: f64 = 0.06;

/// Settings of the driver.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct V4l2Settings {
    /// File of the camera, such as `/dev/video0`.
    pub(crate) device: String,
    /// Arguments of `ffmpeg` for its input.
    pub(crate) input: Vec<String>,
    /// Positions of the presets: pan and tilt from -1 to 1, zoom from 0 to 1, as shares of the
    /// ranges of the motors. `None` for the only preset of a camera that is not turned.
    pub(crate) positions: BTreeMap<String, Option<Position>>,
    /// Share of the picture that must change to count as motion; `None` if the camera does not
    /// watch for motion.
    pub(crate) sensitivity: Option<f64>,
    /// Time after which the camera counts as arrived.
    pub(crate) settle: Duration,
}

impl V4l2Settings {
    /// Returns the arguments of `ffmpeg` for a device, with the size of its pictures if one is
    /// given.
    pub(crate) fn input_of(device: &str, size: Option<(u32, u32)>) -> Vec<String> {
        let size = size.map(|(width, height)| format!("{width}x{height}"));
        let size = size.iter().flat_map(|size| ["-video_size", size]);
        ["-f", "v4l2"].into_iter().chain(size).chain(["-i", device]).map(str::to_owned).collect()
    }

    /// Whether the camera is turned.
    fn can_turn(&self) -> bool {
        self.positions.values().any(Option::is_some)
    }
}

/// A USB camera.
#[derive(Clone)]
struct V4l2Driver {
    shared: Arc<Shared>,
    /// The task that reads the camera; it starts at the first use, and ends with the driver.
    capture: Arc<Mutex<Option<CaptureTask>>>,
}

struct CaptureTask(JoinHandle<()>);

impl Drop for CaptureTask {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Data that the driver's methods and its task share.
struct Shared {
    settings: V4l2Settings,
    seen: watch::Sender<Seen>,
    /// The last whole picture, with the time of its arrival.
    picture: watch::Sender<Option<(Instant, Arc<Vec<u8>>)>>,
    turns: Mutex<Turns>,
}

/// Movements of the camera.
#[derive(Debug, Default)]
struct Turns {
    is_turning: bool,
    /// Number of movements so far.
    count: usize,
}

pub(crate) fn camera(settings: V4l2Settings) -> Arc<dyn Camera> {
    Arc::new(V4l2Driver::new(settings))
}

/// A mark that the camera turns. The mark ends when this value is dropped.
struct Turning(Arc<Shared>);

impl Turning {
    fn begin(shared: &Arc<Shared>) -> Turning {
        let mut turns = lock(&shared.turns);
        (turns.is_turning, turns.count) = (true, turns.count + 1);
        drop(turns);
        shared.seen.send_modify(|seen| (seen.preset, seen.has_motion) = (None, false));
        Turning(Arc::clone(shared))
    }
}

impl Drop for Turning {
    fn drop(&mut self) {
        lock(&self.0.turns).is_turning = false;
    }
}

impl Shared {
    /// Reads the position of the camera from its controls. Takes over which presets it reaches, and
    /// at which it is. A camera that is not turned has no position.
    async fn look(&self) -> Result<(), String> {
        let before = lock(&self.turns).count;
        let (preset, missing) = if self.settings.can_turn() {
            let controls = Controls::read(&self.settings.device).await?;
            let positions = self.settings.positions.iter();
            let positions = positions.map(|(name, at)| (name, at.unwrap_or_default()));
            let missing: BTreeSet<String> = positions
                .clone()
                .filter(|(_, at)| !controls.reaches(*at))
                .map(|(name, _)| name.clone())
                .collect();
            if missing.len() == self.settings.positions.len() {
                return Err(format!(
                    "use the camera: {0} has no motors for any of its presets (v4l2-ctl -d {0} \
                     --list-ctrls shows its controls)",
                    self.settings.device
                ));
            }
            let at: Vec<_> =
                positions.filter(|(_, at)| controls.is_at(*at)).map(|(name, _)| name).collect();
            // Two presets may have one position; the one that the camera was turned to counts.
            let last = self.seen.borrow().preset.clone();
            let preset = last.filter(|last| at.contains(&last)).or(at.first().copied().cloned());
            (preset, missing)
        } else {
            (self.settings.positions.keys().next().cloned(), BTreeSet::new())
        };
        let turns = lock(&self.turns);
        if turns.is_turning || turns.count != before {
            return Ok(());
        }
        self.seen.send_if_modified(|seen| {
            let is_new = (&seen.preset, &seen.missing) != (&preset, &missing);
            (seen.preset, seen.missing) = (preset, missing);
            is_new
        });
        Ok(())
    }

    fn lose(&self, reason: String) {
        self.picture.send_modify(|picture| *picture = None);
        self.seen.send_modify(|seen| {
            (seen.is_tried, seen.problem) = (true, Some(reason));
            (seen.preset, seen.has_motion) = (None, false);
        });
    }

    /// Returns an error if the camera cannot be used.
    fn check(&self) -> Result<(), String> {
        self.seen.borrow().problem.clone().map_or(Ok(()), Err)
    }

    /// Returns an error if the camera does not look at a preset.
    async fn check_view(&self, name: &str) -> Result<(), String> {
        self.check()?;
        self.look().await?;
        match self.seen.borrow().preset.as_deref() == Some(name) {
            true => Ok(()),
            false => Err(format!("see `{name}`: the camera looks elsewhere")),
        }
    }

    /// Turns to a position, and waits until the camera has arrived.
    async fn turn(&self, to: Position) -> Result<Position, String> {
        self.check()?;
        let device = &self.settings.device;
        Controls::read(device).await?.turn(device, to).await?;
        tokio::time::sleep(self.settings.settle).await;
        let controls = Controls::read(device).await?;
        match controls.is_at(to) {
            true => Ok(controls.position()),
            false => Err(format!("turn {device}: its controls have other values than asked for")),
        }
    }
}

impl V4l2Driver {
    fn new(settings: V4l2Settings) -> V4l2Driver {
        let (seen, picture) = (watch::Sender::default(), watch::Sender::default());
        let shared = Shared { settings, seen, picture, turns: Mutex::default() };
        V4l2Driver { shared: Arc::new(shared), capture: Arc::default() }
    }

    /// Starts the task that reads the camera, if it does not run.
    fn follow(&self) {
        let mut capture = lock(&self.capture);
        if capture.is_none() {
            let shared = Arc::clone(&self.shared);
            *capture = Some(CaptureTask(tokio::spawn(capture::follow(shared))));
        }
    }
}

impl Camera for V4l2Driver {
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

    fn can_turn(&self) -> bool {
        self.shared.settings.can_turn()
    }

    fn look_at(&self, preset: &str) -> BoxFuture<Result<View, String>> {
        let (shared, name) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move {
            let Some(to) = shared.settings.positions.get(&name).copied() else {
                return Err(format!("find the preset `{name}`"));
            };
            let Some(to) = to else {
                let detail = "looks there always".to_owned();
                return Ok(View { preset: Some(name), detail });
            };
            let turning = Turning::begin(&shared);
            let Position { pan, tilt, zoom } = shared.turn(to).await?;
            shared.seen.send_modify(|seen| seen.preset = Some(name.clone()));
            drop(turning);
            let detail = format!("looks at `{name}`: pan {pan:.2}, tilt {tilt:.2}, zoom {zoom:.2}");
            Ok(View { preset: Some(name), detail })
        })
    }

    fn move_by(&self, step: Step) -> BoxFuture<Result<View, String>> {
        let shared = Arc::clone(&self.shared);
        Box::pin(async move {
            let now = Controls::read(&shared.settings.device).await?.position();
            let sign = |value: f64| if value == 0.0 { 0.0 } else { value.signum() };
            let to = Position {
                pan: (now.pan + sign(step.pan) * STEP).clamp(-1.0, 1.0),
                tilt: (now.tilt + sign(step.tilt) * STEP).clamp(-1.0, 1.0),
                zoom: (now.zoom + sign(step.zoom - 1.0) * STEP).clamp(0.0, 1.0),
            };
            let turning = Turning::begin(&shared);
            shared.turn(to).await?;
            drop(turning);
            Ok(View { preset: None, detail: "turned by a step".to_owned() })
        })
    }

    fn take_picture(&self, preset: &str) -> BoxFuture<Result<RecordedFile, String>> {
        let (shared, preset) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move {
            shared.check_view(&preset).await?;
            let began = Instant::now();
            let mut pictures = shared.picture.subscribe();
            // A picture that was taken before may show what was there before a turn.
            let picture = {
                let newer = pictures.wait_for(|picture| {
                    picture.as_ref().is_some_and(|(arrived, _)| *arrived > began)
                });
                match tokio::time::timeout(PICTURE_TIME_MAX, newer).await {
                    Ok(Ok(picture)) => picture.as_ref().map(|(_, picture)| Arc::clone(picture)),
                    _ => None,
                }
            };
            let picture = picture.ok_or_else(|| {
                format!("get a picture of {} within {PICTURE_TIME_MAX:?}", shared.settings.device)
            })?;
            shared.check()?;
            // Somebody may have turned the camera meanwhile.
            shared.check_view(&preset).await?;
            let caption = format!("{} kB", picture.len().div_ceil(1_000));
            let content = FileContent::Made(Box::new(move || picture.to_vec()));
            Ok(RecordedFile { extension: "jpg", content, caption })
        })
    }

    fn can_record(&self) -> bool {
        false
    }

    fn record(
        &self,
        _preset: &str,
        _lasts: Duration,
        _part: PartFile,
    ) -> BoxFuture<Result<RecordedFile, String>> {
        let problem = "record a video: the driver `v4l2` takes pictures only";
        Box::pin(std::future::ready(Err(problem.to_owned())))
    }

    fn notice(&self, known: SharedKnown) -> BoxFuture<News> {
        let driver = self.clone();
        Box::pin(async move {
            driver.follow();
            let shared = &driver.shared;
            let is_turning = || lock(&shared.turns).is_turning;
            next_news(shared.seen.subscribe(), known, is_turning).await
        })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
