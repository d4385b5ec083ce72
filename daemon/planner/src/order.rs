//! Deordering: which steps of a plan must wait for which, so that the rest can run side by side.
//!
//! Two steps keep their order if one may write what the other reads or writes, in any branch,
//! through an axiom, or as a number; and if one agent does both. Every order of the steps that
//! respects this leads to the same end (tests try them all). It is not the weakest such order, which
//! is hard to find; it is one that always holds.

use pddl::PlanStep;

use crate::validate::{Footprint, World};

/// A plan's steps with what each waits for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartialOrder {
    /// Per step, in the plan's order: the steps it waits for, sorted; those that these wait for
    /// themselves are left out.
    pub predecessors: Vec<Vec<usize>>,
}

/// Finds the order that the steps of a plan need; of a state of their problem, its facts do not matter.
pub fn deorder(world: &World, steps: &[PlanStep]) -> PartialOrder {
    let footprints: Vec<Footprint> = steps.iter().map(|step| world.footprint(step)).collect();
    let must_wait =
        |later: usize, earlier: usize| footprints[later].must_wait_for(&footprints[earlier]);
    PartialOrder::reduced(footprints.len(), must_wait)
}

/// The first pair of steps of two plans, ours and theirs, whose order may matter; `None` if both
/// plans can run side by side, however their steps interleave.
pub fn interference(
    world: &World,
    ours: &[PlanStep],
    theirs: &[PlanStep],
) -> Option<(usize, usize)> {
    let footprints = |steps: &[PlanStep]| -> Vec<Footprint> {
        steps.iter().map(|step| world.footprint(step)).collect()
    };
    let (ours, theirs) = (footprints(ours), footprints(theirs));
    let pairs = ours.iter().enumerate().flat_map(|(our_index, our)| {
        let theirs = theirs.iter().enumerate();
        theirs.map(move |(their_index, their)| ((our_index, our), (their_index, their)))
    });
    pairs
        .filter(|((_, our), (_, their))| our.must_wait_for(their))
        .map(|((our_index, _), (their_index, _))| (our_index, their_index))
        .next()
}

// === impl PartialOrder ===

impl PartialOrder {
    /// The steps that can start once `done` says which are.
    pub fn ready(&self, done: &[bool]) -> Vec<usize> {
        let is_done = |step: &usize| done.get(*step).copied().unwrap_or(false);
        let steps = 0..self.predecessors.len();
        steps
            .filter(|step| !is_done(step) && self.predecessors[*step].iter().all(is_done))
            .collect()
    }

    /// The transitive reduction of a relation between later and earlier steps.
    fn reduced(count: usize, must_wait: impl Fn(usize, usize) -> bool) -> PartialOrder {
        // Per step: everything it waits for, directly or not.
        let mut before: Vec<Vec<bool>> = Vec::with_capacity(count);
        let mut predecessors = Vec::with_capacity(count);
        for later in 0..count {
            let mut all = vec![false; count];
            let mut direct = Vec::new();
            // Nearest first: what a nearer one waits for need not be waited for again.
            for earlier in (0..later).rev() {
                if !all[earlier] && must_wait(later, earlier) {
                    direct.push(earlier);
                    all[earlier] = true;
                    all.iter_mut().zip(&before[earlier]).for_each(|(mine, theirs)| *mine |= theirs);
                }
            }
            direct.sort_unstable();
            predecessors.push(direct);
            before.push(all);
        }
        PartialOrder { predecessors }
    }
}
