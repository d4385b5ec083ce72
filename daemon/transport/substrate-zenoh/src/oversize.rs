//! Detects messages that are longer than allowed: each is logged with its sender and counted.
//!
//! Zenoh assembles a long message from its fragments, drops it when it grows beyond
//! `max_message_size`, and reports that only in its own log, at level `trace`, without the sender.
//! So the layer [`oversize_layer`] reads that log. The vendored crate for TLS links knows which
//! peer it is reading from. A peer on another kind of link is on this machine and remains unknown.
//!
//! The target and the words of Zenoh's log line are no interface of Zenoh, and another version may
//! change them. Then the test `a_message_of_100_mib_does_no_harm_and_is_counted`
//! (tests/substrate/secured.rs) fails: it sends such a message through real Zenoh over TLS, and
//! waits until this module has reported it. The fields of the line are formatted only up to the
//! first difference, so the cost of reading the log is small.

use std::fmt::{self, Write as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use substrate::{Inbound, Rejected, ViolationKind};
use tokio::sync::mpsc;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;
use zenoh_link_tls::reading::{self, Peer};

use crate::sealing::Security;

/// Log target under which Zenoh reports a message that is too long.
const TARGET: &str = "zenoh_transport::unicast::universal::rx";

/// Beginning of the log line by which Zenoh reports a message that is too long.
const BEGINNING: &str = "Defragmentation buffer full";

/// Maximum number of detected messages that wait to be counted; further ones are not counted. Each
/// stands for sixteen megabytes received.
const WAITING_MAX: usize = 64;

/// Sessions of this process that are notified of messages that are too long.
static LISTENING: Mutex<Vec<Weak<OversizeListener>>> = Mutex::new(Vec::new());

/// Registration of a session: as long as the session holds this value, it is notified of messages
/// that are too long.
pub(crate) struct OversizeListener {
    /// Path of the key file that the session's own links use; `None` if the ecosystem is not
    /// secured.
    key_file: Option<String>,
    /// Channel for detected messages. Each entry is the name of the peer that sent the message;
    /// `None` if it is unknown.
    peers: mpsc::Sender<Option<String>>,
}

/// Reports messages that were too long to `inbound`. Works only if [`oversize_layer`] is among the
/// layers of the log.
///
/// # Panics
///
/// Panics outside a Tokio runtime.
pub(crate) fn listen(
    security: Option<&Security>,
    inbound: &Arc<dyn Inbound>,
) -> Arc<OversizeListener> {
    let key_file = security.map(|each| each.identity.files().0.to_string_lossy().into_owned());
    let (told, mut heard) = mpsc::channel::<Option<String>>(WAITING_MAX);
    let listening = Arc::new(OversizeListener { key_file, peers: told });
    let mut all = all();
    all.retain(|each| each.strong_count() > 0);
    all.push(Arc::downgrade(&listening));
    let inbound = Arc::downgrade(inbound);
    // Runs in a task of its own, because the event occurs while Zenoh holds locks, and within a log
    // call.
    tokio::spawn(async move {
        while let Some(claimed) = heard.recv().await {
            let Some(inbound) = inbound.upgrade() else { return };
            let detail = "is longer than any message may be, and was dropped";
            let (violation, claimed, key) =
                (ViolationKind::Oversized, claimed.as_deref(), "a link");
            inbound.rejected(&Rejected { violation, detail, claimed, key });
        }
    });
    listening
}

/// Returns a log layer that detects messages that are too long. Without the layer, they are dropped
/// silently.
///
/// The layer writes nothing to the log. Each detected message is
/// [rejected](substrate::Inbound::rejected) like any other message that is not accepted. In a
/// process with several sessions, all of them are notified of such a message if it came over a link
/// other than TLS.
pub fn oversize_layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
{
    let is_said_here =
        |about: &Metadata<'_>| *about.level() == Level::TRACE && about.target() == TARGET;
    OversizeLayer.with_filter(filter_fn(is_said_here).with_max_level_hint(LevelFilter::TRACE))
}

struct OversizeLayer;

impl<S: Subscriber> Layer<S> for OversizeLayer {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut line = PrefixMatcher { awaited: BEGINNING };
        event.record(&mut line);
        if line.awaited.is_empty() {
            notify_sessions(reading::peer().as_deref());
        }
    }
}

/// Notifies the session that owns the link to `peer`. If the session is not known, notifies all
/// sessions.
fn notify_sessions(peer: Option<&Peer>) {
    let all: Vec<_> = all().iter().filter_map(Weak::upgrade).collect();
    let key_file = peer.map(|peer| &*peer.key_file);
    let is_its =
        |each: &OversizeListener| key_file.is_some() && each.key_file.as_deref() == key_file;
    let is_known = all.iter().any(|each| is_its(each));
    for each in all.iter().filter(|each| !is_known || is_its(each)) {
        // A full channel loses one notice, which adds nothing to those that wait.
        let _ = each.peers.try_send(peer.and_then(|peer| peer.name.clone()));
    }
}

fn all() -> MutexGuard<'static, Vec<Weak<OversizeListener>>> {
    LISTENING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Compares the beginning of a log line with the expected text. Zenoh logs every batch with its
/// content under the same target, so formatting stops at the first difference.
struct PrefixMatcher {
    awaited: &'static str,
}

impl fmt::Write for PrefixMatcher {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if let Some(rest) = self.awaited.strip_prefix(text) {
            self.awaited = rest;
        } else if text.starts_with(self.awaited) {
            self.awaited = "";
        } else {
            return Err(fmt::Error);
        }
        if self.awaited.is_empty() { Err(fmt::Error) } else { Ok(()) }
    }
}

impl Visit for PrefixMatcher {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            // Returns an error as soon as the comparison is decided.
            let _ = write!(self, "{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_it(line: impl fmt::Display) -> bool {
        let mut beginning = PrefixMatcher { awaited: BEGINNING };
        let _ = write!(beginning, "{line}");
        beginning.awaited.is_empty()
    }

    /// A value that panics if it is formatted.
    struct Unread;

    impl fmt::Display for Unread {
        fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
            panic!("a whole batch was written out")
        }
    }

    #[test]
    fn a_log_line_is_recognised_by_its_beginning() {
        assert!(is_it("Defragmentation buffer full: 9 bytes."));
        assert!(is_it(format_args!("{}{} full: {}", "Defrag", "mentation buffer", Unread)));
        assert!(!is_it("Defragmentation SN error"));
        assert!(!is_it("Defragmentation buffer"));
        assert!(!is_it(format_args!("Received: {}", Unread)));
    }
}
