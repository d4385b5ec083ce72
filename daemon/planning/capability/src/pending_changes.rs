//! Requested claims that have not yet been announced to the maintainers of actuators, which receive
//! heartbeats only.

use std::collections::BTreeSet;

use crate::fact::{ClaimSource, FactKey, Owner};

/// Maximum number of changed claims that are recorded one by one. If more have changed, all claims are
/// announced.
const UNTOLD_MAX: usize = 1_024;

/// Claims that may have changed since they were last announced.
#[derive(Clone, Debug, Default)]
pub(crate) enum PendingChanges {
    /// All claims may have changed: none has been announced yet, or too many have changed.
    #[default]
    All,
    These(BTreeSet<(FactKey, Owner)>),
}

impl PendingChanges {
    /// Records a claim that was made or withdrawn, if it must be announced: if the owner is the map, or
    /// the claim came by request.
    pub(crate) fn record(&mut self, fact: &FactKey, owner: &Owner, source: ClaimSource) {
        let PendingChanges::These(untold) = self else { return };
        if *owner != Owner::Map && !source.is_requested() {
            return;
        }
        untold.insert((fact.clone(), owner.clone()));
        if untold.len() > UNTOLD_MAX {
            *self = PendingChanges::All;
        }
    }

    /// Returns the recorded claims, and clears the record.
    pub(crate) fn take(&mut self) -> PendingChanges {
        std::mem::replace(self, PendingChanges::nothing())
    }

    /// Creates an empty record.
    pub(crate) fn nothing() -> PendingChanges {
        PendingChanges::These(BTreeSet::new())
    }

    /// Whether the claim of `owner` about `fact` may be recorded as changed.
    pub(crate) fn has(&self, fact: &FactKey, owner: &Owner) -> bool {
        match self {
            PendingChanges::All => true,
            PendingChanges::These(untold) => untold.contains(&(fact.clone(), owner.clone())),
        }
    }
}
