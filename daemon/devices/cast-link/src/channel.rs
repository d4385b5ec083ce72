//! The connection to a Chromecast: messages in both directions, and the heartbeat.
//!
//! The heartbeat is sent and answered while a message is awaited, so that a message has to be
//! awaited whenever nothing else is done. No message is lost or cut if a future is dropped.

use std::sync::Arc;
use std::time::Duration;

use rustls::pki_types::ServerName;
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout, timeout_at};
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

use crate::CastAddress;
use crate::error::CastError;
use crate::message::{CastMessage, LENGTH_BYTES, MESSAGE_BYTES_MAX};
use crate::tls;

/// Namespace of the messages that open and close a connection to a part of the device.
pub(crate) const CONNECTION: &str = "urn:x-cast:com.google.cast.tp.connection";

const HEARTBEAT: &str = "urn:x-cast:com.google.cast.tp.heartbeat";

/// Name of this sender.
pub(crate) const SENDER: &str = "sender-0";

/// Name of the device itself; apps that run on it have names of their own.
pub(crate) const PLATFORM: &str = "receiver-0";

/// Time limit for a connection, which is that of a device that wakes up on a busy Wi-Fi.
const CONNECTING: Duration = Duration::from_secs(5);

/// Silence after which the device is asked whether it is there. It is the interval at which devices
/// ask by themselves.
const PING_AFTER: Duration = Duration::from_secs(5);

/// Silence after which the device counts as gone: two heartbeats may be lost or late.
const SILENCE_MAX: Duration = Duration::from_secs(12);
const _: () = assert!(SILENCE_MAX.as_millis() > 2 * PING_AFTER.as_millis());

/// Number of bytes that one read receives at most.
const READ_BYTES: usize = 4 << 10;

/// The connection to a Chromecast.
#[derive(Debug)]
pub(crate) struct Channel {
    address: CastAddress,
    stream: Box<TlsStream<TcpStream>>,
    /// Bytes that have arrived and belong to no message yet.
    received: Vec<u8>,
    /// Bytes that wait to be sent.
    outgoing: Vec<u8>,
    /// Whether bytes are in the buffers of TLS.
    needs_flush: bool,
    /// Time of the last message.
    heard: Instant,
    /// Whether the device was asked since then whether it is there.
    is_pinged: bool,
}

impl Channel {
    /// Connects to a device.
    pub(crate) async fn connect(address: &CastAddress) -> Result<Channel, CastError> {
        let unreachable = |problem: String| {
            let address = address.to_string();
            CastError::Unreachable { address, problem }
        };
        let connecting = async {
            let settings = tls::settings().map_err(|error| error.to_string())?;
            let name = ServerName::try_from(address.host.clone());
            let name = name.map_err(|error| error.to_string())?;
            let target = (address.host.as_str(), address.port);
            let stream = TcpStream::connect(target).await.map_err(|error| error.to_string())?;
            let connector = TlsConnector::from(Arc::new(settings));
            let stream = connector.connect(name, stream).await;
            stream.map_err(|error| format!("there is no TLS: {error}"))
        };
        let stream = timeout(CONNECTING, connecting).await;
        let stream = stream.unwrap_or_else(|_| Err(format!("no answer within {CONNECTING:?}")));
        Ok(Channel {
            address: address.clone(),
            stream: Box::new(stream.map_err(unreachable)?),
            received: Vec::new(),
            outgoing: Vec::new(),
            needs_flush: false,
            heard: Instant::now(),
            is_pinged: false,
        })
    }

    /// Queues a message, which is sent while the next one is awaited.
    pub(crate) fn queue(&mut self, destination: &str, namespace: &str, payload: &Value) {
        let message = CastMessage {
            source: SENDER.to_owned(),
            destination: destination.to_owned(),
            namespace: namespace.to_owned(),
            text: payload.to_string(),
        };
        self.outgoing.extend(message.encode());
    }

    /// Returns the next message that is not part of the heartbeat.
    pub(crate) async fn next(&mut self) -> Result<CastMessage, CastError> {
        loop {
            while let Some(message) = self.take()? {
                self.heard = Instant::now();
                self.is_pinged = false;
                if message.namespace != HEARTBEAT {
                    return Ok(message);
                }
                let payload: Value = serde_json::from_str(&message.text).unwrap_or_default();
                if payload["type"] == "PING" {
                    self.queue(&message.source, HEARTBEAT, &json!({ "type": "PONG" }));
                }
            }
            let until = self.beat()?;
            // After this time the heartbeat is due.
            if let Ok(done) = timeout_at(until, self.transfer()).await {
                done?;
            }
        }
    }

    /// Sends what is queued. Waits for the network only, and not for an answer.
    pub(crate) async fn flush(&mut self) -> Result<(), CastError> {
        match timeout(PING_AFTER, self.send()).await {
            Ok(sent) => sent,
            Err(_) => Err(self.silent()),
        }
    }

    /// Asks after a silence whether the device is there. Returns the time of the next heartbeat.
    fn beat(&mut self) -> Result<Instant, CastError> {
        let now = Instant::now();
        if now >= self.heard + SILENCE_MAX {
            return Err(self.silent());
        }
        if now >= self.heard + PING_AFTER && !self.is_pinged {
            self.is_pinged = true;
            self.queue(PLATFORM, HEARTBEAT, &json!({ "type": "PING" }));
        }
        Ok(self.heard + if self.is_pinged { SILENCE_MAX } else { PING_AFTER })
    }

    /// Sends what is queued, and receives at least one byte.
    async fn transfer(&mut self) -> Result<(), CastError> {
        self.send().await?;
        self.received.reserve(READ_BYTES);
        match self.stream.read_buf(&mut self.received).await {
            Ok(0) => Err(self.closed()),
            Ok(_) => Ok(()),
            Err(error) => Err(self.unreachable(&error)),
        }
    }

    async fn send(&mut self) -> Result<(), CastError> {
        while !self.outgoing.is_empty() {
            self.needs_flush = true;
            match self.stream.write(&self.outgoing).await {
                Ok(0) => return Err(self.closed()),
                Ok(count) => drop(self.outgoing.drain(..count)),
                Err(error) => return Err(self.unreachable(&error)),
            }
        }
        if self.needs_flush {
            self.stream.flush().await.map_err(|error| self.unreachable(&error))?;
            self.needs_flush = false;
        }
        Ok(())
    }

    /// Removes the first message that has arrived whole from the received bytes.
    fn take(&mut self) -> Result<Option<CastMessage>, CastError> {
        let Some((length, rest)) = self.received.split_first_chunk::<LENGTH_BYTES>() else {
            return Ok(None);
        };
        let length = u32::from_be_bytes(*length) as usize;
        if length > MESSAGE_BYTES_MAX {
            let limit = MESSAGE_BYTES_MAX >> 10;
            return Err(self.malformed(format!("it is longer than {limit} KiB")));
        }
        let Some(body) = rest.get(..length) else { return Ok(None) };
        let message = CastMessage::decode(body).map_err(|problem| self.malformed(problem))?;
        self.received.drain(..LENGTH_BYTES + length);
        Ok(Some(message))
    }

    fn malformed(&self, problem: String) -> CastError {
        CastError::Malformed { address: self.address.to_string(), problem }
    }

    fn silent(&self) -> CastError {
        CastError::Silent { address: self.address.to_string(), silence: SILENCE_MAX }
    }

    fn unreachable(&self, error: &std::io::Error) -> CastError {
        // A device that is unplugged does not say so in the manner of TLS.
        if error.kind() == std::io::ErrorKind::UnexpectedEof {
            return self.closed();
        }
        CastError::Unreachable { address: self.address.to_string(), problem: error.to_string() }
    }

    pub(crate) fn closed(&self) -> CastError {
        CastError::Closed { address: self.address.to_string() }
    }
}
