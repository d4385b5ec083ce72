//! The activity: what happened, in sentences, the last ones of them.

use std::collections::VecDeque;

use acl::{AgentId, ConversationId};

use crate::moment::Moment;
use crate::rows::{ActivityEntry, ActivityLevel};
use crate::text::short;

/// A sentence for the activity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Sentence {
    pub(crate) level: ActivityLevel,
    pub(crate) text: String,
    pub(crate) conversation: Option<ConversationId>,
    pub(crate) agent: Option<AgentId>,
}

impl Sentence {
    pub(crate) fn new(level: ActivityLevel, text: impl Into<String>) -> Sentence {
        Sentence { level, text: text.into(), conversation: None, agent: None }
    }

    pub(crate) fn routine(text: impl Into<String>) -> Sentence {
        Sentence::new(ActivityLevel::Routine, text)
    }

    pub(crate) fn notable(text: impl Into<String>) -> Sentence {
        Sentence::new(ActivityLevel::Notable, text)
    }

    pub(crate) fn problem(text: impl Into<String>) -> Sentence {
        Sentence::new(ActivityLevel::Problem, text)
    }

    pub(crate) fn in_conversation(mut self, conversation: &ConversationId) -> Sentence {
        self.conversation = Some(conversation.clone());
        self
    }

    pub(crate) fn about(mut self, agent: &AgentId) -> Sentence {
        self.agent = Some(agent.clone());
        self
    }
}

#[derive(Clone, Debug)]
pub(crate) struct ActivityLog {
    entries: VecDeque<ActivityEntry>,
    entries_max: usize,
    text_bytes: usize,
    count: u64,
}

impl ActivityLog {
    pub(crate) fn new(entries_max: usize, text_bytes: usize) -> ActivityLog {
        ActivityLog { entries: VecDeque::new(), entries_max, text_bytes, count: 0 }
    }

    pub(crate) fn add(&mut self, at: Moment, sentence: Sentence) {
        let Sentence { level, text, conversation, agent } = sentence;
        self.count += 1;
        let text = short(&text, self.text_bytes);
        let number = self.count;
        self.entries.push_back(ActivityEntry { number, at, level, text, conversation, agent });
        while self.entries.len() > self.entries_max {
            self.entries.pop_front();
        }
    }

    pub(crate) fn entries(&self) -> &VecDeque<ActivityEntry> {
        &self.entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_sentences_are_kept() {
        let mut log = ActivityLog::new(2, 10);
        for text in ["one", "two", "three\n and four and more"] {
            log.add(Moment(1), Sentence::routine(text));
        }
        let kept: Vec<_> =
            log.entries().iter().map(|entry| (entry.number, entry.text.as_str())).collect();
        assert_eq!(kept, [(2, "two"), (3, "three a…")]);
    }
}
