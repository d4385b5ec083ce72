//! The task that runs Motion or attaches to it, and follows its camera and its events.

use std::convert::Infallible;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::net::TcpListener;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use onvif_link::{CameraAccess, PictureServer, new_password};
use programs::{Program, ProgramStart, ProgramWords, RunningProgram, is_installed};
use tempfile::TempDir;
use tokio::time::Instant;

use super::config_file::{self, Doors, EVENTS_VARIABLE};
use super::events::{EventPipe, MotionEvent};
use super::{CameraSource, MotionProgram, Servers, Shared, lock};
use crate::recording::without_addresses;
use crate::seen::Seen;

/// Name of the program.
const MOTION: &str = "motion";

/// User name at the servers of a Motion that this process runs.
const USER: &str = "althing";

/// Part of the lines in which Motion says why it has no picture. Further lines say that it tries
/// again.
const REASON: &str = "Unable to open ";

/// Pauses before the next start or attempt: the first, and the longest.
const PAUSE_MIN: Duration = Duration::from_secs(2);
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Pause between two questions whether the camera is connected, once Motion has answered.
const LOOK_INTERVAL: Duration = Duration::from_secs(3);

/// Pause between two questions while Motion starts.
const LOOK_INTERVAL_START: Duration = Duration::from_millis(250);

/// Time within which Motion answers after its start, on a small board that is busy.
const START_TIME_MAX: Duration = Duration::from_secs(20);

/// Number of questions in a row without an answer after which Motion counts as lost.
const FAILURES_MAX: usize = 3;

/// Time for which motion lasts at least, so that the agent notices it.
const MOTION_MIN: Duration = Duration::from_secs(1);

/// Time after which an event without an end is over: the hook of its end is missing, or failed.
const MOTION_MAX: Duration = Duration::from_secs(600);

/// Follows Motion, and starts it or attaches to it again after each failure. Never ends.
pub(super) async fn follow(shared: Arc<Shared>) {
    let mut pause = PAUSE_MIN;
    loop {
        let began = Instant::now();
        let ended = match &shared.settings.program {
            MotionProgram::Supervised { source, options, folder } => {
                supervise(&shared, source, options, folder.as_deref()).await
            }
            MotionProgram::Attached { control, pictures, camera, events } => {
                attach(&shared, control, pictures, *camera, events).await
            }
        };
        let Err(reason) = ended;
        *lock(&shared.servers) = None;
        shared.seen.send_modify(|seen| lose(seen, reason));
        // A Motion that ran for long was sound.
        if began.elapsed() > PAUSE_MAX {
            pause = PAUSE_MIN;
        }
        tokio::time::sleep(pause).await;
        pause = (pause * 2).min(PAUSE_MAX);
    }
}

/// Takes over that the camera cannot be used.
fn lose(seen: &mut Seen, reason: String) {
    (seen.is_tried, seen.problem) = (true, Some(reason));
    (seen.preset, seen.has_motion) = (None, false);
}

/// Attaches to a Motion that runs by itself. Returns the reason why it counts as lost.
async fn attach(
    shared: &Shared,
    control: &CameraAccess,
    pictures: &CameraAccess,
    camera: u32,
    events: &Path,
) -> Result<Infallible, String> {
    let server = |access| PictureServer::new(access).map_err(|error| error.to_string());
    let servers = Servers { control: server(control)?, pictures: server(pictures)?, camera };
    let events = EventPipe::open(events)?;
    let sight = Sight { source: format!("camera {camera}"), secret: None, words: None };
    // It should run already.
    stay(shared, servers, events, &sight, Instant::now()).await
}

/// Runs Motion. Returns the reason why it has ended or must be started again.
async fn supervise(
    shared: &Shared,
    source: &CameraSource,
    options: &[(String, String)],
    folder: Option<&Path>,
) -> Result<Infallible, String> {
    if !is_installed(MOTION) {
        return Err("find the program `motion`: install it (on Debian: apt install motion)".into());
    }
    let folder = folder.map_or_else(std::env::temp_dir, Path::to_owned);
    let made = std::fs::create_dir_all(&folder).and_then(|()| {
        let prefix = format!("motion-{}-", shared.settings.agent);
        tempfile::Builder::new().prefix(&prefix).tempdir_in(&folder)
    });
    let folder = made.map_err(|error| format!("make a folder in {}: {error}", folder.display()))?;
    let (camera, secret) = match source {
        CameraSource::Device(device) => (config_file::WatchedCamera::Device(device.clone()), None),
        CameraSource::Stream(access) => {
            let stream = access.read().map_err(|error| error.to_string())?;
            let secret = stream.login().map(|(_, password)| password.to_owned());
            (config_file::WatchedCamera::Stream(stream), secret)
        }
    };
    let mut sight = Sight { source: source.to_string(), secret, words: None };
    let (servers, events, mut running) = start(&folder, &camera, options)?;
    sight.words = Some(running.words());
    let until = Instant::now() + START_TIME_MAX;
    let reason = tokio::select! {
        reason = stay(shared, servers, events, &sight, until) => reason,
        ended = running.ended() => Err(sight.plain(&ended.to_string())),
    };
    running.end().await;
    reason
}

/// Writes the files of a run, and starts Motion.
fn start(
    folder: &TempDir,
    camera: &config_file::WatchedCamera,
    options: &[(String, String)],
) -> Result<(Servers, EventPipe, RunningProgram), String> {
    let [config, password_file, pipe] =
        ["motion.conf", "password", "events"].map(|name| folder.path().join(name));
    let [control, pictures] = free_ports()?;
    let password = new_password().map_err(|error| error.to_string())?;
    write(&password_file, &password)?;
    let doors = Doors { control, pictures, user: USER, password: &password };
    write(&config, &config_file::text(camera, &doors, options)?)?;
    let events = EventPipe::open(&pipe)?;
    let server = |port: u16| {
        let (user, file) = (Some(USER.to_owned()), Some(password_file.clone()));
        let access = CameraAccess::new(&format!("127.0.0.1:{port}"), user, file, None, None)?;
        PictureServer::new(&access).map_err(|error| error.to_string())
    };
    let servers = Servers { control: server(control)?, pictures: server(pictures)?, camera: 0 };
    let config = config.display().to_string();
    let command = [MOTION, "-n", "-c", &config].map(str::to_owned);
    let program = Program::of(command).ok_or("start Motion without a name")?;
    let environment = [(EVENTS_VARIABLE.to_owned(), pipe.display().to_string())];
    let scratch = Some(folder.path());
    let start = ProgramStart { environment: &environment, scratch, ..ProgramStart::default() };
    let (running, _) = program.start(start).map_err(|error| error.to_string())?;
    Ok((servers, events, running))
}

/// Returns two ports of this machine that are free now. If another program takes one before Motion
/// does, Motion is started again.
fn free_ports() -> Result<[u16; 2], String> {
    let free = || -> std::io::Result<_> {
        let listeners = [TcpListener::bind("127.0.0.1:0")?, TcpListener::bind("127.0.0.1:0")?];
        Ok([listeners[0].local_addr()?.port(), listeners[1].local_addr()?.port()])
    };
    free().map_err(|error| format!("find free ports for Motion: {error}"))
}

/// Writes a new file that only the user of this process can read.
fn write(path: &Path, text: &str) -> Result<(), String> {
    let opened = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
    let written = opened.and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| format!("write {}: {error}", path.display()))
}

/// The camera of a running Motion, for errors.
struct Sight {
    /// The camera's address without a login, or its number.
    source: String,
    /// Password of the camera, which is not repeated.
    secret: Option<String>,
    words: Option<ProgramWords>,
}

impl Sight {
    /// Returns the reason why the camera cannot be used while Motion has no picture of it.
    fn lost(&self) -> String {
        let said = self.words.as_ref().and_then(|words| words.last_with(REASON));
        // The time and the names of functions before the reason are left out.
        let reason = said.as_deref().and_then(|said| said.split_once(REASON));
        let said =
            reason.map(|(_, reason)| format!("; Motion says: {REASON}{}", self.plain(reason)));
        format!("get a picture of {} through Motion{}", self.source, said.unwrap_or_default())
    }

    /// Returns a text of Motion without addresses and the camera's password.
    fn plain(&self, text: &str) -> String {
        let text = without_addresses(text);
        match &self.secret {
            Some(secret) if !secret.is_empty() => text.replace(secret.as_str(), "…"),
            _ => text,
        }
    }
}

/// Follows a running Motion, which has to answer by `until`. Returns the reason why it counts as
/// lost.
async fn stay(
    shared: &Shared,
    servers: Servers,
    events: EventPipe,
    sight: &Sight,
    until: Instant,
) -> Result<Infallible, String> {
    let servers = Arc::new(servers);
    *lock(&shared.servers) = Some(Arc::clone(&servers));
    tokio::select! {
        reason = look(shared, &servers, sight, until) => reason,
        reason = hear(shared, events, sight) => reason,
    }
}

/// Asks Motion every [`LOOK_INTERVAL`] whether its camera is connected.
async fn look(
    shared: &Shared,
    servers: &Servers,
    sight: &Sight,
    until: Instant,
) -> Result<Infallible, String> {
    let (mut has_answered, mut failures) = (false, 0);
    loop {
        match is_connected(servers).await {
            Ok(is_connected) => {
                (has_answered, failures) = (true, 0);
                take(shared, is_connected, sight);
            }
            Err(_) if !has_answered && Instant::now() < until => (),
            Err(problem) if !has_answered => return Err(problem),
            Err(problem) => {
                failures += 1;
                if failures >= FAILURES_MAX {
                    return Err(problem);
                }
            }
        }
        let pause = if has_answered { LOOK_INTERVAL } else { LOOK_INTERVAL_START };
        tokio::time::sleep(pause).await;
    }
}

/// Asks Motion whether its camera is connected.
async fn is_connected(servers: &Servers) -> Result<bool, String> {
    let path = format!("/{}/detection/connection", servers.camera);
    let said = servers.control.text(&path).await.map_err(|error| error.to_string())?;
    connection(&said).ok_or_else(|| {
        "understand Motion: its answer to `detection/connection` is no state of a camera".to_owned()
    })
}

/// Reads Motion's answer about the connection to a camera; `None` if it is none.
fn connection(said: &str) -> Option<bool> {
    let said = said.to_ascii_lowercase();
    match (said.contains("connection ok"), said.contains("lost")) {
        (true, false) => Some(true),
        (false, true) => Some(false),
        _ => None,
    }
}

/// Takes over whether the camera is connected.
fn take(shared: &Shared, is_connected: bool, sight: &Sight) {
    shared.seen.send_if_modified(|seen| {
        let before = seen.clone();
        if is_connected {
            (seen.is_tried, seen.problem) = (true, None);
            seen.preset = Some(shared.settings.preset.clone());
        } else if seen.problem.is_none() {
            lose(seen, sight.lost());
        }
        *seen != before
    });
}

/// Follows the events of Motion.
async fn hear(shared: &Shared, mut pipe: EventPipe, sight: &Sight) -> Result<Infallible, String> {
    let set = |has_motion: bool| {
        let has_motion = has_motion && shared.settings.watches_motion;
        shared.seen.send_if_modified(|seen| {
            std::mem::replace(&mut seen.has_motion, has_motion) != has_motion
        });
    };
    // The end of the present motion.
    let mut until: Option<Instant> = None;
    loop {
        let over = async {
            match until {
                Some(until) => tokio::time::sleep_until(until).await,
                None => std::future::pending().await,
            }
        };
        let events = tokio::select! {
            events = pipe.next() => events?,
            () = over => {
                set(false);
                until = None;
                continue;
            }
        };
        for event in events {
            match event {
                MotionEvent::Started => {
                    set(true);
                    until = Some(Instant::now() + MOTION_MAX);
                }
                MotionEvent::Ended => until = until.map(|_| Instant::now() + MOTION_MIN),
                MotionEvent::CameraLost => {
                    until = None;
                    take(shared, false, sight);
                }
                MotionEvent::CameraFound => take(shared, true, sight),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_about_the_connection_are_understood() {
        for (said, expected) in [
            ("Camera 0 -- Connection OK\n", Some(true)),
            ("Camera 0 -- Lost connection\n", Some(false)),
            ("<html>Not found</html>", None),
            ("", None),
        ] {
            assert_eq!(connection(said), expected, "{said}");
        }
    }

    #[test]
    fn a_password_of_the_camera_is_not_repeated() {
        let secret = Some("hunter2".to_owned());
        let sight = Sight { source: "rtsp://cam/1".to_owned(), secret, words: None };
        let said = "failed: rtsp://me:hunter2@cam/1 userpass me:hunter2";
        assert_eq!(sight.plain(said), "failed: … userpass me:…");
        assert_eq!(sight.lost(), "get a picture of rtsp://cam/1 through Motion");
    }
}
