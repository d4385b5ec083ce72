//! Deordering: computes which steps of a plan must wait for which, so that the others can run in
//! parallel.
//!
//! Two steps keep their order if one of them may write what the other reads or writes (in any branch,
//! through an axiom, or as a number), or if the same agent executes both. Every linearization that
//! respects this order leads to the same end state (tests try them all). It is not a minimal
//! deordering, which is hard to compute; it is an order that is always sound.

use pddl::PlanStep;

use crate::validate::{Footprint, World};

/// The steps of a plan, each with the steps it must wait for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartialOrder {
    /// Per step, in the order of the plan: the steps it directly waits for, sorted. Steps that are
    /// already predecessors of those are left out (transitive reduction).
    pub predecessors: Vec<Vec<usize>>,
}

/// Computes the partial order of the steps of a plan. The facts of the state in `world` do not matter.
pub fn deorder(world: &World, steps: &[PlanStep]) -> PartialOrder {
    let footprints: Vec<Footprint> = steps.iter().map(|step| world.footprint(step)).collect();
    let must_wait =
        |later: usize, earlier: usize| footprints[later].must_wait_for(&footprints[earlier]);
    PartialOrder::reduced(footprints.len(), must_wait)
}

/// Returns the positions of the first two steps, one of each plan, that may depend on their order.
/// Returns `None` if the two plans can run in parallel, however their steps interleave.
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
    /// Returns the steps that are not done and have only predecessors that are done.
    pub fn ready(&self, done: &[bool]) -> Vec<usize> {
        let is_done = |step: &usize| done.get(*step).copied().unwrap_or(false);
        let steps = 0..self.predecessors.len();
        steps
            .filter(|step| !is_done(step) && self.predecessors[*step].iter().all(is_done))
            .collect()
    }

    /// Builds the transitive reduction of a relation between later and earlier steps.
    fn reduced(count: usize, must_wait: impl Fn(usize, usize) -> bool) -> PartialOrder {
        // Per step: all its predecessors, direct or indirect.
        let mut before: Vec<Vec<bool>> = Vec::with_capacity(count);
        let mut predecessors = Vec::with_capacity(count);
        for later in 0..count {
            let mut all = vec![false; count];
            let mut direct = Vec::new();
            // Nearest first: a step that is already an indirect predecessor need not be added.
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
