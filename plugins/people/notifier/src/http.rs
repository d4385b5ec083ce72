//! One bounded HTTP request to a receiver, on a connection of its own: notices are seldom. A
//! redirection is not followed, because the new place is not that of the ecosystem file.

use std::time::Duration;

use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Bytes;
use hyper::client::conn::http1;
use hyper::{HeaderMap, Request};
use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

use crate::address::ReceiverAddress;
use crate::send_failure::SendFailure;
use crate::trust::ReceiverTrust;

/// Time limit of one request, with the connection.
const ANSWERED_WITHIN: Duration = Duration::from_secs(10);

/// Maximum length of an answer, in bytes. Receivers answer with a few words.
const ANSWER_BYTES_MAX: usize = 64 << 10;

/// Headers of a request, by name.
pub(crate) type RequestHeaders = Vec<(&'static str, String)>;

/// A `POST` to a receiver.
#[derive(Clone)]
pub(crate) struct PostRequest<'r> {
    pub(crate) address: &'r ReceiverAddress,
    pub(crate) trust: &'r ReceiverTrust,
    /// Headers besides those that every request has. Values may be secrets.
    pub(crate) headers: RequestHeaders,
    pub(crate) body: Vec<u8>,
}

/// The answer of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReceiverAnswer {
    pub(crate) status: u16,
    /// Pause that the receiver asks for (`Retry-After`, in seconds).
    pub(crate) pause: Option<Duration>,
}

/// Sends a request, and returns the answer, whatever its status.
pub(crate) async fn post(request: PostRequest<'_>) -> Result<ReceiverAnswer, SendFailure> {
    match tokio::time::timeout(ANSWERED_WITHIN, connect_and_send(request)).await {
        Ok(answered) => answered,
        Err(_) => Err(SendFailure::later(format!("get an answer within {ANSWERED_WITHIN:?}"))),
    }
}

async fn connect_and_send(request: PostRequest<'_>) -> Result<ReceiverAnswer, SendFailure> {
    let address = request.address;
    let away = |error: &dyn std::fmt::Display| {
        SendFailure::later(format!("reach {}: {error}", address.origin()))
    };
    let stream = TcpStream::connect((address.host.as_str(), address.port)).await;
    let stream = stream.map_err(|error| away(&error))?;
    if !address.is_encrypted {
        return send(request, stream).await;
    }
    let tls = TlsConnector::from(request.trust.client().await?);
    let name = ServerName::try_from(address.host.clone());
    let name = name.map_err(|error| SendFailure::Never(format!("name the receiver: {error}")))?;
    let stream = tls.connect(name, stream).await.map_err(|error| away(&error))?;
    send(request, stream).await
}

async fn send(
    request: PostRequest<'_>,
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
) -> Result<ReceiverAnswer, SendFailure> {
    let origin = request.address.origin();
    let lost = |error: hyper::Error| SendFailure::later(format!("speak to {origin}: {error}"));
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(lost)?;
    let mut built = Request::post(request.address.path.as_str())
        .header("Host", request.address.authority())
        .header("User-Agent", concat!("althing/", env!("CARGO_PKG_VERSION")))
        .header("Connection", "close");
    for (name, value) in request.headers {
        built = built.header(name, value);
    }
    let built = built.body(Full::new(Bytes::from(request.body)));
    // The error could quote a header, and with it a secret.
    let built = built.map_err(|_| SendFailure::Never("write the request".to_owned()))?;
    let answered = async {
        let (head, body) = sender.send_request(built).await.map_err(lost)?.into_parts();
        // The answer is read so that the receiver sees no broken connection; it is not used.
        let _ = Limited::new(body, ANSWER_BYTES_MAX).collect().await;
        Ok(ReceiverAnswer { status: head.status.as_u16(), pause: pause(&head.headers) })
    };
    let mut answered = std::pin::pin!(answered);
    // The connection does the work of the exchange; it may end before the answer is read.
    tokio::select! {
        answer = &mut answered => answer,
        _ = connection => answered.await,
    }
}

fn pause(headers: &HeaderMap) -> Option<Duration> {
    let seconds = headers.get("Retry-After")?.to_str().ok()?.trim().parse().ok()?;
    Some(Duration::from_secs(seconds))
}

// === impl ReceiverAnswer ===

impl ReceiverAnswer {
    /// Judges an answer as most receivers mean it.
    pub(crate) fn judge(self) -> Result<(), SendFailure> {
        match self.status {
            200..=299 => Ok(()),
            // A secret that was changed, a path that is not served yet: a person mends it.
            401 | 403 | 404 | 408 | 425 | 429 | 500..=599 => Err(SendFailure::Later {
                why: format!("be taken now: HTTP {}", self.status),
                pause: self.pause,
            }),
            status => Err(SendFailure::Never(format!("be taken: HTTP {status}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_judged() {
        let judge = |status| ReceiverAnswer { status, pause: None }.judge();
        assert_eq!(judge(204), Ok(()));
        for status in [401, 404, 429, 500, 503] {
            assert!(matches!(judge(status), Err(SendFailure::Later { .. })), "{status}");
        }
        for status in [301, 400, 410, 413] {
            assert!(matches!(judge(status), Err(SendFailure::Never(_))), "{status}");
        }
    }

    #[test]
    fn a_pause_is_a_number_of_seconds() {
        let mut headers = HeaderMap::new();
        assert_eq!(pause(&headers), None);
        headers.insert("Retry-After", "120".parse().expect("a value"));
        assert_eq!(pause(&headers), Some(Duration::from_secs(120)));
        headers.insert("Retry-After", "Wed, 21 Oct 2026 07:28:00 GMT".parse().expect("a value"));
        assert_eq!(pause(&headers), None);
    }
}
