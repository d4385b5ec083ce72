//! Tests that an input that exceeds a limit is refused with a reason and changes nothing.

use acl::AgentId;
use acl::content::Reason;
use capability::{Declined, limits};
use expect_test::{Expect, expect};

use crate::office::{announcement, id, model, office, thermometer};

#[track_caller]
fn check_model(sections: &str, expected: Expect) {
    let mut office = office();
    let before = office.snapshot();
    let declined = office.admit_life(&model("a", sections), 1).expect_err("too much");
    expected.assert_eq(&declined.to_string());
    assert_eq!(office.snapshot().revision, before.revision);
}

#[test]
fn models_are_bounded() {
    let many =
        |count: usize, text: fn(usize) -> String| -> String { (0..=count).map(text).collect() };
    let actions =
        many(limits::ACTIONS_PER_AGENT_MAX, |n| format!("(:action a{n} :agent ?a - sensor)"));
    check_model(&actions, expect!["there are more actions in a model than the 128 that are taken"]);
    let objects = many(limits::OBJECTS_PER_AGENT_MAX, |n| format!("o{n} "));
    check_model(
        &format!("(:objects {objects})"),
        expect!["there are more objects in a model than the 1024 that are taken"],
    );
    let types = many(limits::DECLARATIONS_PER_AGENT_MAX, |n| format!("t{n} "));
    check_model(
        &format!("(:types {types})"),
        expect!["there are more declarations in a model than the 512 that are taken"],
    );
    let facts = many(limits::FACTS_PER_OWNER_MAX, |n| format!("(p{n})"));
    check_model(
        &format!("(:init {facts})"),
        expect!["there are more facts of one owner than the 4096 that are taken"],
    );
}

#[test]
fn claims_are_bounded() {
    let mut office = office().with([thermometer("t-1")]);
    let facts: String = (0..=limits::FACTS_PER_OWNER_MAX).map(|n| format!("(p{n})")).collect();
    let too_many =
        Declined::TooMany { what: "facts of one owner", limit: limits::FACTS_PER_OWNER_MAX };
    assert_eq!(office.set("keyboard", &facts), Err(too_many.clone()));
    assert_eq!(office.beat("t-1", (1, 1), &facts, ""), Err(too_many));
}

#[test]
fn owners_are_bounded() {
    let mut office = office();
    // The map is an owner too.
    for number in 1..limits::OWNERS_MAX {
        office.set(&format!("k{number}"), "(known-temperature office2)").expect("room");
    }
    let declined = office.set("one-more", "(p)").expect_err("a full house");
    assert_eq!(declined, Declined::TooMany { what: "owners of facts", limit: limits::OWNERS_MAX });
    // A known owner may still claim facts; an owner that retracts its facts makes room for another.
    assert!(office.set("k1", "(p)").is_ok());
    office.remove("k1");
    assert!(office.set("one-more", "(p)").is_ok());
}

#[test]
fn agents_are_bounded() {
    let mut office = office();
    for number in 0..limits::AGENTS_MAX {
        office.admit(&model(&format!("a{number}"), ""));
    }
    let declined = office.admit_life(&model("one-more", ""), 1).expect_err("a full house");
    assert_eq!(declined.reason(), Reason::Busy);
    assert!(office.admit_life(&model("a0", "(:types t)"), 1).is_ok());
}

#[test]
fn a_model_must_describe_its_sender_and_use_the_ontology() {
    let mut office = office();
    let mut stolen = announcement(&thermometer("t-1"), 1);
    stolen.agent = AgentId::new("t-2").expect("a name");
    let now = office.now;
    let declined = office.maintainer.admit(stolen, now).expect_err("another agent's");
    expect!["the model describes `t-1` and was sent by `t-2`; an agent describes itself: write `(define (agent t-2) …)`"].assert_eq(&declined.refusal().detail);
    let foreign = thermometer("t-1").replace("smart-office", "smart-home");
    let declined = office.admit_life(&foreign, 1).expect_err("another ontology");
    expect!["the model builds on `smart-home`, and this ecosystem shares `smart-office`; write `(:domain smart-office)`"].assert_eq(&declined.to_string());
    assert!(office.maintainer.needs_model(&id("t-1"), ""));
}
