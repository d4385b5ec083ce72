//! Chooses the daemon of this machine through which a command joins. Running daemons are tried
//! before stopped ones.
//!
//! A stopped process (SIGSTOP, a debugger, a frozen container) still accepts connections, because
//! the kernel accepts them for it, but it never answers. Zenoh waits ten seconds for each stopped
//! process.

use std::path::Path;

use nix::sys::socket::getsockopt;
use nix::sys::socket::sockopt::PeerCredentials;
use rustix::io::Errno;
use rustix::net::{self, AddressFamily, SocketAddrUnix, SocketFlags, SocketType};
use rustix::process::Pid;
use terminal::output;

/// The prefix of a Zenoh endpoint that is a socket of this machine.
const SOCKET: &str = "unixsock-stream/";

/// The process that listens at a socket, as far as it can be known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SocketPeer {
    /// A process that accepts connections, with its process id; `None` if it is in another PID
    /// namespace.
    Process(Option<Pid>),
    /// A process that accepts no connection, because the socket's queue in the kernel is full.
    Full,
}

/// Returns the endpoints in another order: those of running processes first. Tells the user which
/// processes are stopped.
pub(super) fn running_first(endpoints: &[String]) -> Vec<String> {
    let (mut awake, mut stopped) = (Vec::new(), Vec::new());
    for endpoint in endpoints {
        let why = match listener(endpoint) {
            Some(SocketPeer::Full) => Some("it accepts no connection".to_owned()),
            Some(SocketPeer::Process(Some(process))) if is_stopped(process) => {
                Some(format!("process {process} is stopped; `kill -CONT {process}` lets it go on"))
            }
            _ => None,
        };
        match why {
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

/// Returns the id of the process that listens at an endpoint of this machine; `None` if it is
/// unknown.
pub(super) fn process_at(endpoint: &str) -> Option<Pid> {
    match listener(endpoint)? {
        SocketPeer::Process(process) => process,
        SocketPeer::Full => None,
    }
}

/// Whether a process is stopped, by SIGSTOP or by a debugger.
pub(super) fn is_stopped(process: Pid) -> bool {
    let about = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // The process name before it is in parentheses, and may contain any character.
    let state = about.rsplit_once(')').and_then(|(_, rest)| rest.trim_start().chars().next());
    matches!(state, Some('T' | 't'))
}

/// Whether a process listens at a socket.
pub(super) fn is_listening(path: &Path) -> bool {
    try_connect(path).is_some()
}

fn listener(endpoint: &str) -> Option<SocketPeer> {
    let path = endpoint.strip_prefix(SOCKET)?;
    try_connect(Path::new(path.split(['#', '?']).next()?))
}

/// Connects to a socket without blocking: a stopped process would block the command for ever.
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
    fn a_process_that_takes_no_more_connections_keeps_nobody_waiting() {
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

    /// Opens a connection if the socket's queue in the kernel has room for it; otherwise returns
    /// `None`.
    fn is_free(path: &Path) -> Option<std::os::fd::OwnedFd> {
        let flags = SocketFlags::NONBLOCK;
        let socket = net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None);
        let socket = socket.expect("a socket");
        let address = SocketAddrUnix::new(path).expect("a path");
        net::connect(&socket, &address).is_ok().then_some(socket)
    }
}
