//
// NOTE(althing): this file is not in the crate as published. It is under the licence of the crate.
//
//! Whom links are made with, and kept with, beyond what the authority has signed: TLS knows
//! revocations, Zenoh's configuration does not.
//!
//! Whoever opens a session says so by the file of its private key, which no two share but a daemon
//! and its guests. Of several who decide over one key, all must agree.

use std::{
    collections::HashMap,
    sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, Weak},
};

use tokio::sync::watch;

/// Whether a link may be with who shows this certificate, in DER.
pub type Admits = dyn Fn(&[u8]) -> bool + Send + Sync;

/// Decides over the links of one key for as long as it is held.
pub struct Admission {
    admits: Box<Admits>,
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

/// Lets `admits` decide over the links that show the key in `key_file`.
pub fn decide(
    key_file: String,
    admits: impl Fn(&[u8]) -> bool + Send + Sync + 'static,
) -> Arc<Admission> {
    let mut deciding = deciding();
    let Deciding { admissions, looks } = deciding.entry(key_file).or_default();
    let admission = Arc::new(Admission { admits: Box::new(admits), looks: looks.clone() });
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
pub(crate) fn admits(key_file: &str, certificate: &[u8]) -> bool {
    let admissions: Vec<_> = match deciding().get(key_file) {
        Some(Deciding { admissions, .. }) => admissions.iter().filter_map(Weak::upgrade).collect(),
        None => return true,
    };
    admissions.iter().all(|each| (each.admits)(certificate))
}

/// What changes when the links that show this key have to be looked at again.
pub(crate) fn looks(key_file: &str) -> watch::Receiver<()> {
    deciding().entry(key_file.to_owned()).or_default().looks.subscribe()
}

fn deciding() -> MutexGuard<'static, HashMap<String, Deciding>> {
    DECIDING.lock().unwrap_or_else(PoisonError::into_inner)
}
