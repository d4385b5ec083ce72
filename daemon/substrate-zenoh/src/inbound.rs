//! Messages that come: reads the key, and hands over to [`Inbound`].
//!
//! Zenoh calls on its receiving threads (or, for what this daemon sends itself, on the sender's);
//! one that blocks stops the whole session. Nothing here blocks, waits or calls back into the
//! session, and everything uses callbacks: Zenoh's own channel of 256 hangs for ever when more
//! liveliness tokens than that are known already.

use std::sync::Arc;

use bytes::Bytes;
use substrate::{Delivery, Inbound};
use zenoh::bytes::ZBytes;
use zenoh::key_expr::KeyExpr;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::OpenError;
use crate::key_expr::Keys;

/// Declares what a daemon hears: its inbox, the broadcasts and the models.
pub(crate) fn declare(
    session: &Session,
    keys: &Keys,
    inbound: &Arc<dyn Inbound>,
) -> Result<(), OpenError> {
    let heard = [keys.inbox(), keys.every_broadcast(), keys.every_model()];
    heard.iter().try_for_each(|key_expr| declare_subscriber(session, keys, inbound, key_expr))
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

/// Copies, so that a message kept for long does not keep the whole batch it came in.
pub(crate) fn into_bytes(payload: &ZBytes) -> Bytes {
    Bytes::from(payload.to_bytes().into_owned())
}
