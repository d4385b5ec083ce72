//! Which requested words were not told yet to those who hear heartbeats only.

use std::collections::BTreeSet;

use crate::belief::Source;
use crate::fact::{FactKey, Owner};

/// Of more than this all words are told anew.
const UNTOLD_MAX: usize = 1_024;

/// Whose words about what may be other than when they were told last.
#[derive(Clone, Debug, Default)]
pub(crate) enum Untold {
    /// Any: nothing was told yet, or too much is other.
    #[default]
    Any,
    These(BTreeSet<(FactKey, Owner)>),
}

impl Untold {
    /// A word of `owner` about a fact comes or goes: it has to be told, if it is one of the map or
    /// came by request.
    pub(crate) fn note(&mut self, fact: &FactKey, owner: &Owner, source: Source) {
        let Untold::These(untold) = self else { return };
        if *owner != Owner::Map && !source.is_requested() {
            return;
        }
        untold.insert((fact.clone(), owner.clone()));
        if untold.len() > UNTOLD_MAX {
            *self = Untold::Any;
        }
    }

    /// All of them; from now on, those that come.
    pub(crate) fn take(&mut self) -> Untold {
        std::mem::replace(self, Untold::nothing())
    }

    /// None yet.
    pub(crate) fn nothing() -> Untold {
        Untold::These(BTreeSet::new())
    }

    /// Whether a word may be one of them.
    pub(crate) fn has(&self, fact: &FactKey, owner: &Owner) -> bool {
        match self {
            Untold::Any => true,
            Untold::These(untold) => untold.contains(&(fact.clone(), owner.clone())),
        }
    }
}
