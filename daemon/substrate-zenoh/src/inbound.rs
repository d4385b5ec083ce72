//! What Zenoh's threads call: reads the key, and hands over to [`Inbound`].
//!
//! Zenoh calls on its receiving threads (or, for what this daemon sends itself, on the sender's);
//! one that blocks stops the whole session. Nothing here blocks, waits or calls back into the
//! session, and everything uses callbacks: Zenoh's own channel of 256 hangs for ever when more
//! liveliness tokens than that are known already.

use std::sync::Arc;

use bytes::Bytes;
use substrate::{Delivery, Inbound, Presence};
use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::OpenError;
use crate::key_expr::Keys;

/// Declares what a daemon hears: its inbox, the broadcasts, the models, and who is present.
///
/// Presence comes last: whoever sees one of our agents can already reach it.
pub(crate) fn declare(
    session: &Session,
    keys: &Keys,
    inbound: &Arc<dyn Inbound>,
) -> Result<(), OpenError> {
    for key_expr in [keys.inbox(), keys.every_broadcast(), keys.every_model()] {
        declare_subscriber(session, keys, inbound, &key_expr)?;
    }
    let (key_expr, keys, inbound) = (keys.everyone_alive(), keys.clone(), Arc::clone(inbound));
    let presence = move |sample: Sample| presence(&keys, &*inbound, &sample);
    let liveliness = session.liveliness();
    let subscriber = liveliness.declare_subscriber(&key_expr).history(true).callback(presence);
    subscriber.background().wait().map_err(|source| undeclared("liveliness", &key_expr, source))
}

fn declare_subscriber(
    session: &Session,
    keys: &Keys,
    inbound: &Arc<dyn Inbound>,
    key_expr: &KeyExpr<'static>,
) -> Result<(), OpenError> {
    let (keys, inbound) = (keys.clone(), Arc::clone(inbound));
    let deliver = move |sample: Sample| deliver(&keys, &*inbound, &sample);
    let subscriber = session.declare_subscriber(key_expr).callback(deliver).background();
    subscriber.wait().map_err(|source| undeclared("subscriber", key_expr, source))
}

pub(crate) fn undeclared(what: &str, key_expr: &KeyExpr, source: zenoh::Error) -> OpenError {
    OpenError::Declare { what: format!("{what} `{key_expr}`"), source }
}

fn deliver(keys: &Keys, inbound: &dyn Inbound, sample: &Sample) {
    let key = sample.key_expr().as_str();
    match (sample.kind(), keys.addressed(key)) {
        (SampleKind::Put, Some(addressed)) => {
            inbound.deliver(Delivery { addressed, payload: into_bytes(sample.payload()) });
        }
        _ => tracing::debug!(key, "ignored a message whose key says nothing to us"),
    }
}

fn presence(keys: &Keys, inbound: &dyn Inbound, sample: &Sample) {
    let key = sample.key_expr().as_str();
    match (keys.resident(key), sample.kind()) {
        (Some(resident), SampleKind::Put) => inbound.presence(Presence::Joined(resident)),
        (Some(resident), SampleKind::Delete) => inbound.presence(Presence::Left(resident)),
        (None, _) => tracing::debug!(key, "ignored a liveliness token that names nobody"),
    }
}

/// Copies, so that a message kept for long does not keep the whole batch it came in.
pub(crate) fn into_bytes(payload: &ZBytes) -> Bytes {
    Bytes::from(payload.to_bytes().into_owned())
}
