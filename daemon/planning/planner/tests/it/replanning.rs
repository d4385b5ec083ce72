//! Replanning while actions, objects, facts and goals appear and disappear. A kept ground problem
//! must give the same results as grounding from scratch.

use std::sync::Arc;

use pddl::{Atom, Domain, InitElement, Name, ObjectDeclaration, PlanStep, Problem, Span, Term};
use planner::validate::World;
use planner::{Cancel, GroundingReuse, Options, PlanReuse, Replanned, Replanner, StopReason};
use proptest::prelude::*;
use proptest::sample::Index;

use crate::agreement::{action, atom, axiom, conjunction, with_objects};
use crate::brute_force::least_cost;
use crate::support::{domain, parse, problem};

/// A sequence of changes: all possible parts of the texts, and the parts that exist at each moment.
#[derive(Clone, Debug)]
struct History {
    actions: Vec<String>,
    axiom: String,
    facts: Vec<String>,
    goals: Vec<String>,
    moments: Vec<Moment>,
}

#[derive(Clone, Debug)]
struct Moment {
    actions: Vec<Index>,
    facts: Vec<Index>,
    goal: Index,
    /// Whether the object `c` exists.
    has_guest: bool,
    /// Whether the list of objects is the same allocation as at an earlier moment, instead of an
    /// equal copy.
    shares_objects: bool,
    /// Fact that changes after the first step of the plan without an action. The rest of the plan
    /// is checked afterwards.
    news: Option<Index>,
}

fn history() -> impl Strategy<Value = History> {
    let any = || any::<Index>();
    let moment = (
        prop::collection::vec(any(), 2..6),
        prop::collection::vec(any(), 0..7),
        any(),
        prop::bool::weighted(0.6),
        prop::bool::ANY,
        prop::option::weighted(0.7, any()),
    );
    let moment = moment.prop_map(|(actions, facts, goal, has_guest, shares_objects, news)| {
        Moment { actions, facts, goal, has_guest, shares_objects, news }
    });
    let parts = (
        prop::collection::vec(action(), 3..6),
        axiom(),
        prop::collection::vec(atom(0), 4..8),
        prop::collection::vec(conjunction(0, 1..4), 1..4),
        prop::collection::vec(moment, 3..8),
    );
    parts.prop_map(|(actions, axiom, mut facts, goals, moments)| {
        facts.extend(["(s a b)", "(s b a)", "(s a c)", "(p c)", "(r c a)"].map(str::to_owned));
        History { actions, axiom, facts, goals, moments }
    })
}

impl History {
    fn texts(&self, moment: &Moment) -> (String, String) {
        let mut parts = format!(
            "(:types t) (:constants a - t b)
             (:predicates (z) (p ?x) (q ?x) (r ?x ?y) (d ?x) (s ?x ?y))
             (:functions (total-cost)) (:derived (d ?v0) {})",
            self.axiom
        );
        let mut actions: Vec<usize> =
            moment.actions.iter().map(|index| index.index(self.actions.len())).collect();
        actions.sort_unstable();
        actions.dedup();
        for index in actions {
            parts += &format!("(:action act{index} {})", self.actions[index]);
        }
        let facts: String = { moment.facts.iter() }
            .map(|index| index.get(&self.facts).as_str())
            .filter(|fact| moment.has_guest || !fact.contains(" c"))
            .collect();
        let guest = if moment.has_guest { "(:objects c - t)" } else { "" };
        let goal = moment.goal.get(&self.goals);
        let rest =
            format!("{guest} (:init {facts}) (:goal {goal}) (:metric minimize (total-cost))");
        (with_objects(&domain(&parts), 2), with_objects(&problem(&rest), 2))
    }
}

/// Number of times that each value of `PlanReuse` and `GroundingReuse` was returned.
#[derive(Debug, Default)]
struct Tally {
    courses: [u32; 3],
    groundings: [u32; 4],
}

/// Replans at each moment of a history, and compares the results with brute force.
fn play(history: &History, tally: &mut Tally) -> Result<(), TestCaseError> {
    let mut replanner = Replanner::default();
    let mut earlier: Vec<Arc<Vec<ObjectDeclaration>>> = Vec::new();
    for moment in &history.moments {
        let (domain, problem) = history.texts(moment);
        let (domain, mut problem) = parse(&domain, &problem);
        match earlier.iter().find(|objects| **objects == problem.objects) {
            Some(objects) if moment.shares_objects => problem.objects = Arc::clone(objects),
            _ => earlier.push(Arc::clone(&problem.objects)),
        }
        let plan = answered(&mut replanner, &domain, &problem, &[], tally)?;
        let (Some(news), Some((first, rest))) = (&moment.news, plan.split_first()) else {
            continue;
        };
        let mut world = World::initial(&domain, &problem).expect("there are no bad axioms");
        world.apply(first).expect("the plan is valid");
        let claimed = |fact: &Atom| fact.predicate != "d";
        problem.init = world.atoms().filter(claimed).map(InitElement::Atom).collect();
        let fact = fact(news.get(&history.facts).trim_matches(['(', ')']));
        match problem.init.iter().position(|known| *known == fact) {
            Some(at) => drop(problem.init.remove(at)),
            None => problem.init.push(fact),
        }
        if pddl::check_problem(&domain, &problem).iter().any(pddl::Diagnostic::is_error) {
            continue;
        }
        answered(&mut replanner, &domain, &problem, rest, tally)?;
    }
    Ok(())
}

/// Plans, compares the result with brute force, and returns the steps of the plan.
fn answered(
    replanner: &mut Replanner,
    domain: &Domain,
    problem: &Problem,
    rest: &[PlanStep],
    tally: &mut Tally,
) -> Result<Vec<PlanStep>, TestCaseError> {
    let options = Options::default();
    let found = replanner.plan(domain, problem, rest, &options, &Cancel::new());
    let found = found.map_err(|err| TestCaseError::fail(err.to_string()))?;
    let Replanned { outcome, plan_reuse: course, grounding_reuse: grounding } = found;
    tally.groundings[grounding as usize] += 1;
    match (outcome.plan, least_cost(domain, problem)) {
        (Some(plan), Some(least)) => {
            let cost = plan.cost.map_or(f64::NAN, |cost| cost.0);
            let is_least = (cost - least).abs() < 1e-6;
            let is_kept = course == PlanReuse::Kept;
            prop_assert!(is_least || is_kept, "{course:?}: found {cost}, least {least}");
            prop_assert!(!rest.is_empty() || outcome.statistics.proven_optimal);
            let course = match course {
                PlanReuse::Kept => 0,
                PlanReuse::Repaired { .. } => 1,
                PlanReuse::Planned => 2,
            };
            tally.courses[course] += 1;
            Ok(plan.steps)
        }
        (None, None) => {
            let is_proof = matches!(outcome.stop_reason, StopReason::Unsolvable { .. });
            prop_assert!(is_proof, "{}", outcome.stop_reason);
            Ok(Vec::new())
        }
        (plan, truth) => Err(TestCaseError::fail(format!("planned {plan:?}, truth {truth:?}"))),
    }
}

#[test]
fn a_kept_ground_problem_agrees_with_brute_force() {
    let config = ProptestConfig {
        cases: 400,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(2_028),
        ..ProptestConfig::default()
    };
    let tally = std::cell::RefCell::new(Tally::default());
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let played = runner.run(&history(), |history| play(&history, &mut tally.borrow_mut()));
    if let Err(error) = played {
        panic!("{error}");
    }
    // Each kind of result must have occurred; otherwise the test does not cover it.
    let Tally { courses, groundings } = tally.into_inner();
    assert!(
        courses.iter().chain(&groundings).all(|count| *count > 0),
        "{courses:?} {groundings:?}"
    );
}

/// A robot in a row of places.
const ROW: &str = "(:predicates (at ?x) (next ?x ?y))
    (:action move :parameters (?x ?y) :precondition (and (at ?x) (next ?x ?y))
      :effect (and (not (at ?x)) (at ?y)))";

fn row(place: &str) -> String {
    problem(&format!(
        "(:objects a b c d e) (:init (at {place}) (next a b) (next b c) (next c d) (next d e)
           (next b a) (next c b) (next d c) (next e d)) (:goal (at e))"
    ))
}

#[test]
fn a_plan_is_repaired_to_rejoin_the_old_plan() {
    let mut replanner = Replanner::default();
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut plan = |place: &str, rest: &[PlanStep]| {
        let (domain, problem) = parse(&domain(ROW), &row(place));
        let found = replanner.plan(&domain, &problem, rest, &options, &cancel).expect("it can");
        (found.outcome.plan.expect("there is a way").steps, found.plan_reuse, found.grounding_reuse)
    };
    let (steps, course, grounding) = plan("b", &[]);
    assert_eq!((steps.len(), course, grounding), (3, PlanReuse::Planned, GroundingReuse::Full));
    let rest = &steps[1..];
    let (kept, course, grounding) = plan("c", rest);
    assert_eq!(
        (kept.as_slice(), course, grounding),
        (rest, PlanReuse::Kept, GroundingReuse::Unneeded)
    );
    // The robot has been pushed back.
    let (repaired, course, grounding) = plan("a", rest);
    assert_eq!((&repaired[2..], course), (rest, PlanReuse::Repaired { kept: 2 }));
    assert_eq!(grounding, GroundingReuse::Kept);
    // The robot has been pushed forward: only the last step is still required.
    let (repaired, course, _) = plan("d", rest);
    assert_eq!((repaired.as_slice(), course), (&rest[1..], PlanReuse::Repaired { kept: 1 }));
}

/// Two robots must visit places. The ways between the places have lengths.
const TOUR: &str = "(:types robot place) (:predicates (at ?r - robot ?x - place) (seen ?x - place)
      (way ?x ?y - place) (dark ?x - place))
    (:functions (length ?x ?y - place) (total-cost))
    (:action move :parameters (?r - robot ?x ?y - place)
      :precondition (and (at ?r ?x) (way ?x ?y) (not (dark ?y)))
      :effect (and (not (at ?r ?x)) (at ?r ?y) (increase (total-cost) (length ?x ?y))))
    (:action look :parameters (?r - robot ?x - place) :precondition (at ?r ?x)
      :effect (and (seen ?x) (increase (total-cost) 1)))";

/// A change during a tour that no step of the plan causes.
#[derive(Clone, Debug)]
enum News {
    /// A way is closed, or opened again.
    Way(Index),
    Pushed(usize, usize),
    Dark(usize),
    /// A robot leaves.
    Gone(usize),
}

fn news() -> impl Strategy<Value = News> {
    prop_oneof![
        any::<Index>().prop_map(News::Way),
        (0..2usize, 0..4usize).prop_map(|(robot, place)| News::Pushed(robot, place)),
        (0..4usize).prop_map(News::Dark),
        (0..2usize).prop_map(News::Gone),
    ]
}

fn fact(text: &str) -> InitElement {
    let mut words = text.split(' ').map(Name::new);
    let predicate = words.next().expect("a fact has a name");
    let arguments = words.map(Term::Object).collect();
    InitElement::Atom(Atom { predicate, arguments, span: Span::default() })
}

/// Plays a tour: alternates steps and changes until the tour is over. Returns the number of
/// repaired plans.
fn tour(lengths: &[u32], events: &[(usize, News)]) -> Result<u32, TestCaseError> {
    let pairs = (0..4).flat_map(|x| (0..4).map(move |y| (x, y))).filter(|(x, y)| x != y);
    let ways: Vec<_> = pairs.zip(lengths).filter(|(_, length)| **length > 0).collect();
    let mut init = String::from("(at r0 p0) (at r1 p1)");
    for ((x, y), length) in &ways {
        init += &format!("(way p{x} p{y}) (= (length p{x} p{y}) {length})");
    }
    let text = problem(&format!(
        "(:objects r0 r1 - robot p0 p1 p2 p3 - place) (:init {init})
         (:goal (and (seen p2) (seen p3))) (:metric minimize (total-cost))"
    ));
    let (domain, mut problem) = parse(&domain(TOUR), &text);
    let values = problem.init.iter().filter(|one| matches!(one, InitElement::Assign(..)));
    let values: Vec<InitElement> = values.cloned().collect();
    let mut replanner = Replanner::default();
    let (mut rest, mut tally) = (Vec::new(), Tally::default());
    for (done, news) in events {
        rest = answered(&mut replanner, &domain, &problem, &rest, &mut tally)?;
        let mut world = World::initial(&domain, &problem).expect("there are no axioms");
        for step in rest.drain(..rest.len().min(*done)) {
            world.apply(&step).expect("the plan is valid");
        }
        problem.init = world.atoms().map(InitElement::Atom).chain(values.clone()).collect();
        let toggled = match news {
            News::Way(index) => {
                let ((x, y), _) = *index.get(&ways);
                format!("way p{x} p{y}")
            }
            News::Dark(place) => format!("dark p{place}"),
            News::Gone(robot) | News::Pushed(robot, _) => {
                let name = format!("(at r{robot} ");
                problem.init.retain(|one| !one.to_string().starts_with(&name));
                match news {
                    News::Pushed(_, place) => format!("at r{robot} p{place}"),
                    _ => continue,
                }
            }
        };
        let toggled = fact(&toggled);
        match problem.init.iter().position(|known| *known == toggled) {
            Some(at) => drop(problem.init.remove(at)),
            None => problem.init.push(toggled),
        }
    }
    Ok(tally.courses[1])
}

#[test]
fn tours_are_repaired_at_the_least_cost() {
    let config = ProptestConfig {
        cases: 150,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(2_029),
        ..ProptestConfig::default()
    };
    let lengths = prop::collection::vec(prop_oneof![Just(0), 1..9u32], 12);
    let some_ways = lengths.prop_filter("no way", |all| all.iter().any(|length| *length > 0));
    let events = prop::collection::vec((0..3usize, news()), 3..7);
    let repaired = std::cell::Cell::new(0);
    let mut runner = proptest::test_runner::TestRunner::new(config);
    let played = runner.run(&(some_ways, events), |(lengths, events)| {
        repaired.set(repaired.get() + tour(&lengths, &events)?);
        Ok(())
    });
    if let Err(error) = played {
        panic!("{error}");
    }
    assert!(repaired.get() > 20, "{} repaired", repaired.get());
}

/// A robot with a limited battery charge, and ways with lengths.
const BATTERY: &str =
    "(:types robot place) (:predicates (at ?r - robot ?x - place) (way ?x ?y - place))
    (:functions (length ?x ?y - place) (charge ?r - robot) (warmth ?x - place) (total-cost))
    (:action move :parameters (?r - robot ?x ?y - place)
      :precondition (and (at ?r ?x) (way ?x ?y) (>= (charge ?r) (length ?x ?y)))
      :effect (and (not (at ?r ?x)) (at ?r ?y) (decrease (charge ?r) (length ?x ?y))
        (increase (total-cost) (length ?x ?y))))";

fn battery(length: u32, charge: u32, warmth: u32, goal: &str) -> String {
    problem(&format!(
        "(:objects r - robot a b c - place)
         (:init (at r a) (way a b) (way b c) (way a c) (= (length a b) 2) (= (length b c) 2)
           (= (length a c) {length}) (= (charge r) {charge}) (= (warmth a) {warmth}) (= (total-cost) 0))
         (:goal {goal}) (:metric minimize (total-cost))"
    ))
}

#[test]
fn changed_state_numbers_are_followed_and_others_cause_regrounding() {
    let mut replanner = Replanner::default();
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut again = |length, charge, warmth, goal: &str| {
        let (domain, problem) = parse(&domain(BATTERY), &battery(length, charge, warmth, goal));
        let found = replanner.plan(&domain, &problem, &[], &options, &cancel).expect("it can");
        let cost = found.outcome.plan.and_then(|plan| plan.cost).map(|cost| cost.0);
        (cost, found.grounding_reuse)
    };
    assert_eq!(again(3, 9, 20, "(at r c)"), (Some(3.0), GroundingReuse::Full));
    // The battery charge is part of the state; nothing depends on the warmth.
    assert_eq!(again(3, 3, 21, "(at r c)"), (Some(3.0), GroundingReuse::Kept));
    assert_eq!(again(3, 2, 22, "(at r c)"), (None, GroundingReuse::Kept));
    // Costs depend on the length of the way.
    assert_eq!(again(7, 9, 22, "(at r c)"), (Some(4.0), GroundingReuse::Full));
    assert_eq!(
        again(7, 9, 22, "(and (at r b) (>= (charge r) 7))"),
        (Some(2.0), GroundingReuse::Kept)
    );
    // The warmth has not been part of the state so far.
    let warm = "(and (at r b) (>= (warmth a) 20))";
    assert_eq!(again(7, 9, 22, warm), (Some(2.0), GroundingReuse::Full));
    assert_eq!(again(7, 9, 19, warm).0, None);
}

#[test]
fn purely_numeric_actions_are_kept_if_their_numbers_are_compared() {
    let domain = domain(
        "(:requirements :typing :fluents :action-costs) (:types room)
         (:predicates (dry ?x - room)) (:functions (heat) (total-cost))
         (:action burn :parameters () :effect (and (increase (heat) 3) (increase (total-cost) 1)))
         (:action air :parameters (?x - room) :precondition (>= (heat) 5)
           :effect (and (dry ?x) (increase (total-cost) 1)))",
    );
    let mut replanner = Replanner::default();
    let mut again = |heat, goal: &str| {
        let problem = problem(&format!(
            "(:objects a b - room) (:init (= (heat) {heat}) (= (total-cost) 0))
             (:goal {goal}) (:metric minimize (total-cost))"
        ));
        let (domain, problem) = parse(&domain, &problem);
        let found = replanner.plan(&domain, &problem, &[], &Options::default(), &Cancel::new());
        let found = found.expect("it can");
        (found.outcome.plan.map(|plan| plan.steps.len()), found.grounding_reuse)
    };
    assert_eq!(again(0, "(dry a)"), (Some(3), GroundingReuse::Full));
    assert_eq!(again(2, "(and (dry a) (dry b))"), (Some(3), GroundingReuse::Kept));
    assert_eq!(again(5, "(dry b)"), (Some(1), GroundingReuse::Kept));
}

#[test]
fn actions_that_initialize_a_number_are_kept_if_it_is_changed() {
    let domain = domain(
        "(:requirements :fluents) (:predicates (done) (ready)) (:functions (count))
         (:action prepare :parameters () :effect (ready))
         (:action start :parameters () :precondition (ready) :effect (assign (count) 0))
         (:action go :parameters () :effect (and (done) (increase (count) 1)))",
    );
    let mut replanner = Replanner::default();
    let mut again = |init: &str| {
        let (domain, problem) = parse(&domain, &problem(&format!("(:init {init}) (:goal (done))")));
        let found = replanner.plan(&domain, &problem, &[], &Options::default(), &Cancel::new());
        found.expect("it can").outcome.plan.map(|plan| plan.steps.len())
    };
    assert_eq!(again(""), Some(3));
    assert_eq!(again("(ready)"), Some(2));
}

#[test]
fn invalid_texts_are_rejected_by_a_used_replanner() {
    let mut replanner = Replanner::default();
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut again = |parts: &str, text: &str| {
        let (domain, problem) = parse(&domain(parts), text);
        let found = replanner.plan(&domain, &problem, &[], &options, &cancel);
        (
            found.map(|found| found.grounding_reuse),
            planner::plan(&domain, &problem, &options, &cancel),
        )
    };
    assert_eq!(again(ROW, &row("b")).0, Ok(GroundingReuse::Full));
    let spoiled = [
        (ROW.to_owned(), row("b").replace("(at b)", "(at z)")),
        (ROW.to_owned(), row("b").replace("(:goal (at e))", "(:goal (at z))")),
        (ROW.to_owned(), row("b").replace("(:goal (at e))", "(:goal (near e))")),
        (ROW.to_owned(), row("b").replace("a b c d e)", "a b c d)")),
        (ROW.replacen("(next ?x ?y))\n", ")\n", 1), row("b")),
    ];
    for (parts, text) in spoiled {
        let (found, plain) = again(&parts, &text);
        assert_eq!(found, Err(plain.expect_err("it makes no sense")), "{parts} {text}");
        assert!(again(ROW, &row("c")).0.is_ok());
    }
    assert_eq!(again(ROW, &row("b")).0, Ok(GroundingReuse::Kept));
}

#[test]
fn ever_new_goals_do_not_fill_the_memory() {
    let mut replanner = Replanner::default();
    let (options, cancel) = (Options::default(), Cancel::new());
    let mut afresh = 0;
    for round in 0..2_500 {
        let goal = format!("(and (at r c) (>= (charge r) {}))", f64::from(round) / 1_000.0);
        let (domain, problem) = parse(&domain(BATTERY), &battery(3, 9, 20, &goal));
        let found = replanner.plan(&domain, &problem, &[], &options, &cancel).expect("it can");
        assert!(found.outcome.plan.is_some());
        afresh += u32::from(found.grounding_reuse == GroundingReuse::Full);
    }
    assert_eq!(afresh, 3, "once at first, and once for every thousand goals");
}
