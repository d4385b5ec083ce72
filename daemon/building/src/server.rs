//! The near end of the socket: lets drivers in other processes use the devices.
//!
//! One task accepts, one per client answers. A client that dies takes its
//! operations with it; a client that talks nonsense is told so; none can make
//! the server wait, grow or panic. Fate's operations are not offered.

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{UnixListener, UnixStream};
use tokio::task::{AbortHandle, JoinError, JoinSet};
use tokio::time::{Interval, MissedTickBehavior, interval};
use tracing::Instrument as _;

use crate::error::{DeviceError, ServeError};
use crate::handle::BuildingHandle;
use crate::wire::{ALIVE_PERIOD, Answer, Ask, IN_FLIGHT_MAX, Line, Lines, Request, write_line};

/// How many clients may be connected. A client is a daemon, one per machine; a
/// building simulated on one machine has a handful.
const CLIENTS_MAX: usize = 64;

/// Rest after a failed `accept`: the process is out of file descriptors, and
/// trying again at once would only burn the processor.
const ACCEPT_REST: Duration = Duration::from_millis(100);

/// A building that is being served. Dropping it ends all connections, calls off
/// what is under way, and removes the socket.
#[derive(Debug)]
pub struct Server {
    accepting: AbortHandle,
    path: PathBuf,
    /// Which file is ours, so that a successor's socket is not removed.
    inode: (u64, u64),
}

/// Serves the devices of a building at a Unix socket that only this user can use.
///
/// A socket that a dead server left behind is replaced; a living one is not.
pub async fn serve(
    building: BuildingHandle,
    socket_path: impl AsRef<Path>,
) -> Result<Server, ServeError> {
    let path = socket_path.as_ref().to_owned();
    refuse_occupied(&path).await?;
    let failed = |source| ServeError::Io { path: path.clone(), source };
    let listener = bind_private(&path).map_err(failed)?;
    let metadata = fs::symlink_metadata(&path).map_err(failed)?;
    let span = tracing::info_span!("building", socket = %path.display());
    let accepting = tokio::spawn(accept(building, listener).instrument(span)).abort_handle();
    Ok(Server { accepting, path, inode: (metadata.dev(), metadata.ino()) })
}

impl Drop for Server {
    fn drop(&mut self) {
        self.accepting.abort();
        let inode = fs::symlink_metadata(&self.path).map(|file| (file.dev(), file.ino()));
        if inode.is_ok_and(|inode| inode == self.inode) {
            // A socket that stays behind does no harm: the next server replaces it.
            let _ = fs::remove_file(&self.path);
        }
    }
}

async fn refuse_occupied(path: &Path) -> Result<(), ServeError> {
    let Ok(metadata) = fs::symlink_metadata(path) else { return Ok(()) };
    if !metadata.file_type().is_socket() {
        return Err(ServeError::NotASocket { path: path.to_owned() });
    }
    match UnixStream::connect(path).await {
        Ok(_) => Err(ServeError::InUse { path: path.to_owned() }),
        Err(_) => Ok(()),
    }
}

/// Binds in a folder that only this user can enter, and moves the socket to its
/// place when its mode is set: there is no moment when others could connect.
fn bind_private(path: &Path) -> io::Result<UnixListener> {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    // The name is short, because the path of a socket may have 107 bytes only.
    let nest = parent.unwrap_or(Path::new(".")).join(format!(".b{}", std::process::id()));
    fs::create_dir(&nest)?;
    let bound = fs::set_permissions(&nest, Permissions::from_mode(0o700)).and_then(|()| {
        let listener = UnixListener::bind(nest.join("s"))?;
        fs::set_permissions(nest.join("s"), Permissions::from_mode(0o600))?;
        fs::rename(nest.join("s"), path)?;
        Ok(listener)
    });
    let swept = fs::remove_dir_all(&nest);
    bound.and_then(|listener| swept.map(|()| listener))
}

async fn accept(building: BuildingHandle, listener: UnixListener) {
    let mut clients = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) if clients.len() < CLIENTS_MAX => {
                    clients.spawn(Client::new(building.clone(), stream).run().in_current_span());
                }
                Ok(_) => tracing::warn!(CLIENTS_MAX, "too many clients; one is turned away"),
                Err(err) => {
                    tracing::warn!(%err, "failed to accept a client");
                    tokio::time::sleep(ACCEPT_REST).await;
                }
            },
            Some(_) = clients.join_next() => (),
        }
    }
}

/// One client's task, and the operations that run for it.
struct Client {
    building: BuildingHandle,
    lines: Lines<OwnedReadHalf>,
    writer: OwnedWriteHalf,
    operations: JoinSet<Line>,
    running: BTreeMap<u64, AbortHandle>,
    alive: Interval,
}

/// Everything that can wake a client's task.
enum Event {
    Line(io::Result<Option<Vec<u8>>>),
    Finished(Result<Line, JoinError>),
    AliveDue,
}

impl Client {
    fn new(building: BuildingHandle, stream: UnixStream) -> Client {
        let (reader, writer) = stream.into_split();
        let mut alive = interval(ALIVE_PERIOD);
        alive.set_missed_tick_behavior(MissedTickBehavior::Delay);
        Client {
            building,
            lines: Lines::new(reader),
            writer,
            operations: JoinSet::new(),
            running: BTreeMap::new(),
            alive,
        }
    }

    async fn run(mut self) {
        loop {
            let event = self.next_event().await;
            match self.handle(event).await {
                Ok(true) => (),
                Ok(false) => return,
                Err(err) => {
                    tracing::debug!(%err, "a client's connection ends");
                    return;
                }
            }
        }
    }

    async fn next_event(&mut self) -> Event {
        tokio::select! {
            line = self.lines.next() => Event::Line(line),
            Some(finished) = self.operations.join_next() => Event::Finished(finished),
            _ = self.alive.tick() => Event::AliveDue,
        }
    }

    /// Returns whether the connection goes on.
    async fn handle(&mut self, event: Event) -> io::Result<bool> {
        match event {
            Event::Line(line) => match line? {
                Some(line) => self.hear(&line).await?,
                None => return Ok(false),
            },
            Event::Finished(Ok(line)) => self.tell(line).await?,
            // Called off: nobody waits for the answer.
            Event::Finished(Err(_)) => (),
            Event::AliveDue => write_line(&mut self.writer, &Line::Alive).await?,
        }
        Ok(true)
    }

    async fn hear(&mut self, line: &[u8]) -> io::Result<()> {
        match serde_json::from_slice(line) {
            Ok(Request { id, ask: Ask::Cancel }) => {
                if let Some(operation) = self.running.remove(&id) {
                    operation.abort();
                }
                Ok(())
            }
            Ok(Request { id, ask }) => match self.start(id, ask) {
                Ok(()) => Ok(()),
                Err(reason) => self.refuse(id, reason).await,
            },
            Err(err) => self.refuse(id_of(line), format!("not understood: {err}")).await,
        }
    }

    fn start(&mut self, id: u64, ask: Ask) -> Result<(), String> {
        if self.running.contains_key(&id) {
            return Err(format!("request {id} is under way; choose another id"));
        }
        if self.running.len() >= IN_FLIGHT_MAX {
            return Err(format!("{IN_FLIGHT_MAX} requests are under way; wait for one"));
        }
        let building = self.building.clone();
        let operation = async move {
            match perform(&building, ask).await {
                Ok(answer) => Line::Done { id, answer },
                Err(error) => Line::Failed { id, error },
            }
        };
        self.running.insert(id, self.operations.spawn(operation.in_current_span()));
        Ok(())
    }

    async fn tell(&mut self, line: Line) -> io::Result<()> {
        if let Line::Done { id, .. } | Line::Failed { id, .. } = &line
            && self.running.remove(id).is_none()
        {
            // Finished in the instant in which it was called off.
            return Ok(());
        }
        write_line(&mut self.writer, &line).await
    }

    async fn refuse(&mut self, id: u64, reason: String) -> io::Result<()> {
        let error = DeviceError::Refused { reason };
        write_line(&mut self.writer, &Line::Failed { id, error }).await
    }
}

async fn perform(building: &BuildingHandle, ask: Ask) -> Result<Answer, DeviceError> {
    match ask {
        Ask::ReadTemperature { sensor } => {
            building.read_temperature(&sensor).await.map(Answer::Reading)
        }
        Ask::Navigate { robot, to } => {
            building.navigate(&robot, &to).await.map(|()| Answer::Arrived)
        }
        Ask::PlaceOf { device } => building.place_of(&device).await.map(Answer::Place),
        Ask::Cancel => Err(DeviceError::Refused { reason: "nothing to cancel".to_owned() }),
    }
}

/// The id of a request that is otherwise not understood; 0 where it has none.
fn id_of(line: &[u8]) -> u64 {
    #[derive(serde::Deserialize)]
    struct Numbered {
        id: u64,
    }
    serde_json::from_slice(line).map_or(0, |Numbered { id }| id)
}
