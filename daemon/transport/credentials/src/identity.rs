//! A daemon's own key and certificate, with which the daemon seals its messages.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use ring::signature::{Ed25519KeyPair, KeyPair as _};
use serde::{Deserialize, Serialize};

use crate::certificate::Certificate;
use crate::error::CredentialError;
use crate::files::{self, CredentialFolder};
use crate::seal::{Nonce, Seal, SealChannel, SignedFields};
use crate::trust::Trust;

/// Number of seal channels, the kinds of sealed messages.
const CHANNELS: usize = 4;

/// The seal channels in which messages have sequence numbers.
const NUMBERED: [usize; NUMBERED_CHANNELS] =
    [SealChannel::Message as usize, SealChannel::AgentState as usize];
pub(crate) const NUMBERED_CHANNELS: usize = 2;

/// Sequence numbers that a sender has reached, as it states them in its answer to a roll call (the
/// query to all daemons). Every message with a number up to these was sent before that answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SequenceState {
    /// Incarnation of the sender: the time at which it started, in microseconds since the Unix
    /// epoch.
    pub incarnation: u64,
    /// The last sequence number that the sender has used in each numbered channel, in the order of
    /// [`SealChannel`].
    pub numbers: [u64; NUMBERED_CHANNELS],
    /// Age of the sender's incarnation in milliseconds, by a monotonic clock. 0 if the sender runs
    /// a version that does not state the age.
    #[serde(default)]
    pub age: u64,
}

/// Channel, sequence number and receiving incarnation of a message, for its seal.
struct SealNumbers {
    channel: SealChannel,
    number: u64,
    to: u64,
}

/// The key of a daemon, and the name under which the daemon signs.
pub struct DaemonIdentity {
    folder: CredentialFolder,
    certificate: Certificate,
    key: Ed25519KeyPair,
    /// Name under which messages are signed: the daemon, or a guest that signs with the daemon's
    /// key.
    sender: DaemonId,
    incarnation: u64,
    began: Instant,
    numbers: [AtomicU64; CHANNELS],
}

impl std::fmt::Debug for DaemonIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identity").field("speaker", &self.sender).finish_non_exhaustive()
    }
}

// === impl DaemonIdentity ===

impl DaemonIdentity {
    /// Reads a daemon's key and certificate from the folder, and checks them against `trust`. A new
    /// incarnation of the daemon begins.
    ///
    /// # Errors
    ///
    /// Returns an error if the key or the certificate is missing or not valid here, or if other
    /// users can read the key.
    pub fn read(
        folder: &CredentialFolder,
        daemon: &DaemonId,
        trust: &Trust,
    ) -> Result<DaemonIdentity, CredentialError> {
        let (key_path, path) = (folder.key(daemon), folder.certificate(daemon));
        for (what, path) in [("a daemon's key", &key_path), ("a daemon's certificate", &path)] {
            if !path.exists() {
                let remedy = format!(
                    "make it with `althing cert daemon {daemon}` where the authority is, and copy \
                     {daemon}.key, {daemon}.pem and authority.pem to {}",
                    folder.path().display()
                );
                return Err(CredentialError::Missing { what, path: path.clone(), remedy });
            }
        }
        let malformed = |path: &std::path::Path, problem: &str| CredentialError::Malformed {
            path: path.to_owned(),
            problem: problem.to_owned(),
        };
        let key = files::read_key(&key_path)?;
        let key = Ed25519KeyPair::from_pkcs8_maybe_unchecked(key.secret_pkcs8_der())
            .map_err(|_| malformed(&key_path, "it is not an Ed25519 key"))?;
        let certificate = Certificate::read(&path)?;
        if certificate.public_key.as_ref().map(<[u8; 32]>::as_slice)
            != Some(key.public_key().as_ref())
        {
            let problem = format!("it is not the certificate of {}", key_path.display());
            return Err(malformed(&path, &problem));
        }
        if certificate.subject != daemon.as_str() {
            let problem = format!("it is the certificate of `{}`", certificate.subject);
            return Err(malformed(&path, &problem));
        }
        if let Err(why) = trust.check(&certificate, SystemTime::now()) {
            return Err(CredentialError::Distrusted { path, why });
        }
        Ok(DaemonIdentity {
            folder: folder.clone(),
            certificate,
            key,
            sender: daemon.clone(),
            incarnation: now(),
            began: Instant::now(),
            numbers: Default::default(),
        })
    }

    /// Sets the incarnation, which must be greater than every earlier one. Needed if the clock may
    /// have been set back.
    #[must_use]
    pub fn with_incarnation(self, incarnation: u64) -> DaemonIdentity {
        DaemonIdentity { incarnation, ..self }
    }

    /// Returns the identity of `guest`, a guest that signs with the key of this daemon; see
    /// [`DaemonId::guest`].
    #[must_use]
    pub fn for_guest(self, guest: DaemonId) -> DaemonIdentity {
        DaemonIdentity { sender: guest, ..self }
    }

    /// Returns the daemon or guest that signs the messages.
    pub fn sender(&self) -> &DaemonId {
        &self.sender
    }

    /// Returns the certificate of the daemon that owns the key.
    pub fn certificate(&self) -> &Certificate {
        &self.certificate
    }

    /// Returns the paths of three files for TLS: the daemon's key, its certificate, and the
    /// certificate of its authority.
    pub fn files(&self) -> (std::path::PathBuf, std::path::PathBuf, std::path::PathBuf) {
        let daemon = DaemonId::new(&self.certificate.subject);
        let daemon = daemon.expect("invariant: its subject was a daemon when it was read");
        let folder = &self.folder;
        (folder.key(&daemon), folder.certificate(&daemon), folder.authority())
    }

    /// Returns the incarnation of the sender, the age of the incarnation, and the number of
    /// messages sealed in each numbered channel.
    pub fn sequence_state(&self) -> SequenceState {
        let numbers = NUMBERED.map(|channel| self.numbers[channel].load(Ordering::Relaxed));
        SequenceState { incarnation: self.incarnation, numbers, age: self.age() }
    }

    fn age(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Returns the seal for a payload that is sent under the key expression `key_expr`. The payload
    /// is for the incarnation `to` of one daemon, or for all daemons if `to` is `None`.
    pub fn seal(
        &self,
        channel: SealChannel,
        key_expr: &str,
        payload: &[u8],
        to: Option<u64>,
    ) -> Vec<u8> {
        let number = self.numbers[channel as usize].fetch_add(1, Ordering::Relaxed) + 1;
        let to = to.unwrap_or_default();
        self.write_seal(SealNumbers { channel, number, to }, key_expr, payload, &[])
    }

    /// Returns the seal for an answer to the question that has the nonce `nonce`.
    pub fn seal_answer(&self, key_expr: &str, payload: &[u8], nonce: &Nonce) -> Vec<u8> {
        let numbers = SealNumbers { channel: SealChannel::Answer, number: 0, to: 0 };
        self.write_seal(numbers, key_expr, payload, nonce)
    }

    fn write_seal(
        &self,
        SealNumbers { channel, number, to }: SealNumbers,
        key_expr: &str,
        payload: &[u8],
        nonce: &[u8],
    ) -> Vec<u8> {
        let is_itself = self.sender.as_str() == self.certificate.subject;
        let signer = if is_itself { "" } else { self.sender.as_str() };
        let (incarnation, at) = (self.incarnation, self.age());
        let statement =
            SignedFields { channel, incarnation, number, at, to, sender: signer, key_expr, nonce };
        let signature = self.key.sign(&statement.bytes(payload));
        let certificate = self.certificate.der.as_ref();
        Seal {
            incarnation,
            number,
            at,
            to,
            sender: signer,
            signature: signature.as_ref(),
            certificate,
        }
        .write()
    }
}

/// Returns the number of a new incarnation, taken from the clock. The number is greater than that
/// of every earlier incarnation, unless the clock was set back.
fn now() -> u64 {
    let micros = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    u64::try_from(micros).unwrap_or(u64::MAX)
}
