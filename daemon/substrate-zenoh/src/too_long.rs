//! Messages that are longer than any may be: each costs its sender a line in our log, and a count.
//!
//! Zenoh puts a long message together from its pieces, drops it when it grows beyond
//! `max_message_size`, and says so nowhere but in its own log, at `trace`, without whom it came
//! from. So [`too_long`] listens to that log. Whose bytes were being read, our crate of TLS
//! links knows; who sends over another link is on this machine, and nobody knows who it is.

use std::fmt::{self, Write as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use substrate::{Breach, Inbound, Rejected};
use tokio::sync::mpsc;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;
use zenoh_link_tls::reading::{self, Peer};

use crate::sealing::Security;

/// Where Zenoh says it.
const TARGET: &str = "zenoh_transport::unicast::universal::rx";

/// How the line begins.
const BEGINNING: &str = "Defragmentation buffer full";

/// How many may wait to be counted. Each was sixteen megabytes on its way.
const WAITING_MAX: usize = 64;

/// The sessions of this process that are told.
static LISTENING: Mutex<Vec<Weak<Listening>>> = Mutex::new(Vec::new());

/// A session is told for as long as it holds this.
pub(crate) struct Listening {
    /// Whose links are its own, in a secured ecosystem.
    key_file: Option<String>,
    /// In whose name too long a message came.
    told: mpsc::Sender<Option<String>>,
}

/// Tells `inbound` of messages that were too long, as soon as somebody logs with [`too_long`].
///
/// # Panics
///
/// Outside a Tokio runtime.
pub(crate) fn listen(security: Option<&Security>, inbound: &Arc<dyn Inbound>) -> Arc<Listening> {
    let key_file = security.map(|each| each.identity.files().0.to_string_lossy().into_owned());
    let (told, mut heard) = mpsc::channel::<Option<String>>(WAITING_MAX);
    let listening = Arc::new(Listening { key_file, told });
    let mut all = all();
    all.retain(|each| each.strong_count() > 0);
    all.push(Arc::downgrade(&listening));
    let inbound = Arc::downgrade(inbound);
    // Not where it is noticed, which is within Zenoh's locks and within a line of a log.
    tokio::spawn(async move {
        while let Some(claimed) = heard.recv().await {
            let Some(inbound) = inbound.upgrade() else { return };
            let detail = "is longer than any may be, and was dropped as it came";
            let (breach, claimed, key) = (Breach::Oversized, claimed.as_deref(), "a link");
            inbound.rejected(&Rejected { breach, detail, claimed, key });
        }
    });
    listening
}

/// Part of a program's log, without which messages that are too long are dropped without a word.
///
/// It writes nothing by itself: what it notices is [rejected](substrate::Inbound::rejected) like
/// anything else that is not believed. In a process with several sessions, what came over no TLS
/// link is told to all of them.
pub fn too_long<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
{
    let is_said_here =
        |about: &Metadata<'_>| *about.level() == Level::TRACE && about.target() == TARGET;
    Noticing.with_filter(filter_fn(is_said_here).with_max_level_hint(LevelFilter::TRACE))
}

struct Noticing;

impl<S: Subscriber> Layer<S> for Noticing {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut line = Beginning { awaited: BEGINNING };
        event.record(&mut line);
        if line.awaited.is_empty() {
            tell(reading::peer().as_deref());
        }
    }
}

/// Tells the session whose link it was; all, if that is not known.
fn tell(peer: Option<&Peer>) {
    let all: Vec<_> = all().iter().filter_map(Weak::upgrade).collect();
    let key_file = peer.map(|peer| &*peer.key_file);
    let is_its = |each: &Listening| key_file.is_some() && each.key_file.as_deref() == key_file;
    let is_known = all.iter().any(|each| is_its(each));
    for each in all.iter().filter(|each| !is_known || is_its(each)) {
        // Where so many wait, one less says the same.
        let _ = each.told.try_send(peer.and_then(|peer| peer.name.clone()));
    }
}

fn all() -> MutexGuard<'static, Vec<Weak<Listening>>> {
    LISTENING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Holds the beginning of a line against what is awaited. It is told of every batch that comes,
/// with all that is in it; so nothing is written out beyond the first word that differs.
struct Beginning {
    awaited: &'static str,
}

impl fmt::Write for Beginning {
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

impl Visit for Beginning {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            // It ends with an error as soon as it is known whether it is that line.
            let _ = write!(self, "{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_it(line: impl fmt::Display) -> bool {
        let mut beginning = Beginning { awaited: BEGINNING };
        let _ = write!(beginning, "{line}");
        beginning.awaited.is_empty()
    }

    /// Fails if it is looked at.
    struct Unread;

    impl fmt::Display for Unread {
        fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
            panic!("a whole batch was written out")
        }
    }

    #[test]
    fn a_line_is_known_by_its_beginning_however_it_is_cut() {
        assert!(is_it("Defragmentation buffer full: 9 bytes."));
        assert!(is_it(format_args!("{}{} full: {}", "Defrag", "mentation buffer", Unread)));
        assert!(!is_it("Defragmentation SN error"));
        assert!(!is_it("Defragmentation buffer"));
        assert!(!is_it(format_args!("Received: {}", Unread)));
    }
}
