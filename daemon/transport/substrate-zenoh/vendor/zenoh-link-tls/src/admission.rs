//
// NOTE(althing): this file is not in the crate as published. It is under the licence of the crate.
//
//! Whom links are made with, and kept with, beyond what the authority has signed: TLS knows
//! revocations, Zenoh's configuration does not.
//!
//! It is told as well of whom no link was made with, because of what TLS itself found wrong.
//!
//! Whoever opens a session says so by the file of its private key, which no two share but a daemon
//! and its guests. Of several who decide over one key, all must agree.

use std::{
    collections::HashMap,
    net::SocketAddr,
    sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, Weak},
};

use tokio::sync::watch;

/// Whether a link may be with who shows this certificate, in DER, from this address.
pub type Admits = dyn Fn(&[u8], SocketAddr) -> bool + Send + Sync;

/// Told of a link that was not made with who is at this address, and why.
pub type Refused = dyn Fn(SocketAddr, &str) + Send + Sync;

/// Decides over the links of one key for as long as it is held.
pub struct Admission {
    admits: Box<Admits>,
    refused: Box<Refused>,
    looks: watch::Sender<()>,
}

/// Who decides over the links of one key. There are as many keys as daemons in this process.
#[derive(Default)]
struct Deciding {
    admissions: Vec<Weak<Admission>>,
    /// Told whenever the links that there are have to be looked at again.
    looks: watch::Sender<()>,
}

/// By the file of the key.
static DECIDING: LazyLock<Mutex<HashMap<String, Deciding>>> = LazyLock::new(Mutex::default);

/// Lets `admits` decide over the links that show the key in `key_file`, and tells `refused` of those
/// that TLS did not let come about.
pub fn decide(
    key_file: String,
    admits: impl Fn(&[u8], SocketAddr) -> bool + Send + Sync + 'static,
    refused: impl Fn(SocketAddr, &str) + Send + Sync + 'static,
) -> Arc<Admission> {
    let mut deciding = deciding();
    let Deciding { admissions, looks } = deciding.entry(key_file).or_default();
    let (admits, refused) = (Box::new(admits), Box::new(refused));
    let admission = Arc::new(Admission { admits, refused, looks: looks.clone() });
    admissions.retain(|each| each.strong_count() > 0);
    admissions.push(Arc::downgrade(&admission));
    admission
}

impl Admission {
    /// Closes the links that are not admitted any more.
    pub fn look_again(&self) {
        self.looks.send_replace(());
    }
}

/// Whether a link that shows this key may be with who shows this certificate.
pub(crate) fn admits(key_file: &str, certificate: &[u8], from: SocketAddr) -> bool {
    of_key(key_file).iter().all(|each| (each.admits)(certificate, from))
}

/// A link that shows this key was not made with who is at this address.
pub(crate) fn refused(key_file: &str, from: SocketAddr, why: &str) {
    of_key(key_file).iter().for_each(|each| (each.refused)(from, why));
}

fn of_key(key_file: &str) -> Vec<Arc<Admission>> {
    match deciding().get(key_file) {
        Some(Deciding { admissions, .. }) => admissions.iter().filter_map(Weak::upgrade).collect(),
        None => Vec::new(),
    }
}

/// What changes when the links that show this key have to be looked at again.
pub(crate) fn looks(key_file: &str) -> watch::Receiver<()> {
    deciding().entry(key_file.to_owned()).or_default().looks.subscribe()
}

fn deciding() -> MutexGuard<'static, HashMap<String, Deciding>> {
    DECIDING.lock().unwrap_or_else(PoisonError::into_inner)
}
