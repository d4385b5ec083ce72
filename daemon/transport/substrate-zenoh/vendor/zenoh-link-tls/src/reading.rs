//
// NOTE(althing): this file is not in the crate as published. It is under the licence of the crate.
//
//! Whose bytes a task is at. A transport takes apart what it has read before it reads on, in the
//! same poll of its task; of what it could not put together it says only that there was something.

use std::{cell::RefCell, sync::Arc};

use tokio::task::{self, Id};

/// Who is at the other end of a link.
#[derive(Debug)]
pub struct Peer {
    /// The file of the key that this end of the link shows.
    pub key_file: Arc<str>,
    /// The common name in the certificate that was shown.
    pub name: Option<String>,
}

thread_local! {
    /// The task that has read last on this thread, and from whom. Others may have run here since.
    static LAST: RefCell<Option<(Id, Arc<Peer>)>> = const { RefCell::new(None) };
}

/// Whose bytes this task is at; nobody's, if they came over no TLS link.
pub fn peer() -> Option<Arc<Peer>> {
    let this = task::try_id()?;
    let is_this = |(task, _): &&(Id, Arc<Peer>)| *task == this;
    LAST.with_borrow(|last| last.as_ref().filter(is_this).map(|(_, peer)| Arc::clone(peer)))
}

/// A link has read from this peer.
pub(crate) fn has_read(peer: &Arc<Peer>) {
    LAST.set(task::try_id().map(|task| (task, Arc::clone(peer))));
}
