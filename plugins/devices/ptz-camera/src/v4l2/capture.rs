//! The task that reads a USB camera through `ffmpeg`, and finds motion in its pictures.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use programs::{Program, ProgramStart, RunningProgram, is_installed};
use tokio::io::{AsyncReadExt as _, BufReader};
use tokio::net::UnixStream;
use tokio::process::ChildStdout;
use tokio::time::Instant;

use super::differences::{Differences, HEIGHT, WIDTH};
use super::multipart::Multipart;
use super::{Shared, lock};

/// Name of the program.
const FFMPEG: &str = "ffmpeg";

/// Number of small pictures a second: enough to see a person who walks by several times.
const GRAY_RATE: u32 = 5;

/// Number of whole pictures a second. More cost more, and a picture that is asked for waits for the
/// next one.
const PICTURE_RATE: u32 = 2;

/// Quality of whole pictures for `ffmpeg`: 2 is the best, 31 the worst.
const QUALITY: &str = "3";

/// Pauses before the camera is opened again: the first, and the longest. A camera that is plugged
/// in again is used within the longest.
const PAUSE_MIN: Duration = Duration::from_secs(1);
const PAUSE_MAX: Duration = Duration::from_secs(15);

/// Time limit for the first picture: `ffmpeg` is loaded from a slow disk, and the camera starts.
const START_TIME_MAX: Duration = Duration::from_secs(30);

/// Time without a picture after which the camera counts as lost.
const SILENCE_MAX: Duration = Duration::from_secs(5);

/// Pause between two readings of the direction.
const LOOK_INTERVAL: Duration = Duration::from_secs(3);

/// Time for which motion lasts after the last picture with motion.
const MOTION_LASTS: Duration = Duration::from_secs(1);

/// Time after the start, and after a turn, for which motion does not count: the exposure and the
/// focus settle.
const UNSETTLED: Duration = Duration::from_secs(3);

/// Reads the camera, and opens it again after each failure. Never ends.
pub(super) async fn follow(shared: Arc<Shared>) {
    let mut pause = PAUSE_MIN;
    loop {
        let began = Instant::now();
        let Err(reason) = capture(&shared).await;
        shared.lose(reason);
        if began.elapsed() > PAUSE_MAX {
            pause = PAUSE_MIN;
        }
        tokio::time::sleep(pause).await;
        pause = (pause * 2).min(PAUSE_MAX);
    }
}

/// Returns the program with its arguments. It writes small gray pictures to its output, and whole
/// ones to its file descriptor 4.
fn arguments(input: &[String]) -> Vec<String> {
    let small = format!("fps={GRAY_RATE},scale={WIDTH}:{HEIGHT}:flags=area,format=gray");
    let whole = format!("fps={PICTURE_RATE},format=yuvj420p");
    let begin = [FFMPEG, "-hide_banner", "-nostdin", "-loglevel", "error"];
    let gray = ["-map", "0:v:0", "-vf", &small, "-flush_packets", "1", "-f", "rawvideo", "pipe:1"];
    let pictures = ["-map", "0:v:0", "-vf", &whole, "-c:v", "mjpeg", "-q:v", QUALITY];
    let end = ["-flush_packets", "1", "-f", "mpjpeg", "pipe:4"];
    let fixed = |part: &[&str]| part.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
    let rest = [fixed(&gray), fixed(&pictures), fixed(&end)].concat();
    [fixed(&begin), input.to_vec(), rest].concat()
}

/// Reads the camera. Returns the reason why it counts as lost.
async fn capture(shared: &Shared) -> Result<Infallible, String> {
    let device = &shared.settings.device;
    if !is_installed(FFMPEG) {
        return Err(
            "find the program `ffmpeg`, which reads the camera: install it (on Debian: apt \
                    install ffmpeg)"
                .to_owned(),
        );
    }
    let program = Program::of(arguments(&shared.settings.input));
    let program = program.ok_or("start ffmpeg without a name")?;
    let start = ProgramStart { has_output: true, ..ProgramStart::default() };
    let (mut running, link) = program.start(start).map_err(|error| error.to_string())?;
    let output = running.take_output().ok_or("read the output of ffmpeg")?;
    let reason = tokio::select! {
        // A program that has ended gives a more precise reason than its pipes.
        biased;
        reason = ended(&mut running, device) => Err(reason),
        reason = watch(shared, output) => reason,
        reason = keep(shared, link) => reason,
        reason = look(shared) => reason,
    };
    running.end().await;
    reason
}

async fn ended(running: &mut RunningProgram, device: &str) -> String {
    format!("read the camera {device}: failed to {}", running.ended().await)
}

/// Looks for motion in the small pictures.
async fn watch(shared: &Shared, output: ChildStdout) -> Result<Infallible, String> {
    let mut output = BufReader::new(output);
    let mut differences = Differences::new(shared.settings.sensitivity.unwrap_or(1.0));
    let (mut turns, mut settled_at) = (lock(&shared.turns).count, None);
    let mut motion_until = Instant::now();
    let mut picture = vec![0; WIDTH * HEIGHT];
    loop {
        let limit = if settled_at.is_none() { START_TIME_MAX } else { SILENCE_MAX };
        match tokio::time::timeout(limit, output.read_exact(&mut picture)).await {
            Ok(Ok(_)) => (),
            // The end of the program has its own reason.
            Ok(Err(_)) => return std::future::pending().await,
            Err(_) => {
                let device = &shared.settings.device;
                return Err(format!("get a picture of {device} within {limit:?}"));
            }
        }
        let now = Instant::now();
        let (is_turning, count) = {
            let turns = lock(&shared.turns);
            (turns.is_turning, turns.count)
        };
        if is_turning || count != turns || settled_at.is_none() {
            (turns, settled_at) = (count, Some(now + UNSETTLED));
        }
        if settled_at.is_some_and(|at| now < at) {
            differences.forget();
            motion_until = now;
        } else if differences.take(&picture) && shared.settings.sensitivity.is_some() {
            motion_until = now + MOTION_LASTS;
        }
        let has_motion = motion_until > now;
        shared.seen.send_if_modified(|seen| {
            std::mem::replace(&mut seen.has_motion, has_motion) != has_motion
        });
    }
}

/// Keeps the last whole picture.
async fn keep(shared: &Shared, mut link: UnixStream) -> Result<Infallible, String> {
    let mut parts = Multipart::default();
    let mut piece = vec![0; 64 << 10];
    loop {
        match link.read(&mut piece).await {
            Ok(count @ 1..) => {
                let last = parts.take(piece.get(..count).unwrap_or_default())?;
                if let Some(picture) = last {
                    shared.picture.send_replace(Some((Instant::now(), Arc::new(picture))));
                }
            }
            // The end of the program has its own reason.
            _ => return std::future::pending().await,
        }
    }
}

/// Reads the direction of the camera every [`LOOK_INTERVAL`], after its first picture.
async fn look(shared: &Shared) -> Result<Infallible, String> {
    let mut pictures = shared.picture.subscribe();
    // The sender lives as long as the task.
    let _ = pictures.wait_for(Option::is_some).await;
    loop {
        shared.look().await?;
        shared.seen.send_if_modified(|seen| {
            let is_new = !seen.is_tried || seen.problem.is_some();
            (seen.is_tried, seen.problem) = (true, None);
            is_new
        });
        if !shared.settings.can_turn() {
            return std::future::pending().await;
        }
        tokio::time::sleep(LOOK_INTERVAL).await;
    }
}
