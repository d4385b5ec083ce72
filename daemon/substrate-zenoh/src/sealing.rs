//! Where seals are put on and opened: a link is not an origin, because messages are relayed.
//!
//! What a daemon says to its own agents never leaves the process and carries no seal. Whatever
//! comes over a link is opened here, before anything reads it.

use std::sync::Arc;

use acl::DaemonId;
use bytes::Bytes;
use credentials::{Channel, Distrust, Identity, Nonce, Said, Sealed, Verified, Verifier};
use substrate::{Answer, Breach, Inbound, Origin, Rejected};
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;

use crate::key_expr::Keys;

/// What a daemon of a secured ecosystem speaks and hears with.
#[derive(Clone, Debug)]
pub struct Security {
    /// Its own key.
    pub identity: Arc<Identity>,
    /// Whom it believes.
    pub verifier: Arc<Verifier>,
}

/// An answer, and what it is held against.
#[derive(Clone, Copy)]
pub(crate) struct Answered<'a> {
    pub(crate) keys: &'a Keys,
    pub(crate) inbound: &'a dyn Inbound,
    pub(crate) sample: &'a Sample,
    pub(crate) payload: &'a Bytes,
    /// Sent with the question; without one, no answer is believed.
    pub(crate) nonce: Option<&'a Nonce>,
}

// === impl Security ===

impl Security {
    /// The seal for what goes out to all under this key.
    pub(crate) fn seal(&self, channel: Channel, key_expr: &str, payload: &[u8]) -> ZBytes {
        ZBytes::from(self.identity.seal(channel, key_expr, payload, None))
    }

    /// The seal for a message that goes to one daemon, in the life in which it has answered.
    pub(crate) fn seal_to(&self, to: &DaemonId, key_expr: &str, payload: &[u8]) -> ZBytes {
        let life = self.verifier.life(to);
        ZBytes::from(self.identity.seal(Channel::Message, key_expr, payload, life))
    }

    /// How far this daemon has come, for who calls it.
    pub(crate) fn said(&self) -> Said {
        self.identity.said()
    }

    /// A daemon has answered a call. What it has said before, and is heard after, is not believed.
    pub(crate) fn answered(&self, answerer: Origin, said: Said) {
        let Origin { daemon: speaker, voucher } = answerer;
        self.verifier.answered(&Verified { speaker, voucher }, said);
    }

    /// Who has sent this; what is not believed is told to `inbound`.
    pub(crate) fn origin(
        &self,
        keys: &Keys,
        inbound: &dyn Inbound,
        sample: &Sample,
        payload: &Bytes,
    ) -> Option<Origin> {
        let key = sample.key_expr().as_str();
        let channel = match keys.speaker(key) {
            Some(_) => Channel::Beat,
            None => Channel::Message,
        };
        self.open(keys, inbound, channel, key, payload, sample.attachment(), None)
    }

    /// Whether this answers the question with this nonce, and may.
    pub(crate) fn admits(&self, answered: &Answered<'_>) -> bool {
        let origin = self.answerer(answered);
        let about = answered.keys.answered(answered.sample.key_expr().as_str());
        let (Some(origin), Some((resource, agent))) = (origin, about) else {
            return false;
        };
        let Answered { inbound, payload, .. } = answered;
        inbound.admits(&Answer { origin: &origin, resource, agent: agent.as_ref(), payload })
    }

    /// Who has said this, to the question with this nonce: it is that daemon whose key it has.
    pub(crate) fn answerer(&self, answered: &Answered<'_>) -> Option<Origin> {
        let Answered { keys, inbound, sample, payload, nonce } = *answered;
        let (key, seal, channel) =
            (sample.key_expr().as_str(), sample.attachment(), Channel::Answer);
        self.open(keys, inbound, channel, key, payload, seal, Some(nonce?))
    }

    #[expect(clippy::too_many_arguments, reason = "what was heard, and where it is told")]
    fn open(
        &self,
        keys: &Keys,
        inbound: &dyn Inbound,
        channel: Channel,
        key_expr: &str,
        payload: &Bytes,
        attachment: Option<&ZBytes>,
        nonce: Option<&Nonce>,
    ) -> Option<Origin> {
        let seal = attachment.map(ZBytes::to_bytes);
        let seal = seal.as_deref();
        let heard_in = self.identity.said().life;
        let only = keys.speaker(key_expr);
        let sealed = Sealed { channel, key_expr, payload, seal, nonce, only, heard_in };
        let opened = self.verifier.open(sealed);
        opened
            .map(|Verified { speaker, voucher }| Origin { daemon: speaker, voucher })
            .map_err(|(why, claimed)| {
                if why == Distrust::Uncalled {
                    // Nothing is wrong with it; it is of who has just come, and not here yet.
                    return tracing::debug!(from = claimed, key = key_expr, "not heard: it {why}");
                }
                let (breach, detail) = (breach(why), why.to_string());
                let (detail, claimed) = (detail.as_str(), claimed.as_deref());
                inbound.rejected(&Rejected { breach, detail, claimed, key: key_expr });
            })
            .ok()
    }

    /// What this daemon says to itself.
    pub(crate) fn own(daemon: &DaemonId) -> Origin {
        Origin { daemon: daemon.clone(), voucher: daemon.clone() }
    }
}

/// The seal for an answer, where the asker has sent a nonce.
pub(crate) fn seal_answer(
    identity: &Identity,
    key_expr: &str,
    payload: &[u8],
    nonce: Option<&ZBytes>,
) -> Option<ZBytes> {
    let nonce = nonce?.to_bytes();
    let nonce = Nonce::try_from(&*nonce).ok()?;
    Some(ZBytes::from(identity.seal_answer(key_expr, payload, &nonce)))
}

fn breach(why: Distrust) -> Breach {
    match why {
        Distrust::Unsigned => Breach::Unsigned,
        Distrust::Stranger | Distrust::Expired => Breach::Unknown,
        Distrust::Revoked => Breach::Revoked,
        Distrust::Replayed | Distrust::Belated | Distrust::Overdue => Breach::Replayed,
        Distrust::Flooded => Breach::Flooded,
        // What else can be wrong is so because somebody made it so.
        _ => Breach::Forged,
    }
}
