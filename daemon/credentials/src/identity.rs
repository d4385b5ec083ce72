//! A daemon's own key and certificate: what it seals its messages with.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use ring::signature::{Ed25519KeyPair, KeyPair as _};
use serde::{Deserialize, Serialize};

use crate::certificate::Certificate;
use crate::error::CredentialError;
use crate::files::{self, Folder};
use crate::seal::{Nonce, Seal, Statement};
use crate::trust::Trust;

/// How many channels there are.
const CHANNELS: usize = 3;

/// The channels whose messages are numbered.
const NUMBERED: [usize; NUMBERED_CHANNELS] = [Channel::Message as usize, Channel::Beat as usize];
pub(crate) const NUMBERED_CHANNELS: usize = 2;

/// Messages of one channel come nearly in order; those of two may overtake each other at will, and
/// are numbered apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Channel {
    /// Messages to one and to all.
    Message = 0,
    /// Models and heartbeats, which travel at a lower priority.
    Beat = 1,
    /// Answers to questions: they are bound to their question, and not numbered.
    Answer = 2,
}

/// How far a speaker has come, by its own word in answer to a question: whatever it has numbered
/// up to here, it has said before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Said {
    /// Its life: microseconds since the Unix epoch at its beginning.
    pub life: u64,
    /// The last number of each numbered channel, in the order of [`Channel`].
    pub numbers: [u64; NUMBERED_CHANNELS],
    /// How old its life is: milliseconds, by a clock that nobody sets. Nothing, of who does not say
    /// when it has sealed what.
    #[serde(default)]
    pub age: u64,
}

/// What a seal says of its place among others.
struct Numbers {
    channel: Channel,
    number: u64,
    to: u64,
}

/// Who speaks, and with which key.
pub struct Identity {
    folder: Folder,
    certificate: Certificate,
    key: Ed25519KeyPair,
    /// The daemon, or a guest that speaks with its key.
    speaker: DaemonId,
    life: u64,
    began: Instant,
    numbers: [AtomicU64; CHANNELS],
}

impl std::fmt::Debug for Identity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Identity").field("speaker", &self.speaker).finish_non_exhaustive()
    }
}

// === impl Identity ===

impl Identity {
    /// Reads a daemon's key and certificate, of which `trust` must think well. Its life begins.
    ///
    /// # Errors
    ///
    /// If one of them is missing, can be read by others, or is not worth anything here.
    pub fn read(
        folder: &Folder,
        daemon: &DaemonId,
        trust: &Trust,
    ) -> Result<Identity, CredentialError> {
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
            .map_err(|_| malformed(&key_path, "it is no Ed25519 key"))?;
        let certificate = Certificate::read(&path)?;
        if certificate.public_key.as_ref().map(<[u8; 32]>::as_slice)
            != Some(key.public_key().as_ref())
        {
            let problem = format!("it is not the certificate of {}", key_path.display());
            return Err(malformed(&path, &problem));
        }
        if certificate.subject != daemon.as_str() {
            let problem = format!("it is made out to `{}`", certificate.subject);
            return Err(malformed(&path, &problem));
        }
        if let Err(why) = trust.check(&certificate, SystemTime::now()) {
            return Err(CredentialError::Distrusted { path, why });
        }
        Ok(Identity {
            folder: folder.clone(),
            certificate,
            key,
            speaker: daemon.clone(),
            life: now(),
            began: Instant::now(),
            numbers: Default::default(),
        })
    }

    /// The same, in a life that is known to be later than any before, where the clock may not say so.
    #[must_use]
    pub fn in_life(self, life: u64) -> Identity {
        Identity { life, ..self }
    }

    /// The same key, for a guest of this daemon; see [`DaemonId::guest`].
    #[must_use]
    pub fn for_guest(self, guest: DaemonId) -> Identity {
        Identity { speaker: guest, ..self }
    }

    /// Who speaks.
    pub fn speaker(&self) -> &DaemonId {
        &self.speaker
    }

    /// Its certificate.
    pub fn certificate(&self) -> &Certificate {
        &self.certificate
    }

    /// The files of its key, its certificate and its authority's certificate, for TLS.
    pub fn files(&self) -> (std::path::PathBuf, std::path::PathBuf, std::path::PathBuf) {
        let daemon = DaemonId::new(&self.certificate.subject);
        let daemon = daemon.expect("invariant: it was made out to a daemon when it was read");
        let folder = &self.folder;
        (folder.key(&daemon), folder.certificate(&daemon), folder.authority())
    }

    /// Which life this is, and how many messages it has sealed in each numbered channel.
    pub fn said(&self) -> Said {
        let numbers = NUMBERED.map(|channel| self.numbers[channel].load(Ordering::Relaxed));
        Said { life: self.life, numbers, age: self.age() }
    }

    fn age(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// The seal for a payload that goes out under this key expression, to one daemon in this life
    /// of it, or to all.
    pub fn seal(
        &self,
        channel: Channel,
        key_expr: &str,
        payload: &[u8],
        to: Option<u64>,
    ) -> Vec<u8> {
        let number = self.numbers[channel as usize].fetch_add(1, Ordering::Relaxed) + 1;
        let to = to.unwrap_or_default();
        self.sealed(Numbers { channel, number, to }, key_expr, payload, &[])
    }

    /// The seal for an answer to the question with this nonce.
    pub fn seal_answer(&self, key_expr: &str, payload: &[u8], nonce: &Nonce) -> Vec<u8> {
        let numbers = Numbers { channel: Channel::Answer, number: 0, to: 0 };
        self.sealed(numbers, key_expr, payload, nonce)
    }

    fn sealed(
        &self,
        Numbers { channel, number, to }: Numbers,
        key_expr: &str,
        payload: &[u8],
        nonce: &[u8],
    ) -> Vec<u8> {
        let is_itself = self.speaker.as_str() == self.certificate.subject;
        let speaker = if is_itself { "" } else { self.speaker.as_str() };
        let (life, at) = (self.life, self.age());
        let statement = Statement { channel, life, number, at, to, speaker, key_expr, nonce };
        let signature = self.key.sign(&statement.bytes(payload));
        let certificate = self.certificate.der.as_ref();
        Seal { life, number, at, to, speaker, signature: signature.as_ref(), certificate }.write()
    }
}

/// A life, by its beginning: greater than that of any life before, if the clock does not jump.
fn now() -> u64 {
    let micros = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    u64::try_from(micros).unwrap_or(u64::MAX)
}
