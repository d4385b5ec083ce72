//! Opens seals: whose key, whether over this, whether for the first time.
//!
//! A certificate is checked once and remembered by its hash; a signature each time. Everything
//! that is kept is bounded, and only of daemons that the authority knows.

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

/// Certificates remembered as good. Beyond it all are checked anew, which takes a tenth of a
/// millisecond each.
const CERTIFICATES_MAX: usize = 1_024;

/// How long others may take to notice that a daemon has begun a new life: they call it at least once a
/// second while anybody comes or goes.
const NOTICED: Duration = Duration::from_secs(5);

/// Something heard, with its seal.
#[derive(Clone, Copy, Debug)]
pub struct Sealed<'s> {
    /// What kind it is.
    pub channel: Channel,
    /// Under which key expression it came.
    pub key_expr: &'s str,
    /// Its bytes.
    pub payload: &'s [u8],
    /// What came beside them.
    pub seal: Option<&'s [u8]>,
    /// Of an answer: what was chosen for the question.
    pub nonce: Option<&'s Nonce>,
    /// The daemon that alone may say something under this key expression, if there is one.
    pub only: Option<&'s str>,
    /// The life of who has heard it.
    pub heard_in: u64,
}

/// Who has said something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verified {
    /// The daemon, or a guest of one.
    pub speaker: DaemonId,
    /// The daemon whose key it is: the same, or the guest's host.
    pub voucher: DaemonId,
}

/// Believes, or says why not.
#[derive(Debug)]
pub struct Verifier {
    trust: RwLock<Trust>,
    /// By the hash of the certificate.
    known: Mutex<HashMap<[u8; 32], Arc<Certificate>>>,
    /// By the name in the certificate.
    heard: Mutex<BTreeMap<String, Heard>>,
    /// How many messages one certificate's name may send in a second.
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
    /// Believes whom `trust` trusts, up to so many messages a second from each.
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

    /// Who has said this.
    ///
    /// # Errors
    ///
    /// Says why it is not believed, and in whose name it came as far as that can be read.
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

    /// A certificate that is good now.
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
        // Held until it is remembered, so that a revocation does not come between.
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

    /// Notes that a message was heard, whose signature is good.
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
            // Whoever has not noticed yet that this is another life of it is not to blame.
            let is_young = now.saturating_duration_since(self.began) < NOTICED;
            return Err(if is_young { Distrust::Uncalled } else { Distrust::Belated });
        }
        let (channel, is_for_this_life) = (sealed.channel as usize, seal.to != 0);
        let Seal { life, number, at, .. } = *seal;
        let place = Place { life, channel, number, at, is_for_this_life };
        heard.replays.note(speaker, place, now)?;
        // Last the rate: whoever plays again what was recorded of others must not use up theirs. A
        // message that is dropped for it is told again under another number.
        match heard.rate.take(self.messages_per_second, now) {
            true => Ok(()),
            false => Err(Distrust::Flooded),
        }
    }

    /// How many of so many more messages one may send that has come with a seal of its own: those
    /// that several agents say together cost what they would cost one by one.
    pub fn allowed(&self, voucher: &DaemonId, count: u32) -> u32 {
        let (mut heard, now) = (lock(&self.heard), Instant::now());
        let heard = self.heard_of(&mut heard, voucher.as_str(), now);
        heard.rate.take_up_to(count, self.messages_per_second, now)
    }

    /// Who was asked has answered how far it has come: what it has said to all before is not
    /// believed, what it says from now on is.
    pub fn answered(&self, answerer: &Verified, said: Said) {
        let (mut heard, now) = (lock(&self.heard), Instant::now());
        let heard = self.heard_of(&mut heard, answerer.voucher.as_str(), now);
        heard.replays.answered(answerer.speaker.as_str(), said, now);
    }

    /// The life in which a daemon, or a guest of one, has last answered how far it has come.
    pub fn life(&self, speaker: &DaemonId) -> Option<u64> {
        lock(&self.heard).get(speaker.host())?.replays.life(speaker.as_str())
    }

    /// What was heard of one certificate's name. The names are those that the authority has given:
    /// they are few.
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

    /// The list of revocations as it travels, if there is one.
    pub fn revocations(&self) -> Option<Vec<u8>> {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().map(|list| list.der().to_vec())
    }

    /// To whom a certificate was made out, if it was taken back. It is given in DER, as it comes.
    pub fn revoked(&self, certificate: &[u8]) -> Option<String> {
        let certificate = Certificate::from_der(certificate)?;
        self.has_revoked(&certificate).then_some(certificate.subject)
    }

    /// How often the list of revocations has changed.
    pub fn revisions(&self) -> u64 {
        self.revisions.load(Ordering::Acquire)
    }

    /// Whether a certificate was taken back.
    pub fn has_revoked(&self, certificate: &Certificate) -> bool {
        let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
        trust.revocations().is_some_and(|list| list.has(certificate))
    }

    /// Takes a list that came over the wire, and keeps it in the folder. `None`: it is not the
    /// authority's; otherwise whether it was news.
    pub fn take_revocations(&self, der: &[u8]) -> Option<bool> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.revocations_of(der)?
        };
        Some(self.take(list))
    }

    /// Takes the list in the folder, if there is a newer one; whether there was.
    ///
    /// # Errors
    ///
    /// If there is one that cannot be used.
    pub fn reread_revocations(&self) -> Result<bool, crate::CredentialError> {
        let list = {
            let trust = self.trust.read().unwrap_or_else(PoisonError::into_inner);
            trust.read_revocations()?
        };
        Ok(list.is_some_and(|list| self.take(list)))
    }

    /// Keeps the newest list in the folder for the next life.
    ///
    /// # Errors
    ///
    /// If the folder cannot be written.
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
            // Whoever was believed is looked at again.
            lock(&self.known).clear();
            self.revisions.fetch_add(1, Ordering::AcqRel);
        }
        is_newer
    }
}

/// Who speaks with this certificate under this name, if they may.
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
