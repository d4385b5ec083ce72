//! Verification of seals: which key has signed, whether the signature is for this message, and
//! whether the message is new.
//!
//! A certificate is checked once and remembered by its hash; a signature is checked each time. All
//! stored state is bounded, because it belongs to daemons that the authority has certified.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime};

use acl::DaemonId;
use ring::digest::{SHA256, digest};
use ring::signature::{ED25519, UnparsedPublicKey};

use crate::certificate::Certificate;
use crate::error::DistrustReason;
use crate::identity::SequenceState;
use crate::replay::{MessagePosition, ReplayGuard};
use crate::revocations::Revocations;
use crate::seal::{Nonce, Seal, SealChannel, SignedFields};
use crate::token_bucket::TokenBucket;
use crate::trust::Trust;

/// Maximum number of certificates remembered as valid. When this number is reached, all are dropped
/// and checked again, which takes a tenth of a millisecond for each.
const CERTIFICATES_MAX: usize = 1_024;

/// How long other daemons may take to notice a new incarnation of this daemon. They send roll calls
/// at least once a second while the membership changes.
const NOTICE_GRACE: Duration = Duration::from_secs(5);

/// A received message or answer, with its seal.
#[derive(Clone, Copy, Debug)]
pub struct SealedMessage<'s> {
    /// Channel in which the message was sealed.
    pub channel: SealChannel,
    /// Key expression under which the message came.
    pub key_expr: &'s str,
    /// Payload of the message.
    pub payload: &'s [u8],
    /// Seal that came with the message; `None` if there was none.
    pub seal: Option<&'s [u8]>,
    /// Nonce of the question that is answered; `None` if the message is no answer.
    pub nonce: Option<&'s Nonce>,
    /// The only daemon that may send under this key expression; `None` if there is no such
    /// restriction.
    pub only_sender: Option<&'s str>,
    /// Incarnation of the receiver.
    pub receiver_incarnation: u64,
}

/// Verified origin of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VerifiedOrigin {
    /// Daemon that sent the message, or a guest of a daemon.
    pub sender: DaemonId,
    /// Daemon that owns the key with which the message was signed: the sender itself, or the host
    /// of the guest.
    pub signing_daemon: DaemonId,
}

/// Verifier of the seals of messages. States the reason if a message is rejected.
#[derive(Debug)]
pub struct Verifier {
    trust: RwLock<Trust>,
    /// Certificates that were found valid, by their hash.
    certificates: Mutex<HashMap<[u8; 32], Arc<Certificate>>>,
    /// State of the senders that use one certificate, by the name in the certificate.
    senders: Mutex<BTreeMap<String, SenderState>>,
    /// Maximum number of messages per second under one certificate name; further messages are
    /// rejected.
    messages_per_second: u32,
    began: Instant,
    /// Number of times that the list of revocations has changed.
    revisions: AtomicU64,
}

#[derive(Debug)]
struct SenderState {
    replays: ReplayGuard,
    rate: TokenBucket,
}

// === impl Verifier ===

impl Verifier {
    /// Returns a verifier that trusts the certificates of `trust` and limits the rate per
    /// certificate name.
    pub fn new(trust: Trust, messages_per_second: u32) -> Verifier {
        Verifier {
            trust: RwLock::new(trust),
            certificates: Mutex::default(),
            senders: Mutex::default(),
            messages_per_second,
            began: Instant::now(),
            revisions: AtomicU64::new(0),
        }
    }

    /// Verifies a message and returns its origin.
    ///
    /// # Errors
    ///
    /// Returns the reason why the message is rejected, and the name under which the message came if
    /// that can be read.
    pub fn open(
        &self,
        sealed: SealedMessage<'_>,
    ) -> Result<VerifiedOrigin, (DistrustReason, Option<String>)> {
        let Some(seal) = sealed.seal else { return Err((DistrustReason::Unsigned, None)) };
        let Some(seal) = Seal::read(seal) else { return Err((DistrustReason::Malformed, None)) };
        let certificate = self.certificate(seal.certificate)?;
        let name = certificate.subject.clone();
        let signer = if seal.sender.is_empty() { name.as_str() } else { seal.sender };
        let verified =
            verify_signature(&sealed, &seal, &certificate, signer).and_then(|verified| {
                if sealed.channel != SealChannel::Answer {
                    self.record(&certificate, &seal, &sealed, signer)?;
                }
                Ok(verified)
            });
        verified.map_err(|why| {
            let claimed = if why == DistrustReason::Impostor { signer } else { &name };
            (why, Some(claimed.to_owned()))
        })
    }

    /// Verifies the signature of a message that was overheard, and returns its origin. The message
    /// is not recorded: it may be for another incarnation or have come before, and it does not
    /// count against the rate limit of its sender. `recipient` is the daemon that the message is
    /// for; `None` if it is for all daemons.
    ///
    /// # Errors
    ///
    /// Returns the reason why the signature is not valid.
    pub fn attest(
        &self,
        sealed: SealedMessage<'_>,
        recipient: Option<&str>,
    ) -> Result<VerifiedOrigin, DistrustReason> {
        let seal = sealed.seal.ok_or(DistrustReason::Unsigned)?;
        let seal = Seal::read(seal).ok_or(DistrustReason::Malformed)?;
        let certificate = self.certificate(seal.certificate).map_err(|(why, _)| why)?;
        let name = certificate.subject.as_str();
        let signer = if seal.sender.is_empty() { name } else { seal.sender };
        let channel = match recipient == Some(signer) {
            true => SealChannel::Internal,
            false => sealed.channel,
        };
        verify_signature(&SealedMessage { channel, ..sealed }, &seal, &certificate, signer)
    }

    /// Returns the certificate in `der`; an error if it is not valid now. A certificate is fully
    /// checked the first time and then remembered.
    fn certificate(
        &self,
        der: &[u8],
    ) -> Result<Arc<Certificate>, (DistrustReason, Option<String>)> {
        let now = SystemTime::now();
        let hash = hash(der);
        if let Some(known) = lock(&self.certificates).get(&hash).cloned() {
            if known.is_current(now) {
                return Ok(known);
            }
            return Err((DistrustReason::Expired, Some(known.subject.clone())));
        }
        let Some(certificate) = Certificate::from_der(der) else {
            return Err((DistrustReason::Stranger, None));
        };
        // The lock is held until the certificate is remembered, so that no revocation arrives
        // in between.
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        if let Err(why) = trust.check(&certificate, now) {
            return Err((why, Some(certificate.subject)));
        }
        let certificate = Arc::new(certificate);
        let mut known = lock(&self.certificates);
        if known.len() >= CERTIFICATES_MAX {
            known.clear();
        }
        known.insert(hash, Arc::clone(&certificate));
        Ok(certificate)
    }

    /// Checks a message with a valid signature against the duplicate window and the rate limit, and
    /// records the message.
    fn record(
        &self,
        certificate: &Certificate,
        seal: &Seal<'_>,
        sealed: &SealedMessage<'_>,
        signer: &str,
    ) -> Result<(), DistrustReason> {
        let now = Instant::now();
        let mut heard = lock(&self.senders);
        let heard = self.sender_state(&mut heard, &certificate.subject, now);
        if seal.to != 0 && seal.to != sealed.receiver_incarnation {
            // A sender that has not noticed this new incarnation yet is not at fault.
            let is_young = now.saturating_duration_since(self.began) < NOTICE_GRACE;
            return Err(if is_young {
                DistrustReason::NotSynced
            } else {
                DistrustReason::OldReceiver
            });
        }
        let (channel, is_for_this_incarnation) = (sealed.channel as usize, seal.to != 0);
        let Seal { incarnation, number, at, .. } = *seal;
        let place = MessagePosition { incarnation, channel, number, at, is_for_this_incarnation };
        heard.replays.record(signer, place, now)?;
        // The rate is checked last: a replay of another daemon's messages must not use up that
        // daemon's permits. A message that is dropped because of the rate is sent again under
        // another number.
        match heard.rate.take(self.messages_per_second, now) {
            true => Ok(()),
            false => Err(DistrustReason::Flooded),
        }
    }

    /// Takes permits for `count` more messages that the daemon `voucher` has sent under one seal.
    /// Returns the number of permits taken. So each heartbeat of a batch costs as much as a single
    /// heartbeat.
    pub fn take_permits(&self, voucher: &DaemonId, count: u32) -> u32 {
        let (mut heard, now) = (lock(&self.senders), Instant::now());
        let heard = self.sender_state(&mut heard, voucher.as_str(), now);
        heard.rate.take_up_to(count, self.messages_per_second, now)
    }

    /// Records the answer of a daemon to a roll call. A broadcast of that daemon is accepted only
    /// if its number is greater than the one in the first answer of its incarnation.
    pub fn record_reply(&self, answerer: &VerifiedOrigin, said: SequenceState) {
        let (mut heard, now) = (lock(&self.senders), Instant::now());
        let heard = self.sender_state(&mut heard, answerer.signing_daemon.as_str(), now);
        heard.replays.record_reply(answerer.sender.as_str(), said, now);
    }

    /// Returns the incarnation in which a daemon, or a guest of a daemon, last answered a roll
    /// call; `None` if there was no answer.
    pub fn incarnation(&self, signer: &DaemonId) -> Option<u64> {
        lock(&self.senders).get(signer.host())?.replays.incarnation(signer.as_str())
    }

    /// Returns the state of the senders under one certificate name. Only the authority gives these
    /// names, so they are few.
    fn sender_state<'h>(
        &self,
        heard: &'h mut BTreeMap<String, SenderState>,
        name: &str,
        now: Instant,
    ) -> &'h mut SenderState {
        heard.entry(name.to_owned()).or_insert_with(|| SenderState {
            replays: ReplayGuard::default(),
            rate: TokenBucket::new(self.messages_per_second, now),
        })
    }

    // === revocations ===

    /// Returns the list of revocations in DER; `None` if there is no list.
    pub fn revocations(&self) -> Option<Vec<u8>> {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().map(|list| list.der().to_vec())
    }

    /// Returns the subject of a certificate (in DER) if the certificate was revoked; `None`
    /// otherwise.
    pub fn revoked_subject(&self, certificate: &[u8]) -> Option<String> {
        let certificate = Certificate::from_der(certificate)?;
        self.has_revoked(&certificate).then_some(certificate.subject)
    }

    /// Returns the number of times that the list of revocations has changed.
    pub fn revocations_revision(&self) -> u64 {
        self.revisions.load(Ordering::Acquire)
    }

    /// Whether a certificate was revoked.
    pub fn has_revoked(&self, certificate: &Certificate) -> bool {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().is_some_and(|list| list.contains(certificate))
    }

    /// Uses a list of revocations that came over the network from now on, if it is newer than the
    /// known one; does not store it. Returns whether the list was newer; `None` if the authority
    /// has not signed it.
    pub fn take_revocations(&self, der: &[u8]) -> Option<bool> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.verify_revocations(der)?
        };
        Some(self.take(list))
    }

    /// Uses the list of revocations in the files from now on, if it is newer than the known one.
    /// Returns whether the list was newer.
    ///
    /// # Errors
    ///
    /// Returns an error if a list cannot be read, or the authority has not signed it.
    pub fn reread_revocations(&self) -> Result<bool, crate::CredentialError> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.read_revocations()?
        };
        Ok(list.is_some_and(|list| self.take(list)))
    }

    /// Stores the newest list of revocations in its file for the next run of this daemon.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be written.
    pub fn store_revocations(&self) -> Result<(), crate::CredentialError> {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        match trust.revocations() {
            Some(list) => trust.store(list),
            None => Ok(()),
        }
    }

    fn take(&self, list: Revocations) -> bool {
        let mut trust = self.trust.write().unwrap_or_else(PoisonError::into_inner);
        let is_newer = trust.take(list);
        if is_newer {
            // Certificates that were valid have to be checked against the new list.
            lock(&self.certificates).clear();
            self.revisions.fetch_add(1, Ordering::AcqRel);
        }
        is_newer
    }
}

/// Verifies the signature of a message, and that its key may sign for `signer`.
fn verify_signature(
    sealed: &SealedMessage<'_>,
    seal: &Seal<'_>,
    certificate: &Certificate,
    signer: &str,
) -> Result<VerifiedOrigin, DistrustReason> {
    let statement = SignedFields {
        channel: sealed.channel,
        incarnation: seal.incarnation,
        number: seal.number,
        at: seal.at,
        to: seal.to,
        sender: seal.sender,
        key_expr: sealed.key_expr,
        nonce: sealed.nonce.map_or(&[], Nonce::as_slice),
    };
    let key = certificate.public_key.ok_or(DistrustReason::Stranger)?;
    let key = UnparsedPublicKey::new(&ED25519, key);
    let signed = statement.bytes(sealed.payload);
    key.verify(&signed, seal.signature).map_err(|_| DistrustReason::Forged)?;
    let verified = speaking(signer, certificate).ok_or(DistrustReason::Impostor)?;
    match sealed.only_sender.is_some_and(|only| only != signer) {
        true => Err(DistrustReason::Impostor),
        false => Ok(verified),
    }
}

/// Returns the origin of a message that was sent under the name `signer` with this certificate;
/// `None` if the certificate does not cover that name.
fn speaking(signer: &str, certificate: &Certificate) -> Option<VerifiedOrigin> {
    let signer = DaemonId::new(signer).ok()?;
    let voucher = certificate.daemon()?;
    let is_its_own = signer.host() == voucher.as_str();
    is_its_own.then_some(VerifiedOrigin { sender: signer, signing_daemon: voucher })
}

fn hash(bytes: &[u8]) -> [u8; 32] {
    let mut hash = [0; 32];
    hash.copy_from_slice(digest(&SHA256, bytes).as_ref());
    hash
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
