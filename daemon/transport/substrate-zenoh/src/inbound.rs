//! Incoming messages: this module parses the key, verifies the seal, and passes the message to
//! [`Inbound`].
//!
//! Zenoh runs callbacks on its receiving threads or, for messages of this daemon to itself, on the
//! sender's thread. A callback that blocks stops the whole session, so nothing in this module
//! blocks, waits or calls the session. Callbacks are used for everything: Zenoh's own channel of
//! 256 entries hangs for ever if there are more liveliness tokens than that at the start.

use std::sync::Arc;

use bytes::Bytes;
use credentials::DistrustReason;
use substrate::{Delivery, Inbound, Origin, Rejected, ViolationKind};
use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Locality, Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::batch;
use crate::key_expr::KeySpace;
use crate::open_error::{OpenError, undeclared};
use crate::sealing::Security;

/// Receiver of the messages for one daemon.
#[derive(Clone)]
struct InboundReceiver {
    keys: KeySpace,
    inbound: Arc<dyn Inbound>,
    /// Keys that open the seals of messages from links; `None` if the ecosystem is not secured.
    security: Option<Security>,
}

/// Declares the subscribers of a daemon: for messages to its agents, for broadcasts, and for
/// models.
///
/// In a secured ecosystem there are separate subscribers for the daemon's own messages, because
/// only messages from links may be forged. `telling` is the number of times that all declarations
/// were made again.
pub(crate) fn declare(
    session: &Session,
    keys: &KeySpace,
    inbound: &Arc<dyn Inbound>,
    security: Option<&Security>,
    telling: u64,
) -> Result<Vec<Subscriber<()>>, OpenError> {
    let (keys, inbound, security) = (keys.clone(), Arc::clone(inbound), security.cloned());
    let ear = InboundReceiver { keys, inbound, security };
    let keys = &ear.keys;
    let mut heard = vec![keys.inbox(), keys.every_broadcast(telling)];
    heard.extend(keys.every_model(telling));
    let origins: &[Locality] = match &ear.security {
        None => &[Locality::Any],
        Some(_) => &[Locality::SessionLocal, Locality::Remote],
    };
    let declared = heard
        .iter()
        .flat_map(|key_expr| origins.iter().map(|&origin| ear.declare(session, key_expr, origin)));
    declared.collect()
}

// === impl InboundReceiver ===

impl InboundReceiver {
    fn declare(
        &self,
        session: &Session,
        key_expr: &KeyExpr<'static>,
        origin: Locality,
    ) -> Result<Subscriber<()>, OpenError> {
        let ear = self.clone();
        let is_own = origin == Locality::SessionLocal;
        let deliver = move |sample: Sample| ear.deliver(&sample, is_own);
        let subscriber = session.declare_subscriber(key_expr).callback(deliver);
        let subscriber = subscriber.allowed_origin(origin);
        subscriber.wait().map_err(|source| undeclared("subscriber", key_expr, source))
    }

    fn deliver(&self, sample: &Sample, is_own: bool) {
        let InboundReceiver { keys, inbound, security } = self;
        let key = sample.key_expr().as_str();
        let (addressed, is_together) = (keys.addressed(key), keys.is_together(key));
        if sample.kind() != SampleKind::Put || (addressed.is_none() && !is_together) {
            return tracing::debug!(key, "ignored a message with an unknown key");
        }
        let payload = into_bytes(sample.payload());
        let origin = match security {
            None => None,
            Some(_) if is_own => Some(Security::own(keys.daemon())),
            Some(security) => match security.origin(keys, &**inbound, sample, &payload) {
                Some(origin) => Some(origin),
                None => return,
            },
        };
        let Some(addressed) = addressed else {
            return self.deliver_together(key, &payload, origin.as_ref(), is_own);
        };
        inbound.deliver(Delivery { destination: addressed, payload, origin });
    }

    /// Delivers the heartbeats of a batch.
    fn deliver_together(&self, key: &str, bundle: &Bytes, origin: Option<&Origin>, is_own: bool) {
        let claimed = origin.map(|origin| origin.daemon.as_str());
        let reject = |violation, detail: &str| {
            self.inbound.rejected(&Rejected { violation, detail, claimed, key });
        };
        let Some(mut words) = batch::unpack(bundle) else {
            let detail = format!("is a batch of {} bytes that cannot be read", bundle.len());
            return reject(ViolationKind::Oversized, &detail);
        };
        let mut allowed = words.len();
        if let (Some(security), Some(origin)) = (&self.security, origin.filter(|_| !is_own)) {
            // The seal of the batch has already been counted as one message.
            let beside = u32::try_from(words.len().saturating_sub(1)).unwrap_or(u32::MAX);
            let taken = security.verifier.take_permits(&origin.signing_daemon, beside);
            allowed = 1 + usize::try_from(taken).unwrap_or(0);
        }
        for _ in words.iter().skip(allowed) {
            reject(ViolationKind::Flooded, &DistrustReason::Flooded.to_string());
        }
        words.truncate(allowed);
        self.inbound.deliver_heartbeats(words, origin);
    }
}

/// Copies the payload of a message, so that a message that is kept for long does not keep the whole
/// batch in which it arrived.
pub(crate) fn into_bytes(payload: &ZBytes) -> Bytes {
    Bytes::from(payload.to_bytes().into_owned())
}
