//! Verifies seals: which key has signed, whether it has signed this message, and whether the message is
//! new.
//!
//! A certificate is checked once and remembered by its hash; a signature is checked each time. All stored
//! state is bounded, and belongs to daemons that the authority has certified.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime};

use acl::DaemonId;
use ring::digest::{SHA256, digest};
use ring::signature::{ED25519, UnparsedPublicKey};

use crate::certificate::Certificate;
use crate::error::Distrust;
use crate::identity::{Channel, Said};
use crate::rate::Rate;
use crate::replay::{Place, Replays};
use crate::revocations::Revocations;
use crate::seal::{Nonce, Seal, Statement};
use crate::trust::Trust;

/// Maximum number of certificates remembered as valid. When it is reached all are dropped and checked anew,
/// which takes a tenth of a millisecond each.
const CERTIFICATES_MAX: usize = 1_024;

/// How long other daemons may take to notice a new incarnation of this one: they call it at least once a
/// second while the membership changes.
const NOTICED: Duration = Duration::from_secs(5);

/// A received message or answer, with its seal.
#[derive(Clone, Copy, Debug)]
pub struct Sealed<'s> {
    /// Its channel.
    pub channel: Channel,
    /// Key expression under which it came.
    pub key_expr: &'s str,
    /// Payload of the message.
    pub payload: &'s [u8],
    /// Seal that came with it, if any.
    pub seal: Option<&'s [u8]>,
    /// Nonce of the question, if this is an answer.
    pub nonce: Option<&'s Nonce>,
    /// The only daemon that may send under this key expression; `None` if there is no such restriction.
    pub only: Option<&'s str>,
    /// Incarnation of the receiver.
    pub heard_in: u64,
}

/// Verified origin of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verified {
    /// The sender: a daemon, or a guest of one.
    pub speaker: DaemonId,
    /// The daemon that owns the key: the sender itself, or the guest's host.
    pub voucher: DaemonId,
}

/// Verifies messages, and returns the reason if one is not believed.
#[derive(Debug)]
pub struct Verifier {
    trust: RwLock<Trust>,
    /// Valid certificates, by their hash.
    known: Mutex<HashMap<[u8; 32], Arc<Certificate>>>,
    /// State per name in a certificate.
    heard: Mutex<BTreeMap<String, Heard>>,
    /// Maximum number of messages per second and certificate name.
    messages_per_second: u32,
    began: Instant,
    /// How often the list of revocations has changed.
    revisions: AtomicU64,
}

#[derive(Debug)]
struct Heard {
    replays: Replays,
    rate: Rate,
}

// === impl Verifier ===

impl Verifier {
    /// Returns a verifier with these trusted certificates and this rate limit per sender.
    pub fn new(trust: Trust, messages_per_second: u32) -> Verifier {
        Verifier {
            trust: RwLock::new(trust),
            known: Mutex::default(),
            heard: Mutex::default(),
            messages_per_second,
            began: Instant::now(),
            revisions: AtomicU64::new(0),
        }
    }

    /// Verifies a message and returns its origin.
    ///
    /// # Errors
    ///
    /// Returns the reason why it is not believed, and the name in which it came if that can be read.
    pub fn open(&self, sealed: Sealed<'_>) -> Result<Verified, (Distrust, Option<String>)> {
        let Some(seal) = sealed.seal else { return Err((Distrust::Unsigned, None)) };
        let Some(seal) = Seal::read(seal) else { return Err((Distrust::Malformed, None)) };
        let certificate = self.certificate(seal.certificate)?;
        let name = certificate.subject.clone();
        let speaker = if seal.speaker.is_empty() { name.as_str() } else { seal.speaker };
        let verified = self.verify(&sealed, &seal, &certificate, speaker);
        verified.map_err(|why| {
            let claimed = if why == Distrust::Impostor { speaker } else { &name };
            (why, Some(claimed.to_owned()))
        })
    }

    fn verify(
        &self,
        sealed: &Sealed<'_>,
        seal: &Seal<'_>,
        certificate: &Certificate,
        speaker: &str,
    ) -> Result<Verified, Distrust> {
        let statement = Statement {
            channel: sealed.channel,
            life: seal.life,
            number: seal.number,
            at: seal.at,
            to: seal.to,
            speaker: seal.speaker,
            key_expr: sealed.key_expr,
            nonce: sealed.nonce.map_or(&[], Nonce::as_slice),
        };
        let key = certificate.public_key.ok_or(Distrust::Stranger)?;
        let key = UnparsedPublicKey::new(&ED25519, key);
        let signed = statement.bytes(sealed.payload);
        key.verify(&signed, seal.signature).map_err(|_| Distrust::Forged)?;
        let verified = speaking(speaker, certificate).ok_or(Distrust::Impostor)?;
        if sealed.only.is_some_and(|only| only != speaker) {
            return Err(Distrust::Impostor);
        }
        if sealed.channel != Channel::Answer {
            self.note(certificate, seal, sealed, speaker)?;
        }
        Ok(verified)
    }

    /// Returns a certificate that is valid now, from memory or after a check.
    fn certificate(&self, der: &[u8]) -> Result<Arc<Certificate>, (Distrust, Option<String>)> {
        let now = SystemTime::now();
        let hash = hash(der);
        if let Some(known) = lock(&self.known).get(&hash).cloned() {
            if known.is_current(now) {
                return Ok(known);
            }
            return Err((Distrust::Expired, Some(known.subject.clone())));
        }
        let Some(certificate) = Certificate::from_der(der) else {
            return Err((Distrust::Stranger, None));
        };
        // The lock is held until the certificate is remembered, so that no revocation comes between.
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        if let Err(why) = trust.check(&certificate, now) {
            return Err((why, Some(certificate.subject)));
        }
        let certificate = Arc::new(certificate);
        let mut known = lock(&self.known);
        if known.len() >= CERTIFICATES_MAX {
            known.clear();
        }
        known.insert(hash, Arc::clone(&certificate));
        Ok(certificate)
    }

    /// Checks a message with a valid signature against the duplicate window and the rate limit, and records
    /// it.
    fn note(
        &self,
        certificate: &Certificate,
        seal: &Seal<'_>,
        sealed: &Sealed<'_>,
        speaker: &str,
    ) -> Result<(), Distrust> {
        let now = Instant::now();
        let mut heard = lock(&self.heard);
        let heard = self.heard_of(&mut heard, &certificate.subject, now);
        if seal.to != 0 && seal.to != sealed.heard_in {
            // A sender that has not noticed this new incarnation yet is not at fault.
            let is_young = now.saturating_duration_since(self.began) < NOTICED;
            return Err(if is_young { Distrust::Uncalled } else { Distrust::Belated });
        }
        let (channel, is_for_this_life) = (sealed.channel as usize, seal.to != 0);
        let Seal { life, number, at, .. } = *seal;
        let place = Place { life, channel, number, at, is_for_this_life };
        heard.replays.note(speaker, place, now)?;
        // The rate is checked last: a replay of another daemon's messages must not use up that daemon's
        // permits. A message that is dropped because of the rate is sent again under another number.
        match heard.rate.take(self.messages_per_second, now) {
            true => Ok(()),
            false => Err(Distrust::Flooded),
        }
    }

    /// Returns how many of `count` more messages the daemon may send that came under one seal: each
    /// heartbeat of a batch costs the same as a single one.
    pub fn allowed(&self, voucher: &DaemonId, count: u32) -> u32 {
        let (mut heard, now) = (lock(&self.heard), Instant::now());
        let heard = self.heard_of(&mut heard, voucher.as_str(), now);
        heard.rate.take_up_to(count, self.messages_per_second, now)
    }

    /// Records the answer of a daemon to a call. Broadcasts with a number up to `said` are not believed;
    /// later ones are.
    pub fn answered(&self, answerer: &Verified, said: Said) {
        let (mut heard, now) = (lock(&self.heard), Instant::now());
        let heard = self.heard_of(&mut heard, answerer.voucher.as_str(), now);
        heard.replays.answered(answerer.speaker.as_str(), said, now);
    }

    /// Returns the incarnation in which a daemon, or a guest of one, last answered a call.
    pub fn life(&self, speaker: &DaemonId) -> Option<u64> {
        lock(&self.heard).get(speaker.host())?.replays.life(speaker.as_str())
    }

    /// Returns the state of one certificate name. Only the authority gives these names, so they are few.
    fn heard_of<'h>(
        &self,
        heard: &'h mut BTreeMap<String, Heard>,
        name: &str,
        now: Instant,
    ) -> &'h mut Heard {
        heard.entry(name.to_owned()).or_insert_with(|| Heard {
            replays: Replays::default(),
            rate: Rate::new(self.messages_per_second, now),
        })
    }

    // === revocations ===

    /// Returns the list of revocations in DER, if there is one.
    pub fn revocations(&self) -> Option<Vec<u8>> {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().map(|list| list.der().to_vec())
    }

    /// Returns the subject of a certificate (in DER) if it was revoked; `None` otherwise.
    pub fn revoked(&self, certificate: &[u8]) -> Option<String> {
        let certificate = Certificate::from_der(certificate)?;
        self.has_revoked(&certificate).then_some(certificate.subject)
    }

    /// Returns how often the list of revocations has changed.
    pub fn revisions(&self) -> u64 {
        self.revisions.load(Ordering::Acquire)
    }

    /// Whether a certificate was revoked.
    pub fn has_revoked(&self, certificate: &Certificate) -> bool {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().is_some_and(|list| list.has(certificate))
    }

    /// Takes a list that came over the network, without storing it. Returns `None` if the authority has not
    /// signed it; otherwise whether it was newer.
    pub fn take_revocations(&self, der: &[u8]) -> Option<bool> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.revocations_of(der)?
        };
        Some(self.take(list))
    }

    /// Takes the list in the folder if it is newer; returns whether it was.
    ///
    /// # Errors
    ///
    /// Returns an error if there is a list that cannot be used.
    pub fn reread_revocations(&self) -> Result<bool, crate::CredentialError> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.read_revocations()?
        };
        Ok(list.is_some_and(|list| self.take(list)))
    }

    /// Stores the newest list in the folder for the next incarnation.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be written.
    pub fn keep_revocations(&self) -> Result<(), crate::CredentialError> {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        match trust.revocations() {
            Some(list) => trust.keep(list),
            None => Ok(()),
        }
    }

    fn take(&self, list: Revocations) -> bool {
        let mut trust = self.trust.write().unwrap_or_else(PoisonError::into_inner);
        let is_newer = trust.take(list);
        if is_newer {
            // Certificates that were valid have to be checked against the new list.
            lock(&self.known).clear();
            self.revisions.fetch_add(1, Ordering::AcqRel);
        }
        is_newer
    }
}

/// Returns the origin of a message with this certificate and sender name; `None` if the certificate does
/// not cover the name.
fn speaking(speaker: &str, certificate: &Certificate) -> Option<Verified> {
    let speaker = DaemonId::new(speaker).ok()?;
    let voucher = certificate.daemon()?;
    let is_its_own = speaker.host() == voucher.as_str();
    is_its_own.then_some(Verified { speaker, voucher })
}

fn hash(bytes: &[u8]) -> [u8; 32] {
    let mut hash = [0; 32];
    hash.copy_from_slice(digest(&SHA256, bytes).as_ref());
    hash
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
