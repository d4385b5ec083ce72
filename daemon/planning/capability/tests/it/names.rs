//! Tests of the names of actions inside and outside the composite domain.

use crate::office::{Office, ir_sensor, model, office, step, thermometer};

fn sensors() -> Office {
    office().with([thermometer("t-1"), ir_sensor("ir-1", "base"), thermometer("t-0")])
}

const BOTH: &str = "report-temperature--ir-1 report-temperature--t-1";

#[test]
fn a_variant_is_named_after_its_first_agent() {
    assert_eq!(sensors().actions(), BOTH);
}

#[test]
fn a_name_remains_after_its_agent_has_left() {
    let mut office = sensors();
    office.remove("t-1");
    assert_eq!(office.actions(), BOTH);
    assert_eq!(
        office.known("offers-report-temperature--t-1"),
        "(offers-report-temperature--t-1 t-0)"
    );
}

#[test]
fn a_qualified_name_remains_while_its_variant_exists() {
    let mut office = sensors();
    office.remove("ir-1");
    assert_eq!(office.actions(), "report-temperature--t-1");
    office.remove("t-0");
    office.remove("t-1");
    office.admit(&thermometer("t-0"));
    assert_eq!(office.actions(), "report-temperature");
}

#[test]
fn steps_are_translated_in_both_directions() {
    let snapshot = sensors().snapshot();
    for (outside, inside) in [
        ("(report-temperature t-0 office2)", "(report-temperature--t-1 t-0 office2)"),
        ("(report-temperature ir-1 base office2)", "(report-temperature--ir-1 ir-1 base office2)"),
        ("(dance t-0)", "(dance t-0)"),
        ("(report-temperature nobody)", "(report-temperature nobody)"),
    ] {
        assert_eq!(snapshot.inside(&step(outside)), step(inside));
        assert_eq!(snapshot.outside(&step(inside)), step(outside));
    }
}

#[test]
fn names_are_unique_whatever_agents_call_their_actions() {
    let act = |name: &str, action: &str, effect: &str| {
        let sections = format!(
            "(:objects {name} - sensor) (:action {action} :agent ?s - sensor :effect {effect})"
        );
        model(name, &sections)
    };
    let office = office().with([
        act("a", "look", "(known-temperature office2)"),
        act("b", "look--a", "(and)"),
        act("c", "look", "(and)"),
    ]);
    assert_eq!(office.actions(), "look--a look--a-2 look--c");
    // An action with the name `look--c` joins. It is qualified, because another action already has
    // that name.
    let office = office.with([act("d", "look--c", "(and)")]);
    assert_eq!(office.actions(), "look--a look--a-2 look--c look--c--d");
}
