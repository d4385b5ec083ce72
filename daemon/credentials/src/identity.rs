//! A daemon's own key and certificate, which seal its messages.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use ring::signature::{Ed25519KeyPair, KeyPair as _};
use serde::{Deserialize, Serialize};

use crate::certificate::Certificate;
use crate::error::CredentialError;
use crate::files::{self, CredentialFolder};
use crate::seal::{Nonce, Seal, SignedFields};
use crate::trust::Trust;

/// Number of channels.
const CHANNELS: usize = 3;

/// The channels with sequence numbers.
const NUMBERED: [usize; NUMBERED_CHANNELS] =
    [SealChannel::Message as usize, SealChannel::AgentState as usize];
pub(crate) const NUMBERED_CHANNELS: usize = 2;

/// Kind of message. Messages of one channel arrive nearly in order; those of two channels may overtake each
/// other at will, so each channel has its own sequence numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum SealChannel {
    /// Messages to one agent and to all.
    Message = 0,
    /// Models and heartbeats, which travel at a lower priority.
    AgentState = 1,
    /// Answers to questions: they are bound to their question by its nonce, and not numbered.
    Answer = 2,
}

/// Sequence numbers that a sender has reached, as it states them in answer to a call: every message with a
/// number up to these was sent earlier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SequenceState {
    /// Incarnation: microseconds since the Unix epoch at its start.
    pub life: u64,
    /// The last number of each numbered channel, in the order of [`SealChannel`].
    pub numbers: [u64; NUMBERED_CHANNELS],
    /// Age of the incarnation in milliseconds, by a monotonic clock. 0 if the sender's version does not
    /// state it.
    #[serde(default)]
    pub age: u64,
}

/// Position of a message among the others, for its seal.
struct SealNumbers {
    channel: SealChannel,
    number: u64,
    to: u64,
}

/// The key of a daemon, and the name under which it signs.
pub struct DaemonIdentity {
    folder: CredentialFolder,
    certificate: Certificate,
    key: Ed25519KeyPair,
    /// The daemon, or a guest that signs with its key.
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

// === impl Identity ===

impl DaemonIdentity {
    /// Reads a daemon's key and certificate, and checks them against `trust`. A new incarnation begins.
    ///
    /// # Errors
    ///
    /// Returns an error if one of them is missing, can be read by others, or is not valid here.
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

    /// Sets the incarnation to one known to be later than all before, in case the clock was set back.
    #[must_use]
    pub fn with_incarnation(self, life: u64) -> DaemonIdentity {
        DaemonIdentity { incarnation: life, ..self }
    }

    /// Uses the same key for a guest of this daemon; see [`DaemonId::guest`].
    #[must_use]
    pub fn for_guest(self, guest: DaemonId) -> DaemonIdentity {
        DaemonIdentity { sender: guest, ..self }
    }

    /// Returns the daemon or guest that signs.
    pub fn sender(&self) -> &DaemonId {
        &self.sender
    }

    /// Returns the certificate.
    pub fn certificate(&self) -> &Certificate {
        &self.certificate
    }

    /// Returns the files of its key, its certificate and its authority's certificate, for TLS.
    pub fn files(&self) -> (std::path::PathBuf, std::path::PathBuf, std::path::PathBuf) {
        let daemon = DaemonId::new(&self.certificate.subject);
        let daemon = daemon.expect("invariant: its subject was a daemon when it was read");
        let folder = &self.folder;
        (folder.key(&daemon), folder.certificate(&daemon), folder.authority())
    }

    /// Returns the incarnation, its age, and the number of messages sealed in each numbered channel.
    pub fn sequence_state(&self) -> SequenceState {
        let numbers = NUMBERED.map(|channel| self.numbers[channel].load(Ordering::Relaxed));
        SequenceState { life: self.incarnation, numbers, age: self.age() }
    }

    fn age(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Returns the seal for a payload that goes out under this key expression: to the incarnation `to` of
    /// one daemon, or to all.
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

    /// Returns the seal for an answer to the question with this nonce.
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
        let speaker = if is_itself { "" } else { self.sender.as_str() };
        let (life, at) = (self.incarnation, self.age());
        let statement = SignedFields {
            channel,
            incarnation: life,
            number,
            at,
            to,
            sender: speaker,
            key_expr,
            nonce,
        };
        let signature = self.key.sign(&statement.bytes(payload));
        let certificate = self.certificate.der.as_ref();
        Seal {
            incarnation: life,
            number,
            at,
            to,
            sender: speaker,
            signature: signature.as_ref(),
            certificate,
        }
        .write()
    }
}

/// Returns a new incarnation by the clock: greater than every earlier one, unless the clock was set back.
fn now() -> u64 {
    let micros = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    u64::try_from(micros).unwrap_or(u64::MAX)
}
