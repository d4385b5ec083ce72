//! Mistakes in the file of a home with tables of rooms and doors: each is reported once, at its place,
//! without what only follows from it.

use crate::mistakes::{ERROR, MAP, WARNING, changed, check, told};

/// A home of three rooms.
const HOME: &str = r#"[ecosystem]
name = "home"
[rooms]
living-room = {}
kitchen = {}
bedroom = {}
[doors]
living-room = { kitchen = 4.0, bedroom = 6.0 }
[[agent]]
name = "thermometer-kitchen"
plugin = "temperature-sensor"
config = { location = "kitchen" }
[[agent]]
name = "robot"
plugin = "turtlebot"
config = { start = "living-room", speed = 0.3 }
[[agent]]
name = "thermometer-robot"
plugin = "ir-temperature-sensor"
config = { mounted-on = "robot" }
[goals]
warm = { goal = "(forall (?r - room) (known-temperature ?r))", keep = "maintain", ask = "always" }
"#;

/// Checks that the home with `from` replaced by `to` has one mistake, at this line.
#[track_caller]
fn one(severity: &str, from: &str, to: &str, line: usize, words: &[&str]) {
    check(&changed(HOME, from, to), MAP, severity, &format!("files/school.toml:{line}"), words);
}

#[test]
fn the_home_has_no_mistake() {
    assert_eq!(told(HOME, MAP), []);
}

#[test]
fn tables_by_a_wrong_name_are_one_mistake() {
    one(ERROR, "[rooms]", "[room]", 3, &["unknown key `room`", "`[rooms]`"]);
    one(ERROR, "[doors]", "[door]", 7, &["unknown key `door`", "`[doors]`"]);
    let agents = "[[agents]]\nname = \"robot\"";
    one(ERROR, "[[agent]]\nname = \"robot\"", agents, 13, &["`agents`", "`[[agent]]`"]);
    let list = "rooms = [\"living-room\", \"kitchen\", \"bedroom\"]";
    let rooms = "[rooms]\nliving-room = {}\nkitchen = {}\nbedroom = {}";
    one(ERROR, rooms, list, 3, &["`rooms` in `ecosystem`", "a table of its own, [rooms]"]);
}

#[test]
fn a_wrong_name_of_an_agent_is_one_mistake() {
    let spaced = HOME.replace("\"robot\"", "\"my robot\"");
    check(&spaced, MAP, ERROR, "files/school.toml:14", &["`my robot`", "`my-robot`"]);
    // Another agent that is missing is another mistake.
    let missing = spaced.replacen("mounted-on = \"my robot\"", "mounted-on = \"rover\"", 1);
    assert_eq!(told(&missing, MAP).len(), 2);
    let place = ["there is no agent `kitchen`", "location = \"kitchen\""];
    one(ERROR, "mounted-on = \"robot\"", "mounted-on = \"kitchen\"", 20, &place);
}

#[test]
fn nothing_is_said_of_ways_while_a_robot_or_a_door_is_wrong() {
    one(ERROR, "start = \"living-room\", ", "", 16, &["`start` is missing"]);
    one(ERROR, "\"living-room\", speed", "\"livingroom\", speed", 16, &["`living-room`"]);
    // The bedroom has a door that is an agent.
    let door = |config: &str| {
        let entry =
            format!("[[agent]]\nname = \"door\"\nplugin = \"door\"\nconfig = {{ {config} }}\n");
        let home = HOME.replacen(", bedroom = 6.0", "", 1);
        home.replacen("[goals]", &format!("{entry}[goals]"), 1)
    };
    assert_eq!(told(&door("between = [\"kitchen\", \"bedroom\"], length = 3"), MAP), []);
    for (config, words) in [
        ("between = [\"kitchen\", \"bedrom\"]", "there is no `bedrom` under [rooms]"),
        ("between = [\"kitchen\"]", "`between` names the two places"),
        ("between = [\"kitchen\", \"bedroom\", \"living-room\"]", "`between` names the two places"),
        ("betwen = [\"kitchen\", \"bedroom\"]", "did you mean `between`?"),
    ] {
        check(&door(config), MAP, ERROR, "files/school.toml:24", &[words]);
    }
}

#[test]
fn another_word_for_a_plugin_is_understood() {
    for (plugin, meant) in
        [("thermometer", "temperature-sensor"), ("lamp", "switch"), ("tv", "screen")]
    {
        let to = format!("plugin = \"{plugin}\"");
        let meant = format!("did you mean `{meant}`?");
        one(ERROR, "plugin = \"temperature-sensor\"", &to, 11, &["unknown plugin", &meant]);
    }
}

#[test]
fn times_of_a_goal_are_corrected() {
    let always = "ask = \"always\"";
    one(ERROR, always, "every = \"8:00\"", 22, &["is no recurrence", "write \"day 8:00\""]);
    let weekday = "every = \"day 08:00\", on = \"weekday\"";
    one(ERROR, always, weekday, 22, &["`weekday` names no days", "did you mean workdays?"]);
    one(ERROR, "\"maintain\"", "\"mantain\"", 22, &["did you mean \"maintain\"?"]);
}

#[test]
fn a_goal_by_unknown_words_is_one_mistake() {
    let goal = "(forall (?r - room) (known-temperature ?r))";
    let permuted = "(forall (?r - room) (temperature-known ?r))";
    one(ERROR, goal, permuted, 22, &["unknown predicate", "did you mean `known-temperature`?"]);
    one(WARNING, goal, "(known-co2 kitchen)", 22, &["can ever make `(known-co2 kitchen)` true"]);
    // In the language of the file, although German words are near, too.
    let told = told(&HOME.replacen(goal, "the kitchen is warm", 1), MAP);
    let [(_, _, text)] = told.as_slice() else { panic!("one mistake: {told:#?}") };
    assert!(!text.contains("trägt"), "{text}");
}

#[test]
fn a_goal_that_no_agent_can_reach_is_told() {
    let goal = "(forall (?r - room) (known-temperature ?r))";
    let words = |fact: &str| format!("no agent of this file can ever make `{fact}` true");
    one(WARNING, goal, "(known-co2 kitchen)", 22, &[&words("(known-co2 kitchen)"), "none makes"]);
    // Without the thermometer of the robot, only the kitchen is measured.
    let robot = "[[agent]]\nname = \"thermometer-robot\"\nplugin = \"ir-temperature-sensor\"\n\
                 config = { mounted-on = \"robot\" }\n";
    assert!(HOME.contains(robot));
    let home = HOME.replacen(robot, "", 1);
    let elsewhere =
        ["can ever make `(known-temperature ", "`thermometer-kitchen` does this elsewhere"];
    check(&home, MAP, WARNING, "files/school.toml:18", &elsewhere);
    for reached in ["(known-temperature kitchen)", "(at robot bedroom)"] {
        assert_eq!(told(&home.replacen(goal, reached, 1), MAP), [], "{reached}");
    }
    // A gateway may bring agents that nobody knows before it runs.
    let gateway = "[[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\n\
                   config = { broker = \"localhost:1883\" }\n[goals]";
    assert_eq!(told(&home.replacen("[goals]", gateway, 1), MAP), []);
}
