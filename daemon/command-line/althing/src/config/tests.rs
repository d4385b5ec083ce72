//! Tests of the configuration: how layers are merged, and what their values mean. How mistakes are
//! displayed is tested on the binary.

use std::path::PathBuf;
use std::time::Duration;

use acl::content::{Keep, Partition};
use agent::AgentSettings;
use serde_json::json;
use tempfile::TempDir;

use super::*;

const PLUGINS: &[KnownPlugin] = &[
    KnownPlugin { name: "keyboard", drivers: &[], stands_by: false },
    KnownPlugin { name: "plan-requester", drivers: &[], stands_by: true },
    KnownPlugin { name: "turtlebot", drivers: &["simulated"], stands_by: false },
];

const FILE: &str = r#"
[ecosystem]
name = "house"
domain = "domain.pddl"
problem = "map.pddl"
mode = "centralized"
daemons = ["attic"]

[zenoh]
connect.endpoints = ["tcp/file:7447"]
transport.unicast.max_sessions = 7

[[agent]]
name = "robot"
plugin = "turtlebot"
daemon = "cellar"
config = { start = "hall", speed = 0.5 }

[goals]
all-known = "(forall (?r - room) (known ?r))"

[timing]
grace = "300ms"

[building]
temperatures = { hall = 20 }
conditions = { hall = { co2 = 700 } }
socket = "house.sock"
"#;

struct House {
    folder: TempDir,
    variables: Variables,
    overrides: Overrides,
}

impl House {
    fn new(file: &str) -> House {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let domain = "(define (domain house) (:types room) (:predicates (known ?r - room)))";
        let map =
            "(define (problem m) (:domain house) (:objects hall - room) (:init) (:goal (and)))";
        for (name, text) in [("domain.pddl", domain), ("map.pddl", map), ("house.toml", file)] {
            std::fs::write(folder.path().join(name), text).expect("a file");
        }
        House { folder, variables: Variables::new(), overrides: Overrides::default() }
    }

    fn with_variable(mut self, name: &str, value: &str) -> House {
        self.variables.insert(name.to_owned(), value.to_owned());
        self
    }

    fn file(&self) -> PathBuf {
        self.folder.path().join("house.toml")
    }

    #[track_caller]
    fn load(&self) -> Ecosystem {
        let loaded = Ecosystem::load_with(&self.file(), &self.variables, &self.overrides, PLUGINS);
        loaded.unwrap_or_else(|err| panic!("{:#?}", err.into_report().findings()))
    }
}

/// Returns all that is said about a file with mistakes.
#[track_caller]
fn mistakes_of(house: &House) -> String {
    let loaded = Ecosystem::load_with(&house.file(), &house.variables, &house.overrides, PLUGINS);
    format!("{:#?}", loaded.expect_err("a mistake").into_report().findings())
}

#[test]
fn a_file_defines_the_ecosystem() {
    let house = House::new(FILE);
    let ecosystem = house.load();
    assert_eq!(ecosystem.name.as_str(), "house");
    assert_eq!(ecosystem.mode, Mode::Centralized);
    assert_eq!(ecosystem.domain.name, "house");
    assert_eq!(ecosystem.problem.objects.len(), 1);
    let daemons: Vec<&str> = ecosystem.daemons.iter().map(acl::DaemonId::as_str).collect();
    assert_eq!(daemons, ["attic", "cellar"]);
    let [robot] = &ecosystem.agents[..] else { panic!("one agent: {:?}", ecosystem.agents) };
    assert_eq!(robot.name.as_str(), "robot");
    assert_eq!(robot.plugin, "turtlebot");
    assert_eq!(robot.driver, None);
    assert_eq!(*robot.config, json!({ "start": "hall", "speed": 0.5 }));
    assert_eq!(
        ecosystem.zenoh,
        json!({
            "connect": { "endpoints": ["tcp/file:7447"] },
            "transport": { "unicast": { "max_sessions": 7 } },
        })
    );
    assert_eq!(ecosystem.settings.grace, Duration::from_millis(300));
    assert_eq!(ecosystem.building.temperatures["hall"], 20.0);
    assert_eq!(ecosystem.building.conditions["hall"]["co2"], 700.0);
    assert_eq!(ecosystem.building.socket, Some(house.folder.path().join("house.sock")));
}

#[test]
fn the_defaults_are_those_of_the_agents() {
    let (layer, diagnostics) = reader::read(&SourceText::new(DEFAULTS_NAME, DEFAULTS));
    assert_eq!(diagnostics, []);
    let raw = merge(&[layer], &Overrides::default()).expect("complete defaults");
    assert_eq!(raw.ecosystem.mode, Mode::default());
    let file = FILE.replace("grace = \"300ms\"", "");
    assert_eq!(House::new(&file).load().settings, AgentSettings::default());
}

#[test]
fn the_command_line_overrides_the_environment_and_both_the_file() {
    let mut house = House::new(FILE);
    assert_eq!(house.load().mode, Mode::Centralized);

    house = house.with_variable("ALTHING_ECOSYSTEM__MODE", "decentralized");
    assert_eq!(house.load().mode, Mode::Decentralized);

    house.overrides = Overrides::default().mode(Some(Mode::Centralized));
    assert_eq!(house.load().mode, Mode::Centralized);
    house.overrides = Overrides::default().mode(None);
    assert_eq!(house.load().mode, Mode::Decentralized);
}

#[test]
fn layers_merge_key_by_key() {
    let mut house = House::new(FILE)
        .with_variable("ALTHING_TIMING__HEARTBEAT_PERIOD", "2s")
        .with_variable("ALTHING_BUILDING__TIME_SCALE", "0.5")
        .with_variable("ALTHING_GOALS__WARM_HALL", "(known hall)")
        .with_variable("ALTHING_ZENOH__TRANSPORT__UNICAST__MAX_SESSIONS", "9");
    house.overrides = Overrides::default().connect(&["tcp/there:1".to_owned()]);
    let ecosystem = house.load();
    assert_eq!(ecosystem.settings.heartbeat_period, Duration::from_secs(2));
    assert_eq!(ecosystem.settings.grace, Duration::from_millis(300));
    assert_eq!(ecosystem.building.time_scale, 0.5);
    assert_eq!(ecosystem.goals.len(), 2);
    assert_eq!(ecosystem.zenoh["connect"]["endpoints"], json!(["tcp/there:1"]));
    assert_eq!(ecosystem.zenoh["transport"]["unicast"]["max_sessions"], 9);
}

#[test]
fn goals_have_names_or_are_pddl() {
    let ecosystem = House::new(FILE).load();
    let text = "(forall (?r - room) (known ?r))";
    let text_of = |goal| ecosystem.find_goal(goal).map(|wish| wish.goal);
    assert_eq!(text_of("all-known").as_deref(), Ok(text));
    assert_eq!(text_of(text).as_deref(), Ok(text));
    let error = text_of("all-knwon").expect_err("no such goal");
    assert_eq!(error, "there is no goal called `all-knwon`; did you mean `all-known`?");
    for wrong in ["known hall", "known(hall)", ""] {
        assert_eq!(text_of(wrong).as_deref(), Ok(wrong), "the parser says what is wrong with it");
    }
}

#[test]
fn a_goal_may_have_options() {
    let file = FILE.replace(
        "[timing]",
        "[goals.warm]\ngoal = \"(known hall)\"\nkeep = \"maintain\"\npriority = 3\n\
         partition = \"wait\"\n\n[timing]",
    );
    let house = House::new(&file).with_variable("ALTHING_GOALS__WARM", "(known cellar)");
    let wish = house.load().find_goal("warm").expect("it has a name");
    assert_eq!((wish.goal.as_str(), wish.priority), ("(known cellar)", 3));
    assert_eq!((wish.keep, wish.partition), (Keep::Maintain, Partition::Wait));
}

#[test]
fn without_daemons_all_agents_are_unassigned() {
    let file = FILE.replace("daemon = \"cellar\"", "").replace("daemons = [\"attic\"]", "");
    let ecosystem = House::new(&file).load();
    assert!(ecosystem.daemons.is_empty());
    assert_eq!(ecosystem.unassigned_agents().count(), 1);
}

#[test]
fn no_prefix_of_a_file_panics() {
    // Every prefix of a file is a file that a user is about to finish.
    let house = House::new(FILE);
    for end in (0..FILE.len()).step_by(3) {
        std::fs::write(house.file(), &FILE[..end]).expect("a file");
        let loaded =
            Ecosystem::load_with(&house.file(), &house.variables, &house.overrides, PLUGINS);
        if let Err(err) = loaded {
            assert!(err.into_report().has_errors(), "refused without a reason: {}", &FILE[..end]);
        }
    }
}

#[test]
fn invalid_toml_yields_only_syntax_errors() {
    let house = House::new("this is = = no table\n");
    let loaded = Ecosystem::load_with(&house.file(), &house.variables, &house.overrides, PLUGINS);
    let report = loaded.expect_err("it is none").into_report();
    let findings = format!("{:?}", report.findings());
    assert!(findings.contains("not TOML") && !findings.contains("is missing"), "{findings}");
}

#[test]
fn goals_of_the_file_have_times() {
    let times = |goals: &str| {
        let text = FILE.replace("[goals]", &format!("[goals]\n{goals}\n"));
        House::new(&text).load().goals.by_themselves.clone()
    };
    assert_eq!(times("").goals, []);
    let found = times(
        "day = { goal = \"(known hall)\", every = \"day 08:00\", on = \"workdays\", for = \"2h\" }\n\
         warm = { goal = \"(known hall)\", keep = \"maintain\", ask = \"always\" }\n\
         plain = \"(known hall)\"",
    );
    let names: Vec<_> = found.goals.iter().map(|goal| (&*goal.name, goal.is_always)).collect();
    assert_eq!(names, [("day", false), ("warm", true)]);
    assert_eq!(found.goals[0].times.lasts.as_deref(), Some("2h"));
}

#[test]
fn times_of_goals_are_checked_at_their_places() {
    let mistakes = |goal: &str| {
        let text = FILE
            .replace("[goals]", &format!("[goals]\nx = {{ goal = \"(known hall)\", {goal} }}\n"));
        mistakes_of(&House::new(&text))
    };
    for (goal, part) in [
        ("every = \"fortnight\"", "is no recurrence"),
        ("at = \"08:00\"", "a single time needs its date"),
        ("by = \"08:00\"", "nothing says when the goal is asked for"),
        ("ask = \"always\"", "only a kept goal is asked for always"),
        ("between = \"08:00-18:00\"", "keep it"),
        ("every = \"year 02-30 08:00\"", "never comes"),
    ] {
        let found = mistakes(goal);
        assert!(found.contains(part), "{goal}: {found}");
    }
    let zone = FILE.replace("[ecosystem]", "[ecosystem]\ntime-zone = \"Middle/Earth\"");
    assert!(mistakes_of(&House::new(&zone)).contains("Middle/Earth"));
}

#[test]
fn an_empty_path_is_a_mistake() {
    for (place, key) in [("people", "file"), ("security", "folder"), ("plugins", "folder")] {
        let text = format!("{FILE}\n[{place}]\n{key} = \" \"\n");
        let found = mistakes_of(&House::new(&text));
        let expected = format!("`{place}.{key}` must be a path in quotes, which is not empty");
        assert!(found.contains(&expected), "{found}");
    }
    let text = FILE.replace("\"domain.pddl\"", "\"\"");
    assert!(mistakes_of(&House::new(&text)).contains("`ecosystem.domain` must be a path"));
}
