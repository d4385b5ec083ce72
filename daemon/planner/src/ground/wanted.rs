//! What a goal can rest on, over raw facts and operators that are there already: the way back through
//! what [`super::possible`] goes forward through.
//!
//! `finish` keeps the same and less, but looks at all that it is given. Of a building's thousand
//! actions a goal may want one.

use super::drawn::Layout;
use super::tree::RawAxiom;
use crate::operators::Operators;
use crate::rows::Rows;
use crate::task::{FactId, Literal};

/// Who changes which fact, and what that asks for.
#[derive(Debug)]
pub(super) struct Sources {
    /// By fact, by dense index: the steps that change it.
    changers: Rows,
    /// By step, the operators before the axioms: the facts it asks for, in whichever condition.
    asked: Rows,
    /// The operators that change numbers, of which any comparison may read one.
    counting: Vec<u32>,
    operator_count: usize,
}

// === impl Sources ===

impl Sources {
    pub(super) fn new<'a>(
        layout: &Layout,
        operators: &Operators,
        axioms: impl Iterator<Item = &'a RawAxiom>,
    ) -> Sources {
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
        Sources { changers, asked, counting, operator_count: operators.len() }
    }

    /// Whether it still speaks of all there is.
    pub(super) fn covers(&self, layout: &Layout, operators: &Operators) -> bool {
        self.changers.len() == layout.dense_end() && self.operator_count == operators.len()
    }

    /// Those operators of which one or the other may be needed for a goal, among those that `can`
    /// happen: in order.
    pub(super) fn wanted(&self, layout: &Layout, goal: &[Literal], can: &[bool]) -> Vec<usize> {
        let comparisons = layout.comparison_offset..layout.comparison_end();
        let mut facts = vec![false; self.changers.len()];
        let mut steps = vec![false; self.asked.len()];
        let mut queue: Vec<u32> = Vec::new();
        let mut want = |fact: usize, queue: &mut Vec<u32>| {
            if !std::mem::replace(&mut facts[fact], true) {
                queue.push(fact as u32);
            }
        };
        goal.iter().for_each(|literal| want(layout.dense(literal.fact()), &mut queue));
        while let Some(fact) = queue.pop() {
            let is_comparison = comparisons.contains(&(fact as usize));
            let counting = if is_comparison { &*self.counting } else { &[] };
            for &step in self.changers.row(fact).iter().chain(counting) {
                let step = step as usize;
                if can.get(step) == Some(&false) || std::mem::replace(&mut steps[step], true) {
                    continue;
                }
                for &asked in self.asked.row(step as u32) {
                    want(asked as usize, &mut queue);
                }
            }
        }
        (0..self.operator_count).filter(|operator| steps[*operator]).collect()
    }
}
