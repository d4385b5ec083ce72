//! Contents of the sockets and pipes of a plugin: the memory of their buffers, and descriptors that
//! are queued in messages and not received yet. A file can have its only descriptor in such a
//! message.
//!
//! Neither belongs to a process, and therefore [`usage`](crate::usage) does not count them. The
//! filter of system calls keeps the buffers at their default size if no control group counts them.
//! Connections that are not accepted yet are not counted here.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;

use rustix::process::{Pid, PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};

/// Returns the bytes of memory that the buffers of the sockets and pipes of these processes may
/// take. A buffer with any content counts with its whole size, because small messages take more
/// memory than their length. A buffer that cannot be inspected counts as empty.
pub(crate) fn memory(processes: impl Iterator<Item = i32>) -> u64 {
    let mut known = BTreeSet::new();
    let mut bytes = 0;
    for process in processes {
        let handle = Pid::from_raw(process).map(|process| pidfd_open(process, PidfdFlags::empty()));
        let Some(Ok(handle)) = handle else { continue };
        for (descriptor, link) in descriptors(process).unwrap_or_default() {
            let is_pipe = link.starts_with("pipe:[");
            if (is_pipe || link.starts_with("socket:[")) && !known.contains(&link) {
                let copy = pidfd_getfd(&handle, descriptor, PidfdGetfdFlags::empty());
                bytes += copy.map_or(0, |copy| buffer_of(&copy, is_pipe));
                known.insert(link);
            }
        }
    }
    bytes
}

/// Returns the size in bytes of the buffer of a pipe or socket; 0 if the buffer is empty.
fn buffer_of(end: &OwnedFd, is_pipe: bool) -> u64 {
    let content = rustix::io::ioctl_fionread(end).unwrap_or(0);
    if content == 0 {
        return 0;
    }
    let size = match is_pipe {
        true => rustix::pipe::fcntl_getpipe_size(end.as_fd()),
        false => rustix::net::sockopt::socket_send_buffer_size(end.as_fd()),
    };
    content.max(size.map_or(0, |size| size as u64))
}

/// Returns the number of descriptors in messages that these processes have not received.
///
/// # Errors
///
/// Returns the error about the first process that cannot be inspected, with its number.
pub(crate) fn in_flight(processes: impl Iterator<Item = i32>) -> Result<u64, (i32, io::Error)> {
    let mut known = BTreeSet::new();
    let mut count = 0;
    for process in processes {
        for (descriptor, link) in descriptors(process).map_err(|error| (process, error))? {
            if link.starts_with("socket:[") && known.insert(link) {
                let about = format!("/proc/{process}/fdinfo/{descriptor}");
                // The descriptor may have been closed in the meantime.
                let about = fs::read_to_string(about).unwrap_or_default();
                count += scm_files(&about);
            }
        }
    }
    Ok(count)
}

/// Returns the number of descriptors in the queue of a Unix socket, from the text of its `fdinfo`.
fn scm_files(about: &str) -> u64 {
    let number = about.lines().find_map(|line| line.strip_prefix("scm_fds:"));
    number.and_then(|number| number.trim().parse().ok()).unwrap_or(0)
}

/// Returns the descriptors of a process, each with the target of its link in `/proc`.
fn descriptors(process: i32) -> io::Result<Vec<(i32, String)>> {
    let folder = format!("/proc/{process}/fd");
    let mut all = Vec::new();
    for entry in fs::read_dir(Path::new(&folder))? {
        let entry = entry?;
        let number = entry.file_name().to_str().and_then(|name| name.parse().ok());
        // The descriptor may have been closed in the meantime.
        if let (Some(number), Ok(link)) = (number, fs::read_link(entry.path())) {
            all.push((number, link.to_string_lossy().into_owned()));
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use std::io::{IoSlice, Write as _};
    use std::mem::MaybeUninit;
    use std::os::unix::net::UnixStream;

    use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};

    use super::*;

    fn own() -> impl Iterator<Item = i32> {
        std::iter::once(rustix::process::getpid().as_raw_nonzero().get())
    }

    /// No other test of this process passes descriptors on.
    #[test]
    fn contents_of_sockets_and_pipes_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let (near, mut far) = UnixStream::pair().expect("a pair");
        let (reader, mut writer) = std::io::pipe().expect("a pipe");
        let before = in_flight(own()).expect("this process");
        far.write_all(b"1").expect("there is room");
        writer.write_all(b"1").expect("there is room");
        let size = rustix::net::sockopt::socket_send_buffer_size(&near).expect("a socket");
        let capacity = rustix::pipe::fcntl_getpipe_size(&reader).expect("a pipe");
        assert!(memory(own()) >= (size + capacity) as u64);

        let file = fs::File::create(folder.path().join("file")).expect("a file");
        let files = [file.as_fd()];
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut control = SendAncillaryBuffer::new(&mut space);
        assert!(control.push(SendAncillaryMessage::ScmRights(&files)));
        let sent = sendmsg(&far, &[IoSlice::new(b"2")], &mut control, SendFlags::empty());
        assert_eq!(sent.expect("it is sent"), 1);
        assert_eq!(in_flight(own()).expect("this process"), before + 1);
        drop(near);
        assert_eq!(in_flight(own()).expect("this process"), before, "it is gone with its socket");
    }

    #[test]
    fn descriptors_in_flight_are_read_from_fdinfo() {
        assert_eq!(scm_files("pos:\t0\nflags:\t02\nmnt_id:\t9\nino:\t7\nscm_fds: 3\n"), 3);
        assert_eq!(scm_files("pos:\t0\nflags:\t02\n"), 0);
        assert_eq!(scm_files("scm_fds: nonsense\n"), 0);
    }
}
