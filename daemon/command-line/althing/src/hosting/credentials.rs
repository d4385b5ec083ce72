//! The credentials of this process in a secured ecosystem. A daemon uses its own key. A guest uses
//! the key of a daemon on its machine, if it can read the key's file.
//!
//! A file beside the socket of a daemon tells the guests on the machine where the daemon's keys
//! are. The file and the socket are in a folder that belongs to the daemon's user alone, so that a
//! process that can open the socket can also read the key.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use ::credentials::{
    Certificate, CredentialError, CredentialFolder, DaemonIdentity, Trust, Verifier,
};
use acl::{DaemonId, EcosystemId};
use agent::HostServices;
use substrate_zenoh::Security;

use super::folders::state_folder;
use crate::config::{SecuritySettings, credentials_folder};

/// The extension of the file that contains the path of the folder with a daemon's keys.
const KEYS: &str = "keys";

/// How often a warning is logged that a certificate expires soon.
const ANNOUNCED_EVERY: Duration = Duration::from_secs(24 * 3_600);

/// Maximum number of messages per second that a guest accepts from one daemon; further ones are
/// rejected. Commands receive few messages; this limit bounds the harm that a faulty daemon can do
/// to them.
const GUEST_MESSAGES_PER_SECOND: u32 = 5_000;

/// The daemon that lends its key to a guest, and the folder with that key.
#[derive(Clone, Debug)]
pub(crate) struct GuestKeys {
    folder: CredentialFolder,
    daemon: DaemonId,
}

/// Returns the keys with which a daemon seals and verifies messages. Revocations that the daemon
/// receives are stored in its state folder.
///
/// # Errors
///
/// Returns an error if the daemon's key or a certificate is missing or invalid.
pub(crate) fn secure(
    ecosystem: &EcosystemId,
    daemon: &DaemonId,
    settings: &SecuritySettings,
) -> Result<Security, String> {
    let kept = state_folder(ecosystem, daemon).map_err(|error| error.to_string())?;
    let folder = CredentialFolder::new(&settings.folder);
    let read = || -> Result<Security, CredentialError> {
        let trust = Trust::read(&folder)?.storing_at(kept.join("revoked.pem"))?;
        // This number is greater than that of each earlier incarnation, even if the clock was set
        // back.
        let incarnation = HostServices::new(Some(kept.clone())).next_incarnation();
        let identity =
            DaemonIdentity::read(&folder, daemon, &trust)?.with_incarnation(incarnation.0);
        let identity = Arc::new(identity);
        let verifier = Arc::new(Verifier::new(trust, settings.messages_per_second_max));
        Ok(Security { identity, verifier })
    };
    read().map_err(|error| error.to_string())
}

/// Logs a warning once a day if the certificate of the daemon or that of the authority expires
/// within the time `before`. Never returns.
pub(crate) async fn warn_of_expiry(security: Security, folder: PathBuf, before: Duration) {
    loop {
        let now = SystemTime::now();
        let own = security.identity.certificate().clone();
        let authority = Certificate::read(&CredentialFolder::new(&folder).authority()).ok();
        for certificate in [Some(own), authority].into_iter().flatten() {
            let left = certificate.remaining(now);
            if left <= before {
                let (subject, days) = (&certificate.subject, left.as_secs() / (24 * 3_600));
                let remedy = match certificate.daemon() {
                    Some(daemon) => format!("make a new one: althing cert daemon {daemon}"),
                    None => "make a new authority, and all certificates anew".to_owned(),
                };
                tracing::warn!("the certificate of `{subject}` ends in {days} days; {remedy}");
            }
        }
        tokio::time::sleep(ANNOUNCED_EVERY).await;
    }
}

/// Writes the file by which the guests on this machine find the folder of a daemon's keys.
///
/// # Errors
///
/// Returns an error if the file cannot be written.
pub(crate) fn publish_keys(socket: &Path, folder: &Path) -> io::Result<()> {
    let absolute = fs::canonicalize(folder)?;
    fs::write(socket.with_extension(KEYS), absolute.as_os_str().as_encoded_bytes())
}

/// Removes the file that [`publish_keys`] writes, because the daemon has no keys.
pub(crate) fn unpublish_keys(socket: &Path) {
    // The file may be missing.
    let _ = fs::remove_file(socket.with_extension(KEYS));
}

// === impl GuestKeys ===

impl GuestKeys {
    /// Finds the key that a guest can use in a secured ecosystem. Returns `Ok(None)` if nothing on
    /// this machine shows that the ecosystem is secured.
    ///
    /// # Errors
    ///
    /// Returns an error if the ecosystem is secured, and this machine has no key, or has several of
    /// which none was chosen.
    pub(crate) fn find(
        ecosystem: &EcosystemId,
        settings: Option<&SecuritySettings>,
        sockets: &[PathBuf],
        chosen: Option<&str>,
        host: Option<&DaemonId>,
    ) -> Result<Option<GuestKeys>, String> {
        let told = || sockets.iter().find_map(|socket| read_told(socket));
        let default = || {
            let folder = CredentialFolder::new(credentials_folder(ecosystem));
            // This folder is used only if no daemon runs here and the file names no folder: the
            // daemons may run on other machines.
            (sockets.is_empty() && folder.authority().is_file()).then_some(folder)
        };
        let folder = match settings {
            Some(settings) => Some(CredentialFolder::new(&settings.folder)),
            None => told().or_else(default),
        };
        let Some(folder) = folder else { return Ok(None) };
        let here = folder.daemons();
        let trust = Trust::read(&folder).ok();
        let is_good = |name: &DaemonId| {
            let certificate = Certificate::read(&folder.certificate(name)).ok();
            let checked = trust.as_ref().zip(certificate);
            checked.is_some_and(|(trust, each)| trust.check(&each, SystemTime::now()).is_ok())
        };
        let of_sockets = sockets.iter().filter_map(|socket| {
            let name = DaemonId::new(socket.file_stem()?.to_str()?).ok()?;
            (here.contains(&name) && is_good(&name)).then_some(name)
        });
        let is_here = |name: &&DaemonId| here.contains(*name);
        let only = || here.first().filter(|_| here.len() == 1).cloned();
        let daemon = match chosen {
            Some(name) => Some(DaemonId::new(name).map_err(|error| error.to_string())?),
            None => of_sockets.chain(host.filter(is_here).cloned()).next().or_else(only),
        };
        let Some(daemon) = daemon else {
            let place = folder.path().display();
            return Err(match here.is_empty() {
                true => format!(
                    "join `{ecosystem}`, which is secured: there is no key in {place}; run this as \
                     the user of the daemon, or make a key with `althing cert daemon NAME`"
                ),
                false => {
                    let names: Vec<_> = here.iter().map(DaemonId::as_str).collect();
                    let names = names.join(", ");
                    format!("choose a key in {place}: name one with --as: {names}")
                }
            });
        };
        Ok(Some(GuestKeys { folder, daemon }))
    }

    /// Returns the keys of the daemon `daemon`, for use by a guest.
    pub(crate) fn of(settings: &SecuritySettings, daemon: &DaemonId) -> GuestKeys {
        GuestKeys { folder: CredentialFolder::new(&settings.folder), daemon: daemon.clone() }
    }

    /// Returns the name of a guest with the role `role`, and the keys with which it seals and
    /// verifies messages.
    ///
    /// # Errors
    ///
    /// Returns an error if the key cannot be read.
    pub(crate) fn security(&self, role: &str) -> Result<(DaemonId, Security), String> {
        let read = || -> Result<(DaemonIdentity, Trust), CredentialError> {
            let trust = Trust::read(&self.folder)?;
            Ok((DaemonIdentity::read(&self.folder, &self.daemon, &trust)?, trust))
        };
        let (identity, trust) = read().map_err(|error| error.to_string())?;
        let role = format!("{role}-{}", std::process::id());
        let guest = self.daemon.guest(&role).map_err(|error| error.to_string())?;
        let identity = Arc::new(identity.for_guest(guest.clone()));
        let verifier = Arc::new(Verifier::new(trust, GUEST_MESSAGES_PER_SECOND));
        Ok((guest, Security { identity, verifier }))
    }
}

fn read_told(socket: &Path) -> Option<CredentialFolder> {
    let path = fs::read_to_string(socket.with_extension(KEYS)).ok()?;
    Some(CredentialFolder::new(path))
}
