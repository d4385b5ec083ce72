//! The client of Chromecasts with a stand-in for one: media that are shown and lost, in every way in
//! which a device reports it, and devices that are silent, hostile or gone.

#[path = "../../../../tests/support/cast_device.rs"]
mod cast_device;

use std::time::Duration;

use cast_device::{CastDevice, media_server};
use cast_link::{CastAddress, CastError, CastMedium, Chromecast, MediumState, TelevisionState};
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpListener;

/// Time within which an event of the stand-in has to arrive.
const PATIENCE: Duration = Duration::from_secs(20);

fn address(device: &CastDevice) -> CastAddress {
    CastAddress::parse(&device.address.to_string()).expect("an address")
}

async fn connect(device: &CastDevice) -> Chromecast {
    Chromecast::connect(&address(device)).await.expect("it is there")
}

fn film(server: &str) -> CastMedium {
    medium(&format!("{server}/film.mp4"), "video/mp4")
}

fn medium(address: &str, content_type: &str) -> CastMedium {
    CastMedium { address: address.to_owned(), content_type: content_type.to_owned() }
}

/// Follows the device until `is_so`.
async fn until(cast: &mut Chromecast, is_so: impl Fn(&Chromecast) -> bool) {
    let following = async {
        while !is_so(cast) {
            let pause = Duration::from_millis(20);
            if let Ok(error) = tokio::time::timeout(pause, cast.failed()).await {
                panic!("{error}");
            }
        }
    };
    let done = tokio::time::timeout(PATIENCE, following).await;
    assert!(done.is_ok(), "{:?}", cast.medium());
}

#[tokio::test]
async fn a_medium_is_shown_replaced_and_stopped() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut cast = connect(&device).await;
    assert_eq!((device.app(), cast.medium()), (None, &MediumState::None));
    cast.stop().await.expect("there is nothing to stop");

    cast.load(&film(&server)).await.expect("shown");
    assert_eq!(device.shows(), Some(format!("{server}/film.mp4")));
    assert_eq!(cast.medium(), &MediumState::Shown);
    let picture = medium(&format!("{server}/picture.png"), "image/png");
    for next in [&picture, &picture, &film(&server)] {
        cast.load(next).await.expect("shown");
        assert_eq!(device.shows().as_ref(), Some(&next.address));
        cast.refresh().await.expect("asked");
        assert_eq!(cast.medium(), &MediumState::Shown);
    }
    assert_eq!(device.count("LAUNCH"), 1, "the app runs already");

    cast.set_volume(0.25).await.expect("set");
    assert_eq!(device.state().volume, 0.25);
    assert_eq!(cast.receiver().volume, Some(0.25));

    cast.stop().await.expect("stopped");
    assert_eq!((device.app(), cast.medium()), (None, &MediumState::None));
    cast.load(&film(&server)).await.expect("shown again");
    cast.close().await;
    assert_eq!(device.shows(), Some(format!("{server}/film.mp4")), "it is left as it is");
}

#[tokio::test]
async fn a_medium_that_cannot_be_shown_has_a_reason() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut cast = connect(&device).await;
    for address in [format!("{server}/missing.mp4"), "http://127.0.0.1:1/film.mp4".to_owned()] {
        let error = cast.load(&medium(&address, "video/mp4")).await.expect_err("not there");
        let expected =
            format!("show {address}: the Chromecast cannot fetch or play it (error 905)");
        assert_eq!((error.is_of_command(), error.to_string()), (true, expected));
        cast.stop().await.expect("stopped");
        assert_eq!(device.app(), None, "no error stays on the screen");
    }
    device.state().refuses_launch = true;
    let error = cast.load(&film(&server)).await.expect_err("it starts no app").to_string();
    assert!(error.contains("does not start its media receiver: LAUNCH_ERROR (NOT_FOUND)"));
    device.state().refuses_launch = false;
    cast.load(&film(&server)).await.expect("the connection works");
}

#[tokio::test]
async fn each_loss_of_a_medium_is_noticed_and_what_others_show_is_left_alone() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut cast = connect(&device).await;
    type Loss = (&'static str, fn(&CastDevice), Option<&'static str>);
    let losses: [Loss; 5] = [
        ("its app was closed", |device| device.change_app(None), None),
        (
            "something else is shown in its place: YouTube",
            |device| device.change_app(Some("YouTube")),
            Some("YouTube"),
        ),
        ("the Chromecast cannot fetch or play it", |device| device.end_medium("ERROR"), None),
        ("it was stopped at another device", |device| device.end_medium("CANCELLED"), None),
        (
            "something else was loaded",
            |device| device.end_medium("INTERRUPTED"),
            Some("Default Media Receiver"),
        ),
    ];
    for (reason, lose, left) in losses {
        cast.load(&film(&server)).await.expect("shown");
        lose(&device);
        until(&mut cast, |cast| {
            matches!(cast.medium(),
                MediumState::Lost(why) | MediumState::Replaced(why) if why == reason)
        })
        .await;
        cast.stop().await.expect("stopped");
        assert_eq!(device.app(), left, "{reason}");
    }
}

#[tokio::test]
async fn another_sender_that_loads_a_medium_is_noticed() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let (mut cast, mut other) = (connect(&device).await, connect(&device).await);
    cast.load(&film(&server)).await.expect("shown");
    let picture = medium(&format!("{server}/picture.png"), "image/png");
    other.load(&picture).await.expect("shown");
    until(&mut cast, |cast| matches!(cast.medium(), MediumState::Replaced(_))).await;
    cast.stop().await.expect("stopped");
    assert_eq!(device.shows(), Some(picture.address), "that of the other sender is left");
}

#[tokio::test]
async fn a_film_that_has_ended_is_repeated() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut cast = connect(&device).await;
    for _ in 0..2 {
        match cast.medium() {
            MediumState::Ended => cast.repeat().await.expect("repeated"),
            _ => cast.load(&film(&server)).await.expect("shown"),
        }
        device.end_medium("FINISHED");
        until(&mut cast, |cast| *cast.medium() == MediumState::Ended).await;
        cast.refresh().await.expect("asked");
        assert_eq!(cast.medium(), &MediumState::Ended);
    }
    assert_eq!(device.count("LOAD"), 2);
}

#[tokio::test]
async fn what_the_television_shows_is_known_where_the_device_says_it() {
    let device = CastDevice::start().await;
    let mut cast = connect(&device).await;
    assert_eq!(cast.television(), TelevisionState::Unknown);
    for (shows_device, is_standby, expected) in [
        (true, false, TelevisionState::ShowsChromecast),
        (false, false, TelevisionState::OtherInput),
        (false, true, TelevisionState::Standby),
    ] {
        device.set_television(shows_device, is_standby);
        until(&mut cast, |cast| cast.television() == expected).await;
    }
}

#[tokio::test]
async fn a_device_that_closes_is_reported() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut cast = connect(&device).await;
    cast.load(&film(&server)).await.expect("shown");
    device.hang_up();
    let error = tokio::time::timeout(PATIENCE, cast.failed()).await.expect("it is noticed");
    assert!(matches!(error, CastError::Closed { .. } | CastError::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains(&device.address.to_string()), "{error}");
}

#[tokio::test]
async fn a_silent_device_is_given_up_after_two_heartbeats() {
    let device = CastDevice::start().await;
    let mut cast = connect(&device).await;
    device.state().is_silent = true;
    let error = tokio::time::timeout(PATIENCE, cast.failed()).await.expect("it is noticed");
    assert_eq!(
        error.to_string(),
        format!("reach the Chromecast at {}: it has been silent for 12s", device.address)
    );
    assert!(!error.is_of_command());
}

#[tokio::test]
async fn what_is_no_chromecast_is_said() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let port = listener.local_addr().expect("an address").port();
    let other = CastAddress::parse(&format!("127.0.0.1:{port}")).expect("an address");
    let answering = tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.expect("a client");
        let mut greeting = [0; 64];
        let _ = stream.read(&mut greeting).await;
        let _ = tokio::io::AsyncWriteExt::write_all(&mut stream, b"HTTP/1.1 400\r\n\r\n").await;
    });
    let error = Chromecast::connect(&other).await.expect_err("no TLS").to_string();
    assert!(error.contains("there is no TLS"), "{error}");
    answering.await.expect("it answers");
    let error = Chromecast::connect(&other).await.expect_err("nobody listens").to_string();
    assert!(error.contains(&format!("reach the Chromecast at 127.0.0.1:{port}")), "{error}");
}

#[tokio::test]
async fn a_flood_of_garbage_ends_the_connection() {
    let device = CastDevice::start().await;
    let mut cast = connect(&device).await;
    device.send_raw(&[0, 1, 0, 1]);
    let error = tokio::time::timeout(PATIENCE, cast.failed()).await.expect("it is noticed");
    assert!(error.to_string().ends_with("it is longer than 64 KiB"), "{error}");
    let mut cast = connect(&device).await;
    device.send_raw(&[0, 0, 0, 1, 0x13]);
    let error = tokio::time::timeout(PATIENCE, cast.failed()).await.expect("it is noticed");
    assert!(error.to_string().contains("of the unknown kind 3"), "{error}");
}
