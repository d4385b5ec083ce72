//! One bounded HTTP exchange with a camera.
//!
//! Each exchange has a connection of its own: many cameras close connections without notice, and a
//! camera receives only a few requests a minute.

use std::net::IpAddr;
use std::time::Duration;

use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::Bytes;
use hyper::client::conn::http1;
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

use crate::address::Address;
use crate::error::LinkError;

/// A request to a camera.
#[derive(Debug)]
pub(crate) struct HttpRequest<'r> {
    /// Operation, for errors.
    pub(crate) call: &'r str,
    pub(crate) method: &'static str,
    /// Type and content of the body; `None` for a request without a body.
    pub(crate) body: Option<(String, String)>,
    pub(crate) authorization: Option<String>,
    /// Maximum length of the answer, in bytes; a longer answer is an error.
    pub(crate) bytes_max: usize,
    /// Time limit of the whole exchange.
    pub(crate) time_max: Duration,
}

/// The answer of a camera.
#[derive(Debug)]
pub(crate) struct HttpAnswer {
    pub(crate) status: u16,
    pub(crate) content_type: String,
    /// Values of the headers `WWW-Authenticate`.
    pub(crate) challenges: Vec<String>,
    pub(crate) body: Bytes,
    /// IP address of the camera.
    pub(crate) peer: Option<IpAddr>,
}

/// Sends a request, and returns the answer. `tls` is needed for an encrypted address.
pub(crate) async fn exchange(
    address: &Address,
    tls: Option<&TlsConnector>,
    request: &HttpRequest<'_>,
) -> Result<HttpAnswer, LinkError> {
    let limit = request.time_max;
    let answered = tokio::time::timeout(limit, connect_and_send(address, tls, request)).await;
    answered.unwrap_or_else(|_| {
        let (address, call) = (address.to_string(), request.call.to_owned());
        Err(LinkError::TimedOut { address, call, limit })
    })
}

async fn connect_and_send(
    address: &Address,
    tls: Option<&TlsConnector>,
    request: &HttpRequest<'_>,
) -> Result<HttpAnswer, LinkError> {
    let lost = |problem: String| LinkError::Unreachable { address: address.to_string(), problem };
    let stream = TcpStream::connect((address.host.as_str(), address.port)).await;
    let stream = stream.map_err(|error| lost(error.to_string()))?;
    // Without effect, requests would be slower; nothing else depends on it.
    let _ = stream.set_nodelay(true);
    let peer = stream.peer_addr().ok().map(|peer| peer.ip());
    let answer = if address.is_encrypted {
        let Some(tls) = tls else { return Err(lost("TLS is not set up".to_owned())) };
        let name = ServerName::try_from(address.host.clone());
        let name = name.map_err(|_| lost("its name cannot be in a certificate".to_owned()))?;
        let stream = tls.connect(name, stream).await.map_err(|error| {
            lost(format!("TLS: {error} (`ca` or `fingerprint` names the certificate to trust)"))
        })?;
        send(address, stream, request).await
    } else {
        send(address, stream, request).await
    };
    answer.map(|answer| HttpAnswer { peer, ..answer })
}

async fn send(
    address: &Address,
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    request: &HttpRequest<'_>,
) -> Result<HttpAnswer, LinkError> {
    let lost = |problem: String| LinkError::Unreachable { address: address.to_string(), problem };
    let mut protocol = http1::Builder::new();
    protocol
        .title_case_headers(true)
        .allow_spaces_after_header_name_in_responses(true)
        .allow_obsolete_multiline_headers_in_responses(true)
        .ignore_invalid_headers_in_responses(true);
    let opened = protocol.handshake(TokioIo::new(stream)).await;
    let (mut sender, connection) = opened.map_err(|error| lost(error.to_string()))?;
    let built = build(address, request).map_err(&lost)?;
    let answered = async {
        let answer = sender.send_request(built).await.map_err(|error| lost(cause(&error)))?;
        read(answer, address, request).await
    };
    let mut answered = std::pin::pin!(answered);
    // The connection does the work of the exchange; it may end before the answer is read.
    tokio::select! {
        answer = &mut answered => answer,
        _ = connection => answered.await,
    }
}

fn build(address: &Address, request: &HttpRequest<'_>) -> Result<Request<Full<Bytes>>, String> {
    let mut built = Request::builder()
        .method(request.method)
        .uri(address.path.as_str())
        .header("Host", address.authority())
        .header("User-Agent", "althing")
        .header("Accept", "*/*")
        .header("Connection", "close");
    if let Some(authorization) = &request.authorization {
        built = built.header("Authorization", authorization);
    }
    let mut content = Bytes::new();
    if let Some((content_type, body)) = &request.body {
        built = built.header("Content-Type", content_type);
        content = Bytes::copy_from_slice(body.as_bytes());
    }
    built.body(Full::new(content)).map_err(|error| error.to_string())
}

async fn read(
    answer: Response<hyper::body::Incoming>,
    address: &Address,
    request: &HttpRequest<'_>,
) -> Result<HttpAnswer, LinkError> {
    let (head, body) = answer.into_parts();
    let text =
        |value: &hyper::header::HeaderValue| String::from_utf8_lossy(value.as_bytes()).into_owned();
    let challenges = head.headers.get_all("WWW-Authenticate").iter().map(text).collect();
    let content_type = head.headers.get("Content-Type").map(text).unwrap_or_default();
    let body = Limited::new(body, request.bytes_max).collect().await.map_err(|error| {
        if error.downcast_ref::<http_body_util::LengthLimitError>().is_some() {
            let problem = format!("it is longer than {} bytes", request.bytes_max);
            return LinkError::Unreadable { call: request.call.to_owned(), problem };
        }
        LinkError::Unreachable { address: address.to_string(), problem: error.to_string() }
    })?;
    let (status, body) = (head.status.as_u16(), body.to_bytes());
    Ok(HttpAnswer { status, content_type, challenges, body, peer: None })
}

/// Returns the text of an error with its cause, which the library leaves out.
fn cause(error: &hyper::Error) -> String {
    match std::error::Error::source(error) {
        Some(source) => format!("{error}: {source}"),
        None => error.to_string(),
    }
}
