//! Tests that models are composed into one domain and one problem.

use capability::{Maintainer, MaintainerScope, Timestamp};
use expect_test::{Expect, expect};

use crate::office::{Office, ir_sensor, model, office, thermometer, turtlebot};

#[track_caller]
fn check_domain(office: &Office, expected: Expect) {
    let snapshot = office.snapshot();
    let text = snapshot.domain.to_string();
    let mistakes = pddl::check_domain(&snapshot.domain);
    assert_eq!(mistakes.iter().map(ToString::to_string).collect::<Vec<_>>(), [""; 0], "{text}");
    expected.assert_eq(&text);
}

#[track_caller]
fn check_problem(office: &Office, expected: Expect) {
    let snapshot = office.snapshot();
    let mistakes = pddl::check_problem(&snapshot.domain, &snapshot.problem);
    assert_eq!(mistakes.iter().map(ToString::to_string).collect::<Vec<_>>(), [""; 0]);
    expected.assert_eq(&snapshot.problem.to_string());
}

#[test]
fn one_robot() {
    let office = office().with([turtlebot("turtlebot-1")]);
    check_domain(
        &office,
        expect![[r#"
        (define (domain smart-office)
          (:requirements :typing)
          (:types
            location mobile-base sensor - object
            room - location
            temperature-sensor ir-temperature-sensor - sensor
            turtlebot - mobile-base)
          (:predicates
            (connected ?a ?b - location)
            (at ?b - mobile-base ?l - location)
            (located ?s - sensor ?r - room)
            (mounted-on ?s - sensor ?b - mobile-base)
            (known-temperature ?r - room)
            (:private (docked ?r - turtlebot))
            (offers-move ?r - turtlebot))
          (:functions
            (total-cost) - number
            (distance ?a ?b - location) - number
            (speed ?b - mobile-base) - number)
          (:action move
            :agent ?r - turtlebot
            :parameters (?from ?to - location)
            :precondition (and (offers-move ?r) (at ?r ?from) (connected ?from ?to))
            :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) (distance ?from ?to)))))
    "#]],
    );
    check_problem(
        &office,
        expect![[r#"
        (define (problem map)
          (:domain smart-office)
          (:objects
            office2 - room
            corridor - location
            (:private dock-of-turtlebot-1 - location)
            turtlebot-1 - turtlebot)
          (:init
            (= (total-cost) 0)
            (at turtlebot-1 corridor)
            (connected corridor office2)
            (docked turtlebot-1)
            (= (distance corridor office2) 6)
            (= (speed turtlebot-1) 0.3)
            (offers-move turtlebot-1))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]],
    );
}

#[test]
fn two_equal_robots_share_one_schema() {
    let office = office().with([turtlebot("turtlebot-1"), turtlebot("turtlebot-2")]);
    let alone = crate::office::office().with([turtlebot("turtlebot-1")]);
    assert_eq!(office.snapshot().domain, alone.snapshot().domain);
    check_problem(
        &office,
        expect![[r#"
        (define (problem map)
          (:domain smart-office)
          (:objects
            office2 - room
            corridor - location
            (:private dock-of-turtlebot-1 - location dock-of-turtlebot-2 - location)
            turtlebot-1 turtlebot-2 - turtlebot)
          (:init
            (= (total-cost) 0)
            (at turtlebot-1 corridor)
            (at turtlebot-2 corridor)
            (connected corridor office2)
            (docked turtlebot-1)
            (docked turtlebot-2)
            (= (distance corridor office2) 6)
            (= (speed turtlebot-1) 0.3)
            (= (speed turtlebot-2) 0.3)
            (offers-move turtlebot-1)
            (offers-move turtlebot-2))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]],
    );
}

#[test]
fn equal_means_modulo_variable_names_and_nesting() {
    let renamed = turtlebot("turtlebot-2")
        .replace("?from", "?a")
        .replace("?r", "?robot")
        .replace("(and (at ?robot ?a)", "(AND (and) (and (AT ?robot ?a)) ");
    let office = office().with([turtlebot("turtlebot-1"), renamed]);
    assert_eq!(office.actions(), "move");
    assert_eq!(office.conflicts(), "");
}

#[test]
fn different_actions_with_the_same_name_are_qualified() {
    let models = [thermometer("thermometer-office2"), ir_sensor("ir-1", "turtlebot-1")];
    let office = office().with(models).with([turtlebot("turtlebot-1")]);
    check_domain(
        &office,
        expect![[r#"
        (define (domain smart-office)
          (:requirements :typing)
          (:types
            location mobile-base sensor - object
            room - location
            temperature-sensor ir-temperature-sensor - sensor
            turtlebot - mobile-base)
          (:predicates
            (connected ?a ?b - location)
            (at ?b - mobile-base ?l - location)
            (located ?s - sensor ?r - room)
            (mounted-on ?s - sensor ?b - mobile-base)
            (known-temperature ?r - room)
            (:private (docked ?r - turtlebot))
            (offers-move ?r - turtlebot)
            (offers-report-temperature--ir-1 ?s - ir-temperature-sensor)
            (offers-report-temperature--thermometer-office2 ?s - temperature-sensor))
          (:functions
            (total-cost) - number
            (distance ?a ?b - location) - number
            (speed ?b - mobile-base) - number)
          (:action move
            :agent ?r - turtlebot
            :parameters (?from ?to - location)
            :precondition (and (offers-move ?r) (at ?r ?from) (connected ?from ?to))
            :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) (distance ?from ?to))))
          (:action report-temperature--ir-1
            :agent ?s - ir-temperature-sensor
            :parameters (?b - mobile-base ?r - room)
            :precondition (and (offers-report-temperature--ir-1 ?s) (mounted-on ?s ?b) (at ?b ?r))
            :effect (and (known-temperature ?r) (increase (total-cost) 2)))
          (:action report-temperature--thermometer-office2
            :agent ?s - temperature-sensor
            :parameters (?r - room)
            :precondition (and (offers-report-temperature--thermometer-office2 ?s) (located ?s ?r))
            :effect (and (known-temperature ?r) (increase (total-cost) 1))))
    "#]],
    );
    check_problem(
        &office,
        expect![[r#"
        (define (problem map)
          (:domain smart-office)
          (:objects
            office2 - room
            corridor - location
            (:private dock-of-turtlebot-1 - location)
            ir-1 - ir-temperature-sensor
            thermometer-office2 - temperature-sensor
            turtlebot-1 - turtlebot)
          (:init
            (= (total-cost) 0)
            (at turtlebot-1 corridor)
            (connected corridor office2)
            (docked turtlebot-1)
            (located thermometer-office2 office2)
            (mounted-on ir-1 turtlebot-1)
            (= (distance corridor office2) 6)
            (= (speed turtlebot-1) 0.3)
            (offers-report-temperature--ir-1 ir-1)
            (offers-report-temperature--thermometer-office2 thermometer-office2)
            (offers-move turtlebot-1))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]],
    );
}

#[test]
fn an_object_named_in_an_action_becomes_a_constant() {
    let sections = "(:objects lamp-1 - sensor plug-1 - location)
        (:action plug-in :agent ?l - sensor :effect (known-temperature office2)
          :precondition (connected plug-1 plug-1))";
    let office = office().with([model("lamp-1", sections)]);
    check_domain(
        &office,
        expect![[r#"
        (define (domain smart-office)
          (:requirements :typing)
          (:types
            location mobile-base sensor - object
            room - location
            temperature-sensor ir-temperature-sensor - sensor)
          (:constants office2 - room plug-1 - location)
          (:predicates
            (connected ?a ?b - location)
            (at ?b - mobile-base ?l - location)
            (located ?s - sensor ?r - room)
            (mounted-on ?s - sensor ?b - mobile-base)
            (known-temperature ?r - room)
            (offers-plug-in ?l - sensor))
          (:functions
            (total-cost) - number
            (distance ?a ?b - location) - number
            (speed ?b - mobile-base) - number)
          (:action plug-in
            :agent ?l - sensor
            :parameters ()
            :precondition (and (offers-plug-in ?l) (connected plug-1 plug-1))
            :effect (known-temperature office2)))
    "#]],
    );
    check_problem(
        &office,
        expect![[r#"
        (define (problem map)
          (:domain smart-office)
          (:objects corridor - location lamp-1 - sensor)
          (:init
            (= (total-cost) 0)
            (connected corridor office2)
            (= (distance corridor office2) 6)
            (offers-plug-in lamp-1))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]],
    );
}

#[test]
fn a_guard_gets_an_unused_name() {
    let sections = "(:predicates (offers-move ?r - mobile-base) (offers-move-2))";
    let office = office().with([model("impostor", sections), turtlebot("turtlebot-1")]);
    assert_eq!(office.known("offers-move-3"), "(offers-move-3 turtlebot-1)");
}

#[test]
fn axioms_come_with_their_predicate() {
    let sections = "(:predicates (near ?a ?b - location))
        (:derived (near ?a ?b - location) (or (connected ?a ?b) (connected ?b ?a)))";
    let mut office = office().with([model("a", sections), model("b", sections)]);
    check_domain(
        &office,
        expect![[r#"
        (define (domain smart-office)
          (:requirements :typing)
          (:types
            location mobile-base sensor - object
            room - location
            temperature-sensor ir-temperature-sensor - sensor)
          (:predicates
            (connected ?a ?b - location)
            (at ?b - mobile-base ?l - location)
            (located ?s - sensor ?r - room)
            (mounted-on ?s - sensor ?b - mobile-base)
            (known-temperature ?r - room)
            (near ?a ?b - location))
          (:functions
            (total-cost) - number
            (distance ?a ?b - location) - number
            (speed ?b - mobile-base) - number)
          (:derived (near ?a ?b - location)
            (or (connected ?a ?b) (connected ?b ?a))))
    "#]],
    );
    // A derived fact cannot be claimed.
    let change = office.set("a", "(near office2 office2)").expect("a request");
    assert!(change.is_empty(), "{change:?}");
}

#[test]
fn a_disabled_action_keeps_its_schema() {
    let mut office = office().with([turtlebot("turtlebot-1"), turtlebot("turtlebot-2")]);
    let now = office.now;
    let one = Some(crate::office::id("turtlebot-1"));
    let change = office.maintainer.disable_action("move".into(), one.clone(), now);
    assert!(change.expect("room").epoch_changed);
    assert_eq!(office.known("offers-move"), "(offers-move turtlebot-2)");
    office.maintainer.disable_action("move".into(), None, now).expect("room");
    assert_eq!((office.known("offers-move"), office.actions()), (String::new(), "move".into()));
    office.maintainer.enable_action("move".into(), None, now).expect("it is withheld");
    office.maintainer.enable_action("move".into(), one, now).expect("it is withheld");
    assert_eq!(office.known("offers-move"), "(offers-move turtlebot-1)\n(offers-move turtlebot-2)");
}

#[test]
fn the_metric_is_the_total_cost_by_default() {
    let mut office = office().with([thermometer("thermometer-office2")]);
    let goal = || pddl::parse_condition("(known-temperature office2)").value.expect("a goal");
    let problem = office.snapshot().with_goal(&goal(), None);
    assert_eq!(problem.goal, goal());
    let metric = problem.metric.expect("the ontology counts costs");
    assert_eq!(metric.to_string(), "(:metric minimize (total-cost))");
    let dearest = pddl::Metric { direction: pddl::MetricDirection::Maximize, ..metric };
    let now = office.now;
    office.maintainer.set_metric(Some(dearest.clone()), now).expect("it makes sense");
    assert_eq!(office.snapshot().with_goal(&goal(), None).metric, Some(dearest));
}

#[test]
fn costs_need_no_declaration_by_the_ontology_or_the_model() {
    let ontology = pddl::parse_domain(
        "(define (domain smart-office) (:types kettle cup - object)
          (:predicates (filled ?c - cup) (clean ?c - cup)))",
    );
    let map =
        "(define (problem map) (:domain smart-office) (:objects mug - cup) (:init) (:goal (and)))";
    let maintainer = Maintainer::new(
        ontology.into_result().expect("the ontology"),
        pddl::parse_problem(map).into_result().expect("the map"),
        MaintainerScope::Everything,
    );
    let mut office = Office { maintainer, now: Timestamp(1_000), eyes: None };
    // An action without a cost needs no `total-cost`, so that the length of a plan is minimized.
    let sections = |action: &str, effect: &str| {
        format!(
            "(:objects {action}er - kettle) (:action {action} :agent ?k - kettle
              :parameters (?c - cup) :effect {effect})"
        )
    };
    office.admit(&model("washer", &sections("wash", "(clean ?c)")));
    let functions = |office: &Office| office.snapshot().domain.functions.len();
    assert_eq!(functions(&office), 0);
    let costly = sections("fill", "(and (filled ?c) (increase (total-cost) 3))");
    office.admit(&model("filler", &costly));
    office.admit(&model("filler-2", &costly.replace("filler", "filler-2")));
    assert_eq!(office.conflicts(), "");
    assert_eq!(office.actions(), "fill wash");
    assert_eq!(functions(&office), 1);
    let snapshot = office.snapshot();
    assert!(pddl::check_domain(&snapshot.domain).is_empty(), "{}", snapshot.domain);
    let goal = pddl::parse_condition("(filled mug)").value.expect("a goal");
    let metric = snapshot.with_goal(&goal, None).metric.expect("an action has a cost");
    assert_eq!(metric.to_string(), "(:metric minimize (total-cost))");
}
