//! One connection of a client: its requests, within bounds of time and length.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::{sleep, timeout};

use crate::responses::Responder;
use crate::tls::TlsServer;

/// How long a client may take for the headers of its next request. A client that asks again within
/// this time keeps its connection.
const HEADERS_WITHIN: Duration = Duration::from_secs(10);

/// How long a client may take for the handshake of TLS.
const HANDSHAKE_WITHIN: Duration = Duration::from_secs(5);

/// How long a connection may last. A client that asks again after that connects anew.
const LIFETIME_MAX: Duration = Duration::from_secs(300);

/// How long a client may take to read the answer that is being sent when its time is over.
const LAST_ANSWER_WITHIN: Duration = Duration::from_secs(5);

/// Maximum length of a request's head, in bytes: as short as the library of HTTP allows. The head of
/// Prometheus has three hundred bytes.
const HEAD_BYTES_MAX: usize = 8 << 10;

/// Maximum number of headers of a request.
const HEADERS_MAX: usize = 64;

/// Answers the requests of one client until the client leaves or its time is over.
pub(crate) async fn serve(stream: TcpStream, tls: Option<TlsServer>, responder: Arc<Responder>) {
    let Some(tls) = tls else { return serve_requests(stream, responder).await };
    match timeout(HANDSHAKE_WITHIN, tls.accept(stream)).await {
        Ok(Ok(stream)) => serve_requests(stream, responder).await,
        Ok(Err(error)) => tracing::debug!(%error, "a client of the metrics is not let in"),
        Err(_) => tracing::debug!("a client of the metrics was too slow to be let in"),
    }
}

async fn serve_requests(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send,
    responder: Arc<Responder>,
) {
    let service = service_fn(|request| {
        let response = responder.respond(&request);
        async { Ok::<_, Infallible>(response) }
    });
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(HEADERS_WITHIN)
        .max_buf_size(HEAD_BYTES_MAX)
        .max_headers(HEADERS_MAX);
    let connection = builder.serve_connection(TokioIo::new(stream), service);
    tokio::pin!(connection);
    let ended = tokio::select! {
        ended = &mut connection => ended,
        () = sleep(LIFETIME_MAX) => {
            connection.as_mut().graceful_shutdown();
            match timeout(LAST_ANSWER_WITHIN, connection).await {
                Ok(ended) => ended,
                Err(_) => return,
            }
        }
    };
    if let Err(error) = ended {
        tracing::debug!(%error, "a connection for metrics has ended");
    }
}
