//! Certificates for the secured pair of daemons.

use std::sync::Arc;

use acl::{DaemonId, EcosystemId};
use agent::{AllowedNames, AllowedRequesters, Rights};
use credentials::{
    AUTHORITY_DAYS, Authority, CredentialFolder, DAEMON_DAYS, DaemonIdentity, Trust, Verifier,
};
use substrate_zenoh::Security;
use tempfile::TempDir;

use crate::Error;

/// Rate limit, which two agents that do nothing else cannot reach.
const MESSAGES_PER_SECOND: u32 = 1_000_000;

/// An authority in a folder of its own.
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

    /// The default rights of an ecosystem's file; every message is checked against them.
    pub(crate) fn rights() -> Rights {
        Rights {
            guests: AllowedNames::All,
            goals: AllowedRequesters::All,
            changes: AllowedRequesters::All,
            ..Rights::default()
        }
    }
}
