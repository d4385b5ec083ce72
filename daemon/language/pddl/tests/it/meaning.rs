//! Tests of the semantic checks: trees with semantic mistakes, and valid trees that are unusual.

use expect_test::{Expect, expect};
use pddl::Diagnostic;

const DOMAIN: &str = "(define (domain office)
  (:requirements :typing)
  (:types room corridor - location robot sensor - object turtlebot - robot)
  (:constants dock - room)
  (:predicates (connected ?a ?b - location) (at ?r - robot ?l - location) (mobile ?x - (either robot sensor))
    (reachable ?l - location))
  (:functions (total-cost) - number (distance ?a ?b - location) - number)
  (:derived (reachable ?l - location) (exists (?r - robot) (at ?r ?l)))
  (:action move :parameters (?r - robot ?from ?to - location)
    :precondition (and (at ?r ?from) (connected ?from ?to))
    :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) (distance ?from ?to)))))";

const PROBLEM: &str =
    "(define (problem map) (:domain office) (:objects bot - turtlebot hall - corridor)
  (:init (at bot dock) (connected dock hall)) (:goal (at bot hall)))";

fn domain() -> pddl::Domain {
    pddl::parse_domain(DOMAIN).into_result().expect("the text is right")
}

fn problem() -> pddl::Problem {
    pddl::parse_problem(PROBLEM).into_result().expect("the text is right")
}

fn report(text: &str, diagnostics: &[Diagnostic], expected: &Expect) {
    let mut lines = String::new();
    for diagnostic in diagnostics {
        let marked = &text[diagnostic.span.range()];
        lines += &format!("{} at `{marked}`\n", diagnostic.located(text));
    }
    expected.assert_eq(&lines);
}

/// Checks a domain by itself.
#[track_caller]
fn check(text: &str, expected: Expect) {
    let domain = pddl::parse_domain(text).into_result().expect("the form is right");
    report(text, &pddl::check_domain(&domain), &expected);
}

/// Checks a problem with these sections against the domain of the office.
#[track_caller]
fn check_problem(sections: &str, expected: Expect) {
    let text = format!("(define (problem p) (:domain office) {sections})");
    let problem = pddl::parse_problem(&text).into_result().expect("the form is right");
    report(&text, &pddl::check_problem(&domain(), &problem), &expected);
}

/// Checks an action model with these sections against the domain of the office.
#[track_caller]
fn check_model(sections: &str, expected: Expect) {
    let text = format!("(define (agent bot) (:domain office) {sections})");
    let model = pddl::parse_action_model(&text).into_result().expect("the form is right");
    report(&text, &pddl::check_action_model(&domain(), &model), &expected);
}

/// Checks a goal against the domain and objects of the office.
#[track_caller]
fn check_goal(text: &str, expected: Expect) {
    let goal = pddl::parse_condition(text).into_result().expect("the form is right");
    report(text, &pddl::check_condition(&domain(), &problem(), &goal), &expected);
}

/// Checks a plan against the domain and objects of the office.
#[track_caller]
fn check_plan(text: &str, expected: Expect) {
    let plan = pddl::parse_plan(text).into_result().expect("the form is right");
    report(text, &pddl::check_plan(&domain(), &problem(), &plan), &expected);
}

#[test]
fn the_office_has_no_errors() {
    check(
        DOMAIN,
        expect![[r#"
            3:27: warning: supertype `location` is not declared; declare it: `location - object` at `location`
        "#]],
    );
    report(PROBLEM, &pddl::check_problem(&domain(), &problem()), &expect![[r#""#]]);
    check_goal("(forall (?r - robot) (exists (?l - room) (at ?r ?l)))", expect![[r#""#]]);
    check_plan("(move bot dock hall)", expect![[r#""#]]);
}

#[test]
fn similar_names_are_suggested_for_unknown_words() {
    check_goal(
        "(conected dock hall)",
        expect![[r#"
        1:2: error: unknown predicate `conected`; did you mean `connected`? [(connected ?a ?b - location)] at `conected`
    "#]],
    );
    check_goal(
        "(and (at bot hal) (flies bot) (at both dock))",
        expect![[r#"
        1:14: error: unknown object `hal`; did you mean `hall`? at `hal`
        1:20: error: unknown predicate `flies` at `flies`
        1:35: error: unknown object `both`; did you mean `bot`? at `both`
    "#]],
    );
    check_goal(
        "(exists (?room - rom) (at bot ?rom))",
        expect![[r#"
        1:18: error: unknown type `rom`; did you mean `room`? at `rom`
        1:31: error: unknown variable `?rom`; did you mean `?room`? at `?rom`
    "#]],
    );
    check_goal(
        "(< (distanc dock hall) 5)",
        expect![[r#"
        1:5: error: unknown function `distanc`; did you mean `distance`? [(distance ?a ?b - location)] at `distanc`
    "#]],
    );
    check_plan(
        "(mov bot dock hall)\n(move bot duck hall)\n(fly)",
        expect![[r#"
        1:2: error: unknown action `mov`; did you mean `move`? at `mov`
        2:11: error: unknown object `duck`; did you mean `dock`? at `duck`
        3:2: error: unknown action `fly` at `fly`
    "#]],
    );
    check_problem(
        "(:requirements :strips :typng)",
        expect![[r#"
            1:61: warning: unknown requirement `:typng`; did you mean `:typing`? at `:typng`
        "#]],
    );
}

#[test]
fn arguments_fit_in_number_and_type() {
    check_goal(
        "(connected dock)",
        expect![[r#"
        1:1: error: `connected` takes 2 arguments, found 1 [(connected ?a ?b - location)] at `(connected dock)`
    "#]],
    );
    check_goal(
        "(at hall bot)",
        expect![[r#"
        1:5: error: `hall` is of type `corridor`, `at` wants `robot` [(at ?r - robot ?l - location)] at `hall`
        1:10: error: `bot` is of type `turtlebot`, `at` wants `location` [(at ?r - robot ?l - location)] at `bot`
    "#]],
    );
    check_goal(
        "(and (mobile bot) (mobile dock))",
        expect![[r#"
        1:27: error: `dock` is of type `room`, `mobile` wants `(either robot sensor)` [(mobile ?x - (either robot sensor))] at `dock`
    "#]],
    );
    check_goal(
        "(exists (?x - (either robot room)) (mobile ?x))",
        expect![[r#"
        1:44: warning: `?x` is of type `(either robot room)`, `mobile` wants `(either robot sensor)`; not every one is [(mobile ?x - (either robot sensor))] at `?x`
    "#]],
    );
    check_goal(
        "(exists (?x) (mobile ?x))",
        expect![[r#"
        1:22: warning: `?x` is of type `object`, `mobile` wants `(either robot sensor)`; not every one is [(mobile ?x - (either robot sensor))] at `?x`
    "#]],
    );
    check_goal(
        "(> (distance hall) 1)",
        expect![[r#"
        1:4: error: `distance` takes 2 arguments, found 1 [(distance ?a ?b - location)] at `(distance hall)`
    "#]],
    );
    check_plan(
        "(move bot dock)\n(move hall dock bot)",
        expect![[r#"
        1:1: error: `move` takes 3 arguments, found 2 [(move ?r - robot ?from - location ?to - location)] at `(move bot dock)`
        2:7: error: `hall` is of type `corridor`, `move` wants `robot` [(move ?r - robot ?from - location ?to - location)] at `hall`
        2:17: error: `bot` is of type `turtlebot`, `move` wants `location` [(move ?r - robot ?from - location ?to - location)] at `bot`
    "#]],
    );
}

#[test]
fn predicates_and_functions_are_distinguished() {
    check_goal(
        "(and (distance dock hall) (< (at bot dock) 1))",
        expect![[r#"
        1:7: error: `distance` is a function, not a predicate; compare its value: `(= (…) NUMBER)` [(distance ?a ?b - location)] at `distance`
        1:31: error: `at` is a predicate, not a function [(at ?r - robot ?l - location)] at `at`
    "#]],
    );
}

#[test]
fn a_variable_without_its_question_mark_is_recognized() {
    check_goal(
        "(exists (?place - location) (at bot place))",
        expect![[r#"
        1:37: error: unknown object `place`; did you mean `?place`? at `place`
    "#]],
    );
}

#[test]
fn an_object_in_a_domain_must_be_a_constant() {
    check(
        "(define (domain d) (:constants hall) (:predicates (p ?x))
           (:action act :precondition (and (p hall) (p kitchen) (p hal))))",
        expect![[r#"
            2:56: error: unknown object `kitchen`; add it to `:constants`, or take a parameter: a domain knows no objects of problems at `kitchen`
            2:68: error: unknown object `hal`; did you mean `hall`? at `hal`
        "#]],
    );
}

#[test]
fn nothing_is_declared_twice() {
    check(
        "(define (domain d) (:types a A) (:constants k - a K - a) (:predicates (p) (P ?x - a)) (:functions (f) (f))
           (:action act :parameters (?x ?x - a)) (:durative-action Act :duration ()))",
        expect![[r#"
            1:30: warning: type `A` is declared twice; leave one of the two out at `A`
            1:51: warning: constant `K` is declared twice; leave one of the two out at `K`
            1:76: error: predicate `P` is declared twice at `P`
            1:104: warning: function `f` is declared twice; the first one counts at `f`
            2:41: error: parameter `?x` is declared twice at `?x`
            2:68: error: action `Act` is declared twice at `Act`
        "#]],
    );
    check_problem(
        "(:objects a a - room dock - room)",
        expect![[r#"
            1:50: warning: object `a` is declared twice; leave one of the two out at `a`
            1:59: warning: `dock` is a constant of the domain already at `dock`
        "#]],
    );
    check_problem(
        "(:objects dock - robot)",
        expect![[r#"
            1:48: warning: `dock` is a constant of the domain already, of another type; it belongs to both types at `dock`
        "#]],
    );
}

#[test]
fn types_must_be_declared_and_form_no_cycle() {
    check(
        "(define (domain d) (:types a - b b - c c - a d - thing))",
        expect![[r#"
        1:28: error: type `a` is its own supertype; by way of `b`, `c` at `a`
        1:50: warning: supertype `thing` is not declared; declare it: `thing - object` at `thing`
    "#]],
    );
    check(
        "(define (domain d) (:types a - a object))",
        expect![[r#"
        1:28: error: type `a` is its own supertype; a type cannot be its own supertype at `a`
    "#]],
    );
    check(
        "(define (domain d) (:types room) (:constants k - rom) (:predicates (p ?x ?y - rooom))
           (:functions (f ?x - hall)) (:action a :parameters (?z - moor) :effect (p ?z ?z)))",
        expect![[r#"
            1:50: error: unknown type `rom`; did you mean `room`? at `rom`
            1:79: warning: unknown type `rooom`; did you mean `room`? at `rooom`
            2:32: warning: unknown type `hall`; it is not declared, and nothing is of it at `hall`
            2:68: warning: unknown type `moor`; it is not declared, and nothing is of it at `moor`
        "#]],
    );
}

#[test]
fn the_depth_of_types_is_limited() {
    let tower: Vec<_> = (0..300).map(|level| format!("t{} - t{level}", level + 1)).collect();
    check(
        &format!("(define (domain d) (:types t0 - object {}))", tower.join(" ")),
        expect![[r#"
            1:2870: error: more than 256 types stand above `t255` at `t255`
        "#]],
    );
}

#[test]
fn derived_predicates_cannot_be_set() {
    check(
        "(define (domain d) (:predicates (p) (q) (r ?x)) (:derived (p) (q))
           (:derived (r ?x ?y) (q)) (:derived (s) (q)) (:action a :effect (and (p) (not (p)))))",
        expect![[r#"
            2:23: error: `r` takes 1 argument, found 2 [(r ?x)] at `r`
            2:48: error: unknown predicate `s` at `s`
            2:81: error: `p` is derived, no action can change it; change what it is derived from at `p`
            2:90: error: `p` is derived, no action can change it; change what it is derived from at `p`
        "#]],
    );
    check_problem(
        "(:init (reachable dock))",
        expect![[r#"
        1:46: error: `reachable` is derived, no fact can set it; state what it is derived from at `reachable`
    "#]],
    );
}

#[test]
fn axioms_must_have_layers() {
    check(
        "(define (domain d) (:predicates (p) (q) (r) (s)) (:derived (p) (not (q)))
           (:derived (q) (or (r) (s))) (:derived (r) (imply (p) (s))) (:derived (s) (and (s) (not (s)))))",
        expect![[r#"
            1:70: error: `p` is derived from `(not (q …))`, which depends on it; axioms must have layers: negate only what lies below at `q`
            2:62: error: `r` is derived from `(not (p …))`, which depends on it; axioms must have layers: negate only what lies below at `p`
            2:100: error: `s` is derived from its own negation; axioms must have layers: negate only what lies below at `s`
        "#]],
    );
    check(
        "(define (domain d) (:predicates (p) (q) (r)) (:derived (p) (or (p) (not (not (p))) (not (q))))
           (:derived (q) (not (r))))",
        expect![[r#""#]],
    );
}

#[test]
fn costs_may_only_increase() {
    check(
        "(define (domain d) (:action a :effect (increase (total-cost) 1)))",
        expect![[r#"
        1:50: warning: `total-cost` is not declared; add `(:functions (total-cost) - number)` at `total-cost`
    "#]],
    );
    check(
        "(define (domain d) (:functions (total-cost)) (:action a :effect (assign (total-cost) 1)))",
        expect![[r#"
            1:65: warning: `total-cost` is only ever increased [(increase (total-cost) EXPRESSION)] at `(assign (total-cost) 1)`
        "#]],
    );
}

#[test]
fn problems_are_lenient_with_repetition_and_spare_values() {
    check_problem(
        "(:init (at dock dock) (connected dock dock) (connected dock dock))",
        expect![[r#"
            1:49: error: `dock` is of type `room`, `at` wants `robot` [(at ?r - robot ?l - location)] at `dock`
        "#]],
    );
    check_problem(
        "(:init (= (fuel dock) 3) (= (distanc dock dock) 3))",
        expect![[r#"
            1:49: warning: the domain has no function `fuel`; declare it in `:functions`, or leave the value out at `fuel`
            1:67: error: unknown function `distanc`; did you mean `distance`? [(distance ?a ?b - location)] at `distanc`
        "#]],
    );
    check_problem(
        "(:init (= (distance dock dock) 1) (= (distance DOCK dock) 2))",
        expect![[r#"
            1:75: warning: `(distance DOCK dock)` is 1 already, and now 2; the last value counts at `(distance DOCK dock)`
        "#]],
    );
    let elsewhere = PROBLEM.replace("(:domain office)", "(:domain home)");
    let problem = pddl::parse_problem(&elsewhere).into_result().expect("the form is right");
    report(
        &elsewhere,
        &pddl::check_problem(&domain(), &problem),
        &expect![[r#"
        1:32: warning: the domain is called `office` at `home`
    "#]],
    );
}

#[test]
fn facts_from_a_user_are_checked_more_strictly() {
    let text = "(at bot hall) (= (fuel dock) 3)";
    let facts = pddl::parse_init_elements(text).into_result().expect("the form is right");
    let diagnostics = pddl::check_init_elements(&domain(), &problem(), &facts);
    report(
        text,
        &diagnostics,
        &expect![[r#"
        1:19: error: unknown function `fuel` at `fuel`
    "#]],
    );
}

#[test]
fn models_are_checked_against_the_ontology() {
    check_model(
        "(:types waffle - turtlebot dog - animal) (:predicates (connected ?x ?y - location) (at ?r - robot))
           (:objects bot - waffle) (:init (at bot kitchen))
           (:action bark :agent ?d - waffle :parameters (?l - locaton) :precondition (at ?d ?l)
             :effect (barked ?l))",
        expect![[r#"
            1:71: warning: supertype `animal` is not declared; declare it: `animal - object` at `animal`
            1:122: warning: the ontology declares `at` differently, and takes precedence [(at ?r - robot ?l - location)] at `at`
            2:51: hint: unknown object `kitchen`; the map or another agent has to bring it at `kitchen`
            3:63: error: unknown type `locaton`; did you mean `location`? at `locaton`
            4:23: error: unknown predicate `barked` at `barked`
        "#]],
    );
    check_model(
        "(:action beep :agent ?r - turtlebot :parameters (?r - robot))",
        expect![[r#"
        1:16: warning: the agent `bot` is not among its objects; add `(:objects bot - TYPE)` at `bot`
        1:87: error: `?r` is the agent and a parameter at `?r`
    "#]],
    );
}

#[test]
fn agents_of_a_joint_action_are_checked() {
    check_model(
        "(:objects bot - robot) (:action a :agent (?r - robot ?r - robot) :parameters (?l - location))
           (:action b :agent (?r ?s - robot) :parameters (?s - location) :precondition (at ?s ?l))",
        expect![[r#"
            1:91: error: the agent `?r` is declared twice at `?r`
            2:59: error: `?s` is an agent and a parameter at `?s`
            2:92: error: `?s` is of type `location`, `at` wants `robot` [(at ?r - robot ?l - location)] at `?s`
            2:95: error: unknown variable `?l` at `?l`
        "#]],
    );
}

#[test]
fn durative_actions_are_checked() {
    check(
        "(define (domain d) (:predicates (p)) (:durative-action a :parameters (?x) :duration (= ?duration (f))
           :condition (at start (q ?y)) :effect (and (forall (?z) (at end (r ?z))) (increase (g) (* #t 1))
             (when (at end (s)) (at end (p))))))",
        expect![[r#"
            1:99: error: unknown function `f` at `f`
            2:34: error: unknown predicate `q` at `q`
            2:36: error: unknown variable `?y` at `?y`
            2:76: error: unknown predicate `r` at `r`
            2:95: error: unknown function `g` at `g`
            3:29: error: unknown predicate `s` at `s`
        "#]],
    );
}

#[test]
fn the_search_for_similar_names_is_limited() {
    let objects: Vec<_> = (0..3_000).map(|number| format!("object-number-{number}")).collect();
    let facts: Vec<_> =
        (0..3_000).map(|number| format!("(at nothing-like-{number} dock)")).collect();
    let sections = format!("(:objects {} - robot) (:init {})", objects.join(" "), facts.join(" "));
    let text = format!("(define (problem p) (:domain office) {sections})");
    let problem = pddl::parse_problem(&text).into_result().expect("the form is right");
    assert_eq!(pddl::check_problem(&domain(), &problem).len(), 1_001);
}

#[test]
fn an_object_named_like_a_type_is_reported() {
    let domain = "(define (domain d) (:types room) (:predicates (p ?x - room)))";
    let problem = "(define (problem p) (:domain d) (:objects hall attic room) (:goal (p hall)))";
    let domain = pddl::parse_domain(domain).into_result().unwrap();
    let parsed = pddl::parse_problem(problem).into_result().unwrap();
    let found = pddl::check_problem(&domain, &parsed);
    let told: Vec<String> = found.iter().map(|one| one.located(problem)).collect();
    assert_eq!(
        told[0],
        "1:54: warning: the object `room` has the name of a type; for the type of what stands \
         before it, write `- room`"
    );
    assert!(found[1].is_error(), "{told:?}");
}
