//! Evaluation of axioms: computes the derived facts of a state, stratum by stratum.
//!
//! Within a stratum, the evaluator counts for every axiom the body literals that are still missing.
//! Each literal is therefore visited once (Dowling and Gallier, 1984).

use crate::rows::Rows;
use crate::state::{State, holds, is_true, set};
use crate::task::{FactId, Literal, Task};

/// Evaluator of a task's axioms, which are indexed by the facts in their bodies. The evaluator owns
/// its scratch space.
#[derive(Debug)]
pub(crate) struct AxiomEvaluator {
    /// Index of the first derived fact. All facts from this index on are derived.
    first_derived: usize,
    /// Per stratum: the index after its last axiom.
    strata: Vec<u32>,
    heads: Vec<FactId>,
    /// Per axiom: the body literals that are decided before the axiom's stratum is evaluated. All
    /// of them are in one array; `ends` contains the end of each axiom's literals.
    known: Vec<Literal>,
    ends: Vec<u32>,
    /// Per axiom: the number of facts in its body that are derived in the axiom's own stratum.
    own: Vec<u32>,
    /// Per derived fact: the axioms of the fact's stratum that have the fact in their body.
    waiting: Rows,
    /// Scratch space. Per axiom: the number of facts in its body that belong to the same stratum
    /// and are not derived yet.
    missing: Vec<u32>,
    queue: Vec<FactId>,
}

/// Value of `missing` for an axiom that cannot fire because a literal in `known` does not hold.
const DEAD: u32 = u32::MAX;

// === impl AxiomEvaluator ===

impl AxiomEvaluator {
    pub(crate) fn new(task: &Task) -> AxiomEvaluator {
        let mut stratum_of = vec![u32::MAX; task.fact_count];
        for axiom in &task.axioms {
            stratum_of[axiom.head.index()] = axiom.stratum;
        }
        let is_own = |literal: &&Literal, stratum: u32| {
            literal.is_positive() && stratum_of[literal.fact().index()] == stratum
        };
        let mut axioms = AxiomEvaluator {
            first_derived: task.basic_count + task.comparisons.len(),
            strata: Vec::new(),
            heads: task.axioms.iter().map(|axiom| axiom.head).collect(),
            known: Vec::new(),
            ends: vec![0],
            own: Vec::new(),
            waiting: Rows::default(),
            missing: vec![0; task.axioms.len()],
            queue: Vec::new(),
        };
        let mut waiting = Vec::new();
        for (index, axiom) in task.axioms.iter().enumerate() {
            let (own, known): (Vec<&Literal>, Vec<&Literal>) =
                axiom.body.iter().partition(|literal| is_own(literal, axiom.stratum));
            waiting.extend(own.iter().map(|literal| (literal.fact().0, index as u32)));
            axioms.known.extend(known);
            axioms.ends.push(axioms.known.len() as u32);
            axioms.own.push(own.len() as u32);
            let is_last =
                task.axioms.get(index + 1).is_none_or(|next| next.stratum != axiom.stratum);
            if is_last {
                axioms.strata.push(index as u32 + 1);
            }
        }
        axioms.waiting = Rows::collect(task.fact_count, waiting.iter().copied());
        axioms
    }

    /// Recomputes the derived facts of a state from its basic facts and its comparisons.
    pub(crate) fn derive(&mut self, state: &mut State) {
        clear_from(state, self.first_derived);
        let mut start = 0;
        for index in 0..self.strata.len() {
            let end = self.strata[index] as usize;
            self.stratum(start..end, state);
            start = end;
        }
    }

    fn stratum(&mut self, range: std::ops::Range<usize>, state: &mut State) {
        self.queue.clear();
        for axiom in range {
            let known = &self.known[self.ends[axiom] as usize..self.ends[axiom + 1] as usize];
            let is_alive = known.iter().all(|literal| holds(state, *literal));
            self.missing[axiom] = if is_alive { self.own[axiom] } else { DEAD };
            if is_alive && self.own[axiom] == 0 {
                self.queue.push(self.heads[axiom]);
            }
        }
        while let Some(fact) = self.queue.pop() {
            if is_true(state, fact) {
                continue;
            }
            set(state, fact, true);
            for &axiom in self.waiting.row(fact.0) {
                let missing = &mut self.missing[axiom as usize];
                if *missing != DEAD {
                    *missing -= 1;
                    if *missing == 0 {
                        self.queue.push(self.heads[axiom as usize]);
                    }
                }
            }
        }
    }
}

/// Clears the bit with the index `first` and all bits after it.
fn clear_from(state: &mut State, first: usize) {
    let (word, bit) = (first / 64, first % 64);
    if let Some((head, tail)) = state.get_mut(word..).and_then(<[u64]>::split_first_mut) {
        *head &= (1 << bit) - 1;
        tail.fill(0);
    }
}
