//! Tests of joint actions: actions in which several agents act.

use capability::text_of;
use expect_test::expect;

use crate::office::{Office, id, model, office, office_of, step};

/// A robot that carries a table with another one, or with a trolley.
fn carrier(name: &str, ty: &str) -> String {
    let sections = format!(
        "(:types robot trolley - mobile-base) (:objects {name} - {ty}) (:init (at {name} corridor))
         (:action carry :agent (?a - robot ?b - mobile-base) :parameters (?to - room)
            :precondition (and (at ?a corridor) (at ?b corridor))
            :effect (and (at ?a ?to) (at ?b ?to)))"
    );
    model(name, &sections)
}

fn hall() -> Office {
    office().with([carrier("r-1", "robot"), carrier("t-1", "trolley")])
}

#[test]
fn all_agents_offer_a_joint_action_and_no_two_are_the_same() {
    let office = hall();
    expect!["(:action carry :agent (?a - robot ?b - mobile-base) :parameters (?to - room) :precondition (and (offers-carry ?a) (offers-carry ?b) (not (= ?a ?b)) (at ?a corridor) (at ?b corridor)) :effect (and (at ?a ?to) (at ?b ?to)))"]
    .assert_eq(&office.snapshot().domain.actions[0].to_string());
    let predicates = office.snapshot().domain.predicates.clone();
    let guard = predicates.iter().find(|declared| declared.name == "offers-carry");
    let of = guard.map(|guard| guard.parameters[0].ty.to_string());
    assert_eq!(of.as_deref(), Some("(either robot mobile-base)"));
    let offers = office.snapshot().offers();
    assert!(offers.values().all(|actions| actions["carry"].agents == 2), "{offers:?}");
    assert_eq!(offers.len(), 2);
}

#[test]
fn an_agent_of_none_of_the_types_may_not_act() {
    let sensor = "(:types robot trolley - mobile-base) (:objects s-1 - sensor)
        (:action carry :agent (?a - robot ?b - mobile-base) :parameters (?to - room)
            :precondition (and (at ?a corridor) (at ?b corridor))
            :effect (and (at ?a ?to) (at ?b ?to)))";
    let office = hall().with([model("s-1", sensor)]);
    let conflicts = office.maintainer.conflicts();
    let detail = conflicts.iter().map(|conflict| conflict.detail.clone()).collect::<String>();
    assert_eq!(detail, "its agents are a `robot` and a `mobile-base`, and `s-1` is a `sensor`");
    assert_eq!(office.snapshot().offers().len(), 2);
}

/// The others could not check what only its own agent knows.
#[test]
fn a_joint_action_needs_nothing_private() {
    let sections = "(:types robot trolley - mobile-base) (:objects r-3 - robot)
        (:predicates (:private (rested ?a - robot)))
        (:action hold :agent (?a ?b - robot) :precondition (rested ?b) :effect (and))";
    let office = hall().with([model("r-3", sections)]);
    let conflicts = office.maintainer.conflicts();
    let detail = conflicts.iter().map(|conflict| conflict.detail.clone()).collect::<String>();
    assert!(detail.contains("`rested` is `:private`: the others do not see it"), "{detail}");
    assert_eq!(office.actions(), "carry");
}

/// An agent that joins a known action is added without a new composition.
#[test]
fn a_further_agent_joins_a_joint_action() {
    let joined = hall().with([carrier("r-2", "robot")]);
    let afresh = office().with([
        carrier("r-2", "robot"),
        carrier("t-1", "trolley"),
        carrier("r-1", "robot"),
    ]);
    assert_eq!(joined.snapshot().domain.to_string(), afresh.snapshot().domain.to_string());
    let guards = "(offers-carry r-1)\n(offers-carry r-2)\n(offers-carry t-1)";
    assert_eq!(joined.known("offers-carry"), guards);
}

/// An agent plans alone only with itself: a joint action takes others, which have to agree. Of these it
/// takes it on trust that they can.
#[test]
fn the_domain_of_one_agent_has_the_guard_of_itself_only() {
    let office = office_of("t-1").with([carrier("r-1", "robot"), carrier("t-1", "trolley")]);
    assert_eq!(office.known("offers-carry"), "(offers-carry t-1)");
    let (snapshot, joint) = (office.snapshot(), step("(carry r-1 t-1 office2)"));
    let actors: Vec<&str> = snapshot.actors(&joint, "t-1").iter().map(|it| it.as_str()).collect();
    assert_eq!(actors, ["r-1", "t-1"]);
    let trusted = snapshot.guards_of_partners(&joint, "t-1");
    assert_eq!(text_of(&trusted), "(offers-carry r-1)");
    assert_eq!(snapshot.methods.keys().collect::<Vec<_>>(), [&id("t-1")]);
}

/// Two agents use one name for different joint actions: the second agent of a step may be the one that
/// is known.
#[test]
fn steps_are_translated_by_any_of_their_agents() {
    let other = "(:objects x-1 - sensor) (:action carry :agent ?s - sensor :effect (and))";
    let office = office_of("t-1").with([
        model("x-1", other),
        carrier("r-1", "robot"),
        carrier("t-1", "trolley"),
    ]);
    let inside = office.snapshot().inside(&step("(carry r-1 t-1 office2)"));
    assert_eq!(office.snapshot().outside(&inside), step("(carry r-1 t-1 office2)"));
    assert!(office.actions().contains(inside.action.as_str()), "{inside} {}", office.actions());
}
