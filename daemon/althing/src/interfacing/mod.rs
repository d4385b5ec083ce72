//! Interfacing nodes as ecosystem files mean them: what is wrong with an interface is said before
//! anything is opened. What they do is in the crate of this name.

mod check;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use ::interfacing::Shore;
pub(crate) use ::interfacing::{connect, voice};
use agent::Landing;
pub(crate) use check::{Other, check, load};

use crate::config::Ecosystem;

impl Ecosystem {
    /// This ecosystem, where agents of an interface live in it.
    pub(crate) fn shore(&self, landing: Landing) -> Shore {
        let (domain, problem) = (Arc::clone(&self.domain), Arc::clone(&self.problem));
        Shore { name: self.name.clone(), domain, problem, landing }
    }
}
