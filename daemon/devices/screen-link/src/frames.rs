//! Sends and receives messages of JSON on a socket, each followed by a delimiter.

use serde_json::Value;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::UnixStream;

use crate::ScreenLinkError;

/// Maximum length of a message of the program, in bytes. Events may contain the address of a page,
/// and an address of the kind `data:` contains the whole page.
const MESSAGE_BYTES_MAX: usize = 8 << 20;

/// Number of bytes that one read receives at most.
const READ_BYTES: usize = 16 << 10;

/// A socket that carries messages in both directions.
#[derive(Debug)]
pub(crate) struct Frames {
    stream: UnixStream,
    delimiter: u8,
    /// Bytes that have arrived and belong to no message yet.
    received: Vec<u8>,
    /// Number of bytes at the beginning of `received` that contain no delimiter.
    scanned: usize,
}

impl Frames {
    pub(crate) fn new(stream: UnixStream, delimiter: u8) -> Frames {
        Frames { stream, delimiter, received: Vec::new(), scanned: 0 }
    }

    /// Writes a message.
    pub(crate) async fn send(&mut self, message: &Value) -> Result<(), ScreenLinkError> {
        let mut bytes = message.to_string().into_bytes();
        bytes.push(self.delimiter);
        self.stream.write_all(&bytes).await?;
        Ok(())
    }

    /// Returns the next message. Nothing is lost if the future is dropped.
    pub(crate) async fn next(&mut self) -> Result<Value, ScreenLinkError> {
        loop {
            let is_end = |byte: &u8| *byte == self.delimiter;
            let unseen = self.received.get(self.scanned..).unwrap_or_default();
            if let Some(end) = unseen.iter().position(is_end) {
                let rest = self.received.split_off(self.scanned + end + 1);
                let mut message = std::mem::replace(&mut self.received, rest);
                self.scanned = 0;
                message.pop();
                if message.iter().all(u8::is_ascii_whitespace) {
                    continue;
                }
                return serde_json::from_slice(&message).map_err(|error| {
                    ScreenLinkError::Malformed(format!("it is not JSON: {error}"))
                });
            }
            self.scanned = self.received.len();
            if self.scanned > MESSAGE_BYTES_MAX {
                let limit = MESSAGE_BYTES_MAX >> 20;
                return Err(ScreenLinkError::Malformed(format!("it is longer than {limit} MiB")));
            }
            self.received.reserve(READ_BYTES);
            if self.stream.read_buf(&mut self.received).await? == 0 {
                return Err(ScreenLinkError::Closed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[tokio::test]
    async fn messages_arrive_whole_however_they_are_cut() {
        let (ours, mut theirs) = UnixStream::pair().expect("a pair");
        let mut frames = Frames::new(ours, 0);
        for part in [&b"{\"a\":"[..], b"1}\0{\"b\"", b":2}\0\0[", b"3]\0"] {
            theirs.write_all(part).await.expect("written");
        }
        drop(theirs);
        for expected in [json!({ "a": 1 }), json!({ "b": 2 }), json!([3])] {
            assert_eq!(frames.next().await.expect("a message"), expected);
        }
        assert!(matches!(frames.next().await, Err(ScreenLinkError::Closed)));
    }

    #[tokio::test]
    async fn garbage_and_endless_messages_are_errors() {
        let (ours, mut theirs) = UnixStream::pair().expect("a pair");
        let mut frames = Frames::new(ours, b'\n');
        theirs.write_all(b"\xff\xfe{\n").await.expect("written");
        assert!(matches!(frames.next().await, Err(ScreenLinkError::Malformed(_))));
        let flood = tokio::spawn(async move {
            let part = vec![b'x'; 64 << 10];
            while theirs.write_all(&part).await.is_ok() {}
        });
        let problem = frames.next().await.expect_err("too long").to_string();
        assert_eq!(problem, "read a message of the program: it is longer than 8 MiB");
        drop(frames);
        flood.await.expect("it ends");
    }
}
