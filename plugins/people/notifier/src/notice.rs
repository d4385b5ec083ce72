//! Notices: what people are told of, before it has a form for a channel.

use acl::{AgentId, ConversationId};
use ring::digest::{SHA256, digest};
use serde::{Deserialize, Serialize};

/// Longest text of a notice, in bytes: a question, a goal or a reason. A push service takes about
/// four kilobytes with everything.
const TEXT_BYTES_MAX: usize = 1_000;

/// Bytes of an identifier of a notice before it is written as hexadecimal digits: an accidental
/// match is out of the question, and a push service takes at most 32 characters.
const ID_BYTES: usize = 16;

/// Kind of a notice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum NoticeKind {
    /// An agent asks people a question.
    Question,
    /// A goal has failed, or is given up.
    GoalLost,
    /// A goal is not reached by the time by which it should be, and goes on.
    GoalLate,
    /// A goal will probably not be reached by that time.
    GoalLateSoon,
    /// An agent is gone for longer than the configured time.
    AgentGone,
    /// An agent that was told of as gone is back.
    AgentBack,
    /// A stop is in force.
    Stop,
    /// Stops were released.
    Release,
}

/// Events that a channel may be for, as its `events` names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum NoticeEvent {
    /// Questions to people.
    Question,
    /// Goals that have failed or are given up.
    GoalLost,
    /// Goals that are late, or will probably be.
    GoalLate,
    /// Agents that are gone, and that are back.
    AgentGone,
    /// Stops and their release.
    Stop,
}

/// One thing that people are told of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Notice {
    /// Identifier, which is the same in every replica of the notifier.
    pub(crate) id: String,
    pub(crate) kind: NoticeKind,
    /// Time of day, in milliseconds since 1970-01-01 UTC.
    pub(crate) at_ms: u64,
    /// Names of the agents that the notice is about: that asks, that is gone, that stops.
    pub(crate) agents: Vec<AgentId>,
    /// Conversation of the goal; `None` if the notice is about no goal.
    pub(crate) conversation: Option<ConversationId>,
    /// The question, the goal, or the reason of a stop; empty if there is none.
    pub(crate) text: String,
    /// Names that a stop is limited to; empty for a stop of everything.
    pub(crate) scope: Vec<String>,
    /// Time until which a question waits for an answer, as `at_ms`; `None` if it has no deadline.
    pub(crate) ends_ms: Option<u64>,
    /// The keyboard and the number by which a question is answered; `None` if none has it.
    pub(crate) asked_at: Option<(AgentId, u64)>,
}

/// One thing to send: a notice, or a summary of several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NoticeDelivery {
    /// Identifier, the same in each attempt.
    pub(crate) id: String,
    /// The notices, oldest first; more than one in a summary.
    pub(crate) notices: Vec<Notice>,
}

/// The present time, by two clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct NoticeTime {
    /// Milliseconds since the start of the agent, by a clock that never jumps.
    pub(crate) steady_ms: u64,
    /// Milliseconds since 1970-01-01 UTC, by the clock of the machine.
    pub(crate) wall_ms: u64,
}

// === impl NoticeKind ===

impl NoticeKind {
    /// Returns the event of the kind.
    pub(crate) fn event(self) -> NoticeEvent {
        match self {
            NoticeKind::Question => NoticeEvent::Question,
            NoticeKind::GoalLost => NoticeEvent::GoalLost,
            NoticeKind::GoalLate | NoticeKind::GoalLateSoon => NoticeEvent::GoalLate,
            NoticeKind::AgentGone | NoticeKind::AgentBack => NoticeEvent::AgentGone,
            NoticeKind::Stop | NoticeKind::Release => NoticeEvent::Stop,
        }
    }

    /// Whether the kind ignores quiet hours by default, and twice the usual rate is allowed.
    pub(crate) fn is_urgent(self) -> bool {
        self.event() == NoticeEvent::Stop
    }

    /// Returns the kind as programs read it.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            NoticeKind::Question => "question",
            NoticeKind::GoalLost => "goal-lost",
            NoticeKind::GoalLate => "goal-late",
            NoticeKind::GoalLateSoon => "goal-late-soon",
            NoticeKind::AgentGone => "agent-gone",
            NoticeKind::AgentBack => "agent-back",
            NoticeKind::Stop => "stop",
            NoticeKind::Release => "release",
        }
    }
}

// === impl Notice ===

impl Notice {
    /// Creates a notice. `about` tells the notice from all others of its kind: two replicas that
    /// notice the same give it the same identifier.
    pub(crate) fn new(kind: NoticeKind, about: &str, at_ms: u64) -> Notice {
        Notice {
            id: notice_id(kind.as_str(), about),
            kind,
            at_ms,
            agents: Vec::new(),
            conversation: None,
            text: String::new(),
            scope: Vec::new(),
            ends_ms: None,
            asked_at: None,
        }
    }

    pub(crate) fn with_text(mut self, text: &str) -> Notice {
        self.text = shortened(text);
        self
    }

    pub(crate) fn with_agents(mut self, agents: Vec<AgentId>) -> Notice {
        self.agents = agents;
        self
    }
}

// === impl NoticeDelivery ===

impl NoticeDelivery {
    /// Whether one of the notices is about a stop.
    pub(crate) fn is_urgent(&self) -> bool {
        self.notices.iter().any(|notice| notice.kind.is_urgent())
    }

    /// Whether one of the notices is a question, which needs an answer in time.
    pub(crate) fn has_question(&self) -> bool {
        self.notices.iter().any(|notice| notice.kind == NoticeKind::Question)
    }
}

/// Returns the identifier of what `about` describes.
pub(crate) fn notice_id(kind: &str, about: &str) -> String {
    let hash = digest(&SHA256, format!("{kind}\n{about}").as_bytes());
    hash.as_ref().iter().take(ID_BYTES).map(|byte| format!("{byte:02x}")).collect()
}

/// Returns a text on one line, without control characters, and cut to the longest length.
pub(crate) fn shortened(text: &str) -> String {
    let mut short = String::new();
    for word in text.split(|c: char| c.is_whitespace() || c.is_control()) {
        if word.is_empty() {
            continue;
        }
        if !short.is_empty() {
            short.push(' ');
        }
        for c in word.chars() {
            if short.len() + c.len_utf8() > TEXT_BYTES_MAX {
                short.push('…');
                return short;
            }
            short.push(c);
        }
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_thing_has_the_same_identifier_everywhere() {
        let one = Notice::new(NoticeKind::Stop, "9f3a", 1);
        assert_eq!(one.id, Notice::new(NoticeKind::Stop, "9f3a", 2).id);
        assert_ne!(one.id, Notice::new(NoticeKind::Release, "9f3a", 1).id);
        assert_ne!(one.id, Notice::new(NoticeKind::Stop, "9f3b", 1).id);
        assert_eq!(one.id.len(), 2 * ID_BYTES);
    }

    #[test]
    fn texts_are_one_line_and_short() {
        assert_eq!(shortened(" a\n\tb\u{7}c \r\n"), "a b c");
        let long = shortened(&"ä".repeat(TEXT_BYTES_MAX));
        assert_eq!((long.len(), long.ends_with('…')), (TEXT_BYTES_MAX + '…'.len_utf8(), true));
    }
}
