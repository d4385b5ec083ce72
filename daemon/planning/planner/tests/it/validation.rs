//! The validator: the plans that it accepts, and the faults that it reports for others.

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
fn the_failing_part_of_a_precondition_is_reported_with_its_objects() {
    office(
        "(at turtlebot-1 lab)",
        "(move turtlebot-1 office1 hall)",
        expect!["step 1 (move turtlebot-1 office1 hall): (at turtlebot-1 office1) does not hold"],
    );
}

#[test]
fn the_failing_instance_of_a_goal_is_reported() {
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
fn effects_use_the_state_before_the_step() {
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
fn a_world_validates_the_rest_of_a_plan() {
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

/// Mutually recursive axioms: `early` holds at once and `late` spreads along the chain. `both` must
/// be evaluated again whenever one of the two grows.
const FEEDING: &str = "(define (domain d)
    (:predicates (next ?x ?y) (p ?x) (q ?x) (early ?x) (late ?x) (both ?x) (htob ?x) (lonely))
    (:derived (early ?x) (or (p ?x) (exists (?y) (and (both ?y) (next ?x ?y)))))
    (:derived (late ?x) (or (q ?x) (exists (?y) (and (next ?y ?x) (late ?y)))))
    (:derived (late ?x) (forall (?y) (imply (next ?x ?y) (htob ?y))))
    (:derived (both ?x) (and (early ?x) (late ?x)))
    (:derived (htob ?x) (and (late ?x) (early ?x)))
    (:derived (lonely) (exists (?x) (not (late ?x))))
    (:action cut :parameters (?x ?y) :effect (not (next ?x ?y)))
    (:action drop :parameters (?x) :effect (not (p ?x))))";
const CHAIN: &str = "(define (problem c) (:domain d) (:objects a b c e f g h i j k - object)
    (:init (q a) (p h) (next k k) (next a b) (next b c) (next c e) (next e f) (next f g)
           (next g h) (next h i) (next i j) (next j k))
    (:goal (GOAL)))";

#[track_caller]
fn feeding(goal: &str, plan: &str, expected: Expect) {
    check(FEEDING, &CHAIN.replace("(GOAL)", goal), plan, expected);
}

#[test]
fn mutually_recursive_axioms_reach_a_fixpoint() {
    let all = "(and (both a) (htob a) (both h) (htob h) (not (both i)) (late k) (not (lonely)))";
    feeding(all, "", expect!["valid: 0 steps, cost 0"]);
    feeding(all, "(cut f g)", expect!["goal: (both a) does not hold"]);
    // After the cut, `h` has no successor, so the second axiom makes it `late`.
    feeding(
        "(and (both h) (not (late j)) (lonely))",
        "(cut a b) (cut h i)",
        expect!["valid: 2 steps, cost 2"],
    );
    feeding(
        "(or (both a) (early g))",
        "(drop h)",
        expect!["goal: (or (both a) (early g)) does not hold"],
    );
}

#[test]
fn effects_happen_once_per_binding() {
    let domain = "(define (domain d) (:types t) (:predicates (r ?x ?y) (done ?x)) (:functions (n))
        (:action count :effect (forall (?x - t)
            (when (exists (?y) (r ?x ?y)) (and (increase (n) 1) (done ?x))))))";
    let problem = "(define (problem p) (:domain d) (:objects a b - t c)
        (:init (r a a) (r a b) (r a c) (r c a) (= (n) 0))
        (:goal (and (= (n) 1) (done a) (not (done c)))))";
    check(domain, problem, "(count)", expect!["valid: 1 steps, cost 1"]);
}

#[test]
fn the_first_failing_instance_in_text_order_is_reported() {
    let domain = "(define (domain d) (:predicates (p ?x) (r ?x ?y)) (:functions (f ?x) (n))
        (:action sum :effect (forall (?x) (when (p ?x) (increase (n) (f ?x))))))";
    // The facts are in a different order than the objects.
    let problem = |goal| {
        format!(
            "(define (problem q) (:domain d) (:objects a b c)
             (:init (p c) (p b) (r b c) (r b b) (= (n) 0)) (:goal {goal}))"
        )
    };
    check(domain, &problem("(and)"), "(sum)", expect!["step 1 (sum): (f b) has no value"]);
    check(
        domain,
        &problem("(forall (?x ?y) (or (r ?x ?y) (not (p ?x))))"),
        "",
        expect!["goal: (or (r b a) (not (p b))) does not hold"],
    );
}

#[test]
fn the_axiom_that_depends_on_its_own_negation_is_named() {
    // `a` depends on the cycle but is not part of it.
    let domain = "(define (domain d) (:predicates (a) (b) (c))
        (:derived (a) (not (b))) (:derived (b) (c)) (:derived (c) (not (b))))";
    let (domain, problem) = parse(domain, "(define (problem q) (:domain d) (:init) (:goal (and)))");
    let diagnostics = World::initial(&domain, &problem).expect_err("there is a circle");
    let messages: Vec<&str> = diagnostics.iter().map(|one| one.message.as_str()).collect();
    assert_eq!(messages, ["`c` depends on its own negation"]);
}

#[test]
fn one_argument_is_named_in_the_singular() {
    let domain = "(define (domain d) (:predicates (p ?x))
        (:action a :parameters (?x) :effect (p ?x)))";
    let problem = "(define (problem q) (:domain d) (:objects o) (:goal (and)))";
    check(domain, problem, "(a o o)", expect!["step 1 (a o o): takes 1 argument, not 2"]);
    let wrong = domain.replace("(p ?x)))", "(p ?x ?x)))");
    let (wrong, problem) = parse(&wrong, problem);
    let planned =
        planner::plan(&wrong, &problem, &planner::Options::default(), &planner::Cancel::new());
    let told = planned.map_err(|err| format!("{err:?}")).expect_err("an effect is wrong");
    assert!(told.contains("takes 1 argument, ") && !told.contains("1 arguments"), "{told}");
}
