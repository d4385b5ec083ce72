//! How long a building waits for an answer, and for another one when something has changed: medians
//! and the slowest of a hundred, beside their aims.
//!
//! ```text
//! cargo bench -p planner --bench latency
//! ```
//!
//! The problems are those of `scenarios/`, as in office.rs. Cold: from texts to a validated plan.
//! Warm: a planner that has planned before, told that an agent offers nothing any more, is back, or
//! that a robot stands elsewhere; every agent and every place in turn, solvable or not.

use std::time::Instant;

use pddl::{Domain, InitElement, Problem, Term};
use planner::{Cancel, Grounding, Options, Replanner, plan};

/// A scenario's name, its domain and its problem.
macro_rules! scenario {
    ($name:literal) => {
        (
            $name,
            include_str!(concat!("scenarios/", $name, "/domain.pddl")),
            include_str!(concat!("scenarios/", $name, "/problem.pddl")),
        )
    };
}

const SCENARIOS: [(&str, &str, &str); 5] = [
    scenario!("1-temperatures"),
    scenario!("2-two-robots"),
    scenario!("3-validation"),
    scenario!("4-screen"),
    scenario!("4-video-robot"),
];

/// In milliseconds: the median, and the slowest of a hundred.
const COLD_AIM: (f64, f64) = (0.5, 2.0);
const WARM_AIM: (f64, f64) = (0.3, 0.3);

fn main() {
    // Cargo tries whether the benchmark runs when it tests.
    let is_measured = std::env::args().any(|argument| argument == "--bench");
    let rounds = if is_measured { 2_000 } else { 2 };
    for (name, domain, problem) in SCENARIOS {
        let cold = times(rounds, |_| {
            let (domain, problem) = parse(domain, problem);
            let outcome = plan(&domain, &problem, &Options::default(), &Cancel::new());
            assert!(outcome.expect("it is supported").plan.is_some(), "{name} has a plan");
        });
        tell(name, "text to validated plan", cold, COLD_AIM);
        let (domain, problem) = parse(domain, problem);
        let events = events(&problem);
        let mut replanner = Replanner::default();
        let mut again = |problem: &Problem| {
            let (options, cancel) = (Options::default(), Cancel::new());
            let answer = replanner.plan(&domain, problem, &[], &options, &cancel);
            answer.expect("it is supported").grounding
        };
        again(&problem);
        let warm = times(rounds, |round| {
            let event = &events[round % events.len()];
            assert_eq!(again(event), Grounding::Kept, "{name} is ground once");
        });
        tell(name, &format!("replan, {} events", events.len()), warm, WARM_AIM);
    }
}

fn parse(domain: &str, problem: &str) -> (Domain, Problem) {
    let domain = pddl::parse_domain(domain).into_result().expect("it parses");
    (domain, pddl::parse_problem(problem).into_result().expect("it parses"))
}

/// The problem after each thing that may happen to it.
fn events(problem: &Problem) -> Vec<Problem> {
    let mut events = vec![problem.clone()];
    let (mut agents, mut places) = (Vec::new(), Vec::new());
    let note = |all: &mut Vec<Term>, one: &Term| {
        if !all.contains(one) {
            all.push(one.clone());
        }
    };
    for element in &problem.init {
        let InitElement::Atom(atom) = element else { continue };
        let name = atom.predicate.as_str();
        match atom.arguments.as_slice() {
            [agent] if name.starts_with("offers-") => note(&mut agents, agent),
            [place, _] if name == "connected" => note(&mut places, place),
            _ => (),
        }
    }
    for agent in agents {
        let offers = |element: &InitElement| match element {
            InitElement::Atom(atom) => {
                atom.predicate.as_str().starts_with("offers-") && atom.arguments.contains(&agent)
            }
            _ => false,
        };
        let mut without = problem.clone();
        without.init.retain(|element| !offers(element));
        events.push(without);
    }
    let stands = |element: &InitElement| match element {
        InitElement::Atom(atom) => atom.predicate == "at",
        _ => false,
    };
    for index in (0..problem.init.len()).filter(|index| stands(&problem.init[*index])) {
        for place in &places {
            let mut moved = problem.clone();
            if let InitElement::Atom(atom) = &mut moved.init[index] {
                atom.arguments[1] = Term::clone(place);
            }
            events.push(moved);
        }
    }
    events
}

/// The median and the slowest of a hundred, in milliseconds.
fn times(rounds: usize, mut answer: impl FnMut(usize)) -> (f64, f64) {
    let mut took: Vec<f64> = Vec::with_capacity(rounds);
    for round in 0..rounds {
        let begun = Instant::now();
        answer(round);
        took.push(begun.elapsed().as_secs_f64() * 1_000.0);
    }
    took.sort_by(f64::total_cmp);
    (took[rounds / 2], took[rounds * 99 / 100])
}

fn tell(name: &str, what: &str, took: (f64, f64), aim: (f64, f64)) {
    let verdict = |took: f64, aim: f64| if took <= aim { "reached" } else { "missed" };
    println!(
        "{name}: {what}: p50 {:.3} ms, aim {}: {}; p99 {:.3} ms, aim {}: {}",
        took.0,
        aim.0,
        verdict(took.0, aim.0),
        took.1,
        aim.1,
        verdict(took.1, aim.1)
    );
}
