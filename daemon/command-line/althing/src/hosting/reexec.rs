//! Restarts this program in place, under the same process id, when the other daemons count it as
//! gone. As after any crash, the state is then read from disk and from the Journals.

use std::ffi::CString;
use std::os::unix::ffi::OsStringExt as _;

use nix::unistd::execv;

/// Restarts this program. Returns only if the restart fails.
pub(crate) fn restart_process() {
    give_up_sockets();
    // The arguments came from C strings, so they contain no zero byte.
    let arguments: Vec<_> =
        std::env::args_os().filter_map(|each| CString::new(each.into_vec()).ok()).collect();
    // Executes the file of the running program, even if the file at its path has been replaced.
    // `std::process` is not used, because it first resets SIGPIPE to its default. This process
    // would then end by that signal, because other daemons have closed the links to which its other
    // threads write.
    let Err(error) = execv(c"/proc/self/exe", &arguments);
    tracing::error!(%error, "failed to restart this daemon; some others may not see it");
}

/// Removes the lock files beside the daemon's sockets, so that the next incarnation can use the
/// same sockets. Zenoh holds a lock on each of these files, and leaves their descriptors open on
/// `exec`. A new lock file of the same name can be locked again.
fn give_up_sockets() {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else { return };
    let targets = open.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok());
    for path in targets.filter(|path| path.to_string_lossy().ends_with(".sock.lock")) {
        // If that fails, the next incarnation reports that it could not open its socket.
        let _ = std::fs::remove_file(path);
    }
}
