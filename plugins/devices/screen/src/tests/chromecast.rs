//! The driver `cast` with a stand-in for a Chromecast, by what the device shows.

use serde_json::json;

use super::cast_device::{CastDevice, media_server};
use super::*;

fn screen_with(device: &CastDevice, media: Value) -> Screen {
    let address = device.address.to_string();
    let config = json!({
        "location": "lab", "address": address, "media": media, "volume": 0.5,
    });
    screen(&blueprint("cast", config, Resources::default())).expect("a screen")
}

#[tokio::test]
async fn a_chromecast_shows_media_and_reports_what_it_cannot_show() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let media = json!({
        "film": format!("{server}/film.mp4"),
        "picture": { "address": format!("{server}/picture.png"), "type": "image/png" },
        "missing": format!("{server}/missing.mp4"),
    });
    let mut screen = screen_with(&device, media);
    set_up(&mut screen).await;
    assert_eq!(device.app(), None, "connecting changes nothing");
    for (medium, path) in [("film", "film.mp4"), ("picture", "picture.png")] {
        assert_eq!(call(&mut screen, "show", Some(medium)).await.as_deref(), Ok("shows it"));
        assert_eq!(device.shows(), Some(format!("{server}/{path}")));
        assert!(text_of(&screen).contains(&format!("(presented {medium} lab)")));
    }
    assert_eq!(device.state().volume, 0.5);
    let failure = call(&mut screen, "show", Some("missing")).await.expect_err("missing");
    assert!(failure.contains("the Chromecast cannot fetch or play it"), "{failure}");
    assert_eq!(device.app(), None, "no error stays on the screen");
    until(&mut screen, "offers present").await;

    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.end_medium("FINISHED");
    let repeated = async {
        while device.count("LOAD") < 5 || device.shows().is_none() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(20), repeated).await.expect("a film repeats");
    assert_eq!(call(&mut screen, "hide", None).await.as_deref(), Ok("is dark"));
    assert_eq!(device.app(), None);
}

#[tokio::test]
async fn a_medium_that_is_lost_as_soon_as_it_was_shown_is_noticed() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let media =
        json!({ "film": format!("{server}/film.mp4"), "missing": format!("{server}/no.mp4") });
    let mut screen = screen_with(&device, media);
    set_up(&mut screen).await;
    // The checks began before the method, as they do in a daemon.
    let event = screen.next_event().expect("a screen has events");
    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.change_app(None);
    let event = tokio::time::timeout(Duration::from_secs(20), event).await.expect("it is noticed");
    event(&mut screen);
    assert!(!text_of(&screen).contains("presented film"), "{}", text_of(&screen));
    let event = screen.next_event().expect("a screen has events");
    call(&mut screen, "show", Some("missing")).await.expect_err("missing");
    assert!(!text_of(&screen).contains("offers present"), "until the next check");
    let event = tokio::time::timeout(Duration::from_secs(20), event).await.expect("it works");
    event(&mut screen);
    assert!(text_of(&screen).contains("offers present"));
}

#[tokio::test]
async fn a_chromecast_that_others_use_and_one_that_is_unplugged_are_noticed() {
    let (device, server) = (CastDevice::start().await, media_server().await);
    let mut screen = screen_with(&device, json!({ "film": format!("{server}/film.mp4") }));
    set_up(&mut screen).await;
    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.change_app(Some("YouTube"));
    until(&mut screen, "!presented film").await;
    assert_eq!(device.app(), Some("YouTube"), "that of others is left alone");
    assert!(text_of(&screen).contains("offers present"));

    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.change_app(None);
    until(&mut screen, "!presented film").await;

    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.set_television(false, false);
    until(&mut screen, "!presented film").await;
    device.set_television(true, false);

    call(&mut screen, "show", Some("film")).await.expect("shown");
    device.hang_up();
    until(&mut screen, "!presented film").await;
    until(&mut screen, "offers present").await;
    call(&mut screen, "show", Some("film")).await.expect("shown again");
    drop(screen);
    let stopped = async {
        while device.app().is_some() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(20), stopped).await.expect("it ends with the screen");
}
