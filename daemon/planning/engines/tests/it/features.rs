//! A small task for every feature of the language that the planner supports.

/// A feature of the language, with a task that cannot be solved without it.
pub(crate) struct Feature {
    pub(crate) name: &'static str,
    /// Sections of the task's domain, without the enclosing `define`.
    pub(crate) domain: &'static str,
    /// Sections of the task's problem, without the enclosing `define`.
    pub(crate) problem: &'static str,
    /// Cost of the task's cheapest plan; number of its steps if there is no metric.
    pub(crate) cost: f64,
    pub(crate) by: Judges,
}

/// The external programs that a feature is checked with, in addition to Althing's own validator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Judges {
    /// Both programs: unified-planning accepts the plan, and Fast Downward finds one.
    Both,
    /// Both programs, but unified-planning can only read the texts in the form in which Althing
    /// prints them.
    Printed,
    /// Only unified-planning, because Fast Downward does not support numbers.
    Validator,
    /// Only Fast Downward, because unified-planning cannot read the task. Fast Downward's cheapest
    /// plan must cost as much as the embedded planner's plan. If Fast Downward may only use the
    /// steps of that plan (`following.rs`), it must reach the goal.
    FastDownward,
    /// Both programs, but unified-planning reads the domain given here instead, which has the same
    /// meaning.
    Twin(&'static str),
}

const fn feature(
    name: &'static str,
    by: Judges,
    cost: f64,
    domain: &'static str,
    problem: &'static str,
) -> Feature {
    Feature { name, domain, problem, cost, by }
}

use Judges::{Both, FastDownward, Printed, Twin, Validator};

pub(crate) const FEATURES: &[Feature] = &[
    feature(
        "typing with a hierarchy",
        Both,
        2.0,
        "(:requirements :strips :typing)
         (:types vehicle place - object truck car - vehicle)
         (:predicates (at ?v - vehicle ?p - place) (loaded ?t - truck))
         (:action load :parameters (?t - truck ?p - place) :precondition (at ?t ?p)
           :effect (loaded ?t))
         (:action drive :parameters (?v - vehicle ?a ?b - place) :precondition (at ?v ?a)
           :effect (and (at ?v ?b) (not (at ?v ?a))))",
        "(:objects t - truck c - car x y - place) (:init (at t x) (at c y))
         (:goal (and (loaded t) (at c x)))",
    ),
    feature(
        "either",
        Twin(
            "(:requirements :typing :adl) (:types a b c - object)
             (:predicates (p ?x - object) (q ?x - object))
             (:action go :parameters (?x - object)
               :precondition (and (or (exists (?a - a) (= ?a ?x)) (exists (?b - b) (= ?b ?x)))
                                  (not (p ?x)))
               :effect (p ?x))
             (:action mark :parameters (?x - object)
               :precondition (and (or (exists (?b - b) (= ?b ?x)) (exists (?c - c) (= ?c ?x)))
                                  (not (q ?x)))
               :effect (q ?x))",
        ),
        3.0,
        "(:requirements :typing :adl) (:types a b c - object)
         (:predicates (p ?x - (either a b)) (q ?x - object))
         (:action go :parameters (?x - (either a b)) :precondition (not (p ?x)) :effect (p ?x))
         (:action mark :parameters (?x - (either b c)) :precondition (not (q ?x)) :effect (q ?x))",
        "(:objects x - a y - b z - c) (:init) (:goal (and (p x) (p y) (q z)))",
    ),
    feature(
        "constants",
        Both,
        1.0,
        "(:requirements :strips :typing) (:types room - object) (:constants hall - room)
         (:predicates (at ?x - room))
         (:action home :parameters (?x - room) :precondition (at ?x)
           :effect (and (at hall) (not (at ?x))))",
        "(:objects lab - room) (:init (at lab)) (:goal (at hall))",
    ),
    feature(
        "equality",
        Both,
        1.0,
        "(:requirements :strips :equality :negative-preconditions) (:predicates (p ?x) (q ?x))
         (:action both :parameters (?x ?y) :precondition (and (p ?x) (not (= ?x ?y)))
           :effect (q ?y))",
        "(:objects a b) (:init (p a)) (:goal (q b))",
    ),
    feature(
        "negative preconditions and goals",
        Both,
        2.0,
        "(:requirements :adl) (:predicates (p ?x) (q ?x))
         (:action drop :parameters (?x) :precondition (p ?x) :effect (not (p ?x)))
         (:action mark :parameters (?x) :precondition (not (p ?x)) :effect (q ?x))",
        "(:objects a) (:init (p a)) (:goal (and (not (p a)) (q a)))",
    ),
    feature(
        "disjunction and implication",
        Both,
        2.0,
        "(:requirements :adl) (:predicates (p ?x) (q ?x) (done))
         (:action set :parameters (?x) :precondition (or (p ?x) (not (q ?x))) :effect (q ?x))
         (:action finish :parameters () :precondition (forall (?x) (imply (p ?x) (q ?x)))
           :effect (done))",
        "(:objects a) (:init (p a)) (:goal (and (done) (or (q a) (not (done)))))",
    ),
    feature(
        "existential conditions",
        Both,
        1.0,
        "(:requirements :adl) (:predicates (near ?x) (q))
         (:action go :parameters () :precondition (exists (?x) (near ?x)) :effect (q))",
        "(:objects a b) (:init (near b)) (:goal (and (q) (exists (?y) (near ?y))))",
    ),
    feature(
        "universal conditions",
        Both,
        3.0,
        "(:requirements :adl) (:predicates (p ?x) (done))
         (:action set :parameters (?x) :effect (p ?x))
         (:action finish :parameters () :precondition (forall (?x) (p ?x)) :effect (done))",
        "(:objects a b) (:init) (:goal (and (done) (forall (?x) (p ?x))))",
    ),
    feature(
        "conditional effects",
        Both,
        2.0,
        "(:requirements :adl) (:predicates (p) (q))
         (:action go :parameters () :effect (and (p) (when (p) (q))))",
        "(:init) (:goal (q))",
    ),
    feature(
        "universal effects",
        Both,
        1.0,
        "(:requirements :adl :typing) (:types animal - object dog - animal)
         (:constants rex - dog) (:predicates (fed ?x - animal) (asleep ?x - animal))
         (:action feed :parameters ()
           :effect (forall (?x - animal) (when (not (asleep ?x)) (fed ?x))))",
        "(:objects tom - animal kim - dog) (:init (asleep kim)) (:goal (and (fed rex) (fed tom)))",
    ),
    feature(
        "derived predicates, recursive and negated",
        FastDownward,
        2.0,
        "(:requirements :adl :derived-predicates) (:constants a b c d)
         (:predicates (link ?x ?y) (cut ?x ?y) (reach ?x ?y) (alone ?x) (done))
         (:derived (reach ?x ?y) (and (link ?x ?y) (not (cut ?x ?y))))
         (:derived (reach ?x ?y) (exists (?z) (and (reach ?x ?z) (reach ?z ?y))))
         (:derived (alone ?x) (not (exists (?y) (reach ?x ?y))))
         (:action cut-link :parameters (?x ?y) :precondition (link ?x ?y) :effect (cut ?x ?y))
         (:action celebrate :parameters () :precondition (and (reach a c) (alone d))
           :effect (done))",
        "(:init (link a b) (link b c) (link d a)) (:goal (done))",
    ),
    feature(
        "action costs",
        Both,
        4.0,
        "(:requirements :strips :action-costs) (:predicates (at ?x))
         (:functions (total-cost) - number (distance ?x ?y) - number)
         (:action go :parameters (?x ?y) :precondition (at ?x)
           :effect (and (not (at ?x)) (at ?y) (increase (total-cost) (distance ?x ?y))))",
        "(:objects a b c) (:init (at a) (= (total-cost) 0) (= (distance a c) 9)
            (= (distance a b) 1) (= (distance b c) 3) (= (distance b a) 1) (= (distance c a) 1)
            (= (distance c b) 1) (= (distance a a) 1) (= (distance b b) 1) (= (distance c c) 1))
         (:goal (at c)) (:metric minimize (total-cost))",
    ),
    feature(
        "sums of several cost effects",
        // unified-planning treats `total-cost` specially and does not find its value here.
        FastDownward,
        12.0,
        "(:requirements :strips :action-costs) (:predicates (q ?x))
         (:functions (total-cost) - number (toll ?x) - number)
         (:action go :parameters (?x)
           :effect (and (q ?x) (increase (total-cost) 5) (increase (total-cost) (toll ?x))))",
        "(:objects a) (:init (= (total-cost) 0) (= (toll a) 7)) (:goal (q a))
         (:metric minimize (total-cost))",
    ),
    feature(
        "sums of several changes of one number",
        Both,
        12.0,
        "(:requirements :strips :numeric-fluents) (:predicates (q ?x))
         (:functions (spent) - number (toll ?x) - number)
         (:action go :parameters (?x)
           :effect (and (q ?x) (increase (spent) 5) (increase (spent) (toll ?x))))",
        "(:objects a) (:init (= (spent) 0) (= (toll a) 7)) (:goal (q a))
         (:metric minimize (spent))",
    ),
    feature(
        "fractional costs",
        Both,
        0.65,
        "(:requirements :strips :action-costs) (:predicates (q) (r))
         (:functions (total-cost) - number)
         (:action dear :parameters () :effect (and (q) (increase (total-cost) 0.7)))
         (:action half :parameters () :effect (and (r) (increase (total-cost) 0.3)))
         (:action rest :parameters () :precondition (r)
           :effect (and (q) (increase (total-cost) 0.35)))",
        "(:init (= (total-cost) 0)) (:goal (q)) (:metric minimize (total-cost))",
    ),
    feature(
        "a metric that weighs several functions",
        Both,
        9.0,
        "(:requirements :strips :numeric-fluents) (:predicates (q))
         (:functions (time) - number (money) - number)
         (:action drive :parameters ()
           :effect (and (q) (increase (time) 2) (increase (money) 3)))
         (:action walk :parameters () :effect (and (q) (increase (time) 5)))",
        "(:init (= (time) 0) (= (money) 0)) (:goal (q))
         (:metric minimize (+ (* 3 (time)) (money)))",
    ),
    feature(
        "linear numeric conditions and effects",
        Validator,
        3.0,
        "(:requirements :strips :numeric-fluents) (:predicates (at ?x) (road ?x ?y))
         (:functions (fuel) - number (capacity) - number (length ?x ?y) - number)
         (:action drive :parameters (?x ?y)
           :precondition (and (at ?x) (road ?x ?y) (>= (fuel) (length ?x ?y)))
           :effect (and (not (at ?x)) (at ?y) (decrease (fuel) (length ?x ?y))))
         (:action refuel :parameters (?x) :precondition (at ?x)
           :effect (assign (fuel) (capacity)))",
        "(:objects a b c) (:init (at a) (road a b) (road b c) (= (length a b) 3)
            (= (length b c) 4) (= (length a a) 9) (= (length b b) 9) (= (length c c) 9)
            (= (length a c) 9) (= (length b a) 9) (= (length c a) 9) (= (length c b) 9)
            (= (fuel) 3) (= (capacity) 5))
         (:goal (and (at c) (>= (fuel) 1)))",
    ),
    feature(
        "numeric goals over sums and products, with a metric",
        Validator,
        3.0,
        "(:requirements :strips :numeric-fluents) (:predicates (ready))
         (:functions (x) - number (y) - number (spent) - number)
         (:action left :parameters () :precondition (ready)
           :effect (and (increase (x) 2) (increase (spent) 1)))
         (:action right :parameters () :precondition (ready)
           :effect (and (increase (y) 3) (increase (spent) 1)))",
        "(:init (ready) (= (x) 0) (= (y) 0) (= (spent) 0))
         (:goal (and (>= (+ (* 2 (x)) (y)) 10) (< (y) 4) (> (- (x) (y)) 0)))
         (:metric minimize (spent))",
    ),
    feature(
        "numeric conditional and universal effects",
        Validator,
        2.0,
        "(:requirements :adl :numeric-fluents) (:predicates (on ?x))
         (:functions (level ?x) - number)
         (:action tick :parameters ()
           :effect (forall (?x) (when (on ?x) (increase (level ?x) 1))))",
        "(:objects a b) (:init (on a) (= (level a) 0) (= (level b) 0))
         (:goal (and (= (level a) 2) (<= (level b) 0)))",
    ),
    feature(
        "actions without effects",
        Both,
        1.0,
        "(:requirements :strips) (:predicates (q))
         (:action look :parameters (?x) :effect (and)) (:action go :parameters () :effect (q))",
        "(:objects a) (:init) (:goal (q))",
    ),
    feature(
        "any order of sections",
        Printed,
        7.0,
        "(:action go :parameters () :effect (and (q) (increase (total-cost) 7)))
         (:functions (total-cost) - number) (:predicates (q))
         (:requirements :strips :action-costs)",
        "(:metric minimize (total-cost)) (:goal (q)) (:init (= (total-cost) 0))",
    ),
    feature(
        "add wins over delete",
        Both,
        1.0,
        "(:requirements :strips) (:predicates (p ?x) (q))
         (:action go :parameters (?x ?y) :effect (and (q) (not (p ?x)) (p ?y)))",
        "(:objects a) (:init (p a)) (:goal (and (q) (p a)))",
    ),
];

/// Returns the texts of a feature's task.
pub(crate) fn texts(feature: &Feature) -> (String, String) {
    let problem = format!("(define (problem p) (:domain d) {})", feature.problem);
    (domain_of(feature.domain), problem)
}

/// Returns the text of a domain that has these sections.
pub(crate) fn domain_of(sections: &str) -> String {
    format!("(define (domain d) {sections})")
}
