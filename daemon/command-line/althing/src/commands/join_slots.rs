//! Limits how many commands join a running ecosystem at once. Each command is a process with its
//! own Zenoh session. If hundreds joined at once, the machine would be so busy that no command sees
//! an agent.
//!
//! A slot is a command's turn to join. It is a locked file beside the daemons' sockets, and becomes
//! free when the command has joined or its process has ended.

use std::fs::{File, OpenOptions, TryLockError};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use terminal::output;

/// Number of commands that may join at the same time.
const AT_ONCE: usize = 4;

/// Time after which the user is told that the command waits for its turn to join.
const TOLD_AFTER: Duration = Duration::from_secs(3);

/// Interval between two attempts of a waiting command to get its turn.
const TRIED_EVERY: Duration = Duration::from_millis(25);

/// Maximum time for which a command waits for its turn to join; after this time, the command fails.
/// Joining takes a tenth of a second, so that hundreds of other commands can join in this time.
const WITHIN: Duration = Duration::from_secs(120);

/// A command's turn to join; the turn ends when this value is dropped.
pub(super) struct JoinSlot(Option<File>);

/// Waits until this command may join the daemons that have their sockets in `folder`. The error
/// text completes the sentence “failed to …”.
pub(super) fn acquire_slot(folder: &Path) -> Result<JoinSlot, String> {
    wait_within(folder, WITHIN)
}

fn wait_within(folder: &Path, within: Duration) -> Result<JoinSlot, String> {
    let mut files = Vec::new();
    for number in 0..AT_ONCE {
        let path = folder.join(format!("joining-{number}"));
        let opened = OpenOptions::new().create(true).append(true).mode(0o600).open(&path);
        // If no file can be created, the command joins without waiting.
        let Ok(file) = opened else { return Ok(JoinSlot(None)) };
        match file.try_lock() {
            Ok(()) => return Ok(JoinSlot(Some(file))),
            Err(TryLockError::WouldBlock) => files.push(file),
            Err(TryLockError::Error(_)) => return Ok(JoinSlot(None)),
        }
    }
    let began = Instant::now();
    let mut is_told = false;
    while began.elapsed() < within {
        // The command takes any free lock, so a stopped command that holds one delays no other. A
        // process can sleep on one lock only, so all locks are tried periodically.
        thread::sleep(TRIED_EVERY);
        if let Some(free) = files.iter().position(|file| file.try_lock().is_ok()) {
            return Ok(JoinSlot(Some(files.swap_remove(free))));
        }
        if !is_told && began.elapsed() >= TOLD_AFTER {
            is_told = true;
            output::print_note("many commands are joining just now; this one waits for its turn");
        }
    }
    Err(format!(
        "join the ecosystem: the daemon is busy, other commands have been joining for {} \
         seconds; try again later",
        within.as_secs()
    ))
}

impl Drop for JoinSlot {
    fn drop(&mut self) {
        // The file is unlocked explicitly, because a child process that inherited it would still
        // hold the lock.
        if let Some(file) = &self.0 {
            let _ = file.unlock();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn join_slots_are_limited_and_reused() {
        let folder = tempfile::tempdir().expect("a folder");
        let wait = || wait_within(folder.path(), Duration::ZERO);
        let mut turns: Vec<_> = (0..AT_ONCE).map(|_| wait().expect("its turn")).collect();
        let busy = wait().err().expect("all are taken");
        assert!(busy.contains("the daemon is busy"), "{busy}");
        turns.pop();
        assert!(wait().is_ok(), "its turn has come");
    }
}
