//! Tests of texts that are reported as unsupported, of texts that are accepted with a warning, and
//! of texts that are valid but use unusual names.

use pddl::{Diagnostic, Parsed, check_domain, check_metric_values};

fn domain(parts: &str) -> Parsed<pddl::Domain> {
    pddl::parse_domain(&format!("(define (domain d) (:predicates (p) (q ?x)) {parts})"))
}

#[track_caller]
fn refused_by_name(parts: &str, word: &str) {
    let found = domain(parts).diagnostics;
    let is_it = |one: &Diagnostic| one.is_unsupported && one.message.contains(word);
    assert!(found.iter().any(is_it), "{parts}: {found:?}");
}

#[test]
fn nondeterministic_effects_are_rejected_by_name() {
    for effect in [
        "(oneof (p) (not (p)))",
        "(and (p) (OneOf (and) (p)))",
        "(when (p) (oneof (p) (and)))",
        "(probabilistic 0.5 (p))",
        "(forall (?x) (probabilistic 1/3 (q ?x) 2/3 (and)))",
    ] {
        let word = if effect.contains("prob") { "probabilistic" } else { "oneof" };
        refused_by_name(&format!("(:action a :effect {effect})"), word);
    }
}

#[test]
fn nesting_beyond_the_limit_is_reported_as_a_limit() {
    let deep = |depth: usize| {
        let condition = "(not ".repeat(depth) + "(p)" + &")".repeat(depth);
        format!("(:action a :precondition {condition} :effect (p))")
    };
    refused_by_name(&deep(300), "128");
    refused_by_name(&deep(128), "128");
    assert!(domain(&deep(100)).is_ok());
}

#[test]
fn predicates_may_have_the_names_of_unsupported_keywords() {
    for name in ["preference", "always", "oneof", "probabilistic"] {
        let text = format!(
            "(define (domain d) (:predicates ({name}) (of ?x))
               (:action a :precondition ({name}) :effect (not ({name})))
               (:action b :effect ({name})))"
        );
        let domain = pddl::parse_domain(&text);
        assert!(domain.is_ok(), "{name}: {:?}", domain.diagnostics);
        assert!(check_domain(&domain.value.expect("a domain")).is_empty(), "{name}");
    }
    let goal = "(define (problem p) (:domain d) (:goal (preference)))";
    assert!(pddl::parse_problem(goal).is_ok());
    let soft = "(define (problem p) (:domain d) (:goal (and (p) (preference soon (p)))))";
    let found = pddl::parse_problem(soft).diagnostics;
    assert!(found.iter().any(|one| one.is_unsupported), "{found:?}");
}

#[test]
fn a_quantifier_may_have_one_variable_twice() {
    for condition in ["(exists (?y ?y) (q ?y))", "(forall (?y ?z ?y) (q ?y))"] {
        let action = format!("(:action a :precondition {condition} :effect (p))");
        let found = check_domain(&domain(&action).value.expect("a domain"));
        let [one] = found.as_slice() else { panic!("{condition}: {found:?}") };
        assert!(!one.is_error() && one.message.contains("`?y` is declared twice"), "{one:?}");
    }
}

#[test]
fn an_invalid_character_in_a_name_is_shown_as_written() {
    for (name, shown) in [("o'clock", "`'`"), ("\"a\"", "`\"`"), ("a\u{1}b", "U+0001")] {
        let text = format!("(define (domain {name}))");
        let found = pddl::parse_domain(&text).diagnostics;
        let help = found.iter().filter_map(|one| one.help.clone()).collect::<Vec<_>>().concat();
        assert!(help.contains(shown) && !help.contains('\\'), "{name}: {found:?}");
    }
}

#[test]
fn a_used_fact_is_not_reported_as_unread() {
    let text = "(define (domain d) (:action a :precondition (ready) :effect (increase (fuel) 1)))";
    let domain = pddl::parse_domain(text).value.expect("a domain");
    let problem = "(define (problem p) (:domain d) (:init (ready) (= (fuel) 1)) (:goal (and)))";
    let problem = pddl::parse_problem(problem).value.expect("a problem");
    let found = pddl::check_problem(&domain, &problem);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found.iter().all(|one| !one.is_error() && !format!("{one}").contains("read;")));
    assert!(found.iter().all(|one| !format!("{one}").contains("never read")), "{found:?}");
}

#[test]
fn a_metric_over_an_undefined_function_is_an_error() {
    let check = |action: &str, init: &str| {
        let text = format!("(define (domain d) (:functions (n) (m)) (:action a :effect {action}))");
        let domain = pddl::parse_domain(&text).value.expect("a domain");
        let text = format!(
            "(define (problem p) (:domain d) (:init {init}) (:goal (and))
               (:metric minimize (+ (total-cost) (n))))"
        );
        check_metric_values(&domain, &pddl::parse_problem(&text).value.expect("a problem"))
    };
    assert_eq!(check("(assign (m) 1)", "").len(), 1);
    assert_eq!(check("(increase (n) 1)", "(= (m) 1)").len(), 1);
    assert_eq!(check("(forall (?x) (when (and) (assign (n) 1)))", ""), []);
    assert_eq!(check("(assign (m) 1)", "(= (n) 1)"), []);
}
