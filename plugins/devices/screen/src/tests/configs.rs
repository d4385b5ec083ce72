//! The config: what a medium is, and the mistakes.

use std::fs;

use agent::BuildCheck;
use serde_json::json;

use super::*;

fn built(driver: &str, config: Value) -> Result<Screen, String> {
    // The drivers in question need no building.
    let blueprint = blueprint(driver, config, Resources::default());
    screen(&blueprint).map_err(|error| error.to_string())
}

#[test]
fn the_beginning_of_a_medium_says_what_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a.pdf");
    fs::write(&file, "%PDF-1.4").expect("a file");
    let written = file.display().to_string();
    let path = file.canonicalize().expect("a path");
    let text = |text: &str| Content::Text(text.to_owned());
    for (medium, expected) in [
        (json!("Figures of the quarter"), text("Figures of the quarter")),
        (json!("https://example.org/"), Content::Address("https://example.org/".to_owned())),
        (json!({ "text": "https://example.org/" }), text("https://example.org/")),
        (json!(written), Content::File { written: written.clone(), path }),
        (json!({ "text": "/" }), text("/")),
    ] {
        let config = json!({ "location": "lab", "media": { "slides": medium } });
        let screen = built("browser", config).expect("a screen");
        assert_eq!(screen.media.get("slides"), Some(&expected));
    }
}

#[test]
fn the_ending_of_an_address_says_what_a_chromecast_shows() {
    for (medium, expected) in [
        (json!("http://a/b.MP4?x=1.png#y"), "video/mp4"),
        (json!("https://a.org/b/c.jpeg"), "image/jpeg"),
        (json!("https://a.org/live.m3u8"), "application/x-mpegURL"),
        (json!({ "address": "https://a.org/b.mp4", "type": "audio/mpeg" }), "audio/mpeg"),
    ] {
        let config = json!({ "location": "lab", "address": "10.0.0.7", "media": { "m": medium } });
        let screen = built("cast", config).expect("a screen");
        let Some(Content::Fetched { content_type, .. }) = screen.media.get("m") else {
            panic!("{:?}", screen.media)
        };
        assert_eq!(content_type, expected);
    }
}

#[test]
fn every_mistake_of_a_config_is_reported() {
    let pdf = tempfile::Builder::new().suffix(".pdf").tempfile().expect("a file");
    let pdf = pdf.path().display().to_string();
    let media = |medium: Value| json!({ "location": "lab", "media": { "slides": medium } });
    let cast = |medium: Value| json!({ "location": "lab", "media": { "slides": medium }, "address": "10.0.0.7" });
    for (driver, config, expected) in [
        ("browser", media(json!("/no/such.png")), "media.slides: the file /no/such.png cannot be"),
        ("mpv", media(json!("./no/such.mp4")), "media.slides: the file ./no/such.mp4 cannot be"),
        ("browser", media(json!("/")), "media.slides: / is not a file"),
        ("mpv", media(json!("Hello")), "media.slides: mpv shows films and pictures, and no texts"),
        ("mpv", media(json!(pdf)), "`driver = \"browser\"` can"),
        ("browser", media(json!(1)), "write a text, an address, a path, { text"),
        ("browser", media(json!(["./slides.pdf"])), "write a text, an address, a path, { text"),
        ("cast", media(json!(["https://a/b", "video/mp4"])), "write a text, an address, a path"),
        (
            "mpv",
            json!({ "location": "lab", "media": {}, "profile": "/tmp" }),
            "`profile` is for the driver `browser`, and this one is `mpv`",
        ),
        (
            "simulated",
            json!({ "location": "lab", "media": {}, "program": "mpv" }),
            "`program` is for the driver `browser` and `mpv` and `cec`, and this one is `simulated`",
        ),
        (
            "browser",
            json!({ "location": "lab", "media": { "a": "x", "b": { "text": "x" } } }),
            "two `media` with one text cannot be told apart",
        ),
        (
            "browser",
            json!({ "location": "lab", "media": { "A b": "x" } }),
            "`A b` cannot name a medium: use lower",
        ),
        ("cast", media(json!("https://a/b.mp4")), "driver `cast` needs the `address` of the"),
        ("cast", cast(json!("Hello")), "media.slides: a Chromecast fetches its media by itself"),
        ("cast", cast(json!({ "text": "Hello" })), "It shows no texts, and no files of this"),
        ("cast", cast(json!("./a.mp4")), "and no files of this machine"),
        (
            "cast",
            cast(json!("http://localhost:8000/a.mp4")),
            "media.slides: the Chromecast would look for http://localhost:8000/a.mp4 on itself",
        ),
        ("cast", cast(json!("http://127.0.0.1/a.mp4")), "write the IP address of the machine with"),
        (
            "cast",
            cast(json!({ "address": "http://[::1]:80/a", "type": "video/mp4" })),
            "on itself: write the IP address",
        ),
        ("cast", cast(json!("https://a/b.pdf")), "the ending of https://a/b.pdf does not say what"),
        ("cast", cast(json!({ "address": "https://a/b", "type": "film" })), "the type `film` is"),
        ("browser", media(json!({ "address": "https://a", "type": "video/mp4" })), "`type` is for"),
        (
            "cast",
            json!({ "location": "lab", "media": {}, "address": "https://10.0.0.7" }),
            "the address `https://10.0.0.7` is a URL; write HOST or HOST:PORT",
        ),
        (
            "cast",
            json!({ "location": "lab", "media": {}, "address": "10.0.0.7", "volume": 30 }),
            "`volume` is a share from 0.0 to 1.0",
        ),
        ("cec", media(json!("Hello")), "and nothing else: write \"this machine\""),
        ("cec", media(json!({ "text": "this machine" })), "write \"this machine\""),
        (
            "cec",
            json!({ "location": "lab", "media": {}, "television": "cec0" }),
            "the television `cec0` is no path; write one such as /dev/cec0",
        ),
        (
            "cast",
            json!({ "location": "lab", "media": {}, "television": "/dev/cec0" }),
            "`television` is for the driver `browser` and `mpv` and `cec`, and this one is `cast`",
        ),
        (
            "mpv",
            json!({ "location": "lab", "media": {}, "address": "10.0.0.7" }),
            "`address` is for the driver `cast`, and this one is `mpv`",
        ),
    ] {
        let problem = built(driver, config).err().expect(expected);
        assert!(problem.contains(expected), "{problem} is not {expected}");
    }
}

#[test]
fn a_check_on_another_machine_does_not_look_for_files() {
    let mut resources = Resources::default();
    resources.insert(BuildCheck);
    let config = json!({ "location": "lab", "media": { "film": "/only/there.mp4" } });
    assert!(screen(&blueprint("mpv", config, resources)).is_ok());
}
