//! An agent's mailbox: bounded, so that a flood is refused and not hoarded.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use acl::content::MailboxStatus;
use acl::{AgentId, Message, MessageId};
use bytes::Bytes;
use conversation::Seen;
use substrate::Question;
use tokio::sync::mpsc;

/// What can lie in a mailbox.
pub(crate) enum Letter {
    /// A message to this agent, as it came.
    Direct(Bytes),
    /// A message to all that this agent listens to; read once for the whole daemon.
    Broadcast(Arc<Message>),
    /// A message to all that came before this agent did, as it came.
    Missed(Bytes),
    /// A receipt for a message of this agent.
    Receipts(Vec<MessageId>),
    /// A question that this agent may answer.
    Question(Question),
    /// An agent of its name has come or gone elsewhere.
    Namesake,
}

/// The slot through which letters are put in.
#[derive(Clone)]
pub(crate) struct Slot {
    letters: mpsc::Sender<Letter>,
    counts: Arc<Counts>,
    door: Arc<Door>,
}

/// Which messages an agent has heard, and which were refused before it heard them. A copy of a
/// message that waits in a full mailbox may come again: one of the two words counts, never both.
pub(crate) struct Door(Mutex<Known>);

struct Known {
    heard: Seen,
    refused: Seen,
}

/// What is known of a message that an agent takes out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passed {
    /// It is new.
    New,
    /// The agent has heard it before.
    Before,
    /// Its sender was told that it is refused.
    Refused,
}

/// What became of the letters so far.
#[derive(Default)]
struct Counts {
    received: AtomicU64,
    overflowed: AtomicU64,
}

/// Where the agent takes them out.
pub(crate) struct Mailbox {
    letters: mpsc::Receiver<Letter>,
    door: Arc<Door>,
}

/// A mailbox for `letters_max` letters, that remembers `known_max` messages.
pub(crate) fn mailbox(letters_max: usize, known_max: usize) -> (Slot, Mailbox) {
    let (letters, mailbox) = mpsc::channel(letters_max.max(1));
    let door = Arc::new(Door::new(known_max));
    let slot = Slot { letters, counts: Arc::default(), door: Arc::clone(&door) };
    (slot, Mailbox { letters: mailbox, door })
}

impl Door {
    fn new(known_max: usize) -> Door {
        Door(Mutex::new(Known { heard: Seen::new(known_max), refused: Seen::new(known_max) }))
    }

    /// Notes that an agent hears a message.
    pub(crate) fn hear(&self, id: &MessageId) -> Passed {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if known.refused.has(id) {
            Passed::Refused
        } else if known.heard.note(id) {
            Passed::New
        } else {
            Passed::Before
        }
    }

    /// Notes that a message is refused before its agent hears it; `false` if it has heard it.
    pub(crate) fn refuse(&self, id: &MessageId) -> bool {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_unheard = !known.heard.has(id);
        if is_unheard {
            known.refused.note(id);
        }
        is_unheard
    }
}

impl Slot {
    /// Puts a letter in; gives it back if the mailbox is full or its agent has ended.
    pub(crate) fn put(&self, letter: Letter) -> Result<(), Letter> {
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

    /// What is known of the messages that come here.
    pub(crate) fn door(&self) -> &Door {
        &self.door
    }

    /// How full it is, as the mailbox of `agent`.
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

    /// Whether nobody takes letters out any more.
    pub(crate) fn is_closed(&self) -> bool {
        self.letters.is_closed()
    }
}

impl Mailbox {
    /// What is known of the messages that come here.
    pub(crate) fn door(&self) -> Arc<Door> {
        Arc::clone(&self.door)
    }

    /// How many letters are in it.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        self.letters.len()
    }

    /// The next letter; `None` when nobody can put one in any more.
    pub(crate) async fn next(&mut self) -> Option<Letter> {
        self.letters.recv().await
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_heard_or_refused_and_never_both() {
        let door = Door::new(8);
        let [queued, heard] = ["queued", "heard"].map(MessageId::new);
        assert!(door.refuse(&queued), "its copy found no room");
        assert_eq!(door.hear(&queued), Passed::Refused);
        assert_eq!(door.hear(&heard), Passed::New);
        assert!(!door.refuse(&heard), "a copy that is late changes nothing");
        assert_eq!(door.hear(&heard), Passed::Before);
    }
}
