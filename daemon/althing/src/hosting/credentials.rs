//! What this process speaks and hears with in a secured ecosystem: the daemon with its own key, a
//! guest with that of a daemon whose files it can read.
//!
//! A daemon tells the guests of its machine where its keys are by a file beside its socket, in a
//! folder that belongs to its user alone: who may speak to the socket may read the key.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use ::credentials::{Certificate, CredentialError, Folder, Identity, Trust, Verifier};
use acl::{DaemonId, EcosystemId};
use agent::Machine;
use substrate_zenoh::Security;

use super::folders::state_folder;
use crate::config::{SecuritySettings, credentials_folder};

/// The ending of the file that says where a daemon's keys are.
const KEYS: &str = "keys";

/// How often the end of a certificate is announced.
const ANNOUNCED_EVERY: Duration = Duration::from_secs(24 * 3_600);

/// What a guest hears in a second from one daemon at most. Commands hear little; this is to bound
/// what a daemon gone mad can do to them.
const GUEST_MESSAGES_PER_SECOND: u32 = 5_000;

/// With whose key a guest speaks.
#[derive(Clone, Debug)]
pub(crate) struct GuestKeys {
    folder: Folder,
    daemon: DaemonId,
}

/// What a daemon speaks and hears with; what it hears of revocations it keeps with its state.
///
/// # Errors
///
/// If its key or a certificate is missing, or of no worth.
pub(crate) fn secure(
    ecosystem: &EcosystemId,
    daemon: &DaemonId,
    settings: &SecuritySettings,
) -> Result<Security, String> {
    let kept = state_folder(ecosystem, daemon).map_err(|error| error.to_string())?;
    let folder = Folder::new(&settings.folder);
    let read = || -> Result<Security, CredentialError> {
        let trust = Trust::read(&folder)?.keeping(kept.join("revoked.pem"))?;
        // Later than any before, also where the clock was put back.
        let life = Machine::new(Some(kept.clone())).next_life();
        let identity = Identity::read(&folder, daemon, &trust)?.in_life(life.0);
        let identity = Arc::new(identity);
        let verifier = Arc::new(Verifier::new(trust, settings.messages_per_second_max));
        Ok(Security { identity, verifier })
    };
    read().map_err(|error| error.to_string())
}

/// Says while the daemon lives that its certificate, or the authority's, is near its end.
pub(crate) async fn announce_end(security: Security, folder: PathBuf, before: Duration) {
    loop {
        let now = SystemTime::now();
        let own = security.identity.certificate().clone();
        let authority = Certificate::read(&Folder::new(&folder).authority()).ok();
        for certificate in [Some(own), authority].into_iter().flatten() {
            let left = certificate.left(now);
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

/// Tells the guests of this machine where a daemon's keys are.
///
/// # Errors
///
/// If the file cannot be written.
pub(crate) fn tell_keys(socket: &Path, folder: &Path) -> io::Result<()> {
    let absolute = fs::canonicalize(folder)?;
    fs::write(socket.with_extension(KEYS), absolute.as_os_str().as_encoded_bytes())
}

/// Tells them that there are none.
pub(crate) fn forget_keys(socket: &Path) {
    // There may never have been any.
    let _ = fs::remove_file(socket.with_extension(KEYS));
}

// === impl GuestKeys ===

impl GuestKeys {
    /// Finds the keys of a secured ecosystem: `Ok(None)` where it is not secured, as far as that
    /// can be known here.
    ///
    /// # Errors
    ///
    /// If it is secured, and nobody's key is here, or several are and none was chosen.
    pub(crate) fn find(
        ecosystem: &EcosystemId,
        settings: Option<&SecuritySettings>,
        sockets: &[PathBuf],
        chosen: Option<&str>,
        host: Option<&DaemonId>,
    ) -> Result<Option<GuestKeys>, String> {
        let told = || sockets.iter().find_map(|socket| read_told(socket));
        let default = || {
            let folder = Folder::new(credentials_folder(ecosystem));
            // Only where nothing better is known of the ecosystem, and somebody is elsewhere.
            (sockets.is_empty() && folder.authority().is_file()).then_some(folder)
        };
        let folder = match settings {
            Some(settings) => Some(Folder::new(&settings.folder)),
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
                    "speak in `{ecosystem}`, which is secured: there is no key in {place}; speak \
                     as the user of the daemon, or make one with `althing cert daemon NAME`"
                ),
                false => {
                    let names: Vec<_> = here.iter().map(DaemonId::as_str).collect();
                    let names = names.join(", ");
                    format!("choose whose key of {place} to speak with: say --as, one of {names}")
                }
            });
        };
        Ok(Some(GuestKeys { folder, daemon }))
    }

    /// Those of a daemon.
    pub(crate) fn of(settings: &SecuritySettings, daemon: &DaemonId) -> GuestKeys {
        GuestKeys { folder: Folder::new(&settings.folder), daemon: daemon.clone() }
    }

    /// What a guest of this role speaks and hears with, and the name it goes by.
    ///
    /// # Errors
    ///
    /// If the key cannot be read.
    pub(crate) fn security(&self, role: &str) -> Result<(DaemonId, Security), String> {
        let read = || -> Result<(Identity, Trust), CredentialError> {
            let trust = Trust::read(&self.folder)?;
            Ok((Identity::read(&self.folder, &self.daemon, &trust)?, trust))
        };
        let (identity, trust) = read().map_err(|error| error.to_string())?;
        let role = format!("{role}-{}", std::process::id());
        let guest = self.daemon.guest(&role).map_err(|error| error.to_string())?;
        let identity = Arc::new(identity.for_guest(guest.clone()));
        let verifier = Arc::new(Verifier::new(trust, GUEST_MESSAGES_PER_SECOND));
        Ok((guest, Security { identity, verifier }))
    }
}

fn read_told(socket: &Path) -> Option<Folder> {
    let path = fs::read_to_string(socket.with_extension(KEYS)).ok()?;
    Some(Folder::new(path))
}
