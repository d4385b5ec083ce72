//! Puts seals (signatures) on outgoing messages, and verifies the seals of incoming ones. Seals are
//! needed because messages are relayed: the link over which a message arrives does not show its
//! origin.
//!
//! A message from a daemon to its own agents never leaves the process and has no seal. The seal of
//! every message that comes over a link is verified here, before any other code parses the message.

use std::sync::Arc;

use acl::DaemonId;
use bytes::Bytes;
use credentials::{
    DaemonIdentity, DistrustReason, Nonce, SealChannel, SealedMessage, SequenceState,
    VerifiedOrigin, Verifier,
};
use substrate::{Answer, Inbound, Origin, Rejected, ViolationKind};
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;

use crate::key_expr::KeySpace;

/// Keys of one daemon of a secured ecosystem.
#[derive(Clone, Debug)]
pub struct Security {
    /// The daemon's own key and certificate, with which it signs.
    pub identity: Arc<DaemonIdentity>,
    /// The trusted certificates, with which signatures are verified.
    pub verifier: Arc<Verifier>,
}

/// An answer to a question, with what is needed to verify it.
#[derive(Clone, Copy)]
pub(crate) struct UnverifiedAnswer<'a> {
    pub(crate) keys: &'a KeySpace,
    pub(crate) inbound: &'a dyn Inbound,
    pub(crate) sample: &'a Sample,
    pub(crate) payload: &'a Bytes,
    /// Nonce that was sent with the question. If it is `None`, no answer is accepted.
    pub(crate) nonce: Option<&'a Nonce>,
}

// === impl Security ===

impl Security {
    /// Returns the seal for a payload that goes to all daemons under this key.
    pub(crate) fn seal(&self, channel: SealChannel, key_expr: &str, payload: &[u8]) -> ZBytes {
        ZBytes::from(self.identity.seal(channel, key_expr, payload, None))
    }

    /// Returns the seal for a message to the daemon `to`. The seal is valid only for the
    /// incarnation in which that daemon last answered.
    pub(crate) fn seal_to(&self, to: &DaemonId, key_expr: &str, payload: &[u8]) -> ZBytes {
        let incarnation = self.verifier.incarnation(to);
        ZBytes::from(self.identity.seal(SealChannel::Message, key_expr, payload, incarnation))
    }

    /// Returns the sequence numbers that this daemon has signed so far. The daemon sends them in
    /// its answers to roll calls.
    pub(crate) fn said(&self) -> SequenceState {
        self.identity.sequence_state()
    }

    /// Records the sequence numbers `said`, with which a daemon has answered a roll call. From now
    /// on, broadcasts of that daemon are rejected if their sequence numbers are not greater.
    pub(crate) fn record_reply(&self, answerer: Origin, said: SequenceState) {
        let Origin { daemon: signer, signing_daemon: voucher } = answerer;
        self.verifier
            .record_reply(&VerifiedOrigin { sender: signer, signing_daemon: voucher }, said);
    }

    /// Returns the origin of a message, if its seal proves the origin; otherwise `None`. A message
    /// without a proven origin is reported to `inbound` as rejected. It is only logged if its seal
    /// may be valid, but the sender's daemon or this one started so recently that this cannot be
    /// checked.
    pub(crate) fn origin(
        &self,
        keys: &KeySpace,
        inbound: &dyn Inbound,
        sample: &Sample,
        payload: &Bytes,
    ) -> Option<Origin> {
        let key = sample.key_expr().as_str();
        let channel = match keys.only_sender(key) {
            Some(_) => SealChannel::AgentState,
            None => SealChannel::Message,
        };
        self.open(keys, inbound, channel, key, payload, sample.attachment(), None)
    }

    /// Whether `answered` is sealed as an answer to the question with this nonce, by a daemon that
    /// may answer it.
    pub(crate) fn admits(&self, answered: &UnverifiedAnswer<'_>) -> bool {
        let origin = self.answerer(answered);
        let about = answered.keys.answered_resource(answered.sample.key_expr().as_str());
        let (Some(origin), Some((resource, agent))) = (origin, about) else {
            return false;
        };
        let UnverifiedAnswer { inbound, payload, .. } = answered;
        inbound.accepts_answer(&Answer {
            origin: &origin,
            resource,
            agent: agent.as_ref(),
            payload,
        })
    }

    /// Returns the origin of an answer to the question with this nonce, if its seal proves the
    /// origin; otherwise `None`. The origin is the daemon that the key of the answer names.
    pub(crate) fn answerer(&self, answered: &UnverifiedAnswer<'_>) -> Option<Origin> {
        let UnverifiedAnswer { keys, inbound, sample, payload, nonce } = *answered;
        let (key, seal, channel) =
            (sample.key_expr().as_str(), sample.attachment(), SealChannel::Answer);
        self.open(keys, inbound, channel, key, payload, seal, Some(nonce?))
    }

    #[expect(clippy::too_many_arguments, reason = "a message in its parts")]
    fn open(
        &self,
        keys: &KeySpace,
        inbound: &dyn Inbound,
        channel: SealChannel,
        key_expr: &str,
        payload: &Bytes,
        attachment: Option<&ZBytes>,
        nonce: Option<&Nonce>,
    ) -> Option<Origin> {
        let seal = attachment.map(ZBytes::to_bytes);
        let seal = seal.as_deref();
        let heard_in = self.identity.sequence_state().incarnation;
        let only = keys.only_sender(key_expr);
        let sealed = SealedMessage {
            channel,
            key_expr,
            payload,
            seal,
            nonce,
            only_sender: only,
            receiver_incarnation: heard_in,
        };
        let opened = self.verifier.open(sealed);
        opened
            .map(|VerifiedOrigin { sender: signer, signing_daemon: voucher }| Origin {
                daemon: signer,
                signing_daemon: voucher,
            })
            .map_err(|(why, claimed)| {
                if why == DistrustReason::NotSynced {
                    // Nothing is wrong with the message; its daemon has just started and has not
                    // answered a roll call yet, or it does not know yet that this daemon has just
                    // started.
                    return tracing::debug!(from = claimed, key = key_expr, "ignored: it {why}");
                }
                let (violation, detail) = (violation(why), why.to_string());
                let (detail, claimed) = (detail.as_str(), claimed.as_deref());
                inbound.rejected(&Rejected { violation, detail, claimed, key: key_expr });
            })
            .ok()
    }

    /// Returns the origin of this daemon's messages to its own agents.
    pub(crate) fn own(daemon: &DaemonId) -> Origin {
        Origin { daemon: daemon.clone(), signing_daemon: daemon.clone() }
    }
}

/// Returns the seal for an answer; `None` if the question came without a nonce.
pub(crate) fn seal_answer(
    identity: &DaemonIdentity,
    key_expr: &str,
    payload: &[u8],
    nonce: Option<&ZBytes>,
) -> Option<ZBytes> {
    let nonce = nonce?.to_bytes();
    let nonce = Nonce::try_from(&*nonce).ok()?;
    Some(ZBytes::from(identity.seal_answer(key_expr, payload, &nonce)))
}

fn violation(why: DistrustReason) -> ViolationKind {
    match why {
        DistrustReason::Unsigned => ViolationKind::Unsigned,
        DistrustReason::Stranger | DistrustReason::Expired => ViolationKind::Unknown,
        DistrustReason::Revoked => ViolationKind::Revoked,
        DistrustReason::Replayed | DistrustReason::OldReceiver | DistrustReason::Delayed => {
            ViolationKind::Replayed
        }
        DistrustReason::Flooded => ViolationKind::Flooded,
        // All other defects are the result of an attempt to forge.
        _ => ViolationKind::Forged,
    }
}
