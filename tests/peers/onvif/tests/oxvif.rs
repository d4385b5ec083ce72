//! Tests with the devices of `oxvif`: what they know of themselves is compared with what was asked.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use onvif_link::{CameraAccess, LinkError, MotionEvents, OnvifCamera, Position, discover};
use oxvif::mock::{DiscoveryResponder, MockServer};

const PATIENCE: Duration = Duration::from_secs(30);

async fn connected(server: &MockServer) -> Arc<OnvifCamera> {
    let access = CameraAccess::new(server.device_url(), None, None, None, None);
    let camera = OnvifCamera::connect(&access.expect("an access")).await;
    Arc::new(camera.expect("it connects"))
}

#[tokio::test]
async fn a_camera_turns_to_its_presets_and_says_where_it_is() {
    let server = MockServer::start().await.expect("a device");
    let camera = connected(&server).await;
    let abilities = camera.abilities();
    assert!(abilities.has_presets && abilities.has_absolute && abilities.has_continuous);
    assert!(camera.clock_offset().abs() <= 2, "{}", camera.clock_offset());
    assert!(!camera.identity().await.expect("it says so").is_empty());
    let presets = camera.presets().await.expect("it has some");
    let names: Vec<_> = presets.iter().map(|preset| preset.name.as_str()).collect();
    assert_eq!(names, ["Home", "Door"]);
    for preset in &presets {
        camera.go_to_preset(&preset.token).await.expect("it turns");
        let status = camera.status().await.expect("it says so");
        let (at, expected) = (status.position.expect("a place"), preset.position);
        assert!(expected.expect("a place").is(&at), "{expected:?} {at:?}");
    }
}

#[tokio::test]
async fn a_camera_moves_to_a_position_and_is_stopped() {
    let server = MockServer::start().await.expect("a device");
    let camera = connected(&server).await;
    let position = Position { pan: 0.25, tilt: -0.5, zoom: 0.5 };
    camera.go_to(position).await.expect("it turns");
    let at = camera.status().await.expect("it says so").position.expect("a place");
    assert!(position.is(&at), "{at:?}");
    camera.drive(Position { pan: 0.5, ..Position::default() }).await.expect("it moves");
    camera.stop().await.expect("it stops");
    // A camera without `Stop` is stopped with the speed zero.
    server.inject_fault("Stop", "ter:ActionNotSupported", "no such operation");
    camera.stop().await.expect("it stops all the same");
    // A camera that refuses the time limit of a movement moves without one.
    server.inject_fault("ContinuousMove", "ter:InvalidArgVal", "Timeout");
    camera.drive(Position { tilt: 0.5, ..Position::default() }).await.expect("it moves");
}

#[tokio::test]
async fn a_login_is_accepted_by_its_digest_and_a_wrong_password_has_a_reason() {
    let server = MockServer::builder().enforce_auth(true).start().await.expect("a device");
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, text: &str| -> Option<PathBuf> {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        Some(path)
    };
    let connect = async |user: &str, password: Option<PathBuf>| {
        let user = (!user.is_empty()).then(|| user.to_owned());
        let access = CameraAccess::new(server.device_url(), user, password, None, None);
        OnvifCamera::connect(&access.expect("an access")).await
    };
    let camera = connect("admin", file("right", "admin\n")).await.expect("it is let in");
    assert_eq!(camera.presets().await.expect("it has some").len(), 2);
    for (user, password) in
        [("admin", file("wrong", "hunter2")), ("stranger", file("right", "admin")), ("", None)]
    {
        let error = connect(user, password).await.expect_err("it is not let in");
        assert!(matches!(error, LinkError::LoginRejected { .. }), "{error}");
        assert!(!error.to_string().contains("hunter2"), "{error}");
    }
}

#[tokio::test]
async fn a_picture_is_taken() {
    let server = MockServer::start().await.expect("a device");
    let picture = connected(&server).await.snapshot().await.expect("a picture");
    assert!(picture.content.len() > 1_000);
    assert!(["jpg", "png", "bmp"].contains(&picture.extension));
}

#[tokio::test]
async fn motion_begins_and_ends_also_after_a_fault() {
    let server = MockServer::start().await.expect("a device");
    let mut events = MotionEvents::new(&connected(&server).await);
    for expected in [true, false, true] {
        let seen = async { while events.next().await != Ok(expected) {} };
        tokio::time::timeout(PATIENCE, seen).await.expect("the device alternates");
    }
    server.inject_fault("PullMessagesRequest", "s:Receiver", "the subscription is gone");
    events.next().await.expect_err("the fault");
    let seen = async { while events.next().await != Ok(true) {} };
    tokio::time::timeout(PATIENCE, seen).await.expect("it subscribes anew");
    events.close().await;
}

#[tokio::test]
async fn a_device_is_found_by_its_answer() {
    let device = oxvif::discovery::DiscoveredDevice {
        endpoint: "urn:uuid:0a6dc791-2be6-4991-9af1-454778a1917a".to_owned(),
        types: vec!["dn:NetworkVideoTransmitter".to_owned()],
        scopes: vec![
            "onvif://www.onvif.org/name/Hall%20Camera".to_owned(),
            "onvif://www.onvif.org/hardware/IPC-42".to_owned(),
        ],
        xaddrs: vec!["http://127.0.0.1:8899/onvif/device_service".to_owned()],
    };
    let responder =
        DiscoveryResponder::spawn("127.0.0.1:0", false, device).await.expect("a socket");
    let found = discover(responder.local_addr(), Duration::from_secs(1)).await.expect("asked");
    responder.shutdown().await;
    let found: Vec<_> =
        found.iter().map(|one| (one.name.as_str(), one.hardware.as_str(), &*one.address)).collect();
    assert_eq!(found, [("Hall Camera", "IPC-42", "127.0.0.1:8899")]);
}
