//! The events of one page: an endless answer whose parts are made when the socket can take them.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use bytes::Bytes;
use http_body::{Body, Frame};
use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use crate::caller::Caller;
use crate::host::BoxFuture;
use crate::server_state::{ServerState, StreamPlace};
use crate::topic_store::RowReader;

/// Interval of the comments that keep a connection open on its way, and show a page that the daemon
/// is there.
const COMMENT_EVERY: Duration = Duration::from_secs(15);

/// First line of a stream: how long a page waits until it connects again, in milliseconds.
const RETRY: &str = "retry: 2000\n\n";

/// A comment of the stream.
const COMMENT: &str = ": \n\n";

/// The source of the events of one page.
pub(crate) struct EventSource {
    pub(crate) state: Arc<ServerState>,
    pub(crate) caller: Caller,
    pub(crate) reader: RowReader,
    /// When the caller was looked at last: nothing tells that a session ends by the passing of time.
    pub(crate) looked_at: Instant,
    /// The number of changes of people and sessions.
    pub(crate) people: watch::Receiver<u64>,
    pub(crate) _place: StreamPlace,
}

impl EventSource {
    /// Returns the next part of the stream; `None` if the session has ended.
    async fn next(&mut self) -> Option<Bytes> {
        let until = Instant::now() + COMMENT_EVERY;
        loop {
            let is_due = self.looked_at.elapsed() >= COMMENT_EVERY;
            if self.people.has_changed().unwrap_or(true) || is_due {
                self.people.mark_unchanged();
                self.looked_at = Instant::now();
                if !self.caller.may_look(&self.state.accounts) {
                    return None;
                }
            }
            let now = self.state.host.now();
            if let Some(event) = self.reader.event(now.0) {
                return Some(Bytes::from(event));
            }
            let left = until.saturating_duration_since(Instant::now());
            let waited = timeout(left, async {
                tokio::select! {
                    () = self.reader.changed() => (),
                    _ = self.people.changed() => self.people.mark_changed(),
                }
            });
            if waited.await.is_err() {
                let is_open = self.caller.may_look(&self.state.accounts);
                return is_open.then(|| Bytes::from_static(COMMENT.as_bytes()));
            }
        }
    }
}

/// The body of the answer: the next part is made only when the connection asks for it, so that a
/// page that does not read costs one part of memory.
pub(crate) struct EventBody {
    /// The next part; `None` at the end.
    next: Option<BoxFuture<(EventSource, Option<Bytes>)>>,
}

impl EventBody {
    /// Begins a stream.
    pub(crate) fn new(source: EventSource) -> EventBody {
        let first = async { (source, Some(Bytes::from_static(RETRY.as_bytes()))) };
        EventBody { next: Some(Box::pin(first)) }
    }
}

impl Body for EventBody {
    type Data = Bytes;
    type Error = std::convert::Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Self::Error>>> {
        let Some(next) = &mut self.next else { return Poll::Ready(None) };
        let Poll::Ready((mut source, part)) = next.as_mut().poll(context) else {
            return Poll::Pending;
        };
        self.next = part.as_ref().map(|_| -> BoxFuture<(EventSource, Option<Bytes>)> {
            Box::pin(async move {
                let part = source.next().await;
                (source, part)
            })
        });
        Poll::Ready(part.map(|part| Ok(Frame::data(part))))
    }
}
