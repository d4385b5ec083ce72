//! Zenoh's own errors in the log: each kind of error is reported once, as a sentence that explains
//! its meaning for the ecosystem.
//!
//! Zenoh logs some passing conditions as errors, once for every name concerned: hundreds of lines
//! if a daemon is killed. These errors need no action: agents retry their messages, and roll calls
//! repair the membership.

use std::collections::BTreeSet;
use std::fmt::{self, Write as _};
use std::sync::{Mutex, PoisonError};
use std::thread;

use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, filter_fn};
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

/// Maximum length of a reported line of Zenoh's log, in characters. The rest, which may contain a
/// whole message, is cut off.
const LINE_CHARS_MAX: usize = 300;

/// Maximum number of kinds of errors that are reported; errors of further kinds are not. Zenoh has
/// some dozens of kinds.
const KINDS_MAX: usize = 64;

/// Parts of lines in Zenoh's log, each with the meaning of the line for the ecosystem.
const MEANINGS: &[(&str, &str)] = &[
    (
        "cannot get index of",
        "Zenoh received news of a daemon that it does not know any more: one has just left or \
         come back. The membership is asked for again within seconds",
    ),
    (
        "Too many open files",
        "this process has no file handle left, so Zenoh can accept no connection; raise the limit \
         (`ulimit -n`, or `LimitNOFILE` in the service's unit)",
    ),
];

/// Whether a log event is an error of Zenoh's that this module reports.
pub fn is_error_of_zenoh(about: &Metadata<'_>) -> bool {
    *about.level() == Level::ERROR && about.target().starts_with("zenoh")
}

/// Returns a log layer that reports each kind of Zenoh's errors once, as a warning. The original
/// lines should be left out of the log ([`is_error_of_zenoh`]).
pub fn zenoh_error_layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> LookupSpan<'a>,
{
    // Zenoh's sessions log an error if a message arrives before the declaration of its key; that is
    // not reported.
    let is_told =
        |about: &Metadata<'_>| is_error_of_zenoh(about) && about.target() != "zenoh::api::session";
    // Runs on another thread, because the event may occur while Zenoh holds locks. If the machine
    // has no thread left, the sentence is lost.
    let tell = |sentence: String| {
        let said = thread::Builder::new().spawn(move || tracing::warn!("{sentence}"));
        drop(said);
    };
    ZenohErrorLayer { reported: Mutex::default(), report: tell }
        .with_filter(filter_fn(is_told).with_max_level_hint(LevelFilter::ERROR))
}

struct ZenohErrorLayer<T> {
    reported: Mutex<BTreeSet<String>>,
    report: T,
}

impl<S: Subscriber, T: Fn(String) + 'static> Layer<S> for ZenohErrorLayer<T> {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut line = EventText::default();
        event.record(&mut line);
        let (kind, sentence) = sentence(event.metadata(), &line.0);
        let mut told = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        if told.len() < KINDS_MAX && told.insert(kind) {
            drop(told);
            (self.report)(sentence);
        }
    }
}

/// Returns the kind of an error (the known part of the log line, or its place in Zenoh's code), and
/// the sentence that reports the error.
fn sentence(about: &Metadata<'_>, line: &str) -> (String, String) {
    match MEANINGS.iter().find(|(part, _)| line.contains(part)) {
        Some((part, meaning)) => ((*part).to_owned(), format!("{meaning}. This is reported once")),
        None => {
            let place = format!("{}:{}", about.target(), about.line().unwrap_or_default());
            let line = line.trim().trim_end_matches(['.', '!']);
            (
                place,
                format!(
                    "Zenoh, which carries the messages, reports: {line}. This is reported once"
                ),
            )
        }
    }
}

/// Text of a log event, up to [`LINE_CHARS_MAX`] characters.
#[derive(Default)]
struct EventText(String);

impl fmt::Write for EventText {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = LINE_CHARS_MAX.saturating_sub(self.0.chars().count());
        self.0.extend(text.chars().filter(|each| !each.is_control()).take(room));
        if room == 0 { Err(fmt::Error) } else { Ok(()) }
    }
}

impl Visit for EventText {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Writing returns an error if the line is too long; its beginning is kept.
        let _ = match field.name() {
            "message" => write!(self, "{value:?}"),
            // Some of Zenoh's errors have no message, only a field.
            name => write!(self, " {name}={value:?}"),
        };
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use tracing_subscriber::layer::SubscriberExt as _;

    use super::*;

    #[test]
    fn each_kind_of_error_is_reported_once_as_a_sentence() {
        let told = Arc::new(Mutex::new(Vec::new()));
        let heard = Arc::clone(&told);
        let tell = move |sentence| heard.lock().expect("no panic").push(sentence);
        let telling = ZenohErrorLayer { reported: Mutex::default(), report: tell };
        let is_told = |about: &Metadata<'_>| is_error_of_zenoh(about);
        let log = tracing_subscriber::registry().with(telling.with_filter(filter_fn(is_told)));
        tracing::subscriber::with_default(log, || {
            for name in ["thermometer", "lamp"] {
                tracing::error!(target: "zenoh::net::routing::hat::router::token",
                    "Error propagating token {name}: cannot get index of baf0f4ba!");
                tracing::error!(target: "zenoh_link_tcp", "Unable to accept: \u{1b}]0;{name}.");
                tracing::error!(target: "zenoh::api", error = "closed");
                tracing::error!("an error of ours");
                tracing::warn!(target: "zenoh::net", "a warning of Zenoh's");
            }
        });
        let told = told.lock().expect("no panic").clone();
        assert_eq!(told.len(), 3, "{told:?}");
        assert!(told[2].contains("reports: error=\"closed\". This"), "{told:?}");
        assert!(told[0].starts_with("Zenoh received news of a daemon"), "{told:?}");
        let of_ours = "Zenoh, which carries the messages, reports: ";
        assert_eq!(
            told[1],
            format!("{of_ours}Unable to accept: ]0;thermometer. This is reported once")
        );
    }
}
