//! Tests of valid texts with all features of the language. Each text is parsed and printed.

use expect_test::{Expect, expect};

/// Parses a file of any kind, which must have no mistake, and prints it.
#[track_caller]
fn check(text: &str, expected: Expect) {
    let parsed = pddl::parse_document(text);
    let messages: Vec<_> = parsed.diagnostics.iter().map(|it| it.located(text)).collect();
    assert!(messages.is_empty(), "{messages:#?}");
    let printed = parsed.value.as_ref().map(ToString::to_string).unwrap_or_default();
    expected.assert_eq(&printed);
    assert_eq!(pddl::parse_document(&printed).value, parsed.value);
}

#[test]
fn sections_may_be_in_any_order_and_case() {
    check(
        "(DEFINE (Problem Tower)\r\n(:METRIC Minimize TOTAL-COST); ümläut\r\n(:goal())
           (:init(On ?)(= total-cost 0))(:objects ? A B)(:domain Blocks))"
            .replace('?', "C")
            .as_str(),
        expect![[r#"
            (define (problem Tower)
              (:domain Blocks)
              (:objects C A B - object)
              (:init (On C) (= (total-cost) 0))
              (:goal (and))
              (:metric minimize (TOTAL-COST)))
        "#]],
    );
}

#[test]
fn types_may_have_alternatives_everywhere() {
    check(
        "(define (domain d) (:types a b - (either x y) c) (:constants k - (either a b))
           (:predicates (p ?x - (either a b) ?y ?z - c))
           (:functions (f ?x - (either a b)) (g) - number (h))
           (:action act :parameters (?x - (either a b))
             :precondition (exists (?y - (either b c) ?z) (p ?x ?y))))",
        expect![[r#"
            (define (domain d)
              (:types a b - (either x y) c)
              (:constants k - (either a b))
              (:predicates (p ?x - (either a b) ?y ?z - c))
              (:functions (f ?x - (either a b)) - number (g) - number (h) - number)
              (:action act
                :parameters (?x - (either a b))
                :precondition (exists (?y - (either b c) ?z) (p ?x ?y))))
        "#]],
    );
}

#[test]
fn conditions_have_every_form() {
    check(
        "(define (domain d) (:action a :parameters (?x ?y)
           :precondition (and (p) (p ?x k) (= ?x ?y) (not (= ?x k)) (or (p) (not (p)))
             (imply (p) (q)) (forall (?z - t) (p ?z)) (exists () (p)) (and) (or) ()
             (< (f ?x) 1) (<= (f ?x) -1.50) (= (f) (g ?x)) (= 2 f) (>= f (+ 1 2 3)) (> (- (f)) (- f .5))
             (= (* 2 (/ f 4)) 1e3))))",
        expect![[r#"
            (define (domain d)
              (:action a
                :parameters (?x ?y)
                :precondition (and
                  (p)
                  (p ?x k)
                  (= ?x ?y)
                  (not (= ?x k))
                  (or (p) (not (p)))
                  (imply (p) (q))
                  (forall (?z - t) (p ?z))
                  (exists () (p))
                  (and)
                  (or)
                  (and)
                  (< (f ?x) 1)
                  (<= (f ?x) -1.5)
                  (= (f) (g ?x))
                  (= 2 (f))
                  (>= (f) (+ 1 2 3))
                  (> (- (f)) (- (f) 0.5))
                  (= (* 2 (/ (f) 4)) 1000))))
        "#]],
    );
}

#[test]
fn effects_have_every_form() {
    check(
        "(define (domain d) (:action a :effect (and (p) (not (p)) (and) ()
           (forall (?x - t) (when (p ?x) (and (q ?x) (not (p ?x)))))
           (assign (f) 1) (increase total-cost (f)) (decrease (f) 2) (scale-up (f) 2) (scale-down (f) 2))))",
        expect![[r#"
            (define (domain d)
              (:action a
                :parameters ()
                :effect (and
                  (p)
                  (not (p))
                  (and)
                  (and)
                  (forall (?x - t) (when (p ?x) (and (q ?x) (not (p ?x)))))
                  (assign (f) 1)
                  (increase (total-cost) (f))
                  (decrease (f) 2)
                  (scale-up (f) 2)
                  (scale-down (f) 2))))
        "#]],
    );
}

#[test]
fn axioms_and_empty_actions_are_parsed() {
    check(
        "(define (domain d) (:derived (reach ?a ?b - l) (or (= ?a ?b) (exists (?c - l) (reach ?a ?c))))
           (:action idle :parameters () :precondition () :effect ()) (:action bare))",
        expect![[r#"
            (define (domain d)
              (:derived (reach ?a ?b - l)
                (or (= ?a ?b) (exists (?c - l) (reach ?a ?c))))
              (:action idle
                :parameters ())
              (:action bare
                :parameters ()))
        "#]],
    );
}

#[test]
fn durative_actions_keep_their_times() {
    check(
        "(define (domain d) (:durative-action fly :parameters (?p - plane)
           :duration (and (>= ?duration 1) (at start (<= ?duration (f ?p))))
           :condition (and (at start (at ?p)) (forall (?x - t) (and (over all (ok ?x)) (at end (p)))))
           :effect (and (at start (not (at ?p))) (at end (at ?p)) (increase (f ?p) (* #t 2))
             (forall (?x - t) (when (at start (p)) (at end (q ?x)))) (at end (increase (g) ?duration))))
           (:durative-action wait :duration (= ?duration 1) :condition () :effect ()))",
        expect![[r#"
            (define (domain d)
              (:durative-action fly
                :parameters (?p - plane)
                :duration (and (>= ?duration 1) (at start (<= ?duration (f ?p))))
                :condition (and
                  (at start (at ?p))
                  (forall (?x - t) (over all (ok ?x)))
                  (forall (?x - t) (at end (p))))
                :effect (and
                  (at start (not (at ?p)))
                  (at end (at ?p))
                  (increase (f ?p) (* #t 2))
                  (forall (?x - t) (when (at start (p)) (at end (q ?x))))
                  (at end (increase (g) ?duration))))
              (:durative-action wait
                :parameters ()
                :duration (= ?duration 1)
                :condition ()
                :effect (and)))
        "#]],
    );
}

#[test]
fn facts_may_be_negative_numeric_and_timed() {
    check(
        "(define (problem p) (:domain d) (:init (at home 5) (not (p a)) (= (f a) -2.50) (= g 1e2)
           (at 5 (open)) (at 7.5 (not (open))) (at 9 (= (f a) 3)))
           (:metric maximize (- (* 2 total-time) (f a))))",
        expect![[r#"
            (define (problem p)
              (:domain d)
              (:init
                (at home 5)
                (not (p a))
                (= (f a) -2.5)
                (= (g) 100)
                (at 5 (open))
                (at 7.5 (not (open)))
                (at 9 (= (f a) 3)))
              (:goal (and))
              (:metric maximize (- (* 2 (total-time)) (f a))))
        "#]],
    );
}

#[test]
fn a_model_declares_names_and_actions_of_an_agent() {
    check(
        "(define (agent turtlebot-1) (:domain smart-office) (:requirements :typing :multi-agent)
           (:types turtlebot - mobile-base) (:predicates (open) (:private (docked ?r - turtlebot)))
           (:functions (speed ?r - turtlebot) - number) (:objects turtlebot-1 - turtlebot)
           (:init (at turtlebot-1 corridor) (= (speed turtlebot-1) 0.3))
           (:action move :agent ?r - turtlebot :parameters (?from ?to - location)
             :precondition (and (at ?r ?from) (connected ?from ?to))
             :effect (and (not (at ?r ?from)) (at ?r ?to)
               (increase (total-cost) (distance ?from ?to)))))",
        expect![[r#"
            (define (agent turtlebot-1)
              (:domain smart-office)
              (:requirements :typing :multi-agent)
              (:types turtlebot - mobile-base)
              (:predicates (open) (:private (docked ?r - turtlebot)))
              (:functions (speed ?r - turtlebot) - number)
              (:objects turtlebot-1 - turtlebot)
              (:init (at turtlebot-1 corridor) (= (speed turtlebot-1) 0.3))
              (:action move
                :agent ?r - turtlebot
                :parameters (?from ?to - location)
                :precondition (and (at ?r ?from) (connected ?from ?to))
                :effect (and (not (at ?r ?from)) (at ?r ?to) (increase (total-cost) (distance ?from ?to)))))
        "#]],
    );
}

#[test]
fn several_agents_act_in_one_action() {
    check(
        "(define (domain d) (:predicates (p)) (:action a :agent (?x ?y - t ?z) :effect (p))
           (:action b :agent (?x - t) :effect (p)) (:action c :agent (?x ?y) :effect (p)))",
        expect![[r#"
            (define (domain d)
              (:predicates (p))
              (:action a
                :agent (?x ?y - t ?z)
                :parameters ()
                :effect (p))
              (:action b
                :agent ?x - t
                :parameters ()
                :effect (p))
              (:action c
                :agent (?x ?y)
                :parameters ()
                :effect (p)))
        "#]],
    );
}

#[test]
fn unfactored_private_sections_name_an_owner() {
    check(
        "(define (domain d) (:requirements :unfactored-privacy) (:predicates (p)
           (:private ?a - driver (driving ?a - driver ?t) (rested ?a)) (:private ?t (empty ?t))))",
        expect![[r#"
            (define (domain d)
              (:requirements :unfactored-privacy)
              (:predicates
                (p)
                (:private ?a - driver (driving ?a - driver ?t) (rested ?a))
                (:private ?t (empty ?t))))
        "#]],
    );
    check(
        "(define (problem p) (:domain d) (:objects depot0 - depot t - truck
           (:private depot0 hoist0 hoist1 - hoist) (:private driver1 driver1 - driver)))",
        expect![[r#"
            (define (problem p)
              (:domain d)
              (:objects
                depot0 - depot
                t - truck
                (:private depot0 hoist0 hoist1 - hoist)
                (:private driver1 driver1 - driver))
              (:goal (and)))
        "#]],
    );
}

#[test]
fn factored_private_sections_name_no_owner() {
    check(
        "(define (problem p) (:domain d) (:objects depot0 - depot (:private hoist0 hoist1 - hoist)))",
        expect![[r#"
            (define (problem p)
              (:domain d)
              (:objects depot0 - depot (:private hoist0 - hoist hoist1 - hoist))
              (:goal (and)))
        "#]],
    );
}

/// Parses a plan and prints it.
#[track_caller]
fn check_plan(text: &str, expected: Expect) {
    let plan = pddl::parse_plan(text).into_result();
    expected.assert_eq(&plan.map(|plan| plan.to_string()).unwrap_or_else(|it| format!("{it:?}")));
}

#[test]
fn plans_have_costs_times_and_durations() {
    check_plan(
        "(move a b)\n\n(READ a)\n; cost = 3 (general cost)\n",
        expect![[r#"
        (move a b)
        (READ a)
        ; cost = 3
    "#]],
    );
    check_plan(
        "; Plan cost: 7.5\n(a)",
        expect![[r#"
            (a)
            ; cost = 7.5
        "#]],
    );
    check_plan(
        "0.0: (a b) [1.000]\n1.001:(c)",
        expect![[r#"
        0: (a b) [1]
        1.001: (c)
    "#]],
    );
    check_plan("", expect![[r#""#]]);
}

/// Prints the result of parsing a part of a file, or the first diagnostic.
#[track_caller]
fn check_part<T: std::fmt::Display>(parsed: pddl::Parsed<T>, expected: Expect) {
    let value = parsed.into_result().map(|value| value.to_string());
    expected.assert_eq(&value.unwrap_or_else(|diagnostics| diagnostics[0].to_string()));
}

#[test]
fn parts_are_parsed_alone() {
    check_part(
        pddl::parse_condition("; now\n(forall (?r - room) (known-temperature ?r))"),
        expect!["(forall (?r - room) (known-temperature ?r))"],
    );
    check_part(pddl::parse_init_element("(= (distance a b) 2)"), expect!["(= (distance a b) 2)"]);
    check_part(
        pddl::parse_step("(Move turtlebot-1 corridor office1)"),
        expect!["(Move turtlebot-1 corridor office1)"],
    );
    check_part(pddl::parse_condition(""), expect!["error: the text holds no condition"]);
    check_part(
        pddl::parse_condition("(p) (q)"),
        expect!["error: one condition is expected, `(q)` is more"],
    );
    let facts = pddl::parse_init_elements("(p a) (not (q)) (= f 1)").into_result();
    assert_eq!(facts.map(|facts| facts.len()), Ok(3));
}

#[test]
fn bytes_that_are_not_utf8_are_read_as_latin_1() {
    assert_eq!(pddl::text_from_bytes(b"; Thi\xe9baux\n(p)"), "; Thiébaux\n(p)");
    assert_eq!(pddl::text_from_bytes("; Thiébaux".as_bytes()), "; Thiébaux");
    check_part(pddl::parse_condition("\u{feff}(p)"), expect!["(p)"]);
}

#[test]
fn a_list_that_touches_a_number_is_an_operand_of_its_own() {
    for (expression, printed) in [("(+ 1(f))", "(+ 1 (f))"), ("(- 0(f))", "(- 0 (f))")] {
        let condition = pddl::parse_condition(&format!("(< {expression} 5)"));
        assert_eq!(condition.into_result().expect("valid").to_string(), format!("(< {printed} 5)"));
    }
    let three =
        pddl::parse_condition("(< (- 0(f) 1) 5)").into_result().expect_err("three operands");
    assert_eq!(three[0].message, "wrong number of operands: 3");
}
