//! A process whose place among the others is lost begins anew, under its process id: what it was at is
//! known from disk and from the Journals, as after any death.

use std::ffi::CString;
use std::os::unix::ffi::OsStringExt as _;

use nix::unistd::execv;

/// Begins anew; returns if that fails.
pub(crate) fn begin_anew() {
    give_up_sockets();
    // An argument came from a string of C's, and so it has no zero within.
    let arguments: Vec<_> =
        std::env::args_os().filter_map(|each| CString::new(each.into_vec()).ok()).collect();
    // The file that runs, also if another has been put in its place. Not by `std::process`, which
    // first gives up ignoring SIGPIPE, of which this process then dies: others have closed the
    // links that its other threads write to.
    let Err(error) = execv(c"/proc/self/exe", &arguments);
    tracing::error!(%error, "could not begin anew; some may not see this daemon");
}

/// Lets the next life take the sockets. Zenoh locks a file beside each, and alone of all that is
/// open this is not closed with the program; a file of the same name is another.
fn give_up_sockets() {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else { return };
    let targets = open.flatten().filter_map(|entry| std::fs::read_link(entry.path()).ok());
    for path in targets.filter(|path| path.to_string_lossy().ends_with(".sock.lock")) {
        // Then the next life says what it could not open.
        let _ = std::fs::remove_file(path);
    }
}
