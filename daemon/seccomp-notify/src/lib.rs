//! System calls that another process decides about: seccomp's user notification (Linux 5.9, seccomp_unotify(2)).
//!
//! - A process that confines itself installs a filter ([`listen`]) and hands the [`Listener`] to its
//!   supervisor ([`send`], [`receive`]), over a socket that both have.
//! - Each call that the filter selects waits until the supervisor has answered it
//!   ([`Listener::respond`]): with a value, an error, or “go on”. The supervisor can also put a file of
//!   its own into the process ([`Listener::put_file`]): a socket that it has connected, say.
//!
//! The arguments of a call are registers and do not change; what they point to may, and any other
//! thread of the process may change what its file descriptors mean. So “go on” is right only where the
//! registers alone decide.
//!
//! There is no async here, and no policy. All that is `unsafe` is in `ffi`.

mod ffi;
mod handing;

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use seccompiler::{BpfProgram, SeccompAction, SeccompFilter, SeccompRule, TargetArch};

pub use ffi::listen;
pub use handing::{receive, send};

/// `BPF_RET | BPF_K`: what a program answers.
const RETURN: u16 = 0x06;
/// `SECCOMP_RET_TRACE`, which stands for a notification until a program is finished.
const TRACE: u32 = 0x7ff0_0000;
/// `SECCOMP_RET_USER_NOTIF`.
const NOTIFY: u32 = 0x7fc0_0000;

/// The supervisor's end of a filter.
#[derive(Debug)]
pub struct Listener(OwnedFd);

/// A call that waits for an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Notification {
    /// Names the call in the answer.
    pub id: u64,
    /// The thread that makes the call, by its number here; 0 if it cannot be seen from here.
    pub thread: u32,
    /// The number of the call.
    pub call: i64,
    /// Its arguments, as registers hold them.
    pub arguments: [u64; 6],
}

/// What becomes of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// It returns this, and nothing is done.
    Value(i64),
    /// It fails with this error number.
    Error(i32),
    /// The kernel does it.
    Continue,
}

/// The program of a filter that notifies of these calls, and allows all others.
///
/// # Errors
///
/// If a rule cannot be compiled.
pub fn program(
    rules: BTreeMap<i64, Vec<SeccompRule>>,
    target: TargetArch,
) -> Result<BpfProgram, seccompiler::BackendError> {
    let (others, these) = (SeccompAction::Allow, SeccompAction::Trace(0));
    let mut program: BpfProgram = SeccompFilter::new(rules, others, these, target)?.try_into()?;
    // `seccompiler` has no word for it.
    for instruction in &mut program {
        if instruction.code == RETURN && instruction.k == TRACE {
            instruction.k = NOTIFY;
        }
    }
    Ok(program)
}

impl Listener {
    /// Waits for a call; `None` once no process has the filter any more, or when the time is over.
    ///
    /// # Errors
    ///
    /// If the kernel does not say.
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
                // The process was killed, or a signal took the call back, before it was read.
                Err(error) if !matches!(error.raw_os_error(), Some(libc::ENOENT | libc::EINTR)) => {
                    return Err(error);
                }
                Err(_) => continue,
            }
        }
    }

    /// Answers a call. One that waits no more is passed over.
    ///
    /// # Errors
    ///
    /// If the kernel refuses the answer.
    pub fn respond(&self, id: u64, response: Response) -> io::Result<()> {
        match ffi::respond(self.as_fd(), id, response) {
            Err(error) if error.raw_os_error() == Some(libc::ENOENT) => Ok(()),
            answered => answered,
        }
    }

    /// Whether a call still waits: only then is what was read of its process its own.
    pub fn is_waiting(&self, id: u64) -> bool {
        ffi::is_waiting(self.as_fd(), id)
    }

    /// Puts a file into the process of a call that waits, in place of one that it has.
    ///
    /// # Errors
    ///
    /// If the call waits no more, or the kernel refuses.
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

impl From<OwnedFd> for Listener {
    fn from(file: OwnedFd) -> Listener {
        Listener(file)
    }
}

impl AsFd for Listener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
