//! Commands join a running ecosystem in turns: each is a process with a Zenoh session of its own, and
//! hundreds that join at one instant would keep the machine so busy that none sees anybody.
//!
//! A turn is a locked file beside the daemons' sockets. It is over when the command has joined, or its
//! process has ended.

use std::fs::{File, OpenOptions, TryLockError};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use terminal::output;

/// How many commands join at a time.
const AT_ONCE: usize = 4;

/// After how long a person is told that the command waits.
const TOLD_AFTER: Duration = Duration::from_secs(3);

/// How often a command that waits tries whether its turn has come.
const TRIED_EVERY: Duration = Duration::from_millis(25);

/// How long a command waits for its turn. Joining takes a tenth of a second: hundreds come first.
const WITHIN: Duration = Duration::from_secs(120);

/// A command's turn to join; over when dropped.
pub(super) struct Turn(Option<File>);

/// Waits until it is this command's turn to join the daemons whose sockets are in `folder`. The error
/// completes “failed to …”.
pub(super) fn wait(folder: &Path) -> Result<Turn, String> {
    wait_within(folder, WITHIN)
}

fn wait_within(folder: &Path, within: Duration) -> Result<Turn, String> {
    let mut files = Vec::new();
    for number in 0..AT_ONCE {
        let path = folder.join(format!("joining-{number}"));
        let opened = OpenOptions::new().create(true).append(true).mode(0o600).open(&path);
        // Where no file can be made, nobody can be waited for.
        let Ok(file) = opened else { return Ok(Turn(None)) };
        match file.try_lock() {
            Ok(()) => return Ok(Turn(Some(file))),
            Err(TryLockError::WouldBlock) => files.push(file),
            Err(TryLockError::Error(_)) => return Ok(Turn(None)),
        }
    }
    let began = Instant::now();
    let mut is_told = false;
    while began.elapsed() < within {
        // Any of them: one that is held by a stopped command holds up nobody. The system wakes who
        // waits for one lock only, so all are tried now and then.
        thread::sleep(TRIED_EVERY);
        if let Some(free) = files.iter().position(|file| file.try_lock().is_ok()) {
            return Ok(Turn(Some(files.swap_remove(free))));
        }
        if !is_told && began.elapsed() >= TOLD_AFTER {
            is_told = true;
            output::note("many commands are joining just now; this one waits for its turn");
        }
    }
    Err(format!(
        "join the ecosystem: the daemon is busy, other commands have been joining for {} \
         seconds; try again later",
        within.as_secs()
    ))
}

impl Drop for Turn {
    fn drop(&mut self) {
        // A process of the same files that was begun meanwhile would hold the lock.
        if let Some(file) = &self.0 {
            let _ = file.unlock();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_join_at_a_time_and_the_next_when_one_has() {
        let folder = tempfile::tempdir().expect("a folder");
        let wait = || wait_within(folder.path(), Duration::ZERO);
        let mut turns: Vec<_> = (0..AT_ONCE).map(|_| wait().expect("its turn")).collect();
        let busy = wait().err().expect("all are taken");
        assert!(busy.contains("the daemon is busy"), "{busy}");
        turns.pop();
        assert!(wait().is_ok(), "its turn has come");
    }
}
