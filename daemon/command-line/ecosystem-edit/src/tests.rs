//! Tests of the editor: additions insert text and change nothing else, and mistakes are told in the
//! author's terms.

use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use expect_test::{Expect, expect};
use proptest::prelude::*;

use crate::{
    AgentAddition, DeviceOffer, DoorAddition, EcosystemAddition, EcosystemDraft, EcosystemText,
    EditableFile, GoalAddition, Respondent, RoomAddition, SettingText, as_name, interview,
    unified_difference,
};

const HOME: &str = r#"# My house.
[ecosystem]
name = "home"   # as on the door

[rooms]
hall = { kind = "corridor" }   # no heating
kitchen = {}
# The cellar is locked.

# Doors, measured in May.
[doors]
hall = { kitchen = 4.0 }

[[agent]]
name = "thermometer-kitchen"
plugin = "temperature-sensor"
config = { location = "kitchen" }

# What I want.
[goals]
warm = "(known-temperature kitchen)"
# more later
"#;

fn room(name: &str) -> EcosystemAddition {
    EcosystemAddition::Room(RoomAddition { name: name.to_owned(), ..RoomAddition::default() })
}

fn door(from: &str, to: &str, length: Option<f64>, is_one_way: bool) -> EcosystemAddition {
    let (from, to) = (from.to_owned(), to.to_owned());
    EcosystemAddition::Door(DoorAddition { from, to, length, is_one_way })
}

fn agent(name: &str, config: &[&str]) -> EcosystemAddition {
    let config = config.iter().map(|text| SettingText::read(text).expect("a setting")).collect();
    let (name, plugin) = (name.to_owned(), "sensor".to_owned());
    EcosystemAddition::Agent(AgentAddition { name, plugin, config, ..AgentAddition::default() })
}

fn goal(name: &str, is_kept: bool) -> EcosystemAddition {
    let goal = "(known-co2 kitchen)".to_owned();
    let (name, settings) = (name.to_owned(), Vec::new());
    EcosystemAddition::Goal(GoalAddition { name, goal, is_kept, settings })
}

fn added(text: &str, additions: &[EcosystemAddition]) -> Result<String, String> {
    let mut edited = EcosystemText::parse(text).map_err(|error| error.to_string())?;
    for addition in additions {
        edited.add(addition).map_err(|error| error.to_string())?;
    }
    Ok(edited.text().to_owned())
}

/// Checks the lines that additions insert, as a difference without context.
fn check(text: &str, additions: &[EcosystemAddition], expected: Expect) {
    let new = added(text, additions).expect("it can be added");
    // An expected text has no spaces at the end of a line; unchanged empty lines have one.
    let difference = unified_difference("home.toml", text, &new);
    let lines: String = difference.lines().map(|line| format!("{}\n", line.trim_end())).collect();
    expected.assert_eq(&lines);
}

#[track_caller]
fn refused(text: &str, addition: EcosystemAddition, sentence: &str) {
    let refused = added(text, &[addition]).expect_err("it is refused");
    assert_eq!(refused, sentence);
}

/// Whether `new` is `old` with one text inserted.
fn is_insertion(old: &str, new: &str) -> bool {
    let before = old.bytes().zip(new.bytes()).take_while(|(one, other)| one == other).count();
    let (old_rest, new_rest) = (&old.as_bytes()[before..], &new.as_bytes()[before..]);
    new_rest.len() > old_rest.len() && new_rest.ends_with(old_rest)
        || (0..=before).any(|at| {
            let (head, tail) = old.as_bytes().split_at(at);
            new.as_bytes().starts_with(head) && new.as_bytes().ends_with(tail)
        })
}

#[test]
fn a_room_a_door_an_agent_and_a_goal_stand_at_the_end_of_their_tables() {
    let additions = [
        EcosystemAddition::Room(RoomAddition {
            name: "attic".to_owned(),
            kind: None,
            floor: Some(2),
            area: Some(12.0),
            settings: Vec::new(),
        }),
        door("attic", "hall", Some(6.5), false),
        agent("co2-attic", &["location=attic", "quantity=co2", "valid-for=10min"]),
        goal("air", true),
    ];
    check(
        HOME,
        &additions,
        expect![[r#"
            --- home.toml
            +++ home.toml
            @@ -6,17 +6,24 @@
             hall = { kind = "corridor" }   # no heating
             kitchen = {}
             # The cellar is locked.
            +attic = { floor = 2, area = 12.0 }
 
             # Doors, measured in May.
             [doors]
            -hall = { kitchen = 4.0 }
            +hall = { kitchen = 4.0, attic = 6.5 }
 
             [[agent]]
             name = "thermometer-kitchen"
             plugin = "temperature-sensor"
             config = { location = "kitchen" }
 
            +[[agent]]
            +name = "co2-attic"
            +plugin = "sensor"
            +config = { location = "attic", quantity = "co2", valid-for = "10min" }
            +
             # What I want.
             [goals]
             warm = "(known-temperature kitchen)"
             # more later
            +air = { goal = "(known-co2 kitchen)", keep = "maintain", ask = "always" }
        "#]],
    );
}

#[test]
fn tables_that_are_missing_are_made() {
    let additions = [
        room("hall"),
        room("attic"),
        door("hall", "attic", None, true),
        agent("x", &[]),
        goal("air", false),
    ];
    let new = added("[ecosystem]\nname = \"home\"", &additions).expect("it can be added");
    expect![[r#"
        [ecosystem]
        name = "home"

        [rooms]
        hall = {}
        attic = {}

        [doors]
        hall = { attic = { one-way = true } }

        [[agent]]
        name = "x"
        plugin = "sensor"

        [goals]
        air = "(known-co2 kitchen)"
    "#]]
    .assert_eq(&new);
}

#[test]
fn tables_of_any_form_are_extended() {
    let forms = [
        ("rooms = { hall = {} }\n", "rooms = { hall = {}, attic = {} }\n"),
        ("rooms = {}\n", "rooms = { attic = {} }\n"),
        ("rooms.hall = {}\n", "rooms.hall = {}\nrooms.attic = {}\n"),
        ("[rooms.hall]\nfloor = 1\n", "[rooms.hall]\nfloor = 1\n\n[rooms]\nattic = {}\n"),
        ("[rooms]\nhall = {}\n[rooms.bath]\n", "[rooms]\nhall = {}\nattic = {}\n[rooms.bath]\n"),
        ("[rooms]\nhall.floor = 1", "[rooms]\nhall.floor = 1\nattic = {}\n"),
        (
            "[rooms]\r\nhall = {}\r\n\r\n# x\r\n",
            "[rooms]\r\nhall = {}\r\nattic = {}\r\n\r\n# x\r\n",
        ),
        ("\u{feff}[rooms]\n", "\u{feff}[rooms]\nattic = {}\n"),
    ];
    for (old, new) in forms {
        assert_eq!(added(old, &[room("attic")]).as_deref(), Ok(new), "{old}");
    }
    let subtable = "[rooms]\na = {}\nb = {}\nc = {}\n[doors.a]\nb = 1.0\n# end";
    let longer = "[rooms]\na = {}\nb = {}\nc = {}\n[doors.a]\nb = 1.0\n# end\nc = 2.0\n";
    let to_c = door("c", "a", Some(2.0), false);
    assert_eq!(added(subtable, &[to_c]).as_deref(), Ok(longer), "a door stands with its room");
}

#[test]
fn long_configs_are_tables() {
    let settings =
        ["location=kitchen", "device=tmp117@i2c-1/1-0048", "presets.door.shows=hall", "n=[1, 2]"];
    let new = added("[ecosystem]\nname = \"home\"\n", &[agent("x", &settings)]);
    expect![[r#"
        [ecosystem]
        name = "home"

        [[agent]]
        name = "x"
        plugin = "sensor"

        [agent.config]
        location = "kitchen"
        device = "tmp117@i2c-1/1-0048"
        presets.door.shows = "hall"
        n = [1, 2]
    "#]]
    .assert_eq(&new.expect("it can be added"));
    let entry = agent("y", &["location=kitchen"]);
    let once = added("", &[agent("x", &settings), entry]).expect("it can be added");
    assert!(once.contains("n = [1, 2]\n\n[[agent]]\nname = \"y\""), "{once}");
}

#[test]
fn mistakes_are_told_in_the_terms_of_the_author() {
    refused(
        HOME,
        room("kitchen"),
        "there is a room `kitchen` already, in line 7; nothing is added",
    );
    refused(
        HOME,
        room("thermometer-kitchen"),
        "there is an agent `thermometer-kitchen` already, in line 15; nothing is added",
    );
    refused(
        HOME,
        agent("hall", &[]),
        "there is a room `hall` already, in line 6; nothing is added",
    );
    refused(
        HOME,
        goal("warm", true),
        "there is a goal `warm` already, in line 21; nothing is added",
    );
    refused(
        HOME,
        room("Große Küche"),
        "`Große Küche` cannot be the name of a room: use 1 to 64 of `a-z`, `0-9`, `-` and `_`, and \
         begin with a letter; did you mean `grosse-kueche`?",
    );
    refused(
        HOME,
        door("hall", "kitchn", None, false),
        "there is no room `kitchn`; did you mean `kitchen`?",
    );
    refused(
        HOME,
        door("hall", "cellar", None, false),
        "there is no room `cellar`; there are hall, kitchen",
    );
    refused(
        HOME,
        door("kitchen", "hall", Some(4.0), false),
        "there is a door `kitchen – hall` already, in line 12; nothing is added",
    );
    refused(
        HOME,
        door("hall", "hall", None, false),
        "a door leads from one room to another, and `hall` is on both of its sides",
    );
    refused(
        "[rooms]\na = {}\nb = {}\n",
        door("a", "b", Some(-1.0), false),
        "a length of -1 is impossible: a length is a number above 0, in meters",
    );
    refused("a = = 1", room("x"), "line 1 is not valid TOML: extra `=`, expected nothing");
    refused(
        "[ecosystem]\ndomain = \"d.pddl\"\nproblem = \"map.pddl\"\n",
        room("x"),
        "this file has a map of its own, in PDDL (map.pddl): add the room there, or replace `domain` \
         and `problem` by the tables [rooms] and [doors]",
    );
    refused(
        "agent = [{ name = \"x\" }]\n",
        agent("y", &[]),
        "`agent` in line 1 is no list of [[agent]]; write the agent by hand",
    );
    refused(HOME, agent("x", &["a=1", "a=2"]), "`a` is given twice");
}

#[test]
fn a_door_one_way_has_a_way_back_of_its_own() {
    let there = door("a", "b", Some(2.0), true);
    let back = door("b", "a", Some(3.0), true);
    let rooms = "[rooms]\na = {}\nb = {}\n";
    let both = added(rooms, &[there.clone(), back]).expect("two ways");
    assert!(both.ends_with(
        "[doors]\na = { b = { length = 2.0, one-way = true } }\nb = { a = { length = 3.0, one-way = true } }\n"
    ), "{both}");
    assert!(added(rooms, &[there.clone(), there.clone()]).is_err());
    assert!(added(rooms, &[there, door("b", "a", None, false)]).is_err());
}

#[test]
fn settings_are_values_of_toml_or_texts() {
    let line = |text: &str| SettingText::read(text).map(|setting| setting.line());
    assert_eq!(line("speed=0.3").as_deref(), Ok("speed = 0.3"));
    assert_eq!(line("humidity=true").as_deref(), Ok("humidity = true"));
    assert_eq!(line("places=[\"a\", \"b\"]").as_deref(), Ok("places = [\"a\", \"b\"]"));
    assert_eq!(line("every=day 08:00").as_deref(), Ok("every = \"day 08:00\""));
    assert_eq!(line("device=a\"b").as_deref(), Ok("device = 'a\"b'"));
    assert_eq!(line("since=2026-01-01").as_deref(), Ok("since = \"2026-01-01\""));
    assert_eq!(line("x=y=z").as_deref(), Ok("x = \"y=z\""));
    for wrong in ["speed", "=1", "a b=1", "x=a\nb"] {
        assert!(line(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn names_are_suggested() {
    let pairs = [("Büro 1", "buero-1"), ("  WC/Bad ", "wc-bad"), ("3. Stock", "stock"), ("å", "a")];
    for (text, name) in pairs {
        assert_eq!(as_name(text).as_deref(), Some(name), "{text}");
    }
    assert_eq!(as_name("42"), None);
}

fn ecosystems() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../ecosystems");
    let files = fs::read_dir(folder).expect("it is there").flatten().map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect()
}

#[test]
fn every_ecosystem_of_the_repository_keeps_its_text() {
    let files = ecosystems();
    assert!(files.len() >= 5, "{files:?}");
    for path in files {
        let old = fs::read_to_string(&path).expect("it is text");
        let edited = EcosystemText::parse(old.clone()).expect("it is valid");
        assert_eq!(edited.text(), old, "{}", path.display());
        for addition in [agent("new-one", &["location=here"]), goal("new-goal", true)] {
            let new = added(&old, &[addition]).expect("it can be added");
            assert!(is_insertion(&old, &new), "{}", unified_difference("x", &old, &new));
        }
    }
}

proptest! {
    #[test]
    fn additions_insert_text_and_change_nothing_else(
        lines in prop::collection::vec(prop::sample::select(vec![
            "[rooms]", "[doors]", "[goals]", "[[agent]]", "[agent.config]", "[rooms.r]", "[other]",
            "a = {}", "b = { kind = \"x\" } # why", "name = \"n\"", "c.d = 1", "# words", "", "  ",
            "rooms = {}", "e = [\n 1, # one\n]", "hall = { a = 1.0, b = 2.0, }",
        ]), 0..14),
        ends_with_line in any::<bool>(),
        number in 0_usize..5,
    ) {
        let mut old = lines.join("\n");
        if ends_with_line {
            old.push('\n');
        }
        let addition = match number {
            0 => room("z"),
            1 => door("a", "b", Some(1.0), false),
            2 => door("hall", "a", None, true),
            3 => agent("z", &["location=a"]),
            _ => goal("z", true),
        };
        if let Ok(new) = added(&old, &[addition]) {
            prop_assert!(is_insertion(&old, &new), "{old:?} became {new:?}");
        }
    }
}

// === files ===

#[test]
fn a_file_is_replaced_with_its_permissions_and_through_its_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, link) = (folder.path().join("home.toml"), folder.path().join("link.toml"));
    fs::write(&file, HOME).expect("a file");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).expect("ours");
    symlink(&file, &link).expect("a link");
    let read = EditableFile::read(&link).expect("it is there");
    assert_eq!(read.text(), HOME);
    read.replace("new\n").expect("it can be written");
    assert_eq!(fs::read_to_string(&file).expect("a file"), "new\n");
    assert!(fs::symlink_metadata(&link).expect("a link").is_symlink());
    let mode = fs::metadata(&file).expect("a file").permissions().mode() & 0o777;
    assert_eq!(mode, 0o640);
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2, "nothing is left");
}

#[test]
fn a_file_that_was_edited_meanwhile_stays_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("home.toml");
    fs::write(&file, HOME).expect("a file");
    let read = EditableFile::read(&file).expect("it is there");
    fs::write(&file, "edited\n").expect("a file");
    let error = read.replace("new\n").expect_err("it has changed").to_string();
    assert!(error.contains("was edited meanwhile; nothing is changed"), "{error}");
    assert_eq!(fs::read_to_string(&file).expect("a file"), "edited\n");
    fs::remove_file(&file).expect("ours");
    assert!(read.replace("new\n").is_err(), "a file that was removed is not made anew");
    assert!(!file.exists());
}

#[test]
fn what_cannot_be_written_leaves_the_old_file_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("home.toml");
    fs::write(&file, HOME).expect("a file");
    let read = EditableFile::read(&file).expect("it is there");
    // A folder in the place of the new file cannot be written, not even by root.
    let aside = folder.path().join(format!(".home.toml.new-{}", std::process::id()));
    fs::create_dir(&aside).expect("a folder");
    let error = read.replace("new\n").expect_err("it cannot be written").to_string();
    assert!(error.starts_with("write ") && error.ends_with("nothing is changed"), "{error}");
    assert_eq!(fs::read_to_string(&file).expect("a file"), HOME);
}

#[test]
fn a_full_disk_is_told_and_leaves_nothing() {
    // Every write to this device fails as on a full disk.
    let full = std::io::Error::from_raw_os_error(28);
    let path = PathBuf::from("/etc/home.toml");
    let error = crate::FileEditError::Write { path, source: full }.to_string();
    assert_eq!(error, "write /etc/home.toml: the disk is full; nothing is changed");
}

#[test]
fn a_new_file_never_overwrites_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("home.toml");
    EditableFile::create(&file, "one\n").expect("it is new");
    let error = EditableFile::create(&file, "two\n").expect_err("it exists").to_string();
    assert!(error.ends_with("it exists already, and is not overwritten"), "{error}");
    assert_eq!(fs::read_to_string(&file).expect("a file"), "one\n");
    let nowhere = folder.path().join("no/such/home.toml");
    let error = EditableFile::create(&nowhere, "x").expect_err("no folder").to_string();
    assert!(error.contains("there is no such folder"), "{error}");
    symlink("nowhere", folder.path().join("link.toml")).expect("a link");
    assert!(EditableFile::create(&folder.path().join("link.toml"), "x").is_err());
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2, "nothing is left");
}

// === new files ===

fn home() -> EcosystemDraft {
    let mut draft = EcosystemDraft { name: "home".to_owned(), ..EcosystemDraft::default() };
    for word in ["hall:corridor", "kitchen", "bath"] {
        draft.rooms.push(word.parse::<crate::PlaceOptions>().expect("a room").into());
    }
    for word in ["hall=kitchen:4", "hall=bath:2,5 m"] {
        draft.doors.push(word.parse::<crate::DoorWords>().expect("a door").into());
    }
    draft.add_robot(&"turtlebot@hall".parse().expect("a robot"), true);
    for word in ["temperature@kitchen", "co2@bath", "temperature@turtlebot"] {
        draft.add_sensor(&word.parse().expect("a sensor"), true).expect("it is possible");
    }
    draft
}

#[test]
fn a_new_file_is_commented_and_complete() {
    let mut draft = home();
    let (goal, about) = draft.goal_suggestions().remove(0);
    assert_eq!(about, "the temperature of every room is known");
    draft.goals.push(goal);
    let lines = "[[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\n".to_owned();
    let about = "an MQTT broker at localhost:1883".to_owned();
    draft.take_offer(&DeviceOffer { about, lines, ..DeviceOffer::default() }, None);
    expect![[r##"
        # The ecosystem `home`: its places, what stands there, and what is to be so.
        #
        # Made by `althing init`. `althing check FILE` finds what does not fit, and
        # `althing add` adds rooms, doors, agents and goals. Lines that begin with # are
        # comments, for people.

        [ecosystem]
        name = "home"

        # ── The places ───────────────────────────────────────────────────────────────
        # A place is a room unless `kind` says what else it is. Its `floor` (a number)
        # and its `area` (in square meters) may be said, too.

        [rooms]
        hall = { kind = "corridor" }
        kitchen = {}
        bath = {}

        # Doors lead both ways. The number is the length of the way in meters.
        [doors]
        hall = { kitchen = 4.0, bath = 2.5 }

        # ── What stands there ────────────────────────────────────────────────────────
        # One [[agent]] each. The agents that plan need no entry: they are there.

        [[agent]]
        name = "turtlebot-1"
        plugin = "turtlebot"
        driver = "simulated"
        config = { start = "hall" }

        [[agent]]
        name = "thermometer-kitchen"
        plugin = "temperature-sensor"
        driver = "simulated"
        config = { location = "kitchen" }

        [[agent]]
        name = "co2-bath"
        plugin = "sensor"
        driver = "simulated"
        config = { location = "bath", quantity = "co2" }

        [[agent]]
        name = "thermometer-turtlebot-1"
        plugin = "ir-temperature-sensor"
        driver = "simulated"
        config = { mounted-on = "turtlebot-1" }

        # ── Found, and not used yet ──────────────────────────────────────────────────
        # Remove the `# ` before the lines of a device, and fill in what is its own.

        # an MQTT broker at localhost:1883:
        # [[agent]]
        # name = "zigbee"
        # plugin = "mqtt"

        # ── What is to be so ─────────────────────────────────────────────────────────
        # A goal that is kept is planned for again whenever it does not hold.
        # `althing goals` shows how it stands.

        [goals]
        temperatures = { goal = "(forall (?r - room) (known-temperature ?r))", keep = "maintain", ask = "always" }

        # ── The simulated building ───────────────────────────────────────────────────
        # For agents with driver = "simulated"; real devices need none of it.

        [building]
        # The true temperature of each room in °C, which agents find out by measuring.
        temperatures = { kitchen = 19.5, bath = 20.0 }
        # 1.0 is real time; 0.1 is ten times as fast.
        time-scale = 1.0
    "##]]
    .assert_eq(&draft.text().expect("it is consistent"));
}

#[test]
fn a_draft_with_a_mistake_has_no_text() {
    let mut draft = home();
    draft.doors.push("hall=cellar".parse::<crate::DoorWords>().expect("a door").into());
    assert_eq!(
        draft.text().expect_err("no cellar").to_string(),
        "there is no room `cellar`; there are hall, kitchen, bath"
    );
    let wrong = |word: &str| word.parse::<crate::SensorWords>().expect_err("wrong").to_string();
    assert!(wrong("temprature@bath").ends_with("did you mean `temperature@bath`?"));
    assert!(wrong("temperature").contains("write QUANTITY@ROOM"));
    let real = "co2@bath".parse::<crate::SensorWords>().expect("a sensor");
    let error = home().add_sensor(&real, false).expect_err("it has no device").to_string();
    assert!(error.contains("`althing sensors` lists") && error.contains("--simulated"), "{error}");
}

/// A person with answers that were written before.
struct Scripted<'a> {
    answers: Vec<&'a str>,
    told: String,
}

impl Respondent for Scripted<'_> {
    fn tell(&mut self, text: &str) {
        self.told += &format!("{text}\n");
    }

    fn ask(&mut self, question: &str, usual: &str) -> Option<String> {
        let answer = (!self.answers.is_empty()).then(|| self.answers.remove(0).to_owned());
        self.told += &format!("{question} [{usual}]: {}\n", answer.as_deref().unwrap_or("(end)"));
        answer
    }

    fn mistake(&mut self, text: &str) -> Option<String> {
        text.contains("korridor").then(|| "there is no kind `korridor`".to_owned())
    }
}

#[test]
fn a_person_is_asked_until_the_answers_fit() {
    let offer = DeviceOffer {
        about: "tmp117@i2c-1/1-0048 (temperature)".to_owned(),
        agent: Some(AgentAddition {
            plugin: "temperature-sensor".to_owned(),
            driver: Some("linux".to_owned()),
            config: vec![SettingText::text("device", "tmp117@i2c-1/1-0048")],
            ..AgentAddition::default()
        }),
        quantity: "temperature".to_owned(),
        lines: "[[agent]]\n".to_owned(),
    };
    let answers = vec![
        "",
        "hall:korridor, kitchen bath",
        "hall:corridor, kitchen bath",
        "",
        "bathroom",
        "bath",
        "turtlebot@hall",
        "co2@kitchen",
        "1",
    ];
    let mut person = Scripted { answers, told: String::new() };
    let draft = EcosystemDraft { name: "home".to_owned(), ..EcosystemDraft::default() };
    let draft = interview(&mut person, draft, &[offer]).expect("all is answered");
    assert!(person.told.contains("there is no room `bathroom`; there are"), "{}", person.told);
    assert!(person.told.contains("  there is no kind `korridor`\nRooms"), "{}", person.told);
    assert!(person.told.contains("Doors [hall=kitchen:4 hall=bath:4]"), "{}", person.told);
    let text = draft.text().expect("it is consistent");
    for line in [
        "hall = { kitchen = 4.0, bath = 4.0 }",
        "name = \"thermometer-bath\"",
        "config = { location = \"bath\", device = \"tmp117@i2c-1/1-0048\" }",
        "config = { location = \"kitchen\", quantity = \"co2\" }",
        "temperature = { goal = \"(known-temperature bath)\", keep = \"maintain\", ask = \"always\" }",
    ] {
        assert!(text.contains(line), "{line} is missing in\n{text}");
    }
    let mut silent = Scripted { answers: vec!["home"], told: String::new() };
    assert_eq!(interview(&mut silent, EcosystemDraft::default(), &[]), None);
    let mut stubborn = Scripted { answers: vec!["!"; 100], told: String::new() };
    assert_eq!(interview(&mut stubborn, EcosystemDraft::default(), &[]), None);
    assert!(stubborn.answers.len() > 50, "it ends after a while");
}
