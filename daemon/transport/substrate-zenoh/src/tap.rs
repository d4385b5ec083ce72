//! A passive listener, which receives all messages of an ecosystem, as any Zenoh tool could.

use substrate::OverheardMessage;
use zenoh::Session;
use zenoh::pubsub::Subscriber;

use crate::config::Config;
use crate::key_expr::KeySpace;
use crate::open_error::OpenError;
use crate::overhear::Eavesdropper;

/// Handle of a passive listener, which runs until the handle is dropped.
pub struct Tap {
    _subscribers: Vec<Subscriber<()>>,
    _session: Session,
}

/// Passes all messages, broadcasts and models of the ecosystem of `config` to `heard`, each with
/// the key under which it was sent. A batch of heartbeats is passed on as single heartbeats. In a
/// secured ecosystem, messages without a valid signature are dropped. `heard` runs on Zenoh's
/// threads and must not block.
///
/// # Errors
///
/// Returns an error if the session cannot be opened.
pub async fn tap(
    config: Config,
    heard: impl Fn(&str, OverheardMessage) + Send + Sync + 'static,
) -> Result<Tap, OpenError> {
    let settings = config.settings()?;
    let keys = KeySpace::new(&config.ecosystem, config.daemon);
    let (listen, connect, security) = (settings.listen, settings.connect, settings.security);
    let session = zenoh::open(settings.zenoh).await.map_err(|source| OpenError::Session {
        listen,
        connect,
        source,
    })?;
    let subscribers =
        Eavesdropper { keys, leaves_out_own: false, security }.declare(&session, heard)?;
    Ok(Tap { _subscribers: subscribers, _session: session })
}
