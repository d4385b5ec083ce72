//! Interfaces between ecosystems, as ecosystem files define them. They are checked here before
//! anything is opened. The crate `interfacing` implements them.

mod check;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use ::interfacing::EcosystemEndpoint;
pub(crate) use ::interfacing::{connect, remote_client};
use agent::Spawner;
pub(crate) use check::{PeerEcosystem, check, load};

use crate::config::Ecosystem;

impl Ecosystem {
    /// Returns the endpoint in this ecosystem at which the proxy agents of an interface run.
    pub(crate) fn ecosystem_endpoint(&self, spawner: Spawner) -> EcosystemEndpoint {
        let (domain, problem) = (Arc::clone(&self.domain), Arc::clone(&self.problem));
        EcosystemEndpoint { name: self.name.clone(), domain, problem, spawner }
    }
}
