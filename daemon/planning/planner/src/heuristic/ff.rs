//! The FF heuristic: the cost of a plan for the delete relaxation (Hoffmann and Nebel, 2001). The
//! best supporters are those of h_add (Keyder and Geffner, 2008).

use super::Evaluator;
use super::additive::{AdditiveHeuristic, NO_SUPPORTER};
use super::deficits::{Cover, Deficits};
use super::relaxation::{Relaxation, Weights};
use crate::state::{State, all_hold};
use crate::task::{Literal, OperatorId, Task};

/// Maximum length of the stored relaxed plan; further steps are not stored. A longer plan is
/// unlikely to be executable.
const PLAN_MAX: usize = 10_000;

/// Maximum number of rounds in which deficits of a relaxed plan are covered. To cover one may cause
/// another, along a chain of counters for instance, or again and again.
const ROUNDS_MAX: usize = 8;

/// Number of occurrences of an operator in a relaxed plan.
#[derive(Clone, Copy, Debug, Default)]
struct OperatorMark {
    /// Number of the evaluation that set the mark. The mark of an earlier evaluation is treated as
    /// zero.
    evaluation: u32,
    times: u32,
}

/// The FF heuristic of a task.
#[derive(Debug)]
pub(crate) struct FastForward<'t> {
    task: &'t Task,
    relaxation: Relaxation,
    additive: AdditiveHeuristic,
    /// Preferred operators: first those of the relaxed plan before its deficits were covered.
    preferred: Vec<OperatorId>,
    plain_count: usize,
    /// Applicable operators that approach a comparison of the relaxed plan.
    helpful: Vec<OperatorId>,
    /// Last relaxed plan, unordered. An operator that must be repeated occurs several times.
    plan: Vec<OperatorId>,
    /// Per proposition: the number of the last evaluation that visited it.
    marks: Vec<u32>,
    operator_marks: Vec<OperatorMark>,
    evaluation: u32,
    waiting: Vec<u32>,
    /// Operators of the last relaxed plan, each once.
    chosen: Vec<OperatorId>,
    /// Deficits of relaxed plans; `None` for a task without numbers.
    deficits: Option<Deficits>,
    /// Whether relaxed plans cover their deficits.
    covers_deficits: bool,
    covers: Vec<Cover>,
    /// Goals that require a sum of several numbers to have one value.
    balances: Vec<u32>,
    /// Cost of the last relaxed plan before its deficits were covered. Each balance that does not hold
    /// counts as one.
    plain_estimate: u64,
}

// === impl FastForward ===

impl<'t> FastForward<'t> {
    pub(crate) fn new(task: &'t Task, weights: Weights) -> FastForward<'t> {
        let relaxation = Relaxation::simplified(task, weights);
        let deficits = Deficits::new(task, &relaxation);
        FastForward {
            balances: deficits.iter().flat_map(|one| one.balances()).collect(),
            task,
            additive: AdditiveHeuristic::new(&relaxation),
            preferred: Vec::new(),
            plain_count: 0,
            helpful: Vec::new(),
            plan: Vec::new(),
            marks: vec![0; relaxation.proposition_count()],
            operator_marks: vec![OperatorMark::default(); task.operators.len()],
            evaluation: 0,
            waiting: Vec::new(),
            chosen: Vec::new(),
            deficits,
            covers_deficits: true,
            covers: Vec::new(),
            plain_estimate: 0,
            relaxation,
        }
    }

    /// Returns the size of the relaxation, which is a measure of the work of one evaluation.
    pub(crate) fn size(&self) -> usize {
        self.relaxation.size()
    }

    /// Returns the delete relaxation that this heuristic plans in.
    pub(crate) fn relaxation(&self) -> &Relaxation {
        &self.relaxation
    }

    /// Returns the operators of the last relaxed plan, unordered.
    pub(crate) fn relaxed_plan(&self) -> &[OperatorId] {
        &self.plan
    }

    /// Returns the propositions that the last relaxed plan makes true and that do not hold in the
    /// evaluated state.
    pub(crate) fn relaxed_propositions(&self) -> Vec<u32> {
        let marked = (0..self.marks.len()).filter(|one| self.marks[*one] == self.evaluation);
        marked.map(|one| one as u32).filter(|one| !self.is_given(*one)).collect()
    }

    /// Returns the h_add cost of the most expensive positive precondition of an operator. Sorting
    /// operators by this cost gives an ordered relaxed plan.
    pub(crate) fn depth(&self, operator: OperatorId) -> u64 {
        let preconditions = self.task.operator(operator).preconditions.iter();
        let costs = preconditions
            .filter(|literal| literal.is_positive())
            .map(|literal| u64::from(self.additive.cost(literal.fact().0)));
        costs.max().unwrap_or(0)
    }

    /// Sets whether relaxed plans cover their deficits from now on.
    pub(crate) fn set_covering(&mut self, covers: bool) {
        self.covers_deficits = covers;
    }

    /// Replaces the goal by other literals that the goal of the task contains.
    pub(crate) fn set_goal(&mut self, goal: &[Literal]) {
        self.relaxation.set_goal(goal);
        self.additive.set_goal(&self.relaxation);
    }

    /// Returns the h_add cost of a part of the goal in the last evaluated state.
    pub(crate) fn part_cost(&self, part: Literal) -> u64 {
        let proposition = self.relaxation.proposition(part);
        proposition.map_or(0, |one| u64::from(self.additive.cost(one)))
    }

    /// Whether an operator can reach the bound of a comparison, so that deficits can be covered.
    pub(crate) fn may_have_deficits(&self) -> bool {
        self.deficits.is_some()
    }

    /// Returns the last estimate without the cost of covering deficits. Where deficits mislead, such
    /// as that of a tank which need not be full, it is the better one.
    pub(crate) fn plain_estimate(&self) -> u64 {
        self.plain_estimate
    }

    /// Returns the number of preferred operators of the last relaxed plan before its deficits were
    /// covered. They come first.
    pub(crate) fn plain_count(&self) -> usize {
        self.plain_count
    }

    fn mark(&mut self, proposition: u32) {
        let mark = &mut self.marks[proposition as usize];
        if *mark != self.evaluation {
            *mark = self.evaluation;
            self.waiting.push(proposition);
        }
    }

    /// Extracts the relaxed plan backwards from the goal, and returns its cost. The plan's
    /// operators that are applicable in `state` become the preferred operators. If deficits are
    /// covered, those of the covers are preferred, too, and all helpful ones.
    fn extract(&mut self, state: &State) -> u64 {
        self.evaluation += 1;
        let mut unbalanced = 0;
        if self.covers_deficits {
            for index in 0..self.balances.len() {
                let balance = self.balances[index];
                if self.relaxation.goal().binary_search(&balance).is_ok() {
                    self.marks[balance as usize] = self.evaluation;
                    unbalanced += u64::from(!self.is_given(balance));
                }
            }
        }
        for index in 0..self.relaxation.goal().len() {
            self.mark(self.relaxation.goal()[index]);
        }
        let cost = self.support_waiting(state, false);
        self.plain_estimate = cost.saturating_add(unbalanced);
        self.preferred.sort_unstable();
        self.preferred.dedup();
        self.plain_count = self.preferred.len();
        if !self.covers_deficits || self.deficits.is_none() {
            return self.plain_estimate;
        }
        let cost = cost.saturating_add(self.cover_deficits(state));
        self.helpful.extend(self.preferred.drain(self.plain_count..));
        self.helpful.retain(|one| self.preferred.binary_search(one).is_err());
        self.helpful.sort_unstable();
        self.helpful.dedup();
        self.preferred.append(&mut self.helpful);
        cost
    }

    /// Adds the supporters of all waiting propositions to the relaxed plan, with what these require
    /// in turn. Returns their cost.
    fn support_waiting(&mut self, state: &State, is_covering: bool) -> u64 {
        let mut cost: u64 = 0;
        while let Some(proposition) = self.waiting.pop() {
            if self.is_given(proposition) {
                continue;
            }
            self.note_helpful(proposition, state);
            if is_covering && self.is_in_plan(proposition) {
                continue;
            }
            let supporter = self.additive.supporter(proposition);
            for index in 0..self.relaxation.preconditions(supporter).len() {
                self.mark(self.relaxation.preconditions(supporter)[index]);
            }
            let Some(operator) = self.relaxation.origin(supporter) else { continue };
            self.prefer((supporter, operator), state);
            let times = self.additive.repetitions(&self.relaxation, proposition).times;
            let known = self.times(operator);
            if times > known {
                let relaxed = (supporter, operator);
                cost = cost.saturating_add(self.apply(relaxed, times - known));
            }
        }
        cost
    }

    /// Whether the relaxed plan so far makes a comparison true by the steps that it has anyway: to
    /// pour water makes room for the next load.
    fn is_in_plan(&self, proposition: u32) -> bool {
        let Some(deficits) = &self.deficits else { return false };
        deficits.approaching(proposition).iter().any(|&relaxed| {
            let known = self.relaxation.origin(relaxed).map_or(0, |operator| self.times(operator));
            let needed = self.additive.repetitions_of(&self.relaxation, relaxed, proposition);
            known >= needed.times && !needed.is_detour
        })
    }

    /// Returns the number of occurrences of an operator in the relaxed plan so far.
    fn times(&self, operator: OperatorId) -> u32 {
        let mark = self.operator_marks[operator.index()];
        if mark.evaluation == self.evaluation { mark.times } else { 0 }
    }

    /// Notes the operator of a relaxed one as preferred if it achieves in `state` what the relaxed one
    /// is for: the condition of its effect must hold, too.
    fn prefer(&mut self, (relaxed, operator): (u32, OperatorId), state: &State) {
        let mut preconditions = self.relaxation.preconditions(relaxed).iter();
        if preconditions.all(|one| self.relaxation.holds(state, *one))
            && all_hold(state, self.task.operator(operator).preconditions)
        {
            self.preferred.push(operator);
        }
    }

    /// Adds an operator to the relaxed plan, `further` times. Returns the cost. The operator is that
    /// of the relaxed one.
    fn apply(&mut self, relaxed: (u32, OperatorId), further: u32) -> u64 {
        let (relaxed, operator) = relaxed;
        let known = self.times(operator);
        let times = known.saturating_add(further);
        self.operator_marks[operator.index()] = OperatorMark { evaluation: self.evaluation, times };
        let room = PLAN_MAX.saturating_sub(self.plan.len());
        self.plan.extend(std::iter::repeat_n(operator, room.min(further as usize)));
        if known == 0 {
            self.chosen.push(operator);
        }
        self.relaxation.base_cost(relaxed).saturating_mul(u64::from(further))
    }

    /// Covers the deficits of the relaxed plan, and those that this causes. Returns the cost of the
    /// operators that it adds.
    fn cover_deficits(&mut self, state: &State) -> u64 {
        let mut cost: u64 = 0;
        let Some(deficits) = &mut self.deficits else { return cost };
        deficits.start(self.task, state);
        for _ in 0..ROUNDS_MAX {
            let covers = self.find_covers();
            if covers.is_empty() {
                self.covers = covers;
                break;
            }
            for Cover { proposition, relaxed, operator, times } in &covers {
                self.note_helpful(*proposition, state);
                for index in 0..self.relaxation.preconditions(*relaxed).len() {
                    self.mark(self.relaxation.preconditions(*relaxed)[index]);
                }
                self.prefer((*relaxed, *operator), state);
                cost = cost.saturating_add(self.apply((*relaxed, *operator), *times));
            }
            self.covers = covers;
            cost = cost.saturating_add(self.support_waiting(state, true));
        }
        cost.saturating_add(self.support_balances(state))
    }

    /// Adds the supporters of balances that no operator covers, such as one that an assignment reaches.
    /// Returns their cost.
    fn support_balances(&mut self, state: &State) -> u64 {
        let unmet = self.deficits.iter().flat_map(|one| one.unmet());
        self.waiting.extend(unmet);
        self.support_waiting(state, false)
    }

    fn find_covers(&mut self) -> Vec<Cover> {
        let mut found = std::mem::take(&mut self.covers);
        let FastForward { task, deficits, relaxation, additive, chosen, .. } = self;
        let (operator_marks, marks, evaluation) =
            (&self.operator_marks, &self.marks, self.evaluation);
        if let Some(deficits) = deficits {
            let plan = chosen.iter().map(|one| (*one, operator_marks[one.index()].times));
            let is_needed = |one: u32| marks[one as usize] == evaluation;
            deficits.find((task, relaxation), additive, plan, is_needed, &mut found);
        }
        found
    }

    /// Notes all applicable operators that may reach the bound of a comparison. Which one of them is
    /// the supporter is decided by costs that are often equal, and hides those that also help
    /// others: of two counters in the wrong order, either one can be changed (Scala, Saetti, Serina
    /// and Gerevini, 2020).
    fn note_helpful(&mut self, proposition: u32, state: &State) {
        let Some(deficits) = &self.deficits else { return };
        if !self.covers_deficits {
            return;
        }
        for &relaxed in deficits.approaching(proposition) {
            let mut preconditions = self.relaxation.preconditions(relaxed).iter();
            if let Some(operator) = self.relaxation.origin(relaxed)
                && preconditions.all(|one| self.relaxation.holds(state, *one))
            {
                self.helpful.push(operator);
            }
        }
    }

    /// Whether a proposition holds in the evaluated state and needs no supporter.
    fn is_given(&self, proposition: u32) -> bool {
        self.additive.supporter(proposition) == NO_SUPPORTER
    }
}

impl Evaluator for FastForward<'_> {
    fn evaluate(&mut self, state: &State) -> Option<u64> {
        self.preferred.clear();
        self.plan.clear();
        self.chosen.clear();
        self.helpful.clear();
        if !self.additive.explore(&self.relaxation, state) {
            return None;
        }
        Some(self.extract(state))
    }

    fn preferred(&self) -> &[OperatorId] {
        &self.preferred
    }

    fn bytes(&self) -> usize {
        let deficits = self.deficits.as_ref().map_or(0, Deficits::bytes);
        self.relaxation.bytes() + self.additive.bytes() + self.operator_marks.len() * 8 + deficits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progression::Progression;
    use crate::test_tasks::task;

    /// Returns the steps that are preferred in the initial state, sorted.
    fn preferred(task: &Task) -> Vec<String> {
        let mut ff = FastForward::new(task, Weights::Unit);
        let state = Progression::new(task).initial();
        ff.evaluate(&state).expect("a goal in reach");
        let mut steps: Vec<_> =
            task.plan(ff.preferred()).steps.iter().map(ToString::to_string).collect();
        steps.sort();
        steps
    }

    #[test]
    fn all_steps_towards_the_bound_of_a_comparison_are_preferred() {
        let domain = "(define (domain d) (:types counter) (:functions (value ?c - counter))
            (:action up :parameters (?c - counter) :precondition (< (value ?c) 9)
                :effect (increase (value ?c) 1))
            (:action down :parameters (?c - counter) :precondition (> (value ?c) 0)
                :effect (decrease (value ?c) 1)))";
        let problem = "(define (problem p) (:domain d) (:objects a b c - counter)
            (:init (= (value a) 5) (= (value b) 3) (= (value c) 9))
            (:goal (and (< (value a) (value b)) (< (value b) (value c)))))";
        let task = task(domain, problem);
        assert_eq!(preferred(&task), ["(down a)", "(up b)"]);
    }

    const JOURNEY: &str = "(define (domain d) (:types place)
        (:predicates (at ?p - place) (road ?p ?q - place)) (:functions (fuel))
        (:action move :parameters (?p ?q - place)
            :precondition (and (at ?p) (road ?p ?q) (>= (fuel) 1))
            :effect (and (not (at ?p)) (at ?q) (decrease (fuel) 1)))
        (:action refuel :parameters () :precondition (< (fuel) 9) :effect (increase (fuel) 1)))";

    fn journey(fuel: u32, goal: &str) -> Task {
        task(
            JOURNEY,
            &format!(
                "(define (problem p) (:domain d) (:objects a b c d - place)
            (:init (at a) (road a b) (road b c) (road c d) (= (fuel) {fuel})) (:goal {goal}))"
            ),
        )
    }

    #[test]
    fn what_the_steps_of_a_relaxed_plan_use_up_is_supplied() {
        for (fuel, goal, plain, covered) in [
            (1, "(at d)", 3, 5),
            (3, "(at d)", 3, 3),
            // A goal must still hold when all steps are done.
            (1, "(and (at c) (>= (fuel) 1))", 2, 4),
            (1, "(and (at c) (> (fuel) 1))", 3, 5),
            // One supply covers several bounds of the same number.
            (1, "(and (at c) (>= (fuel) 1) (>= (+ (fuel) 1) 2))", 2, 4),
        ] {
            let task = journey(fuel, goal);
            let state = Progression::new(&task).initial();
            let mut ff = FastForward::new(&task, Weights::Unit);
            assert_eq!(ff.evaluate(&state), Some(covered), "{fuel} {goal}");
            assert_eq!(ff.plain_estimate(), plain, "{fuel} {goal}");
            ff.set_covering(false);
            assert_eq!(ff.evaluate(&state), Some(plain), "{fuel} {goal}");
        }
    }

    const WATERING: &str = "(define (domain d) (:types agent)
        (:functions (x ?a - agent) (carrying ?a - agent) (loaded) (poured))
        (:action right :parameters (?a - agent) :effect (increase (x ?a) 1))
        (:action left :parameters (?a - agent) :effect (decrease (x ?a) 1))
        (:action load :parameters (?a - agent)
            :precondition (and (= (x ?a) 0) (<= (+ (carrying ?a) 1) 5))
            :effect (and (increase (carrying ?a) 1) (increase (loaded) 1)))
        (:action pour :parameters (?a - agent)
            :precondition (and (= (x ?a) 6) (>= (carrying ?a) 1))
            :effect (and (decrease (carrying ?a) 1) (increase (poured) 1))))";

    fn watering(agents: [(i32, u32); 2], loaded: u32, goal: &str) -> Task {
        let [(a, with_a), (b, with_b)] = agents;
        task(
            WATERING,
            &format!(
                "(define (problem p) (:domain d) (:objects a b - agent)
            (:init (= (x a) {a}) (= (carrying a) {with_a}) (= (x b) {b}) (= (carrying b) {with_b})
              (= (loaded) {loaded}) (= (poured) 0)) (:goal {goal}))"
            ),
        )
    }

    /// Agent `b` is nearer to the plant, but has to get all the water first. The bucket of `a` is full;
    /// pouring makes room for the water that is missing.
    #[test]
    fn an_operator_that_has_more_of_what_its_repetitions_use_up_is_preferred() {
        let task = watering([(-2, 5), (2, 0)], 5, "(= (poured) 8)");
        let mut ff = FastForward::new(&task, Weights::Unit);
        let state = Progression::new(&task).initial();
        assert_eq!(ff.evaluate(&state), Some(8 + 8 + 3));
        assert_eq!(preferred(&task), ["(left a)", "(right a)"]);
    }

    /// What is loaded must be poured: the steps that pour for one goal do so for the other one, too.
    #[test]
    fn steps_of_a_relaxed_plan_count_for_a_balance_of_several_numbers() {
        let goal = "(and (>= (poured) 5) (= (poured) (loaded)))";
        let task = watering([(0, 3), (60, 0)], 3, goal);
        let mut ff = FastForward::new(&task, Weights::Unit);
        let state = Progression::new(&task).initial();
        assert_eq!(ff.evaluate(&state), Some(5 + 6 + 2));
        // More is loaded than a goal needs.
        let task = watering([(0, 3), (60, 0)], 3, "(and (>= (poured) 2) (= (poured) (loaded)))");
        let mut ff = FastForward::new(&task, Weights::Unit);
        assert_eq!(ff.evaluate(&Progression::new(&task).initial()), Some(3 + 6));
    }

    /// No sum of changes says what an assignment or a conditional change does.
    #[test]
    fn a_balance_that_no_sum_reaches_has_a_supporter() {
        for effect in ["(assign (x) (y))", "(when (on) (increase (x) 7))"] {
            let domain = format!(
                "(define (domain d) (:types place) (:predicates (at ?p - place) (on))
                (:functions (x) (y) (spent)) (:constants shop - place)
                (:action go :parameters (?p ?q - place) :precondition (at ?p)
                    :effect (and (not (at ?p)) (at ?q)))
                (:action switch :parameters () :effect (on))
                (:action set :parameters () :precondition (at shop) :effect {effect}))"
            );
            let problem = "(define (problem p) (:domain d) (:objects home - place)
                (:init (at home) (= (x) 0) (= (y) 7) (= (spent) 0)) (:goal (= (x) (y))))";
            let task = task(&domain, problem);
            let mut ff = FastForward::new(&task, Weights::Unit);
            let estimate = ff.evaluate(&Progression::new(&task).initial());
            assert!(estimate >= Some(2), "{effect}: {estimate:?}");
            assert!(preferred(&task).contains(&"(go home shop)".to_owned()), "{effect}");
        }
    }
}
