//! The history of an ecosystem: what happened, when, and what caused it.
//!
//! A history agent answers a [`ReadHistory`] with one `confirm`, whose report has a
//! [`HistoryPage`], or with a `refuse`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{AgentId, ConversationId};

/// Largest number of events in a page.
pub const HISTORY_EVENTS_MAX: u32 = 1_000;

/// Longest page, in bytes of its JSON; a page of more has fewer events than were asked for.
pub const HISTORY_PAGE_BYTES_MAX: usize = 256 << 10;

/// Longest subject and longest text of an event, in bytes; longer ones are cut with an ellipsis.
pub const HISTORY_TEXT_BYTES_MAX: usize = 512;

/// Request to a history agent for a page of events.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReadHistory {
    /// Which events are wanted.
    pub query: HistoryQuery,
    /// Greatest number of events in the page, at most [`HISTORY_EVENTS_MAX`].
    #[serde(default = "limit_by_default")]
    pub limit: u32,
    /// Only events with a smaller number than this: the [`HistoryPage::next`] of the page before.
    /// `None` for the first page.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before: Option<u64>,
    /// Public key for sealing private events, as in [`super::Question::seal_to`]. Without it, no
    /// private event is in the page.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seal_to: Option<String>,
}

/// Returns the number of events in a page if the request names none.
fn limit_by_default() -> u32 {
    100
}

/// What a history agent is asked for.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum HistoryQuery {
    /// Events, newest first.
    Events {
        /// A word that the events are about: the name of an agent, a place, a predicate or an
        /// action, a fact, a goal, or the conversation of a goal. `None` for all events.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        about: Option<String>,
        /// Kinds of the events; empty for all kinds.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        kinds: Vec<HistoryKind>,
        /// Time of the oldest wanted event, in milliseconds since 1970-01-01 UTC.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from_ms: Option<u64>,
        /// Time of the newest wanted event, in milliseconds since 1970-01-01 UTC.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        to_ms: Option<u64>,
    },
    /// The newest event of the subject, followed by its cause, the cause of that, and so on, up to
    /// the root.
    Why {
        /// A fact, a step, a goal, the conversation of a goal, an agent, or `#` and the number of
        /// an event.
        subject: String,
    },
    /// The newest event of the subject, followed by the events that it caused, and those that they
    /// caused, and so on, in the order of their numbers. The next page has *greater* numbers.
    Effects {
        /// As in `why`.
        subject: String,
    },
    /// The newest events in which something worked: a fact held or was observed, a step or a goal
    /// was done, an agent was present; newest first.
    Last {
        /// As `about` in `events`.
        about: String,
    },
    /// The values over time of a fact, newest first: events of [`HistoryKind::Fact`], with a
    /// [`HistoryEvent::value`] where the fact is a number.
    Values {
        /// The fact: a ground function such as `(temperature office1)`, or a ground atom.
        fact: String,
        /// Time of the oldest wanted value, in milliseconds since 1970-01-01 UTC.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from_ms: Option<u64>,
        /// Time of the newest wanted value, in milliseconds since 1970-01-01 UTC.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        to_ms: Option<u64>,
    },
}

/// A page of events: the answer of a history agent.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HistoryPage {
    /// The events, in the order that the query names; without those in `sealed`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<HistoryEvent>,
    /// Private events, if the one that asks may read them: sealed boxes of the JSON of a
    /// [`HistoryEvent`], made with the key of the request, in hexadecimal digits. In lists of
    /// events their place follows from their number, and in a chain from their cause.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sealed: Vec<String>,
    /// Number of private events that belong to this page and that the one that asks may not read.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub withheld: u64,
    /// Value of [`ReadHistory::before`] for the next page; `None` if there is no further page.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub next: Option<u64>,
    /// Time of the oldest event that the history agent keeps, in milliseconds since 1970-01-01 UTC;
    /// `None` if it keeps none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub oldest_ms: Option<u64>,
    /// Number of messages that the history agent has missed, and of events that it could not write,
    /// since its file was made.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lost: u64,
    /// What the one that asks has to know about the history, such as a disk without room; texts for
    /// a person.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notices: Vec<String>,
    /// If no event is about the subject: words like it that the history knows, the nearest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub near: Vec<String>,
}

/// Something that happened.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistoryEvent {
    /// Number of the event in the history of this history agent, from 1; a later event has a
    /// greater number.
    pub number: u64,
    /// Time of the event in milliseconds since 1970-01-01 UTC, by the clock of the machine of the
    /// history agent.
    pub at_ms: u64,
    /// Kind of the event.
    pub kind: HistoryKind,
    /// What the event is about: a fact, a ground action, a goal or a name.
    pub subject: String,
    /// The agent that the event comes from: it acted, measured, asked, answered, joined or left;
    /// `None` if it comes from none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
    /// Description of the event: a sentence for a person, without a full stop.
    pub text: String,
    /// Conversation that the event belongs to; `None` if it belongs to none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conversation: Option<ConversationId>,
    /// Number of the event that caused this one; `None` for a root. It may be older than all events
    /// that are kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<u64>,
    /// Where the chain of causes begins, if it begins at this event.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub root: Option<HistoryRoot>,
    /// Value of the fact; `None` if the event is not about a fact that has a number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Whether the event is about a fact that its agent declares `:private`.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub private: bool,
}

/// Kind of an event.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HistoryKind {
    /// A fact began to hold, ceased to hold, or has another value.
    Fact,
    /// A goal was asked for, changed its phase, or ended.
    Goal,
    /// A plan was made, was begun, or ended.
    Plan,
    /// A step of a plan was requested, agreed to, or ended.
    Step,
    /// An agent made a proposal, or its proposal was accepted or rejected.
    Bid,
    /// An agent declined a request.
    Refusal,
    /// An agent joined or left.
    Presence,
    /// A stop was requested or released, or an actuator has obeyed it.
    Stop,
    /// An agent asked a person, or a person answered; what was answered is not kept.
    Question,
    /// Somebody asked for a change, of the state or of the way in which plans are made.
    Request,
    /// The kind is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// Where a chain of causes begins.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HistoryRoot {
    /// A person asked for it, at a command line, at a keyboard or in the ecosystem file.
    Person,
    /// An agent reported it by itself: a sensor measured it, a device noticed it.
    Sensor,
    /// A time has come, or has passed.
    Clock,
    /// An agent left without having been asked to, or is silent.
    Death,
    /// An agent joined.
    Arrival,
    /// The root is defined by a newer version only.
    #[serde(other)]
    Other,
}

/// Error for a text that is not the name of a kind of events.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no kind of events; there are {all}", all = HistoryKind::ALL.map(HistoryKind::as_str).join(", "))]
pub struct UnknownHistoryKind(pub String);

fn is_zero(number: &u64) -> bool {
    *number == 0
}

// === impl ReadHistory ===

impl ReadHistory {
    /// Creates a request for the first page of the answer to `query`, without private events.
    pub fn new(query: HistoryQuery) -> ReadHistory {
        ReadHistory { query, limit: limit_by_default(), before: None, seal_to: None }
    }
}

// === impl HistoryKind ===

impl HistoryKind {
    /// All kinds that this version defines.
    pub const ALL: [HistoryKind; 10] = [
        HistoryKind::Fact,
        HistoryKind::Goal,
        HistoryKind::Plan,
        HistoryKind::Step,
        HistoryKind::Bid,
        HistoryKind::Refusal,
        HistoryKind::Presence,
        HistoryKind::Stop,
        HistoryKind::Question,
        HistoryKind::Request,
    ];

    /// Returns the spelling of the kind in messages and on command lines.
    pub const fn as_str(self) -> &'static str {
        match self {
            HistoryKind::Fact => "fact",
            HistoryKind::Goal => "goal",
            HistoryKind::Plan => "plan",
            HistoryKind::Step => "step",
            HistoryKind::Bid => "bid",
            HistoryKind::Refusal => "refusal",
            HistoryKind::Presence => "presence",
            HistoryKind::Stop => "stop",
            HistoryKind::Question => "question",
            HistoryKind::Request => "request",
            HistoryKind::Other => "other",
        }
    }
}

impl fmt::Display for HistoryKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl FromStr for HistoryKind {
    type Err = UnknownHistoryKind;

    fn from_str(text: &str) -> Result<HistoryKind, UnknownHistoryKind> {
        HistoryKind::ALL
            .into_iter()
            .find(|kind| kind.as_str() == text)
            .ok_or_else(|| UnknownHistoryKind(text.to_owned()))
    }
}

impl fmt::Display for HistoryRoot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            HistoryRoot::Person => "person",
            HistoryRoot::Sensor => "sensor",
            HistoryRoot::Clock => "clock",
            HistoryRoot::Death => "death",
            HistoryRoot::Arrival => "arrival",
            HistoryRoot::Other => "other",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_spelled_alike_in_messages_and_on_command_lines() {
        for kind in HistoryKind::ALL {
            let json = serde_json::to_string(&kind).expect("a plain string");
            assert_eq!(json, format!("\"{kind}\""));
            assert_eq!(kind.as_str().parse(), Ok(kind));
        }
        assert!("other".parse::<HistoryKind>().is_err());
    }

    #[test]
    fn a_page_of_a_newer_version_is_read() {
        let text = r#"{"events": [{"number": 7, "at_ms": 5, "kind": "dream", "subject": "(a)",
                       "text": "a dream", "root": "oracle"}], "colour": "blue"}"#;
        let page: HistoryPage = serde_json::from_str(text).expect("a page");
        assert_eq!(page.events[0].kind, HistoryKind::Other);
        assert_eq!(page.events[0].root, Some(HistoryRoot::Other));
        assert!(!page.events[0].private);
    }

    #[test]
    fn a_short_request_asks_for_a_hundred_public_events() {
        let text = r#"{"query": {"of": "why", "subject": "(lit hall)"}}"#;
        let request: ReadHistory = serde_json::from_str(text).expect("a request");
        let subject = "(lit hall)".to_owned();
        assert_eq!(request, ReadHistory::new(HistoryQuery::Why { subject }));
        assert_eq!(request.limit, 100);
    }
}
