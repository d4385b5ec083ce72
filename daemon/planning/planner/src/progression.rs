//! Progression: applies operators to states.

use pddl::{Assignment, Operator};

use crate::axioms::AxiomEvaluator;
use crate::state::{State, all_hold, set};
use crate::task::{Changes, ConditionalEffect, FactId, GroundOperator, Task};

/// Computes successor states: applies operators, then evaluates comparisons and axioms. Each search
/// has its own `Progression`, because it owns scratch space.
#[derive(Debug)]
pub(crate) struct Progression<'t> {
    task: &'t Task,
    fact_words: usize,
    axioms: AxiomEvaluator,
    numeric: Vec<(u32, Assignment, f64)>,
}

impl<'t> Progression<'t> {
    pub(crate) fn new(task: &'t Task) -> Progression<'t> {
        Progression {
            task,
            fact_words: task.fact_count.div_ceil(64),
            axioms: AxiomEvaluator::new(task),
            numeric: Vec::new(),
        }
    }

    /// Computes the initial state.
    pub(crate) fn initial(&mut self) -> Vec<u64> {
        let mut state = vec![0; self.fact_words];
        for fact in &self.task.initial {
            set(&mut state, *fact, true);
        }
        state.extend(self.task.values.iter().map(|value| value.to_bits()));
        self.derive(&mut state);
        state
    }

    /// Writes the successor state of an applicable operator into `to`. Returns `false` if the
    /// operator cannot be applied after all, because a number that it uses is undefined or its
    /// changes of a number contradict each other.
    pub(crate) fn apply(
        &mut self,
        operator: GroundOperator<'_>,
        from: &State,
        to: &mut Vec<u64>,
    ) -> bool {
        debug_assert!(all_hold(from, operator.preconditions));
        to.clear();
        to.extend_from_slice(from);
        let fires = |one: &ConditionalEffect<'_>| all_hold(from, one.conditions);
        let firing = || operator.conditional.iter().filter(fires).map(|one| one.effect);
        let changes = || std::iter::once(operator.effect).chain(firing());
        for fact in changes().flat_map(|changes| changes.deletes) {
            set(to, *fact, false);
        }
        // Adds come after all deletes, because a fact that is both deleted and added becomes true.
        for fact in changes().flat_map(|changes| changes.adds) {
            set(to, *fact, true);
        }
        if !self.task.values.is_empty() && !self.apply_numeric(changes(), from, to) {
            return false;
        }
        self.derive(to);
        true
    }

    fn apply_numeric<'c>(
        &mut self,
        changes: impl Iterator<Item = Changes<'c>>,
        from: &State,
        to: &mut State,
    ) -> bool {
        let numbers = &from[self.fact_words..];
        let value = |fluent: u32| f64::from_bits(numbers[fluent as usize]);
        self.numeric.clear();
        for change in changes.flat_map(|changes| changes.numeric) {
            self.numeric.push((change.fluent, change.assignment, change.value.evaluate(&value)));
        }
        self.numeric.sort_by_key(|(fluent, ..)| *fluent);
        for group in self.numeric.chunk_by(|left, right| left.0 == right.0) {
            let fluent = group[0].0;
            let Some(new) = combine(value(fluent), group) else { return false };
            // Adding 0.0 turns `-0.0` into `0.0`, so that equal states have equal words.
            to[self.fact_words + fluent as usize] = (new + 0.0).to_bits();
        }
        true
    }

    fn derive(&mut self, state: &mut State) {
        let (facts, numbers) = state.split_at_mut(self.fact_words);
        let value = |fluent: u32| f64::from_bits(numbers[fluent as usize]);
        for (index, comparison) in self.task.comparisons.iter().enumerate() {
            set(facts, FactId::from_index(self.task.basic_count + index), comparison.holds(&value));
        }
        if !self.task.axioms.is_empty() {
            self.axioms.derive(&mut state[..self.fact_words]);
        }
    }
}

/// Returns the value of a fluent after several simultaneous changes; `None` if they contradict each
/// other or the result is not finite.
fn combine(old: f64, group: &[(u32, Assignment, f64)]) -> Option<f64> {
    let kind = |assignment: Assignment| match assignment {
        Assignment::Assign => 0,
        Assignment::Increase | Assignment::Decrease => 1,
        Assignment::ScaleUp | Assignment::ScaleDown => 2,
    };
    let (_, first, first_value) = group[0];
    if group.iter().any(|(_, assignment, _)| kind(*assignment) != kind(first)) {
        return None;
    }
    if first == Assignment::Assign && group.iter().any(|(.., value)| value != &first_value) {
        return None;
    }
    let new = match group {
        // Several changes are added first, so that those that cancel each other change nothing.
        [_, _, ..] if kind(first) == 1 => {
            let change = { group.iter() }
                .fold(0.0, |sum, (_, assignment, value)| assignment.apply(sum, *value));
            Operator::Add.apply(old, change)
        }
        _ => { group.iter() }
            .fold(old, |number, (_, assignment, value)| assignment.apply(number, *value)),
    };
    new.is_finite().then_some(new)
}
