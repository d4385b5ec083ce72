//! The driver `motion`: the paper's detector, the program Motion, which watches a camera without
//! motors.
//!
//! - Motion runs under this process (`source`), or by itself (`address`, `events`). It is a process
//!   of its own in both cases.
//! - Its hooks write the begin and the end of motion into a named pipe (`events`). Questions about
//!   the camera, and requests for pictures, are HTTP.
//! - Videos are copied from the camera itself, if it has an RTSP address.

mod config_file;
mod events;
mod follower;

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use actuator::BoxFuture;
use onvif_link::{CameraAccess, CameraPicture, PictureServer, StreamAccess};
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::Instant;

pub(crate) use config_file::check_option;

use crate::driver::{Camera, FileContent, News, PartFile, RecordedFile, SharedKnown, Step, View};
use crate::recording;
use crate::seen::{Seen, first_connection, next_news};

/// Time limit for a picture.
const ACTING_TIME_MAX: Duration = Duration::from_secs(15);

/// Time for which a picture is asked for again, and the pause before each repetition.
const RETRY_MAX: Duration = Duration::from_secs(10);
const RETRY_INTERVAL: Duration = Duration::from_millis(200);

/// Settings of the driver.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MotionSettings {
    /// Name of the agent.
    pub(crate) agent: String,
    /// The only preset, which the camera always looks at.
    pub(crate) preset: String,
    pub(crate) watches_motion: bool,
    pub(crate) program: MotionProgram,
}

/// The Motion that watches the camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum MotionProgram {
    /// This process runs it.
    Supervised {
        source: CameraSource,
        /// Options of Motion, with their values.
        options: Vec<(String, String)>,
        /// Folder for the files of a run; `None` for that of temporary files.
        folder: Option<PathBuf>,
    },
    /// It runs by itself.
    Attached {
        /// Its port for questions, and its port for pictures.
        control: CameraAccess,
        pictures: CameraAccess,
        /// Number of the camera in Motion.
        camera: u32,
        /// The named pipe into which its hooks write.
        events: PathBuf,
    },
}

/// A camera of a Motion that this process runs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CameraSource {
    /// A file of a USB camera, such as `/dev/video0`.
    Device(String),
    /// A video of the network, or a film.
    Stream(StreamAccess),
}

impl Display for CameraSource {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            CameraSource::Device(device) => f.write_str(device),
            CameraSource::Stream(stream) => Display::fmt(stream, f),
        }
    }
}

/// A camera that Motion watches.
#[derive(Clone)]
struct MotionDriver {
    shared: Arc<Shared>,
    /// The task that follows Motion; it starts at the first use, and ends with the driver.
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
    settings: MotionSettings,
    seen: watch::Sender<Seen>,
    /// The servers of Motion; `None` while it does not run.
    servers: Mutex<Option<Arc<Servers>>>,
}

/// The two servers of Motion.
struct Servers {
    control: PictureServer,
    pictures: PictureServer,
    camera: u32,
}

pub(crate) fn camera(settings: MotionSettings) -> Arc<dyn Camera> {
    let (seen, servers) = (watch::Sender::default(), Mutex::new(None));
    let shared = Arc::new(Shared { settings, seen, servers });
    Arc::new(MotionDriver { shared, follower: Arc::default() })
}

impl MotionDriver {
    /// Starts the task that follows Motion, if it does not run.
    fn follow(&self) {
        let mut follower = lock(&self.follower);
        if follower.is_none() {
            let shared = Arc::clone(&self.shared);
            *follower = Some(FollowerTask(tokio::spawn(follower::follow(shared))));
        }
    }

    /// Returns the camera's own video, which can be recorded; `None` if there is none.
    fn video(&self) -> Option<&StreamAccess> {
        match &self.shared.settings.program {
            MotionProgram::Supervised { source: CameraSource::Stream(stream), .. } => {
                stream.to_string().starts_with("rtsp://").then_some(stream)
            }
            _ => None,
        }
    }
}

impl Shared {
    /// Returns an error if the camera cannot be used, or `name` is not its preset.
    fn check(&self, name: &str) -> Result<(), String> {
        if name != self.settings.preset {
            return Err(format!("find the preset `{name}`"));
        }
        self.seen.borrow().problem.clone().map_or(Ok(()), Err)
    }

    /// Gets a picture. Motion has none for a moment after its start, and while its server is busy.
    async fn picture(&self) -> Result<CameraPicture, String> {
        let servers = lock(&self.servers).clone();
        let servers = servers.ok_or("take a picture: Motion is being started")?;
        let (path, until) = (format!("/{}/current", servers.camera), Instant::now() + RETRY_MAX);
        loop {
            match servers.pictures.picture(&path).await {
                Ok(picture) => return Ok(picture),
                Err(error) if Instant::now() >= until => return Err(error.to_string()),
                Err(_) => {
                    tokio::time::sleep(RETRY_INTERVAL).await;
                    self.seen.borrow().problem.clone().map_or(Ok(()), Err)?;
                }
            }
        }
    }
}

impl Camera for MotionDriver {
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
        false
    }

    fn look_at(&self, preset: &str) -> BoxFuture<Result<View, String>> {
        let looks = self.shared.check(preset).map(|()| View {
            preset: Some(preset.to_owned()),
            detail: "looks there always".to_owned(),
        });
        Box::pin(std::future::ready(looks))
    }

    fn move_by(&self, _step: Step) -> BoxFuture<Result<View, String>> {
        let problem = "turn a camera without motors".to_owned();
        Box::pin(std::future::ready(Err(problem)))
    }

    fn take_picture(&self, preset: &str) -> BoxFuture<Result<RecordedFile, String>> {
        let (shared, preset) = (Arc::clone(&self.shared), preset.to_owned());
        Box::pin(async move {
            shared.check(&preset)?;
            let picture = shared.picture().await?;
            // If the camera is lost, Motion shows a picture of its own.
            shared.check(&preset)?;
            let caption = format!("{} kB", picture.content.len().div_ceil(1_000));
            let content = FileContent::Made(Box::new(move || picture.content.to_vec()));
            Ok(RecordedFile { extension: picture.extension, content, caption })
        })
    }

    fn can_record(&self) -> bool {
        self.video().is_some() && recording::is_possible()
    }

    fn record(
        &self,
        preset: &str,
        lasts: Duration,
        part: PartFile,
    ) -> BoxFuture<Result<RecordedFile, String>> {
        let stream = self.shared.check(preset).and_then(|()| {
            let access = self.video().ok_or("record a video: the camera has no RTSP address")?;
            access.read().map_err(|error| error.to_string())
        });
        Box::pin(async move { recording::record(&stream?, lasts, part).await })
    }

    fn notice(&self, known: SharedKnown) -> BoxFuture<News> {
        let driver = self.clone();
        Box::pin(async move {
            driver.follow();
            next_news(driver.shared.seen.subscribe(), known, || false).await
        })
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
