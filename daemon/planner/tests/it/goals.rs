//! Splitting of goals into conjuncts, and detection of unreachable conjuncts.

use expect_test::{Expect, expect};
use pddl::Condition;
use planner::goal::{conjuncts, conjuncts_but, unreachable};
use planner::validate::World;
use planner::{Cancel, Options, Replanner};

use crate::support::parse;

const OFFICE: &str = include_str!("../../benches/office/domain.pddl");
const MORNING: &str = include_str!("../../benches/office/problem.pddl");

#[track_caller]
fn check(goal: &str, replaced: (&str, &str), expected: Expect) {
    let (domain, problem) = parse(OFFICE, &MORNING.replace(replaced.0, replaced.1));
    let goal = pddl::parse_condition(goal).into_result().expect("the goal parses");
    let world = World::initial(&domain, &problem).expect("makes sense");
    let parts = conjuncts(&world, &goal);
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
fn what_is_derived_is_taken_apart_where_all_of_it_must_be() {
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
        let parts = conjuncts(&world, &goal);
        let parts: Vec<String> = parts.iter().map(ToString::to_string).collect();
        assert_eq!(parts.join(" "), expected, "{goal}");
    }
    let goal = "(and (not (lit lab)) (not (lit hall)))";
    let goal = pddl::parse_condition(goal).into_result().expect("a goal");
    let is_of_hall = |atom: &pddl::Atom| atom.to_string() == "(lit hall)";
    let parts = conjuncts_but(&world, &goal, &is_of_hall);
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
