//! An event of the history: what happened, when, and the event that caused it.

use std::sync::Arc;

use acl::content::{HISTORY_TEXT_BYTES_MAX, HistoryEvent, HistoryKind, HistoryRoot};
use acl::{AgentId, ConversationId};

/// An event, as the recorder makes it and the store keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedEvent {
    /// Number of the event, from 1; a later event has a greater number.
    pub number: u64,
    /// Time of the event in milliseconds since 1970-01-01 UTC.
    pub at_ms: u64,
    /// Kind of the event.
    pub kind: HistoryKind,
    /// What the event is about: a fact without its value, a ground action, a goal or a name.
    pub subject: Arc<str>,
    /// Name of the agent that the event comes from; empty if it comes from none.
    pub agent: Arc<str>,
    /// Conversation of the event; empty if it belongs to none.
    pub conversation: Arc<str>,
    /// Description of the event.
    pub what: EventDescription,
    /// Number of the event that caused this one, which is smaller; `None` for a root.
    pub cause: Option<u64>,
    /// Root of the chain of causes that ends here.
    pub root: HistoryRoot,
    /// Whether something worked: a fact held or was observed, a step or a goal was done, an agent
    /// was present.
    pub worked: bool,
    /// Whether the event is about something that an agent declares `:private`.
    pub private: bool,
}

/// Description of an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EventDescription {
    /// A sentence for a person.
    Sentence(Arc<str>),
    /// The change of a fact, from which the sentence follows.
    Change {
        /// Value before the change; `None` if it was not known.
        from: Option<Arc<str>>,
        /// Value after the change: `true`, `false`, `unknown`, or a number.
        to: Arc<str>,
    },
}

/// Value of a fact that holds.
pub const TRUE: &str = "true";
/// Value of a fact that does not hold.
pub const FALSE: &str = "false";
/// Value of a fact of which nothing is known.
pub const UNKNOWN: &str = "unknown";

// === impl RecordedEvent ===

impl RecordedEvent {
    /// Returns the sentence that describes the event to a person.
    pub fn sentence(&self) -> String {
        let subject = &self.subject;
        match &self.what {
            EventDescription::Sentence(text) => text.to_string(),
            EventDescription::Change { to, .. } if **to == *TRUE => format!("`{subject}` holds"),
            EventDescription::Change { from: Some(from), to }
                if **to == *FALSE && **from == *TRUE =>
            {
                format!("`{subject}` holds no longer")
            }
            EventDescription::Change { to, .. } if **to == *FALSE => {
                format!("`{subject}` does not hold")
            }
            EventDescription::Change { to, .. } if **to == *UNKNOWN => {
                format!("`{subject}` is unknown")
            }
            EventDescription::Change { from: Some(from), to } if **from != *UNKNOWN => {
                format!("`{subject}` is {to}, after {from}")
            }
            EventDescription::Change { to, .. } => format!("`{subject}` is {to}"),
        }
    }

    /// Returns the value of the fact; `None` if the event is not about a fact with a number.
    pub fn value(&self) -> Option<f64> {
        match &self.what {
            EventDescription::Change { to, .. } => {
                to.parse().ok().filter(|value: &f64| value.is_finite())
            }
            EventDescription::Sentence(_) => None,
        }
    }

    /// Returns the event as it is sent. `is_cause_kept` states whether the event that caused this
    /// one can still be read; if it cannot, the root stands here.
    pub fn to_message(&self, is_cause_kept: bool) -> HistoryEvent {
        let is_end = self.cause.is_none() || !is_cause_kept;
        HistoryEvent {
            number: self.number,
            at_ms: self.at_ms,
            kind: self.kind,
            subject: shortened(&self.subject).into_owned(),
            agent: AgentId::new(&self.agent).ok(),
            text: shortened(&self.sentence()).into_owned(),
            conversation: Some(&*self.conversation)
                .filter(|conversation| !conversation.is_empty())
                .map(ConversationId::new),
            cause: self.cause,
            root: is_end.then_some(self.root),
            value: self.value(),
            private: self.private,
        }
    }
}

/// Returns a text of at most [`HISTORY_TEXT_BYTES_MAX`] bytes: the text itself, or its beginning
/// with an ellipsis.
pub(crate) fn shortened(text: &str) -> std::borrow::Cow<'_, str> {
    if text.len() <= HISTORY_TEXT_BYTES_MAX {
        return text.into();
    }
    let mut end = HISTORY_TEXT_BYTES_MAX - '…'.len_utf8();
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}…", &text[..end]).into()
}

/// Returns an event about a temperature, for tests.
#[cfg(test)]
pub(crate) fn test_event(number: u64) -> RecordedEvent {
    RecordedEvent {
        number,
        at_ms: 1_000_000 + number,
        kind: HistoryKind::Fact,
        subject: "(temperature office1)".into(),
        agent: "sensor-1".into(),
        conversation: "".into(),
        what: EventDescription::Change { from: None, to: "21.5".into() },
        cause: None,
        root: HistoryRoot::Sensor,
        worked: true,
        private: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_is_told_in_a_sentence() {
        let told = |from: Option<&str>, to: &str| {
            let what = EventDescription::Change { from: from.map(Arc::from), to: to.into() };
            RecordedEvent { what, ..test_event(1) }.sentence()
        };
        assert_eq!(told(None, "21.5"), "`(temperature office1)` is 21.5");
        assert_eq!(told(Some("21.5"), "22"), "`(temperature office1)` is 22, after 21.5");
        assert_eq!(told(Some(UNKNOWN), TRUE), "`(temperature office1)` holds");
        assert_eq!(told(Some(TRUE), FALSE), "`(temperature office1)` holds no longer");
        assert_eq!(told(Some(UNKNOWN), FALSE), "`(temperature office1)` does not hold");
        assert_eq!(told(Some("1"), UNKNOWN), "`(temperature office1)` is unknown");
    }

    #[test]
    fn long_texts_are_cut_between_characters() {
        let long = "ä".repeat(HISTORY_TEXT_BYTES_MAX);
        let short = shortened(&long);
        assert!(short.len() <= HISTORY_TEXT_BYTES_MAX && short.ends_with("ä…"), "{short}");
        assert_eq!(shortened("kurz"), "kurz");
    }
}
