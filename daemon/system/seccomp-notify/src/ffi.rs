//! The one system call and the four `ioctl`s of seccomp's user notification: all `unsafe` code is
//! here.
//!
//! Each call passes the kernel a pointer to a structure of `libc`, which has the layout of the
//! kernel's `linux/seccomp.h`. The structure stays on the stack of the caller until the call
//! returns, and the kernel keeps no pointer.
#![expect(unsafe_code, reason = "no crate wraps these calls")]

use std::ffi::{c_long, c_ulong};
use std::io;
use std::mem;
use std::os::fd::{AsRawFd as _, BorrowedFd, FromRawFd as _, OwnedFd};

use seccompiler::BpfProgram;

use crate::{Notification, NotifyListener, Response};

/// Installs a filter of system calls on this thread. The filter cannot be removed, and the thread's
/// children inherit it. Each call that the filter selects waits until it is answered through the
/// returned listener.
///
/// # Errors
///
/// Returns an error if the kernel has no user notification, or if the process already has a filter
/// with a listener.
pub fn listen(program: &BpfProgram) -> io::Result<NotifyListener> {
    rustix::thread::set_no_new_privs(true)?;
    // With `WAIT_KILLABLE_RECV`, a signal does not interrupt a call that the listener has read.
    // Linux before 5.19 does not have this flag; an interrupted call is then made again.
    let killable =
        libc::SECCOMP_FILTER_FLAG_NEW_LISTENER | libc::SECCOMP_FILTER_FLAG_WAIT_KILLABLE_RECV;
    match install(program, killable) {
        Err(error) if error.raw_os_error() == Some(libc::EINVAL) => {
            install(program, libc::SECCOMP_FILTER_FLAG_NEW_LISTENER)
        }
        installed => installed,
    }
}

fn install(program: &BpfProgram, flags: c_ulong) -> io::Result<NotifyListener> {
    let length = u16::try_from(program.len());
    let length = length.map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
    let filter: Vec<libc::sock_filter> = program.iter().map(instruction).collect();
    let program = libc::sock_fprog { len: length, filter: filter.as_ptr().cast_mut() };
    // SAFETY: `program` points to `length` instructions, which exist until the call returns; the
    // kernel copies the instructions and writes to neither.
    let result = unsafe {
        libc::syscall(
            libc::SYS_seccomp,
            c_ulong::from(libc::SECCOMP_SET_MODE_FILTER),
            flags,
            &raw const program,
        )
    };
    let listener = i32::try_from(checked(result)?).map_err(io::Error::other)?;
    // SAFETY: the kernel has just opened this descriptor for this process, and nothing else owns
    // it.
    Ok(NotifyListener::from(unsafe { OwnedFd::from_raw_fd(listener) }))
}

fn instruction(one: &seccompiler::sock_filter) -> libc::sock_filter {
    libc::sock_filter { code: one.code, jt: one.jt, jf: one.jf, k: one.k }
}

/// Reads a system call that waits for an answer; blocks until there is such a call.
pub(crate) fn receive(listener: BorrowedFd<'_>) -> io::Result<Notification> {
    // SAFETY: all fields of the structure are numbers, and the kernel requires zeros.
    let mut read: libc::seccomp_notif = unsafe { mem::zeroed() };
    // SAFETY: the kernel writes one `seccomp_notif` to a pointer to one.
    let result =
        unsafe { libc::ioctl(listener.as_raw_fd(), libc::SECCOMP_IOCTL_NOTIF_RECV, &raw mut read) };
    checked(result.into())?;
    Ok(Notification {
        id: read.id,
        thread: read.pid,
        call: read.data.nr.into(),
        arguments: read.data.args,
    })
}

pub(crate) fn respond(listener: BorrowedFd<'_>, id: u64, response: Response) -> io::Result<()> {
    let mut answer = libc::seccomp_notif_resp { id, val: 0, error: 0, flags: 0 };
    match response {
        Response::Value(value) => answer.val = value,
        Response::Error(number) => answer.error = -number.abs(),
        Response::Continue => answer.flags = libc::SECCOMP_USER_NOTIF_FLAG_CONTINUE as u32,
    }
    // SAFETY: the kernel reads one `seccomp_notif_resp` from a pointer to one.
    let result = unsafe {
        libc::ioctl(listener.as_raw_fd(), libc::SECCOMP_IOCTL_NOTIF_SEND, &raw mut answer)
    };
    checked(result.into()).map(drop)
}

pub(crate) fn is_waiting(listener: BorrowedFd<'_>, id: u64) -> bool {
    // SAFETY: the kernel reads one `u64` from a pointer to one.
    let result = unsafe {
        libc::ioctl(listener.as_raw_fd(), libc::SECCOMP_IOCTL_NOTIF_ID_VALID, &raw const id)
    };
    result == 0
}

pub(crate) fn put_file(
    listener: BorrowedFd<'_>,
    id: u64,
    file: BorrowedFd<'_>,
    in_place_of: u32,
    closes_on_exec: bool,
) -> io::Result<()> {
    let closes = if closes_on_exec { libc::O_CLOEXEC } else { 0 };
    let put = libc::seccomp_notif_addfd {
        id,
        flags: libc::SECCOMP_ADDFD_FLAG_SETFD as u32,
        srcfd: file.as_raw_fd().unsigned_abs(),
        newfd: in_place_of,
        newfd_flags: closes.unsigned_abs(),
    };
    // SAFETY: the kernel reads one `seccomp_notif_addfd` from a pointer to one; `file` is open.
    let result = unsafe {
        libc::ioctl(listener.as_raw_fd(), libc::SECCOMP_IOCTL_NOTIF_ADDFD, &raw const put)
    };
    checked(result.into()).map(drop)
}

fn checked(result: c_long) -> io::Result<c_long> {
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(result) }
}
