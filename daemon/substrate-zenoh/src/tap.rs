//! A listener that takes no part: hears everything an ecosystem says, as any Zenoh tool could.

use bytes::Bytes;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::config::{Config, OpenError};
use crate::inbound::{into_bytes, undeclared};
use crate::key_expr::Keys;
use crate::together;

/// Hears until it is dropped.
pub struct Tap {
    _session: Session,
}

/// Hears all messages, broadcasts and models of `config`'s ecosystem: the key and the payload, as
/// they were sent; what several agents say together, as if each had said it alone. Called on Zenoh's threads: `heard` must not block.
///
/// # Errors
///
/// If the session cannot be opened.
pub async fn tap(
    config: Config,
    heard: impl Fn(&str, Bytes) + Send + Sync + 'static,
) -> Result<Tap, OpenError> {
    let settings = config.settings()?;
    let keys = Keys::new(&config.ecosystem, config.daemon);
    let (listen, connect) = (settings.listen, settings.connect);
    let session = zenoh::open(settings.zenoh).await.map_err(|source| OpenError::Session {
        listen,
        connect,
        source,
    })?;
    let everything = keys.everything();
    let hear = move |sample: Sample| {
        let (key, payload) = (sample.key_expr().as_str(), into_bytes(sample.payload()));
        match sample.kind() {
            SampleKind::Put if keys.is_together(key) => together::unpack(&payload)
                .into_iter()
                .flatten()
                .for_each(|(sender, payload)| heard(&format!("{key}/{sender}"), payload)),
            SampleKind::Put => heard(key, payload),
            SampleKind::Delete => (),
        }
    };
    session
        .declare_subscriber(&everything)
        .callback(hear)
        .background()
        .wait()
        .map_err(|source| undeclared("subscriber", &everything, source))?;
    Ok(Tap { _session: session })
}
