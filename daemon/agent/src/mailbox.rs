//! An agent's mailbox: bounded, so that a flood is refused and not hoarded.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use acl::content::MailboxStatus;
use acl::{AgentId, Message, MessageId};
use bytes::Bytes;
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
}

/// What became of the letters so far.
#[derive(Default)]
struct Counts {
    received: AtomicU64,
    overflowed: AtomicU64,
}

/// Where the agent takes them out.
pub(crate) struct Mailbox(mpsc::Receiver<Letter>);

/// A mailbox for `letters_max` letters.
pub(crate) fn mailbox(letters_max: usize) -> (Slot, Mailbox) {
    let (letters, mailbox) = mpsc::channel(letters_max.max(1));
    (Slot { letters, counts: Arc::default() }, Mailbox(mailbox))
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
    /// How many letters are in it.
    #[cfg(test)]
    pub(crate) fn waiting(&self) -> usize {
        self.0.len()
    }

    /// The next letter; `None` when nobody can put one in any more.
    pub(crate) async fn next(&mut self) -> Option<Letter> {
        self.0.recv().await
    }
}
