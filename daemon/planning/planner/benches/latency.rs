//! Measures the latency of planning for a building, first and after a change. Prints the median and
//! the 99th percentile beside their targets.
//!
//! ```text
//! cargo bench -p planner --bench latency
//! ```
//!
//! The problems are those of `scenarios`. “Cold” is the time from the texts to a validated plan.
//! “Warm” is the time of a planner that has planned before, after one change: an agent offers no
//! actions any more or offers them again, or a robot has moved. Each agent and each place is
//! changed in turn, even if that makes the goal unreachable.

use std::time::Instant;

mod scenarios;

use pddl::Problem;
use planner::{Cancel, GroundingReuse, Options, Replanner, plan};
use scenarios::{SCENARIOS, events, parse};

/// Targets in milliseconds: the median and the 99th percentile.
const COLD_AIM: (f64, f64) = (0.5, 2.0);
const WARM_AIM: (f64, f64) = (0.3, 0.3);

fn main() {
    // Without `--bench`, Cargo only checks that the benchmark runs.
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
            answer.expect("it is supported").grounding_reuse
        };
        again(&problem);
        let warm = times(rounds, |round| {
            let event = &events[round % events.len()];
            assert_eq!(again(event), GroundingReuse::Kept, "{name} is ground once");
        });
        tell(name, &format!("replan, {} events", events.len()), warm, WARM_AIM);
    }
}

/// Returns the median and the 99th percentile, in milliseconds.
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
