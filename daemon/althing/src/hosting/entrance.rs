//! Who calls whom among the daemons of one machine: who comes later calls those who are here.
//!
//! Two daemons must never call each other at once: Zenoh may answer that by closing both links.
//! So daemons come in one at a time, through a door, and nobody calls those who come after it. A
//! newcomer is linked as soon as it listens, whatever its name is, and also to daemons whose
//! ecosystem file does not name it.
//!
//! Whom it has lost, Zenoh calls again for ever. A daemon that comes back calls by itself, so those
//! calls must not reach it: every life of a daemon is called by a path of its own, a link to the
//! daemon's socket, which the next life takes away before it listens.
//!
//! The folder where they meet holds for each daemon, beside its socket,
//!
//! - `NAME.here`, locked for as long as it lives; in it its life, and nothing once it has left;
//! - `NAME.LIFE`, by which others call it.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _};
use std::os::unix::fs::{FileExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use substrate_zenoh::REST;

use super::folders::{FolderError, socket_in};

/// The lock through which daemons come in.
const DOOR: &str = "entrance.lock";

/// How long the door is waited for. Who is in it reads a few small files; longer than that stays
/// only a process that was stopped there.
const DOOR_WITHIN: Duration = Duration::from_secs(2);
const DOOR_PERIOD: Duration = Duration::from_millis(2);
const _: () = assert!(DOOR_PERIOD.as_millis() < DOOR_WITHIN.as_millis());

/// How often a newcomer waits because another has left while it did. A service that ends as soon as
/// it has begun, and is started again and again, must not keep all others out.
const RESTS_MAX: usize = 8;

/// The ending of the file that says that a daemon is here.
const TICKET: &str = "here";

/// A life is the time of its beginning in microseconds, as far as ten hexadecimal digits hold it
/// (twelve days): its path must find room where that of the socket does.
const LIFE_DIGITS: usize = 10;

/// Why a daemon cannot come in. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum EnterError {
    /// Its socket has no place.
    #[error("{0}")]
    Folder(#[from] FolderError),
    /// A file cannot be used.
    #[error("use {}: {source}", path.display())]
    Io {
        /// The file, or the folder.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// Another process is this daemon.
    #[error("be `{daemon}`: a daemon of this name is running here already")]
    Taken {
        /// The name.
        daemon: DaemonId,
    },
}

/// A daemon's life among the others; when this is dropped, they may know when it ended.
#[derive(Debug)]
pub(crate) struct Stay {
    /// Locked, until the kernel closes it.
    ticket: File,
    /// By which path those are to call it who come later.
    life: PathBuf,
    /// By which paths it is to call those who came before.
    pub(crate) others: Vec<PathBuf>,
}

/// What a ticket says.
struct Ticket {
    daemon: String,
    /// Whether it is locked.
    is_here: bool,
    /// Empty when it has left and said so.
    life: String,
    /// Since when it says that.
    since: SystemTime,
}

/// Comes in, but not before [`REST`] has passed since a daemon left. One of this name that was here
/// and did not say when it left is taken to have left now: it died, and whoever starts it anew may
/// be quick. When another died, nobody knows.
///
/// # Errors
///
/// If a daemon of this name is here, or the folder cannot be used.
pub(crate) async fn enter(folder: &Path, daemon: &DaemonId) -> Result<Stay, EnterError> {
    for _ in 0..RESTS_MAX {
        let rest = {
            let _door = pass(folder).await?;
            bury(folder, daemon)?;
            let rest = rest(&tickets(folder)?, SystemTime::now());
            if rest.is_zero() {
                return Stay::begin(folder, daemon);
            }
            rest
        };
        tokio::time::sleep(rest).await;
    }
    let _door = pass(folder).await?;
    Stay::begin(folder, daemon)
}

/// Waits for the door. It closes again when the file is dropped.
async fn pass(folder: &Path) -> Result<File, EnterError> {
    let path = folder.join(DOOR);
    let door = open(&path)?;
    let passing = async {
        loop {
            match door.try_lock() {
                Ok(()) => return Ok(()),
                Err(TryLockError::WouldBlock) => tokio::time::sleep(DOOR_PERIOD).await,
                Err(TryLockError::Error(source)) => return Err(source),
            }
        }
    };
    match tokio::time::timeout(DOOR_WITHIN, passing).await {
        Ok(passed) => passed.map_err(|source| EnterError::Io { path, source })?,
        // Two that come in at once may call each other, and call again if that fails. To stay
        // away for ever because another process stands still would be worse.
        Err(_) => tracing::warn!(door = %path.display(), "somebody stands in the door"),
    }
    Ok(door)
}

/// Lets a life of this name that ended unsaid have ended now, in the door. Others call it still, by
/// a path that goes with it.
fn bury(folder: &Path, daemon: &DaemonId) -> Result<(), EnterError> {
    let path = socket_in(folder, daemon.as_str())?.with_extension(TICKET);
    let failed = |source| EnterError::Io { path: path.clone(), source };
    let ticket = match read(&path) {
        Ok(ticket) => ticket.filter(|ticket| !ticket.is_here && !ticket.life.is_empty()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(failed(error)),
    };
    let Some(Ticket { life, .. }) = ticket else { return Ok(()) };
    // It may have gone all the same.
    let _ = fs::remove_file(path.with_extension(life));
    open(&path)?.set_len(0).map_err(failed)
}

/// How long a newcomer has yet to stay away.
fn rest(tickets: &[Ticket], now: SystemTime) -> Duration {
    let said = tickets.iter().filter(|ticket| !ticket.is_here && ticket.life.is_empty());
    // A clock that was put back must not keep anybody away for longer.
    let past = said.map(|ticket| now.duration_since(ticket.since).unwrap_or_default());
    past.min().map_or(Duration::ZERO, |past| REST.saturating_sub(past))
}

/// Everybody who is or was here. Only in the door: to look whether a ticket is locked, one locks it.
fn tickets(folder: &Path) -> Result<Vec<Ticket>, EnterError> {
    let failed = |source| EnterError::Io { path: folder.to_owned(), source };
    let mut tickets = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|extension| extension == TICKET) {
            tickets.extend(read(&path).map_err(|source| EnterError::Io { path, source })?);
        }
    }
    Ok(tickets)
}

/// The ticket in this file, if its name is a daemon's.
fn read(path: &Path) -> io::Result<Option<Ticket>> {
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let Some(daemon) = stem.filter(|stem| DaemonId::new(stem).is_ok()) else { return Ok(None) };
    let mut file = File::open(path)?;
    let is_here = match file.try_lock_shared() {
        Ok(()) => false,
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Error(source)) => return Err(source),
    };
    let mut life = String::new();
    file.read_to_string(&mut life)?;
    if !is_life(&life) {
        life.clear();
    }
    let since = file.metadata()?.modified()?;
    Ok(Some(Ticket { daemon: daemon.to_owned(), is_here, life, since }))
}

/// Opens a file of this user's alone: whoever else could lock it could keep daemons out.
fn open(path: &Path) -> Result<File, EnterError> {
    let mut options = OpenOptions::new();
    let opened = options.read(true).write(true).create(true).mode(0o600).open(path);
    opened.map_err(|source| EnterError::Io { path: path.to_owned(), source })
}

/// A life that begins now.
fn name_life(now: SystemTime) -> String {
    let micros = now.duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    let digits = format!("{micros:0LIFE_DIGITS$x}");
    digits[digits.len() - LIFE_DIGITS..].to_owned()
}

fn is_life(text: &str) -> bool {
    text.len() == LIFE_DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

// === impl Stay ===

impl Stay {
    /// Begins a life, in the door.
    fn begin(folder: &Path, daemon: &DaemonId) -> Result<Stay, EnterError> {
        let socket = socket_in(folder, daemon.as_str())?;
        let path = socket.with_extension(TICKET);
        let ticket = open(&path)?;
        let failed = |source| EnterError::Io { path: path.clone(), source };
        ticket.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => EnterError::Taken { daemon: daemon.clone() },
            TryLockError::Error(source) => failed(source),
        })?;
        let mut others = Vec::new();
        for Ticket { daemon: other, is_here, life, .. } in tickets(folder)? {
            if is_here && !life.is_empty() && other != daemon.as_str() {
                others.push(folder.join(format!("{other}.{life}")));
            }
        }
        let name = name_life(SystemTime::now());
        let life = socket.with_extension(&name);
        // First the ticket: of a life that ends here the next one finds the path, if there is any.
        ticket.set_len(0).map_err(failed)?;
        ticket.write_all_at(name.as_bytes(), 0).map_err(failed)?;
        let target = socket.file_name().unwrap_or_default();
        std::os::unix::fs::symlink(target, &life)
            .map_err(|source| EnterError::Io { path: life.clone(), source })?;
        others.sort();
        Ok(Stay { ticket, life, others })
    }
}

impl Drop for Stay {
    fn drop(&mut self) {
        // What fails here makes the next life wait as if this one had died.
        let _ = fs::remove_file(&self.life);
        let _ = self.ticket.set_len(0);
    }
}

#[cfg(test)]
mod tests;
