//! Change that one call made to the domain and the state, as plain data. Other agents receive the
//! change and can apply it to their copies.

use acl::AgentId;
use acl::content::EpochChange;
use pddl::InitElement;

/// Difference between the domain and state before and after a call. If all lists are empty and no
/// epoch began, no visible part has changed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DomainChange {
    /// The epoch after the call: the number of changes of the set of capabilities, from 0 at the
    /// start.
    pub epoch: u64,
    /// The revision after the call: the number of changes of any kind, from 0 at the start.
    pub revision: u64,
    /// Whether this change began a new epoch.
    pub epoch_changed: bool,
    /// Agents with capabilities that have become available.
    pub joined: Vec<AgentId>,
    /// Agents with capabilities that are no longer available, because the agents are gone or
    /// silent, or because their liveliness tokens are lost.
    pub left: Vec<AgentId>,
    /// Facts that have become believed. A fact about a function has the new value.
    pub believed: Vec<InitElement>,
    /// Facts that have ceased to be believed. A fact about a function has the last value.
    pub retracted: Vec<InitElement>,
}

// === impl DomainChange ===

impl DomainChange {
    /// Whether the change has no visible effect.
    pub fn is_empty(&self) -> bool {
        !self.epoch_changed
            && self.joined.is_empty()
            && self.left.is_empty()
            && self.believed.is_empty()
            && self.retracted.is_empty()
    }
}

impl From<&DomainChange> for EpochChange {
    fn from(change: &DomainChange) -> EpochChange {
        let DomainChange { epoch, revision, epoch_changed: _, joined, left, believed, retracted } =
            change;
        EpochChange {
            epoch: *epoch,
            revision: *revision,
            joined: joined.clone(),
            left: left.clone(),
            believed: text_of(believed),
            retracted: text_of(retracted),
            requested: None,
            requested_since: None,
        }
    }
}

/// Formats facts as PDDL text, one per line.
pub fn text_of(facts: &[InitElement]) -> String {
    facts.iter().map(InitElement::to_string).collect::<Vec<_>>().join("\n")
}
