//! `althing check` on interfaces: a rule that would reveal something private, or lend an action
//! that cannot work, is reported at its place.

use expect_test::expect;

use crate::sandbox::Sandbox;

macro_rules! shipped {
    ($path:literal) => {
        ($path, include_str!(concat!("../../../../../", $path)))
    };
}

/// The firm and the house as shipped, with a change in the firm's file.
fn firm(from: &str, to: &str) -> Sandbox {
    let (path, text) = shipped!("ecosystems/firm.toml");
    assert!(text.contains(from), "{from}");
    Sandbox::new(&[
        shipped!("domains/house/domain.pddl"),
        shipped!("domains/house/map.pddl"),
        shipped!("domains/firm/domain.pddl"),
        shipped!("domains/firm/map.pddl"),
        shipped!("ecosystems/house.toml"),
        (path, &text.replacen(from, to, 1)),
    ])
}

#[test]
fn the_firm_as_shipped_is_right() {
    firm("", "")
        .check("check ecosystems/firm.toml ecosystems/house.toml", 0)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): ok
            ecosystems/house.toml: ecosystem house (5 agents, 2 daemons, decentralized): ok
        "#]], expect![""]);
}

#[test]
fn a_private_symbol_is_refused_at_its_place() {
    firm("clean = \"swept\" }", "clean = \"swept\", has-room = \"bin-free\" }")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `bin-free` is private to `sweeper-1`
              --> ecosystems/firm.toml:48:85
               |
            48 | ... clean = "swept", has-room = "bin-free" }
               |                                 ^^^^^^^^^^
               |
               = help: nothing private ever passes: take it out

            1 error
        "#]]);
}

#[test]
fn a_private_object_of_the_map_is_refused_at_its_place() {
    let firm = firm("", "");
    let map = include_str!("../../../../../domains/house/map.pddl");
    let with_secret =
        map.replacen("lift lobby - corridor)", "lift - corridor (:private lobby - corridor))", 1);
    assert_ne!(map, with_secret);
    firm.write("domains/house/map.pddl", with_secret.as_bytes());
    let run = firm.check("check ecosystems/firm.toml", 33);
    for said in ["`lobby` is private in the map of `house`", "entrance = \"lobby\"", "1 error"] {
        assert!(run.stderr.contains(said), "{said}: {}", run.stderr);
    }
}

#[test]
fn an_action_that_would_lose_a_precondition_is_refused() {
    firm("next-to = \"connected\", ", "")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `move` is not exported: it needs the predicate `connected`, which is
                   not exported
              --> ecosystems/firm.toml:64:20
               |
            64 | actions = { walk = "move", tidy = "sweep" }
               |                    ^^^^^^
               |
               = help: a plan there could have steps that cannot be carried out; export
                       `connected` too, under `predicates`, or leave the action out

            1 error
        "#]]);
}

#[test]
fn a_cost_that_would_be_lost_is_set_by_the_rule() {
    let without = "functions = { paces = \"distance\" }";
    firm(without, "")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `move` is not exported: its cost depends on the function `distance`,
                   which is not exported
              --> ecosystems/firm.toml:64:20
               |
            64 | actions = { walk = "move", tidy = "sweep" }
               |                    ^^^^^^
               |
               = help: say what it is to cost here: costs = { walk = 5 }

            1 error
        "#]]);
    let text = "actions = { walk = \"move\", tidy = \"sweep\" }";
    let (_, shipped) = shipped!("ecosystems/firm.toml");
    let sandbox = firm("", "");
    let priced =
        shipped.replace(without, "").replace(text, &format!("{text}\ncosts = {{ walk = 5 }}"));
    sandbox.write("ecosystems/firm.toml", priced.as_bytes());
    sandbox.check("check ecosystems/firm.toml", 0);
}

#[test]
fn colliding_and_ambiguous_names_are_refused() {
    firm("as = \"cleaner\"  ", "as = \"plan-requester\"")
        .check("check ecosystems/firm.toml", 33)
        .shows(
            expect![[r#"
                ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `plan-requester` is an agent of this ecosystem already
              --> ecosystems/firm.toml:63:6
               |
            63 | as = "plan-requester"                        # its name here
               |      ^^^^^^^^^^^^^^^^
               |
               = help: give it another name here: as = "…"

            1 error
        "#]],
        );
    firm("blue-room = \"room-218\"", "blue-room = \"room-217\"")
        .check("check ecosystems/firm.toml", 33)
        .shows(
            expect![[r#"
                ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `blue-room` stands for `room-217` already
              --> ecosystems/firm.toml:52:12
               |
            52 | red-room = "room-217"
               |            ^^^^^^^^^^
               |
               = help: it could not be translated back: give each a name of its own

            1 error
        "#]],
        );
}

#[test]
fn mistakes_in_a_rule_point_at_it() {
    firm("agent = \"sweeper-1\"", "agent = \"sweper-1\"")
        .check("check ecosystems/firm.toml", 0)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): ok
        "#]], expect![[r#"
            warning: the other ecosystem's file has no actuator `sweper-1`
              --> ecosystems/firm.toml:62:9
               |
            62 | agent = "sweper-1"
               |         ^^^^^^^^^^
               |
               = help: did you mean `sweeper-1`?

            1 warning
        "#]]);
    firm("\"cfp\", \"request\"", "\"shout\", \"request\"")
        .check("check ecosystems/firm.toml", 33)
        .shows(
            expect![[r#"
                ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `interface.import.performatives` must be "inform" or "cfp" or "request"
                   or "cancel"
              --> ecosystems/firm.toml:65:28
               |
            65 | performatives = ["inform", "shout", "request", "cancel"]      # all ther...
               |                            ^^^^^^^
               |
               = rule: performatives = "inform" | "cfp" | "request" | "cancel"  # what
                       passes to and from it

            1 error
        "#]],
        );
    firm("ecosystem = \"house.toml\" ", "ecosystem = \"hut.toml\"")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `ecosystems/hut.toml` cannot be read: there is no such file
              --> ecosystems/firm.toml:40:13
               |
            40 | ecosystem = "hut.toml"       # its name, its words, its map, and where i...
               |             ^^^^^^^^^^
               |
               = help: paths are relative to the ecosystem file

            1 error
        "#]]);
    firm("goals = [\"clean\"]", "goals = [\"claen\"]")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (4 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: goals about `claen` cannot pass: it is not under `predicates`
              --> ecosystems/firm.toml:71:9
               |
            71 | goals = ["claen"]
               |         ^^^^^^^^^
               |
               = help: did you mean `clean`?

            1 error
        "#]]);
}
