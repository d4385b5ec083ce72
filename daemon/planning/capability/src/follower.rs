//! A copy of the believed state, kept up to date by announced changes.

use std::collections::BTreeMap;

use acl::content::EpochChange;
use pddl::{Diagnostic, InitElement};

use crate::fact::{FactKey, FactStatement, FactValue};

/// A copy of the facts that a Domain Maintainer believes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Follower {
    epoch: u64,
    revision: u64,
    facts: BTreeMap<FactKey, FactValue>,
}

/// Reason why a received change could not be applied to a copy of the state. The copy is unchanged;
/// the caller must request a fresh one.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FollowError {
    /// A change between the copy and the received change has been lost.
    Gap {
        /// The revision (number of changes) of the copy.
        known: u64,
        /// The revision (number of changes) after the received change.
        announced: u64,
    },
    /// The set of capabilities has changed, so the domain and the objects differ from those of the
    /// copy.
    NewEpoch {
        /// The epoch of the copy.
        known: u64,
        /// The epoch of the received change.
        announced: u64,
    },
    /// The facts in the received change are not valid PDDL.
    Unreadable(Vec<Diagnostic>),
}

// === impl Follower ===

impl Follower {
    /// Creates a copy from a requested state and the epoch and revision of that state.
    pub fn new(epoch: u64, revision: u64, state: &[InitElement]) -> Follower {
        let mut follower = Follower { epoch, revision, facts: BTreeMap::new() };
        follower.believe(state);
        follower
    }

    /// Applies a received change to the copy. A change that the copy already contains is ignored.
    ///
    /// # Errors
    ///
    /// Returns an error if the change cannot be applied. A fresh copy must then be requested.
    pub fn follow(&mut self, change: &EpochChange) -> Result<(), FollowError> {
        let EpochChange { epoch, revision, believed, retracted, .. } = change;
        if *revision <= self.revision {
            return Ok(());
        }
        if *epoch != self.epoch {
            return Err(FollowError::NewEpoch { known: self.epoch, announced: *epoch });
        }
        if *revision != self.revision + 1 {
            return Err(FollowError::Gap { known: self.revision, announced: *revision });
        }
        let read =
            |text| pddl::parse_init_elements(text).into_result().map_err(FollowError::Unreadable);
        let (believed, retracted) = (read(believed)?, read(retracted)?);
        for fact in &retracted {
            if let FactStatement::Is(key, _) = FactStatement::of(fact) {
                self.facts.remove(&key);
            }
        }
        self.believe(&believed);
        self.revision = *revision;
        Ok(())
    }

    fn believe(&mut self, facts: &[InitElement]) {
        for fact in facts {
            if let FactStatement::Is(key, value) = FactStatement::of(fact) {
                self.facts.insert(key, value);
            }
        }
    }

    /// Returns the believed facts of the copy, in a fixed order.
    pub fn facts(&self) -> impl Iterator<Item = InitElement> {
        self.facts.iter().map(|(key, value)| key.element(*value))
    }

    /// Returns the epoch of the copy.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Returns the revision of the copy.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}
