//! Requested claims that are not announced yet to the maintainers of actuators, which otherwise
//! receive only heartbeats.

use std::collections::BTreeSet;

use crate::fact::{ClaimSource, FactKey, Owner};

/// Maximum number of changed claims that are recorded individually. If more have changed, all
/// claims are sent to the other maintainers.
pub(crate) const UNTOLD_MAX: usize = 1_024;

/// Claims that may have changed since claims were last sent to other maintainers.
#[derive(Clone, Debug, Default)]
pub(crate) enum PendingChanges {
    /// Any claim may have changed, because no claim has been sent to other maintainers yet, or too
    /// many claims have changed.
    #[default]
    All,
    These(BTreeSet<(FactKey, Owner)>),
}

impl PendingChanges {
    /// Records a claim that was made or withdrawn, if it must be sent to other maintainers: the
    /// owner is the map, or the claim came by request.
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

    /// Creates a record without changes.
    pub(crate) fn nothing() -> PendingChanges {
        PendingChanges::These(BTreeSet::new())
    }

    /// Whether the claim of `owner` about `fact` may have changed.
    pub(crate) fn has(&self, fact: &FactKey, owner: &Owner) -> bool {
        match self {
            PendingChanges::All => true,
            PendingChanges::These(untold) => untold.contains(&(fact.clone(), owner.clone())),
        }
    }
}
