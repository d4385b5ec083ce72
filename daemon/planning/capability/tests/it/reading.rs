//! Tests of parsing the contents of messages.

use acl::content::{ChangeState, Heartbeat, Method, Methods, ModelAnnouncement};
use acl::{Incarnation, Millis};
use capability::{Announcement, Effects, ParsedHeartbeat, Timestamp, model_digest};
use expect_test::expect;

use crate::office::{facts, id, office, thermometer};

fn heartbeat(facts: &str) -> Heartbeat {
    Heartbeat {
        digest: "d".to_owned(),
        sequence: 4,
        facts: facts.to_owned(),
        known_for: [("(known-temperature office2)".to_owned(), Millis::from(60_000))].into(),
        period: Millis::from(1_000),
        stops: Vec::new(),
    }
}

#[test]
fn the_expiry_of_facts_is_relative_to_the_time_of_receipt() {
    let read =
        |text| ParsedHeartbeat::read(id("t-1"), Incarnation(1), &heartbeat(text), Timestamp(500));
    let beat = read("(located t-1 office2)").expect("a heartbeat");
    assert_eq!(beat.period, Some(std::time::Duration::from_secs(1)));
    let known: Vec<_> = beat.facts.iter().map(|known| known.until).collect();
    assert_eq!(known, [None, Some(Timestamp(60_500))]);
    assert!(read("(located t-1").is_err());
}

#[test]
fn a_request_is_read_as_a_whole_or_rejected() {
    let change = |believe: &str, retract: &str| ChangeState {
        believe: believe.to_owned(),
        retract: retract.to_owned(),
        owner: None,
    };
    let read = Effects::read(&change("(a) (= (f) 1)", "(b)")).expect("facts");
    assert_eq!((read.believe, read.retract), (facts("(a) (= (f) 1)"), facts("(b)")));
    assert!(Effects::read(&change("(a)", "(b")).is_err());
}

#[test]
fn a_parsed_model_is_reused_by_another_maintainer() {
    let one = office().with([thermometer("t-1"), thermometer("t-2")]);
    let digest = model_digest(&thermometer("t-1"), &Methods::new());
    let read = |incarnation, digest| {
        one.maintainer.announcement(&id("t-1"), Incarnation(incarnation), digest)
    };
    assert!(read(2, &digest).is_none(), "another incarnation");
    assert!(read(1, "another").is_none(), "another model");
    let mut other = office().with([thermometer("t-2")]);
    let now = other.now;
    other.maintainer.admit(read(1, &digest).expect("taken"), now).expect("a good model");
    assert_eq!(other.snapshot().to_content().domain, one.snapshot().to_content().domain);
    assert_eq!(other.known("located"), one.known("located"));
}

#[test]
fn a_model_comes_with_its_methods_and_leaves_with_the_snapshot() {
    let model = thermometer("t-1");
    let method = Method {
        method: "read".to_owned(),
        arguments: [("room".to_owned(), "?r".to_owned())].into(),
        timeout: Millis::from(2_000),
    };
    let methods = [("report-temperature".to_owned(), method)].into();
    let digest = model_digest(&model, &methods);
    let heartbeat = Heartbeat { digest, ..heartbeat("") };
    let announced = ModelAnnouncement { model, methods, heartbeat };
    let read = Announcement::read(id("t-1"), Incarnation(1), &announced).expect("a model");
    let mut office = office().with([thermometer("t-2")]);
    let now = office.now;
    office.maintainer.admit(read, now).expect("a good model");
    let content = office.snapshot().to_content();
    expect![[r#"
        {
            "t-1": {
                "report-temperature": Offer {
                    schema: "report-temperature",
                    guard: "(offers-report-temperature t-1)",
                    method: Some(
                        Method {
                            method: "read",
                            arguments: {
                                "room": "?r",
                            },
                            timeout: Millis(
                                2s,
                            ),
                        },
                    ),
                    agents: 1,
                },
            },
            "t-2": {
                "report-temperature": Offer {
                    schema: "report-temperature",
                    guard: "(offers-report-temperature t-2)",
                    method: None,
                    agents: 1,
                },
            },
        }
    "#]]
    .assert_debug_eq(&content.offers);
    assert_eq!(content.digest, capability::text_digest(&content.domain));
    office.mask("t-2");
    let offers = office.snapshot().offers();
    assert_eq!(offers.keys().collect::<Vec<_>>(), [&id("t-1")]);
    let unreadable = ModelAnnouncement { model: "(define".to_owned(), ..announced };
    assert!(Announcement::read(id("t-1"), Incarnation(2), &unreadable).is_err());
}

#[test]
fn the_digest_of_a_problem_covers_objects_and_facts_but_not_the_goal() {
    let read = |objects: &str, facts: &str, goal: &str| {
        let text = format!(
            "(define (problem p) (:domain d) (:objects {objects}) (:init {facts}) (:goal {goal}))"
        );
        pddl::parse_problem(&text).into_result().expect("a problem")
    };
    let digest = |problem| capability::problem_digest("d", &problem);
    let one = digest(read("a b", "(p a)", "(p b)"));
    assert_eq!(one, digest(read("a  b", "(p a)", "(q b)")));
    for other in [("a b", "(p b)"), ("a b", "(p a) (p b)"), ("a b c", "(p a)"), ("b a", "(p a)")] {
        assert_ne!(one, digest(read(other.0, other.1, "(p b)")), "{other:?}");
    }
    assert_ne!(one, capability::problem_digest("e", &read("a b", "(p a)", "(p b)")));
}
