//! An agent's mailbox: bounded, so that a flood is refused and not hoarded.

use std::sync::Arc;

use acl::{Message, MessageId};
use bytes::Bytes;
use substrate::Question;
use tokio::sync::mpsc;

/// What can lie in a mailbox.
pub(crate) enum Letter {
    /// A message to this agent, as it came.
    Direct(Bytes),
    /// A message to all that this agent listens to; read once for the whole daemon.
    Broadcast(Arc<Message>),
    /// A receipt for a message of this agent.
    Receipts(Vec<MessageId>),
    /// A question that this agent may answer.
    Question(Question),
}

/// The slot through which letters are put in.
#[derive(Clone)]
pub(crate) struct Slot(mpsc::Sender<Letter>);

/// Where the agent takes them out.
pub(crate) struct Mailbox(mpsc::Receiver<Letter>);

/// A mailbox for `letters_max` letters.
pub(crate) fn mailbox(letters_max: usize) -> (Slot, Mailbox) {
    let (slot, mailbox) = mpsc::channel(letters_max.max(1));
    (Slot(slot), Mailbox(mailbox))
}

impl Slot {
    /// Puts a letter in; gives it back if the mailbox is full or its agent has ended.
    pub(crate) fn put(&self, letter: Letter) -> Result<(), Letter> {
        self.0.try_send(letter).map_err(|error| match error {
            mpsc::error::TrySendError::Full(letter) | mpsc::error::TrySendError::Closed(letter) => {
                letter
            }
        })
    }

    /// Whether nobody takes letters out any more.
    pub(crate) fn is_closed(&self) -> bool {
        self.0.is_closed()
    }
}

impl Mailbox {
    /// The next letter; `None` when nobody can put one in any more.
    pub(crate) async fn next(&mut self) -> Option<Letter> {
        self.0.recv().await
    }
}
