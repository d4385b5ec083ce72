//! The listener: accepts a bounded number of connections, so that no client can exhaust the process.

use std::collections::VecDeque;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::sleep;

use crate::connection;
use crate::responses::{MetricsSource, Responder};
use crate::tls::TlsServer;

/// Maximum number of connections at a time: more than the programs that scrape one machine. Another
/// client takes the place of the one that has been connected longest.
const CONNECTIONS_MAX: usize = 32;

/// Wait after a failure to accept a connection, as when too many files are open.
const AFTER_FAILURE: Duration = Duration::from_secs(1);

/// A socket on which metrics are served.
#[derive(Debug)]
pub struct MetricsListener {
    socket: TcpListener,
    tls: Option<TlsServer>,
}

/// Reason why metrics cannot be served. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[error("listen at {address}: {source}")]
pub struct ListenError {
    address: SocketAddr,
    source: io::Error,
}

impl MetricsListener {
    /// Opens the socket. With `tls`, only clients with a certificate of its authority are answered.
    ///
    /// # Errors
    ///
    /// Returns an error if the operating system refuses, as when another program listens there.
    pub async fn bind(
        address: SocketAddr,
        tls: Option<TlsServer>,
    ) -> Result<MetricsListener, ListenError> {
        let socket = TcpListener::bind(address).await;
        let socket = socket.map_err(|source| ListenError { address, source })?;
        Ok(MetricsListener { socket, tls })
    }

    /// Returns the address of the socket, with the port that the operating system chose if none was
    /// given; `None` if the socket has failed.
    pub fn address(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }

    /// Serves the metrics and the health of `source`. Never returns; dropping the future closes the
    /// socket and all connections.
    pub async fn serve(self, source: Arc<dyn MetricsSource>) {
        let responder = Arc::new(Responder::new(source, self.tls.is_some()));
        let mut connections = JoinSet::new();
        let mut oldest_first: VecDeque<AbortHandle> = VecDeque::new();
        loop {
            let stream = match self.socket.accept().await {
                Ok((stream, _)) => stream,
                Err(error) => {
                    tracing::debug!(%error, "a client of the metrics could not connect");
                    sleep(AFTER_FAILURE).await;
                    continue;
                }
            };
            while connections.try_join_next().is_some() {}
            oldest_first.retain(|connection| !connection.is_finished());
            while connections.len() >= CONNECTIONS_MAX {
                if let Some(oldest) = oldest_first.pop_front() {
                    oldest.abort();
                }
                // Its socket is closed before the next connection is served.
                connections.join_next().await;
            }
            let (tls, responder) = (self.tls.clone(), Arc::clone(&responder));
            oldest_first.push_back(connections.spawn(connection::serve(stream, tls, responder)));
        }
    }
}
