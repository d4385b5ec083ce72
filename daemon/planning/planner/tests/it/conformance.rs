//! Conformance to PDDL, case by case, in cases where other planners reject the text, guess or give
//! a wrong result.

use expect_test::{Expect, expect};

use crate::support::{self, check};

/// Checks the result for a domain and a problem, given by their parts.
#[track_caller]
fn case(domain: &str, problem: &str, expected: Expect) {
    check(&support::domain(domain), &support::problem(problem), expected);
}

#[test]
fn either_in_parameters_quantifiers_and_predicates() {
    case(
        "(:requirements :adl) (:types a b c) (:predicates (p ?x - (either a b)) (q ?x))
         (:action go :parameters (?x - (either a b)) :effect (p ?x))
         (:action mark :parameters (?x) :precondition (exists (?y - (either b c)) (= ?x ?y))
           :effect (q ?x))",
        "(:objects x - a y - b z - c) (:init)
         (:goal (and (forall (?o - (either a b)) (p ?o)) (q z)))",
        expect![[r#"
            (go x)
            (go y)
            (mark z)
            cost 3, optimal
        "#]],
    );
}

#[test]
fn a_conditional_cost_counts_and_allows_no_proof() {
    case(
        "(:predicates (p) (q)) (:functions (total-cost))
         (:action go :effect (and (q) (when (p) (increase (total-cost) 2))))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (go)
            cost 0, unproven
        "#]],
    );
}

#[test]
fn several_costs_of_one_action_add_up() {
    case(
        "(:predicates (q)) (:functions (total-cost) (toll ?x)) (:constants a)
         (:action go :effect (and (q) (increase (total-cost) 5) (increase (total-cost) (toll a))))",
        "(:init (= (toll a) 7)) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (go)
            cost 12, optimal
        "#]],
    );
}

#[test]
fn fractional_costs_are_kept_and_compared() {
    case(
        "(:predicates (q) (r)) (:functions (total-cost))
         (:action dear :effect (and (q) (increase (total-cost) 0.7)))
         (:action half :effect (and (r) (increase (total-cost) 0.3)))
         (:action rest :precondition (r) :effect (and (q) (increase (total-cost) 0.35)))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (half)
            (rest)
            cost 0.65, optimal
        "#]],
    );
}

#[test]
fn negative_costs_are_supported_without_a_proof() {
    case(
        "(:predicates (q)) (:functions (total-cost))
         (:action earn :effect (and (q) (decrease (total-cost) 3)))",
        "(:init) (:goal (q)) (:metric minimize (total-cost))",
        expect![[r#"
            (earn)
            cost -3, unproven
        "#]],
    );
}

#[test]
fn an_undefined_cost_is_reported_and_its_action_never_applies() {
    case(
        "(:predicates (at ?x)) (:functions (total-cost) (distance ?x ?y))
         (:action go :parameters (?x ?y) :precondition (at ?x)
           :effect (and (not (at ?x)) (at ?y) (increase (total-cost) (distance ?x ?y))))",
        "(:objects a b c) (:init (at a) (= (distance a b) 1) (= (distance b c) 1))
         (:goal (at c)) (:metric minimize (total-cost))",
        expect![[r#"
            warning: some instances of `go` never apply: they use a function value that :init leaves out
            (go a b)
            (go b c)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn the_metric_may_be_a_weighted_sum() {
    case(
        "(:predicates (q)) (:functions (time) (money))
         (:action drive :effect (and (q) (increase (time) 2) (increase (money) 3)))
         (:action walk :effect (and (q) (increase (time) 5) (increase (money) 0)))",
        "(:init (= (time) 0) (= (money) 0)) (:goal (q))
         (:metric minimize (+ (* 3 (time)) (money)))",
        expect![[r#"
            (drive)
            cost 9, optimal
        "#]],
    );
}

#[test]
fn a_nonlinear_metric_ranks_plans_without_a_proof() {
    case(
        "(:predicates (q)) (:functions (time)) (:action go :effect (and (q) (increase (time) 2)))",
        "(:init (= (time) 0)) (:goal (q)) (:metric minimize (* (time) (time)))",
        expect![[r#"
            (go)
            cost 4, unproven
        "#]],
    );
}

#[test]
fn without_a_metric_the_steps_are_counted() {
    case(
        "(:predicates (q) (r)) (:functions (total-cost))
         (:action dear :effect (and (q) (increase (total-cost) 9)))
         (:action half :effect (and (r) (increase (total-cost) 1)))
         (:action rest :precondition (r) :effect (and (q) (increase (total-cost) 1)))",
        "(:init) (:goal (q))",
        expect![[r#"
            (dear)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn zero_cost_steps_are_not_added_needlessly() {
    case(
        "(:predicates (at ?x) (next ?x ?y)) (:functions (total-cost))
         (:action go :parameters (?x ?y) :precondition (and (at ?x) (next ?x ?y))
           :effect (and (not (at ?x)) (at ?y) (increase (total-cost) 0)))",
        "(:objects a b c d) (:init (at a) (next a b) (next b c) (next c d) (next b d) (next c a))
         (:goal (at d)) (:metric minimize (total-cost))",
        expect![[r#"
            (go a b)
            (go b d)
            cost 0, optimal
        "#]],
    );
}

#[test]
fn an_action_without_effect_is_accepted() {
    case(
        "(:predicates (q)) (:action look :parameters (?x)) (:action wait :effect ())
         (:action go :effect (q))",
        "(:objects a) (:init) (:goal (q))",
        expect![[r#"
            (go)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn an_empty_goal_needs_no_steps() {
    case(
        "(:predicates (q))",
        "(:init) (:goal (and))",
        expect![[r#"
        cost 0, optimal
    "#]],
    );
    case(
        "(:predicates (q))",
        "(:init) (:goal ())",
        expect![[r#"
        cost 0, optimal
    "#]],
    );
}

#[test]
fn sections_may_be_in_any_order() {
    case(
        "(:action go :effect (q)) (:predicates (q))",
        "(:metric minimize (total-time)) (:goal (q)) (:init)",
        expect![[r#"
            (go)
            cost 1, optimal
        "#]],
    );
    case(
        "(:action go :effect (q)) (:predicates (q)) (:functions (total-cost))",
        "(:metric minimize (total-cost)) (:goal (q)) (:init)",
        expect![[r#"
            (go)
            cost 0, optimal
        "#]],
    );
}

#[test]
fn negation_disjunction_implication_and_quantifiers_in_goals() {
    case(
        "(:predicates (p ?x) (q ?x) (r ?x))
         (:action drop :parameters (?x) :precondition (p ?x) :effect (not (p ?x)))
         (:action mark :parameters (?x) :precondition (not (p ?x)) :effect (q ?x))
         (:action rest :parameters (?x) :effect (r ?x))",
        "(:objects a b) (:init (p a) (p b))
         (:goal (and (not (p a)) (or (q b) (r b)) (imply (q a) (r a)) (exists (?x) (q ?x))
                     (forall (?x) (or (q ?x) (r ?x) (not (= ?x a))))))",
        expect![[r#"
            (drop a)
            (drop b)
            (mark b)
            (rest a)
            cost 4, optimal
        "#]],
    );
}

#[test]
fn large_disjunctions_stay_small() {
    case(
        "(:predicates (p ?x) (q ?x) (done))
         (:action left :parameters (?x) :effect (p ?x))
         (:action right :parameters (?x) :effect (q ?x))
         (:action finish :precondition (forall (?x) (or (p ?x) (q ?x))) :effect (done))",
        "(:objects a b c d e f) (:init (p a) (q b) (p c) (q d)) (:goal (done))",
        expect![[r#"
            (right e)
            (right f)
            (finish)
            cost 3, optimal
        "#]],
    );
}

#[test]
fn conditions_of_effects_use_the_state_before_the_action() {
    case(
        "(:predicates (p) (q)) (:action go :effect (and (p) (when (p) (q))))",
        "(:init) (:goal (q))",
        expect![[r#"
            (go)
            (go)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn a_fact_both_added_and_deleted_is_true() {
    case(
        "(:predicates (p ?x) (q)) (:action go :parameters (?x ?y)
           :effect (and (q) (not (p ?x)) (p ?y)))",
        "(:objects a) (:init (p a)) (:goal (and (q) (p a)))",
        expect![[r#"
            (go a a)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn a_conditional_add_that_does_not_happen_keeps_the_delete() {
    case(
        "(:predicates (p) (c) (q))
         (:action go :effect (and (q) (not (p)) (when (c) (p))))",
        "(:init (p)) (:goal (and (q) (p)))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
    case(
        "(:predicates (p) (c) (q))
         (:action go :effect (and (q) (when (q) (not (p))) (when (c) (p))))
         (:action allow :effect (c))",
        "(:init (p) (q)) (:goal (and (c) (q) (p)))",
        expect![[r#"
            (allow)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn universal_effects_include_constants_and_subtypes_and_allow_empty_types() {
    case(
        "(:types animal empty - object dog - animal) (:constants rex - dog)
         (:predicates (fed ?x - animal) (never) (always))
         (:action feed :effect (forall (?x - animal) (fed ?x)))
         (:action vacuous :precondition (forall (?x - empty) (never)) :effect (always))",
        "(:objects tom - animal) (:init)
         (:goal (and (fed rex) (fed tom) (always) (not (exists (?x - empty) (always)))))",
        expect![[r#"
            (feed)
            (vacuous)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn one_object_may_bind_two_parameters_unless_the_precondition_forbids_it() {
    case(
        "(:predicates (p ?x) (q ?x)) (:action both :parameters (?x ?y) :precondition (p ?x)
           :effect (q ?y))",
        "(:objects a) (:init (p a)) (:goal (q a))",
        expect![[r#"
            (both a a)
            cost 1, optimal
        "#]],
    );
    case(
        "(:predicates (p ?x) (q ?x)) (:action both :parameters (?x ?y)
           :precondition (and (p ?x) (not (= ?x ?y))) :effect (q ?y))",
        "(:objects a) (:init (p a)) (:goal (q a))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
}

#[test]
fn the_witness_of_an_existential_is_not_part_of_the_step() {
    case(
        "(:predicates (near ?x) (q)) (:action go :precondition (exists (?x) (near ?x)) :effect (q))",
        "(:objects a b c) (:init (near a) (near c)) (:goal (q))",
        expect![[r#"
            (go)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn names_keep_their_spelling_and_compare_without_case() {
    case(
        "(:predicates (Known ?x)) (:action Report :parameters (?X) :effect (KNOWN ?x))",
        "(:objects Office1) (:init) (:goal (known OFFICE1))",
        expect![[r#"
            (Report Office1)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn repeated_facts_and_explicit_negations_in_init() {
    case(
        "(:predicates (p) (q)) (:action go :precondition (p) :effect (q))",
        "(:init (p) (p) (not (q))) (:goal (q))",
        expect![[r#"
            (go)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn derived_predicates_support_recursion_negation_and_changes() {
    case(
        "(:requirements :derived-predicates)
         (:constants a b c d) (:predicates (link ?x ?y) (cut ?x ?y) (reach ?x ?y) (alone ?x) (done))
         (:derived (reach ?x ?y) (and (link ?x ?y) (not (cut ?x ?y))))
         (:derived (reach ?x ?y) (exists (?z) (and (reach ?x ?z) (reach ?z ?y))))
         (:derived (alone ?x) (not (exists (?y) (reach ?x ?y))))
         (:action cut-link :parameters (?x ?y) :precondition (link ?x ?y) :effect (cut ?x ?y))
         (:action celebrate :precondition (and (reach a c) (alone d)) :effect (done))
         ",
        "(:init (link a b) (link b c) (link d a)) (:goal (done))",
        expect![[r#"
            (cut-link d a)
            (celebrate)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn all_axioms_of_a_predicate_are_of_one_layer() {
    case(
        "(:requirements :derived-predicates)
         (:constants a e) (:predicates (b ?x) (c) (p ?x) (q ?x) (r ?x) (done))
         (:derived (q ?x) (b ?x))
         (:derived (p ?x) (= ?x a))
         (:derived (p ?x) (not (q ?x)))
         (:derived (r ?x) (p ?x))
         (:action go :effect (c))
         (:action win :parameters (?x) :precondition (and (r ?x) (q ?x) (c)) :effect (done))
         ",
        "(:init (b a) (b e)) (:goal (done))",
        expect![[r#"
            (go)
            (win a)
            cost 2, optimal
        "#]],
    );
}

#[test]
fn an_axiom_may_not_depend_on_its_own_negation() {
    case(
        "(:requirements :derived-predicates) (:predicates (p) (q)) (:derived (p) (not (q)))
         (:derived (q) (not (p)))",
        "(:init) (:goal (p))",
        expect![[r#"
            error: `p` is derived from `(not (q …))`, which depends on it; axioms must have layers: negate only what lies below
            error: `q` is derived from `(not (p …))`, which depends on it; axioms must have layers: negate only what lies below
        "#]],
    );
}

#[test]
fn a_derived_fact_may_not_be_an_effect() {
    case(
        "(:requirements :derived-predicates) (:predicates (p) (q)) (:derived (p) (q))
         (:action go :effect (p))",
        "(:init) (:goal (p))",
        expect![[r#"
            error: `p` is derived, no action can change it; change what it is derived from
        "#]],
    );
}

#[test]
fn temporal_features_are_rejected_by_name() {
    case(
        "(:predicates (p)) (:durative-action wait :parameters () :duration (= ?duration 5)
           :condition () :effect (at end (p)))",
        "(:init) (:goal (p))",
        expect![[r#"
            unsupported: durative actions
            at (:durative-action wait :parameters () :duration (= ?duration 5)
                       :condition () :effect (at end (p)))
        "#]],
    );
    case(
        "(:predicates (p))",
        "(:init (at 5 (p))) (:goal (p))",
        expect![[r#"
        unsupported: timed initial literals
        at (p)
    "#]],
    );
}

#[test]
fn the_agent_is_the_first_argument() {
    case(
        "(:requirements :typing :multi-agent) (:types robot room) (:predicates (in ?r - robot ?x - room))
         (:action enter :agent ?r - robot :parameters (?x - room) :effect (in ?r ?x))",
        "(:objects r1 - robot lab - room) (:init) (:goal (in r1 lab))",
        expect![[r#"
            (enter r1 lab)
            cost 1, optimal
        "#]],
    );
}

#[test]
fn unknown_names_are_reported_as_errors() {
    case(
        "(:predicates (p)) (:action go :precondition (pp) :effect (p))",
        "(:init) (:goal (p))",
        expect![[r#"
            error: unknown predicate `pp`; did you mean `p`? [(p)]
        "#]],
    );
}

#[test]
fn a_condition_without_free_variables_is_still_checked() {
    // Static facts, types and other tests leave one candidate per parameter.
    const MOVE: &str =
        "(:types robot room) (:predicates (at ?r - robot ?x - room) (moved ?r - robot))
         (:action move :parameters (?r - robot ?from ?to - room)
           :precondition (and (at ?r ?from) (not (= ?from ?to)))
           :effect (and (not (at ?r ?from)) (at ?r ?to) (moved ?r)))";
    case(
        MOVE,
        "(:objects r - robot hall - room) (:init (at r hall)) (:goal (moved r))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
    case(
        MOVE,
        "(:objects r - robot hall attic - room) (:init (at r hall)) (:goal (moved r))",
        expect![[r#"
            (move r hall attic)
            cost 1, optimal
        "#]],
    );
    case(
        "(:predicates (p ?x) (q ?x) (s ?x) (g)) (:action one :parameters (?x) :precondition
           (and (p ?x) (not (s ?x))) :effect (g)) (:action make :parameters (?x) :effect (p ?x))",
        "(:objects a) (:init (s a)) (:goal (g))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
    case(
        "(:predicates (p ?x) (g)) (:functions (size ?x)) (:action one :parameters (?x) :precondition
           (and (p ?x) (< (size ?x) 2)) :effect (g)) (:action make :parameters (?x) :effect (p ?x))",
        "(:objects a) (:init (= (size a) 2)) (:goal (g))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
    case(
        "(:constants a) (:predicates (p) (g)) (:action one :precondition (and (p) (not (= a a)))
           :effect (g)) (:action make :effect (p))",
        "(:init) (:goal (g))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
}

#[test]
fn a_condition_beside_many_alternatives_is_still_checked() {
    let wide = |index: usize| {
        let alternatives: String = (0..4).map(|at| format!("(q{at} ?x{index})")).collect();
        format!("(and (not (= ?x0 ?x1)) (or {alternatives}))")
    };
    let predicates: String = (0..4).map(|at| format!("(q{at} ?x)")).collect();
    let parts = format!(
        "(:predicates {predicates} (g)) (:action make :parameters (?x) :effect (q1 ?x))
         (:action try :parameters (?x0 ?x1) :effect (when {} (when {} (g))))
         (:action one :parameters (?x0 ?x1) :precondition (and {} {}) :effect (g))",
        wide(0),
        wide(1),
        wide(0),
        wide(1)
    );
    case(
        &parts,
        "(:objects a) (:init) (:goal (g))",
        expect![[r#"
            proven unsolvable before search
        "#]],
    );
}

#[test]
fn a_metric_ranks_plans_and_invalidates_none() {
    const GAIN: &str = "(:predicates (done)) (:functions (gain) (fuel))
         (:action little :precondition (not (done)) :effect (and (done) (increase (gain) 1)))
         (:action much :precondition (not (done)) :effect (and (done) (increase (gain) 9)))
         (:action fill :effect (assign (fuel) 5))
         (:action waste :effect (when (done) (increase (fuel) 2)))";
    let goal = |metric: &str, expected: Expect| {
        case(
            GAIN,
            &format!("(:init (= (gain) 0) (= (fuel) 3)) (:goal (done)) (:metric {metric})"),
            expected,
        );
    };
    goal(
        "maximize (gain)",
        expect![[r#"
            (much)
            cost 9, unproven
        "#]],
    );
    goal(
        "minimize (- 0 (gain))",
        expect![[r#"
            (much)
            cost -9, unproven
        "#]],
    );
    goal(
        "maximize (fuel)",
        expect![[r#"
            (little)
            cost 3, unproven
        "#]],
    );
    goal(
        "minimize (* (gain) (fuel))",
        expect![[r#"
            (little)
            cost 3, unproven
        "#]],
    );
}

#[test]
fn a_metric_without_a_value_is_an_error() {
    case(
        "(:predicates (done)) (:functions (fuel)) (:action go :effect (done))",
        "(:init) (:goal (done)) (:metric minimize (fuel))",
        expect![[r#"
            error: the metric reads `(fuel)`, which has no value; give it one in `:init`: `(= (fuel) NUMBER)`
        "#]],
    );
}
