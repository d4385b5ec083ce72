//! The conversations, with the last messages of each.

use std::collections::{BTreeSet, VecDeque};

use acl::{AgentId, ConversationId, Message, Protocol};
use serde_json::Value;

use crate::bounded::BoundedMap;
use crate::moment::{Moment, ViewLimits};
use crate::rows::{ConversationDetail, ConversationRow, MessageRow};
use crate::summary::{subject, summarize};
use crate::text::short;

/// Maximum number of agents of one conversation that are listed; further ones are counted with
/// their messages only.
const LANES_MAX: usize = 1_000;

/// Maximum number of receivers of one message that are kept.
const RECEIVERS_MAX: usize = 64;

#[derive(Clone, Debug)]
struct ConversationRecord {
    subject: String,
    protocols: BTreeSet<Protocol>,
    first_at: Moment,
    last_at: Moment,
    count: u64,
    senders: BTreeSet<AgentId>,
    out_of_turn: u64,
    messages: VecDeque<MessageRow>,
}

#[derive(Clone, Debug)]
pub(crate) struct ConversationStore {
    conversations: BoundedMap<ConversationId, ConversationRecord>,
    /// Number of messages of all conversations together.
    kept: usize,
    messages_max: usize,
    messages_per_conversation: usize,
    text_bytes: usize,
}

impl ConversationStore {
    pub(crate) fn new(limits: &ViewLimits) -> ConversationStore {
        ConversationStore {
            conversations: BoundedMap::new(limits.conversations),
            kept: 0,
            messages_max: limits.messages,
            messages_per_conversation: limits.messages_per_conversation.max(1),
            text_bytes: limits.text_bytes,
        }
    }

    /// Takes a message, and the description of the rule that it breaks.
    pub(crate) fn add(&mut self, at: Moment, message: &Message, out_of_turn: Option<String>) {
        let id = &message.conversation_id;
        let is_new = !self.conversations.contains(id);
        if is_new && is_housekeeping(message) {
            return;
        }
        if is_new {
            let record = ConversationRecord {
                subject: String::new(),
                protocols: BTreeSet::new(),
                first_at: at,
                last_at: at,
                count: 0,
                senders: BTreeSet::new(),
                out_of_turn: 0,
                messages: VecDeque::new(),
            };
            if let Some((_, dropped)) = self.conversations.insert(id.clone(), record) {
                self.kept -= dropped.messages.len();
            }
        }
        self.conversations.renew(id);
        let Some(record) = self.conversations.get_mut(id) else { return };
        if record.subject.is_empty() {
            record.subject = short(&subject(message), self.text_bytes);
        }
        record.protocols.extend(message.protocol);
        record.last_at = at;
        record.count += 1;
        record.out_of_turn += u64::from(out_of_turn.is_some());
        if record.senders.len() < LANES_MAX {
            record.senders.insert(message.sender.clone());
        }
        record.messages.push_back(MessageRow {
            at,
            from: message.sender.clone(),
            to: message.receiver.iter().take(RECEIVERS_MAX).cloned().collect(),
            performative: message.performative,
            protocol: message.protocol,
            summary: short(&summarize(message), self.text_bytes),
            out_of_turn: out_of_turn.map(|text| short(&text, self.text_bytes)),
        });
        self.kept += 1;
        if record.messages.len() > self.messages_per_conversation {
            record.messages.pop_front();
            self.kept -= 1;
        }
        while self.kept > self.messages_max
            && let Some((_, dropped)) = self.conversations.pop_oldest()
        {
            self.kept -= dropped.messages.len();
        }
    }

    /// Returns all conversations, the one with the newest message first.
    pub(crate) fn rows(&self) -> Vec<ConversationRow> {
        self.conversations.newest_first().map(|(id, record)| record.row(id)).collect()
    }

    pub(crate) fn detail(&self, id: &ConversationId) -> Option<ConversationDetail> {
        let record = self.conversations.get(id)?;
        let mut seen = BTreeSet::new();
        let agents =
            record.messages.iter().flat_map(|row| std::iter::once(&row.from).chain(&row.to));
        let lanes = agents.filter(|agent| seen.insert(*agent)).take(LANES_MAX).cloned().collect();
        let kept = u64::try_from(record.messages.len()).unwrap_or(u64::MAX);
        Some(ConversationDetail {
            row: record.row(id),
            lanes,
            messages: record.messages.iter().cloned().collect(),
            dropped: record.count.saturating_sub(kept),
        })
    }
}

/// Whether no conversation begins with a message: the storage of a record, a stop (which is requested
/// of each agent on its own), or the answer to one of these.
fn is_housekeeping(message: &Message) -> bool {
    let act = message.content.get("act").and_then(Value::as_str);
    let is_for_each =
        ["store-records", "stop", "release-stops", "read-history"].map(Some).contains(&act);
    let answers = message.protocol == Some(Protocol::StateChange) && !message.opens_exchange();
    is_for_each || answers
}

impl ConversationRecord {
    fn row(&self, id: &ConversationId) -> ConversationRow {
        ConversationRow {
            conversation: id.clone(),
            subject: self.subject.clone(),
            protocols: self.protocols.iter().copied().collect(),
            first_at: self.first_at,
            last_at: self.last_at,
            messages: self.count,
            participants: u64::try_from(self.senders.len()).unwrap_or(u64::MAX),
            out_of_turn: self.out_of_turn,
        }
    }
}
