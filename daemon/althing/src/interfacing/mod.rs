//! Interfaces between ecosystems, as ecosystem files define them: checks an interface before
//! anything is opened. What an interface does is in the crate `interfacing`.

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
    /// Returns the endpoint of this ecosystem in which the proxy agents of an interface run.
    pub(crate) fn shore(&self, landing: Landing) -> Shore {
        let (domain, problem) = (Arc::clone(&self.domain), Arc::clone(&self.problem));
        Shore { name: self.name.clone(), domain, problem, landing }
    }
}
