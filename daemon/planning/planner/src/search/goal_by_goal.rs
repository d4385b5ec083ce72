//! Search that reaches the parts of a goal one after the other: from a state with some parts, it
//! searches for a state with these and one more.
//!
//! The FF heuristic for all parts together often stands still, because a step that brings one part
//! nearer takes another one farther away. For one part alone it leads straight there. The parts are
//! serialized as by Lipovetzky and Geffner (“Width and Serialization of Classical Planning Problems”,
//! 2012), but the search between them is a greedy one with the FF heuristic.
//!
//! The search is incomplete, because a part may have to be given up for another one. It gives up
//! after little work.

use super::limit_reached;
use super::open::{OpenEntry, OpenList};
use super::preferred::Preferred;
use crate::heuristic::{Evaluator, FastForward};
use crate::limits::{Budget, Cancel};
use crate::progression::Progression;
use crate::state::{State, StateId, StateSpace, all_hold, holds};
use crate::successors::SuccessorGenerator;
use crate::task::{Literal, OperatorId, Task};

/// Maximum number of parts that are tried in one state. The parts with the lowest estimates come
/// first.
const PARTS_MAX: usize = 4;

/// Maximum number of evaluations of the search for one part.
const PART_EVALUATIONS_MAX: u64 = 3_000;

/// Maximum number of steps of the search for one part. Most of them lead to known states then.
const PART_STEPS_MAX: u64 = 100_000;

/// Maximum number of evaluations of the searches for all parts.
const EVALUATIONS_MAX: u64 = 100_000;

/// Limit on the work of the searches for all parts: the number of evaluations times the size of the
/// relaxation. The limit allows some tenths of a second.
const WORK_MAX: usize = 150_000_000;

/// Number of additional turns of the preferred operators whenever an estimate is lower than all
/// before.
const BOOST: i64 = 1_000;

/// Serialized search from the initial state of a task.
pub(crate) struct GoalByGoal<'t, 'h> {
    task: &'t Task,
    generator: &'t SuccessorGenerator,
    ff: &'h mut FastForward<'t>,
    progression: Progression<'t>,
    budget: Budget,
    cancel: &'h Cancel,
    evaluations_max: u64,
    /// Number of states evaluated so far.
    pub(crate) evaluations: u64,
    /// Number of states expanded so far.
    pub(crate) expansions: u64,
}

/// Operators to apply, and the state after them.
type Stretch = (Vec<OperatorId>, Vec<u64>);

/// The open lists of the search for one part. Both contain the same states.
struct PartLists {
    all: OpenList,
    preferred: OpenList,
    operators: Preferred,
    /// Turns of `preferred` less turns of `all`.
    ahead: i64,
    lowest: u64,
}

// === impl GoalByGoal ===

impl<'t, 'h> GoalByGoal<'t, 'h> {
    pub(crate) fn new(
        task: &'t Task,
        generator: &'t SuccessorGenerator,
        ff: &'h mut FastForward<'t>,
        (budget, cancel): (Budget, &'h Cancel),
    ) -> GoalByGoal<'t, 'h> {
        let evaluations_max = EVALUATIONS_MAX.min((WORK_MAX / ff.size().max(1)) as u64);
        GoalByGoal {
            task,
            generator,
            ff,
            progression: Progression::new(task),
            budget,
            cancel,
            evaluations_max,
            evaluations: 0,
            expansions: 0,
        }
    }

    /// Returns a plan; `None` if no part can be added within the limits, those of the budget included.
    pub(crate) fn run(&mut self) -> Option<Vec<OperatorId>> {
        let plan = self.add_parts();
        self.ff.set_goal(&self.task.goal);
        plan
    }

    fn add_parts(&mut self) -> Option<Vec<OperatorId>> {
        let mut state = self.progression.initial();
        let mut plan = Vec::new();
        while !all_hold(&state, &self.task.goal) {
            let (steps, next) = self.add_part(&state)?;
            plan.extend(steps);
            state = next;
        }
        Some(plan)
    }

    /// Searches for a state with the parts of the goal that `from` has, and one more. The whole goal
    /// must be reachable from there in the delete relaxation.
    fn add_part(&mut self, from: &State) -> Option<Stretch> {
        if self.is_over() {
            return None;
        }
        self.ff.set_goal(&self.task.goal);
        self.evaluate(from)?;
        let (mut parts, missing): (Vec<Literal>, Vec<Literal>) =
            self.task.goal.iter().partition(|part| holds(from, **part));
        let mut missing: Vec<(u64, Literal)> =
            missing.into_iter().map(|part| (self.ff.part_cost(part), part)).collect();
        missing.sort_by_key(|(cost, part)| (*cost, part.index()));
        for (_, part) in missing.into_iter().take(PARTS_MAX) {
            if self.is_over() {
                return None;
            }
            parts.push(part);
            if let Some((steps, next)) = self.search(from, &parts) {
                self.ff.set_goal(&self.task.goal);
                if self.evaluate(&next).is_some() {
                    return Some((steps, next));
                }
            }
            parts.pop();
        }
        None
    }

    /// Whether no further part may be tried.
    fn is_over(&self) -> bool {
        let is_limited = || limit_reached(self.budget, self.expansions, 0, self.cancel).is_some();
        self.evaluations >= self.evaluations_max || is_limited()
    }

    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.evaluations += 1;
        self.ff.evaluate(state)
    }

    /// Searches for a state with all of `parts`: greedily, with deferred evaluation.
    fn search(&mut self, from: &State, parts: &[Literal]) -> Option<Stretch> {
        self.ff.set_goal(parts);
        let estimate = self.evaluate(from)?;
        let evaluations_max = self.evaluations_max.min(self.evaluations + PART_EVALUATIONS_MAX);
        let mut space = StateSpace::new(from);
        let mut lists = PartLists::new();
        lists.push(StateId(0), Some(estimate), self.ff.preferred());
        let mut successor = Vec::new();
        for _ in 0..PART_STEPS_MAX {
            if self.evaluations >= evaluations_max {
                return None;
            }
            let bytes = space.bytes() + lists.bytes() + self.ff.bytes();
            if limit_reached(self.budget, self.expansions, bytes, self.cancel).is_some() {
                return None;
            }
            let (parent, id) = lists.pop(|state, found| {
                self.generator.applicable(self.task, space.state(state), found);
            })?;
            let operator = self.task.operator(id);
            if !self.progression.apply(operator, space.state(parent), &mut successor) {
                continue;
            }
            let (child, is_new) = space.insert(&successor, parent, id);
            if !is_new {
                continue;
            }
            if all_hold(&successor, parts) {
                return Some((space.path(child), successor));
            }
            let estimate = self.evaluate(&successor);
            self.expansions += 1;
            lists.push(child, estimate, self.ff.preferred());
        }
        None
    }
}

// === impl PartLists ===

impl PartLists {
    fn new() -> PartLists {
        PartLists {
            all: OpenList::default(),
            preferred: OpenList::default(),
            operators: Preferred::default(),
            ahead: 0,
            lowest: u64::MAX,
        }
    }

    /// Adds a state, with its estimate and its preferred operators. A state without an estimate is a
    /// dead end, and is left out.
    fn push(&mut self, state: StateId, estimate: Option<u64>, preferred: &[OperatorId]) {
        let Some(estimate) = estimate else { return };
        self.operators.set(state, preferred, preferred.len());
        if estimate < self.lowest {
            self.lowest = estimate;
            self.ahead -= BOOST;
        }
        self.all.push((estimate, 0, 0), state);
        self.preferred.push((estimate, 0, 0), state);
    }

    /// Returns the next operator of a state; `None` if no list has one. `applicable` computes all
    /// operators of a state, which include the preferred ones.
    fn pop(&mut self, applicable: impl FnMut(StateId, &mut Vec<OperatorId>)) -> Option<OpenEntry> {
        if self.ahead <= 0 {
            let operators = &self.operators;
            let found = self.preferred.pop(|state, found| {
                found.extend_from_slice(operators.all(state));
            });
            if found.is_some() {
                self.ahead += 1;
                return found;
            }
        }
        self.ahead -= 1;
        self.all.pop(applicable)
    }

    /// Returns the number of bytes of the lists.
    fn bytes(&self) -> usize {
        self.all.bytes() + self.preferred.bytes() + self.operators.bytes()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::heuristic::Weights;
    use crate::test_tasks::{assert_reaches_the_goal, conjunction, task, texts, with_goal};

    fn plan(task: &Task) -> (Option<Vec<OperatorId>>, u64) {
        let generator = SuccessorGenerator::new(task);
        let mut ff = FastForward::new(task, Weights::Unit);
        let (budget, cancel) = (Budget::default(), Cancel::new());
        let mut search = GoalByGoal::new(task, &generator, &mut ff, (budget, &cancel));
        let plan = search.run();
        (plan, search.evaluations)
    }

    /// A step towards one plant is a step away from the other one.
    #[test]
    fn parts_in_opposite_directions_are_reached_one_after_the_other() {
        let domain = "(define (domain d) (:types plant) (:predicates (seen ?p - plant))
            (:functions (x) (y) (column ?p - plant) (row ?p - plant))
            (:action right :parameters () :precondition (<= (x) 99) :effect (increase (x) 1))
            (:action left :parameters () :precondition (>= (x) 1) :effect (decrease (x) 1))
            (:action up :parameters () :precondition (<= (y) 99) :effect (increase (y) 1))
            (:action down :parameters () :precondition (>= (y) 1) :effect (decrease (y) 1))
            (:action see :parameters (?p - plant)
              :precondition (and (= (x) (column ?p)) (= (y) (row ?p))) :effect (seen ?p)))";
        let problem = "(define (problem p) (:domain d) (:objects a b c e - plant)
            (:init (= (x) 50) (= (y) 50) (= (column a) 10) (= (row a) 10) (= (column b) 90)
              (= (row b) 90) (= (column c) 10) (= (row c) 90) (= (column e) 90) (= (row e) 10))
            (:goal (and (seen a) (seen b) (seen c) (seen e))))";
        let task = task(domain, problem);
        let (plan, evaluations) = plan(&task);
        let plan = plan.expect("a plan");
        assert_reaches_the_goal(&task, &plan);
        assert_eq!(plan.len(), 80 + 3 * 80 + 4, "without detours");
        assert!(evaluations < 8 * plan.len() as u64, "{evaluations}");
    }

    /// The key breaks in the first door, and the left door takes the spare one, too.
    #[test]
    fn a_part_after_which_the_goal_is_out_of_reach_is_not_added() {
        let domain = "(define (domain d) (:predicates (key) (spare) (left) (right))
            (:action open-left :parameters () :precondition (key)
              :effect (and (left) (not (key)) (not (spare))))
            (:action open-right :parameters () :precondition (key) :effect (and (right) (not (key))))
            (:action take :parameters () :precondition (spare) :effect (key)))";
        // One of the two orders of the parts tries the left door first.
        for [one, other] in [["left", "right"], ["right", "left"]] {
            let domain = domain.replace("(left) (right)", &format!("({one}) ({other})"));
            let problem = format!(
                "(define (problem p) (:domain d) (:init (key) (spare))
                (:goal (and ({one}) ({other}))))"
            );
            let task = task(&domain, &problem);
            let plan = plan(&task).0.expect("a plan");
            assert_reaches_the_goal(&task, &plan);
            let steps: Vec<String> = plan.iter().map(|id| task.step(*id).to_string()).collect();
            assert_eq!(steps, ["(open-right)", "(take)", "(open-left)"]);
        }
    }

    /// Each of two rooms is entered only from the other one.
    fn swaps() -> Task {
        let domain = "(define (domain d) (:predicates (in ?x) (marked ?x) (next ?x ?y))
            (:action go :parameters (?x ?y) :precondition (and (in ?x) (next ?x ?y))
              :effect (and (not (in ?x)) (in ?y) (marked ?y) (not (marked ?x)))))";
        let problem = "(define (problem p) (:domain d) (:objects a b c)
            (:init (in a) (next a b) (next b c) (next c a))
            (:goal (and (marked a) (marked b) (marked c))))";
        task(domain, problem)
    }

    #[test]
    fn the_heuristic_has_the_whole_goal_after_a_failed_search() {
        let task = swaps();
        let (generator, budget, cancel) =
            (SuccessorGenerator::new(&task), Budget::default(), Cancel::new());
        let mut ff = FastForward::new(&task, Weights::Unit);
        assert_eq!(GoalByGoal::new(&task, &generator, &mut ff, (budget, &cancel)).run(), None);
        let initial = Progression::new(&task).initial();
        let mut fresh = FastForward::new(&task, Weights::Unit);
        assert_eq!(ff.evaluate(&initial), fresh.evaluate(&initial));
        assert_eq!(ff.preferred(), fresh.preferred());
        assert_eq!(ff.relaxed_plan(), fresh.relaxed_plan());
    }

    #[test]
    fn the_limits_of_a_call_are_kept() {
        let task = swaps();
        let generator = SuccessorGenerator::new(&task);
        let evaluations = |budget, cancel: &Cancel| {
            let mut ff = FastForward::new(&task, Weights::Unit);
            let mut search = GoalByGoal::new(&task, &generator, &mut ff, (budget, cancel));
            assert_eq!(search.run(), None);
            (search.evaluations, search.expansions)
        };
        let cancelled = Cancel::new();
        cancelled.set();
        assert_eq!(evaluations(Budget::default(), &cancelled), (0, 0));
        let none = Budget { expansions_max: 0, ..Budget::default() };
        assert_eq!(evaluations(none, &Cancel::new()), (0, 0));
        let few = Budget { expansions_max: 2, ..Budget::default() };
        assert_eq!(evaluations(few, &Cancel::new()).1, 2);
        let small = Budget { memory_max_bytes: 1, ..Budget::default() };
        assert_eq!(evaluations(small, &Cancel::new()).1, 0);
        assert!(evaluations(Budget::default(), &Cancel::new()).1 > 2);
    }

    proptest! {
        #[test]
        fn a_plan_reaches_the_goal(
            (actions, initial) in texts(),
            goal in conjunction(),
        ) {
            let Some(task) = with_goal(&actions, &initial, goal) else { return Ok(()) };
            if let (Some(plan), _) = plan(&task) {
                assert_reaches_the_goal(&task, &plan);
            }
        }
    }
}
