//! Tests of the driver `motion`: the real Motion with films and cameras of the network; a stand-in for
//! a Motion that runs by itself; configs that are refused.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde_json::{Value, json};

use super::*;
use crate::film::{RtspCamera, crossing, kill_with, missing, processes_with};
use crate::left_out::left_out;
use crate::test_support::{
    PATIENCE, camera_with, facts, files, perform, refusal, requested, until,
};

const AT: [(&str, &str); 2] = [("preset", "ahead"), ("place", "hall")];

fn config(source: &str) -> Value {
    json!({
        "location": "hall", "source": source, "on-motion": { "goal": "(known-picture ?l)" },
        "settings": { "threshold": 1000, "event_gap": 1 },
    })
}

fn has_motion() -> bool {
    let missing = missing(&["motion", "ffmpeg"]);
    if !missing.is_empty() {
        left_out(&format!("it needs {}: apt install motion ffmpeg", missing.join(", ")));
    }
    missing.is_empty()
}

/// Returns the only file of this name below a folder.
fn find(folder: &Path, name: &str) -> std::path::PathBuf {
    let runs = std::fs::read_dir(folder.join("motion")).expect("a folder").flatten();
    let found: Vec<_> =
        runs.map(|run| run.path().join(name)).filter(|path| path.exists()).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    found.into_iter().next().expect("one")
}

#[tokio::test]
async fn motion_sees_what_crosses_a_film_and_takes_a_picture() {
    if !has_motion() {
        return;
    }
    let films = tempfile::tempdir().expect("a folder");
    let film = crossing(films.path()).display().to_string();
    let (mut camera, folder) = camera_with(MOTION, config(&format!("file://{film}")));
    until(&mut camera, |camera| camera.in_view.as_deref() == Some("ahead")).await;
    let written = find(folder.path(), "motion.conf");
    let mode = std::fs::metadata(&written).expect("there").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    perform(&mut camera, "take_picture", &AT).await.expect("a picture");
    let picture = std::fs::read(&files(&folder, "jpg")[0]).expect("a file");
    assert!(picture.starts_with(b"\xff\xd8"));
    let goal = requested(&mut camera).await;
    assert!(goal.contains("(known-picture hall)"), "{goal}");
    assert!(facts(&camera).contains("(motion hall)"), "{}", facts(&camera));

    // Motion is killed: the camera leaves, and comes back with a new one.
    let run = written.parent().expect("a folder").to_owned();
    kill_with(&written.display().to_string());
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("run `motion`: signal: 9"), "{problem}");
    assert!(camera.describe().model.actions.is_empty());
    until(&mut camera, |camera| camera.problem.is_none() && camera.in_view.is_some()).await;
    assert!(!run.exists(), "the files of the first run are removed");

    // The driver ends: nothing of Motion is left.
    let name = find(folder.path(), "motion.conf");
    drop(camera);
    let is_gone = async {
        while !processes_with(&name.display().to_string()).is_empty() || name.exists() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let gone = tokio::time::timeout(PATIENCE, is_gone).await;
    let left = (processes_with(&name.display().to_string()), name.exists());
    assert!(gone.is_ok(), "{left:?}");
}

#[tokio::test]
async fn a_camera_of_the_network_is_watched_and_recorded_with_its_password() {
    if !has_motion() {
        return;
    }
    let password = "p@ss:w/rd %41";
    let mut video = match RtspCamera::start(Some(("me", password))) {
        Ok(video) => video,
        Err(lacks) => return left_out(&lacks),
    };
    let secrets = tempfile::tempdir().expect("a folder");
    let file = secrets.path().join("password");
    std::fs::write(&file, password).expect("a file");
    let mut wanted = config(&format!("rtsp://127.0.0.1:{}/live", video.port));
    (wanted["user"], wanted["password-file"]) = (json!("me"), json!(file));
    wanted["record-seconds"] = json!(2.0);
    let (mut camera, folder) = camera_with(MOTION, wanted.clone());
    until(&mut camera, |camera| camera.in_view.is_some()).await;
    perform(&mut camera, "take_picture", &AT).await.expect("a picture");
    perform(&mut camera, "record_video", &AT).await.expect("a video");
    assert!(facts(&camera).contains("(recorded hall)"), "{}", facts(&camera));
    assert_eq!(files(&folder, "mp4").len(), 1);

    // The camera is switched off: it leaves, with a reason.
    video.kill();
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("through Motion"), "{problem}");
    let failure = perform(&mut camera, "take_picture", &AT).await.expect_err("no picture");
    assert!(failure.to_string().contains("through Motion"), "{failure}");
}

#[tokio::test]
async fn a_wrong_password_has_a_reason_that_does_not_repeat_it() {
    if !has_motion() {
        return;
    }
    let video = match RtspCamera::start(Some(("me", "right"))) {
        Ok(video) => video,
        Err(lacks) => return left_out(&lacks),
    };
    let secrets = tempfile::tempdir().expect("a folder");
    let file = secrets.path().join("password");
    std::fs::write(&file, "hunter2").expect("a file");
    let mut wanted = config(&format!("rtsp://127.0.0.1:{}/live", video.port));
    (wanted["user"], wanted["password-file"]) = (json!("me"), json!(file));
    let (mut camera, _folder) = camera_with(MOTION, wanted);
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("through Motion") && !problem.contains("hunter2"), "{problem}");
    assert!(problem.contains("401 Unauthorized"), "{problem}");
    assert!(camera.describe().model.actions.is_empty());
}

/// A Motion that runs by itself: its two servers in one, and its hooks.
#[derive(Clone)]
struct ForeignMotion {
    address: SocketAddr,
    /// What it says of its camera; `None` while it does not answer.
    connection: Arc<Mutex<Option<&'static str>>>,
}

impl ForeignMotion {
    fn start() -> ForeignMotion {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let connection = Arc::new(Mutex::new(Some("Connection OK")));
        let motion = ForeignMotion { address, connection };
        let serving = motion.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // A client that has gone needs no answer.
                let _ = serving.answer(&stream);
            }
        });
        motion
    }

    fn answer(&self, mut stream: &TcpStream) -> std::io::Result<()> {
        let mut lines = BufReader::new(stream).lines();
        let request = lines.next().transpose()?.unwrap_or_default();
        while lines.next().transpose()?.is_some_and(|line| !line.is_empty()) {}
        let Some(connection) = *self.connection.lock().expect("a lock") else { return Ok(()) };
        let body = match request.split(' ').nth(1) {
            Some("/2/detection/connection") => format!("Camera 2 -- {connection}\n").into_bytes(),
            Some("/2/current") => b"\xff\xd8 a picture \xff\xd9".to_vec(),
            _ => b"Not found".to_vec(),
        };
        write!(stream, "HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n", body.len())?;
        stream.write_all(&body)
    }

    fn say(&self, connection: Option<&'static str>) {
        *self.connection.lock().expect("a lock") = connection;
    }

    fn config(&self, events: &Path) -> Value {
        json!({
            "location": "hall", "address": self.address.to_string(),
            "pictures": self.address.to_string(), "camera": 2, "events": events,
            "on-motion": { "goal": "(known-picture ?l)" }, "motion-for": "1s",
        })
    }
}

/// Writes a word into the pipe, as a hook does.
fn hook(events: &Path, word: &str) {
    let mut pipe = std::fs::OpenOptions::new().write(true).open(events).expect("a pipe");
    writeln!(pipe, "{word}").expect("written");
}

#[tokio::test]
async fn a_motion_that_runs_by_itself_is_attached_to() {
    let motion = ForeignMotion::start();
    let pipes = tempfile::tempdir().expect("a folder");
    let events = pipes.path().join("events");
    let (mut camera, folder) = camera_with(MOTION, motion.config(&events));
    until(&mut camera, |camera| camera.in_view.is_some()).await;
    perform(&mut camera, "take_picture", &AT).await.expect("a picture");
    assert_eq!(files(&folder, "jpg").len(), 1);
    let offered = format!("{:?}", camera.describe().methods.keys());
    assert_eq!(offered, "[\"take-snapshot\"]", "there is no video to record");

    hook(&events, "start");
    let goal = requested(&mut camera).await;
    assert!(goal.contains("(known-picture hall)"), "{goal}");
    // Motion that goes on is told again; its end is not.
    requested(&mut camera).await;
    hook(&events, "end");

    // The hook says that the camera is lost before Motion is asked again.
    motion.say(Some("Lost connection"));
    hook(&events, "lost");
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert_eq!(problem, "get a picture of camera 2 through Motion");
    motion.say(Some("Connection OK"));
    hook(&events, "found");
    until(&mut camera, |camera| camera.problem.is_none()).await;

    // Motion hangs up, and is there again.
    motion.say(None);
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("reach the camera at"), "{problem}");
    motion.say(Some("Connection OK"));
    until(&mut camera, |camera| camera.problem.is_none()).await;
}

/// Measures the time from the word of a hook to the goal that is asked for.
#[tokio::test(flavor = "multi_thread")]
#[ignore = "a measurement, which takes a minute"]
async fn motion_becomes_a_goal_within_milliseconds() {
    let motion = ForeignMotion::start();
    let pipes = tempfile::tempdir().expect("a folder");
    let events = pipes.path().join("events");
    let mut wanted = motion.config(&events);
    wanted["motion-for"] = json!("200ms");
    let (mut camera, _folder) = camera_with(MOTION, wanted);
    until(&mut camera, |camera| camera.in_view.is_some()).await;
    let mut times = Vec::new();
    for _ in 0..50 {
        let began = std::time::Instant::now();
        // The shell of a hook is a part of the time.
        let line = "echo start 1<>\"$0\"";
        let mut shell = std::process::Command::new("sh");
        let mut shell = shell.args(["-c", line]).arg(&events).spawn().expect("a shell");
        requested(&mut camera).await;
        times.push(began.elapsed());
        assert!(shell.wait().expect("it ends").success());
        hook(&events, "end");
        let mut seen = camera.next_event();
        let over = Duration::from_millis(1_500);
        while let Ok(event) = tokio::time::timeout(over, seen.take().expect("events")).await {
            event(&mut camera);
            seen = camera.next_event();
        }
    }
    times.sort();
    println!("p50 {:?}, greatest of {} {:?}", times[25], times.len(), times[49]);
}

#[tokio::test]
async fn a_motion_that_is_not_there_has_a_reason() {
    let pipes = tempfile::tempdir().expect("a folder");
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let connection = Arc::new(Mutex::new(None));
    let nobody = ForeignMotion { address: free, connection };
    let (mut camera, _folder) = camera_with(MOTION, nobody.config(&pipes.path().join("events")));
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("Connection refused"), "{problem}");
    let file = pipes.path().join("file");
    std::fs::write(&file, "").expect("a file");
    let (mut camera, _folder) = camera_with(MOTION, ForeignMotion::start().config(&file));
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("it is no named pipe"), "{problem}");
}

#[test]
fn a_config_that_cannot_work_is_refused_with_its_correction() {
    let with = |key: &str, value: Value| {
        let mut config = config("rtsp://10.0.0.9/1");
        config[key] = value;
        config
    };
    let attached = |key: &str, value: Value| {
        let mut config = ForeignMotion::start().config(Path::new("/run/events"));
        config[key] = value;
        config
    };
    let set = |option: &str, value: Value| with("settings", json!({ option: value }));
    let preset = json!({ "a": { "shows": "hall", "preset": "A" } });
    for (config, expected) in [
        (json!({ "location": "hall" }), "needs the `source` of the pictures"),
        (with("address", json!("127.0.0.1:8080")), "and not both"),
        (with("source", json!("rtsp://me:hunter2@cam/1")), "write `user` and `password-file`"),
        (with("source", json!("cam")), "`source`: the address of a video is rtsp://…"),
        (with("source", json!("/etc/passwd")), "is no camera of this machine"),
        (with("events", json!("/x")), "`events` is for a Motion that runs by itself"),
        (with("sensitivity", json!(0.1)), "Motion counts pixels"),
        (with("presets", preset), "does not turn"),
        (set("on_event_start", json!("evil")), "cannot be set here"),
        (set("threshold", json!("1\non_event_start evil")), "no control character"),
        (attached("events", json!("events")), "absolute path of a named pipe"),
        (attached("settings", json!({ "threshold": 1 })), "has its own motion.conf"),
        (attached("record-seconds", json!(5.0)), "records the `source`"),
        (attached("address", json!("https://10.0.0.9")), "name the certificate to trust"),
    ] {
        let problem = refusal(MOTION, config);
        assert!(problem.contains(expected), "{problem}");
        assert!(!problem.contains("hunter2"), "{problem}");
    }
    let mut device = config("/dev/video0");
    device["record-seconds"] = json!(5.0);
    assert!(refusal(MOTION, device).contains("records the `source`"));
}
