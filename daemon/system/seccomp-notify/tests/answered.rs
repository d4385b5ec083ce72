//! System calls of one thread that another thread answers.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd as _, AsRawFd as _};
use std::os::unix::net::UnixStream;
use std::sync::mpsc;
use std::time::Duration;

use seccomp_notify::{NotifyListener, Response, listen, program};

const PATIENCE: Option<Duration> = Some(Duration::from_secs(20));

/// Runs `work` on a thread with a filter for these system calls. Returns the listener of the
/// filter, and a channel with the result of `work`.
fn filtered<T: Send + 'static>(
    calls: &[libc::c_long],
    work: impl FnOnce() -> T + Send + 'static,
) -> (NotifyListener, mpsc::Receiver<T>) {
    let rules: BTreeMap<_, _> = calls.iter().map(|call| (number(*call), Vec::new())).collect();
    let target = std::env::consts::ARCH.try_into().expect("a machine with seccomp");
    let program = program(rules, target).expect("a program");
    let (tell, told) = mpsc::channel();
    let (tell_result, result) = mpsc::channel();
    std::thread::spawn(move || {
        tell.send(listen(&program).expect("a kernel since 5.9")).expect("the test waits");
        let _ = tell_result.send(work());
    });
    (told.recv().expect("it was installed"), result)
}

fn result<T>(results: &mpsc::Receiver<T>) -> T {
    results.recv_timeout(PATIENCE.expect("some")).expect("it is answered")
}

#[test]
fn a_call_is_refused_pretended_or_done() {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = ["refused", "pretended", "done"].map(|name| folder.path().join(name));
    let made = paths.clone();
    let calls = [libc::SYS_mkdirat, mkdir()];
    let (listener, results) = filtered(&calls, move || made.map(fs::create_dir));
    for response in [Response::Error(libc::EACCES), Response::Value(0), Response::Continue] {
        let call = listener.next(PATIENCE).expect("it says").expect("it waits");
        assert!(calls.map(number).contains(&call.call), "{call:?}");
        assert!(listener.is_waiting(call.id));
        listener.respond(call.id, response).expect("it is taken");
        assert!(!listener.is_waiting(call.id));
    }
    let [refused, pretended, done] = result(&results);
    assert_eq!(refused.expect_err("refused").raw_os_error(), Some(libc::EACCES));
    assert!(pretended.is_ok() && done.is_ok());
    assert_eq!(paths.map(|path| path.exists()), [false, false, true]);
    assert_eq!(listener.next(PATIENCE).expect("it says"), None, "nobody has the filter any more");
}

#[test]
fn a_file_is_put_in_place_of_another() {
    let (ours, mut theirs) = UnixStream::pair().expect("a pair");
    let mut file = tempfile::tempfile().expect("a file");
    let number = file.as_raw_fd().unsigned_abs();
    let (listener, results) = filtered(&[libc::SYS_fsync], move || -> io::Result<()> {
        file.sync_all()?;
        // The supervisor has replaced the file with a socket.
        file.write_all(b"hello")
    });
    let call = listener.next(PATIENCE).expect("it says").expect("it waits");
    assert_eq!(call.arguments[0], u64::from(number));
    listener.put_file(call.id, ours.as_fd(), number, true).expect("it is put");
    drop(ours);
    listener.respond(call.id, Response::Value(0)).expect("it is taken");
    result(&results).expect("written");
    let mut heard = [0; 5];
    theirs.read_exact(&mut heard).expect("heard");
    assert_eq!(&heard, b"hello");
}

#[test]
fn a_listener_is_handed_over_with_a_message() {
    let (one, other) = UnixStream::pair().expect("a pair");
    let (listener, results) =
        filtered(&[libc::SYS_fsync], || tempfile::tempfile().and_then(|file| file.sync_all()));
    seccomp_notify::send(one.as_fd(), b"here", Some(&listener)).expect("sent");
    drop(listener);
    let mut buffer = [0; 64];
    let (length, listener) = seccomp_notify::receive(other.as_fd(), &mut buffer).expect("received");
    assert_eq!(&buffer[..length], b"here");
    let listener = listener.expect("it came along");
    let call = listener.next(PATIENCE).expect("it says").expect("it waits");
    listener.respond(call.id, Response::Error(libc::EIO)).expect("it is taken");
    assert_eq!(result(&results).expect_err("refused").raw_os_error(), Some(libc::EIO));
}

#[test]
fn a_listener_waits_no_longer_than_its_limit() {
    let (go, wait) = mpsc::channel::<()>();
    let (listener, _results) = filtered(&[libc::SYS_fsync], move || wait.recv());
    assert_eq!(listener.next(Some(Duration::from_millis(10))).expect("it says"), None);
    drop(go);
}

#[allow(clippy::useless_conversion, reason = "a C long has 32 bits on some boards")]
fn number(call: libc::c_long) -> i64 {
    i64::from(call)
}

/// Returns the number of the system call `mkdir`, or of `mkdirat` on architectures without `mkdir`.
fn mkdir() -> libc::c_long {
    #[cfg(target_arch = "x86_64")]
    return libc::SYS_mkdir;
    #[cfg(not(target_arch = "x86_64"))]
    return libc::SYS_mkdirat;
}
