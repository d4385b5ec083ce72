//! Passing of a listener to its supervisor over a Unix socket, together with a message.

use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd};

use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, recvmsg, sendmsg,
};

use crate::NotifyListener;

/// Sends a message over a Unix socket, together with `listener` if it is given. The message must
/// not be empty, and must be shorter than a pipe's buffer, so that it is sent in one piece.
///
/// # Errors
///
/// Returns an error if the socket does not accept the message.
pub fn send(
    socket: BorrowedFd<'_>,
    message: &[u8],
    listener: Option<&NotifyListener>,
) -> io::Result<()> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut ancillary = SendAncillaryBuffer::new(&mut space);
    let files = listener.map(|listener| [listener.as_fd()]);
    if let Some(files) = &files
        && !ancillary.push(SendAncillaryMessage::ScmRights(files))
    {
        return Err(io::Error::other("there is no room for a descriptor"));
    }
    let sent = sendmsg(socket, &[IoSlice::new(message)], &mut ancillary, SendFlags::NOSIGNAL)?;
    match sent == message.len() {
        true => Ok(()),
        false => Err(io::ErrorKind::WriteZero.into()),
    }
}

/// Receives a message over a Unix socket, and the listener that was sent with it; `None` if there
/// was no listener. Also returns the number of bytes in `buffer`; if the message is longer than
/// `buffer`, its end is lost. Blocks if the socket does.
///
/// # Errors
///
/// Returns an error if reading from the socket fails.
pub fn receive(
    socket: BorrowedFd<'_>,
    buffer: &mut [u8],
) -> io::Result<(usize, Option<NotifyListener>)> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
    let mut ancillary = RecvAncillaryBuffer::new(&mut space);
    let flags = RecvFlags::CMSG_CLOEXEC;
    let received = recvmsg(socket, &mut [IoSliceMut::new(buffer)], &mut ancillary, flags)?;
    let files = ancillary.drain().filter_map(|message| match message {
        RecvAncillaryMessage::ScmRights(files) => Some(files),
        _ => None,
    });
    let listener = files.flatten().next().map(NotifyListener::from);
    Ok((received.bytes, listener))
}
