//! Chooses the daemon of this machine through which a command joins. Running daemons are tried
//! before stopped ones.
//!
//! A stopped process (SIGSTOP, a debugger, a frozen control group) still accepts connections,
//! because the kernel accepts them for it, but it never answers. Zenoh waits ten seconds for each
//! stopped process.

use std::os::fd::OwnedFd;
use std::path::Path;

use nix::sys::socket::getsockopt;
use nix::sys::socket::sockopt::PeerCredentials;
use rustix::io::Errno;
use rustix::net::{self, AddressFamily, Shutdown, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::{Pid, PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};
use terminal::output;

/// The prefix of a Zenoh endpoint that is a socket of this machine.
const SOCKET: &str = "unixsock-stream/";

/// Result of a connection to the socket of a daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SocketPeer {
    /// A process that accepts connections, with its process id; `None` if it is in another PID
    /// namespace.
    Process(Option<Pid>),
    /// A process that accepts no connection, because the socket's queue in the kernel is full.
    Full,
}

/// Sorts endpoints so that those of running processes come first. Prints which processes are
/// stopped.
pub(super) fn running_first(endpoints: &[String]) -> Vec<String> {
    let (mut awake, mut stopped) = (Vec::new(), Vec::new());
    for endpoint in endpoints {
        match why_mute(endpoint) {
            Some(why) => stopped.push((endpoint.clone(), why)),
            None => awake.push(endpoint.clone()),
        }
    }
    for (endpoint, why) in &stopped {
        let instead = match awake.first() {
            Some(other) => format!("this command connects to {other}"),
            None => "this machine has no other, so this command waits for it".to_owned(),
        };
        output::print_note(&format!(
            "the daemon at {endpoint} does not respond ({why}); {instead}"
        ));
    }
    awake.extend(stopped.into_iter().map(|(endpoint, _)| endpoint));
    awake
}

/// Returns the endpoints, without those at which a stopped process listens.
pub(super) fn running(endpoints: &[String]) -> Vec<String> {
    endpoints.iter().filter(|endpoint| why_mute(endpoint).is_none()).cloned().collect()
}

/// Returns the reason why the daemon at an endpoint cannot answer, as text for a person. Returns
/// `None` if there is no such reason.
pub(super) fn why_mute(endpoint: &str) -> Option<String> {
    match listener(endpoint)? {
        SocketPeer::Full => Some("it accepts no connection".to_owned()),
        SocketPeer::Process(Some(process)) if is_frozen(process) => {
            Some(format!("the control group of process {process} is frozen"))
        }
        SocketPeer::Process(Some(process)) if is_stopped(process) => {
            Some(format!("process {process} is stopped; `kill -CONT {process}` lets it go on"))
        }
        SocketPeer::Process(_) => None,
    }
}

/// Whether this process has a connection to `process`; `true` if the kernel does not allow the
/// check.
pub(super) fn is_connected_to(process: Pid) -> bool {
    connections_to(process).is_none_or(|connections| !connections.is_empty())
}

/// Shuts down all connections of this process to `process`. Zenoh then connects to another daemon
/// at once, and not only when the link's lease has expired. Does nothing if the kernel does not
/// allow it.
pub(super) fn disconnect_from(process: Pid) {
    for connection in connections_to(process).unwrap_or_default() {
        let _ = net::shutdown(&connection, Shutdown::Both);
    }
}

/// Returns duplicates of those file descriptors of this process that are connected to `process`.
/// The originals belong to Zenoh. Returns `None` if the kernel does not allow duplicating them.
fn connections_to(process: Pid) -> Option<Vec<OwnedFd>> {
    let own = pidfd_open(getpid(), PidfdFlags::empty()).ok()?;
    let open = std::fs::read_dir("/proc/self/fd").ok()?;
    let numbers = open.flatten().filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let mut connections = Vec::new();
    for number in numbers.collect::<Vec<i32>>() {
        match pidfd_getfd(&own, number, PidfdGetfdFlags::empty()) {
            Ok(copy) => {
                let peer = getsockopt(&copy, PeerCredentials).ok();
                if peer.and_then(|peer| Pid::from_raw(peer.pid())) == Some(process) {
                    connections.push(copy);
                }
            }
            // The descriptor has been closed in the meantime.
            Err(Errno::BADF) => (),
            Err(_) => return None,
        }
    }
    Some(connections)
}

/// Returns the id of the process that listens at an endpoint of this machine; `None` if it is
/// unknown.
pub(super) fn process_at(endpoint: &str) -> Option<Pid> {
    match listener(endpoint)? {
        SocketPeer::Process(process) => process,
        SocketPeer::Full => None,
    }
}

/// Whether a process is stopped: by SIGSTOP, by a debugger, or together with its control group.
pub(super) fn is_stopped(process: Pid) -> bool {
    let about = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // The process name before it is in parentheses, and may contain any character.
    let state = about.rsplit_once(')').and_then(|(_, rest)| rest.trim_start().chars().next());
    matches!(state, Some('T' | 't')) || is_frozen(process)
}

/// Whether the control group (cgroup v2) of a process is frozen, as that of a paused container is.
fn is_frozen(process: Pid) -> bool {
    let groups = std::fs::read_to_string(format!("/proc/{process}/cgroup")).unwrap_or_default();
    let path = groups.lines().find_map(|line| line.strip_prefix("0::/"));
    // The path of a group outside this cgroup namespace begins with `..`.
    let path = path.filter(|path| !path.starts_with(".."));
    let events = path.map(|path| Path::new("/sys/fs/cgroup").join(path).join("cgroup.events"));
    let events = events.and_then(|path| std::fs::read_to_string(path).ok());
    events.is_some_and(|events| events.lines().any(|line| line == "frozen 1"))
}

/// Whether a process listens at a socket.
pub(super) fn is_listening(path: &Path) -> bool {
    try_connect(path).is_some()
}

fn listener(endpoint: &str) -> Option<SocketPeer> {
    let path = endpoint.strip_prefix(SOCKET)?;
    try_connect(Path::new(path.split(['#', '?']).next()?))
}

/// Connects to a socket without blocking, because a stopped process would block the command for
/// ever. Returns `None` if no process listens at the socket.
fn try_connect(path: &Path) -> Option<SocketPeer> {
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None).ok()?;
    match net::connect(&socket, &SocketAddrUnix::new(path).ok()?) {
        Ok(()) => {
            // The kernel reports process 0 for a peer in another PID namespace.
            let peer = getsockopt(&socket, PeerCredentials).ok();
            Some(SocketPeer::Process(peer.and_then(|peer| Pid::from_raw(peer.pid()))))
        }
        Err(Errno::AGAIN) => Some(SocketPeer::Full),
        Err(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;

    use super::*;

    #[test]
    fn a_full_socket_blocks_no_command() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.sock");
        assert_eq!(try_connect(&path), None);
        let listener = UnixListener::bind(&path).expect("a socket");
        net::listen(&listener, 0).expect("a short queue");
        let own = rustix::process::getpid();
        assert_eq!(try_connect(&path), Some(SocketPeer::Process(Some(own))));
        let _waiting: Vec<_> = (0..8).map_while(|_| is_free(&path)).collect();
        assert_eq!(try_connect(&path), Some(SocketPeer::Full));
        assert!(is_listening(&path) && !is_stopped(own));
    }

    #[test]
    fn connections_to_other_processes_are_left_alone() {
        use std::io::Read as _;
        use std::os::unix::net::UnixStream;
        use std::process::{Command, Stdio};
        let (mut own, far) = UnixStream::pair().expect("a pair");
        own.set_nonblocking(true).expect("a socket");
        let mut cat = Command::new("cat").stdin(Stdio::piped()).spawn().expect("a program");
        let process = Pid::from_raw(cat.id().try_into().expect("a process id")).expect("not 0");
        assert!(!is_connected_to(process) && is_connected_to(getpid()));
        disconnect_from(process);
        let read = own.read(&mut [0]).map_err(|error| error.kind());
        assert_eq!(read, Err(std::io::ErrorKind::WouldBlock), "both ends are of this process");
        assert!(!is_stopped(process));
        drop((cat.stdin.take(), far));
        cat.wait().expect("it ends");
    }

    /// Opens a connection if the socket's queue in the kernel has room for it; otherwise returns
    /// `None`.
    fn is_free(path: &Path) -> Option<OwnedFd> {
        let flags = SocketFlags::NONBLOCK;
        let socket = net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None);
        let socket = socket.expect("a socket");
        let address = SocketAddrUnix::new(path).expect("a path");
        net::connect(&socket, &address).is_ok().then_some(socket)
    }
}
