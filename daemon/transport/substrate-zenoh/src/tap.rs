//! A passive listener, which receives all messages of an ecosystem, as any Zenoh tool could.

use bytes::Bytes;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

use crate::batch;
use crate::config::Config;
use crate::inbound::into_bytes;
use crate::key_expr::KeySpace;
use crate::open_error::{OpenError, undeclared};

/// Handle of a passive listener, which runs until the handle is dropped.
pub struct Tap {
    _session: Session,
}

/// Passes all messages, broadcasts and models of the ecosystem of `config` to `heard`, each as its
/// key and its payload as they were sent. A batch of heartbeats is passed on as single heartbeats.
/// `heard` runs on Zenoh's threads and must not block.
///
/// # Errors
///
/// Returns an error if the session cannot be opened.
pub async fn tap(
    config: Config,
    heard: impl Fn(&str, Bytes) + Send + Sync + 'static,
) -> Result<Tap, OpenError> {
    let settings = config.settings()?;
    let keys = KeySpace::new(&config.ecosystem, config.daemon);
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
            SampleKind::Put if keys.is_together(key) => batch::unpack(&payload)
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
