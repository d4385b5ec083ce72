//! Overhearing: an agent receives the messages between all other agents of the ecosystem, in batches
//! and with a count of those that it was too slow for.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use acl::Message;
use substrate::{BoxFuture, Origin, OverhearToken, OverheardMessage, SendError};
use tokio::sync::{Mutex, mpsc};

use crate::router::MessageRouter;

/// Maximum number of messages in one batch. A greater one would delay the agent's other events.
const BATCH_MAX: usize = 256;

/// Messages that an agent has overheard since the last batch.
#[derive(Debug, Default)]
pub struct OverheardBatch {
    /// The messages, in the order of their arrival. In a secured ecosystem each has the signature
    /// of a daemon that may send in the name of the message's sender.
    pub messages: Vec<Overheard>,
    /// Number of messages that were lost since the last batch, because too many waited.
    pub lost: u64,
    /// Number of messages since the last batch that could not be read.
    pub unreadable: u64,
    /// Number of messages since the last batch that a daemon has signed without the right to send
    /// in the name of their sender.
    pub forged: u64,
}

/// One overheard message.
#[derive(Clone, Debug)]
pub struct Overheard {
    /// The message.
    pub message: Message,
    /// Origin of the message, as its signature proves; `None` if messages are not signed.
    pub origin: Option<Origin>,
}

/// Bounded queue of overheard messages. Clones refer to the same queue, which listens as long as
/// one of them exists.
#[derive(Clone)]
pub(crate) struct OverheardQueue(Arc<QueueState>);

struct QueueState {
    router: Arc<MessageRouter>,
    waiting: Mutex<mpsc::Receiver<OverheardMessage>>,
    lost: Arc<AtomicU64>,
    _token: OverhearToken,
}

// === impl OverheardQueue ===

impl OverheardQueue {
    /// Starts to listen. At most `waiting_max` messages wait to be taken; more are lost and
    /// counted.
    pub(crate) fn listen(
        router: &Arc<MessageRouter>,
        waiting_max: usize,
    ) -> Result<OverheardQueue, SendError> {
        let (sender, waiting) = mpsc::channel(waiting_max.max(1));
        let lost = Arc::<AtomicU64>::default();
        let count = Arc::clone(&lost);
        let listener = move |message| {
            if sender.try_send(message).is_err() {
                count.fetch_add(1, Ordering::Relaxed);
            }
        };
        let token = router.overhear(Arc::new(listener))?;
        Ok(OverheardQueue(Arc::new(QueueState {
            router: Arc::clone(router),
            waiting: Mutex::new(waiting),
            lost,
            _token: token,
        })))
    }

    /// Resolves to the next batch. Resolves to `None` when the substrate is closed.
    pub(crate) fn next(&self) -> BoxFuture<Option<OverheardBatch>> {
        let queue = self.clone();
        Box::pin(async move {
            let mut received = Vec::new();
            if queue.0.waiting.lock().await.recv_many(&mut received, BATCH_MAX).await == 0 {
                return None;
            }
            let mut batch = OverheardBatch {
                lost: queue.0.lost.swap(0, Ordering::Relaxed),
                ..OverheardBatch::default()
            };
            for OverheardMessage { payload, origin, .. } in received {
                match acl::decode(&payload) {
                    Err(_) => batch.unreadable += 1,
                    Ok(message) if queue.0.router.is_from_sender(origin.as_ref(), &message) => {
                        batch.messages.push(Overheard { message, origin });
                    }
                    Ok(_) => batch.forged += 1,
                }
            }
            Some(batch)
        })
    }
}
