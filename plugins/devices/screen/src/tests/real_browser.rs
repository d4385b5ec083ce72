//! The driver `browser` with a real Chromium, by the pixels of a display.

use serde_json::json;

use super::stage::{BLUE, RED, Stage};
use super::*;

/// An argument that tells the processes of one test from others.
fn mark(stage: &Stage) -> String {
    format!("--althing-test={}", stage.folder.path().display())
}

fn screen_with(stage: &Stage, media: Value) -> Screen {
    // Machines of tests have neither user namespaces nor sound.
    let arguments = [mark(stage), "--no-sandbox".to_owned(), "--mute-audio".to_owned()];
    let config = json!({
        "location": "lab", "media": media, "display": stage.display, "arguments": arguments,
    });
    screen(&blueprint("browser", config, Resources::default())).expect("a screen")
}

#[tokio::test]
async fn the_browser_shows_each_kind_of_medium() {
    let Some(stage) = Stage::set(&["chromium", "mpv"]) else { return };
    let server = stage::serve().await;
    let raw = stage.file("film.y4m", &stage::film(82, 90, 240));
    let film = stage.folder.path().join("a film ü.webm");
    stage::encode(&raw, &film);
    let media = json!({
        "text": "█████\n█████\n█████",
        "picture": stage.file("picture #1.bmp", &stage::picture(BLUE)),
        "film": film,
        "pdf": stage.file("slides.pdf", &stage::pdf()),
        "page": format!("{server}/red"),
        "onward": format!("{server}/onward"),
        "logo": format!("{server}/logo"),
        "alert": format!("{server}/alert"),
    });
    let mut screen = screen_with(&stage, media);
    set_up(&mut screen).await;
    stage.is_dark().await;
    for (medium, color) in [
        ("text", (255, 255, 255)),
        ("picture", BLUE),
        ("film", RED),
        ("pdf", BLUE),
        ("page", RED),
        ("logo", BLUE),
        ("onward", RED),
        ("logo", BLUE),
        ("page", RED),
        ("alert", BLUE),
    ] {
        let shown = call(&mut screen, "show", Some(medium)).await;
        assert_eq!(shown.as_deref(), Ok("shows it"), "{medium}");
        stage.shows(color).await;
        assert!(text_of(&screen).contains(&format!("(presented {medium} lab)")));
        if matches!(medium, "page") {
            assert_eq!(stage.colors(), [color; 5], "no margin is left");
        }
    }
    assert_eq!(call(&mut screen, "hide", None).await.as_deref(), Ok("is dark"));
    stage.is_dark().await;
}

#[tokio::test]
async fn what_the_browser_cannot_show_fails_with_a_reason() {
    let Some(stage) = Stage::set(&["chromium"]) else { return };
    let server = stage::serve().await;
    let media = json!({
        "missing": format!("{server}/nothing"),
        "unreachable": "http://127.0.0.1:2/",
        "picture": stage.file("picture.png", b"This is a text."),
        "film": stage.file("film.mp4", b"This is a text."),
        "pdf": stage.file("slides.pdf", b"This is a text."),
        "gone": stage.file("gone.html", b""),
        "archive": stage.file("archive.zip", b"PK"),
        "page": format!("{server}/red"),
    });
    let mut screen = screen_with(&stage, media);
    std::fs::remove_file(stage.folder.path().join("gone.html")).expect("removed");
    set_up(&mut screen).await;
    for (medium, expected) in [
        ("missing", "/nothing: its server answers with HTTP status 404"),
        ("unreachable", "load http://127.0.0.1:2/: net::ERR_CONNECTION_REFUSED"),
        ("picture", "it is not a picture that the browser can show"),
        ("film", "its film: "),
        ("pdf", "slides.pdf is not a PDF"),
        ("gone", "gone.html: net::ERR_FILE_NOT_FOUND"),
        ("archive", "archive.zip: "),
    ] {
        let failure = call(&mut screen, "show", Some(medium)).await.expect_err(medium);
        assert!(failure.contains(expected), "{failure}");
        until(&mut screen, "offers present").await;
        stage.is_dark().await;
    }
    let home = std::env::home_dir().expect("a home");
    assert!(!home.join("Downloads/archive.zip").exists(), "nothing is stored");
    call(&mut screen, "show", Some("page")).await.expect("it works as before");
    stage.shows(RED).await;
}

#[tokio::test]
async fn a_page_that_is_not_shown_any_more_is_noticed() {
    let Some(stage) = Stage::set(&["chromium"]) else { return };
    let (server, other) = (stage::serve().await, stage::serve().await);
    let media = json!({
        "leaves": format!("{server}/leaves?{other}/blue"),
        "stays": format!("{server}/leaves?/blue"),
        "hangs": format!("{server}/hangs"),
    });
    let mut screen = screen_with(&stage, media);
    set_up(&mut screen).await;
    call(&mut screen, "show", Some("stays")).await.expect("shown");
    stage.shows(BLUE).await;
    let longer = tokio::time::timeout(Duration::from_secs(3), until(&mut screen, "!presented"));
    assert!(longer.await.is_err(), "a page may change within its server");
    call(&mut screen, "show", Some("leaves")).await.expect("shown");
    until(&mut screen, "!presented leaves").await;
    stage.is_dark().await;
    assert!(text_of(&screen).contains("offers present"));
    call(&mut screen, "show", Some("hangs")).await.expect("shown");
    until(&mut screen, "!presented hangs").await;
    until(&mut screen, "offers present").await;
    stage.is_dark().await;
}

#[tokio::test]
async fn a_browser_that_crashes_is_noticed_and_started_again_and_nothing_is_left_of_it() {
    let Some(stage) = Stage::set(&["chromium"]) else { return };
    let server = stage::serve().await;
    let mut screen = screen_with(&stage, json!({ "page": format!("{server}/red") }));
    set_up(&mut screen).await;
    // The process of the tab, then the browser itself.
    for kind in ["--type=renderer", "--remote-debugging-pipe"] {
        call(&mut screen, "show", Some("page")).await.expect("shown");
        stage.shows(RED).await;
        let of_kind = stage::processes(kind);
        let ours = stage::processes(&mark(&stage));
        let scratch = scratch_of(&ours);
        let folder = stage::processes(&scratch);
        let of_kind = of_kind.into_iter().filter(|pid| ours.contains(pid) || folder.contains(pid));
        of_kind.for_each(stage::kill);
        until(&mut screen, "!presented page").await;
        until(&mut screen, "offers present").await;
        stage::nothing_is_left(&scratch).await;
        assert!(!std::path::Path::new(&scratch).exists(), "the folder of the profile is removed");
    }
    call(&mut screen, "show", Some("page")).await.expect("shown");
    stage.shows(RED).await;
    let scratch = scratch_of(&stage::processes(&mark(&stage)));
    drop(screen);
    stage::nothing_is_left(&mark(&stage)).await;
    stage::nothing_is_left(&scratch).await;
    assert!(!std::path::Path::new(&scratch).exists(), "the folder of the profile is removed");
}

/// Returns the folder of a browser, from the command line of its first process.
fn scratch_of(pids: &[i32]) -> String {
    let line = |pid: &i32| std::fs::read_to_string(format!("/proc/{pid}/cmdline")).ok();
    let folder = |line: String| {
        let profile = line.split('\0').find_map(|word| word.strip_prefix("--user-data-dir="));
        profile?.strip_suffix("/profile").map(str::to_owned)
    };
    pids.iter().filter_map(line).find_map(folder).expect("a browser with a folder")
}
