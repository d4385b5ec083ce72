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
fn every_mistake_of_a_config_is_reported() {
    let pdf = tempfile::Builder::new().suffix(".pdf").tempfile().expect("a file");
    let pdf = pdf.path().display().to_string();
    let media = |medium: Value| json!({ "location": "lab", "media": { "slides": medium } });
    for (driver, config, expected) in [
        ("browser", media(json!("/no/such.png")), "media.slides: the file /no/such.png cannot be"),
        ("mpv", media(json!("./no/such.mp4")), "media.slides: the file ./no/such.mp4 cannot be"),
        ("browser", media(json!("/")), "media.slides: / is not a file"),
        ("mpv", media(json!("Hello")), "media.slides: mpv shows films and pictures, and no texts"),
        ("mpv", media(json!(pdf)), "`driver = \"browser\"` can"),
        ("browser", media(json!(1)), "write a text, an address, a path, or { text"),
        (
            "mpv",
            json!({ "location": "lab", "media": {}, "profile": "/tmp" }),
            "`profile` is for the driver `browser`, and this one is `mpv`",
        ),
        (
            "simulated",
            json!({ "location": "lab", "media": {}, "program": "mpv" }),
            "`program` is for the driver `browser` and `mpv`, and this one is `simulated`",
        ),
        (
            "browser",
            json!({ "location": "lab", "media": { "a": "x", "b": { "text": "x" } } }),
            "two `media` with one text cannot be told apart",
        ),
        ("browser", json!({ "location": "lab", "media": { "A b": "x" } }), "`A b` cannot name"),
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
