//! One bounded HTTP request to the collector, on a connection of its own: batches are seconds apart.

use std::sync::Arc;
use std::time::Duration;

use http_body_util::{BodyExt as _, Full, Limited};
use hyper::Request;
use hyper::body::Bytes;
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;

use crate::config::Collector;

/// How long one request may take.
const ANSWERED_WITHIN: Duration = Duration::from_secs(10);

/// Maximum length of an answer, in bytes. The answer to a batch is a few words.
const ANSWER_BYTES_MAX: usize = 64 << 10;

/// Maximum number of characters of an answer in a message of the log.
const ANSWER_CHARS_SHOWN: usize = 200;

/// Greatest pause that a collector may ask for.
const PAUSE_MAX: Duration = Duration::from_secs(300);

/// Why a batch was not taken. The texts complete “failed to …”.
#[derive(Debug)]
pub(crate) enum PostError {
    /// The batch may be taken later: the collector is away or busy. It may ask for a pause.
    Later { why: String, pause: Option<Duration> },
    /// The batch will never be taken.
    Never(String),
}

/// Sends a batch to the collector. Returns a warning of the collector, if its answer has one.
pub(crate) async fn post(collector: &Collector, body: Bytes) -> Result<Option<String>, PostError> {
    match tokio::time::timeout(ANSWERED_WITHIN, connect_and_send(collector, body)).await {
        Ok(answered) => answered,
        Err(_) => Err(later(format!("get an answer within {ANSWERED_WITHIN:?}"))),
    }
}

fn later(why: String) -> PostError {
    PostError::Later { why, pause: None }
}

async fn connect_and_send(collector: &Collector, body: Bytes) -> Result<Option<String>, PostError> {
    let away = |error: &dyn std::fmt::Display| later(format!("reach the collector: {error}"));
    let stream = TcpStream::connect((collector.host.as_str(), collector.port)).await;
    let stream = stream.map_err(|error| away(&error))?;
    let Some(ca) = &collector.ca else { return send(collector, stream, body).await };
    let file = ca.clone();
    let pem = tokio::task::spawn_blocking(move || std::fs::read(file)).await;
    let pem = pem.map_err(std::io::Error::other).flatten();
    let pem = pem.map_err(|error| later(format!("read {}: {error}", ca.display())))?;
    let tls = tls(&pem).map_err(|why| later(format!("use {}: {why}", ca.display())))?;
    let name = ServerName::try_from(collector.host.clone());
    let name = name.map_err(|error| PostError::Never(format!("name the collector: {error}")))?;
    let stream = tls.connect(name, stream).await.map_err(|error| away(&error))?;
    send(collector, stream, body).await
}

/// Returns the TLS settings that trust the authorities in a text of PEM.
fn tls(pem: &[u8]) -> Result<TlsConnector, String> {
    let found = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>();
    let mut roots = RootCertStore::empty();
    let (added, _) = roots.add_parsable_certificates(found.map_err(|error| error.to_string())?);
    if added == 0 {
        return Err("there is no certificate of an authority in it".to_owned());
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(TlsConnector::from(Arc::new(config)))
}

async fn send(
    collector: &Collector,
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    body: Bytes,
) -> Result<Option<String>, PostError> {
    let lost = |error: hyper::Error| later(format!("speak to the collector: {error}"));
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(lost)?;
    let request = Request::post(collector.path.as_str())
        .header("Host", collector.authority())
        .header("User-Agent", concat!("althing/", env!("CARGO_PKG_VERSION")))
        .header("Content-Type", "application/json")
        .header("Connection", "close")
        .body(Full::new(body))
        .map_err(|error| PostError::Never(format!("write the request: {error}")))?;
    let answered = async {
        let answer = sender.send_request(request).await.map_err(lost)?;
        let (head, body) = answer.into_parts();
        let pause = head.headers.get("Retry-After").and_then(|value| value.to_str().ok());
        let pause = pause.and_then(|text| text.parse().ok()).map(Duration::from_secs);
        let body = Limited::new(body, ANSWER_BYTES_MAX).collect().await;
        let body = body.map(|body| body.to_bytes()).unwrap_or_default();
        judge(head.status.as_u16(), pause, &body)
    };
    let mut answered = std::pin::pin!(answered);
    // The connection does the work of the exchange; it may end before the answer is read.
    tokio::select! {
        answer = &mut answered => answer,
        _ = connection => answered.await,
    }
}

/// Judges an answer as OTLP defines it: four codes may be tried again, and a batch may be taken in
/// part.
fn judge(status: u16, pause: Option<Duration>, body: &[u8]) -> Result<Option<String>, PostError> {
    let text = || {
        let text = String::from_utf8_lossy(body);
        text.chars().take(ANSWER_CHARS_SHOWN).collect::<String>()
    };
    match status {
        200..=299 => {
            let answer: serde_json::Value = serde_json::from_slice(body).unwrap_or_default();
            let partial = &answer["partialSuccess"];
            let rejected = &partial["rejectedSpans"];
            let number = rejected.as_u64().or_else(|| rejected.as_str()?.parse().ok());
            let is_rejected = number.is_some_and(|number| number > 0);
            let message = partial["errorMessage"].as_str().filter(|message| !message.is_empty());
            Ok((is_rejected || message.is_some()).then(text))
        }
        429 | 502 | 503 | 504 => {
            let pause = pause.map(|pause| pause.min(PAUSE_MAX));
            Err(PostError::Later { why: format!("be taken now: HTTP {status}"), pause })
        }
        _ => Err(PostError::Never(format!("be taken: HTTP {status}: {}", text()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_judged_as_otlp_defines_them() {
        assert!(matches!(judge(200, None, br#"{"partialSuccess":null}"#), Ok(None)));
        assert!(matches!(judge(200, None, b"\xff"), Ok(None)));
        let part = br#"{"partialSuccess":{"rejectedSpans":"3","errorMessage":"full"}}"#;
        assert!(matches!(judge(200, None, part), Ok(Some(said)) if said.contains("full")));
        let pause = Some(Duration::from_secs(9_999));
        assert!(matches!(
            judge(503, pause, b""),
            Err(PostError::Later { pause: Some(PAUSE_MAX), .. })
        ));
        assert!(
            matches!(judge(400, None, b"bad"), Err(PostError::Never(why)) if why.contains("bad"))
        );
    }

    #[test]
    fn a_file_without_certificates_is_no_authority() {
        assert!(tls(b"nothing").is_err());
    }
}
