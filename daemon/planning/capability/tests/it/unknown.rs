//! Tests of unknown facts: in the state, in the domain, and after the agent that reported them has
//! left.

use expect_test::expect;
use pddl::Condition;

use crate::office::{Office, facts, model, office, office_of};

/// Returns the text with single spaces between words.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn lamp(name: &str) -> String {
    model(
        name,
        &format!(
            "(:types lamp - object)
             (:predicates (lamp-in ?l - lamp ?r - room) (shining ?l - lamp) (lit ?r - room))
             (:derived (lit ?r - room) (exists (?l - lamp) (and (lamp-in ?l ?r) (shining ?l))))
             (:objects {name} - lamp) (:init (lamp-in {name} office2) (unknown (shining {name})))
             (:action turn-off :agent ?l - lamp :parameters (?r - room)
               :precondition (lamp-in ?l ?r) :effect (not (shining ?l)))"
        ),
    )
}

fn motion(name: &str) -> String {
    model(
        name,
        &format!(
            "(:predicates (motion ?r - room) (known-motion ?r - room))
             (:functions (light ?r - room))
             (:objects {name} - sensor) (:init (located {name} office2))
             (:action look :agent ?s - sensor :parameters (?r - room)
               :precondition (located ?s ?r) :effect (known-motion ?r)
               :observe (and (motion ?r) (light ?r)))"
        ),
    )
}

fn goal(text: &str) -> Condition {
    pddl::parse_condition(text).into_result().expect("a condition")
}

#[track_caller]
fn unknown(office: &Office, symbol: &str) -> bool {
    !office.known(&format!("unknown-{symbol}")).is_empty()
}

#[test]
fn an_agent_can_report_a_fact_as_unknown() {
    let mut office = office().with([lamp("a")]);
    assert!(unknown(&office, "shining"), "its model says so");
    office.beat("a", (1, 1), "(shining a)", "").expect("a heartbeat");
    assert!(!unknown(&office, "shining"));
    assert_eq!(office.known("shining"), "(shining a)");
    let change = office.beat("a", (1, 2), "(unknown (shining a))", "").expect("a heartbeat");
    assert_eq!(change.believed, facts("(unknown (shining a))"));
    assert_eq!(office.known("shining"), "");
    assert_eq!(office.known("unknown-shining"), "(unknown-shining a)");
    let change = office.beat("a", (1, 3), "", "").expect("a heartbeat");
    assert_eq!(change.retracted, facts("(unknown (shining a))"));
    assert!(!unknown(&office, "shining"), "what it does not say of what is its own is false");
}

#[test]
fn one_known_claim_suffices_and_an_unclaimed_number_is_undefined() {
    let mut office = office().with([motion("m"), motion("n")]);
    office.beat("m", (1, 1), "(motion office2)", "").expect("a heartbeat");
    office.beat("n", (1, 1), "(unknown (motion office2))", "").expect("a heartbeat");
    assert_eq!(office.known("motion"), "(motion office2)");
    assert!(!unknown(&office, "motion"));
    office.beat("m", (1, 2), "(not (motion office2))", "").expect("a heartbeat");
    assert!(unknown(&office, "motion"), "one of them cannot tell");
    assert_eq!(office.known("defined-light"), "");
    office.beat("m", (1, 3), "(= (light office2) 120)", "").expect("a heartbeat");
    assert_eq!(office.known("defined-light"), "(defined-light office2)");
}

#[test]
fn the_domain_has_predicates_for_unknown_facts_and_goals_use_them() {
    let office = office().with([lamp("a"), motion("m")]);
    let snapshot = office.snapshot();
    let problem =
        snapshot.with_goal(&goal("(and (not (lit office2)) (not (motion office2)))"), None);
    expect![[
        "(and (not (maybe-lit office2)) (and (not (motion office2)) (or (not (unknown-motion \
         office2)) (found-motion office2))))"
    ]]
    .assert_eq(&words(&problem.goal.to_string()));
    assert!(pddl::check_domain(&snapshot.domain).is_empty());
    assert!(pddl::check_problem(&snapshot.domain, &problem).is_empty());
    let sent = snapshot.to_content();
    let known: Vec<_> = sent.knowledge.keys().map(String::as_str).collect();
    assert_eq!(known, ["light", "lit", "motion", "shining"]);
}

#[test]
fn the_predicates_for_unknown_facts_remain_when_a_fact_becomes_known() {
    let mut office = office().with([lamp("a")]);
    let before = office.snapshot().digest().to_owned();
    office.beat("a", (1, 1), "(shining a)", "").expect("a heartbeat");
    office.beat("a", (1, 2), "(unknown (shining a))", "").expect("a heartbeat");
    office.beat("a", (1, 3), "", "").expect("a heartbeat");
    assert_eq!(office.snapshot().digest(), before);
}

#[test]
fn a_fact_that_only_a_departed_agent_observed_is_unknown() {
    // No heartbeat of the other sensor has contained facts about the room.
    let mut office = office().with([lamp("a"), lamp("b"), motion("m"), motion("n")]);
    office.beat("a", (1, 1), "(not (shining a))", "").expect("a heartbeat");
    office.beat("b", (1, 1), "(shining b)", "").expect("a heartbeat");
    office.beat("m", (1, 1), "(known-motion office2) (not (motion office2))", "").expect("a beat");
    assert!(!unknown(&office, "lit") && !unknown(&office, "motion"));
    office.remove("m");
    assert_eq!(office.known("unknown-motion"), "(unknown-motion office2)");
    assert!(!unknown(&office, "known-motion"), "that was found out by it, and is not any more");
    office.remove("b");
    assert_eq!(office.known("unknown-lit"), "(unknown-lit office2)");
    assert_eq!(office.known("unknown-shining"), "", "the lamp itself is gone");
    // The unknown facts are announced, so that other and restarted maintainers know them.
    let told = office.maintainer.requested(office.now);
    let facts: Vec<_> = told.facts.iter().map(|told| told.fact.as_str()).collect();
    assert_eq!(facts, ["(unknown (lit office2))", "(unknown (motion office2))"]);
    // The returning agent reports the fact again. The other fact is set by a request.
    office.admit_life(&motion("m"), 2).expect("it is back");
    assert!(!unknown(&office, "motion"));
    let now = office.now;
    let retract = crate::office::facts("(unknown (lit office2))");
    let dark = capability::Effects { believe: Vec::new(), retract };
    office
        .maintainer
        .apply_request(&crate::office::id("ann").into(), &dark, now)
        .expect("a request");
    assert!(!unknown(&office, "lit"));
}

#[test]
fn facts_of_an_expected_agent_are_unknown_until_it_joins() {
    let mut office = office().with([lamp("a"), motion("n")]);
    office.beat("a", (1, 1), "(not (shining a))", "").expect("a heartbeat");
    office.beat("n", (1, 1), "(not (motion office2))", "").expect("a heartbeat");
    assert!(!unknown(&office, "lit") && !unknown(&office, "motion"));
    let models = [lamp("a"), lamp("b"), motion("m")].map(|text| {
        pddl::parse_action_model(&text).into_result().expect("a model of the ecosystem file")
    });
    let now = office.now;
    let change = office.maintainer.expect_agents(models, now);
    assert_eq!(change.believed, facts("(unknown (lit office2)) (unknown (motion office2))"));
    assert_eq!(office.known("unknown-lit"), "(unknown-lit office2)");
    assert_eq!(office.known("unknown-motion"), "(unknown-motion office2)");
    assert!(!unknown(&office, "known-motion"), "nobody has looked");
    assert!(!unknown(&office, "light"), "a number without a value needs no mark");
    assert_eq!(office.known("located"), "(located n office2)");
    assert!(!office.maintainer.has_requests(now), "nothing that a Journal has to keep");
    // Other maintainers must be informed, because they do not read the ecosystem file.
    assert_eq!(office.maintainer.requested(now).facts.len(), 2);
    office.admit(&lamp("b"));
    office.beat("b", (1, 1), "(not (shining b))", "").expect("a heartbeat");
    assert!(!unknown(&office, "lit"), "it has come, and is off");
    assert!(unknown(&office, "motion"), "the other one has not come");
    let retract = facts("(unknown (motion office2))");
    let still = capability::Effects { believe: Vec::new(), retract };
    office.maintainer.apply_request(&crate::office::id("ann").into(), &still, now).expect("a word");
    assert!(!unknown(&office, "motion"), "a person has looked");
}

/// The models determine no facts about roads, about past actions, and about the position of a robot
/// that has not joined.
#[test]
fn facts_that_no_expected_agent_determines_stay_false() {
    let mut office = office();
    let models = [
        crate::office::turtlebot("turtlebot-1"),
        crate::office::thermometer("t"),
        crate::office::ir_sensor("ir-1", "turtlebot-1"),
    ];
    let models = models.map(|text| pddl::parse_action_model(&text).into_result().expect("a model"));
    let now = office.now;
    let change = office.maintainer.expect_agents(models, now);
    assert!(change.believed.is_empty(), "{change:?}");
    assert!(!unknown(&office, "connected") && !unknown(&office, "known-temperature"));
}

#[test]
fn a_mark_removed_by_the_leader_does_not_return_with_a_standby() {
    let mut office = office();
    office.maintainer.set_standby(true);
    let now = office.now;
    let model = pddl::parse_action_model(&motion("m")).into_result().expect("a model");
    let _ = office.maintainer.expect_agents([model], now);
    let none = capability::RequestedChanges::default();
    office.maintainer.apply_leader_requests(&none, now).expect("an announcement");
    office.maintainer.set_standby(false);
    assert!(office.maintainer.requested(now).facts.is_empty());
}

#[test]
fn an_actuators_maintainer_keeps_unknown_facts_of_other_agents() {
    let mut local = office_of("a").with([lamp("a"), motion("m")]);
    local.beat("a", (1, 1), "(unknown (shining a))", "").expect("a heartbeat");
    local.beat("m", (1, 1), "(unknown (motion office2))", "").expect("a heartbeat");
    assert_eq!(local.known("unknown-shining"), "(unknown-shining a)");
    assert_eq!(local.known("unknown-motion"), "(unknown-motion office2)");
}
