//! A camera that the real Motion watches, in a whole daemon: what crosses its picture leads to a goal,
//! and the picture is a file.

use std::path::PathBuf;

use crate::film::{crossing, kill_with, missing};
use crate::support::left_out::left_out;
use crate::support::{Office, lab, stderr, stdout};

/// Returns the pictures of the camera.
fn pictures(office: &Office) -> Vec<PathBuf> {
    let files = std::fs::read_dir(office.folder().join("pictures"));
    let files = files.into_iter().flatten().flatten().map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "jpg")).collect()
}

#[test]
fn motion_in_a_film_leads_to_a_picture_of_its_place() {
    let missing = missing(&["motion", "ffmpeg"]);
    if !missing.is_empty() {
        return left_out(&format!("it needs {}: apt install motion ffmpeg", missing.join(", ")));
    }
    let office = Office::new();
    let film = crossing(office.folder());
    let folder = office.folder().join("pictures");
    let entry = format!(
        "[[agent]]\nname = \"camera-1\"\nplugin = \"ptz-camera\"\ndriver = \"motion\"\n\n\
         [agent.config]\nlocation = \"corridor\"\nsource = \"file://{}\"\nfolder = \"{}\"\n\
         settings = {{ threshold = 1000, event_gap = 1 }}\nvalid-for = \"2s\"\n\
         on-motion = {{ goal = \"(known-picture ?l)\" }}\n",
        film.display(),
        folder.display()
    );
    let file = office.write("lab.toml", &(lab("decentralized") + &entry));
    let mut office = office.with_file(file);
    let file = office.file.display().to_string();
    let checked = office.run(&["check", &file]);
    assert!(checked.status.success(), "{}{}", stdout(&checked), stderr(&checked));
    office.up_alone(&[]);
    office.await_devices(1);
    office.await_fact("(looks-at camera-1 ahead)", true);
    // No person asks for the picture.
    office.await_fact("(motion corridor)", true);
    office.await_fact("(known-picture corridor)", true);
    let taken = pictures(&office);
    let picture = std::fs::read(taken.first().expect("a picture")).expect("a file");
    assert!(picture.starts_with(b"\xff\xd8"));

    // Motion is killed; the camera comes back, and takes a picture for a person.
    kill_with(&format!("motion -n -c {}", office.folder().display()));
    office.await_fact("(looks-at camera-1 ahead)", false);
    office.await_fact("(looks-at camera-1 ahead)", true);
}
