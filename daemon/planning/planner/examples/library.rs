//! Uses the planner as a library: parses, plans, orders the steps, replans, and explains.
//!
//! `cargo run -p planner --example library`
//!
//! The task is the office of the benchmarks: sensors on walls, and two robots that carry sensors.
//! The planner uses no clock and no files; `tasks.rs` shows how a caller sets a deadline.

use std::error::Error;

use pddl::{Diagnostic, Domain, InitElement, Plan, Problem};
use planner::{Budget, Cancel, Options, Replanner, Verdict, World, explain, order, plan, validate};

const DOMAIN: &str = include_str!("../benches/office/domain.pddl");
const PROBLEM: &str = include_str!("../benches/office/problem.pddl");

fn main() -> Result<(), Box<dyn Error>> {
    let domain = pddl::parse_domain(DOMAIN).into_result().map_err(first)?;
    let problem = pddl::parse_problem(PROBLEM).into_result().map_err(first)?;
    let (options, cancel) = (Options::default(), Cancel::new());

    // One call from texts to a validated plan.
    let outcome = plan(&domain, &problem, &options, &cancel)?;
    let Some(found) = outcome.plan else {
        return Err(format!("no plan: {}", outcome.stop_reason).into());
    };
    println!("a plan of {} steps:\n{found}", found.steps.len());
    println!("proved to be the cheapest: {}\n", outcome.statistics.proven_optimal);
    in_order(&domain, &problem, &found)?;

    // The validator can be used alone, for a plan from any source.
    let shorter = Plan { steps: found.steps[1..].to_vec(), cost: None };
    let verdict = validate(&domain, &problem, &shorter);
    println!(
        "without its first step: {}\n",
        if is_valid(&verdict) { "valid" } else { "not valid" }
    );

    // A `Replanner` keeps the ground problem, for callers that plan repeatedly.
    let mut replanner = Replanner::default();
    replanner.plan(&domain, &problem, &[], &options, &cancel)?;
    let changed = without(&problem, "(located thermo2 office2)");
    let replanned = replanner.plan(&domain, &changed, &found.steps, &options, &cancel)?;
    println!(
        "without thermo2, {:?}, grounding {:?}:",
        replanned.plan_reuse, replanned.grounding_reuse
    );
    println!("{}", replanned.outcome.plan.map(|plan| plan.to_string()).unwrap_or_default());

    // If there is no plan, the planner can explain why.
    let closed = without(&problem, "(connected hall kitchen)");
    let outcome = plan(&domain, &closed, &options, &cancel)?;
    println!("without a door to the kitchen: {}", outcome.stop_reason);
    let memory = Budget::default().memory_max_bytes;
    let why = explain::why_unsolvable(&domain, &closed, memory, &cancel)?;
    for (part, reason) in &why.parts {
        println!("{part}: {reason}");
    }
    Ok(())
}

/// Prints the steps in rounds. The steps of one round can run in parallel.
fn in_order(domain: &Domain, problem: &Problem, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let world = World::initial(domain, problem).map_err(first)?;
    let order = order::deorder(&world, &plan.steps);
    let mut done = vec![false; plan.steps.len()];
    for round in 1.. {
        let ready = order.ready(&done);
        if ready.is_empty() {
            break;
        }
        for step in ready {
            println!("round {round}: {}", plan.steps[step]);
            done[step] = true;
        }
    }
    println!();
    Ok(())
}

fn is_valid(verdict: &Verdict) -> bool {
    matches!(verdict, Verdict::Valid { .. })
}

/// Returns the problem without one fact of its initial state.
fn without(problem: &Problem, fact: &str) -> Problem {
    let mut problem = problem.clone();
    problem.init.retain(|element: &InitElement| element.to_string() != fact);
    problem
}

/// Returns the first of several diagnostics, as an error.
fn first(diagnostics: Vec<Diagnostic>) -> Box<dyn Error> {
    match diagnostics.into_iter().next() {
        Some(diagnostic) => diagnostic.into(),
        None => "the text is not correct".into(),
    }
}
