//! Relevance analysis of operators that were grounded before, with raw fact numbers. The analysis
//! goes backwards from a goal, through the same steps as [`super::relaxed_reachability`].
//!
//! `finish` also drops irrelevant operators, and detects more of them, but visits every operator in
//! its input. This analysis comes first, because a goal may need one of a thousand actions of a
//! building.

use super::ground_formula::RawAxiom;
use super::raw_instances::FactLayout;
use crate::operators::OperatorTable;
use crate::rows::Rows;
use crate::task::{FactId, Literal};

/// Index for the relevance analysis: the steps that change each fact, and the facts in the
/// conditions of each step.
#[derive(Debug)]
pub(super) struct RelevanceIndex {
    /// Per fact, by dense index: the steps that change the fact.
    changers: Rows,
    /// Per step (first the operators, then the axioms): the facts in all conditions of the step.
    asked: Rows,
    /// Operators that change numbers. These are always relevant: a comparison, a cost or another
    /// numeric change may depend on the number, or on whether it is defined.
    counting: Vec<u32>,
    operator_count: usize,
}

// === impl RelevanceIndex ===

impl RelevanceIndex {
    pub(super) fn new<'a>(
        layout: &FactLayout,
        operators: &OperatorTable,
        axioms: impl Iterator<Item = &'a RawAxiom>,
    ) -> RelevanceIndex {
        let dense = |fact: &FactId| layout.dense(*fact) as u32;
        let asks = |literal: &Literal| layout.dense(literal.fact()) as u32;
        let (mut changed, mut asked, mut counting) = (Rows::default(), Rows::default(), Vec::new());
        let (mut changes, mut asks_for) = (Vec::new(), Vec::new());
        for (index, operator) in operators.iter().enumerate() {
            changes.clear();
            asks_for.clear();
            asks_for.extend(operator.preconditions.iter().map(asks));
            let mut counts = !operator.effect.numeric.is_empty();
            changes.extend(operator.effect.adds.iter().chain(operator.effect.deletes).map(dense));
            for one in operator.conditional.iter() {
                asks_for.extend(one.conditions.iter().map(asks));
                changes.extend(one.effect.adds.iter().chain(one.effect.deletes).map(dense));
                counts |= !one.effect.numeric.is_empty();
            }
            changed.push(&changes);
            asked.push(&asks_for);
            counting.extend(counts.then_some(index as u32));
        }
        for axiom in axioms {
            asks_for.clear();
            asks_for.extend(axiom.body.iter().map(asks));
            changed.push(&[dense(&axiom.head)]);
            asked.push(&asks_for);
        }
        let changers = changed.inverted(layout.dense_end());
        RelevanceIndex { changers, asked, counting, operator_count: operators.len() }
    }

    /// Whether the index covers all facts and operators, and need not be built again.
    pub(super) fn covers(&self, layout: &FactLayout, operators: &OperatorTable) -> bool {
        self.changers.len() == layout.dense_end() && self.operator_count == operators.len()
    }

    /// Returns the operators that are relevant to a goal, in ascending order. `can` marks the
    /// operators that are applicable in the delete relaxation; only these are considered.
    pub(super) fn wanted(&self, layout: &FactLayout, goal: &[Literal], can: &[bool]) -> Vec<usize> {
        let mut facts = vec![false; self.changers.len()];
        let mut steps = vec![false; self.asked.len()];
        let mut queue: Vec<u32> = Vec::new();
        let mut want = |fact: u32, queue: &mut Vec<u32>| {
            if !std::mem::replace(&mut facts[fact as usize], true) {
                queue.push(fact);
            }
        };
        for literal in goal {
            want(layout.dense(literal.fact()) as u32, &mut queue);
        }
        let mut take = |step: u32, queue: &mut Vec<u32>| {
            let is_possible = can.get(step as usize) != Some(&false);
            if is_possible && !std::mem::replace(&mut steps[step as usize], true) {
                self.asked.row(step).iter().for_each(|asked| want(*asked, queue));
            }
        };
        self.counting.iter().for_each(|step| take(*step, &mut queue));
        while let Some(fact) = queue.pop() {
            self.changers.row(fact).iter().for_each(|step| take(*step, &mut queue));
        }
        (0..self.operator_count).filter(|operator| steps[*operator]).collect()
    }
}
