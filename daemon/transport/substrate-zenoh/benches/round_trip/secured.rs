//! Certificates for the secured pair of daemons in the benchmark.

use std::sync::Arc;

use acl::{DaemonId, EcosystemId};
use agent::{AllowedNames, AllowedRequesters, Rights};
use credentials::{
    AUTHORITY_DAYS, Authority, CredentialFolder, DAEMON_DAYS, DaemonIdentity, Trust, Verifier,
};
use substrate_zenoh::Security;
use tempfile::TempDir;

use crate::Error;

/// Rate limit per second that two agents cannot reach, even if they do nothing but exchange
/// messages.
const MESSAGES_PER_SECOND: u32 = 1_000_000;

/// A certificate authority with its files in a temporary folder.
pub(crate) struct House {
    folder: CredentialFolder,
    authority: Authority,
    _temporary: TempDir,
}

impl House {
    pub(crate) fn new() -> Result<House, Error> {
        let temporary = tempfile::tempdir()?;
        let folder = CredentialFolder::new(temporary.path().join("keys"));
        let ecosystem = EcosystemId::new("secured")?;
        let authority = Authority::create(&folder, &ecosystem, AUTHORITY_DAYS)?;
        Ok(House { folder, authority, _temporary: temporary })
    }

    pub(crate) fn security(&self, daemon: &str) -> Result<Security, Error> {
        let daemon = DaemonId::new(daemon)?;
        self.authority.issue(&daemon, &[], DAEMON_DAYS)?;
        let trust = Trust::read(&self.folder)?;
        let identity = Arc::new(DaemonIdentity::read(&self.folder, &daemon, &trust)?);
        Ok(Security { identity, verifier: Arc::new(Verifier::new(trust, MESSAGES_PER_SECOND)) })
    }

    /// Returns the default rights of an ecosystem file; every message is checked against them.
    pub(crate) fn rights() -> Rights {
        Rights {
            guests: AllowedNames::All,
            goals: AllowedRequesters::All,
            changes: AllowedRequesters::All,
            history: AllowedRequesters::All,
            ..Rights::default()
        }
    }
}
