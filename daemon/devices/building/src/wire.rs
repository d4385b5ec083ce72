//! The protocol of the building's socket: lines of JSON, of bounded length in both directions.
//!
//! A client writes [`WireRequest`]s, the server writes [`ServerLine`]s. Unknown fields are ignored,
//! so that a newer program can communicate with an older one; an unknown request is refused. This
//! file has only the framing; `client` and `server` handle the meaning of the lines.

use std::io;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::io::{AsyncBufReadExt as _, AsyncRead, AsyncWrite, AsyncWriteExt as _, BufReader};

use crate::driver_requests::{DriverAnswer, DriverRequest};
use crate::error::DeviceError;

/// Maximum length of a line, in bytes; a longer line is an error. The longest line in use is a
/// refusal that lists a corridor's neighbors: 100 names of 64 bytes.
pub(crate) const LINE_MAX: usize = 8 * 1024;

/// Interval at which the server sends an `Alive` line.
pub(crate) const ALIVE_PERIOD: Duration = Duration::from_secs(1);

/// Time without any line after which a client treats the server as dead. The time is five intervals
/// of the `Alive` lines, so that a machine that is briefly busy does not count as dead.
pub(crate) const SILENCE_MAX: Duration = Duration::from_secs(5);
const _: () = assert!(SILENCE_MAX.as_millis() >= 5 * ALIVE_PERIOD.as_millis());

/// Time limit for writing one line. After this limit the other side is presumed not to read any
/// more, and the connection ends.
pub(crate) const WRITE_MAX: Duration = SILENCE_MAX;

/// Maximum number of requests of one client that are under way; further requests are refused. An
/// actuator has one or two.
pub(crate) const IN_FLIGHT_MAX: usize = 64;

/// A request of a client.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct WireRequest {
    /// Number of the request, chosen by the client; unique among the client's requests under way.
    pub(crate) id: u64,
    pub(crate) ask: DriverRequest,
}

/// A line from the server.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ServerLine {
    /// A sign of life from the server, sent at intervals even if there are no answers.
    Alive,
    /// The request with this id was carried out, with this answer.
    Done { id: u64, answer: DriverAnswer },
    /// The request with this id was not carried out, because of this error.
    Failed { id: u64, error: DeviceError },
}

/// A reader of lines of at most [`LINE_MAX`] bytes. Dropping the future of `next` loses no bytes.
pub(crate) struct LineReader<R> {
    reader: BufReader<R>,
    partial: Vec<u8>,
}

impl<R: AsyncRead + Unpin> LineReader<R> {
    pub(crate) fn new(reader: R) -> LineReader<R> {
        LineReader { reader: BufReader::new(reader), partial: Vec::new() }
    }

    /// Returns the next line without its line end; `None` if the other side has closed the
    /// connection.
    pub(crate) async fn next(&mut self) -> io::Result<Option<Vec<u8>>> {
        loop {
            let arrived = self.reader.fill_buf().await?;
            if arrived.is_empty() {
                return Ok(None);
            }
            let end = arrived.iter().position(|byte| *byte == b'\n');
            let (piece, used) = match end {
                Some(end) => (&arrived[..end], end + 1),
                None => (arrived, arrived.len()),
            };
            if self.partial.len() + piece.len() > LINE_MAX {
                let reason = format!("a line is longer than {LINE_MAX} bytes");
                return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
            }
            self.partial.extend_from_slice(piece);
            self.reader.consume(used);
            if end.is_some() {
                return Ok(Some(std::mem::take(&mut self.partial)));
            }
        }
    }
}

/// Writes one line. Returns an error if that takes longer than [`WRITE_MAX`].
pub(crate) async fn write_line(
    writer: &mut (impl AsyncWrite + Unpin),
    line: &impl Serialize,
) -> io::Result<()> {
    let mut bytes = serde_json::to_vec(line).map_err(io::Error::other)?;
    bytes.push(b'\n');
    match tokio::time::timeout(WRITE_MAX, writer.write_all(&bytes)).await {
        Ok(written) => written,
        Err(_) => Err(io::Error::new(io::ErrorKind::TimedOut, "the other side does not read")),
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use tokio::io::{AsyncWriteExt as _, duplex};

    use super::{LINE_MAX, LineReader, write_line};

    /// Writes the pieces one by one, drops a waiting `next` between them, and compares the lines
    /// that are read with `expected`.
    async fn check(pieces: &[&[u8]], expected: &[&[u8]]) {
        let (mut writer, reader) = duplex(2 * LINE_MAX);
        let mut lines = LineReader::new(reader);
        let mut heard = Vec::new();
        for piece in pieces {
            writer.write_all(piece).await.unwrap();
            while let Some(next) = now_or_never(lines.next()).await {
                heard.push(next.unwrap().unwrap());
            }
        }
        drop(writer);
        assert!(lines.next().await.unwrap().is_none(), "the unfinished rest is no line");
        assert_eq!(heard, expected);
    }

    async fn now_or_never<T>(future: impl Future<Output = T>) -> Option<T> {
        tokio::select! {
            biased;
            output = future => Some(output),
            () = std::future::ready(()) => None,
        }
    }

    #[tokio::test]
    async fn lines_are_reassembled_from_any_pieces() {
        check(&[b"one\ntwo\n"], &[b"one", b"two"]).await;
        check(&[b"o", b"n", b"e\nt", b"wo", b"\n"], &[b"one", b"two"]).await;
        check(&[b"\n", b"\r\n", b"rest"], &[b"", b"\r"]).await;
        let longest = vec![b'x'; LINE_MAX];
        check(&[&longest, b"\n"], &[&longest]).await;
    }

    #[tokio::test]
    async fn a_line_without_an_end_is_an_error() {
        let (mut writer, reader) = duplex(2 * LINE_MAX);
        writer.write_all(&vec![b'x'; LINE_MAX + 1]).await.unwrap();
        let error = LineReader::new(reader).next().await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
    }

    #[tokio::test(start_paused = true)]
    async fn writing_to_a_peer_that_does_not_read_times_out() {
        let (mut writer, _reader) = duplex(8);
        let error = write_line(&mut writer, &"more than eight bytes").await.unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
