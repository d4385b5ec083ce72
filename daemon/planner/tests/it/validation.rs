//! The validator: which plans it accepts, and what it says of the others.

use expect_test::{Expect, expect};
use planner::{Verdict, World, rest_reaches, validate};

use crate::support::parse;

const OFFICE: &str = include_str!("../../benches/office/domain.pddl");
const MORNING: &str = include_str!("../../benches/office/problem.pddl");

#[track_caller]
fn check(domain: &str, problem: &str, plan: &str, expected: Expect) {
    let (domain, problem) = parse(domain, problem);
    let plan = pddl::parse_plan(plan).into_result().expect("the plan parses");
    let text = match validate(&domain, &problem, &plan) {
        Verdict::Valid { cost, steps } => format!("valid: {steps} steps, cost {cost}"),
        Verdict::Fault(fault) => fault.to_string(),
        Verdict::BadInput(diagnostics) => format!("{diagnostics:?}"),
    };
    expected.assert_eq(&text);
}

#[track_caller]
fn office(goal: &str, plan: &str, expected: Expect) {
    let problem = MORNING.replace("(forall (?r - room) (known-temperature ?r))", goal);
    check(OFFICE, &problem, plan, expected);
}

#[test]
fn a_valid_plan_gets_its_true_cost() {
    office(
        "(at turtlebot-1 office3)",
        "(move turtlebot-1 hall office3) ; cost = 1",
        expect!["valid: 1 steps, cost 8.5"],
    );
}

#[test]
fn the_failing_part_of_a_precondition_is_told_with_its_objects() {
    office(
        "(at turtlebot-1 lab)",
        "(move turtlebot-1 office1 hall)",
        expect!["step 1 (move turtlebot-1 office1 hall): (at turtlebot-1 office1) does not hold"],
    );
}

#[test]
fn the_failing_instance_of_a_goal_is_told() {
    office(
        "(forall (?r - room) (known-temperature ?r))",
        "(report-temperature thermo1 office1)",
        expect!["goal: (known-temperature office2) does not hold"],
    );
}

#[test]
fn names_arguments_and_types_are_checked() {
    office(
        "(and)",
        "(fly turtlebot-1 hall)",
        expect!["step 1 (fly turtlebot-1 hall): no action has this name"],
    );
    office(
        "(and)",
        "(move turtlebot-1 hall)",
        expect!["step 1 (move turtlebot-1 hall): takes 3 arguments, not 2"],
    );
    office(
        "(and)",
        "(move turtlebot-9 hall lab)",
        expect!["step 1 (move turtlebot-9 hall lab): no object is called `turtlebot-9`"],
    );
    office(
        "(and)",
        "(move thermo1 hall lab)",
        expect!["step 1 (move thermo1 hall lab): `thermo1` is not of type turtlebot"],
    );
}

const NUMBERS: &str = "(define (domain d) (:predicates (p)) (:functions (x) (y) (z))
    (:action swap :effect (and (assign (x) (y)) (assign (y) (x))))
    (:action twice :effect (and (increase (x) 1) (increase (x) 2)))
    (:action clash :effect (and (increase (x) 1) (assign (x) 2)))
    (:action unset :effect (increase (z) 1)))";
const VALUES: &str = "(define (problem q) (:domain d) (:init (= (x) 1) (= (y) 5)) (:goal (GOAL))
    (:metric maximize (+ (x) (* 2 (y)))))";

#[track_caller]
fn numbers(goal: &str, plan: &str, expected: Expect) {
    check(NUMBERS, &VALUES.replace("(GOAL)", goal), plan, expected);
}

#[test]
fn effects_read_the_state_before() {
    numbers("(and (= (x) 5) (= (y) 1))", "(swap)", expect!["valid: 1 steps, cost 7"]);
}

#[test]
fn increases_add_up_and_contradictions_are_faults() {
    numbers("(= (x) 4)", "(twice)", expect!["valid: 1 steps, cost 14"]);
    numbers("(and)", "(clash)", expect!["step 1 (clash): effects contradict each other on (x)"]);
    numbers("(and)", "(unset)", expect!["step 1 (unset): (z) has no value"]);
    numbers("(> (x) (y))", "", expect!["goal: (> (x) (y)) does not hold"]);
}

#[test]
fn a_world_answers_for_the_rest_of_a_plan() {
    let (domain, problem) = parse(OFFICE, MORNING);
    let goal = pddl::parse_condition("(known-temperature office3)").into_result().expect("parses");
    let rest = pddl::parse_plan(
        "(move turtlebot-1 hall office3)\n(measure-temperature ir-1 turtlebot-1 office3)",
    )
    .into_result()
    .expect("parses");
    let mut world = World::initial(&domain, &problem).expect("makes sense");
    assert_eq!(rest_reaches(&world, &rest.steps, &goal), Ok(()));
    world.apply(&rest.steps[0]).expect("applies");
    assert_eq!(rest_reaches(&world, &rest.steps[1..], &goal), Ok(()));
    assert!(!world.holds(&goal));
    let fault = rest_reaches(&world, &rest.steps, &goal).expect_err("the robot has left the hall");
    assert_eq!(
        fault.condition().map(ToString::to_string),
        Some("(at turtlebot-1 hall)".to_owned())
    );
    let before = world.clone();
    assert!(world.apply(&rest.steps[0]).is_err());
    assert!(world == before, "a fault changed the world");
}
