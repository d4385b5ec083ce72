//! The order in which the daemons of one machine connect: each daemon that enters connects to the
//! daemons that are present.
//!
//! Two daemons must never connect to each other at the same time, because Zenoh may then close both
//! links. Therefore daemons enter one at a time, under a lock, and no daemon connects to those that
//! enter after it. Names play no role: a daemon is linked even to daemons with an ecosystem file
//! that does not contain its name.
//!
//! Zenoh tries for ever to reconnect to a lost peer. A daemon that restarts connects to the others
//! by itself, so their attempts to reconnect to its previous incarnation must fail. Therefore each
//! incarnation has its own path by which other daemons connect to it: a symbolic link to the
//! daemon's socket. The next incarnation removes that link before it listens.
//!
//! For each daemon, the runtime folder holds beside the socket
//!
//! - `NAME.here`, the *ticket*: the daemon locks this file as long as it runs. The file contains
//!   the incarnation, and is empty after the daemon has left in good order.
//! - `NAME.INCARNATION`, the symbolic link by which other daemons connect to the daemon.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read as _};
use std::os::unix::fs::{FileExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::DaemonId;
use substrate_zenoh::REOPEN_DELAY;

use super::folders::{FolderError, give_to_service, socket_in};

/// The name of the lock file by which daemons enter one at a time.
const LOCK_FILE: &str = "entrance.lock";

/// How long a daemon waits for the lock. The holder of the lock only reads a few small files, so it
/// keeps the lock for longer only if it is suspended meanwhile.
const LOCK_TIMEOUT: Duration = Duration::from_secs(2);
const LOCK_POLL_PERIOD: Duration = Duration::from_millis(2);
const _: () = assert!(LOCK_POLL_PERIOD.as_millis() < LOCK_TIMEOUT.as_millis());

/// Maximum number of times that a daemon waits because another daemon has left. Without this bound,
/// a daemon that exits at every start, and is always restarted, would keep all other daemons from
/// entering.
const RESTS_MAX: usize = 8;

/// The extension of a daemon's ticket: the file that a running daemon keeps locked, which shows the
/// other daemons of the machine that it is present.
const PRESENCE_EXTENSION: &str = "here";

/// Number of hexadecimal digits in the name of an incarnation. They are the last digits of its
/// start time in microseconds, and repeat after twelve days. With more digits, the path of the
/// symbolic link could be longer than that of the socket.
const LIFE_DIGITS: usize = 10;

/// The reason why a daemon cannot enter. The message completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum RegisterError {
    /// The folder cannot hold the daemon's socket, for example because the path would be too long.
    #[error("{0}")]
    Folder(#[from] FolderError),
    /// A file or folder cannot be used.
    #[error("use {}: {source}", path.display())]
    Io {
        /// Path of the file or folder.
        path: PathBuf,
        /// The error that the operating system reports.
        #[source]
        source: io::Error,
    },
    /// Another running process uses the daemon's name.
    #[error("start as `{daemon}`: a daemon of this name is running here already")]
    Taken {
        /// Name of the daemon.
        daemon: DaemonId,
    },
}

/// The presence of a daemon among the daemons of its machine. Dropping this value records in the
/// ticket file that the daemon has left.
#[derive(Debug)]
pub(crate) struct PresenceGuard {
    /// The daemon's ticket: the file that is locked while the daemon is present. The lock lasts
    /// until the kernel closes the file.
    ticket: File,
    /// The path by which daemons that enter later connect to this daemon.
    incarnation: PathBuf,
    /// The paths by which this daemon connects to the daemons that entered before it.
    pub(crate) others: Vec<PathBuf>,
}

/// The entrance of the daemons of an ecosystem, closed: a daemon that starts waits until this value is
/// dropped, for [`LOCK_TIMEOUT`] at most.
#[derive(Debug)]
pub(crate) struct ClosedEntrance {
    _door: Option<File>,
    /// Names of the daemons that are present.
    pub(crate) daemons: Vec<String>,
}

/// The content and the state of the ticket file of a daemon, as they were read.
struct PresenceFile {
    daemon: String,
    /// Whether the file is locked, which means that the daemon is present.
    is_here: bool,
    /// The incarnation that the ticket file contains; empty if the daemon has left in good order.
    incarnation: String,
    /// Time of the last change of the ticket file: the time at which the daemon began or left.
    since: SystemTime,
}

/// Registers a daemon, but not before [`REOPEN_DELAY`] has passed since another daemon left. If the
/// previous incarnation of this daemon crashed, it counts as having left now, because a restart may
/// follow a crash at once. Crashes of other daemons cause no wait, because their times are unknown.
///
/// # Errors
///
/// Returns an error if a daemon of this name is present, or if the folder cannot be used.
pub(crate) async fn register_daemon(
    folder: &Path,
    daemon: &DaemonId,
) -> Result<PresenceGuard, RegisterError> {
    for _ in 0..RESTS_MAX {
        let rest = {
            let _door = acquire_lock(folder).await?;
            clean_up_crashed(folder, daemon)?;
            let rest = remaining_delay(&presence_files(folder)?, SystemTime::now());
            if rest.is_zero() {
                return PresenceGuard::begin(folder, daemon);
            }
            rest
        };
        tokio::time::sleep(rest).await;
    }
    let _door = acquire_lock(folder).await?;
    PresenceGuard::begin(folder, daemon)
}

/// Waits for the lock under which daemons enter. The lock is released when the returned file is
/// dropped.
async fn acquire_lock(folder: &Path) -> Result<File, RegisterError> {
    let path = folder.join(LOCK_FILE);
    let door = open(&path)?;
    let passing = async {
        loop {
            match door.try_lock() {
                Ok(()) => return Ok(()),
                Err(TryLockError::WouldBlock) => tokio::time::sleep(LOCK_POLL_PERIOD).await,
                Err(TryLockError::Error(source)) => return Err(source),
            }
        }
    };
    match tokio::time::timeout(LOCK_TIMEOUT, passing).await {
        Ok(passed) => passed.map_err(|source| RegisterError::Io { path, source })?,
        // Without the lock, two daemons that enter at once may connect to each other, and retry if
        // that fails. Waiting for ever for a suspended process would be worse.
        Err(_) => tracing::warn!(door = %path.display(), "another process keeps the lock"),
    }
    Ok(door)
}

/// If the previous incarnation of this daemon crashed, records now as the time at which it left,
/// and removes the symbolic link by which other daemons still try to connect to it. The caller
/// holds the lock.
fn clean_up_crashed(folder: &Path, daemon: &DaemonId) -> Result<(), RegisterError> {
    let path = socket_in(folder, daemon.as_str())?.with_extension(PRESENCE_EXTENSION);
    let failed = |source| RegisterError::Io { path: path.clone(), source };
    let ticket = match read(&path) {
        Ok(ticket) => ticket.filter(|ticket| !ticket.is_here && !ticket.incarnation.is_empty()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(failed(error)),
    };
    let Some(PresenceFile { incarnation, .. }) = ticket else { return Ok(()) };
    // The symbolic link may be missing.
    let _ = fs::remove_file(path.with_extension(incarnation));
    open(&path)?.set_len(0).map_err(failed)
}

/// Returns how much longer a daemon must wait before it enters: until [`REOPEN_DELAY`] has passed
/// since the last daemon left. `tickets` are those of all daemons.
fn remaining_delay(tickets: &[PresenceFile], now: SystemTime) -> Duration {
    let said = tickets.iter().filter(|ticket| !ticket.is_here && ticket.incarnation.is_empty());
    // A clock that was set back must not make the wait longer.
    let past = said.map(|ticket| now.duration_since(ticket.since).unwrap_or_default());
    past.min().map_or(Duration::ZERO, |past| REOPEN_DELAY.saturating_sub(past))
}

/// Returns the tickets of all daemons that are or were present: the files that show their presence.
/// The caller holds the lock on the folder, because this function locks each ticket for a moment to
/// find out whether it is locked.
fn presence_files(folder: &Path) -> Result<Vec<PresenceFile>, RegisterError> {
    let failed = |source| RegisterError::Io { path: folder.to_owned(), source };
    let mut tickets = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_some_and(|extension| extension == PRESENCE_EXTENSION) {
            tickets.extend(read(&path).map_err(|source| RegisterError::Io { path, source })?);
        }
    }
    Ok(tickets)
}

/// Reads the ticket file at `path`; returns `None` if its file name is not a daemon's name.
fn read(path: &Path) -> io::Result<Option<PresenceFile>> {
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    let Some(daemon) = stem.filter(|stem| DaemonId::new(stem).is_ok()) else { return Ok(None) };
    let mut file = File::open(path)?;
    let is_here = match file.try_lock_shared() {
        Ok(()) => false,
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Error(source)) => return Err(source),
    };
    let mut incarnation = String::new();
    file.read_to_string(&mut incarnation)?;
    if !is_incarnation_name(&incarnation) {
        incarnation.clear();
    }
    let since = file.metadata()?.modified()?;
    Ok(Some(PresenceFile { daemon: daemon.to_owned(), is_here, incarnation, since }))
}

/// Opens a file that only this user can open. Another user could otherwise lock it, and so keep
/// daemons from entering.
fn open(path: &Path) -> Result<File, RegisterError> {
    let mut options = OpenOptions::new();
    let opened = options.read(true).write(true).create(true).mode(0o600).open(path);
    // A command of root may be the first one that needs the lock; the daemon needs it after that.
    let opened = opened.and_then(|file| give_to_service(path).map(|()| file));
    opened.map_err(|source| RegisterError::Io { path: path.to_owned(), source })
}

/// Returns the text that names the incarnation of a daemon that starts at the time `now`.
fn incarnation_name(now: SystemTime) -> String {
    let micros = now.duration_since(UNIX_EPOCH).unwrap_or_default().as_micros();
    let digits = format!("{micros:0LIFE_DIGITS$x}");
    digits[digits.len() - LIFE_DIGITS..].to_owned()
}

fn is_incarnation_name(text: &str) -> bool {
    text.len() == LIFE_DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

// === impl ClosedEntrance ===

impl ClosedEntrance {
    /// Closes the entrance in a folder of sockets. No daemon has entered a folder that does not
    /// exist.
    ///
    /// # Errors
    ///
    /// Returns an error if the folder cannot be used.
    pub(crate) async fn close(folder: &Path) -> Result<ClosedEntrance, RegisterError> {
        if !folder.is_dir() {
            return Ok(ClosedEntrance { _door: None, daemons: Vec::new() });
        }
        let door = acquire_lock(folder).await?;
        let here = presence_files(folder)?.into_iter().filter(|ticket| ticket.is_here);
        let daemons = here.map(|ticket| ticket.daemon).collect();
        Ok(ClosedEntrance { _door: Some(door), daemons })
    }
}

// === impl PresenceGuard ===

impl PresenceGuard {
    /// Begins an incarnation of a daemon: locks its ticket and makes its symbolic link. The caller
    /// holds the lock.
    fn begin(folder: &Path, daemon: &DaemonId) -> Result<PresenceGuard, RegisterError> {
        let socket = socket_in(folder, daemon.as_str())?;
        let path = socket.with_extension(PRESENCE_EXTENSION);
        let ticket = open(&path)?;
        let failed = |source| RegisterError::Io { path: path.clone(), source };
        ticket.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => RegisterError::Taken { daemon: daemon.clone() },
            TryLockError::Error(source) => failed(source),
        })?;
        let mut others = Vec::new();
        for PresenceFile { daemon: other, is_here, incarnation, .. } in presence_files(folder)? {
            if is_here && !incarnation.is_empty() && other != daemon.as_str() {
                others.push(folder.join(format!("{other}.{incarnation}")));
            }
        }
        let name = incarnation_name(SystemTime::now());
        let incarnation = socket.with_extension(&name);
        // The ticket is written before the link. If the process crashes in between, the next
        // incarnation finds the path of the link to remove in the ticket.
        ticket.set_len(0).map_err(failed)?;
        ticket.write_all_at(name.as_bytes(), 0).map_err(failed)?;
        let target = socket.file_name().unwrap_or_default();
        std::os::unix::fs::symlink(target, &incarnation)
            .map_err(|source| RegisterError::Io { path: incarnation.clone(), source })?;
        others.sort();
        Ok(PresenceGuard { ticket, incarnation, others })
    }
}

impl Drop for PresenceGuard {
    fn drop(&mut self) {
        // If this fails, the next incarnation waits as after a crash.
        let _ = fs::remove_file(&self.incarnation);
        let _ = self.ticket.set_len(0);
    }
}

#[cfg(test)]
mod tests;
