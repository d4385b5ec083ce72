//! `althing check` on ecosystem files: every kind of mistake, at its line, all at once.

use expect_test::{Expect, expect};

use crate::sandbox::Sandbox;

const HOUSE: &str = "\
(define (domain house)
  (:types room sensor)
  (:predicates (known ?r - room) (warm ?r - room)))
";

const MAP: &str = "\
(define (problem house-map)
  (:domain house)
  (:objects kitchen hall - room)
  (:init (warm hall))
  (:goal (and)))
";

const ECOSYSTEM: &str = r#"[ecosystem]
name = "house"
domain = "house.pddl"
problem = "map.pddl"

[[agent]]
name = "thermometer"
plugin = "temperature-sensor"
driver = "simulated"
config = { location = "kitchen" }

[goals]
temperatures = "(forall (?r - room) (known ?r))"

[[agent]]
name = "domain-maintainer"
plugin = "domain-maintainer"

[[agent]]
name = "plan-requester"
plugin = "plan-requester"

[[agent]]
name = "plan-executor"
plugin = "plan-executor"
"#;

fn house(ecosystem: &str) -> Sandbox {
    Sandbox::new(&[("house.pddl", HOUSE), ("map.pddl", MAP), ("house.toml", ecosystem)])
}

/// Checks the output for the ecosystem after one text in it is replaced.
#[track_caller]
fn check(from: &str, to: &str, expected: Expect) {
    assert!(ECOSYSTEM.contains(from), "{from}");
    let run = house(&ECOSYSTEM.replace(from, to)).check("check house.toml", 33);
    expected.assert_eq(&run.stderr);
}

#[test]
fn a_file_without_mistakes_has_one_line() {
    // Beside goals, sensors that no goal asks for are noted.
    let goals = "[goals]\ntemperatures = \"(forall (?r - room) (known ?r))\"\n\n";
    assert!(ECOSYSTEM.contains(goals));
    // A domain without the words of its agents would leave their actions out.
    let domain = HOUSE.replace("room sensor)", "room temperature-sensor)");
    let words =
        "(known-temperature ?r - room) (located ?s - temperature-sensor ?r - room) (warm ?r";
    let domain = domain.replace("(warm ?r", words);
    let ecosystem = ECOSYSTEM.replace(goals, "");
    let files = [("house.pddl", &*domain), ("map.pddl", MAP), ("house.toml", &ecosystem)];
    Sandbox::new(&files).check("check house.toml", 0).shows(
        expect![[r#"
            house.toml: ecosystem house (4 agents on one machine, decentralized): ok
        "#]],
        expect![""],
    );
}

/// A table that is missing is reported in the file, where it can be written, although the defaults
/// have it.
#[test]
fn a_missing_table_is_reported_in_the_file() {
    house("[goals]\n").check("check house.toml", 33).shows(
        expect![[r#"
            house.toml: ecosystem: has errors
        "#]],
        expect![[r#"
            error: `name` is missing in `ecosystem`
             --> house.toml:1:1
              |
            1 | [goals]
              | ^
              |
              = help: write name = "smart-office" under [ecosystem]

            error: the file says nothing of the building: `[rooms]` is missing
             --> house.toml:1:1
              |
            1 | [goals]
              | ^
              |
              = help: write its places, one in a line, such as
                      [rooms]
                      office1 = {}
                      or name a domain and a map in PDDL by `domain` and `problem` under
                      [ecosystem]

            2 errors
        "#]],
    );
}

#[test]
fn the_environment_overrides_the_file() {
    let file = ECOSYSTEM.replacen("[[agent]]", "mode = \"decentralized\"\n\n[[agent]]", 1);
    let sandbox = house(&file).with_variable("ALTHING_ECOSYSTEM__MODE", "centralized");
    let run = sandbox.check("check house.toml", 0);
    assert!(run.stdout.contains("centralized"), "{}", run.stdout);
}

#[test]
fn mistakes_in_the_environment_are_shown_like_those_of_the_file() {
    house(ECOSYSTEM)
        .with_variable("ALTHING_ECOSYSTEM__MOD", "centralized")
        .with_variable("ALTHING_ECOSYSTEM__NAME", "Our House")
        .with_variable("ALTHING_TIMING__GRACE", "soon")
        .with_variable("ALTHING_AGENT__NAME", "x")
        .with_variable("ALTHING_LOG", "warn")
        .check("check house.toml", 33)
        .shows(
            expect![[r#"
            house.toml: ecosystem: has errors
        "#]],
            expect![[r#"
            error: `ALTHING_AGENT__NAME` is no key of an ecosystem file
             --> environment:1:1
              |
            1 | ALTHING_AGENT__NAME=x
              | ^^^^^^^^^^^^^^^^^^^
              |
              = help: agents are set in the ecosystem file only

            error: `ALTHING_ECOSYSTEM__MOD` is no key of an ecosystem file
             --> environment:2:1
              |
            2 | ALTHING_ECOSYSTEM__MOD=centralized
              | ^^^^^^^^^^^^^^^^^^^^^^
              |
              = help: did you mean `ALTHING_ECOSYSTEM__MODE`?

            error: `Our House` cannot be the name of an ecosystem
             --> environment:3:25
              |
            3 | ALTHING_ECOSYSTEM__NAME=Our House
              |                         ^^^^^^^^^
              |
              = help: use 1 to 64 of `a-z`, `0-9`, `-` and `_`, and begin with a letter,
                      such as `our-house`

            error: `timing.grace` must be a duration, such as "500ms", "2s" or "1min"
             --> environment:4:23
              |
            4 | ALTHING_TIMING__GRACE=soon
              |                       ^^^^
              |
              = help: write a number and ms, s, min or h, such as "500ms" or "2s"
              = rule: grace = "NUMBER(ms|s|min|h)"  # how long a plan bears the absence
                      of an agent

            4 errors
        "#]],
        );
}

#[test]
fn all_mistakes_are_found_in_one_pass() {
    let file = r#"[ecosystem]
name = "Our House"
domain = "hose.pddl"
problem = "map.pddl"
mode = "centralised"
daemons = ["kitchen-pi", "Kitchen Pi"]
colour = "red"

[timing]
grace = 5
heartbeat-period = "5s"

[[agent]]
name = "thermometer"
plugin = "temprature-sensor"

[[agent]]
name = "thermometer"
plugin = "turtlebot"
driver = "simulate"

[[agent]]
plugin = "keyboard"
driver = "simulated"
config = { mounted-on = "thermometr" }

[goals]
warm = "(warm hall"

[building]
temperatures = { hall = -300 }
"#;
    house(file).check("check house.toml", 33).shows(
        expect![[r#"
        house.toml: ecosystem: has errors
    "#]],
        expect![[r#"
        error: `Our House` cannot be the name of an ecosystem
         --> house.toml:2:8
          |
        2 | name = "Our House"
          |        ^^^^^^^^^^^
          |
          = help: use 1 to 64 of `a-z`, `0-9`, `-` and `_`, and begin with a letter,
                  such as `our-house`

        error: `hose.pddl` cannot be read: there is no such file
         --> house.toml:3:10
          |
        3 | domain = "hose.pddl"
          |          ^^^^^^^^^^^
          |
          = help: did you mean `house.pddl`?

        error: `ecosystem.mode` must be "centralized" or "decentralized"
         --> house.toml:5:8
          |
        5 | mode = "centralised"
          |        ^^^^^^^^^^^^^
          |
          = help: did you mean "centralized"?
          = rule: mode = "centralized" | "decentralized"  # the planning mode

        error: `Kitchen Pi` cannot be the name of a daemon
         --> house.toml:6:26
          |
        6 | daemons = ["kitchen-pi", "Kitchen Pi"]
          |                          ^^^^^^^^^^^^
          |
          = help: use 1 to 64 of `a-z`, `0-9`, `-` and `_`, and begin with a letter,
                  such as `kitchen-pi`

        error: unknown key `colour` in `ecosystem`
         --> house.toml:7:1
          |
        7 | colour = "red"
          | ^^^^^^
          |
          = help: known are name, domain, problem, vocabulary, reasoning, mode,
                  privacy, daemons, time-zone

        error: `timing.grace` must be a duration, such as "500ms", "2s" or "1min"
          --> house.toml:10:9
           |
        10 | grace = 5
           |         ^
           |
           = help: a duration has a unit and stands in quotes, such as "500ms"
           = rule: grace = "NUMBER(ms|s|min|h)"  # how long a plan bears the absence
                   of an agent

        error: `heartbeat-lease` (3.5s) must be longer than `heartbeat-period` (5s)
          --> house.toml:11:20
           |
        11 | heartbeat-period = "5s"
           |                    ^^^^
           |
           = help: or an agent is declared gone between two of its heartbeats

        error: unknown plugin `temprature-sensor`
          --> house.toml:15:10
           |
        15 | plugin = "temprature-sensor"
           |          ^^^^^^^^^^^^^^^^^^^
           |
           = help: did you mean `temperature-sensor`?

        error: two agents are called `thermometer`
          --> house.toml:18:8
           |
        14 | name = "thermometer"
           |        ------------- the first
        ...
        18 | name = "thermometer"
           |        ^^^^^^^^^^^^^
           |
           = help: give this one a name of its own

        error: plugin `turtlebot` has no driver `simulate`
          --> house.toml:20:10
           |
        20 | driver = "simulate"
           |          ^^^^^^^^^^
           |
           = help: did you mean `simulated`?

        error: `name` is missing in `agent`
          --> house.toml:22:1
           |
        22 | [[agent]]
           | ^^^^^^^^^
           |
           = help: write name = "thermometer-office2"

        error: plugin `keyboard` has no driver `simulated`
          --> house.toml:24:10
           |
        24 | driver = "simulated"
           |          ^^^^^^^^^^^
           |
           = help: it needs none: leave the key out

        error: there is no agent `thermometr`
          --> house.toml:25:25
           |
        25 | config = { mounted-on = "thermometr" }
           |                         ^^^^^^^^^^^^
           |
           = help: did you mean `thermometer`?

        error: unclosed `(`
          --> house.toml:28:9
           |
        28 | warm = "(warm hall"
           |         ^ opened here
           |
           = help: add `)` at the end

        error: `building.temperatures.hall` must be a number from -273.15 to 1000
          --> house.toml:31:25
           |
        31 | temperatures = { hall = -300 }
           |                         ^^^^
           |
           = rule: hall = NUMBER  # the true temperature of each place, in °C

        15 errors
    "#]],
    );
}

#[test]
fn toml_that_cannot_be_read() {
    check(
        "name = \"house\"",
        "name = house",
        expect![[r#"
            error: not TOML: a text stands in quotes
             --> house.toml:2:8
              |
            2 | name = house
              |        ^^^^^
              |
              = help: write "house"

            1 error
        "#]],
    );
}

#[test]
fn a_key_that_is_there_twice() {
    check(
        "name = \"house\"\n",
        "name = \"house\"\nname = \"home\"\n",
        expect![[r#"
            error: not TOML: `name` is there already (line 2)
             --> house.toml:3:1
              |
            3 | name = "home"
              | ^^^^
              |
              = help: take one of the two out

            1 error
        "#]],
    );
}

#[test]
fn a_place_that_is_not_on_the_map() {
    check(
        "\"kitchen\"",
        "\"kichen\"",
        expect![[r#"
        error: there is no `kichen` on the map
          --> house.toml:10:23
           |
        10 | config = { location = "kichen" }
           |                       ^^^^^^^^
           |
           = help: did you mean `kitchen`?

        1 error
    "#]],
    );
}

#[test]
fn an_agent_that_is_called_like_a_place() {
    check(
        "name = \"thermometer\"",
        "name = \"hall\"",
        expect![[r#"
        error: `hall` is on the map already
         --> house.toml:7:8
          |
        7 | name = "hall"
          |        ^^^^^^
          |
          = help: an agent is an object of the composed domain, so its name must be
                  new

        1 error
    "#]],
    );
}

#[test]
fn a_goal_is_shown_where_it_stands_in_its_string() {
    check(
        "(known ?r)",
        "(knwon ?r)",
        expect![[r#"
        error: unknown predicate `knwon`
          --> house.toml:13:38
           |
        13 | temperatures = "(forall (?r - room) (knwon ?r))"
           |                                      ^^^^^
           |
           = help: did you mean `known`?
           = rule: (known ?r - room)

        1 error
    "#]],
    );
    check(
        "\"(forall (?r - room) (known ?r))\"",
        "'''\n(warm\n  hal)'''",
        expect![[r#"
        error: unknown object `hal`
          --> house.toml:15:3
           |
        15 |   hal)'''
           |   ^^^
           |
           = help: did you mean `hall`?

        1 error
    "#]],
    );
}

#[test]
fn a_goal_may_use_words_that_an_agent_brings() {
    let file = ECOSYSTEM.replace("(known ?r)", "(polished ?r)");
    let run = house(&file).check("check house.toml", 0);
    assert!(run.stderr.contains("warning: unknown predicate `polished`"), "{}", run.stderr);
}

#[test]
fn a_mistake_in_the_map_is_shown_in_the_map() {
    let sandbox = house(ECOSYSTEM);
    sandbox.write("map.pddl", MAP.replace("(warm hall)", "(worm hall)").as_bytes());
    let run = sandbox.check("check house.toml map.pddl house.pddl", 33);
    // The mistake is reported once, although the map is checked both by itself and with the
    // ecosystem.
    assert_eq!(run.stderr.matches("map.pddl:4:11").count(), 1, "{}", run.stderr);
}

#[test]
fn the_house_s_own_ecosystem_is_right() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");
    let run = Sandbox::new(&[]).run(&format!("check {root}/ecosystems/smart-office.toml"));
    assert_eq!(run.code, 0, "{}", run.stderr);
}

// === mistakes that only plugins can find ===

#[test]
fn a_key_that_the_plugin_does_not_know() {
    check(
        "{ location = \"kitchen\" }",
        "{ location = \"kitchen\", wattage = true }",
        expect![[r#"
            error: config of `thermometer`: there is no key `wattage`
              --> house.toml:10:34
               |
            10 | config = { location = "kitchen", wattage = true }
               |                                  ^^^^^^^
               |
               = help: known are `location`, `quantity`, `humidity`, `valid-for`,
                       `device`, `channel`, and 23 more

            1 error
        "#]],
    );
}

#[test]
fn a_value_of_another_kind() {
    check(
        "{ location = \"kitchen\" }",
        "{ location = \"kitchen\", humidity = 3 }",
        expect![[r#"
            error: config of `thermometer`: `humidity` must be true or false, and is 3
              --> house.toml:10:45
               |
            10 | config = { location = "kitchen", humidity = 3 }
               |                                             ^
               |
               = help: write humidity = true or humidity = false

            1 error
        "#]],
    );
}

#[test]
fn a_key_that_the_plugin_needs() {
    check(
        "{ location = \"kitchen\" }",
        "{ humidity = true }",
        expect![[r#"
            error: config of `thermometer`: `location` is missing
              --> house.toml:10:1
               |
            10 | config = { humidity = true }
               | ^^^^^^
               |
               = help: write location = "kitchen"

            1 error
        "#]],
    );
}

/// The file with the PIN exists only on the robot's own machine, not on the one that checks.
#[test]
fn a_mistake_within_a_table_of_a_config() {
    let robot = |login: &str| {
        format!(
            "{ECOSYSTEM}\n[[agent]]\nname = \"robot\"\nplugin = \"turtlebot\"\n\
             config = {{ start = \"kitchen\", login = {{ pin-file = \"/no/such\", {login} }} }}\n"
        )
    };
    house(&robot("attempts = 3")).check("check house.toml", 0);
    let run = house(&robot("attempts = 3, patience = \"soon\"")).check("check house.toml", 33);
    expect![[r#"
        warning: there is no file /no/such
          --> house.toml:30:52
           |
        30 | config = { start = "kitchen", login = { pin-file = "/no/such", attempts ...
           |                                                    ^^^^^^^^^^
           |
           = help: the machine that hosts `robot` needs it: one line with the secret,
                   mode 600

        error: config of `robot`: `login.patience` must be a duration, and is "soon"
          --> house.toml:30:89
           |
        30 | ...uch", attempts = 3, patience = "soon" } }
           |                                   ^^^^^^
           |
           = help: write a number and ms, s, min or h in quotes, such as "30s" or
                   "10min"

        1 error and 1 warning
    "#]]
    .assert_eq(&run.stderr);
    assert!(
        run.stdout.contains("house.toml: ecosystem house") && run.stdout.contains("has errors")
    );
}
