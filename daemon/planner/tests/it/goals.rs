//! Goals taken apart, and which parts cannot be had.

use expect_test::{Expect, expect};
use pddl::Condition;
use planner::goal::{conjuncts, unreachable};
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
