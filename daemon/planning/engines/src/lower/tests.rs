//! Tests of the translation of tasks to the engines' dialects.

use expect_test::{Expect, expect};

use super::{Dialect, lower};

const FAST_DOWNWARD: Dialect = Dialect::FAST_DOWNWARD;
const METRIC_FF: Dialect = Dialect::METRIC_FF;

/// Translates a domain and a problem with these sections to a dialect. Compares both resulting
/// texts, or the refusal and its place, with `expected`.
#[track_caller]
fn check(dialect: Dialect, domain: &str, problem: &str, expected: Expect) {
    let domain_text = format!("(define (domain x) {domain})");
    let problem_text = format!("(define (problem y) (:domain x) {problem})");
    let domain = pddl::parse_domain(&domain_text);
    let problem = pddl::parse_problem(&problem_text);
    assert!(domain.is_ok(), "{:?}", domain.diagnostics);
    assert!(problem.is_ok(), "{:?}", problem.diagnostics);
    let domain = domain.value.expect("a domain");
    let problem = problem.value.expect("a problem");
    let mistakes = [pddl::check_domain(&domain), pddl::check_problem(&domain, &problem)].concat();
    assert!(!mistakes.iter().any(pddl::Diagnostic::is_error), "{mistakes:?}");
    let text = match lower(&domain, &problem, dialect) {
        Ok(lowered) => {
            let rounded = if lowered.costs_exact { "" } else { "; rounded" };
            format!("{}{}{rounded}", lowered.domain, lowered.problem)
        }
        Err(unsupported) => {
            let is_domain = unsupported.text == planner::InputText::Domain;
            let source = if is_domain { &domain_text } else { &problem_text };
            let place = source.get(unsupported.span.range()).unwrap_or("?");
            format!("unsupported: {}\nat {place}\n", unsupported.feature)
        }
    };
    expected.assert_eq(&text);
}

#[test]
fn names_become_readable_and_stay_unique() {
    check(
        FAST_DOWNWARD,
        "(:requirements :strips :typing :multi-agent) (:types Büro@2 a)
         (:predicates (a ?x - a) (when/now ?x) (not-a))
         (:action move :parameters (?x - a ?and - Büro@2) :precondition (a ?x) :effect (when/now ?and))",
        "(:objects and b.c B/C - Büro@2 ÄÖ äü - a) (:init (a ÄÖ) (a äö) (not (not-a)))
         (:goal (when/now b/c))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:types t-b-ro-2 t-a - object)
              (:predicates (p-a ?x1) (p-when-now ?x1) (p-not-a))
              (:action a-move
                :parameters (?v-x - t-a ?v-and - t-b-ro-2)
                :precondition (p-a ?v-x)
                :effect (and (p-when-now ?v-and))))
            (define (problem p)
              (:domain d)
              (:objects o-and o-b-c o-b-c-2 - t-b-ro-2 o--- o----2 - t-a)
              (:init (p-a o---))
              (:goal (p-when-now o-b-c-2)))
        "#]],
    );
}

#[test]
fn agents_become_parameters_and_privacy_is_gone() {
    check(
        FAST_DOWNWARD,
        "(:types robot room - object) (:predicates (:private (docked ?r - robot)) (in ?r - robot ?x - room))
         (:action enter :agent ?r - robot :parameters (?x - room)
           :precondition (not (docked ?r)) :effect (in ?r ?x))",
        "(:objects lab - room (:private r1 - robot)) (:init) (:goal (in r1 lab))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:types t-robot t-room - object)
              (:predicates (p-docked ?x1) (p-in ?x1 ?x2))
              (:action a-enter
                :parameters (?v-r - t-robot ?v-x - t-room)
                :precondition (not (p-docked ?v-r))
                :effect (and (p-in ?v-r ?v-x))))
            (define (problem p)
              (:domain d)
              (:objects o-lab - t-room o-r1 - t-robot)
              (:init)
              (:goal (p-in o-r1 o-lab)))
        "#]],
    );
}

#[test]
fn either_becomes_a_predicate() {
    check(
        FAST_DOWNWARD,
        "(:types a b c - object) (:constants k - a) (:predicates (p ?x - (either a b)) (q ?x))
         (:derived (q ?x - (either a b)) (p ?x))
         (:action go :parameters (?x - (either a b)) :effect (forall (?y - (either b c)) (p ?y)))
         (:action all :parameters () :precondition (forall (?x - (either b c)) (p ?x)) :effect (p k))",
        "(:objects x - a y - b z - c) (:init) (:goal (exists (?o - (either a b)) (p ?o)))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:types t-a t-b t-c - object)
              (:constants o-k - t-a)
              (:predicates (p-p ?x1) (p-q ?x1) (p-is-1 ?x1) (p-is-2 ?x1))
              (:derived (p-q ?v-x - object)
                (and (p-is-1 ?v-x) (p-p ?v-x)))
              (:action a-go
                :parameters (?v-x - object)
                :precondition (and (p-is-1 ?v-x))
                :effect (and (forall (?v-y - object) (when (and (p-is-2 ?v-y)) (p-p ?v-y)))))
              (:action a-all
                :parameters ()
                :precondition (forall (?v-x - object) (imply (and (p-is-2 ?v-x)) (p-p ?v-x)))
                :effect (and (p-p o-k))))
            (define (problem p)
              (:domain d)
              (:objects o-x - t-a o-y - t-b o-z - t-c)
              (:init (p-is-1 o-k) (p-is-1 o-x) (p-is-1 o-y) (p-is-2 o-y) (p-is-2 o-z))
              (:goal (exists (?v-o - object) (and (p-is-1 ?v-o) (p-p ?v-o)))))
        "#]],
    );
}

#[test]
fn several_supertypes_make_predicates_of_all_types() {
    check(
        METRIC_FF,
        "(:types a b - object c - (either a b)) (:predicates (p ?x - b))
         (:action go :parameters (?x - b) :effect (p ?x))",
        "(:objects x - a y - c) (:init) (:goal (p y))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :fluents)
              (:predicates (p-p ?x1) (p-is-1 ?x1))
              (:action a-go
                :parameters (?v-x - object)
                :precondition (and (p-is-1 ?v-x))
                :effect (and (p-p ?v-x))))
            (define (problem p)
              (:domain d)
              (:objects o-x o-y - object)
              (:init (p-is-1 o-y))
              (:goal (p-p o-y)))
        "#]],
    );
}

#[test]
fn several_costs_become_one_and_fractions_become_integers() {
    check(
        FAST_DOWNWARD,
        "(:types room) (:constants hall - room) (:predicates (at ?x - room))
         (:functions (total-cost) (distance ?x ?y - room) (toll ?x - room))
         (:action go :parameters (?x ?y - room) :precondition (at ?x)
           :effect (and (at ?y) (not (at ?x)) (increase (total-cost) (* 2 (distance ?x ?y)))
                        (increase (total-cost) (toll ?y))))
         (:action rest :parameters () :effect (and (at hall) (increase (total-cost) 0.25)))
         (:action sing :parameters () :effect (and (at hall)))",
        "(:objects a b - room)
         (:init (at a) (= (distance a b) 1.5) (= (distance b a) 2) (= (toll b) 1) (= (toll a) 0))
         (:goal (at b)) (:metric minimize (total-cost))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:types t-room - object)
              (:constants o-hall - t-room)
              (:predicates (p-at ?x1))
              (:functions (f-cost-1 ?x1 ?x2) - number (total-cost) - number)
              (:action a-go
                :parameters (?v-x ?v-y - t-room)
                :precondition (p-at ?v-x)
                :effect (and (p-at ?v-y) (not (p-at ?v-x)) (increase (total-cost) (f-cost-1 ?v-x ?v-y))))
              (:action a-rest
                :parameters ()
                :effect (and (p-at o-hall) (increase (total-cost) 25)))
              (:action a-sing
                :parameters ()
                :effect (and (p-at o-hall) (increase (total-cost) 0))))
            (define (problem p)
              (:domain d)
              (:objects o-a o-b - t-room)
              (:init (p-at o-a) (= (f-cost-1 o-a o-b) 400) (= (f-cost-1 o-b o-a) 400) (= (total-cost) 0))
              (:goal (p-at o-b))
              (:metric minimize (total-cost)))
        "#]],
    );
}

#[test]
fn a_weighted_sum_becomes_total_cost() {
    check(
        FAST_DOWNWARD,
        "(:predicates (q)) (:functions (time) (money))
         (:action drive :effect (and (q) (increase (time) 2) (increase (money) 3)))
         (:action walk :effect (and (q) (increase (time) 5)))",
        "(:init (= (time) 0) (= (money) 0)) (:goal (q)) (:metric minimize (+ (* 3 (time)) (money)))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:predicates (p-q) (p-has-money) (p-has-time))
              (:functions (total-cost) - number)
              (:action a-drive
                :parameters ()
                :precondition (and (p-has-time) (p-has-money))
                :effect (and (p-q) (increase (total-cost) 9)))
              (:action a-walk
                :parameters ()
                :precondition (and (p-has-time))
                :effect (and (p-q) (increase (total-cost) 15))))
            (define (problem p)
              (:domain d)
              (:init (p-has-money) (p-has-time) (= (total-cost) 0))
              (:goal (p-q))
              (:metric minimize (total-cost)))
        "#]],
    );
}

#[test]
fn without_a_metric_numbers_only_decide_applicability() {
    check(
        FAST_DOWNWARD,
        "(:predicates (at ?x) (known ?x))
         (:functions (total-cost) (distance ?x ?y) (temperature ?x) (count))
         (:action go :parameters (?x ?y) :precondition (at ?x)
           :effect (and (at ?y) (increase (total-cost) (distance ?x ?y)) (increase (count) 1)))
         (:action read :parameters (?x) :effect (and (known ?x) (assign (temperature ?x) 20)))
         (:action look :parameters (?x))",
        "(:objects a b) (:init (at a) (= (distance a b) 2)) (:goal (and (at b) (known b)))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:predicates (p-at ?x1) (p-known ?x1) (p-has-count) (p-has-distance ?x1 ?x2))
              (:action a-go
                :parameters (?v-x ?v-y - object)
                :precondition (and (p-at ?v-x) (p-has-distance ?v-x ?v-y) (p-has-count))
                :effect (and (p-at ?v-y)))
              (:action a-read
                :parameters (?v-x - object)
                :effect (and (p-known ?v-x))))
            (define (problem p)
              (:domain d)
              (:objects o-a o-b - object)
              (:init (p-at o-a) (p-has-distance o-a o-b))
              (:goal (and (p-at o-b) (p-known o-b))))
        "#]],
    );
}

#[test]
fn costs_finer_than_the_scale_are_rounded() {
    check(
        FAST_DOWNWARD,
        "(:predicates (q)) (:functions (total-cost))
         (:action go :effect (and (q) (increase (total-cost) (/ 1 3))))
         (:action run :effect (and (q) (increase (total-cost) 2)))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:predicates (p-q))
              (:functions (total-cost) - number)
              (:action a-go
                :parameters ()
                :effect (and (p-q) (increase (total-cost) 166667)))
              (:action a-run
                :parameters ()
                :effect (and (p-q) (increase (total-cost) 1000000))))
            (define (problem p)
              (:domain d)
              (:init (= (total-cost) 0))
              (:goal (p-q))
              (:metric minimize (total-cost)))
            ; rounded"#]],
    );
}

#[test]
fn variables_are_unique_and_conditional_effects_are_not_nested() {
    check(
        FAST_DOWNWARD,
        "(:predicates (p ?x) (q ?x))
         (:action go :parameters (?x)
           :precondition (and (p ?x) (exists (?x) (and (q ?x) (forall () (p ?x)))) (not (q ?x)))
           :effect (when (p ?x) (and (q ?x) (forall (?x) (when (q ?x) (not (p ?x))))
                                     (when (q ?x) (p ?x)))))",
        "(:objects a) (:init (p a) (p a)) (:goal ())",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :derived-predicates :action-costs)
              (:predicates (p-p ?x1) (p-q ?x1))
              (:action a-go
                :parameters (?v-x - object)
                :precondition (and
                  (p-p ?v-x)
                  (exists (?v-x-2 - object) (and (p-q ?v-x-2) (p-p ?v-x-2)))
                  (not (p-q ?v-x)))
                :effect (and
                  (when (p-p ?v-x) (p-q ?v-x))
                  (forall (?v-x-3 - object) (when (and (p-p ?v-x) (p-q ?v-x-3)) (not (p-p ?v-x-3))))
                  (when (and (p-p ?v-x) (p-q ?v-x)) (p-p ?v-x)))))
            (define (problem p)
              (:domain d)
              (:objects o-a - object)
              (:init (p-p o-a))
              (:goal (and)))
        "#]],
    );
}

#[test]
fn metric_ff_keeps_numbers() {
    check(
        METRIC_FF,
        "(:predicates (at ?x)) (:functions (fuel) (length ?x ?y) (total-cost))
         (:action drive :parameters (?x ?y)
           :precondition (and (at ?x) (>= (fuel) (+ 1 (length ?x ?y) 2)))
           :effect (and (at ?y) (not (at ?x)) (decrease (fuel) (length ?x ?y))
                        (and (increase (total-cost) 1) (increase (total-cost) (length ?x ?y))
                             (decrease (total-cost) (- 2)))))",
        "(:objects a b) (:init (at a) (= (fuel) 9) (= (length a b) 3.5)) (:goal (at b))
         (:metric minimize (+ (total-cost) (fuel)))",
        expect![[r#"
            (define (domain d)
              (:requirements :adl :fluents)
              (:predicates (p-at ?x1))
              (:functions (f-fuel) - number (f-length ?x1 ?x2) - number (total-cost) - number)
              (:action a-drive
                :parameters (?v-x ?v-y - object)
                :precondition (and (p-at ?v-x) (>= (f-fuel) (+ (+ 1 (f-length ?v-x ?v-y)) 2)))
                :effect (and
                  (p-at ?v-y)
                  (not (p-at ?v-x))
                  (decrease (f-fuel) (f-length ?v-x ?v-y))
                  (increase (total-cost) (- (+ 1 (f-length ?v-x ?v-y)) (- 0 2))))))
            (define (problem p)
              (:domain d)
              (:objects o-a o-b - object)
              (:init (p-at o-a) (= (f-fuel) 9) (= (f-length o-a o-b) 3.5) (= (total-cost) 0))
              (:goal (p-at o-b))
              (:metric minimize (+ (total-cost) (f-fuel))))
        "#]],
    );
}

#[test]
fn tasks_beyond_fast_downward_are_rejected() {
    let refused = |domain: &str, problem: &str, expected| {
        check(FAST_DOWNWARD, domain, problem, expected);
    };
    refused(
        "(:predicates (p)) (:functions (fuel))
         (:action go :precondition (>= (fuel) 1) :effect (and (p) (decrease (fuel) 1)))",
        "(:init (= (fuel) 3)) (:goal (p))",
        expect![[r#"
            unsupported: a numeric condition
            at (>= (fuel) 1)
        "#]],
    );
    refused(
        "(:predicates (p)) (:functions (fuel)) (:action go :effect (decrease (fuel) 1))",
        "(:init (= (fuel) 3)) (:goal (< (fuel) 1))",
        expect![[r#"
            unsupported: a numeric condition
            at (< (fuel) 1)
        "#]],
    );
    refused(
        "(:predicates (p) (q)) (:functions (total-cost))
         (:action go :effect (and (q) (when (p) (increase (total-cost) 2))))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            unsupported: a conditional change of `total-cost`, which the metric counts
            at (increase (total-cost) 2)
        "#]],
    );
    refused(
        "(:predicates (q)) (:functions (total-cost) (load))
         (:action load :effect (increase (load) 1))
         (:action go :effect (and (q) (increase (total-cost) (load))))",
        "(:init (= (load) 0)) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            unsupported: a state-dependent change of `total-cost`, which the metric counts
            at (increase (total-cost) (load))
        "#]],
    );
    refused(
        "(:predicates (q)) (:functions (total-cost))
         (:action earn :effect (and (q) (decrease (total-cost) 3)))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            unsupported: a negative cost of `earn`
            at (:action earn :effect (and (q) (decrease (total-cost) 3)))
        "#]],
    );
    refused(
        "(:predicates (q)) (:functions (spent ?x))
         (:action go :parameters (?x) :effect (and (q) (increase (spent ?x) 3)))",
        "(:objects a b) (:init) (:goal (q)) (:metric minimize (+ (spent a) (spent b)))",
        expect![[r#"
            unsupported: a metric over `(spent a)`, one of several
            at (:metric minimize (+ (spent a) (spent b)))
        "#]],
    );
    refused(
        "(:predicates (q)) (:functions (load) (last))
         (:action go :effect (and (q) (assign (last) (load))))
         (:action set :effect (and (q) (assign (load) 3)))",
        "(:init) (:goal (q))",
        expect![[r#"
            unsupported: the number `last`, which changes
            at (assign (last) (load))
        "#]],
    );
    refused(
        "(:predicates (p)) (:durative-action wait :parameters () :duration (= ?duration 5)
           :condition () :effect (at end (p)))",
        "(:init) (:goal (p))",
        expect![[r#"
            unsupported: durative actions
            at (:durative-action wait :parameters () :duration (= ?duration 5)
                       :condition () :effect (at end (p)))
        "#]],
    );
    refused(
        "(:predicates (p))",
        "(:init (at 5 (p))) (:goal (p))",
        expect![[r#"
        unsupported: timed initial literals
        at (p)
    "#]],
    );
}

#[test]
fn tasks_beyond_metric_ff_are_rejected() {
    let refused = |domain: &str, problem: &str, expected| {
        check(METRIC_FF, domain, problem, expected);
    };
    refused(
        "(:predicates (p) (q)) (:derived (p) (q)) (:action go :effect (q))",
        "(:init) (:goal (p))",
        expect![[r#"
            unsupported: derived predicates
            at (:derived (p) (q))
        "#]],
    );
    refused(
        "(:predicates (p)) (:functions (a) (b))
         (:action go :precondition (> (* (a) (b)) 4) :effect (and (p) (increase (a) (b))))
         (:action come :effect (increase (b) 1))",
        "(:init (= (a) 1) (= (b) 1)) (:goal (p))",
        expect![[r#"
            unsupported: arithmetic that is not linear
            at (> (* (a) (b)) 4)
        "#]],
    );
    refused(
        "(:predicates (p)) (:functions (a)) (:action go :effect (and (p) (scale-up (a) 2)))",
        "(:init (= (a) 1)) (:goal (p))",
        expect![[r#"
            unsupported: scaling effects
            at (scale-up (a) 2)
        "#]],
    );
    refused(
        "(:predicates (p ?a ?b ?c ?d ?e ?f))
         (:action go :parameters (?x) :effect (p ?x ?x ?x ?x ?x ?x))",
        "(:objects a) (:init) (:goal (p a a a a a a))",
        expect![[r#"
            unsupported: more than 5 parameters in one signature
            at p
        "#]],
    );
    let many: String = (1..=51).map(|index| format!("(p{index})")).collect();
    refused(
        &format!("(:predicates {many}) (:action go :effect (p1))"),
        "(:init) (:goal (p1))",
        expect![[r#"
            unsupported: more than 50 predicates
            at p51
        "#]],
    );
    let many: String = (1..=2001).map(|index| format!("o{index} ")).collect();
    refused(
        "(:predicates (p)) (:action go :effect (p))",
        &format!("(:objects {many}) (:init) (:goal (p))"),
        expect![[r#"
            unsupported: more than 2000 objects
            at o2001
        "#]],
    );
}

#[test]
fn plans_use_the_authors_names() {
    let domain = "(define (domain x) (:predicates (in ?r)) (:action Enter :parameters (?r)
        :effect (in ?r)) (:action enter :parameters (?r ?s) :effect (in ?r)))";
    let problem =
        "(define (problem y) (:domain x) (:objects Büro@2 büro/2) (:init) (:goal (in Büro@2)))";
    let domain = pddl::parse_domain(domain).value.expect("a domain");
    let problem = pddl::parse_problem(problem).value.expect("a problem");
    let names = lower(&domain, &problem, METRIC_FF).expect("nothing special").names;
    let raise = |text: &str| {
        let plan = pddl::parse_plan(text).value.expect("a plan");
        names.restore_names(plan).map(|plan| plan.to_string())
    };
    let plan =
        raise("(A-ENTER O-B-RO-2)\n(a-enter-2 o-b-ro-2 o-b-ro-2-2)\n; cost = 7").expect("names");
    assert_eq!(plan, "(Enter Büro@2)\n(enter Büro@2 büro/2)\n");
    assert_eq!(raise("(a-leave)"), Err("a-leave".to_owned()));
}
