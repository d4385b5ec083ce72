//! Kinds of tasks and parts that are easy to get wrong.

use acl::content::PartStep;
use planner::{Cancel, Options};
use skeleton::{Partner, Projection, SkeletonTask};

use crate::joint::{files, play, validated};

/// A private step must come before another agent changes what it needs.
#[test]
fn private_steps_stay_before_the_changes_of_others() {
    let worker = files(
        "worker",
        "(define (domain shop) (:predicates (power) (lid) (cut) (done) (:private (charged)))
          (:action recharge :parameters () :precondition (power) :effect (charged))
          (:action lift :parameters () :effect (lid))
          (:action work :parameters () :precondition (and (charged) (cut)) :effect (done)))",
        "(define (problem p) (:domain shop) (:init (power)) (:goal (done)))",
    );
    let cutter = files(
        "cutter",
        "(define (domain shop) (:predicates (power) (lid) (cut))
          (:action cut-power :parameters () :precondition (lid)
            :effect (and (cut) (not (power)))))",
        "(define (problem p) (:domain shop) (:init (power)) (:goal (and)))",
    );
    let task = [cutter, worker];
    let steps = play(&task).steps.expect("a plan");
    assert_eq!(validated(&task, &steps), Ok(4.0), "{steps:?}");
}

/// A quantified goal ranges over private and over public things.
#[test]
fn a_goal_over_private_and_public_things_is_reached() {
    let driver = files(
        "driver",
        "(define (domain yard) (:requirements :typing) (:types truck car - vehicle)
          (:predicates (parked ?v - vehicle))
          (:action park-truck :parameters (?t - truck) :effect (parked ?t))
          (:action park-car :parameters (?c - car) :effect (parked ?c)))",
        "(define (problem p) (:domain yard)
          (:objects red - car (:private blue - truck))
          (:init) (:goal (forall (?v - vehicle) (parked ?v))))",
    );
    let task = [driver];
    let steps = play(&task).steps.expect("a plan");
    assert_eq!(validated(&task, &steps), Ok(2.0), "{steps:?}");
}

/// What others do after the last step of an agent counts for its own goals, too.
#[test]
fn changes_after_the_last_step_of_an_agent_reach_it() {
    let first = files(
        "first",
        "(define (domain gate) (:predicates (open) (ready) (:private (calm)))
          (:action prepare :parameters () :effect (ready))
          (:action calm-down :parameters () :precondition (open) :effect (calm)))",
        "(define (problem p) (:domain gate) (:init) (:goal (and (calm) (open))))",
    );
    let second = files(
        "second",
        "(define (domain gate) (:predicates (open) (ready))
          (:action swing :parameters () :precondition (ready) :effect (open)))",
        "(define (problem p) (:domain gate) (:init) (:goal (and)))",
    );
    let task = [first, second];
    let steps = play(&task).steps.expect("a plan");
    assert_eq!(validated(&task, &steps), Ok(3.0), "{steps:?}");
}

/// Refusals that prove nothing must not make an agent tell more.
#[test]
fn a_part_that_makes_no_sense_reveals_nothing() {
    let washer = files(
        "washer",
        "(define (domain wash) (:requirements :typing) (:types item tool - object)
          (:predicates (clean ?i - item) (:private (holds ?t - tool) (lies ?t - tool)))
          (:action grab :parameters (?t - tool) :precondition (lies ?t) :effect (holds ?t))
          (:action scrub :parameters (?i - item ?t - tool) :precondition (holds ?t)
            :effect (clean ?i)))",
        "(define (problem p) (:domain wash)
          (:objects cup - item (:private brush - tool))
          (:init (lies brush)) (:goal (clean cup)))",
    );
    let mut partner = Partner::new(washer).expect("supported");
    let told = partner.projection();
    for part in [
        vec![],
        vec![PartStep::Own("(nonsense)".to_owned())],
        vec![PartStep::Own("(washer--do-scrub cup brush)".to_owned())],
        vec![PartStep::Own("(washer--do-scrub saucer)".to_owned())],
        vec![PartStep::Others("(".to_owned()), PartStep::Own("(washer--do-scrub cup)".to_owned())],
    ] {
        let refusal =
            partner.fill(&part, &Options::default(), &Cancel::new()).expect_err("refused");
        assert!(!partner.sharpen(&refusal), "{part:?}: {refusal:?}");
    }
    let cancelled = Cancel::new();
    cancelled.set();
    let part = [PartStep::Own("(washer--do-scrub cup)".to_owned())];
    let refusal = partner.fill(&part, &Options::default(), &cancelled).expect_err("refused");
    assert!(!partner.sharpen(&refusal), "{refusal:?}");
    // A guess at private facts changes nothing: the washer has to grab the brush itself.
    let guess = PartStep::Others("(holds brush)".to_owned());
    let part = [guess, PartStep::Own("(washer--do-scrub cup)".to_owned())];
    let filled = partner.fill(&part, &Options::default(), &Cancel::new()).expect("possible");
    assert_eq!(filled.steps.iter().flatten().count(), 2, "{filled:?}");
    assert_eq!(partner.projection(), told);
}

#[test]
fn what_cannot_be_kept_secret_is_refused() {
    let refused = |domain: &str, problem: &str| {
        Partner::new(files("agent", domain, problem)).err().expect("refused")
    };
    let problem = "(define (problem p) (:domain d) (:init) (:goal (lit)))";
    let conditional = refused(
        "(define (domain d) (:predicates (lit) (:private (awake)))
          (:action push :parameters () :effect (when (awake) (lit))))",
        problem,
    );
    assert!(conditional.contains("depends on something private"), "{conditional}");
    let goal = "(define (problem p) (:domain d) (:init) (:goal (or (lit) (sung))))";
    let mixed = refused("(define (domain d) (:predicates (lit)))", goal);
    assert!(mixed.contains("does not know"), "{mixed}");
}

/// A public fact of the beginning that only one agent states holds for all who know its names.
#[test]
fn what_only_another_states_of_the_beginning_is_told() {
    let states = |init: &str| {
        let problem = format!("(define (problem p) (:domain gate) (:init {init}) (:goal (there)))");
        let robot = files(
            "robot",
            "(define (domain gate) (:predicates (open) (there) (:private (awake)))
              (:action wake :parameters () :effect (awake))
              (:action drive :parameters () :precondition (and (open) (awake)) :effect (there)))",
            "(define (problem p) (:domain gate) (:init) (:goal (there)))",
        );
        let keeper = files(
            "keeper",
            "(define (domain gate) (:predicates (open) (there) (locked))
              (:action knock :parameters () :precondition (locked) :effect (open)))",
            &problem,
        );
        [keeper, robot]
    };
    let task = states("(open)");
    let steps = play(&task).steps.expect("a plan");
    assert_eq!(validated(&task, &steps), Ok(2.0), "{steps:?}");
    assert!(play(&states("")).steps.is_none(), "nobody opens it");
}

#[test]
fn no_name_of_a_variable_is_announced() {
    let domain = "(define (domain d) (:predicates (near ?secret-a ?secret-b)
          (:private (held ?secret-c)))
        (:functions (far ?secret-d) - number)
        (:action go :parameters (?secret-e) :precondition (held ?secret-e)
          :effect (near ?secret-e ?secret-e)))";
    let problem = "(define (problem p) (:domain d) (:objects x)
        (:init (held x) (= (far x) 1)) (:goal (near x x)))";
    let partner = Partner::new(files("agent", domain, problem)).expect("supported");
    let told = partner.projection();
    assert!(!told.domain.contains("secret"), "{}", told.domain);
}

/// What a member may not do: change what is another member's own, under its opaque name.
#[test]
fn names_of_another_member_are_refused_wherever_they_stand() {
    let projection = |init: &str, effect: &str| Projection {
        domain: format!(
            "(define (domain d) (:predicates (lit))
              (:action agent--do-push :parameters () :effect {effect}))"
        ),
        problem: format!("(define (problem p) (:domain d) (:init {init}) (:goal (lit)))"),
    };
    let merged = |projection: Projection| {
        let merged = SkeletonTask::merge(&[("agent".to_owned(), projection)].into());
        merged.err().map(|error| error.why)
    };
    assert_eq!(merged(projection("", "(lit)")), None);
    for foreign in [projection("(known-to--robot x)", "(lit)"), projection("", "(robot--p0)")] {
        let why = merged(foreign).expect("refused");
        assert!(why.contains("only names of its own things may"), "{why}");
    }
}
