//! Deordering: every linearization of its result leads to the goal.

use expect_test::{Expect, expect};
use pddl::{Domain, Plan, Problem};
use planner::order::{PartialOrder, deorder, interference};
use planner::validate::World;
use planner::{Verdict, validate};

use crate::support::{domain, parse, problem};

const OFFICE: &str = include_str!("../../benches/office/domain.pddl");
const MORNING: &str = include_str!("../../benches/office/problem.pddl");

/// Validates every total order of the steps that respects the partial order, but at most
/// `orders_max`.
pub(crate) fn assert_all_orders_work(
    domain: &Domain,
    problem: &Problem,
    plan: &Plan,
    order: &PartialOrder,
    orders_max: usize,
) -> usize {
    let mut prefixes = vec![Vec::new()];
    let mut count = 0;
    while let Some(prefix) = prefixes.pop() {
        if prefix.len() == plan.steps.len() {
            let steps = prefix.iter().map(|step: &usize| plan.steps[*step].clone()).collect();
            let verdict = validate(domain, problem, &Plan { steps, cost: None });
            assert!(matches!(verdict, Verdict::Valid { .. }), "{prefix:?}: {verdict:?}");
            count += 1;
            if count == orders_max {
                return count;
            }
        }
        let mut done = vec![false; plan.steps.len()];
        prefix.iter().for_each(|step| done[*step] = true);
        for step in order.ready(&done) {
            prefixes.push([prefix.as_slice(), &[step]].concat());
        }
    }
    count
}

#[track_caller]
fn check(domain: &str, problem: &str, plan: &str, expected: Expect) {
    let (domain, problem) = parse(domain, problem);
    let plan = pddl::parse_plan(plan).into_result().expect("the plan parses");
    let world = World::initial(&domain, &problem).expect("makes sense");
    let order = deorder(&world, &plan.steps);
    let orders = assert_all_orders_work(&domain, &problem, &plan, &order, 10_000);
    expected.assert_eq(&format!("{:?}, {orders} orders", order.predecessors));
}

#[test]
fn agents_work_in_parallel_and_each_in_order() {
    let problem = MORNING.replace("(forall (?r - room) (known-temperature ?r))", "(and)");
    check(
        OFFICE,
        &problem,
        "(report-temperature thermo1 office1)
         (move turtlebot-1 hall office3)
         (move turtlebot-2 lab hall)
         (measure-temperature ir-1 turtlebot-1 office3)
         (move turtlebot-2 hall kitchen)
         (measure-temperature ir-2 turtlebot-2 kitchen)",
        expect!["[[], [], [], [1], [2], [4]], 60 orders"],
    );
}

/// Steps that depend on each other through a branch that is not taken, through an axiom, and
/// through numbers.
const MEETINGS: &str = "(:requirements :adl :derived-predicates :fluents)
    (:predicates (a) (b) (c) (d) (e)) (:functions (n) (total-cost))
    (:derived (d) (or (a) (b)))
    (:action make-a :effect (and (a) (increase (total-cost) 1)))
    (:action use-d :precondition (d) :effect (and (e) (increase (total-cost) 1)))
    (:action branch :effect (when (e) (c)))
    (:action count :effect (increase (n) 1))
    (:action ask :precondition (>= (n) 1) :effect (b))
    (:action apart :effect (and (increase (total-cost) 3)))";

#[test]
fn branches_axioms_and_numbers_keep_their_order_and_total_cost_does_not() {
    check(
        &domain(MEETINGS),
        &problem("(:init (= (n) 0)) (:goal (and (e) (a) (n-is-one)))")
            .replace("(n-is-one)", "(= (n) 1)"),
        "(make-a) (use-d) (branch) (count) (apart)",
        expect!["[[], [0], [1], [], []], 20 orders"],
    );
    check(
        &domain(MEETINGS),
        &problem("(:init (= (n) 0)) (:goal (and (b) (e) (not (c))))"),
        "(branch) (count) (ask) (use-d)",
        expect!["[[], [], [1], [0, 2]], 3 orders"],
    );
}

/// Checks which steps of two plans for one office interfere, so that they must not be interleaved.
#[track_caller]
fn check_interference(ours: &str, theirs: &str, expected: Option<(usize, usize)>) {
    let problem = MORNING.replace("(forall (?r - room) (known-temperature ?r))", "(and)");
    let (domain, problem) = parse(OFFICE, &problem);
    let steps = |plan| pddl::parse_plan(plan).into_result().expect("the plan parses").steps;
    let world = World::initial(&domain, &problem).expect("makes sense");
    let found = interference(&world, &steps(ours), &steps(theirs));
    assert_eq!(found, expected, "{ours} beside {theirs}");
}

#[test]
fn plans_that_share_an_agent_or_a_fact_interfere() {
    let measure = "(measure-temperature ir-1 turtlebot-1 office3)";
    check_interference("(move turtlebot-2 lab hall)", "(move turtlebot-1 hall office3)", None);
    check_interference("(move turtlebot-2 lab hall)", measure, None);
    let both = format!("(report-temperature thermo1 office1) {measure}");
    check_interference(&both, "(move turtlebot-1 office3 hall)", Some((1, 0)));
    check_interference(
        "(report-temperature thermo1 office1)",
        "(report-temperature thermo1 office1)",
        Some((0, 0)),
    );
}

#[test]
fn quantifiers_with_too_many_bindings_count_for_every_fact() {
    let variables: Vec<String> = (0..20).map(|number| format!("?v{number}")).collect();
    let variables = variables.join(" ");
    let domain = domain(&format!(
        "(:predicates (seen ?x) (shut ?x) (lit ?x) (calm)) (:functions (level ?x))
         (:action look :parameters (?x) :effect (seen ?x))
         (:action light :parameters (?x) :effect (lit ?x))
         (:action fill :parameters (?x) :effect (assign (level ?x) 1))
         (:action check :parameters () :effect (calm)
           :precondition (forall ({variables}) (or (= ?v0 ?v19) (seen ?v0) (not (seen ?v19)))))
         (:action close :parameters () :effect (forall ({variables}) (when (seen ?v19) (shut ?v0))))
         (:action drain :parameters () :effect (forall ({variables}) (assign (level ?v19) 0)))"
    ));
    let problem = problem("(:objects a b c) (:init) (:goal (and))");
    let (domain, problem) = parse(&domain, &problem);
    let world = World::initial(&domain, &problem).expect("makes sense");
    for (steps, expected) in [
        ("(look a) (check)", vec![vec![], vec![0]]),
        ("(light a) (check)", vec![vec![], vec![]]),
        ("(check) (look b)", vec![vec![], vec![0]]),
        ("(look a) (close)", vec![vec![], vec![0]]),
        ("(close) (look a)", vec![vec![], vec![0]]),
        ("(close) (close)", vec![vec![], vec![0]]),
        ("(close) (light a)", vec![vec![], vec![]]),
        ("(fill a) (drain)", vec![vec![], vec![0]]),
        ("(drain) (fill c)", vec![vec![], vec![0]]),
        ("(drain) (check)", vec![vec![], vec![]]),
    ] {
        let plan = pddl::parse_plan(steps).into_result().expect("the plan parses");
        assert_eq!(deorder(&world, &plan.steps).predecessors, expected, "{steps}");
    }
}
