//! Events before they have a number, and links to earlier events.

use acl::content::{HistoryKind, HistoryRoot};

use crate::event::EventDescription;

/// Reference to an event, with the root of its chain of causes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EventLink {
    /// Number of the event.
    pub(crate) number: u64,
    /// Root of its chain of causes.
    pub(crate) root: HistoryRoot,
}

/// What caused an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EventCause {
    /// Nothing that is recorded: the chain begins here.
    Root(HistoryRoot),
    /// An earlier event.
    Event(EventLink),
}

/// An event before it has a number.
#[derive(Clone, Debug)]
pub(crate) struct EventDraft<'a> {
    pub(crate) kind: HistoryKind,
    pub(crate) subject: &'a str,
    pub(crate) agent: &'a str,
    pub(crate) conversation: &'a str,
    pub(crate) what: EventDescription,
    pub(crate) cause: EventCause,
    pub(crate) worked: bool,
}

impl From<EventLink> for EventCause {
    fn from(event: EventLink) -> EventCause {
        EventCause::Event(event)
    }
}

impl<'a> EventDraft<'a> {
    /// Creates an event of no conversation.
    pub(crate) fn new(
        kind: HistoryKind,
        subject: &'a str,
        agent: &'a str,
        text: impl AsRef<str>,
        cause: impl Into<EventCause>,
    ) -> EventDraft<'a> {
        EventDraft {
            kind,
            subject,
            agent,
            conversation: "",
            what: EventDescription::Sentence(text.as_ref().into()),
            cause: cause.into(),
            worked: false,
        }
    }

    /// Returns the event as one of a conversation.
    pub(crate) fn of(self, conversation: &'a str) -> EventDraft<'a> {
        EventDraft { conversation, ..self }
    }

    /// Returns the event as one in which something worked, or not.
    pub(crate) fn worked(self, worked: bool) -> EventDraft<'a> {
        EventDraft { worked, ..self }
    }
}
