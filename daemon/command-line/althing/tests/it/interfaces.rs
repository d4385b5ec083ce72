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
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): ok
            ecosystems/house.toml: ecosystem house (7 agents, 2 daemons, decentralized): ok
        "#]], expect![""]);
}

#[test]
fn a_private_symbol_is_refused_at_its_place() {
    firm("clean = \"swept\" }", "clean = \"swept\", has-room = \"bin-free\" }")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `bin-free` is private to `sweeper-1`
              --> ecosystems/firm.toml:29:85
               |
            29 | ... clean = "swept", has-room = "bin-free" }
               |                                 ^^^^^^^^^^
               |
               = help: nothing private ever passes: take it out

            1 error
        "#]]);
}

#[test]
fn a_private_object_of_the_map_is_refused_at_its_place() {
    let firm = firm("", "");
    // Only a map in PDDL has private objects.
    let (_, house) = shipped!("ecosystems/house.toml");
    let tables =
        house.find("[rooms]").expect("it has rooms")..house.find("[[agent]]").expect("agents");
    let house = house.replacen(&house[tables], "", 1).replacen(
        "mode = ",
        "domain = \"words.pddl\"\nproblem = \"map.pddl\"\nmode = ",
        1,
    );
    firm.write("ecosystems/house.toml", house.as_bytes());
    firm.write("ecosystems/words.pddl", ontology::STANDARD_DOMAIN.as_bytes());
    let map = "(define (problem second-floor) (:domain smart-office)
      (:objects room-217 room-218 room-219 - room corridor-2 lift - corridor
        (:private lobby - corridor))
      (:init (= (total-cost) 0)) (:goal (and)) (:metric minimize (total-cost)))";
    firm.write("ecosystems/map.pddl", map.as_bytes());
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
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `move` is not exported: it needs the predicate `connected`, which is
                   not exported
              --> ecosystems/firm.toml:45:20
               |
            45 | actions = { walk = "move", tidy = "sweep" }
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
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `move` is not exported: its cost depends on the function `distance`,
                   which is not exported
              --> ecosystems/firm.toml:45:20
               |
            45 | actions = { walk = "move", tidy = "sweep" }
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
                ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `plan-requester` is an agent of this ecosystem already
              --> ecosystems/firm.toml:44:6
               |
            44 | as = "plan-requester"                        # its name here
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
                ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `blue-room` stands for `room-217` already
              --> ecosystems/firm.toml:33:12
               |
            33 | red-room = "room-217"
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
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): ok
        "#]], expect![[r#"
            warning: the other ecosystem's file has no actuator `sweper-1`
              --> ecosystems/firm.toml:43:9
               |
            43 | agent = "sweper-1"
               |         ^^^^^^^^^^
               |
               = help: did you mean `sweeper-1`?

            1 warning
        "#]]);
    firm("\"cfp\", \"request\"", "\"shout\", \"request\"")
        .check("check ecosystems/firm.toml", 33)
        .shows(
            expect![[r#"
                ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
            "#]],
            expect![[r#"
            error: `interface.import.performatives` must be "inform" or "cfp" or "request"
                   or "cancel"
              --> ecosystems/firm.toml:46:28
               |
            46 | performatives = ["inform", "shout", "request", "cancel"]      # all ther...
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
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: `ecosystems/hut.toml` cannot be read: there is no such file
              --> ecosystems/firm.toml:21:13
               |
            21 | ecosystem = "hut.toml"       # its name, its words, its map, and where i...
               |             ^^^^^^^^^^
               |
               = help: paths are relative to the ecosystem file

            1 error
        "#]]);
    firm("goals = [\"clean\"]", "goals = [\"claen\"]")
        .check("check ecosystems/firm.toml", 33)
        .shows(expect![[r#"
            ecosystems/firm.toml: ecosystem firm (6 agents, 1 daemon, 1 interface, decentralized): has errors
        "#]], expect![[r#"
            error: goals about `claen` cannot pass: it is not under `predicates`
              --> ecosystems/firm.toml:52:9
               |
            52 | goals = ["claen"]
               |         ^^^^^^^^^
               |
               = help: did you mean `clean`?

            1 error
        "#]]);
}
