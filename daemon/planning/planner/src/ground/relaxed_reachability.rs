//! Reachability from a state in the delete relaxation, with operators that were grounded before and
//! raw fact numbers.
//!
//! For every operator, conditional effect and axiom, the unreached preconditions are counted
//! (Dowling and Gallier, 1984), so that a query visits each literal once. The index is built once
//! and used for many states.

use super::ground_formula::RawAxiom;
use super::raw_instances::FactLayout;
use crate::operators::OperatorTable;
use crate::rows::Rows;
use crate::task::{FactId, Literal};

/// Index of the delete relaxation: the facts that each step (operator, conditional effect or axiom)
/// requires and adds.
#[derive(Debug)]
pub(super) struct RelaxationIndex {
    /// Per fact: the steps that require the fact.
    waiting: Rows,
    /// Per step: the number of facts that the step requires.
    needs: Vec<u32>,
    /// Per step: the facts that the step adds.
    adds: Rows,
    /// Per step: the operator that the step belongs to, or [`NO_OPERATOR`] for an axiom.
    operators: Vec<u32>,
    facts: usize,
    operator_count: usize,
}

const NO_OPERATOR: u32 = u32::MAX;

/// Facts (by dense index) and operators that are reachable in the delete relaxation.
pub(super) struct RelaxedReachable {
    pub(super) facts: Vec<bool>,
    pub(super) operators: Vec<bool>,
}

/// Steps of a [`RelaxationIndex`] that is being built.
struct StepIndexBuilder<'l> {
    layout: &'l FactLayout,
    preconditions: Rows,
    adds: Rows,
    operators: Vec<u32>,
    asked: Vec<u32>,
    added: Vec<u32>,
}

// === impl RelaxationIndex ===

impl RelaxationIndex {
    pub(super) fn new<'a>(
        layout: &FactLayout,
        operators: &OperatorTable,
        axioms: impl Iterator<Item = &'a RawAxiom>,
    ) -> RelaxationIndex {
        let mut steps = StepIndexBuilder {
            layout,
            preconditions: Rows::default(),
            adds: Rows::default(),
            operators: Vec::new(),
            asked: Vec::new(),
            added: Vec::new(),
        };
        for (index, operator) in operators.iter().enumerate() {
            let index = index as u32;
            steps.add(index, operator.preconditions, &[], operator.effect.adds);
            for one in operator.conditional.iter() {
                steps.add(index, operator.preconditions, one.conditions, one.effect.adds);
            }
        }
        for axiom in axioms {
            steps.add(NO_OPERATOR, &axiom.body, &[], &[axiom.head]);
        }
        let StepIndexBuilder { preconditions, adds, operators: of, .. } = steps;
        let facts = layout.dense_end();
        let needs = (0..preconditions.len() as u32).map(|step| preconditions.row(step).len());
        RelaxationIndex {
            needs: needs.map(|count| count as u32).collect(),
            waiting: preconditions.inverted(facts),
            adds,
            operators: of,
            facts,
            operator_count: operators.len(),
        }
    }

    /// Whether the index covers all facts and operators, and need not be built again.
    pub(super) fn covers(&self, layout: &FactLayout, operators: &OperatorTable) -> bool {
        self.facts == layout.dense_end() && self.operator_count == operators.len()
    }

    /// Computes the facts and operators that are reachable from a state in the delete relaxation.
    /// Operators that are `masked` are not used.
    pub(super) fn relaxed_reachable(
        &self,
        layout: &FactLayout,
        initial: &[bool],
        masked: &[bool],
    ) -> RelaxedReachable {
        let mut facts = vec![false; self.facts];
        facts[..initial.len()].copy_from_slice(initial);
        // Comparisons are assumed to be reachable.
        facts[layout.comparison_offset..layout.comparison_end()].fill(true);
        let mut operators = vec![false; self.operator_count];
        let mut missing = self.needs.clone();
        let mut queue: Vec<u32> =
            (0..facts.len() as u32).filter(|fact| facts[*fact as usize]).collect();
        let mut fire = |step: u32, facts: &mut [bool], queue: &mut Vec<u32>| {
            let operator = self.operators[step as usize];
            if operator != NO_OPERATOR {
                if masked[operator as usize] {
                    return;
                }
                operators[operator as usize] = true;
            }
            for &fact in self.adds.row(step) {
                if !std::mem::replace(&mut facts[fact as usize], true) {
                    queue.push(fact);
                }
            }
        };
        for (step, _) in self.needs.iter().enumerate().filter(|(_, needs)| **needs == 0) {
            fire(step as u32, &mut facts, &mut queue);
        }
        while let Some(fact) = queue.pop() {
            for &step in self.waiting.row(fact) {
                missing[step as usize] -= 1;
                if missing[step as usize] == 0 {
                    fire(step, &mut facts, &mut queue);
                }
            }
        }
        RelaxedReachable { facts, operators }
    }
}

// === impl StepIndexBuilder ===

impl StepIndexBuilder<'_> {
    fn add(&mut self, operator: u32, first: &[Literal], second: &[Literal], adds: &[FactId]) {
        let StepIndexBuilder { layout, asked, added, .. } = self;
        let dense = |fact: FactId| layout.dense(fact) as u32;
        let positive = first.iter().chain(second).filter(|literal| literal.is_positive());
        asked.clear();
        asked.extend(positive.map(|literal| dense(literal.fact())));
        asked.sort_unstable();
        asked.dedup();
        added.clear();
        added.extend(adds.iter().map(|fact| dense(*fact)));
        self.preconditions.push(asked);
        self.adds.push(added);
        self.operators.push(operator);
    }
}
