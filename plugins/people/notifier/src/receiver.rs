//! A receiver for tests: an HTTP server on loopback, with or without TLS, which answers as the test
//! says and passes on what it was sent.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use http_body_util::{BodyExt as _, Full};
use hyper::body::{Bytes, Incoming};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{HeaderMap, Request, Response};
use hyper_util::rt::TokioIo;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;

/// Time limit of every step of a test.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

/// A request that has arrived.
#[derive(Debug)]
pub(crate) struct ReceivedRequest {
    pub(crate) path: String,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

/// The receiver. It ends with this value.
pub(crate) struct TestReceiver {
    pub(crate) port: u16,
    requests: mpsc::UnboundedReceiver<ReceivedRequest>,
    task: tokio::task::JoinHandle<()>,
}

impl Drop for TestReceiver {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl TestReceiver {
    /// Starts a receiver whose answers have these codes, and 200 after them. An answer that is no
    /// success asks for a pause of seven seconds.
    pub(crate) async fn start(codes: &[u16], tls: Option<TlsAcceptor>) -> TestReceiver {
        TestReceiver::start_at(0, codes, tls).await
    }

    /// Starts a receiver at a port; 0 stands for one of the kernel's choice.
    pub(crate) async fn start_at(
        port: u16,
        codes: &[u16],
        tls: Option<TlsAcceptor>,
    ) -> TestReceiver {
        let listener = TcpListener::bind(("127.0.0.1", port)).await.expect("a port");
        let port = listener.local_addr().expect("an address").port();
        let (tell, requests) = mpsc::unbounded_channel();
        let codes = Arc::new(Mutex::new(codes.iter().copied().collect::<VecDeque<_>>()));
        let task = tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let (tell, codes, tls) = (tell.clone(), Arc::clone(&codes), tls.clone());
                tokio::spawn(async move {
                    let service = service_fn(move |request| {
                        answer(request, tell.clone(), Arc::clone(&codes))
                    });
                    let server = http1::Builder::new();
                    // A client that breaks off is none of the receiver's business.
                    let _ = match tls {
                        None => server.serve_connection(TokioIo::new(stream), service).await,
                        Some(tls) => match tls.accept(stream).await {
                            Ok(stream) => {
                                server.serve_connection(TokioIo::new(stream), service).await
                            }
                            Err(_) => Ok(()),
                        },
                    };
                });
            }
        });
        TestReceiver { port, requests, task }
    }

    /// Waits for the next request.
    pub(crate) async fn next(&mut self) -> ReceivedRequest {
        let next = tokio::time::timeout(PATIENCE, self.requests.recv()).await;
        next.expect("a request in time").expect("the receiver runs")
    }

    /// Returns the next request, if one has arrived.
    pub(crate) fn arrived(&mut self) -> Option<ReceivedRequest> {
        self.requests.try_recv().ok()
    }
}

async fn answer(
    request: Request<Incoming>,
    tell: mpsc::UnboundedSender<ReceivedRequest>,
    codes: Arc<Mutex<VecDeque<u16>>>,
) -> Result<Response<Full<Bytes>>, Infallible> {
    let (head, body) = request.into_parts();
    let body = body.collect().await.map(|body| body.to_bytes()).unwrap_or_default();
    let path = head.uri.to_string();
    let _ = tell.send(ReceivedRequest { path, headers: head.headers, body });
    let code = codes.lock().expect("no panic").pop_front().unwrap_or(200);
    let mut built = Response::builder().status(code);
    if code >= 400 {
        built = built.header("Retry-After", "7");
    }
    Ok(built.body(Full::new(Bytes::from_static(b"{}"))).expect("an answer"))
}
