//! Splitting of goals into conjuncts, and detection of unreachable conjuncts.

use expect_test::{Expect, expect};
use pddl::Condition;
use planner::goal::{GOAL_SIZE_MAX, GoalTooLarge, conjuncts, conjuncts_but, unreachable};
use planner::validate::World;
use planner::{Cancel, FaultReason, Options, Replanner, rest_reaches};

use crate::support::parse;

const OFFICE: &str = include_str!("../../benches/office/domain.pddl");
const MORNING: &str = include_str!("../../benches/office/problem.pddl");

#[track_caller]
fn check(goal: &str, replaced: (&str, &str), expected: Expect) {
    let (domain, problem) = parse(OFFICE, &MORNING.replace(replaced.0, replaced.1));
    let goal = pddl::parse_condition(goal).into_result().expect("the goal parses");
    let world = World::initial(&domain, &problem).expect("makes sense");
    let parts = conjuncts(&world, &goal).expect("it is small");
    let missing = unreachable(&domain, &problem, &parts, &Options::default(), &Cancel::new())
        .expect("supported");
    let all: Vec<_> = parts.iter().collect();
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut replanner = Replanner::default();
    let cheaply = replanner.facts_out_of_reach(&domain, &problem, &all, &options, &cancel);
    let is_fact = |position: &&usize| matches!(parts[**position], Condition::Atom(_));
    let facts: Vec<usize> = missing.iter().filter(is_fact).copied().collect();
    assert_eq!(cheaply.expect("supported"), facts, "the cheap proof finds the same facts");
    let line = |(position, part)| {
        let mark = if missing.contains(&position) { "unreachable " } else { "" };
        format!("{mark}{part}\n")
    };
    expected.assert_eq(&parts.iter().enumerate().map(line).collect::<String>());
}

#[test]
fn a_derived_conjunct_is_expanded_if_all_its_parts_are_required() {
    let (domain, problem) = parse(
        "(define (domain d) (:types room lamp lock)
            (:predicates (in ?d - object ?r - room) (on ?l - lamp) (shut ?k - lock) (lit ?r - room)
                (dark ?r - room) (locked ?r - room) (reached ?a ?b - room) (way ?a ?b - room))
            (:derived (lit ?r - room) (exists (?l - lamp) (and (in ?l ?r) (on ?l))))
            (:derived (dark ?r - room) (not (lit ?r)))
            (:derived (locked ?r - room) (and (exists (?k - lock) (in ?k ?r))
                (forall (?k - lock) (imply (in ?k ?r) (shut ?k)))))
            (:derived (reached ?a ?b - room) (way ?a ?b))
            (:derived (reached ?a ?b - room) (exists (?c - room) (and (way ?a ?c) (reached ?c ?b))))
            (:action turn :parameters (?l - lamp) :effect (not (on ?l)))
            (:action lock :parameters (?k - lock) :effect (shut ?k)))",
        "(define (problem p) (:domain d) (:objects hall lab - room a b c - lamp k m n - lock)
            (:init (in a hall) (in b hall) (in c lab) (in k hall) (in m lab) (in n hall) (on a) (on c))
            (:goal (and)))",
    );
    let world = World::initial(&domain, &problem).expect("makes sense");
    for (goal, expected) in [
        ("(lit hall)", "(lit hall)"),
        ("(not (lit hall))", "(not (on a)) (not (on b))"),
        ("(not (dark hall))", "(not (dark hall))"),
        ("(locked hall)", "(shut k) (shut n)"),
        ("(locked lab)", "(locked lab)"),
        ("(dark hall)", "(not (on a)) (not (on b))"),
        ("(dark lab)", "(dark lab)"),
        ("(not (reached hall lab))", "(not (reached hall lab))"),
        ("(forall (?r - room) (locked ?r))", "(shut k) (shut n) (locked lab)"),
    ] {
        let goal = pddl::parse_condition(goal).into_result().expect("a goal");
        let parts = conjuncts(&world, &goal).expect("it is small");
        let parts: Vec<String> = parts.iter().map(ToString::to_string).collect();
        assert_eq!(parts.join(" "), expected, "{goal}");
    }
    let goal = "(and (not (lit lab)) (not (lit hall)))";
    let goal = pddl::parse_condition(goal).into_result().expect("a goal");
    let is_of_hall = |atom: &pddl::Atom| atom.to_string() == "(lit hall)";
    let parts = conjuncts_but(&world, &goal, &is_of_hall).expect("it is small");
    let parts: Vec<String> = parts.iter().map(ToString::to_string).collect();
    assert_eq!(parts, ["(not (lit lab))", "(not (lit hall))"], "one is known by more than axioms");
}

#[test]
fn forall_is_expanded_and_conjunctions_are_flattened() {
    check(
        "(and (forall (?r - room) (and (known-temperature ?r) (connected hall ?r)))
              (and (at turtlebot-1 hall) (at turtlebot-1 hall))
              (not (or (at turtlebot-2 hall) (exists (?r - room) (at turtlebot-2 ?r))))
              (or (at turtlebot-1 lab) (at turtlebot-1 kitchen)))",
        ("", ""),
        expect![[r#"
            (known-temperature office1)
            (connected hall office1)
            (known-temperature office2)
            (connected hall office2)
            (known-temperature office3)
            (connected hall office3)
            (known-temperature lab)
            (connected hall lab)
            (known-temperature kitchen)
            (connected hall kitchen)
            (at turtlebot-1 hall)
            (not (at turtlebot-2 hall))
            (not (at turtlebot-2 office1))
            (not (at turtlebot-2 office2))
            (not (at turtlebot-2 office3))
            (not (at turtlebot-2 lab))
            (not (at turtlebot-2 kitchen))
            (or (at turtlebot-1 lab) (at turtlebot-1 kitchen))
        "#]],
    );
}

#[test]
fn a_room_without_a_door_is_named() {
    check(
        "(forall (?r - room) (known-temperature ?r))",
        ("(connected hall kitchen)", ""),
        expect![[r#"
            (known-temperature office1)
            (known-temperature office2)
            (known-temperature office3)
            (known-temperature lab)
            unreachable (known-temperature kitchen)
        "#]],
    );
}

/// Returns a condition `body`, quantified over `count` variables `?v1 … ?vN` of type `location`.
fn over_locations(quantifier: &str, count: usize, body: &str) -> Condition {
    let variables: Vec<String> = (1..=count).map(|number| format!("?v{number}")).collect();
    let text = format!("({quantifier} ({} - location) {body})", variables.join(" "));
    pddl::parse_condition(&text).into_result().expect("a condition")
}

/// A condition that static facts cannot decide, and that mentions four of the variables.
const BODY: &str =
    "(imply (connected ?v1 ?v2) (or (connected ?v2 ?v1) (connected ?v3 ?v4) (= ?v1 ?v4)))";

#[test]
fn a_goal_that_expands_to_too_many_conditions_is_rejected_with_the_limit() {
    let (domain, problem) = parse(OFFICE, MORNING);
    let world = World::initial(&domain, &problem).expect("makes sense");
    let limit = GOAL_SIZE_MAX;
    let small = conjuncts(&world, &over_locations("forall", 4, BODY)).expect("it is small");
    assert_eq!(small.len(), 6_usize.pow(4), "the office has six locations");
    let many = over_locations("forall", 30, BODY);
    let never = Condition::Not(Box::new(over_locations("exists", 30, BODY)));
    let nested = over_locations("forall", 15, &over_locations("forall", 15, BODY).to_string());
    // Every instance is a long text, so that a few instances exceed the limit.
    let long = format!("(or {})", "(connected ?v1 ?v2) ".repeat(GOAL_SIZE_MAX / 40));
    let long = over_locations("forall", 2, &long);
    // A part of the goal with long expressions as its instances.
    let sum = format!("(> (+ {}) 1)", "1 ".repeat(GOAL_SIZE_MAX / 10));
    let sum = over_locations("forall", 2, &sum);
    let last = Condition::And(vec![small[0].clone(), many.clone()]);
    for goal in [many, never, nested, long, sum, last] {
        let refused = conjuncts(&world, &goal);
        assert_eq!(refused, Err(GoalTooLarge { limit }), "{:.80}", goal.to_string());
    }
    let told = GoalTooLarge { limit }.to_string();
    assert!(told.contains("more than 200000 conditions and terms"), "{told}");
}

#[test]
fn an_axiom_that_expands_to_too_many_conditions_is_rejected() {
    let quantified = over_locations("forall", 30, BODY);
    let all = OFFICE.trim_end().strip_suffix(')').expect("a definition");
    let (domain, problem) = parse(&format!("{all} (:derived (tidy) {quantified}))"), MORNING);
    let world = World::initial(&domain, &problem).expect("makes sense");
    for goal in ["(tidy)", "(not (not (tidy)))"] {
        let goal = pddl::parse_condition(goal).into_result().expect("a goal");
        assert!(conjuncts(&world, &goal).is_err(), "{goal}");
    }
    let stays = pddl::parse_condition("(tidy)").into_result().expect("a goal");
    let parts = conjuncts_but(&world, &stays, &|_| true).expect("it is not split");
    assert_eq!(parts, [stays]);
}

#[test]
fn after_the_work_limit_no_condition_holds() {
    let (domain, problem) = parse(OFFICE, MORNING);
    let initial = World::initial(&domain, &problem).expect("makes sense");
    let easy = pddl::parse_condition("(exists (?r - room) (connected hall ?r))");
    let easy = easy.into_result().expect("a condition");
    let world = initial.clone().limit_work(10_000, None);
    assert!(world.holds(&easy), "that takes few steps");
    assert_eq!(world.work_limit_reached(), None);
    // The condition is true for every combination of objects, and each combination has to be tried.
    let other = over_locations("forall", 30, "(= ?v30 ?v30)");
    assert!(!world.holds(&other), "it holds, which is not found out");
    assert_eq!(world.work_limit_reached(), Some(10_000));
    let denied = Condition::Not(Box::new(other.clone()));
    for condition in [&other, &denied, &easy] {
        assert!(!world.holds(condition), "{condition}");
        assert_eq!(world.failing(condition).as_ref(), Some(condition));
    }
    let fresh = initial.clone().limit_work(10_000, None);
    let fault = rest_reaches(&fresh, &[], &other).expect_err("it is not found out");
    assert_eq!(fault.reason, FaultReason::WorkLimit { limit: 10_000 });
    assert!(fault.to_string().contains("takes more than 10000 steps"), "{fault}");
    let cancel = Cancel::new();
    cancel.set();
    let stopped = initial.limit_work(u64::MAX, Some(&cancel));
    assert!(!stopped.holds(&other));
}

#[test]
fn axioms_have_a_separate_work_count() {
    let all = OFFICE.trim_end().strip_suffix(')').expect("a definition");
    // The first axiom requires trying eight thousand combinations of five locations.
    let easy = over_locations("exists", 5, "(not (= ?v5 ?v5))");
    let hard = over_locations("exists", 30, "(not (= ?v30 ?v30))");
    let text = format!(
        "{all} (:derived (near ?l - location) (or (= ?l ?l) {easy}))
               (:derived (far) {hard}))"
    );
    let text = text.replace("(:predicates", "(:predicates (near ?l - location) (far)");
    let (domain, problem) = parse(&text, MORNING);
    let condition = |text: &str| pddl::parse_condition(text).into_result().expect("a condition");
    let world = World::initial(&domain, &problem).expect("makes sense");
    let world = world.limit_work(100_000, None);
    // The condition uses up its own steps; the facts of the axiom are complete.
    let long = over_locations("exists", 30, "(and (near ?v1) (not (= ?v30 ?v30)))");
    assert!(!world.holds(&long));
    assert_eq!(world.work_limit_reached(), Some(100_000));
    world.renew_work();
    assert!(world.holds(&condition("(forall (?l - location) (near ?l))")));
    assert_eq!(world.work_limit_reached(), None);
    // The limit ends the evaluation of an axiom, so that all later results are unknown.
    assert!(!world.holds(&condition("(not (far))")));
    world.renew_work();
    assert_eq!(world.work_limit_reached(), Some(100_000));
    assert!(!world.holds(&condition("(near hall)")));
    assert_eq!(world.limit_work(1_000_000, None).work_limit_reached(), Some(1_000_000));
}
