//! Merging: finds an order of the steps of several agents' plans in which all plans work together
//! and reach a goal.
//!
//! Each plan keeps its own order. Two steps of different plans threaten each other if their order
//! may matter ([`crate::order`]). A step that no remaining step of another plan threatens is taken
//! at once; only where there is a threat, both orders are tried, and the validator's state decides.
//! So the search is complete for plans that keep their order, up to its limit, and plans without
//! threats are joined without any search. Steps are neither added nor left out.

use std::collections::HashMap;

use pddl::{Condition, PlanStep};

use crate::validate::{Footprint, World};

/// Searches an order of the steps of `plans` that leads from `world` to `goal`. Of several orders,
/// the first one in the order of the plans is returned: all steps of the first plan, then all of
/// the second one, and so on, as far as this works. Returns `None` if there is no such order, or if
/// none was found among `states_max` states in which there was a choice.
pub fn merge(
    world: &World,
    plans: &[Vec<PlanStep>],
    goal: &Condition,
    states_max: usize,
) -> Option<Vec<PlanStep>> {
    let threats = Threats::between(world, plans);
    let mut search = MergeSearch { nodes: Vec::new(), seen: HashMap::new() };
    let positions = vec![0; plans.len()];
    let mut start = MergeNode { world: world.clone(), positions, parent: None, taken: Vec::new() };
    if !start.follow(plans, &threats) {
        return None;
    }
    let mut open = vec![search.add(start)?];
    while let Some(index) = open.pop() {
        let next = threats.choices(plans, &search.nodes[index].positions);
        if next.is_empty() && search.nodes[index].world.holds(goal) {
            return Some(search.steps(index, plans));
        }
        // The first plan is pushed last, so that it is continued first.
        for plan in next.into_iter().rev() {
            if search.nodes.len() >= states_max {
                return None;
            }
            let MergeNode { world, positions, .. } = &search.nodes[index];
            let (world, positions) = (world.clone(), positions.clone());
            let mut node = MergeNode { world, positions, parent: Some(index), taken: Vec::new() };
            if node.take(plan, plans) && node.follow(plans, &threats) {
                open.extend(search.add(node));
            }
        }
    }
    None
}

/// For each step of each plan: how many steps of each other plan must be taken before no remaining
/// step of that plan threatens it.
struct Threats(Vec<Vec<Vec<usize>>>);

/// A state that is reached by taking some first steps of each plan, and from which there are several
/// ways to go on, or none.
struct MergeNode {
    world: World,
    /// Number of taken steps of each plan.
    positions: Vec<usize>,
    parent: Option<usize>,
    /// The plans of the steps that led here from the parent, in their order.
    taken: Vec<usize>,
}

struct MergeSearch {
    nodes: Vec<MergeNode>,
    /// Nodes by their positions. Steps that do not threaten each other lead to the same state.
    seen: HashMap<Vec<usize>, Vec<usize>>,
}

// === impl Threats ===

impl Threats {
    fn between(world: &World, plans: &[Vec<PlanStep>]) -> Threats {
        let footprints: Vec<Vec<Footprint>> = { plans.iter() }
            .map(|plan| plan.iter().map(|step| world.footprint(step)).collect())
            .collect();
        let last_threat = |step: &Footprint, other: &[Footprint]| {
            other.iter().rposition(|their| step.must_wait_for(their)).map_or(0, |at| at + 1)
        };
        let of_plan = |(index, plan): (usize, &Vec<Footprint>)| {
            let of_step = |step: &Footprint| {
                let of_other = |(other, steps): (usize, &Vec<Footprint>)| match other == index {
                    true => 0,
                    false => last_threat(step, steps),
                };
                footprints.iter().enumerate().map(of_other).collect()
            };
            plan.iter().map(of_step).collect()
        };
        Threats(footprints.iter().enumerate().map(of_plan).collect())
    }

    /// Returns the plans with which to go on: a single one, if its next step is not threatened.
    fn choices(&self, plans: &[Vec<PlanStep>], positions: &[usize]) -> Vec<usize> {
        let unfinished: Vec<usize> =
            (0..plans.len()).filter(|plan| positions[*plan] < plans[*plan].len()).collect();
        let is_free = |plan: &&usize| {
            let threats = &self.0[**plan][positions[**plan]];
            threats.iter().zip(positions).all(|(last, taken)| last <= taken)
        };
        match unfinished.iter().find(is_free) {
            Some(free) => vec![*free],
            None => unfinished,
        }
    }
}

// === impl MergeNode ===

impl MergeNode {
    /// Takes the next step of a plan. Returns `false` if it cannot be applied.
    fn take(&mut self, plan: usize, plans: &[Vec<PlanStep>]) -> bool {
        let is_applied = self.world.apply(&plans[plan][self.positions[plan]]).is_ok();
        self.positions[plan] += 1;
        self.taken.push(plan);
        is_applied
    }

    /// Takes steps as long as there is a single choice. Returns `false` if one cannot be applied.
    fn follow(&mut self, plans: &[Vec<PlanStep>], threats: &Threats) -> bool {
        while let [only] = threats.choices(plans, &self.positions)[..] {
            if !self.take(only, plans) {
                return false;
            }
        }
        true
    }
}

// === impl MergeSearch ===

impl MergeSearch {
    /// Adds a node; returns `None` if an equal state was reached with the same steps before.
    fn add(&mut self, node: MergeNode) -> Option<usize> {
        let same = self.seen.entry(node.positions.clone()).or_default();
        if same.iter().any(|other| self.nodes[*other].world == node.world) {
            return None;
        }
        same.push(self.nodes.len());
        self.nodes.push(node);
        Some(self.nodes.len() - 1)
    }

    /// Returns the steps that lead to a node.
    fn steps(&self, last: usize, plans: &[Vec<PlanStep>]) -> Vec<PlanStep> {
        let mut steps = Vec::new();
        let mut positions = self.nodes[last].positions.clone();
        let mut next = Some(last);
        while let Some(index) = next {
            for plan in self.nodes[index].taken.iter().rev() {
                positions[*plan] -= 1;
                steps.push(plans[*plan][positions[*plan]].clone());
            }
            next = self.nodes[index].parent;
        }
        steps.reverse();
        steps
    }
}
