//! Plan neighborhood graph search: finds shortcuts between the states of a plan (Nakhost and
//! Müller, 2010).
//!
//! First, states near the plan are collected breadth-first from all states of the plan at once,
//! within the limits. Then the cheapest path through the collected states is computed. No heuristic
//! is used that could mislead the search: if a plan makes a detour, this search finds the shortcut.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::optimal::weight;
use crate::arena;
use crate::heuristic::Weights;
use crate::limits::Cancel;
use crate::progression::Progression;
use crate::state::{StateId, StateSpace, all_hold};
use crate::successors::SuccessorGenerator;
use crate::task::{OperatorId, Task};

/// Limits of the search for shortcuts near a plan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NeighborhoodLimits {
    /// Maximum number of generated transitions (states with one of their operators applied). At the
    /// limit, the states and transitions generated so far are searched.
    pub(crate) steps_max: u64,
    /// Maximum number of bytes of states and transitions. At the limit, the states and transitions
    /// generated so far are searched.
    pub(crate) bytes_max: usize,
}

/// States near a plan, and the transitions between them.
struct Neighborhood<'t> {
    task: &'t Task,
    space: StateSpace,
    /// Per expanded state, in the order of ids: the index of its first transition. The last entry
    /// is the end of all transitions.
    starts: Vec<usize>,
    steps: Vec<(StateId, OperatorId)>,
}

/// Searches the neighborhood of `plan` for a plan that is cheaper, or as cheap with fewer steps;
/// `None` if there is no such plan.
pub(crate) fn cheaper(
    task: &Task,
    generator: &SuccessorGenerator,
    plan: &[OperatorId],
    extent: NeighborhoodLimits,
    cancel: &Cancel,
) -> Option<Vec<OperatorId>> {
    let neighborhood = Neighborhood::gather(task, generator, plan, extent, cancel);
    neighborhood.cheapest(weight(task, plan), cancel)
}

// === impl Neighborhood ===

impl<'t> Neighborhood<'t> {
    fn gather(
        task: &'t Task,
        generator: &SuccessorGenerator,
        plan: &[OperatorId],
        extent: NeighborhoodLimits,
        cancel: &Cancel,
    ) -> Neighborhood<'t> {
        let mut progression = Progression::new(task);
        let mut space = StateSpace::new(&progression.initial());
        let (mut next, mut from) = (Vec::new(), StateId(0));
        for &id in plan {
            if !progression.apply(task.operator(id), space.state(from), &mut next) {
                break;
            }
            (from, _) = space.insert(&next, from, id);
        }
        let mut gathered = Neighborhood { task, space, starts: vec![0], steps: Vec::new() };
        let mut applicable = Vec::new();
        // Ids ascend in the order of insertion, so iterating over them is a breadth-first search.
        for id in (0..).map(StateId) {
            let is_end = id.0 as usize >= gathered.space.len() || cancel.is_set();
            if is_end || gathered.steps.len() as u64 >= extent.steps_max {
                break;
            }
            if gathered.bytes() >= extent.bytes_max {
                break;
            }
            generator.applicable(task, gathered.space.state(id), &mut applicable);
            for &operator in &applicable {
                let state = gathered.space.state(id);
                if progression.apply(task.operator(operator), state, &mut next) {
                    let (to, _) = gathered.space.insert(&next, id, operator);
                    arena::make_room(&mut gathered.steps, 1);
                    gathered.steps.push((to, operator));
                }
            }
            gathered.starts.push(gathered.steps.len());
        }
        gathered
    }

    /// Returns the number of bytes of the neighborhood, including those for Dijkstra's algorithm.
    fn bytes(&self) -> usize {
        let per_state = size_of::<u64>() + 2 * size_of::<(u64, StateId)>();
        self.space.bytes() + self.space.len() * per_state + arena::bytes(&self.steps, 1)
    }

    /// Returns the cheapest path to a goal state; `None` if no path weighs less than `bound`.
    fn cheapest(mut self, bound: u64, cancel: &Cancel) -> Option<Vec<OperatorId>> {
        let mut weights = vec![u64::MAX; self.space.len()];
        let mut open = BinaryHeap::from([Reverse((0, StateId(0)))]);
        weights[0] = 0;
        while let Some(Reverse((spent, id))) = open.pop() {
            if spent > weights[id.0 as usize] {
                continue;
            }
            if spent >= bound || cancel.is_set() {
                return None;
            }
            if all_hold(self.space.state(id), &self.task.goal) {
                return Some(self.space.path(id));
            }
            let Some(range) = self.starts.get(id.0 as usize..id.0 as usize + 2) else { continue };
            for &(to, operator) in &self.steps[range[0]..range[1]] {
                let step = Weights::CostThenSteps.weight(self.task, self.task.operator(operator));
                let spent = spent.saturating_add(step);
                if spent < weights[to.0 as usize] {
                    weights[to.0 as usize] = spent;
                    self.space.reparent(to, id, operator);
                    open.push(Reverse((spent, to)));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::heuristic::LandmarkCut;
    use crate::limits::Budget;
    use crate::search::optimal::AStar;
    use crate::search::run;
    use crate::test_tasks::{task, texts, with_goal};

    const ALL: NeighborhoodLimits =
        NeighborhoodLimits { steps_max: u64::MAX, bytes_max: usize::MAX };

    fn found(
        task: &Task,
        plan: &[OperatorId],
        extent: NeighborhoodLimits,
    ) -> Option<Vec<OperatorId>> {
        cheaper(task, &SuccessorGenerator::new(task), plan, extent, &Cancel::new())
    }

    /// Returns the plan of a random walk, or `None` if the walk does not reach the goal. `choices`
    /// determine the operators.
    fn strolled(task: &Task, choices: &[usize]) -> Option<Vec<OperatorId>> {
        let generator = SuccessorGenerator::new(task);
        let mut progression = Progression::new(task);
        let (mut state, mut next) = (progression.initial(), Vec::new());
        let (mut plan, mut applicable) = (Vec::new(), Vec::new());
        for choice in choices {
            generator.applicable(task, &state, &mut applicable);
            let operator = *applicable.get(choice % applicable.len().max(1))?;
            if progression.apply(task.operator(operator), &state, &mut next) {
                std::mem::swap(&mut state, &mut next);
                plan.push(operator);
            }
            if all_hold(&state, &task.goal) {
                return Some(plan);
            }
        }
        None
    }

    proptest! {
        /// Without limits, the result is a cheapest plan. There is no result if the given plan is
        /// already a cheapest plan.
        #[test]
        fn an_unlimited_neighborhood_contains_a_cheapest_plan(
            (actions, initial) in texts(),
            choices in prop::collection::vec(0..64_usize, 1..40),
        ) {
            let Some(task) = with_goal(&actions, &initial, "(z)") else { return Ok(()) };
            let Some(plan) = strolled(&task, &choices) else { return Ok(()) };
            let generator = SuccessorGenerator::new(&task);
            let evaluator = Box::new(LandmarkCut::new(&task));
            let mut search = AStar::new(&task, &generator, evaluator, u64::MAX, u64::MAX);
            let cheapest = run(&mut search, Budget::default(), &Cancel::new(), &mut |_| ());
            let cheapest = weight(&task, &cheapest.expect("there is a plan"));
            let found = found(&task, &plan, ALL);
            prop_assert_eq!(weight(&task, found.as_ref().unwrap_or(&plan)), cheapest);
            prop_assert_eq!(found.is_some(), cheapest < weight(&task, &plan));
        }
    }

    #[test]
    fn a_detour_is_shortened_within_the_limits() {
        let task = task(
            "(define (domain d) (:predicates (at ?x) (door ?x ?y))
               (:action go :parameters (?x ?y) :precondition (and (at ?x) (door ?x ?y))
                 :effect (and (not (at ?x)) (at ?y))))",
            "(define (problem p) (:domain d) (:objects a b c e)
               (:init (at a) (door a b) (door b c) (door c e) (door a e)) (:goal (at e)))",
        );
        let around = strolled(&task, &[0, 0, 0]).filter(|plan| plan.len() == 3);
        let around = around.or_else(|| strolled(&task, &[1, 0, 0])).expect("both doors lead there");
        assert_eq!(around.len(), 3);
        let shorter = found(&task, &around, ALL).expect("there is a door");
        assert_eq!(shorter.len(), 1);
        assert_eq!(found(&task, &shorter, ALL), None);
        assert_eq!(found(&task, &around, NeighborhoodLimits { steps_max: 0, ..ALL }), None);
        assert_eq!(found(&task, &around, NeighborhoodLimits { bytes_max: 0, ..ALL }), None);
    }
}
