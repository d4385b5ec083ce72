//! One connection of a browser: its requests, within bounds of time and length.

use std::net::IpAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use axum::body::Body;
use axum::extract::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tower_service::Service as _;

use crate::deadline_stream::DeadlineStream;

/// How long a client may take for the headers of its next request: browsers keep a connection that
/// they may need again, and open another one if it has ended.
const HEADERS_WITHIN: Duration = Duration::from_secs(20);

/// How long a client may take for the handshake of TLS.
const HANDSHAKE_WITHIN: Duration = Duration::from_secs(10);

/// Maximum length of a request's head, in bytes, and of what waits to be sent beside the event that
/// is being written.
const HEAD_BYTES_MAX: usize = 16 << 10;

/// Maximum number of headers of a request. Browsers send twenty.
const HEADERS_MAX: usize = 64;

/// The client of a connection.
#[derive(Clone, Debug)]
pub(crate) struct PageClient {
    /// The address of the client.
    pub(crate) from: IpAddr,
    /// Set when a request of a signed-in person comes over the connection, which then keeps its
    /// place.
    pub(crate) is_known: Arc<AtomicBool>,
}

/// Answers the requests of one client until the client leaves, or is too slow.
pub(crate) async fn serve(
    stream: TcpStream,
    tls: Option<TlsAcceptor>,
    client: PageClient,
    router: axum::Router,
) {
    let Some(tls) = tls else {
        return serve_requests(DeadlineStream::new(stream), client, router).await;
    };
    match timeout(HANDSHAKE_WITHIN, tls.accept(stream)).await {
        Ok(Ok(stream)) => serve_requests(DeadlineStream::new(stream), client, router).await,
        Ok(Err(error)) => tracing::debug!(%error, "a browser and the page do not agree on TLS"),
        Err(_) => tracing::debug!("a browser was too slow to agree on TLS"),
    }
}

async fn serve_requests(
    stream: impl AsyncRead + AsyncWrite + Unpin + Send,
    client: PageClient,
    router: axum::Router,
) {
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let mut request: Request = request.map(Body::new);
        request.extensions_mut().insert(client.clone());
        router.clone().call(request)
    });
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(HEADERS_WITHIN)
        .max_buf_size(HEAD_BYTES_MAX)
        .max_headers(HEADERS_MAX);
    if let Err(error) = builder.serve_connection(TokioIo::new(stream), service).await {
        tracing::debug!(%error, "a connection of a page has ended");
    }
}
