//! The client of the building's socket: sends requests to a building in another process.
//!
//! One task per connection matches answers with requests. Every wait has a deadline. The end of the
//! server is noticed at once, and a frozen server after [`SILENCE_MAX`]. Dropping the future of a
//! request cancels the request at the server. The effects of the requests are defined by `server`
//! and the building.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::{Mutex, mpsc, oneshot};
use tokio::time::timeout;
use tracing::Instrument as _;

use crate::driver_requests::{DriverAnswer, DriverRequest};
use crate::error::DeviceError;
use crate::wire::{IN_FLIGHT_MAX, LineReader, SILENCE_MAX, ServerLine, WireRequest, write_line};

/// Time limit for connecting, and for requests that the building answers at once.
const ANSWER_MAX: Duration = SILENCE_MAX;

/// Time limit for a request that makes a device work: enough for a kilometer at walking pace. The
/// limit only prevents a hanging device from blocking a caller forever; actuators have shorter
/// timeouts of their own.
const WORK_MAX: Duration = Duration::from_secs(15 * 60);

/// Time limit for awaiting a change. The limit is a year, because a room may stay empty for months.
/// The server's `Alive` lines show that the server still runs.
const CHANGE_MAX: Duration = Duration::from_secs(365 * 24 * 3_600);

/// Capacity of a connection's queue of commands. Each request under way needs a place for the
/// request and one for its cancellation.
const COMMANDS_MAX: usize = 2 * IN_FLIGHT_MAX;

type RequestResult = Result<DriverAnswer, DeviceError>;

/// A client of a building in another process. The client opens a new connection after the old one
/// has broken.
#[derive(Clone, Debug)]
pub(crate) struct RemoteBuilding {
    shared: Arc<SharedClient>,
}

#[derive(Debug)]
struct SharedClient {
    path: PathBuf,
    id_next: AtomicU64,
    /// Sender of the current connection's queue of commands; the queue is closed once the
    /// connection has ended.
    commands: Mutex<Option<mpsc::Sender<ConnectionCommand>>>,
}

/// A command to a connection's task.
enum ConnectionCommand {
    Ask { request: WireRequest, reply: oneshot::Sender<RequestResult> },
    CallOff { id: u64 },
}

impl RemoteBuilding {
    /// Returns a client that connects when it is first used.
    pub(crate) fn at(path: &Path) -> RemoteBuilding {
        let (id_next, commands) = (AtomicU64::new(1), Mutex::new(None));
        RemoteBuilding {
            shared: Arc::new(SharedClient { path: path.to_owned(), id_next, commands }),
        }
    }

    /// Returns a client that is connected already.
    pub(crate) async fn connect(path: &Path) -> Result<RemoteBuilding, DeviceError> {
        let remote = RemoteBuilding::at(path);
        remote.commands().await.map(|_| remote)
    }

    /// Sends a request and waits for the answer. Dropping the future cancels the request.
    pub(crate) async fn ask(&self, ask: DriverRequest) -> RequestResult {
        let limit = match &ask {
            DriverRequest::PlaceOf { .. } | DriverRequest::Cancel => ANSWER_MAX,
            DriverRequest::AwaitChange { .. } => CHANGE_MAX,
            _ => WORK_MAX,
        };
        let answered = timeout(limit, self.ask_without_limit(ask)).await;
        answered.unwrap_or_else(|_| Err(unreachable(format!("no answer within {limit:?}"))))
    }

    async fn ask_without_limit(&self, ask: DriverRequest) -> RequestResult {
        let gone = |_| unreachable("the connection broke".to_owned());
        let commands = self.commands().await?;
        let id = self.shared.id_next.fetch_add(1, Ordering::Relaxed);
        // Room for the cancellation is reserved first, so that dropping the future never fails.
        let room = commands.clone().reserve_owned().await.map_err(|_| gone(()))?;
        let (reply, answer) = oneshot::channel();
        let command = ConnectionCommand::Ask { request: WireRequest { id, ask }, reply };
        commands.send(command).await.map_err(|_| gone(()))?;
        let mut call_off = CancelOnDrop { id, room: Some(room) };
        let outcome = answer.await.unwrap_or_else(|_| Err(gone(())));
        call_off.room = None;
        outcome
    }

    /// Returns the sender of the current connection's command queue. Opens a new connection if the
    /// last one has broken.
    async fn commands(&self) -> Result<mpsc::Sender<ConnectionCommand>, DeviceError> {
        let mut present = self.shared.commands.lock().await;
        if let Some(commands) = present.as_ref().filter(|commands| !commands.is_closed()) {
            return Ok(commands.clone());
        }
        let commands = open(&self.shared.path).await?;
        Ok(present.insert(commands).clone())
    }
}

/// Cancels the request with this id when it is dropped before the answer has arrived.
struct CancelOnDrop {
    id: u64,
    room: Option<mpsc::OwnedPermit<ConnectionCommand>>,
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        if let Some(room) = self.room.take() {
            room.send(ConnectionCommand::CallOff { id: self.id });
        }
    }
}

async fn open(path: &Path) -> Result<mpsc::Sender<ConnectionCommand>, DeviceError> {
    let connected = timeout(ANSWER_MAX, UnixStream::connect(path)).await;
    let stream =
        connected.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into())).map_err(|err| {
            unreachable(format!("no building is served at {}: {err}", path.display()))
        })?;
    let (reader, writer) = stream.into_split();
    let (commands, inbox) = mpsc::channel(COMMANDS_MAX);
    let connection =
        ClientConnection { lines: LineReader::new(reader), writer, inbox, open: BTreeMap::new() };
    let span = tracing::info_span!("building", socket = %path.display());
    tokio::spawn(connection.run().instrument(span));
    Ok(commands)
}

/// Task of one connection. When the task ends, its command queue closes and all open requests fail.
struct ClientConnection {
    lines: LineReader<OwnedReadHalf>,
    writer: OwnedWriteHalf,
    inbox: mpsc::Receiver<ConnectionCommand>,
    open: BTreeMap<u64, oneshot::Sender<RequestResult>>,
}

/// An event that wakes a connection's task.
enum ClientEvent {
    Command(ConnectionCommand),
    /// The last client of this connection was dropped.
    InboxClosed,
    Line(io::Result<Option<Vec<u8>>>),
    Silence,
}

impl ClientConnection {
    async fn run(mut self) {
        while let Ok(()) = self.step().await.inspect_err(|reason| {
            tracing::debug!(%reason, open_count = self.open.len(), "connection to the building ends");
        }) {}
    }

    /// Handles one event. Returns an error with the reason if the connection must end.
    async fn step(&mut self) -> Result<(), String> {
        match self.next_event().await {
            ClientEvent::Command(command) => {
                self.execute_command(command).await.map_err(|err| err.to_string())
            }
            ClientEvent::InboxClosed => Err("no client needs it any more".to_owned()),
            ClientEvent::Line(Ok(Some(line))) => self.handle_line(&line),
            ClientEvent::Line(Ok(None)) => Err("the building closed it".to_owned()),
            ClientEvent::Line(Err(err)) => Err(err.to_string()),
            ClientEvent::Silence => Err(format!("the building was silent for {SILENCE_MAX:?}")),
        }
    }

    async fn next_event(&mut self) -> ClientEvent {
        tokio::select! {
            line = timeout(SILENCE_MAX, self.lines.next()) => line.map_or(ClientEvent::Silence, ClientEvent::Line),
            command = self.inbox.recv() => command.map_or(ClientEvent::InboxClosed, ClientEvent::Command),
        }
    }

    async fn execute_command(&mut self, command: ConnectionCommand) -> io::Result<()> {
        match command {
            ConnectionCommand::Ask { request, reply } => {
                self.open.insert(request.id, reply);
                write_line(&mut self.writer, &request).await
            }
            ConnectionCommand::CallOff { id } => {
                self.open.remove(&id);
                write_line(&mut self.writer, &WireRequest { id, ask: DriverRequest::Cancel }).await
            }
        }
    }

    fn handle_line(&mut self, line: &[u8]) -> Result<(), String> {
        let line = serde_json::from_slice(line).map_err(|err| format!("not understood: {err}"))?;
        let (id, outcome) = match line {
            ServerLine::Alive => return Ok(()),
            ServerLine::Done { id, answer } => (id, Ok(answer)),
            ServerLine::Failed { id, error } => (id, Err(error)),
        };
        if let Some(reply) = self.open.remove(&id) {
            // The receiver is gone if the caller has dropped its future meanwhile; then the answer
            // is discarded.
            let _ = reply.send(outcome);
        }
        Ok(())
    }
}

fn unreachable(reason: String) -> DeviceError {
    DeviceError::Unreachable { reason }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use tokio::io::AsyncWriteExt as _;
    use tokio::net::UnixListener;

    use crate::BuildingHandle;
    use crate::wire::LineReader;

    /// Connects to a server that answers the first request with `answer` and then closes the
    /// connection, and compares the result of the driver's request with `expected`.
    async fn check(answer: &str, expected: &str) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("odd.sock");
        let listener = UnixListener::bind(&path).unwrap();
        let driver = BuildingHandle::connect(&path).await.unwrap();
        let answering = async {
            let (reader, mut writer) = listener.accept().await.unwrap().0.into_split();
            LineReader::new(reader).next().await.unwrap();
            writer.write_all(answer.as_bytes()).await.unwrap();
        };
        let (place, ()) = tokio::join!(driver.place_of("ir-1"), answering);
        let heard = place.unwrap_or_else(|error| format!("failed to {error}"));
        assert_eq!(heard, expected, "to {answer:?}");
    }

    #[tokio::test]
    async fn every_answer_of_a_server_gives_the_caller_a_result() {
        let broke = "failed to reach the building: the connection broke";
        check("{\"done\":{\"id\":1,\"answer\":{\"place\":\"hall\"}}}\n", "hall").await;
        check("\"alive\"\n{\"done\":{\"id\":9,\"answer\":\"arrived\"}}\n", broke).await;
        check("not JSON\n", broke).await;
        check("{\"done\":{\"id\":1,\"answer\":{\"pla", broke).await;
        check("", broke).await;
        check(
            "{\"done\":{\"id\":1,\"answer\":\"arrived\"}}\n",
            "failed to reach the building: its answer does not fit: Arrived",
        )
        .await;
        check(
            "{\"failed\":{\"id\":1,\"error\":{\"broken\":{\"device\":\"ir-1\"}}}}\n",
            "failed to use `ir-1`: it is broken",
        )
        .await;
    }

    #[tokio::test]
    async fn a_missing_server_is_reported() {
        let refused = BuildingHandle::connect(Path::new("/nonexistent/socket")).await.unwrap_err();
        let reason = refused.to_string();
        assert!(
            reason.starts_with("reach the building: no building is served at /nonexistent/socket"),
            "{reason}"
        );
    }
}
