//! The server: accepts a bounded number of connections, so that no client can exhaust the process.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use accounts::{Accounts, RequestLog};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{MissedTickBehavior, interval, sleep};

use crate::connection;
use crate::host::PageHost;
use crate::options::PageOptions;
use crate::routes;
use crate::server_state::ServerState;
use crate::tls::PageTls;
use crate::topic_task;

/// Wait after a failure to accept a connection, as when too many files are open.
const AFTER_FAILURE: Duration = Duration::from_secs(1);

/// Interval at which the file of people is looked at: a person that was removed sees nothing more
/// after this time, although nothing else asks for the file.
const PEOPLE_READ_EVERY: Duration = Duration::from_secs(2);

/// Bytes that the system keeps for a client that does not read: the rows of a page of a hundred
/// devices. By default it would keep megabytes.
const SEND_BUFFER_BYTES: u32 = 128 << 10;

/// Number of clients that wait until they are accepted.
const BACKLOG: u32 = 256;

/// A socket on which pages are served.
#[derive(Debug)]
pub struct PageServer {
    socket: TcpListener,
    tls: Option<PageTls>,
    options: PageOptions,
}

/// Reason why pages cannot be served. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[error("listen at {address}: {source}")]
pub struct PageListenError {
    address: SocketAddr,
    source: io::Error,
}

impl PageServer {
    /// Opens the socket. With `tls`, only encrypted requests are answered.
    ///
    /// # Errors
    ///
    /// Returns an error if the operating system refuses, as when another program listens there.
    pub async fn bind(
        address: SocketAddr,
        tls: Option<PageTls>,
        options: PageOptions,
    ) -> Result<PageServer, PageListenError> {
        let socket = open(address).map_err(|source| PageListenError { address, source })?;
        Ok(PageServer { socket, tls, options })
    }

    /// Returns the address of the socket, with the port that the operating system chose if none was
    /// given; `None` if the socket has failed.
    pub fn address(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }

    /// Serves the pages of `host` to the people of `accounts`; `log` keeps what they ask for. Never
    /// returns; dropping the future closes the socket and all connections.
    pub async fn serve(
        self,
        host: Arc<dyn PageHost>,
        accounts: Arc<Accounts>,
        log: Option<Arc<RequestLog>>,
    ) {
        let PageServer { socket, tls, options } = self;
        let limits = (options.connections, options.connections_per_address);
        let state = ServerState::new(host, Arc::clone(&accounts), log, options, tls.clone());
        let state = Arc::new(state);
        let mut tasks = JoinSet::new();
        tasks.spawn(topic_task::compute(Arc::clone(&state.host), Arc::clone(&state.topics)));
        tasks.spawn(reread_people(accounts));
        let router = routes::router(Arc::clone(&state));
        let mut clients = Clients::new(limits);
        loop {
            let (stream, from) = match socket.accept().await {
                Ok(accepted) => accepted,
                Err(error) => {
                    tracing::debug!(%error, "a browser could not connect");
                    sleep(AFTER_FAILURE).await;
                    continue;
                }
            };
            // Events are small, and each is to be seen at once.
            let _ = stream.set_nodelay(true);
            clients.admit(stream, from, tls.as_ref(), &router);
        }
    }
}

fn open(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
    socket.set_reuseaddr(true)?;
    // The sockets of accepted connections have what the listening one has.
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

async fn reread_people(accounts: Arc<Accounts>) {
    let mut looks = interval(PEOPLE_READ_EVERY);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        looks.tick().await;
        let accounts = Arc::clone(&accounts);
        // `accounts` logs a file with mistakes itself, once.
        let _ = tokio::task::spawn_blocking(move || accounts.refresh()).await;
    }
}

/// One connected client.
struct ConnectedClient {
    from: IpAddr,
    task: AbortHandle,
    /// Whether a request of a signed-in person has come over this connection.
    is_known: Arc<AtomicBool>,
}

/// The clients that are connected, oldest first.
struct Clients {
    connections: JoinSet<()>,
    clients: Vec<ConnectedClient>,
    max: usize,
    max_per_address: usize,
}

impl Clients {
    fn new((max, max_per_address): (usize, usize)) -> Clients {
        Clients { connections: JoinSet::new(), clients: Vec::new(), max, max_per_address }
    }

    /// Serves a client. If there are too many, of all or of one address, it takes the place of the
    /// oldest one without a signed-in person; if there is none, it is disconnected.
    fn admit(
        &mut self,
        stream: TcpStream,
        from: SocketAddr,
        tls: Option<&PageTls>,
        router: &axum::Router,
    ) {
        while self.connections.try_join_next().is_some() {}
        self.clients.retain(|client| !client.task.is_finished());
        let of_address = |client: &ConnectedClient| client.from == from.ip();
        // Nothing is served with a certificate that has ended.
        let Some(acceptor) = tls.map_or(Some(None), |tls| tls.acceptor().map(Some)) else { return };
        let has_room =
            if self.clients.iter().filter(|it| of_address(it)).count() >= self.max_per_address {
                self.end_oldest(of_address)
            } else {
                self.clients.len() < self.max || self.end_oldest(|_| true)
            };
        if !has_room {
            tracing::debug!(%from, "there are too many connections for one more");
            return;
        }
        let is_known = Arc::<AtomicBool>::default();
        let client = connection::PageClient { from: from.ip(), is_known: Arc::clone(&is_known) };
        let served = connection::serve(stream, acceptor, client, router.clone());
        let task = self.connections.spawn(served);
        self.clients.push(ConnectedClient { from: from.ip(), task, is_known });
    }

    /// Disconnects the oldest client that `may_end` allows and that has not signed in. Returns
    /// whether there was one.
    fn end_oldest(&mut self, may_end: impl Fn(&ConnectedClient) -> bool) -> bool {
        let is_unknown = |client: &ConnectedClient| !client.is_known.load(Ordering::Relaxed);
        let found = self.clients.iter().position(|client| is_unknown(client) && may_end(client));
        if let Some(found) = found {
            self.clients.remove(found).task.abort();
        }
        found.is_some()
    }
}
