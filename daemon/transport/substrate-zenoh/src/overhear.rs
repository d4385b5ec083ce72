//! Overhearing: the messages between all agents of an ecosystem, for a process that watches them.
//!
//! In a secured ecosystem the signature of each overheard message is verified, and messages without
//! a valid one are dropped. Whether a message is new is not checked, because a listener does not
//! act on it: it may have come before, and it may be for another incarnation of its receiver.
//!
//! Messages that the listening daemon itself receives are passed to its listeners before they are
//! passed to its agents ([`OverheardInbound`]). An agent answers at once, on another thread: a
//! listener with a subscriber of its own would hear many answers before their questions.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use acl::AgentId;
use bytes::Bytes;
use credentials::{DistrustReason, SealChannel, SealedMessage};
use substrate::{
    Answer, Delivery, Destination, Inbound, Origin, OverhearCallback, OverheardMessage, Presence,
    ReceivedQuery, Rejected, Subject,
};
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::batch;
use crate::inbound::into_bytes;
use crate::key_expr::KeySpace;
use crate::open_error::{OpenError, undeclared};
use crate::sealing::Security;

/// The listeners of one daemon, by a running number. Clones refer to the same listeners.
#[derive(Clone, Default)]
pub(crate) struct OverhearListeners(Arc<RwLock<NumberedListeners>>);

#[derive(Default)]
struct NumberedListeners {
    count: u64,
    listeners: BTreeMap<u64, OverhearCallback>,
}

/// The receiving side of a daemon, in front of which its listeners hear every message.
pub(crate) struct OverheardInbound {
    inner: Arc<dyn Inbound>,
    listeners: OverhearListeners,
}

/// Listener to all messages of an ecosystem.
#[derive(Clone)]
pub(crate) struct Eavesdropper {
    pub(crate) keys: KeySpace,
    /// Whether messages that the daemon itself receives are left out, because its listeners hear
    /// them from [`OverheardInbound`].
    pub(crate) leaves_out_own: bool,
    /// Keys with which signatures are verified; `None` if the ecosystem is not secured.
    pub(crate) security: Option<Security>,
}

// === impl OverhearListeners ===

impl OverhearListeners {
    /// Adds a listener, and returns its number.
    pub(crate) fn add(&self, listener: OverhearCallback) -> u64 {
        let mut numbered = self.0.write().unwrap_or_else(PoisonError::into_inner);
        numbered.count += 1;
        let number = numbered.count;
        numbered.listeners.insert(number, listener);
        number
    }

    pub(crate) fn remove(&self, number: u64) {
        self.0.write().unwrap_or_else(PoisonError::into_inner).listeners.remove(&number);
    }

    fn is_empty(&self) -> bool {
        self.0.read().unwrap_or_else(PoisonError::into_inner).listeners.is_empty()
    }

    fn hear(&self, delivery: &Delivery) {
        if matches!(delivery.destination, Destination::To(_, Subject::Receipt)) {
            return;
        }
        let Delivery { destination, payload, origin } = delivery;
        for listener in self.0.read().unwrap_or_else(PoisonError::into_inner).listeners.values() {
            listener(OverheardMessage {
                destination: destination.clone(),
                payload: payload.clone(),
                origin: origin.clone(),
            });
        }
    }
}

// === impl OverheardInbound ===

impl OverheardInbound {
    pub(crate) fn new(inner: Arc<dyn Inbound>, listeners: OverhearListeners) -> OverheardInbound {
        OverheardInbound { inner, listeners }
    }
}

impl Inbound for OverheardInbound {
    fn deliver(&self, delivery: Delivery) {
        self.listeners.hear(&delivery);
        self.inner.deliver(delivery);
    }

    fn deliver_heartbeats(&self, beats: Vec<(AgentId, Bytes)>, origin: Option<&Origin>) {
        if !self.listeners.is_empty() {
            for (sender, payload) in &beats {
                let payload = Bytes::copy_from_slice(payload);
                let (destination, origin) =
                    (Destination::AgentState(sender.clone()), origin.cloned());
                self.listeners.hear(&Delivery { destination, payload, origin });
            }
        }
        self.inner.deliver_heartbeats(beats, origin);
    }

    fn presence(&self, presence: Presence) {
        self.inner.presence(presence);
    }

    fn receive_query(&self, question: ReceivedQuery) {
        self.inner.receive_query(question);
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.inner.rejected(rejected);
    }

    fn accepts_answer(&self, answer: &Answer<'_>) -> bool {
        self.inner.accepts_answer(answer)
    }
}

// === impl Eavesdropper ===

impl Eavesdropper {
    /// Declares the subscribers that pass each overheard message to `hear`, with its key. The key
    /// of a heartbeat from a batch is that of the batch and the sender. The listening ends when the
    /// subscribers are dropped.
    pub(crate) fn declare(
        self,
        session: &Session,
        hear: impl Fn(&str, OverheardMessage) + Send + Sync + 'static,
    ) -> Result<Vec<Subscriber<()>>, OpenError> {
        let origins: &[Locality] = match &self.security {
            None => &[Locality::Any],
            Some(_) => &[Locality::SessionLocal, Locality::Remote],
        };
        let (everything, hear) = (self.keys.everything(), Arc::new(hear));
        let has_warned = Arc::<AtomicBool>::default();
        let declared = origins.iter().map(|&origin| {
            let is_from_here = origin == Locality::SessionLocal;
            let (listener, hear, has_warned) =
                (self.clone(), Arc::clone(&hear), Arc::clone(&has_warned));
            let receive = move |sample: Sample| {
                if let Err(why) = listener.receive(&sample, is_from_here, &*hear)
                    && !has_warned.swap(true, Ordering::Relaxed)
                {
                    let key = sample.key_expr().as_str();
                    tracing::warn!(
                        key,
                        "an overheard message is ignored, and so are others: it {why}"
                    );
                }
            };
            let subscriber = session.declare_subscriber(&everything).callback(receive);
            let subscriber = subscriber.allowed_origin(origin).wait();
            subscriber.map_err(|source| undeclared("subscriber", &everything, source))
        });
        declared.collect()
    }

    fn receive(
        &self,
        sample: &Sample,
        is_from_here: bool,
        hear: &dyn Fn(&str, OverheardMessage),
    ) -> Result<(), DistrustReason> {
        let key = sample.key_expr().as_str();
        if sample.kind() != SampleKind::Put {
            return Ok(());
        }
        let (is_batch, overheard) = (self.keys.is_together(key), self.keys.overheard(key));
        let is_own = is_batch || self.keys.addressed(key).is_some();
        if (!is_batch && overheard.is_none()) || (self.leaves_out_own && is_own) {
            return Ok(());
        }
        let payload = into_bytes(sample.payload());
        let recipient = overheard.as_ref().and_then(|(_, daemon)| *daemon);
        let origin = match &self.security {
            None => None,
            Some(_) if is_from_here => Some(Security::own(self.keys.daemon())),
            Some(security) => {
                Some(self.attest(security, key, &payload, sample.attachment(), recipient)?)
            }
        };
        if let Some((destination, _)) = overheard {
            hear(key, OverheardMessage { destination, payload, origin });
            return Ok(());
        }
        for (sender, payload) in batch::unpack(&payload).into_iter().flatten() {
            let (key, origin) = (format!("{key}/{sender}"), origin.clone());
            let payload = Bytes::copy_from_slice(&payload);
            let destination = Destination::AgentState(sender);
            hear(&key, OverheardMessage { destination, payload, origin });
        }
        Ok(())
    }

    /// Returns the origin of an overheard message, if its signature proves the origin.
    fn attest(
        &self,
        security: &Security,
        key_expr: &str,
        payload: &Bytes,
        seal: Option<&ZBytes>,
        recipient: Option<&str>,
    ) -> Result<Origin, DistrustReason> {
        let seal = seal.map(ZBytes::to_bytes);
        let only_sender = self.keys.only_sender(key_expr);
        let channel = match only_sender {
            Some(_) => SealChannel::AgentState,
            None => SealChannel::Message,
        };
        let sealed = SealedMessage {
            channel,
            key_expr,
            payload,
            seal: seal.as_deref(),
            nonce: None,
            only_sender,
            receiver_incarnation: 0,
        };
        let verified = security.verifier.attest(sealed, recipient)?;
        Ok(Origin { daemon: verified.sender, signing_daemon: verified.signing_daemon })
    }
}
