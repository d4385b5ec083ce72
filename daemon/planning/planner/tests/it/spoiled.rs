//! Mutated texts: words are dropped, duplicated, copied and swapped. Planning must end within its
//! limits, and every plan must be valid.

use std::time::{Duration, Instant};

use proptest::prelude::*;

#[path = "../../fuzz/answer.rs"]
mod answer;

use answer::{Answer, answer};

/// Expands to a correct domain, a zero byte, and a correct problem.
macro_rules! texts {
    ($folder:literal) => {
        concat!(
            include_str!(concat!("../../benches/", $folder, "/domain.pddl")),
            "\0",
            include_str!(concat!("../../benches/", $folder, "/problem.pddl"))
        )
    };
}

const TEXTS: [&str; 5] = [
    texts!("office"),
    texts!("scenarios/2-two-robots"),
    texts!("scenarios/3-validation"),
    // A task with features that the other texts do not use.
    "(define (domain d) (:types u - t t) (:constants a - t b - u)
       (:predicates (z) (p ?x) (r ?x ?y - t) (d ?x)) (:functions (total-cost) (n) (f ?x - t))
       (:derived (d ?x) (or (p ?x) (exists (?y - t) (and (r ?x ?y) (d ?y)))))
       (:action go :parameters (?x - t ?y - (either u t))
         :precondition (and (imply (z) (p ?x)) (forall (?v - u) (or (r ?v ?x) (not (= ?v ?y)))))
         :effect (and (p ?y) (when (d ?x) (not (p ?x))) (increase (n) (f ?x))
           (forall (?v - t) (when (p ?v) (r ?x ?v))) (increase (total-cost) (+ 1 (* 2 (f ?y))))))
       (:action drop :parameters (?x) :precondition (>= (n) 1)
         :effect (and (decrease (n) 1) (assign (f b) (/ (n) (f ?x))) (z))))
     \0(define (problem e) (:domain d) (:objects c - u) (:init (p a) (= (n) 0) (= (f a) 2)
       (= (f b) 0) (= (f c) 1)) (:goal (and (z) (r c a) (> (n) (f b))))
       (:metric minimize (+ (total-cost) (* 3 (total-time)))))",
    // A task with an action that has too many ground instances for the limits, so that it is
    // applied piecewise.
    "(define (domain w) (:types t) (:predicates (n ?x ?y - t) (p ?x - t) (s ?x ?y - t))
       (:functions (total-cost) (f ?x ?y - t))
       (:action go :parameters (?a ?b ?c ?d ?e ?g ?h ?i - t)
         :precondition (and (n ?a ?b) (n ?b ?c) (n ?c ?d) (n ?d ?e) (n ?e ?g) (n ?g ?h) (n ?h ?i)
           (p ?i) (not (= ?a ?i)) (not (= ?b ?i)) (not (s ?a ?i)) (or (p ?h) (n ?a ?i))
           (forall (?v - t) (imply (p ?v) (not (s ?v ?a)))))
         :effect (and (s ?a ?i) (p ?a) (when (n ?i ?a) (not (p ?i)))
           (forall (?v - t) (when (s ?v ?i) (p ?v))) (increase (total-cost) (f ?a ?i))))
       (:action rest :parameters (?x - t) :precondition (p ?x) :effect (not (p ?x))))
     \0(define (problem x) (:domain w) (:objects a b c d e g - t)
       (:init (p a) (n a b) (n a c) (n a d) (n a e) (n a g) (n b a) (n b c) (n b d) (n b e) (n b g)
         (n c a) (n c b) (n c d) (n c e) (n c g) (n d a) (n d b) (n d c) (n d e) (n d g) (n e a)
         (n e b) (n e c) (n e d) (n e g) (n g a) (n g b) (n g c) (n g d) (n g e)
         (= (f c a) 2) (= (f b c) 1) (= (f d a) 3))
       (:goal (s c a)) (:metric minimize (total-cost)))",
];

/// Time limit, generous for debug builds on a busy machine. libFuzzer uses a shorter one.
const PATIENCE: Duration = Duration::from_secs(60);

/// Mutation of one word.
#[derive(Clone, Copy, Debug)]
enum Slip {
    Drop,
    Double,
    /// Replaces another word by a copy of this one.
    Copy,
    Exchange,
}

fn slip() -> impl Strategy<Value = Slip> {
    prop_oneof![Just(Slip::Drop), Just(Slip::Double), Just(Slip::Copy), Just(Slip::Exchange)]
}

/// Returns the words and parentheses of a text, without comments.
fn words(text: &str) -> Vec<String> {
    let said = text.lines().filter_map(|line| line.split(';').next());
    let apart = said.collect::<Vec<_>>().join(" ");
    let apart = apart.replace('(', " ( ").replace(')', " ) ").replace('\0', " \0 ");
    apart.split_ascii_whitespace().map(str::to_owned).collect()
}

fn spoil(text: &str, slips: &[(Slip, prop::sample::Index, prop::sample::Index)]) -> String {
    let mut words = words(text);
    for (slip, at, other) in slips {
        let (at, other) = (at.index(words.len()), other.index(words.len()));
        match slip {
            Slip::Drop => drop(words.remove(at)),
            Slip::Double => words.insert(at, words[at].clone()),
            Slip::Copy => words[other] = words[at].clone(),
            Slip::Exchange => words.swap(at, other),
        }
    }
    words.join(" ")
}

#[test]
fn the_original_texts_have_plans() {
    for text in TEXTS {
        assert_eq!(answer(words(text).join(" ").as_bytes()), Answer::Planned, "{text}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(2_031),
        ..ProptestConfig::default()
    })]

    #[test]
    fn mutated_texts_end_within_the_limits(
        text in prop::sample::select(&TEXTS[..]),
        slips in prop::collection::vec(
            (slip(), any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..4),
    ) {
        let spoiled = spoil(text, &slips);
        let began = Instant::now();
        let answer = answer(spoiled.as_bytes());
        prop_assert!(began.elapsed() < PATIENCE, "{answer:?} after {:?}", began.elapsed());
    }
}
