//! Deordering: computes which steps of a plan must wait for which others. All other steps can run
//! in parallel.
//!
//! Two steps keep their order if one of them may write a fact or number that the other reads or
//! writes (in any branch, or through an axiom), or if the same agent executes both. Every
//! linearization of this order leads to the same end state; tests try all linearizations. The order
//! is always sound, but may contain more waits than a minimal deordering, which is hard to compute.

use pddl::PlanStep;

use crate::validate::{Footprint, World};

/// Partial order of the steps of a plan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartialOrder {
    /// Per step, in the order of the plan: its direct predecessors, sorted. A step that is already
    /// an indirect predecessor is omitted (transitive reduction).
    pub predecessors: Vec<Vec<usize>>,
}

/// Computes the partial order of the steps of a plan. The facts of the state in `world` do not
/// affect the result.
pub fn deorder(world: &World, steps: &[PlanStep]) -> PartialOrder {
    let footprints: Vec<Footprint> = steps.iter().map(|step| world.footprint(step)).collect();
    let must_wait =
        |later: usize, earlier: usize| footprints[later].must_wait_for(&footprints[earlier]);
    PartialOrder::reduced(footprints.len(), must_wait)
}

/// Returns the first pair of steps for which the order may matter: the position of a step in
/// `ours`, and that of a step in `theirs`. Returns `None` if the two plans can run in parallel with
/// any interleaving.
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
    /// Returns the steps that can begin: they are not done, and all their predecessors are done.
    pub fn ready(&self, done: &[bool]) -> Vec<usize> {
        let is_done = |step: &usize| done.get(*step).copied().unwrap_or(false);
        let steps = 0..self.predecessors.len();
        steps
            .filter(|step| !is_done(step) && self.predecessors[*step].iter().all(is_done))
            .collect()
    }

    /// Builds the partial order of `count` steps. `must_wait(later, earlier)` returns whether a
    /// later step must wait for an earlier one.
    fn reduced(count: usize, must_wait: impl Fn(usize, usize) -> bool) -> PartialOrder {
        // Per step: its direct and indirect predecessors.
        let mut before: Vec<Vec<bool>> = Vec::with_capacity(count);
        let mut predecessors = Vec::with_capacity(count);
        for later in 0..count {
            let mut all = vec![false; count];
            let mut direct = Vec::new();
            // The nearest step comes first, so that steps which are already indirect predecessors
            // are not added.
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
