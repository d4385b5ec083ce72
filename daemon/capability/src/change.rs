//! What a call changed, as plain data: to be told to others, and to be followed by them.

use acl::AgentId;
use acl::content::EpochChange;
use pddl::InitElement;

/// What changed. Empty lists and no new epoch mean: nothing that anyone can see.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// Counts changes of the set of capabilities, from 0 at the start.
    pub epoch: u64,
    /// Counts changes of anything, from 0 at the start.
    pub revision: u64,
    /// Whether this change made the epoch.
    pub epoch_changed: bool,
    /// Agents whose capabilities are there now and were not.
    pub joined: Vec<AgentId>,
    /// Agents whose capabilities are gone or masked.
    pub left: Vec<AgentId>,
    /// Facts that are believed now; of a number, with its new value.
    pub believed: Vec<InitElement>,
    /// Facts that are believed no longer; of a number, with its last value.
    pub retracted: Vec<InitElement>,
}

// === impl Change ===

impl Change {
    /// Whether nothing changed that anyone can see.
    pub fn is_empty(&self) -> bool {
        !self.epoch_changed
            && self.joined.is_empty()
            && self.left.is_empty()
            && self.believed.is_empty()
            && self.retracted.is_empty()
    }
}

impl From<&Change> for EpochChange {
    fn from(change: &Change) -> EpochChange {
        let Change { epoch, revision, epoch_changed: _, joined, left, believed, retracted } =
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

/// Facts as PDDL text, one per line.
pub fn text_of(facts: &[InitElement]) -> String {
    facts.iter().map(InitElement::to_string).collect::<Vec<_>>().join("\n")
}
