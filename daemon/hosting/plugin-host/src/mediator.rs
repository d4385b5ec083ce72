//! Answers the system calls of a confined plugin that the kernel alone cannot decide
//! (`confinement::calls`).
//!
//! - `connect`: the daemon itself connects to the plugin's endpoint and puts the connected socket
//!   in place of the plugin's socket. A plugin that changes the address in its memory meanwhile
//!   therefore gains nothing. Other Unix sockets are refused. With the right `network`, the daemon
//!   also connects sockets of the Internet.
//! - Signals are allowed only within the plugin's own process group.
//! - `fork` is allowed up to the plugin's limit of processes.
//!
//! Each plugin has one thread for these answers. The thread ends with the last process that has the
//! filter.

use std::fs::{self, File};
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, SocketAddrV6};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::str::FromStr as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::{Pid, PidfdFlags, PidfdGetfdFlags};
use seccomp_notify::{Notification, NotifyListener, Response};
use syscalls::Sysno;

use crate::usage;

/// Maximum number of connections to the Internet that the daemon may be establishing for a plugin
/// at the same time. Further attempts of the plugin fail with `EAGAIN`.
const WAITING_MAX: usize = 64;

/// Maximum length of an address of `connect` that is read, in bytes: `sizeof(struct sockaddr_un)`.
const ADDRESS_MAX: u64 = 110;

/// Mediator of one plugin: decides the system calls that the kernel alone cannot decide.
pub(crate) struct CallMediator {
    /// Process group of the plugin.
    pub(crate) group: Pid,
    /// Sockets that the plugin may connect to.
    pub(crate) sockets: Vec<PathBuf>,
    /// Whether the plugin may use the Internet.
    pub(crate) network: bool,
    /// Limit of the number of processes of the plugin.
    pub(crate) processes: u32,
}

/// Address that a process passes to `connect`.
#[derive(Debug, PartialEq)]
enum ConnectAddress {
    Path(PathBuf),
    Internet(SocketAddr),
    /// An address of the family `AF_UNSPEC`, which dissolves the connection of a socket.
    Nothing,
}

impl CallMediator {
    /// Answers the plugin's system calls, on a thread of its own.
    ///
    /// # Errors
    ///
    /// Returns an error if the thread cannot be started.
    pub(crate) fn start(self, listener: NotifyListener) -> io::Result<()> {
        let thread = std::thread::Builder::new().name("plugin-calls".to_owned());
        thread.spawn(move || self.run(listener)).map(drop)
    }

    fn run(self, listener: NotifyListener) {
        let (mediator, listener) = (Arc::new(self), Arc::new(listener));
        let waiting = Arc::new(AtomicUsize::new(0));
        loop {
            match listener.next(None) {
                Ok(Some(call)) => mediator.answer(&listener, call, &waiting),
                Ok(None) => return,
                Err(error) => {
                    // Calls that wait for an answer fail with `ENOSYS` from now on.
                    return tracing::error!(
                        group = ?mediator.group,
                        %error,
                        "system calls of a plugin cannot be received any more: those that wait for \
                         an answer fail"
                    );
                }
            }
        }
    }

    fn answer(
        self: &Arc<Self>,
        listener: &Arc<NotifyListener>,
        call: Notification,
        waiting: &Arc<AtomicUsize>,
    ) {
        let is = |name: &str| {
            Sysno::from_str(name).is_ok_and(|known| i64::from(known.id()) == call.call)
        };
        let response = if is("connect") {
            match self.address(listener, &call) {
                Ok(ConnectAddress::Path(path)) => self.connect(listener, &call, &path),
                Ok(address) => return self.connect_beyond(listener, call, address, waiting),
                Err(errno) => Err(errno),
            }
        } else if ["fork", "vfork", "clone"].into_iter().any(is) {
            self.fork()
        } else {
            self.signal(call.arguments[0])
        };
        respond(listener, call.id, response);
    }

    /// Reads the address of a call of `connect` from the plugin's memory, exactly once.
    fn address(
        &self,
        listener: &NotifyListener,
        call: &Notification,
    ) -> Result<ConnectAddress, Errno> {
        let [_, pointer, length, ..] = call.arguments;
        let length = usize::try_from(length.min(ADDRESS_MAX)).map_err(|_| Errno::INVAL)?;
        let mut bytes = vec![0; length];
        let memory = File::open(format!("/proc/{}/mem", call.thread)).map_err(|_| Errno::ACCESS)?;
        memory.read_exact_at(&mut bytes, pointer).map_err(|_| Errno::FAULT)?;
        if !listener.is_waiting(call.id) {
            return Err(Errno::INTR);
        }
        read(&bytes).ok_or(Errno::ACCESS)
    }

    /// Connects to a Unix socket on behalf of the plugin.
    fn connect(
        &self,
        listener: &NotifyListener,
        call: &Notification,
        path: &Path,
    ) -> Result<Response, Errno> {
        let descriptor = u32::try_from(call.arguments[0] & 0xffff_ffff).map_err(|_| Errno::BADF)?;
        if !self.sockets.iter().any(|known| known == path) {
            let path = path.display();
            tracing::debug!(group = ?self.group, %path, "a connection to this socket is refused");
            return Err(Errno::ACCESS);
        }
        let theirs = format!("/proc/{}/fd/{descriptor}", call.thread);
        let is_socket = |link: PathBuf| link.as_os_str().as_bytes().starts_with(b"socket:");
        if !fs::read_link(theirs).is_ok_and(is_socket) {
            return Err(Errno::NOTSOCK);
        }
        let flags = flags(call.thread, descriptor).ok_or(Errno::BADF)?;
        let socket = connected(path)?;
        if flags & libc::O_NONBLOCK.unsigned_abs() == 0 {
            rustix::io::ioctl_fionbio(&socket, false)?;
        }
        let closes = flags & libc::O_CLOEXEC.unsigned_abs() != 0;
        let put = listener.put_file(call.id, socket.as_fd(), descriptor, closes);
        put.map_err(|error| Errno::from_io_error(&error).unwrap_or(Errno::IO))?;
        Ok(Response::Value(0))
    }

    /// Connects a socket of the Internet on behalf of the plugin, on a thread of its own, because
    /// connecting may block.
    fn connect_beyond(
        self: &Arc<Self>,
        listener: &Arc<NotifyListener>,
        call: Notification,
        address: ConnectAddress,
        waiting: &Arc<AtomicUsize>,
    ) {
        if !self.network {
            return respond(listener, call.id, Err(Errno::ACCESS));
        }
        if waiting.fetch_add(1, Ordering::Relaxed) >= WAITING_MAX {
            waiting.fetch_sub(1, Ordering::Relaxed);
            return respond(listener, call.id, Err(Errno::AGAIN));
        }
        let (heard, counted) = (Arc::clone(listener), Arc::clone(waiting));
        let thread = std::thread::Builder::new().name("plugin-connects".to_owned());
        let begun = thread.spawn(move || {
            respond(&heard, call.id, connect_socket(&heard, &call, &address));
            counted.fetch_sub(1, Ordering::Relaxed);
        });
        if begun.is_err() {
            waiting.fetch_sub(1, Ordering::Relaxed);
            respond(listener, call.id, Err(Errno::AGAIN));
        }
    }

    /// Allows a signal only to processes of the plugin's own group. The process id can belong to
    /// another process when the kernel sends the signal only if the checked process ends in
    /// between.
    fn signal(&self, process: u64) -> Result<Response, Errno> {
        // A `pid_t` is the lower half of the register.
        let process = i32::from_ne_bytes(((process & 0xffff_ffff) as u32).to_ne_bytes());
        let own = self.group.as_raw_nonzero().get();
        let is_own = match process {
            0 => true,
            process if process < 0 => process == -own,
            process => usage::is_of_group(process, own).ok_or(Errno::SRCH)?,
        };
        if is_own { Ok(Response::Continue) } else { Err(Errno::PERM) }
    }

    fn fork(&self) -> Result<Response, Errno> {
        let are = usage::processes(self.group.as_raw_nonzero().get());
        if are < self.processes { Ok(Response::Continue) } else { Err(Errno::AGAIN) }
    }
}

fn respond(listener: &NotifyListener, id: u64, response: Result<Response, Errno>) {
    let response = response.unwrap_or_else(|errno| Response::Error(errno.raw_os_error()));
    if let Err(error) = listener.respond(id, response) {
        tracing::debug!(%error, "a system call is not answered");
    }
}

/// Parses an address of `connect`; returns `None` if it is invalid or of a family that no plugin
/// may connect to.
fn read(bytes: &[u8]) -> Option<ConnectAddress> {
    let family = u16::from_ne_bytes(bytes.get(..2)?.try_into().ok()?);
    match i32::from(family) {
        libc::AF_UNSPEC => Some(ConnectAddress::Nothing),
        libc::AF_UNIX => {
            let name = bytes.get(2..)?;
            let end = name.iter().position(|byte| *byte == 0).unwrap_or(name.len());
            // A name that begins with a zero byte is abstract. Abstract sockets are refused.
            let name = name.get(..end).filter(|name| !name.is_empty())?;
            Some(ConnectAddress::Path(PathBuf::from(std::ffi::OsStr::from_bytes(name))))
        }
        libc::AF_INET => {
            let port = u16::from_be_bytes(bytes.get(2..4)?.try_into().ok()?);
            let address: [u8; 4] = bytes.get(4..8)?.try_into().ok()?;
            Some(ConnectAddress::Internet(SocketAddrV4::new(Ipv4Addr::from(address), port).into()))
        }
        libc::AF_INET6 => {
            let port = u16::from_be_bytes(bytes.get(2..4)?.try_into().ok()?);
            let flow = u32::from_be_bytes(bytes.get(4..8)?.try_into().ok()?);
            let address: [u8; 16] = bytes.get(8..24)?.try_into().ok()?;
            let scope = u32::from_ne_bytes(bytes.get(24..28)?.try_into().ok()?);
            let address = SocketAddrV6::new(Ipv6Addr::from(address), port, flow, scope);
            Some(ConnectAddress::Internet(address.into()))
        }
        _ => None,
    }
}

/// Returns a new non-blocking socket that is connected to the Unix socket at `path`.
fn connected(path: &Path) -> Result<OwnedFd, Errno> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket)
}

/// Returns the flags of a file descriptor of another process.
fn flags(thread: u32, descriptor: u32) -> Option<u32> {
    // For some files, a process can make this text arbitrarily long, so the length that is read is
    // bounded.
    let about = usage::read_text(Path::new(&format!("/proc/{thread}/fdinfo/{descriptor}"))).ok()?;
    let flags = about.lines().find_map(|line| line.strip_prefix("flags:"))?;
    u32::from_str_radix(flags.trim(), 8).ok()
}

/// Connects a socket of another process to an address that was read before. The socket's file
/// descriptor is duplicated first, so that the process cannot replace the socket.
fn connect_socket(
    listener: &NotifyListener,
    call: &Notification,
    address: &ConnectAddress,
) -> Result<Response, Errno> {
    let process = process_of(call.thread).ok_or(Errno::SRCH)?;
    let process = rustix::process::pidfd_open(process, PidfdFlags::empty())?;
    let descriptor = i32::try_from(call.arguments[0] & 0x7fff_ffff).map_err(|_| Errno::BADF)?;
    let socket = rustix::process::pidfd_getfd(&process, descriptor, PidfdGetfdFlags::empty())?;
    // If the process has ended meanwhile, its id and its socket may belong to another process.
    if !listener.is_waiting(call.id) {
        return Err(Errno::INTR);
    }
    let family = rustix::net::sockopt::socket_domain(&socket)?;
    if family != AddressFamily::INET && family != AddressFamily::INET6 {
        return Err(Errno::ACCESS);
    }
    match address {
        ConnectAddress::Internet(address) => rustix::net::connect(&socket, address)?,
        ConnectAddress::Nothing => rustix::net::connect_unspec(&socket)?,
        ConnectAddress::Path(_) => return Err(Errno::INVAL),
    }
    Ok(Response::Value(0))
}

/// Returns the id of the process that a thread belongs to.
fn process_of(thread: u32) -> Option<Pid> {
    let about = fs::read_to_string(format!("/proc/{thread}/status")).ok()?;
    let process = about.lines().find_map(|line| line.strip_prefix("Tgid:"))?;
    Pid::from_raw(process.trim().parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_parsed_as_the_kernel_parses_them() {
        let family = |family: i32| u16::try_from(family).expect("short").to_ne_bytes().to_vec();
        let unix = |name: &[u8]| [family(libc::AF_UNIX), name.to_vec()].concat();
        assert_eq!(read(&unix(b"/run/a\0rest")), Some(ConnectAddress::Path("/run/a".into())));
        assert_eq!(read(&unix(b"/run/a")), Some(ConnectAddress::Path("/run/a".into())));
        assert_eq!(read(&unix(b"\0abstract")), None);
        assert_eq!(read(&unix(b"")), None);
        let internet = [family(libc::AF_INET), vec![0x1f, 0x90, 127, 0, 0, 1]].concat();
        let expected = SocketAddr::from(([127, 0, 0, 1], 8080));
        assert_eq!(read(&internet), Some(ConnectAddress::Internet(expected)));
        assert_eq!(read(&internet[..5]), None);
        assert_eq!(read(&family(libc::AF_UNSPEC)), Some(ConnectAddress::Nothing));
        assert_eq!(read(&family(libc::AF_NETLINK)), None);
        assert_eq!(read(b"x"), None);
    }

    #[test]
    fn signals_stay_in_the_group() {
        let group = rustix::process::getpgid(None).expect("it has one");
        let mediator = CallMediator { group, sockets: Vec::new(), network: false, processes: 1 };
        let own = group.as_raw_nonzero().get();
        let sent = |process: i32| mediator.signal(u64::from(process.cast_unsigned()));
        for process in [0, -own, std::process::id().cast_signed()] {
            assert_eq!(sent(process), Ok(Response::Continue), "{process}");
        }
        assert_eq!(sent(-1), Err(Errno::PERM));
        assert_eq!(sent(i32::MIN), Err(Errno::PERM));
        assert_ne!(sent(1), Ok(Response::Continue));
        assert_eq!(mediator.fork(), Err(Errno::AGAIN), "this process is one already");
    }
}
