//! Tests of the parts of other agents' models that an actuator's snapshot shows or hides.

use capability::text_of;
use expect_test::expect;

use crate::office::{Office, id, ir_sensor, model, office_of, thermometer, turtlebot};

/// Returns the office in the scope of the actuator `turtlebot-1`. This robot can carry `ir-1`, and
/// there is another robot.
fn local() -> Office {
    let ir = ir_sensor("ir-1", "turtlebot-1");
    office_of("turtlebot-1").with([turtlebot("turtlebot-1"), turtlebot("turtlebot-2"), ir])
}

#[test]
fn a_snapshot_hides_the_actions_and_private_facts_of_others() {
    let office = local();
    let problem = office.snapshot().problem;
    expect![[r#"
        (define (problem map)
          (:domain smart-office)
          (:objects
            office2 - room
            corridor - location
            (:private dock-of-turtlebot-1 - location)
            ir-1 - ir-temperature-sensor
            turtlebot-1 turtlebot-2 - turtlebot)
          (:init
            (= (total-cost) 0)
            (at turtlebot-1 corridor)
            (at turtlebot-2 corridor)
            (connected corridor office2)
            (docked turtlebot-1)
            (mounted-on ir-1 turtlebot-1)
            (= (distance corridor office2) 6)
            (= (speed turtlebot-1) 0.3)
            (= (speed turtlebot-2) 0.3)
            (offers-move turtlebot-1))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]]
    .assert_eq(&problem.to_string());
    assert_eq!(office.actions(), "move");
    let methods: Vec<_> = office.snapshot().methods.into_keys().collect();
    assert_eq!(methods, [id("turtlebot-1")]);
}

#[test]
fn carried_agents_are_fully_visible() {
    let office = Office { eyes: Some([id("turtlebot-1"), id("ir-1")].into()), ..local() };
    assert_eq!(office.actions(), "move report-temperature");
    assert_eq!(office.known("offers-report-temperature"), "(offers-report-temperature ir-1)");
    let other = Office { eyes: Some([id("turtlebot-2")].into()), ..office };
    assert_eq!(other.actions(), "move");
    assert_eq!(other.known("offers-move"), "(offers-move turtlebot-2)");
}

/// An agent is carried if its model contains such a fact, with any predicate.
#[test]
fn carried_agents_are_detected_with_any_predicate() {
    for (declared, fact, is_carried) in [
        ("(arm-on ?a - arm ?b - mobile-base)", "(arm-on arm-1 turtlebot-1)", true),
        ("(carries ?b - mobile-base ?a - arm)", "(carries turtlebot-1 arm-1)", true),
        (
            "(fixed-to ?a - arm ?b - mobile-base ?s - side)",
            "(fixed-to arm-1 turtlebot-1 front)",
            true,
        ),
        // A fact about a third object that also names the two, and a fact that the agent's own
        // actions change.
        (
            "(between ?s - side ?b - mobile-base ?a - arm)",
            "(between front turtlebot-1 arm-1)",
            false,
        ),
        ("(holding ?a - arm ?i - object)", "(holding arm-1 turtlebot-1)", false),
        ("(arm-on ?a - arm ?b - mobile-base)", "(unknown (arm-on arm-1 turtlebot-1))", false),
    ] {
        let held = match declared.starts_with("(holding") {
            true => "",
            false => "(holding ?a - arm ?i - object)",
        };
        let arm = model(
            "arm-1",
            &format!(
                "(:types arm item side - object) (:objects arm-1 - arm front - side)
                 (:predicates {declared} {held}) (:init {fact})
                 (:action drop :agent ?a - arm :parameters (?i - object)
                   :precondition (holding ?a ?i) :effect (not (holding ?a ?i)))"
            ),
        );
        let office = local().with([arm]);
        let carried = |base| office.maintainer.with_carried(&id(base));
        let has_arm = carried("turtlebot-1").contains(&id("arm-1"));
        assert_eq!(has_arm, is_carried, "{fact}");
        assert!(carried("turtlebot-1").contains(&id("ir-1")), "{fact}");
        assert_eq!(carried("turtlebot-2"), [id("turtlebot-2")].into(), "{fact}");
    }
}

#[test]
fn the_shared_snapshot_contains_no_actions() {
    let office = local();
    let shared = office.maintainer.snapshot(office.now);
    assert!(shared.domain.actions.is_empty() && shared.methods.is_empty());
    assert!(shared.offers().is_empty());
}

#[test]
fn an_invisible_action_does_not_qualify_names() {
    let office = local().with([thermometer("t-1")]);
    let office = Office { eyes: Some([id("turtlebot-1"), id("ir-1")].into()), ..office };
    assert_eq!(office.actions(), "move report-temperature");
}

#[test]
fn private_facts_of_others_are_never_shown() {
    let mut office = local();
    let said = "(docked turtlebot-2) (at turtlebot-2 dock-of-turtlebot-2)
        (connected corridor dock-of-turtlebot-2)";
    let change = office.beat("turtlebot-2", (1, 1), said, "").expect("a heartbeat");
    assert!(change.believed.is_empty(), "{change:?}");
    let shown: Vec<_> =
        office.maintainer.provenance(office.now).into_iter().map(|known| known.fact).collect();
    let shown = text_of(&shown) + &office.snapshot().domain.to_string();
    assert!(!shown.contains("dock-of-turtlebot-2") && !shown.contains("(docked turtlebot-2)"));
    assert_eq!(office.known("docked"), "(docked turtlebot-1)");
}
