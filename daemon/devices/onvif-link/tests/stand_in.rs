//! Tests with a stand-in for a camera, which has the peculiarities of real ones.

#[path = "../../../../tests/support/onvif_camera.rs"]
#[allow(dead_code, reason = "what other tests need of a camera besides")]
mod onvif_camera;

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use onvif_camera::StandIn;
use onvif_link::{CameraAccess, LinkError, MotionEvents, OnvifCamera, Position, StopOnDrop};
use rcgen::{CertificateParams, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::PrivateKeyDer;
use tempfile::TempDir;
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;

const PATIENCE: Duration = Duration::from_secs(60);
const YEAR: i64 = 365 * 86_400;

/// Returns a folder with the file of a password.
fn secret() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("password");
    std::fs::write(&file, "hunter2\n").expect("a file");
    (folder, file)
}

async fn connect(camera: &StandIn) -> Result<Arc<OnvifCamera>, LinkError> {
    let (_folder, password) = secret();
    let address = camera.address.to_string();
    let access = CameraAccess::new(&address, Some("me".to_owned()), Some(password), None, None);
    OnvifCamera::connect(&access.expect("an access")).await.map(Arc::new)
}

#[tokio::test]
async fn a_camera_behind_a_router_is_reached_at_the_host_of_the_config() {
    let stand_in = StandIn::start();
    let camera = connect(&stand_in).await.expect("it connects");
    let names: Vec<_> =
        camera.presets().await.expect("presets").into_iter().map(|p| p.name).collect();
    assert_eq!(names, ["Hall", "Door"]);
    camera.go_to_preset("2").await.expect("it turns");
    assert_eq!(stand_in.behavior().position, (-0.5, 0.0));
    // The profile with motors is used, although another one comes first.
    let requests = stand_in.behavior();
    let (_, body) = requests.requests.iter().find(|(name, _)| name == "GotoPreset").expect("asked");
    assert!(body.contains("ProfileToken>main</"), "{body}");
}

#[tokio::test]
async fn a_clock_that_is_a_year_behind_is_met_also_after_it_is_set() {
    let stand_in = StandIn::start();
    (stand_in.behavior().clock_offset, stand_in.behavior().checks_clock) = (-YEAR, true);
    let camera = connect(&stand_in).await.expect("it connects");
    assert!((camera.clock_offset() + YEAR).abs() <= 2, "{}", camera.clock_offset());
    stand_in.behavior().clock_offset = 3 * YEAR;
    assert_eq!(camera.presets().await.expect("it logs in").len(), 2);
}

#[tokio::test]
async fn a_rejected_login_has_a_reason_without_the_password() {
    let stand_in = StandIn::start();
    stand_in.behavior().rejects_login = true;
    let error = connect(&stand_in).await.expect_err("it is rejected");
    assert!(matches!(error, LinkError::LoginRejected { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("the user `me`, or the password in /"), "{text}");
    assert!(!text.contains("hunter2") && !format!("{error:?}").contains("hunter2"), "{text}");
    // A camera locks a user out after some attempts.
    assert!(stand_in.count("GetServices") <= 1, "{}", stand_in.count("GetServices"));
    let requests = format!("{:?}", stand_in.behavior().requests);
    assert!(!requests.contains("hunter2"), "the password itself is never sent");
}

#[tokio::test]
async fn http_digest_is_answered_and_basic_without_tls_refused() {
    let stand_in = StandIn::start();
    stand_in.behavior().wants_digest = true;
    let camera = connect(&stand_in).await.expect("it connects");
    camera.snapshot().await.expect("a picture");
    stand_in.behavior().wants_digest = false;
    stand_in.behavior().wants_basic = true;
    let error = connect(&stand_in).await.expect_err("the password would be readable");
    assert!(error.to_string().contains("HTTP Basic"), "{error}");
}

#[tokio::test]
async fn an_old_camera_that_knows_only_capabilities_is_used() {
    let stand_in = StandIn::start();
    stand_in.behavior().unsupported = ["GetServices", "GetNodes"].into();
    let camera = connect(&stand_in).await.expect("it connects");
    assert!(camera.abilities().has_presets && camera.has_events());
}

#[tokio::test]
async fn garbage_has_a_reason_wherever_it_comes() {
    let stand_in = StandIn::start();
    for operation in ["GetSystemDateAndTime", "GetServices", "GetProfiles", "GetNodes"] {
        stand_in.behavior().garbles = [operation].into();
        let error = connect(&stand_in).await.expect_err(operation);
        assert!(
            matches!(&error, LinkError::Unreadable { call, .. } if call == operation),
            "{error}"
        );
    }
    stand_in.behavior().garbles.clear();
    let camera = connect(&stand_in).await.expect("it connects");
    stand_in.behavior().garbles =
        ["GetPresets", "GetStatus", "GetSnapshotUri", "PullMessages", "picture"].into();
    camera.presets().await.expect_err("garbage");
    camera.status().await.expect_err("garbage");
    camera.snapshot().await.expect_err("garbage");
    MotionEvents::new(&camera).next().await.expect_err("garbage");
    stand_in.behavior().garbles = ["picture"].into();
    let error = camera.snapshot().await.expect_err("garbage").to_string();
    assert!(error.contains("it is no picture, but 25 bytes of `text/xml`"), "{error}");
}

#[tokio::test]
async fn a_picture_without_end_is_cut_off() {
    let stand_in = StandIn::start();
    stand_in.behavior().picture_bytes = Some(17 << 20);
    let camera = connect(&stand_in).await.expect("it connects");
    let error = camera.snapshot().await.expect_err("it is too long").to_string();
    assert!(error.contains("it is longer than 16777216 bytes"), "{error}");
}

#[tokio::test]
async fn a_camera_without_stop_is_stopped_with_the_speed_zero() {
    let stand_in = StandIn::start();
    stand_in.behavior().unsupported = ["Stop"].into();
    let camera = connect(&stand_in).await.expect("it connects");
    camera.drive(Position { pan: 0.5, ..Position::default() }).await.expect("it moves");
    // Whoever is interrupted in the middle of a movement stops the camera.
    drop(StopOnDrop::new(&camera));
    let stopped = async {
        while stand_in.count("ContinuousMove") < 2 {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(PATIENCE, stopped).await.expect("it is stopped");
    let behavior = stand_in.behavior();
    let (_, body) = behavior.requests.last().expect("a request");
    assert!(body.contains("PanTilt x=\"0\" y=\"0\""), "{body}");
    assert!(!body.contains("Timeout"), "{body}");
}

#[tokio::test]
async fn motion_is_heard_also_after_the_subscription_is_lost() {
    let stand_in = StandIn::start();
    let camera = connect(&stand_in).await.expect("it connects");
    let mut events = MotionEvents::new(&camera);
    assert_eq!(events.next().await, Ok(false));
    stand_in.report_motion(true);
    assert_eq!(events.next().await, Ok(true));
    stand_in.behavior().unsupported = ["PullMessages"].into();
    events.next().await.expect_err("the subscription is lost");
    stand_in.behavior().unsupported.clear();
    stand_in.report_motion(false);
    assert_eq!(events.next().await, Ok(false));
    assert_eq!(stand_in.count("CreatePullPointSubscription"), 2);
    let behavior = stand_in.behavior();
    let (_, pull) =
        behavior.requests.iter().find(|(name, _)| name == "PullMessages").expect("a pull");
    assert!(pull.contains(">7</p:Id>"), "the reference is handed back: {pull}");
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_never_answers_is_given_up() {
    let stand_in = StandIn::start();
    stand_in.behavior().silent = ["GetSystemDateAndTime"].into();
    let error = connect(&stand_in).await.expect_err("it is silent");
    assert!(matches!(error, LinkError::TimedOut { .. }), "{error}");
}

/// Starts a TLS server before a camera. Returns its port, and its certificate and the certificate's
/// fingerprint.
async fn encrypted(camera: &StandIn) -> (u16, String, String) {
    let key = KeyPair::generate().expect("a key");
    // Cameras certify themselves, for names that nobody uses.
    let params = CertificateParams::new(vec!["ipcam".to_owned()]).expect("a name");
    let certificate = params.self_signed(&key).expect("signed");
    let mut fingerprint = String::new();
    for byte in ring::digest::digest(&ring::digest::SHA256, certificate.der()).as_ref() {
        write!(fingerprint, "{byte:02X}:").expect("memory");
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let settings = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_no_client_auth()
        .with_single_cert(
            vec![certificate.der().clone()],
            PrivateKeyDer::try_from(key.serialize_der()).expect("a key"),
        );
    let acceptor = TlsAcceptor::from(Arc::new(settings.expect("settings")));
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let (port, camera) = (listener.local_addr().expect("an address").port(), camera.address);
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let acceptor = acceptor.clone();
            tokio::spawn(async move {
                let mut client = acceptor.accept(stream).await?;
                let mut camera = TcpStream::connect(camera).await?;
                tokio::io::copy_bidirectional(&mut client, &mut camera).await
            });
        }
    });
    (port, certificate.pem(), fingerprint)
}

#[tokio::test]
async fn a_camera_with_tls_is_known_by_its_certificate_alone() {
    let stand_in = StandIn::start();
    let (port, certificate, fingerprint) = encrypted(&stand_in).await;
    let (folder, _) = secret();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path
    };
    let address = format!("https://127.0.0.1:{port}");
    let access = |ca: Option<PathBuf>, fingerprint: Option<&str>| {
        CameraAccess::new(&address, None, None, ca, fingerprint).expect("an access")
    };
    for known in
        [access(Some(file("camera.pem", &certificate)), None), access(None, Some(&fingerprint))]
    {
        let camera = OnvifCamera::connect(&known).await.expect("it is known");
        assert_eq!(camera.presets().await.expect("presets").len(), 2);
    }
    let (_, other, _) = encrypted(&stand_in).await;
    for unknown in
        [access(Some(file("other.pem", &other)), None), access(None, Some(&"00".repeat(32)))]
    {
        let error = OnvifCamera::connect(&unknown).await.expect_err("a stranger").to_string();
        assert!(error.contains("invalid peer certificate"), "{error}");
    }
    let empty = access(Some(file("empty.pem", "")), None);
    let error = OnvifCamera::connect(&empty).await.expect_err("no certificate").to_string();
    assert!(error.contains("empty.pem: there is none"), "{error}");
}

/// Writes every kind of request into the folder of the environment variable `ONVIF_REQUESTS`, for
/// `tests/peers/onvif/validate.py`.
#[tokio::test]
async fn every_request_is_written_for_the_validation_by_the_official_schemas() {
    let stand_in = StandIn::start();
    let camera = connect(&stand_in).await.expect("it connects");
    camera.identity().await.expect("asked");
    camera.presets().await.expect("asked");
    camera.go_to_preset("1").await.expect("asked");
    camera.go_to(Position { pan: 0.5, tilt: -1.0, zoom: 0.25 }).await.expect("asked");
    camera.drive(Position { pan: 0.5, tilt: 0.0, zoom: 0.0 }).await.expect("asked");
    camera.stop().await.expect("asked");
    camera.status().await.expect("asked");
    camera.snapshot().await.expect("asked");
    let video = camera.video_stream().await.expect("asked");
    assert_eq!(video.address(), "rtsp://127.0.0.1:554/live", "at the host that was asked");
    let mut events = MotionEvents::new(&camera);
    events.next().await.expect("asked");
    events.close().await;
    stand_in.behavior().unsupported = ["GetServices"].into();
    connect(&stand_in).await.expect("it connects");
    let Some(folder) = std::env::var_os("ONVIF_REQUESTS").map(PathBuf::from) else { return };
    for (name, body) in stand_in.behavior().requests.iter().filter(|(_, body)| !body.is_empty()) {
        std::fs::write(folder.join(format!("{name}.xml")), body).expect("written");
    }
}
