//! From nothing to a kept goal in a building of one's own: `althing init` and `althing add`, with
//! options, at a terminal, and while a daemon runs.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;

use crate::support::terminal::{Terminal, has_tmux};
use crate::support::{Office, stderr, stdout};

/// The options of a house with three rooms, two thermometers and a robot that carries one of them.
const HOUSE: &[&str] = &[
    "init",
    "--name",
    "home",
    "--room",
    "hall:corridor",
    "--room",
    "kitchen",
    "--room",
    "bath",
    "--door",
    "hall=kitchen:4",
    "--door",
    "hall=bath:4",
    "--robot",
    "turtlebot@hall",
    "--sensor",
    "temperature@kitchen",
    "--sensor",
    "temperature@turtlebot",
    "--goal",
    "temperatures=(forall (?r - room) (known-temperature ?r))",
    "--simulated",
    "--yes",
];

/// Returns an office in whose folder `althing init` has written a house.
fn house() -> Office {
    let office = Office::new();
    let written = office.run(HOUSE);
    assert!(written.status.success(), "{}{}", stdout(&written), stderr(&written));
    let said = stdout(&written);
    for part in ["althing.toml is written: `home`, 3 places, 3 agents, 1 goal", "\n  althing up "] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let file = office.folder().join("althing.toml");
    office.with_file(file)
}

fn text(office: &Office) -> String {
    fs::read_to_string(&office.file).expect("it is written")
}

/// Runs `althing add` with these words, and returns the exit code and all output.
fn add(office: &Office, words: &[&str]) -> (Option<i32>, String) {
    let output = office.run(&[&["add"], words].concat());
    (output.status.code(), format!("{}{}", stdout(&output), stderr(&output)))
}

#[test]
fn a_house_from_options_to_a_kept_goal_that_grows_while_it_runs() {
    let mut office = house();
    let checked = office.run(&["check", "althing.toml"]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    assert!(!stderr(&checked).contains("warning"), "{}", stderr(&checked));
    office.up_alone(&[]);
    // The goal is asked for by itself, and the robot drives to the bath.
    office.await_fact("(known-temperature bath)", true);
    office.await_fact("(known-temperature kitchen)", true);

    // An agent and a goal are taken while the daemon runs.
    let before = text(&office);
    let sensor = ["agent", "co2-kitchen", "--plugin", "sensor", "--driver", "simulated"];
    let more = ["--location", "kitchen", "--set", "quantity=co2", "--yes"];
    let (code, said) = add(&office, &[&sensor[..], &more].concat());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("+name = \"co2-kitchen\""), "the difference is shown: {said}");
    assert!(said.contains("` has taken it\n"), "{said}");
    let (code, said) = add(&office, &["goal", "air", "(known-co2 kitchen)", "--keep", "--yes"]);
    assert_eq!(code, Some(0), "{said}");
    office.await_fact("(known-co2 kitchen)", true);
    for line in before.lines() {
        assert!(text(&office).lines().any(|other| other == line), "`{line}` is kept");
    }

    // A room lets the daemon restart itself; the kept goal then holds there, too.
    let (code, said) = add(&office, &["room", "attic", "--door", "hall=6", "--yes"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("has taken it: it restarted itself"), "{said}");
    office.await_fact("(known-temperature attic)", true);
    assert_eq!(office.ended(), Vec::<String>::new(), "under the same process id");
}

#[test]
fn a_daemon_with_another_text_is_left_alone() {
    let mut office = house();
    office.up_alone(&[]);
    let edited = format!("# edited since\n{}", text(&office));
    fs::write(&office.file, edited).expect("it can be written");
    let (code, said) = add(&office, &["room", "attic", "--door", "hall=6", "--yes"]);
    assert_eq!(code, Some(69), "{said}");
    assert!(said.contains("runs with another text than"), "{said}");
    assert!(text(&office).contains("attic = {}"), "the file is written all the same");
    let (code, said) = add(&office, &["room", "cellar", "--file-only", "--yes"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn mistakes_change_nothing() {
    let office = house();
    let before = text(&office);
    let (code, said) = add(&office, &["door", "hall", "kitchn", "--length", "3", "--yes"]);
    assert_eq!(code, Some(33), "{said}");
    assert!(said.contains("there is no room `kitchn`; did you mean `kitchen`?"), "{said}");
    let cases: &[(&[&str], i32, &str)] = &[
        (&["room", "kitchen", "--yes"], 33, "there is a room `kitchen` already, in line"),
        (&["room", "attic"], 77, "--yes agrees to the difference"),
        (&["room", "attic", "--dry-run"], 0, "nothing is changed (--dry-run)"),
        (&["room", "attic", "--kind", "corridr", "--yes"], 33, "corridr"),
        (&["agent", "x", "--plugin", "sensr", "--yes"], 33, "did you mean `sensor`?"),
        (
            &["agent", "x", "--plugin", "temperature-sensor", "--location", "hal", "--yes"],
            33,
            "did you mean `hall`?",
        ),
        (&["goal", "air", "(known-co kitchen)", "--yes"], 33, "did you mean `known-co2`?"),
    ];
    for (words, expected, sentence) in cases {
        let (code, said) = add(&office, words);
        assert_eq!(code, Some(*expected), "{words:?}: {said}");
        assert!(said.contains(sentence), "{words:?}: {said}");
        assert_eq!(text(&office), before, "{words:?}");
    }
    let again = office.run(HOUSE);
    assert_eq!(again.status.code(), Some(33), "{}", stderr(&again));
    assert!(stderr(&again).contains("it exists already, and is not overwritten"));
    fs::write(&office.file, format!("{before}[goal]\n")).expect("it can be written");
    let (code, said) = add(&office, &["room", "attic", "--yes"]);
    assert_eq!(code, Some(33), "{said}");
    assert!(said.contains("has mistakes already: mend them first"), "{said}");
}

#[test]
fn init_names_what_does_not_fit_and_writes_nothing() {
    let office = Office::new();
    let cases: &[(&[&str], i32, &str)] = &[
        (&[], 33, "say which rooms there are"),
        (&["--room", "kitchen"], 77, "--yes writes the file"),
        (&["--room", "Küche", "--yes"], 64, "did you mean `kueche`?"),
        (&["--room", "kitchen", "--door", "kitchen=hal:2", "--yes"], 33, "there is no room `hal`"),
        (&["--room", "kitchen", "--sensor", "co2@kitchen", "--yes"], 33, "--simulated"),
        (&["--room", "kitchen", "--goal", "a=(known-co kitchen)", "--yes"], 33, "known-co2"),
    ];
    for (words, expected, sentence) in cases {
        let output = office.run(&[&["init"], *words].concat());
        assert_eq!(output.status.code(), Some(*expected), "{words:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(sentence), "{words:?}: {}", stderr(&output));
        assert!(!office.folder().join("althing.toml").exists(), "{words:?}");
    }
    let nowhere = ["init", "no/such/home.toml", "--room", "kitchen", "--yes"];
    let output = office.run(&nowhere);
    assert!(stderr(&output).contains("there is no such folder"), "{}", stderr(&output));
}

#[test]
fn a_sensor_of_the_machine_is_offered_as_a_comment_without_questions() {
    let office = Office::new();
    let device = office.folder().join("sys/devices/i2c-1/1-0048/iio:device0");
    fs::create_dir_all(&device).expect("a folder");
    fs::write(device.with_file_name("name"), "tmp117\n").expect("a file");
    fs::write(device.join("in_temp_input"), "21500\n").expect("a file");
    let all: PathBuf = office.folder().join("sys/bus/iio/devices");
    fs::create_dir_all(&all).expect("a folder");
    std::os::unix::fs::symlink(&device, all.join("iio:device0")).expect("a link");
    let sysfs = office.folder().join("sys").display().to_string();
    let words = ["init", "--room", "kitchen", "--discover", "--sysfs", &sysfs, "--yes"];
    let output = office.run(&words);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = fs::read_to_string(office.folder().join("althing.toml")).expect("it is written");
    for line in ["# tmp117@i2c-1/1-0048 (temperature, now 21.5 Cel):", "# driver = \"linux\""] {
        assert!(text.contains(line), "{line} is missing in\n{text}");
    }
}

#[test]
fn a_person_is_asked_at_a_terminal() {
    if !has_tmux() {
        return;
    }
    let office = Office::new();
    let terminal = Terminal::of_size(&office, "init --no-discovery --name home", (100, 50));
    let answers = [
        ("A name for this building [home]:", ""),
        ("Rooms:", "hall:corridor kitchen bath"),
        ("Doors [hall=kitchen:4 hall=bath:4]:", ""),
        ("Robots, such as", "turtlebot@hal"),
        ("did you mean `hall`?", "turtlebot@hall"),
        ("Sensors, such as", "temperature@kitchen temperature@turtlebot"),
        ("A number, a goal of your own", ""),
        ("Write this to althing.toml? [y/N]", "y"),
    ];
    for (question, answer) in answers {
        terminal.await_text(question);
        terminal.enter(answer);
    }
    let end = terminal.await_text("ended with");
    assert!(end.contains("What comes next:"), "{end}");
    assert!(end.contains("ended with 0"), "{end}");
    let checked = office.run(&["check", "althing.toml"]);
    assert!(checked.status.success(), "{}", stderr(&checked));
}

#[test]
fn a_file_that_is_edited_while_a_person_decides_is_not_overwritten() {
    if !has_tmux() {
        return;
    }
    let office = house();
    fs::set_permissions(&office.file, fs::Permissions::from_mode(0o640)).expect("ours");
    // The path of the file is longer than 80 columns.
    let size = (160, 40);
    let terminal = Terminal::of_size(&office, "add room attic --door hall=6", size);
    terminal.await_text("Write that? [y/N]");
    let edited = format!("{}# by another editor\n", text(&office));
    fs::write(&office.file, &edited).expect("it can be written");
    terminal.enter("y");
    let end = terminal.await_text("ended with");
    assert!(end.contains("it was edited meanwhile; nothing is changed"), "{end}");
    assert_eq!(text(&office), edited);
    let mode = fs::metadata(&office.file).expect("a file").permissions().mode() & 0o777;
    assert_eq!(mode, 0o640);
}
