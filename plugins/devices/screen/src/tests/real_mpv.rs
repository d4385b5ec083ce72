//! The driver `mpv` with a real mpv, by the pixels of a display.

use serde_json::json;

use super::stage::{BLUE, RED, Stage};
use super::*;

/// An argument that tells the processes of one test from others.
fn mark(stage: &Stage) -> String {
    format!("--title={}", stage.folder.path().display())
}

fn screen_with(stage: &Stage, media: Value) -> Screen {
    let arguments = [mark(stage), "--vo=x11".to_owned(), "--ao=null".to_owned()];
    let config = json!({
        "location": "lab", "media": media, "display": stage.display, "arguments": arguments,
    });
    screen(&blueprint("mpv", config, Resources::default())).expect("a screen")
}

#[tokio::test]
async fn mpv_shows_films_and_pictures_and_reports_what_it_cannot_show() {
    let Some(stage) = Stage::set(&["mpv"]) else { return };
    let media = json!({
        "film": stage.file("film.y4m", &stage::film(82, 90, 240)),
        "picture": stage.file("picture.bmp", &stage::picture(BLUE)),
        "text": stage.file("film.mp4", b"This is a text."),
        "gone": stage.file("gone.mp4", b""),
        "unreachable": "http://127.0.0.1:1/film.mp4",
    });
    let mut screen = screen_with(&stage, media);
    std::fs::remove_file(stage.folder.path().join("gone.mp4")).expect("removed");
    set_up(&mut screen).await;
    stage.is_dark().await;
    for (medium, color) in [("film", RED), ("picture", BLUE)] {
        assert_eq!(call(&mut screen, "show", Some(medium)).await.as_deref(), Ok("shows it"));
        stage.shows(color).await;
        assert!(text_of(&screen).contains(&format!("(presented {medium} lab)")));
    }
    // The film has two seconds, and begins again.
    call(&mut screen, "show", Some("film")).await.expect("shown");
    let longer =
        tokio::time::timeout(Duration::from_secs(5), until(&mut screen, "!presented film"));
    assert!(longer.await.is_err(), "it ends");
    stage.shows(RED).await;
    for (medium, expected) in [
        ("text", "film.mp4: unrecognized file format"),
        ("gone", "gone.mp4: loading failed"),
        ("unreachable", "play http://127.0.0.1:1/film.mp4: loading failed"),
    ] {
        let failure = call(&mut screen, "show", Some(medium)).await.expect_err(medium);
        assert!(failure.contains(expected), "{failure}");
        until(&mut screen, "offers present").await;
        stage.is_dark().await;
    }
    call(&mut screen, "show", Some("film")).await.expect("shown");
    stage.shows(RED).await;
    assert_eq!(call(&mut screen, "hide", None).await.as_deref(), Ok("is dark"));
    stage.is_dark().await;
}

#[tokio::test]
async fn mpv_that_dies_is_noticed_and_started_again_and_nothing_is_left_of_it() {
    let Some(stage) = Stage::set(&["mpv"]) else { return };
    let film = stage.file("film.y4m", &stage::film(82, 90, 240));
    let mut screen = screen_with(&stage, json!({ "film": film }));
    set_up(&mut screen).await;
    call(&mut screen, "show", Some("film")).await.expect("shown");
    stage.shows(RED).await;
    let [pid] = stage::processes(&mark(&stage))[..] else { panic!("one mpv") };
    stage::kill(pid);
    until(&mut screen, "!presented film").await;
    until(&mut screen, "offers present").await;
    call(&mut screen, "show", Some("film")).await.expect("shown again");
    stage.shows(RED).await;
    drop(screen);
    stage::nothing_is_left(&mark(&stage)).await;
}
