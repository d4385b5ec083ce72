//! Brute force: searches all states with the validator's [`World`](planner::World), one step at a
//! time.

use std::collections::BTreeMap;

use pddl::{Domain, Name, PlanStep, Problem};
use planner::World;

/// Returns all grounded steps: every action with all combinations of objects for its parameters.
pub(crate) fn all_steps(domain: &Domain, problem: &Problem) -> Vec<PlanStep> {
    let objects: Vec<Name> = domain
        .constants
        .iter()
        .chain(problem.objects.iter().map(|declaration| &declaration.object))
        .map(|object| object.name.clone())
        .collect();
    let mut steps = Vec::new();
    for action in &domain.actions {
        let mut tuples: Vec<Vec<Name>> = vec![Vec::new()];
        for _ in action.all_parameters() {
            tuples = tuples
                .iter()
                .flat_map(|tuple| {
                    objects.iter().map(move |object| {
                        [tuple.as_slice(), std::slice::from_ref(object)].concat()
                    })
                })
                .collect();
        }
        steps.extend(tuples.into_iter().map(|tuple| PlanStep::new(action.name.clone(), tuple)));
    }
    steps
}

/// Error: the task has more states than the given maximum.
#[derive(Debug)]
pub(crate) struct TooLarge;

/// Returns the least cost of any plan, by Dijkstra's algorithm; `None` if there is no plan.
///
/// Costs are rounded to millionths, so that they can be ordered as integers.
pub(crate) fn least_cost(domain: &Domain, problem: &Problem) -> Option<f64> {
    least_cost_within(domain, problem, usize::MAX).expect("no bound")
}

/// As [`least_cost`], but returns an error if more than `states_max` states are reachable.
pub(crate) fn least_cost_within(
    domain: &Domain,
    problem: &Problem,
    states_max: usize,
) -> Result<Option<f64>, TooLarge> {
    let steps = all_steps(domain, problem);
    let start = World::initial(domain, problem).expect("the texts make sense");
    let mut known = BTreeMap::from([(key(&start), 0)]);
    let mut open = BTreeMap::from([((0, key(&start)), start)]);
    while let Some(((cost, id), world)) = open.pop_first() {
        if known[&id] < cost {
            continue;
        }
        if world.holds(&problem.goal) {
            return Ok(Some(cost as f64 / 1e6));
        }
        if known.len() > states_max {
            return Err(TooLarge);
        }
        for step in &steps {
            let mut next = world.clone();
            if next.apply(step).is_err() {
                continue;
            }
            let cost = (next.cost().expect("the metric has a value") * 1e6).round() as i64;
            let id = key(&next);
            if known.get(&id).is_none_or(|best| cost < *best) {
                known.insert(id.clone(), cost);
                open.insert((cost, id), next);
            }
        }
    }
    Ok(None)
}

fn key(world: &World) -> String {
    world.atoms().map(|atom| atom.to_string()).collect()
}
