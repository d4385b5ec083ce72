//! Tests of the ONVIF driver with a stand-in for a camera, and of its configs that are refused.

use std::time::Duration;

use serde_json::{Value, json};

use super::*;
use crate::onvif_camera::StandIn;
use crate::test_support::{
    self as support, PATIENCE, facts, files, perform, refusal, requested, until,
};

fn config(address: &str) -> Value {
    let presets = json!({
        "hall": { "shows": "hall", "preset": "Hall" },
        "door": { "shows": "entry", "preset": "Door" },
    });
    json!({ "location": "hall", "address": address, "settle": "1s", "presets": presets })
}

fn camera_with(config: Value) -> (PtzCamera, tempfile::TempDir) {
    support::camera_with(ONVIF, config)
}

#[tokio::test]
async fn a_camera_turns_to_a_place_and_takes_its_picture() {
    let stand_in = StandIn::start();
    let (mut camera, folder) = camera_with(config(&stand_in.address.to_string()));
    camera.read_state().expect("it connects").await;
    let done = perform(&mut camera, "go_to_preset", &[("preset", "door")]).await.expect("it turns");
    assert!(done.detail.contains("pan -0.50"), "{}", done.detail);
    assert_eq!(stand_in.behavior().position, (-0.5, 0.0));
    assert!(facts(&camera).contains("(looks-at camera-1 door)"), "{}", facts(&camera));
    let at = [("preset", "door"), ("place", "entry")];
    perform(&mut camera, "take_picture", &at).await.expect("a picture");
    let files = files(&folder, "jpg");
    assert_eq!(files.len(), 1);
    let picture = std::fs::read(&files[0]).expect("a file");
    assert!(picture.starts_with(b"\xff\xd8"));
    // Somebody turns the camera with its app: no picture of the wrong place is taken.
    stand_in.behavior().position = (0.9, 0.9);
    let failure = perform(&mut camera, "take_picture", &at).await.expect_err("elsewhere");
    assert!(failure.to_string().contains("the camera looks elsewhere"), "{failure}");
    assert!(!facts(&camera).contains("looks-at"), "{}", facts(&camera));
}

#[tokio::test]
async fn a_camera_that_says_nothing_of_its_moves_arrives_after_its_time() {
    let stand_in = StandIn::start();
    stand_in.behavior().says_position = false;
    let (mut camera, _folder) = camera_with(config(&stand_in.address.to_string()));
    let done = perform(&mut camera, "go_to_preset", &[("preset", "hall")]).await.expect("it turns");
    assert!(done.detail.contains("does not say its position"), "{}", done.detail);
    stand_in.behavior().unsupported = ["GetStatus"].into();
    perform(&mut camera, "go_to_preset", &[("preset", "door")]).await.expect("it turns");
    assert_eq!(stand_in.behavior().position, (-0.5, 0.0));
}

#[tokio::test]
async fn a_preset_that_is_gone_is_no_place_to_look_at() {
    let stand_in = StandIn::start();
    stand_in.behavior().presets.retain(|(_, name, _)| *name == "Hall");
    let (mut camera, _folder) = camera_with(config(&stand_in.address.to_string()));
    until(&mut camera, |camera| camera.missing.contains("door")).await;
    assert!(facts(&camera).contains("(shows camera-1 hall hall)"), "{}", facts(&camera));
    assert!(!facts(&camera).contains("entry"), "{}", facts(&camera));
    let failure = perform(&mut camera, "go_to_preset", &[("preset", "door")]).await;
    let failure = failure.expect_err("it is gone").to_string();
    assert!(failure.contains("find the preset `Door` in the camera: it has `Hall`"), "{failure}");

    stand_in.behavior().presets.clear();
    let (mut camera, _folder) = camera_with(config(&stand_in.address.to_string()));
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("none of its presets is `Door`, `Hall`; it has none"), "{problem}");
    assert!(camera.describe().model.actions.is_empty());
}

#[tokio::test]
async fn a_camera_that_rejects_the_login_offers_nothing_and_says_why() {
    let stand_in = StandIn::start();
    stand_in.behavior().rejects_login = true;
    let (mut camera, _folder) = camera_with(config(&stand_in.address.to_string()));
    until(&mut camera, |camera| camera.problem.is_some()).await;
    let problem = camera.problem.clone().unwrap_or_default();
    assert!(problem.contains("write `user` and `password-file`"), "{problem}");
    assert!(camera.describe().model.actions.is_empty());
}

#[tokio::test]
async fn motion_where_the_camera_looks_becomes_a_fact_and_a_goal() {
    let stand_in = StandIn::start();
    let mut wanted = config(&stand_in.address.to_string());
    wanted["on-motion"] = json!({ "goal": "(known-picture ?l)" });
    let (mut camera, _folder) = camera_with(wanted);
    camera.read_state().expect("it connects").await;
    // The camera is found where it looks, without having been turned.
    stand_in.behavior().position = (0.5, 0.1);
    until(&mut camera, |camera| camera.in_view.as_deref() == Some("hall")).await;
    stand_in.report_motion(true);
    let goal = requested(&mut camera).await;
    assert!(goal.contains("(known-picture hall)"), "{goal}");
    assert!(facts(&camera).contains("(motion hall)"), "{}", facts(&camera));
}

#[tokio::test]
async fn an_interrupted_turn_stops_the_camera() {
    let stand_in = StandIn::start();
    stand_in.behavior().says_position = false;
    let mut wanted = config(&stand_in.address.to_string());
    wanted["settle"] = json!("20s");
    let (camera, _folder) = camera_with(wanted);
    let turning = tokio::spawn(camera.camera.look_at("door"));
    let wait = async |operation: &str| {
        let asked = async {
            while stand_in.count(operation) == 0 {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(PATIENCE, asked).await.expect(operation);
    };
    wait("GotoPreset").await;
    turning.abort();
    wait("Stop").await;
}

#[test]
fn a_config_that_cannot_work_is_refused_with_its_correction() {
    let without = |key: &str| {
        let mut config = config("10.0.0.9");
        config.as_object_mut().expect("an object").remove(key);
        config
    };
    let with = |key: &str, value: Value| {
        let mut config = config("10.0.0.9");
        config[key] = value;
        config
    };
    let preset = |preset: Value| with("presets", json!({ "hall": preset }));
    for (driver, config, expected) in [
        (ONVIF, without("address"), "needs the `address` of the camera"),
        (ONVIF, with("address", json!("rtsp://cam")), "write HOST"),
        (ONVIF, with("address", json!("https://cam")), "name the certificate to trust"),
        (ONVIF, with("password-file", json!("/x")), "needs its `user`"),
        (ONVIF, with("sensitivity", json!(0.1)), "decides by itself what is motion"),
        (ONVIF, with("record-seconds", json!(90.0)), "record-seconds is 0.2 to 60"),
        (ONVIF, with("source", json!("/dev/video0")), "`source` is for `driver = \"motion\"`"),
        (ONVIF, with("settle", json!("1h")), "settle `1h`: write a time between 0s and 20s"),
        (ONVIF, preset(json!({ "shows": "hall" })), "names no direction of the camera"),
        (ONVIF, preset(json!({ "shows": "hall", "preset": " " })), "`preset` is empty"),
        (ONVIF, preset(json!({ "shows": "hall", "pan": 3.0 })), "degrees of a simulated camera"),
        (ONVIF, preset(json!({ "shows": "hall", "position": [2.0, 0.0, 0.0] })), "from -1 to 1"),
        (SIMULATED, config("10.0.0.9"), "`address` is for the drivers `onvif`, `motion`"),
    ] {
        let problem = refusal(driver, config);
        assert!(problem.contains(expected), "{problem}");
    }
}
