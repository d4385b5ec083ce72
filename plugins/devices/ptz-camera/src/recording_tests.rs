//! Tests of recordings: real videos over RTSP, by what is in the folder afterwards.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use onvif_link::StreamAccess;
use serde_json::json;

use super::*;
use crate::film::{RtspCamera, missing, processes_with};
use crate::left_out::left_out;
use crate::onvif_camera::StandIn;
use crate::test_support::{PATIENCE, camera_with, facts, files, perform};

/// A password that no address can contain as it is.
const PASSWORD: &str = "p@ss:w/rd %41";

/// Starts a camera; reports the test as left out if this machine lacks something.
fn rtsp_camera(login: Option<(&str, &str)>) -> Option<RtspCamera> {
    let missing = missing(&["ffmpeg", "ffprobe"]);
    if !missing.is_empty() {
        left_out(&format!("it needs {}: apt install ffmpeg", missing.join(", ")));
        return None;
    }
    RtspCamera::start(login).map_err(|lacks| left_out(&lacks)).ok()
}

/// Returns the length of a video and the number of its whole pictures, by `ffprobe`.
fn probed(video: &Path) -> (f64, usize) {
    let entries = ["-count_packets", "-show_entries", "stream=nb_read_packets:format=duration"];
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "v"])
        .args(entries)
        .args(["-of", "default=noprint_wrappers=1"])
        .arg(video)
        .output()
        .expect("ffprobe runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let number = |key: &str| -> f64 {
        let found = text.lines().find_map(|line| line.strip_prefix(key));
        found.and_then(|number| number.parse().ok()).unwrap_or_else(|| panic!("{key} in {text}"))
    };
    (number("duration="), number("nb_read_packets=") as usize)
}

/// Returns a part that is not taken by an album.
fn part(folder: &tempfile::TempDir) -> PartFile {
    let album = album::Album::new(folder.path().join("pictures"), "camera-1".to_owned(), 5);
    album.part_of_video().expect("a part")
}

fn stream(port: u16, login: Option<(&Path, &str)>) -> onvif_link::VideoStream {
    let (file, user) = login.map(|(file, user)| (file.to_owned(), user.to_owned())).unzip();
    let address = format!("rtsp://127.0.0.1:{port}/live");
    let access = StreamAccess::new(&address, &["rtsp"], user, file).expect("an access");
    access.read().expect("a password")
}

#[tokio::test]
async fn a_camera_records_the_video_that_it_names() {
    let Some(video) = rtsp_camera(None) else { return };
    let stand_in = StandIn::start();
    stand_in.behavior().stream = Some(format!("rtsp://127.0.0.1:{}/live", video.port));
    let presets = json!({ "hall": { "shows": "hall", "preset": "Hall" } });
    let config = json!({
        "location": "hall", "address": stand_in.address.to_string(), "presets": presets,
        "record-seconds": 3.0,
    });
    let (mut camera, folder) = camera_with(ONVIF, config);
    camera.read_state().expect("it connects").await;
    let model = format!("{:?}", camera.describe().model);
    assert!(model.contains("record"), "{model}");
    perform(&mut camera, "go_to_preset", &[("preset", "hall")]).await.expect("it turns");
    let at = [("preset", "hall"), ("place", "hall")];
    let done = perform(&mut camera, "record_video", &at).await.expect("a video");
    assert!(facts(&camera).contains("(recorded hall)"), "{}", facts(&camera));
    let videos = files(&folder, "mp4");
    assert_eq!(videos.len(), 1, "{}", done.detail);
    let (seconds, pictures) = probed(&videos[0]);
    assert!((1.5..=3.6).contains(&seconds), "{seconds}");
    assert!(pictures >= 15, "{pictures} pictures in {seconds} s");
    assert!(files(&folder, "part").is_empty());

    // Somebody turns it: no video of another place is told as one of this.
    stand_in.behavior().position = (0.9, 0.9);
    let failure = perform(&mut camera, "record_video", &at).await.expect_err("elsewhere");
    assert!(failure.to_string().contains("the camera looks elsewhere"), "{failure}");
    assert_eq!(files(&folder, "mp4").len(), 1);
}

#[tokio::test]
async fn a_video_that_breaks_off_is_no_recording() {
    let Some(mut video) = rtsp_camera(None) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let stream = stream(video.port, None);
    let part = part(&folder);
    let path = part.path().to_owned();
    let recording = tokio::spawn(async move {
        recording::record(&stream, Duration::from_secs(30), part).await.map(|done| done.caption)
    });
    let has_begun = async {
        while std::fs::metadata(&path).map_or(0, |file| file.len()) == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(PATIENCE, has_begun).await.expect("it begins");
    video.kill();
    let recorded = tokio::time::timeout(PATIENCE, recording).await.expect("in time");
    let problem = recorded.expect("it ends").expect_err("it broke off");
    assert!(problem.starts_with(&format!("record rtsp://127.0.0.1:{}/live: ", video.port)));
    assert!(!path.exists(), "{problem}");
}

#[tokio::test]
async fn a_recording_that_is_given_up_leaves_nothing() {
    let Some(video) = rtsp_camera(None) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (stream, part) = (stream(video.port, None), part(&folder));
    let path = part.path().to_owned();
    let recording = recording::record(&stream, Duration::from_secs(30), part);
    let has_begun = async {
        while !path.exists() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::select! {
        recorded = recording => panic!("it ends: {:?}", recorded.map(|done| done.caption)),
        begun = tokio::time::timeout(PATIENCE, has_begun) => begun.expect("it begins"),
    }
    let name = path.display().to_string();
    let is_gone = async {
        while !processes_with(&name).is_empty() || path.exists() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(PATIENCE, is_gone).await.expect("the program and its file are gone");
}

#[tokio::test]
async fn a_password_reaches_the_camera_and_no_one_else() {
    let Some(video) = rtsp_camera(Some(("me", PASSWORD))) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("password");
    std::fs::write(&file, PASSWORD).expect("a file");
    let two = Duration::from_secs(2);
    let with_login = stream(video.port, Some((&file, "me")));
    let recording = recording::record(&with_login, two, part(&folder));
    let watching = async {
        let mut seen = Vec::new();
        loop {
            seen.extend(processes_with("pipe:3").into_iter().map(|(_, line)| line));
            assert!(!seen.iter().any(|line| line.contains("p%40ss") || line.contains(PASSWORD)));
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::select! {
        recorded = recording => drop(recorded.expect("it is let in")),
        () = watching => (),
    }
    std::fs::write(&file, "hunter2").expect("a file");
    let wrong = stream(video.port, Some((&file, "me")));
    let problem = recording::record(&wrong, two, part(&folder)).await.err().expect("a reason");
    assert!(problem.contains("401") && !problem.contains("hunter2"), "{problem}");
    let nowhere = stream(1, Some((&file, "me")));
    let problem = recording::record(&nowhere, two, part(&folder)).await.err().expect("a reason");
    assert!(problem.contains("Connection refused") && !problem.contains("hunter2"), "{problem}");
}
