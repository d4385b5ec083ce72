//! A stream whose reader must read: writing that makes no progress for too long fails, so that a
//! browser that does not read loses its connection and nothing else.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep_until};

/// How long a client may read nothing while something waits to be sent. A phone that changes its
/// network comes back within this time, or connects anew.
pub(crate) const READ_WITHIN: Duration = Duration::from_secs(30);

/// A stream with a deadline for writing.
pub(crate) struct DeadlineStream<S> {
    stream: S,
    /// The end of the wait for the client; `None` while nothing waits.
    waiting: Option<Pin<Box<Sleep>>>,
}

impl<S> DeadlineStream<S> {
    pub(crate) fn new(stream: S) -> DeadlineStream<S> {
        DeadlineStream { stream, waiting: None }
    }

    /// Turns waiting that lasts too long into an error.
    fn bound<T>(
        &mut self,
        context: &mut Context<'_>,
        outcome: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if outcome.is_ready() {
            self.waiting = None;
            return outcome;
        }
        let until = || Box::pin(sleep_until(Instant::now() + READ_WITHIN));
        match self.waiting.get_or_insert_with(until).as_mut().poll(context) {
            Poll::Pending => Poll::Pending,
            Poll::Ready(()) => {
                let problem = "the client did not read what was sent";
                Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, problem)))
            }
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for DeadlineStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for DeadlineStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.bound(context, outcome)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let outcome = Pin::new(&mut self.stream).poll_write_vectored(context, parts);
        self.bound(context, outcome)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let outcome = Pin::new(&mut self.stream).poll_flush(context);
        self.bound(context, outcome)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let outcome = Pin::new(&mut self.stream).poll_shutdown(context);
        self.bound(context, outcome)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, duplex};

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn writing_fails_only_if_nothing_is_read_for_long() {
        let (near, mut far) = duplex(4);
        let mut stream = DeadlineStream::new(near);
        let began = Instant::now();
        let (written, ()) = tokio::join!(stream.write_all(b"0123456789abcdef"), async {
            // Slow, but it reads.
            for _ in 0..3 {
                tokio::time::sleep(READ_WITHIN * 9 / 10).await;
                far.read_exact(&mut [0; 4]).await.expect("something is there");
            }
        });
        written.expect("each wait was short enough");
        assert!(began.elapsed() > READ_WITHIN * 2);
        let error = stream.write_all(b"0123456789").await.expect_err("nothing is read");
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
