//! By which daemon of this machine a command joins: one that runs before one that was stopped.
//!
//! A stopped process (SIGSTOP, a debugger, a frozen container) still accepts connections, because the
//! kernel does that for it, and then says nothing. Zenoh waits ten seconds for each of them.

use std::os::unix::net::UnixStream;
use std::path::Path;

use terminal::output;

/// How Zenoh names a socket of this machine.
const SOCKET: &str = "unixsock-stream/";

/// The same endpoints, those of processes that run first; says which stand still.
pub(super) fn awake_first(endpoints: &[String]) -> Vec<String> {
    let (mut awake, mut stopped) = (Vec::new(), Vec::new());
    for endpoint in endpoints {
        match stopped_at(endpoint) {
            Some(process) => stopped.push((endpoint.clone(), process)),
            None => awake.push(endpoint.clone()),
        }
    }
    for (endpoint, process) in &stopped {
        let instead = match awake.first() {
            Some(other) => format!("this command joins by {other}"),
            None => "there is no other here, so this command waits for it".to_owned(),
        };
        output::note(&format!(
            "the daemon at {endpoint} stands still (process {process} is stopped; `kill -CONT \
             {process}` lets it go on); {instead}"
        ));
    }
    awake.extend(stopped.into_iter().map(|(endpoint, _)| endpoint));
    awake
}

/// The stopped process behind an endpoint of this machine, if it is one.
pub(super) fn stopped_at(endpoint: &str) -> Option<i32> {
    let path = endpoint.strip_prefix(SOCKET)?;
    let process = server_of(Path::new(path.split(['#', '?']).next()?))?;
    let about = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name before it is in parentheses, and may hold any character.
    let state = about.rsplit_once(')')?.1.trim_start().chars().next()?;
    matches!(state, 'T' | 't').then_some(process)
}

/// The process that listens at a socket.
fn server_of(path: &Path) -> Option<i32> {
    // Asking Tokio's stream needs its runtime, in which every command runs.
    tokio::runtime::Handle::try_current().ok()?;
    let stream = UnixStream::connect(path).ok()?;
    stream.set_nonblocking(true).ok()?;
    let stream = tokio::net::UnixStream::from_std(stream).ok()?;
    stream.peer_cred().ok()?.pid()
}
