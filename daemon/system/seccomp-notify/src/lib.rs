//! System calls that another process answers: seccomp's user notification (Linux 5.9,
//! seccomp_unotify(2)).
//!
//! - A process that confines itself installs a filter of system calls ([`listen`]). It passes the
//!   [`NotifyListener`] to its supervisor ([`send`], [`receive`]), over a socket between the two.
//! - Each call that the filter selects waits until the supervisor has answered the call
//!   ([`NotifyListener::respond`]): with a value, an error, or “continue”. The supervisor can also
//!   put a file of its own into the process ([`NotifyListener::put_file`]), for example a connected
//!   socket.
//!
//! The arguments of a call are registers and do not change. But the memory that they point to may
//! change, and another thread of the process may replace the files behind its descriptors. So
//! “continue” is safe only if the decision depends on the values of the registers alone.
//!
//! This crate has no async code. It decides nothing: the supervisor chooses the answers. All
//! `unsafe` code is in `ffi`.

mod ffi;
mod listener_passing;

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use seccompiler::{BpfProgram, SeccompAction, SeccompFilter, SeccompRule, TargetArch};

pub use ffi::listen;
pub use listener_passing::{receive, send};

/// Code of the instruction of a filter program that returns an action (`BPF_RET | BPF_K`).
const RETURN: u16 = 0x06;
/// Action with which `seccompiler` builds a filter program; [`program`] replaces it by the
/// notification (`SECCOMP_RET_TRACE`).
const TRACE: u32 = 0x7ff0_0000;
/// Action of a filter program that notifies the supervisor (`SECCOMP_RET_USER_NOTIF`).
const NOTIFY: u32 = 0x7fc0_0000;

/// The supervisor's end of a filter of system calls, through which the supervisor receives and
/// answers calls.
#[derive(Debug)]
pub struct NotifyListener(OwnedFd);

/// A system call that waits for the supervisor's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Notification {
    /// Number that identifies the system call in the answer.
    pub id: u64,
    /// Id of the thread that makes the system call, in the supervisor's namespace; 0 if the thread
    /// is not visible there.
    pub thread: u32,
    /// Number of the system call.
    pub call: i64,
    /// Arguments of the system call, as in the registers.
    pub arguments: [u64; 6],
}

/// Answer of the supervisor to a system call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// Makes the system call return this value without being executed.
    Value(i64),
    /// Makes the system call fail with this error number.
    Error(i32),
    /// Lets the kernel execute the system call.
    Continue,
}

/// Returns a filter program that notifies the supervisor of system calls that match `rules`, and
/// allows all others.
///
/// # Errors
///
/// Returns an error if a rule cannot be compiled.
pub fn program(
    rules: BTreeMap<i64, Vec<SeccompRule>>,
    target: TargetArch,
) -> Result<BpfProgram, seccompiler::BackendError> {
    let (others, these) = (SeccompAction::Allow, SeccompAction::Trace(0));
    let mut program: BpfProgram = SeccompFilter::new(rules, others, these, target)?.try_into()?;
    // `seccompiler` does not support notifications, so its action “trace” is replaced.
    for instruction in &mut program {
        if instruction.code == RETURN && instruction.k == TRACE {
            instruction.k = NOTIFY;
        }
    }
    Ok(program)
}

impl NotifyListener {
    /// Waits for a system call that the filter selects. Returns `None` when no process has the
    /// filter any more, or when the time `within` has passed. With `None` for `within`, waits
    /// without a limit.
    ///
    /// # Errors
    ///
    /// Returns an error if waiting or reading fails.
    pub fn next(&self, within: Option<Duration>) -> io::Result<Option<Notification>> {
        let timeout = within.map(Timespec::try_from).transpose();
        let timeout = timeout.map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
        loop {
            let mut polled = [PollFd::new(&self.0, PollFlags::IN)];
            match poll(&mut polled, timeout.as_ref()) {
                Ok(0) => return Ok(None),
                Ok(_) => (),
                Err(rustix::io::Errno::INTR) => continue,
                Err(error) => return Err(error.into()),
            }
            if !polled[0].revents().contains(PollFlags::IN) {
                return Ok(None);
            }
            match ffi::receive(self.as_fd()) {
                Ok(notification) => return Ok(Some(notification)),
                // The process of the call was killed, or a signal interrupted the call, before the
                // call was read.
                Err(error) if !matches!(error.raw_os_error(), Some(libc::ENOENT | libc::EINTR)) => {
                    return Err(error);
                }
                Err(_) => continue,
            }
        }
    }

    /// Answers the system call with the number `id`. Does nothing if the call does not wait any
    /// more.
    ///
    /// # Errors
    ///
    /// Returns an error if the kernel rejects the answer.
    pub fn respond(&self, id: u64, response: Response) -> io::Result<()> {
        match ffi::respond(self.as_fd(), id, response) {
            Err(error) if error.raw_os_error() == Some(libc::ENOENT) => Ok(()),
            answered => answered,
        }
    }

    /// Whether the system call with the number `id` still waits. Information that was read about
    /// the calling process is valid only if this method returns `true` afterwards. Otherwise the
    /// process may have ended, and another process may have its id.
    pub fn is_waiting(&self, id: u64) -> bool {
        ffi::is_waiting(self.as_fd(), id)
    }

    /// Puts a file into the process that makes the waiting call `id`, in place of the file
    /// descriptor `in_place_of`. With `closes_on_exec`, the descriptor is closed when the process
    /// executes another program.
    ///
    /// # Errors
    ///
    /// Returns an error if the call does not wait any more, or the kernel refuses to put the file
    /// there.
    pub fn put_file(
        &self,
        id: u64,
        file: BorrowedFd<'_>,
        in_place_of: u32,
        closes_on_exec: bool,
    ) -> io::Result<()> {
        ffi::put_file(self.as_fd(), id, file, in_place_of, closes_on_exec)
    }
}

impl From<OwnedFd> for NotifyListener {
    fn from(file: OwnedFd) -> NotifyListener {
        NotifyListener(file)
    }
}

impl AsFd for NotifyListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
