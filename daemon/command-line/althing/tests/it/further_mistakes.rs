//! Mistakes about daemons, files with secrets, times, goals and channels in the file of a home: each
//! is reported once, at its place, and with what would be right.

use crate::mistakes::{ERROR, MAP, WARNING, changed, check, told};

/// A home of two rooms.
const HOME: &str = r#"[ecosystem]
name = "home"
[rooms]
hall = { kind = "corridor" }
kitchen = { floor = 1, area = 12.5 }
[doors]
hall = { kitchen = 4.0 }
[[agent]]
name = "thermometer-kitchen"
plugin = "temperature-sensor"
config = { location = "kitchen" }
[[agent]]
name = "robot"
plugin = "turtlebot"
config = { start = "hall", speed = 0.3 }
[goals]
first = { goal = "(known-temperature kitchen)" }
"#;

/// The line of the goal.
const GOAL: usize = 17;

#[track_caller]
fn one(severity: &str, from: &str, to: &str, line: usize, words: &[&str]) {
    check(&changed(HOME, from, to), MAP, severity, &format!("files/school.toml:{line}"), words);
}

/// Checks the one report about the goal `goal`.
#[track_caller]
fn goal(severity: &str, goal: &str, words: &[&str]) {
    one(severity, "(known-temperature kitchen)", goal, GOAL, words);
}

#[test]
fn the_home_has_no_mistake() {
    assert_eq!(told(HOME, MAP), []);
}

#[test]
fn an_agent_that_no_daemon_hosts_is_reported() {
    let daemons = "name = \"home\"\ndaemons = [\"desk\", \"hall-pi\"]\nreasoning = \"desk\"";
    let text = changed(HOME, "name = \"home\"", daemons);
    let found = told(&text, MAP);
    assert_eq!(found.len(), 2, "{found:#?}");
    for agent in ["thermometer-kitchen", "robot"] {
        let message = format!("no daemon hosts `{agent}`");
        assert!(found.iter().any(|it| format!("{it:?}").contains(&message)), "{found:#?}");
    }
    // A single daemon hosts all.
    let daemons = "name = \"home\"\ndaemons = [\"desk\"]\nreasoning = \"desk\"";
    assert_eq!(told(&changed(HOME, "name = \"home\"", daemons), MAP), []);
}

#[test]
fn a_misspelt_daemon_hosts_only_agents_that_plan() {
    let reasoning = |name: &str, list: &str| {
        let text = changed(
            HOME,
            "name = \"home\"",
            &format!("name = \"home\"\n{list}reasoning = \"{name}\""),
        );
        text.replace("plugin = \"t", "daemon = \"office-pi\"\nplugin = \"t")
    };
    let place = "files/school.toml:3";
    check(&reasoning("ofice-pi", ""), MAP, WARNING, place, &["did you mean `office-pi`?"]);
    assert_eq!(told(&reasoning("office-pi", ""), MAP), []);
    assert_eq!(told(&reasoning("desk", ""), MAP), []);
}

#[test]
fn a_file_with_a_secret_is_looked_for() {
    let channel = "[[agent]]\nname = \"n\"\nplugin = \"notifier\"\n[[agent.config.to]]\n\
                   kind = \"ntfy\"\nurl = \"https://ntfy.example/t\"\ntoken-file = \"none\"\n[goals]";
    one(WARNING, "[goals]", channel, 22, &["there is no file", "`n` needs it", "mode 600"]);
}

#[test]
fn the_mistake_of_a_channel_is_at_its_value() {
    let channels = |first: &str, second: &str| {
        let channel = |more: &str| {
            format!(
                "[[agent.config.to]]\nkind = \"ntfy\"\nurl = \"https://ntfy.example/t\"\n{more}"
            )
        };
        let agent = "[[agent]]\nname = \"n\"\nplugin = \"notifier\"\n";
        changed(HOME, "[goals]", &format!("{agent}{}{}[goals]", channel(first), channel(second)))
    };
    assert_eq!(told(&channels("", ""), MAP), []);
    let second = channels("", "quiet = \"22-7\"\n");
    check(&second, MAP, ERROR, "files/school.toml:25", &["channel 2", "`quiet"]);
    let first = channels("until = \"soon\"\n", "");
    check(&first, MAP, ERROR, "files/school.toml:22", &["channel 1", "`until"]);
    let kind = channels("", "").replacen("kind = \"ntfy\"", "kind = \"mail\"", 1);
    check(&kind, MAP, ERROR, "files/school.toml:20", &["`kind` cannot be \"mail\"", "\"email\""]);
}

#[test]
fn two_services_at_one_address_are_reported() {
    let web = |address: &str| {
        format!("[metrics]\nlisten = \"127.0.0.1:8650\"\n[web]\nlisten = \"{address}\"\n[goals]")
    };
    let metrics = "files/school.toml:17";
    let words = ["`metrics.listen` and `web.listen`", "another port, such as 8651"];
    check(&changed(HOME, "[goals]", &web("127.0.0.1:8650")), MAP, ERROR, metrics, &words);
    assert_eq!(told(&changed(HOME, "[goals]", &web("127.0.0.1:8651")), MAP), []);
    let zenoh = "[metrics]\nlisten = \"127.0.0.1:7447\"\n[zenoh.listen]\n\
                 endpoints = [\"tcp/127.0.0.1:7447\"]\n[goals]";
    one(ERROR, "[goals]", zenoh, 17, &["`metrics.listen` and `zenoh.listen.endpoints.0`"]);
}

#[test]
fn plain_text_that_leaves_the_machine_is_reported() {
    let zenoh = |security: &str, endpoint: &str| {
        format!("{security}[zenoh.connect]\nendpoints = [\"{endpoint}\"]\n[goals]")
    };
    let words = ["as plain text", "write [security]"];
    one(WARNING, "[goals]", &zenoh("", "tcp/192.168.1.2:7447"), 17, &words);
    assert_eq!(told(&changed(HOME, "[goals]", &zenoh("", "tcp/127.0.0.1:7447")), MAP), []);
    assert_eq!(
        told(&changed(HOME, "[goals]", &zenoh("[security]\n", "tls/192.168.1.2:7447")), MAP),
        []
    );
}

#[test]
fn a_misspelt_daemon_of_the_rights_is_reported() {
    let daemons =
        "name = \"home\"\ndaemons = [\"desk\"]\nreasoning = \"desk\"\n[security]\n[rights]\n";
    let guests =
        |names: &str| changed(HOME, "name = \"home\"", &format!("{daemons}guests = [{names}]"));
    let place = "files/school.toml:7";
    check(&guests("\"dek\""), MAP, WARNING, place, &["`dek`", "did you mean `desk`?"]);
    assert_eq!(told(&guests("\"desk\", \"anna-laptop\""), MAP), []);
}

#[test]
fn a_duration_without_sense_is_reported() {
    let valid = "location = \"kitchen\", valid-for = \"0s\"";
    one(ERROR, "location = \"kitchen\"", valid, 11, &["`0s`", "between 1ms and"]);
    let endless =
        "location = \"kitchen\", command = [\"cat\"], every = \"0s\" }\ndriver = \"command\"";
    one(ERROR, "location = \"kitchen\" }", endless, 11, &["`0s`", "between 10ms and"]);
}

#[test]
fn a_time_that_is_past_is_reported() {
    let at = "\", at = \"2020-01-01T08:00";
    goal(WARNING, &format!("(known-temperature kitchen){at}"), &["is past", "asked for no more"]);
    let until = "\", every = \"day 08:00\", until = \"2020-12-24";
    goal(WARNING, &format!("(known-temperature kitchen){until}"), &["is past"]);
}

#[test]
fn a_goal_in_another_order_is_explained() {
    goal(ERROR, "(>= (temperature kitchen) 21,5)", &["(>= (temperature kitchen) 21.5)"]);
    goal(ERROR, "(temperature kitchen >= 21)", &["(>= (temperature kitchen) 21)"]);
    goal(ERROR, "(not known-temperature kitchen)", &["(not (known-temperature kitchen))"]);
    goal(ERROR, "(kitchen known-temperature)", &["write (known-temperature kitchen)"]);
    goal(ERROR, "(move robot hall kitchen)", &["`move` is an action of `robot`", "(at "]);
}

#[test]
fn a_goal_that_asks_for_nothing_or_for_the_impossible_is_reported() {
    goal(WARNING, "(and)", &["asks for nothing"]);
    goal(WARNING, "(or)", &["can never hold"]);
    goal(WARNING, "(lit kitchen)", &["no agent of this file can ever make `(lit kitchen)` true"]);
}

#[test]
fn what_is_written_instead_is_taken_next() {
    one(ERROR, "floor = 1", "floor = \"1\"", 5, &["write floor = 1"]);
    one(ERROR, "area = 12.5", "area = -12.5", 5, &["above zero", "write area = 12.5"]);
    let lasts = "(known-temperature kitchen)\", every = \"day 08:00\", for = 2, keep = \"maintain";
    goal(ERROR, lasts, &["for = \"2h\""]);
    let lamp = |line: &str| {
        let config = format!("location = \"kitchen\", kind = \"lamp\", line = {line}");
        format!(
            "[[agent]]\nname = \"lamp\"\nplugin = \"switch\"\ndriver = \"gpio\"\nconfig = {{ {config} }}\n[goals]"
        )
    };
    one(ERROR, "[goals]", &lamp("4"), 20, &["write line = \"GPIO4\""]);
    assert_eq!(told(&changed(HOME, "[goals]", &lamp("\"GPIO4\"")), MAP), []);
}

#[test]
fn the_words_of_a_file_are_checked() {
    let words = |entry: &str| format!("[words.en.predicates]\n{entry}\n[goals]");
    let cases = [
        (ERROR, "lit = { phrase = \"shines\" }", "has no place"),
        (WARNING, "litt = { phrase = \"{1} shines\" }", "did you mean `lit`?"),
        (ERROR, "lit = { phrse = \"{1} shines\" }", "did you mean `phrase`?"),
    ];
    for (severity, entry, cure) in cases {
        one(severity, "[goals]", &words(entry), 17, &[cure]);
    }
    assert_eq!(
        told(&changed(HOME, "[goals]", &words("lit = { phrase = \"{1} shines\" }")), MAP),
        []
    );
}

#[test]
fn a_key_of_another_driver_has_two_cures() {
    let device = "location = \"kitchen\", device = \"x@y\"";
    let words = ["leave `device` out, or write driver = \"linux\""];
    one(ERROR, "location = \"kitchen\"", device, 11, &words);
    let number = "location = \"kitchen\", device = \"hwmon0\" }\ndriver = \"linux\"";
    one(ERROR, "location = \"kitchen\" }", number, 11, &["NAME@PLACE"]);
}
