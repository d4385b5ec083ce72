//! Mailbox of an agent: a bounded queue. When the queue is full, further messages are refused.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use acl::content::MailboxStatus;
use acl::{AgentId, Message, MessageId};
use bytes::Bytes;
use conversation::DuplicateWindow;
use substrate::ReceivedQuery;
use tokio::sync::mpsc;

/// Item in a mailbox: a message, receipts, a query, or a notice of the router.
pub(crate) enum MailboxItem {
    /// A message to this agent alone, not decoded.
    Direct(Bytes),
    /// A broadcast with a performative that this agent listens to; decoded once for the whole
    /// daemon.
    Broadcast(Arc<Message>),
    /// A broadcast that arrived before this agent started, not decoded.
    Replayed(Bytes),
    /// Receipts for messages that this agent has sent.
    Receipts(Vec<MessageId>),
    /// A query of a resource, which this agent may answer.
    Question(ReceivedQuery),
    /// An agent of the same name has joined or left at another daemon.
    NameConflict,
}

/// Sending half of a mailbox.
#[derive(Clone)]
pub(crate) struct MailboxSender {
    letters: mpsc::Sender<MailboxItem>,
    counts: Arc<MailboxCounters>,
    door: Arc<DuplicateFilter>,
}

/// Duplicate window of an agent: the messages that the agent has received, and the messages that
/// were refused before the agent received them. A copy of a queued message may arrive when the
/// mailbox is full. The window ensures that the message is then either handled or refused, never
/// both.
pub(crate) struct DuplicateFilter(Mutex<FilterWindows>);

struct FilterWindows {
    heard: DuplicateWindow,
    refused: DuplicateWindow,
}

/// State of a message that an agent takes out of its mailbox, by the agent's duplicate window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MessageState {
    /// The message is new.
    New,
    /// The agent has received the message before.
    Before,
    /// The message was refused, and its sender was sent the refusal.
    Refused,
}

/// Counts of items: those that were put into a mailbox, and those that found it full.
#[derive(Default)]
struct MailboxCounters {
    received: AtomicU64,
    overflowed: AtomicU64,
}

/// Receiving half of a mailbox.
pub(crate) struct Mailbox {
    letters: mpsc::Receiver<MailboxItem>,
    door: Arc<DuplicateFilter>,
}

/// Creates a mailbox that holds at most `letters_max` items, with a duplicate window of `known_max`
/// message ids.
pub(crate) fn mailbox(letters_max: usize, known_max: usize) -> (MailboxSender, Mailbox) {
    let (letters, mailbox) = mpsc::channel(letters_max.max(1));
    let door = Arc::new(DuplicateFilter::new(known_max));
    let slot = MailboxSender { letters, counts: Arc::default(), door: Arc::clone(&door) };
    (slot, Mailbox { letters: mailbox, door })
}

impl DuplicateFilter {
    fn new(known_max: usize) -> DuplicateFilter {
        DuplicateFilter(Mutex::new(FilterWindows {
            heard: DuplicateWindow::new(known_max),
            refused: DuplicateWindow::new(known_max),
        }))
    }

    /// Records that the agent receives a message, and returns the state of the message.
    pub(crate) fn receive(&self, sender: &AgentId, id: &MessageId) -> MessageState {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if known.refused.contains(sender, id) {
            MessageState::Refused
        } else if known.heard.insert(sender, id) {
            MessageState::New
        } else {
            MessageState::Before
        }
    }

    /// Records that a message is refused before its agent receives it. Returns `false`, and records
    /// nothing, if the agent has received the message.
    pub(crate) fn refuse(&self, sender: &AgentId, id: &MessageId) -> bool {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_unheard = !known.heard.contains(sender, id);
        if is_unheard {
            known.refused.insert(sender, id);
        }
        is_unheard
    }
}

impl MailboxSender {
    /// Adds an item to the mailbox; returns the item if the mailbox is full or its agent has ended.
    pub(crate) fn put(&self, letter: MailboxItem) -> Result<(), MailboxItem> {
        match self.letters.try_send(letter) {
            Ok(()) => {
                self.counts.received.fetch_add(1, Ordering::Relaxed);
                Ok(())
            }
            Err(mpsc::error::TrySendError::Full(letter)) => {
                self.counts.overflowed.fetch_add(1, Ordering::Relaxed);
                Err(letter)
            }
            Err(mpsc::error::TrySendError::Closed(letter)) => Err(letter),
        }
    }

    /// Returns the duplicate window of the agent that owns the mailbox.
    pub(crate) fn door(&self) -> &DuplicateFilter {
        &self.door
    }

    /// Returns the number of items and the counters of this mailbox; `agent` is the name under
    /// which they are reported.
    pub(crate) fn status(&self, agent: AgentId) -> MailboxStatus {
        let (room, most) = (self.letters.capacity(), self.letters.max_capacity());
        let number = |count: usize| u64::try_from(count).unwrap_or(u64::MAX);
        MailboxStatus {
            agent,
            waiting: number(most - room),
            waiting_max: number(most),
            received: self.counts.received.load(Ordering::Relaxed),
            overflowed: self.counts.overflowed.load(Ordering::Relaxed),
        }
    }

    /// Returns how many items wait, how many fit, and how many have found the mailbox full.
    pub(crate) fn load(&self) -> (usize, usize, u64) {
        let (room, most) = (self.letters.capacity(), self.letters.max_capacity());
        (most - room, most, self.counts.overflowed.load(Ordering::Relaxed))
    }

    /// Whether the agent has ended, so that no item is taken out of the mailbox any more.
    pub(crate) fn is_closed(&self) -> bool {
        self.letters.is_closed()
    }
}

impl Mailbox {
    /// Returns the duplicate window of the agent that owns the mailbox.
    pub(crate) fn door(&self) -> Arc<DuplicateFilter> {
        Arc::clone(&self.door)
    }

    /// Returns the number of items in the mailbox.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        self.letters.len()
    }

    /// Waits for the next item and returns it; `None` once all sending halves are gone.
    pub(crate) async fn next(&mut self) -> Option<MailboxItem> {
        self.letters.recv().await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_received_or_refused_and_never_both() {
        let door = DuplicateFilter::new(8);
        let [queued, heard] = ["queued", "heard"].map(MessageId::new);
        let robot = AgentId::new("robot").expect("a name");
        assert!(door.refuse(&robot, &queued), "its copy found no room");
        assert_eq!(door.receive(&robot, &queued), MessageState::Refused);
        assert_eq!(door.receive(&robot, &heard), MessageState::New);
        assert!(!door.refuse(&robot, &heard), "a copy that is late changes nothing");
        assert_eq!(door.receive(&robot, &heard), MessageState::Before);
    }
}
