//! Irregularities of competition files, each reduced to a small text. Input that other planners
//! accept is accepted here with a warning at its position, and planned for as its author meant it.

use pddl::{Diagnostic, Parsed, check_domain, check_problem};
use planner::{Cancel, Options, plan, validate};

use crate::support;

/// Parses, plans and validates. Checks that there is a warning that contains `warned` at `place`,
/// and that the plan is `steps`.
#[track_caller]
fn check(domain: &str, problem: &str, warned: &str, place: &str, steps: &str) {
    let (domain_text, problem_text) = (domain, problem);
    let Parsed { value: domain, diagnostics } = pddl::parse_domain(domain_text);
    let domain = domain.expect("a domain");
    let mut found = told(domain_text, diagnostics.into_iter().chain(check_domain(&domain)));
    let Parsed { value: problem, diagnostics } = pddl::parse_problem(problem_text);
    let problem = problem.expect("a problem");
    let checked = check_problem(&domain, &problem);
    found.extend(told(problem_text, diagnostics.into_iter().chain(checked)));
    let is_it = |(message, at): &(String, String)| message.contains(warned) && at == place;
    assert!(found.iter().any(is_it), "no warning `{warned}` at `{place}`: {found:?}");
    let outcome = plan(&domain, &problem, &Options::default(), &Cancel::new());
    let outcome = outcome.unwrap_or_else(|err| panic!("{err}"));
    let Some(plan) = outcome.plan else {
        assert_eq!(outcome.stop_reason.to_string(), steps);
        return;
    };
    let lines: Vec<String> = plan.steps.iter().map(ToString::to_string).collect();
    assert_eq!(lines.join(" "), steps);
    assert!(matches!(validate(&domain, &problem, &plan), planner::Verdict::Valid { .. }));
}

/// Returns the warnings, each with the part of the text to which it refers. Panics if there is an
/// error.
fn told(text: &str, all: impl Iterator<Item = Diagnostic>) -> Vec<(String, String)> {
    let each = |found: Diagnostic| {
        assert!(!found.is_error(), "{}", found.located(text));
        (found.message, text[found.span.range()].to_owned())
    };
    all.map(each).collect()
}

const LAMP: &str = "(define (domain d) (:types lamp) (:predicates (lit ?l - lamp) (done))
    (:action light :parameters (?l - lamp) :effect (lit ?l)))";

#[test]
fn a_parameter_of_a_predicate_may_be_named_twice() {
    check(
        "(define (domain d) (:predicates (beside ?thing ?thing) (done))
           (:action put :parameters (?a ?b) :effect (beside ?a ?b)))",
        "(define (problem p) (:domain d) (:objects cup saucer) (:goal (beside cup saucer)))",
        "parameter `?thing` is declared twice",
        "?thing",
        "(put cup saucer)",
    );
}

#[test]
fn a_type_may_be_declared_twice_and_has_both_supertypes() {
    // A `nook` is both a place and a shelf; both actions accept it.
    check(
        "(define (domain d) (:types place shelf - object nook - place nook - shelf)
           (:predicates (swept ?p - place) (dusted ?s - shelf))
           (:action sweep :parameters (?p - place) :effect (swept ?p))
           (:action dust :parameters (?s - shelf) :precondition (swept ?s) :effect (dusted ?s)))",
        "(define (problem p) (:domain d) (:objects n - nook hall - place)
           (:goal (and (dusted n) (swept hall))))",
        "type `nook` is declared twice",
        "nook",
        "(sweep n) (sweep hall) (dust n)",
    );
}

#[test]
fn an_object_may_be_declared_twice_and_belongs_to_both_types() {
    let domain = "(define (domain d) (:types guest staff) (:constants boss - staff)
        (:predicates (fed ?g - guest) (paid ?s - staff))
        (:action feed :parameters (?g - guest) :effect (fed ?g))
        (:action pay :parameters (?s - staff) :precondition (not (paid ?s)) :effect (paid ?s)))";
    check(
        domain,
        "(define (problem p) (:domain d) (:objects ann - guest ann - staff bob - guest)
           (:goal (and (fed ann) (paid ann))))",
        "object `ann` is declared twice",
        "ann",
        "(feed ann) (pay ann)",
    );
    check(
        domain,
        "(define (problem p) (:domain d) (:objects ann - guest ann - guest)
           (:goal (forall (?g - guest) (fed ?g))))",
        "object `ann` is declared twice",
        "ann",
        "(feed ann)",
    );
    check(
        domain,
        "(define (problem p) (:domain d) (:objects boss - guest)
           (:goal (and (fed boss) (paid boss))))",
        "`boss` is a constant of the domain already, of another type",
        "boss",
        "(feed boss) (pay boss)",
    );
}

#[test]
fn a_variable_may_follow_a_word_without_space() {
    check(
        "(define (domain d) (:predicates (cup?c) (washed ?c))
           (:action wash :parameters (?c) :precondition (cup?c) :effect (washed ?c)))",
        "(define (problem p) (:domain d) (:objects mug) (:init (cup mug)) (:goal (washed mug)))",
        "touches the word before it",
        "?c",
        "(wash mug)",
    );
}

#[test]
fn a_lisp_package_clause_may_precede_the_definition() {
    for word in ["in-package", "IN-PACKAGE", "In-Package"] {
        check(
            &format!("({word} \"PDDL\")\n{LAMP}"),
            "(define (problem p) (:domain d) (:objects a - lamp) (:goal (lit a)))",
            &format!("`{word}` is of Lisp"),
            &format!("({word} \"PDDL\")"),
            "(light a)",
        );
    }
}

#[test]
fn vars_declare_additional_parameters() {
    check(
        "(define (domain d) (:predicates (at ?x) (road ?x ?y))
           (:action go :vars (?from) :parameters (?to) :precondition (and (at ?from) (road ?from ?to))
             :effect (and (at ?to) (not (at ?from)))))",
        "(define (problem p) (:domain d) (:objects a b) (:init (at a) (road a b)) (:goal (at b)))",
        "`:vars` are read as further parameters",
        ":vars",
        "(go b a)",
    );
}

#[test]
fn sections_may_occur_twice() {
    check(
        LAMP,
        "(define (problem p) (:domain d) (:objects a - lamp) (:init (done)) (:goal (lit a))
           (:metric minimize (total-time)) (:metric  minimize (total-time)))",
        "a second `:metric` section",
        ":metric",
        "(light a)",
    );
    check(
        LAMP,
        "(define (problem p) (:domain d) (:objects a - lamp) (:objects b - lamp) (:goal (lit b)))",
        "a second `:objects` section",
        ":objects",
        "(light b)",
    );
    check(
        "(define (domain d) (:predicates (lit)) (:predicates (done))
           (:action light :effect (and (lit) (done))))",
        "(define (problem p) (:domain d) (:init) (:goal (and (lit) (done))))",
        "a second `:predicates` section",
        ":predicates",
        "(light)",
    );
}

#[test]
fn two_different_metrics_are_an_error() {
    let problem = pddl::parse_problem(
        "(define (problem p) (:domain d) (:goal (done))
           (:metric minimize (total-time)) (:metric maximize (total-time)))",
    );
    assert!(problem.diagnostics.iter().any(Diagnostic::is_error));
}

#[test]
fn the_last_of_two_values_counts() {
    let domain = "(define (domain d) (:predicates (done)) (:functions (fuel))
        (:action go :precondition (>= (fuel) 3) :effect (done)))";
    check(
        domain,
        "(define (problem p) (:domain d) (:init (= (fuel) 1) (= (fuel) 5)) (:goal (done)))",
        "`(fuel)` is 1 already, and now 5",
        "(fuel)",
        "(go)",
    );
    check(
        domain,
        "(define (problem p) (:domain d) (:init (= (fuel) 5) (= (fuel) 1)) (:goal (done)))",
        "`(fuel)` is 5 already, and now 1",
        "(fuel)",
        "proven unsolvable before search",
    );
}

#[test]
fn facts_of_undeclared_predicates_are_ignored() {
    check(
        LAMP,
        "(define (problem p) (:domain d) (:objects a - lamp) (:init (color a) (not (old a)))
           (:goal (lit a)))",
        "the domain has no predicate `color`",
        "color",
        "(light a)",
    );
}

#[test]
fn an_undeclared_type_has_no_objects() {
    check(
        "(define (domain d) (:types lamp) (:predicates (lit ?l - lamp) (seen ?g - ghost))
           (:action haunt :parameters (?g - ghost ?l - lamp) :effect (lit ?l))
           (:action light :parameters (?l - lamp) :effect (lit ?l)))",
        "(define (problem p) (:domain d) (:objects a - lamp) (:goal (lit a)))",
        "unknown type `ghost`",
        "ghost",
        "(light a)",
    );
}

#[test]
fn a_contradictory_initial_fact_is_true_and_reported_with_both_places() {
    let problem = "(define (problem p) (:domain d) (:objects a - lamp)
        (:init (not (lit a)) (lit a)) (:goal (lit a)))";
    check(LAMP, problem, "`(lit a)` is said to be true here", "(lit a)", "");
    let (domain, parsed) = (pddl::parse_domain(LAMP).value, pddl::parse_problem(problem).value);
    let found = check_problem(&domain.expect("a domain"), &parsed.expect("a problem"));
    let note = found[0].notes.first().expect("the other place");
    assert_eq!(&problem[note.span.range()], "(lit a)");
    assert!(note.span.start < found[0].span.start);
}

#[test]
fn an_extra_parenthesis_at_the_end_is_tolerated() {
    check(
        &format!("{LAMP})"),
        "(define (problem p) (:domain d) (:objects a - lamp) (:goal (lit a)))",
        "`)` after the end closes nothing",
        ")",
        "(light a)",
    );
}

#[test]
fn a_predicate_may_be_declared_twice_in_the_same_way() {
    check(
        "(define (domain d) (:predicates (lit ?x) (lit ?y)) (:action light :parameters (?x)
           :effect (lit ?x)))",
        "(define (problem p) (:domain d) (:objects a) (:goal (lit a)))",
        "predicate `lit` is declared twice",
        "lit",
        "(light a)",
    );
    let other = "(define (domain d) (:predicates (lit ?x) (lit)))";
    let domain = pddl::parse_domain(other).value.expect("a domain");
    assert!(check_domain(&domain).iter().any(Diagnostic::is_error), "which of the two is meant?");
}

#[test]
fn an_unknown_requirement_is_reported() {
    check(
        &LAMP.replace("(:types", "(:requirements :typng :concurrency) (:types"),
        "(define (problem p) (:domain d) (:objects a - lamp) (:goal (lit a)))",
        "unknown requirement `:typng`",
        ":typng",
        "(light a)",
    );
}

#[test]
fn a_total_cost_that_is_not_declared_is_counted() {
    for (functions, start) in [("", ""), ("(:functions (f))", ""), ("", "(= (total-cost) 0)")] {
        let domain = support::domain(&format!(
            "(:predicates (g)) {functions}
             (:action dear :effect (and (g) (increase (total-cost) 5)))
             (:action cheap :effect (and (g) (increase (total-cost) 2)))"
        ));
        let problem = support::problem(&format!(
            "(:init {start}) (:goal (g)) (:metric minimize (total-cost))"
        ));
        let outcome = support::outcome(&domain, &problem).expect("it plans");
        assert!(outcome.statistics.proven_optimal);
        assert_eq!(outcome.plan.and_then(|plan| plan.cost).map(|cost| cost.0), Some(2.0));
        let (domain, _) = support::parse(&domain, &problem);
        let warned = pddl::check_domain(&domain);
        assert!(warned.iter().all(|found| !found.is_error() && found.span.start > 0), "{warned:?}");
        assert!(warned[0].message.contains("`total-cost` is not declared"), "{warned:?}");
    }
}

#[test]
fn an_object_may_be_declared_by_either_and_has_both_types() {
    let domain = "(define (domain d) (:types b c) (:predicates (p ?x - b) (q ?x - c) (done ?x))
        (:action a :parameters (?x - b ?y - c) :precondition (and (p ?x) (q ?y)) :effect (done ?x)))";
    check(
        domain,
        "(define (problem p) (:domain d) (:objects k - (either b c)) (:init (p k) (q k))
           (:goal (and (done k) (exists (?x - c) (done ?x)) (exists (?x - b) (done ?x)))))",
        "`k` is of type `b` and of type `c`",
        "k",
        "(a k k)",
    );
    // An `either` of a variable means one of the types.
    let either = domain.replace("?x - b ?y - c", "?x ?y - (either b c)");
    check(
        &either,
        "(define (problem p) (:domain d) (:objects k - (either b c) l - c) (:init (p k) (q l))
           (:goal (done k)))",
        "`k` is of type `b` and of type `c`",
        "k",
        "(a k l)",
    );
}

#[test]
fn an_object_that_is_named_by_digits_can_be_compared() {
    let domain = "(define (domain d) (:constants 1) (:predicates (p ?x))
        (:action a :parameters (?x) :precondition (not (= ?x 1)) :effect (p ?x)))";
    let problem = "(define (problem q) (:domain d) (:objects k) (:goal (exists (?x) (p ?x))))";
    support::check(domain, problem, expect_test::expect![["(a k)\ncost 1, optimal\n"]]);
}
