//! Factored tasks: what is private to an agent stays its own in the merged task, and files that
//! contradict each other are refused.

use pddl::factored::{AgentFiles, FactoredTask, merge_factored};

/// Two agents at two ends of a wall; each has a private box of the same name.
const DOMAIN: &str = "(define (domain wall) (:requirements :typing :factored-privacy)
    (:types side box - object)
    (:predicates (at-wall ?s - side) (open ?s - side) (:private (full ?b - box)))
    (:action empty :parameters (?b - box ?s - side)
        :precondition (and (full ?b) (at-wall ?s)) :effect (and (open ?s) (not (full ?b)))))";

fn problem(side: &str, goal: &str) -> String {
    format!(
        "(define (problem p) (:domain wall) (:objects {side} - side (:private crate - box))
            (:init (at-wall {side}) (full crate)) (:goal {goal}))"
    )
}

fn merged(agents: &[(&str, &str, &str)]) -> Result<FactoredTask, String> {
    let task = |(agent, domain, problem): &(&str, &str, &str)| AgentFiles {
        agent: (*agent).to_owned(),
        domain: pddl::parse_domain(domain).into_result().expect("a domain"),
        problem: pddl::parse_problem(problem).into_result().expect("a problem"),
    };
    merge_factored(&agents.iter().map(task).collect::<Vec<_>>())
}

#[test]
fn private_names_are_kept_apart_and_given_back() {
    let goal = "(and (open left) (open right))";
    let (left, right) = (problem("left", goal), problem("right", goal));
    let task = merged(&[("a", DOMAIN, &left), ("b", DOMAIN, &right)]).expect("it fits");
    let names: Vec<String> = task.domain.actions.iter().map(|it| it.name.to_string()).collect();
    assert_eq!(names, ["empty--a", "empty--b"]);
    let facts: Vec<String> = task.problem.init.iter().map(ToString::to_string).collect();
    for fact in ["(full--a crate--a)", "(full--b crate--b)", "(at-wall left)", "(known-to--a left)"]
    {
        assert!(facts.iter().any(|known| known == fact), "{fact}: {facts:?}");
    }
    assert!(!facts.iter().any(|known| known == "(known-to--a right)"), "{facts:?}");
    assert_eq!(task.problem.goal.to_string(), goal, "a common goal is stated once");
    for text in [task.domain.to_string(), task.problem.to_string()] {
        assert!(pddl::parse_document(&text).is_ok(), "{text}");
    }
    let plan = pddl::parse_plan("(empty--a crate--a left)").into_result().expect("a plan");
    assert_eq!(task.original(&plan).steps[0].to_string(), "(empty crate left)");
}

#[test]
fn contradictions_are_refused_with_the_agents() {
    let goal = "(open left)";
    let left = problem("left", goal);
    let other = DOMAIN
        .replace("(at-wall ?s - side)", "(at-wall ?s ?t - side)")
        .replace("(at-wall ?s))", "(at-wall ?s ?s))");
    let again = problem("left", goal).replace("(at-wall left)", "(at-wall left left)");
    let refused = merged(&[("a", DOMAIN, &left), ("b", &other, &again)]).expect_err("it differs");
    assert_eq!(refused, "`at-wall` takes 2 arguments for `b`, and 1 for another agent");
    let boxed = left.replace("left - side (", "left - box (");
    let refused = merged(&[("a", DOMAIN, &left), ("b", DOMAIN, &boxed)]).expect_err("it differs");
    assert_eq!(refused, "`left` is a `box` for `b`, and a `side` for another agent");
    let quantified = DOMAIN.replace("(at-wall ?s))", "(forall (?x - box) (full ?x)))");
    let right = problem("right", goal);
    let refused = merged(&[("a", &quantified, &left), ("b", DOMAIN, &right)]);
    assert!(refused.expect_err("it ranges over all").contains("has a quantifier"));
    assert_eq!(merged(&[]).expect_err("nothing is there"), "there is no agent");
}

#[test]
fn constants_of_a_domain_stay_constants() {
    let domain = DOMAIN
        .replace("(:predicates", "(:constants left - side) (:predicates")
        .replace("(at-wall ?s))", "(at-wall ?s) (at-wall left))");
    let (left, right) = (problem("left", "(open left)"), problem("right", "(open left)"));
    let left = left.replace("left - side (", "(");
    let task = merged(&[("a", &domain, &left), ("b", DOMAIN, &right)]).expect("it fits");
    let constants: Vec<String> =
        task.domain.constants.iter().map(|constant| constant.name.to_string()).collect();
    assert_eq!(constants, ["left"]);
    assert!(pddl::check_domain(&task.domain).is_empty(), "{}", task.domain);
}

#[test]
fn an_agent_uses_only_the_things_that_it_knows() {
    // Both have as many things as there are names, of which one names two things.
    let shared = "(define (domain d) (:requirements :typing) (:types thing place)
        (:predicates (stored ?t - thing ?p - place))
        (:action store :parameters (?t - thing ?p - place) :effect (stored ?t ?p)))";
    let things = "(define (problem p) (:domain d)
        (:objects hall lab - place (:private trolley - thing)) (:init) (:goal (and)))";
    let task = merged(&[("a", shared, things), ("b", shared, things)]).expect("it fits");
    let facts: Vec<String> = task.problem.init.iter().map(ToString::to_string).collect();
    let knows = |fact: &str| facts.iter().any(|known| known == fact);
    assert!(knows("(known-to--a trolley--a)") && !knows("(known-to--a trolley--b)"), "{facts:?}");
}

#[test]
fn a_quantifier_over_things_that_its_agent_does_not_know_is_refused() {
    let right = problem("right", "(and)");
    let all = problem("left", "(forall (?b - box) (not (full ?b)))");
    let refused = merged(&[("a", DOMAIN, &all), ("b", DOMAIN, &right)]).expect_err("refused");
    assert!(refused.starts_with("the goal of `a` has a quantifier"), "{refused}");
    let left = problem("left", "(and)");
    let when = DOMAIN.replace(
        "(open ?s) (not",
        "(open ?s) (when (exists (?c - box) (full ?c)) (at-wall ?s)) (not",
    );
    let refused = merged(&[("a", &when, &left), ("b", DOMAIN, &right)]).expect_err("refused");
    assert!(refused.starts_with("`empty` of `a` has a quantifier"), "{refused}");
}

#[test]
fn private_constants_are_refused() {
    let domain = "(define (domain d) (:constants (:private brass)) (:predicates (p ?x)))";
    let found = pddl::parse_domain(domain).into_result().expect_err("refused");
    assert!(found[0].to_string().contains("private constants"), "{found:?}");
}
