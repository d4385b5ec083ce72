//
// NOTE(althing): this file is not in the crate as published. It is under the licence of the crate.
//
//! Whose bytes a thread is at. A transport takes apart what it has read before it reads on, in the
//! same poll of its task; of what it could not put together it says only that there was something.

use std::{cell::RefCell, sync::Arc};

/// Who is at the other end of a link.
#[derive(Debug)]
pub struct Peer {
    /// The file of the key that this end of the link shows.
    pub key_file: Arc<str>,
    /// The common name in the certificate that was shown.
    pub name: Option<String>,
}

thread_local! {
    static AT: RefCell<Option<Arc<Peer>>> = const { RefCell::new(None) };
}

/// Whose bytes this thread has read last and is still at; nobody's, if they came over no TLS link.
pub fn peer() -> Option<Arc<Peer>> {
    AT.with_borrow(Clone::clone)
}

/// A link is about to read: what it read before has been dealt with.
pub(crate) fn begins() {
    AT.set(None);
}

/// A link has read from this peer.
pub(crate) fn ends(peer: &Arc<Peer>) {
    AT.set(Some(Arc::clone(peer)));
}
