//! Tests of the driver `v4l2`: a film in place of the device, through the real `ffmpeg`; configs that
//! are refused.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use super::*;
use crate::film::{crossing, kill_with, missing};
use crate::left_out::left_out;
use crate::test_support::{camera_with, facts, files, perform, refusal, requested, until};
use crate::v4l2::V4l2Settings;

fn config() -> Value {
    json!({
        "location": "hall", "device": "/dev/video99",
        "on-motion": { "goal": "(known-picture ?l)" },
    })
}

/// Returns a camera whose device is a film, shown again and again as fast as it was made.
fn film_camera(film: &Path) -> (PtzCamera, tempfile::TempDir) {
    let (mut camera, folder) = camera_with(V4L2, config());
    let film = film.display().to_string();
    let input = ["-re", "-stream_loop", "-1", "-i", &film].map(str::to_owned).to_vec();
    camera.camera = v4l2::camera(V4l2Settings {
        device: "/dev/video99".to_owned(),
        input,
        positions: BTreeMap::from([("ahead".to_owned(), None)]),
        sensitivity: Some(0.004),
        settle: Duration::from_secs(1),
    });
    (camera, folder)
}

fn has_ffmpeg() -> bool {
    let is_there = missing(&["ffmpeg"]).is_empty();
    if !is_there {
        left_out("it needs ffmpeg: apt install ffmpeg");
    }
    is_there
}

#[tokio::test]
async fn a_camera_sees_what_crosses_and_takes_a_picture() {
    if !has_ffmpeg() {
        return;
    }
    let films = tempfile::tempdir().expect("a folder");
    let (mut camera, folder) = film_camera(&crossing(films.path()));
    camera.read_state().expect("it connects").await;
    until(&mut camera, |camera| camera.in_view.as_deref() == Some("ahead")).await;
    assert!(!facts(&camera).contains("motion"), "{}", facts(&camera));
    let at = [("preset", "ahead"), ("place", "hall")];
    perform(&mut camera, "take_picture", &at).await.expect("a picture");
    let pictures = files(&folder, "jpg");
    let picture = std::fs::read(&pictures[0]).expect("a file");
    assert!(picture.starts_with(b"\xff\xd8") && picture.ends_with(b"\xff\xd9"));
    let goal = requested(&mut camera).await;
    assert!(goal.contains("(known-picture hall)"), "{goal}");
    assert!(facts(&camera).contains("(motion hall)"), "{}", facts(&camera));
}

#[tokio::test]
async fn a_device_that_is_not_there_has_a_reason() {
    if !has_ffmpeg() {
        return;
    }
    let (mut camera, _folder) = camera_with(V4L2, config());
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.starts_with("read the camera /dev/video99"), "{problem}");
    assert!(problem.contains("No such file"), "{problem}");
    assert!(camera.describe().model.actions.is_empty());
}

/// Wave at the camera.
#[tokio::test]
#[ignore = "for a machine with a camera; ALTHING_CAMERA names its device"]
async fn a_real_device_gives_a_picture_and_sees_what_moves() {
    let device = std::env::var("ALTHING_CAMERA").expect("ALTHING_CAMERA=/dev/video0");
    let mut wanted = config();
    wanted["device"] = json!(device);
    let (mut camera, folder) = camera_with(V4L2, wanted);
    until(&mut camera, |camera| camera.in_view.is_some()).await;
    let at = [("preset", "ahead"), ("place", "hall")];
    let done = perform(&mut camera, "take_picture", &at).await.expect("a picture");
    let picture = std::fs::read(&files(&folder, "jpg")[0]).expect("a file");
    assert!(picture.starts_with(b"\xff\xd8") && picture.ends_with(b"\xff\xd9"));
    let goal = requested(&mut camera).await;
    assert!(goal.contains("(known-picture hall)"), "{goal}");
    println!("{}, and motion", done.detail);
}

#[tokio::test]
async fn a_camera_that_ends_leaves_and_comes_back() {
    if !has_ffmpeg() {
        return;
    }
    let films = tempfile::tempdir().expect("a folder");
    let film = crossing(films.path());
    let (mut camera, _folder) = film_camera(&film);
    until(&mut camera, |camera| camera.in_view.is_some()).await;
    // The program is killed from outside, as it ends when the camera is unplugged.
    kill_with(&film.display().to_string());
    until(&mut camera, |camera| camera.problem.is_some()).await;
    assert!(camera.describe().model.actions.is_empty());
    until(&mut camera, |camera| camera.problem.is_none() && camera.in_view.is_some()).await;
}

#[test]
fn a_camera_offers_only_what_it_can_do() {
    let (camera, _folder) = camera_with(V4L2, config());
    let offered = format!("{:?}", camera.describe().methods.keys());
    assert_eq!(offered, "[\"take-snapshot\"]");
    let mut turned = config();
    turned["presets"] = json!({ "door": { "shows": "hall", "position": [0.5, 0.0, 0.0] } });
    let (camera, _folder) = camera_with(V4L2, turned);
    assert!(camera.describe().methods.contains_key("look-at"));
}

#[test]
fn a_config_that_cannot_work_is_refused_with_its_correction() {
    let with = |key: &str, value: Value| {
        let mut config = config();
        config[key] = value;
        config
    };
    let presets = |presets: Value| with("presets", presets);
    let two = json!({ "a": { "shows": "hall" }, "b": { "shows": "hall" } });
    for (config, expected) in [
        (json!({ "location": "hall" }), "needs the `device`"),
        (with("device", json!("video0")), "write /dev/video0"),
        (with("device", json!("/dev/video0 -x")), "write /dev/video0"),
        (with("size", json!("big")), "write WIDTHxHEIGHT"),
        (with("size", json!("0x480")), "write WIDTHxHEIGHT"),
        (with("sensitivity", json!(2.0)), "a share of the picture"),
        (with("address", json!("10.0.0.9")), "`address` is for the drivers `onvif`, `motion`"),
        (with("record-seconds", json!(5.0)), "`record-seconds` is for the drivers"),
        (presets(two), "only one preset for a camera without motors"),
        (presets(json!({ "a": { "shows": "hall", "preset": "A" } })), "stores no presets"),
        (presets(json!({ "a": { "shows": "hall", "position": [3, 0, 0] } })), "from -1 to 1"),
    ] {
        let problem = refusal(V4L2, config);
        assert!(problem.contains(expected), "{problem}");
    }
    let input = V4l2Settings::input_of("/dev/video0", Some((640, 480)));
    assert_eq!(input.join(" "), "-f v4l2 -video_size 640x480 -i /dev/video0");
}
