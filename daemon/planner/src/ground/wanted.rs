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
    /// The operators that change numbers: whoever compares one, is priced by one or changes one by
    /// another may need them, also that it has a value at all.
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
