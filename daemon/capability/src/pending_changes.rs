//! Requested claims that have not yet been announced to the agents that receive heartbeats only.

use std::collections::BTreeSet;

use crate::belief::ClaimSource;
use crate::fact::{FactKey, Owner};

/// If more claims than this change, all of them are announced anew.
const UNTOLD_MAX: usize = 1_024;

/// Claims that may have changed since they were last announced.
#[derive(Clone, Debug, Default)]
pub(crate) enum PendingChanges {
    /// All claims: none has been announced yet, or too many have changed.
    #[default]
    All,
    These(BTreeSet<(FactKey, Owner)>),
}

impl PendingChanges {
    /// Adds a claim that was made or withdrawn. It must be announced if its owner is the map or it came
    /// by request; other claims are ignored.
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

    /// Returns the recorded claims, and starts again with none.
    pub(crate) fn take(&mut self) -> PendingChanges {
        std::mem::replace(self, PendingChanges::nothing())
    }

    /// Creates an empty record.
    pub(crate) fn nothing() -> PendingChanges {
        PendingChanges::These(BTreeSet::new())
    }

    /// Whether a claim may be recorded.
    pub(crate) fn has(&self, fact: &FactKey, owner: &Owner) -> bool {
        match self {
            PendingChanges::All => true,
            PendingChanges::These(untold) => untold.contains(&(fact.clone(), owner.clone())),
        }
    }
}
