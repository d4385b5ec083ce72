//! What a daemon is known by: its key and certificate, the seals on what it says, and whom nobody
//! believes any more.
//!
//! - [`Authority`] makes certificates and revokes them; its key stays where it was made.
//! - [`Folder`] says which file is which, and refuses a key that others can read.
//! - [`AnswerKey`] opens what people answer, [`seal_answer`] seals it.
//! - [`Identity`] seals what a daemon says, [`Verifier`] opens what it hears.
//!
//! One Ed25519 key per daemon serves TLS and seals; what is signed begins with a text of its own
//! in each, so that neither can be taken for the other. Knows nothing of Zenoh, nor of rights: who
//! may say what is decided above.
//!
//! Keys never leave this crate but as files, and nothing here is logged or shown that holds one.

mod answer;
mod authority;
mod certificate;
mod error;
mod files;
mod identity;
mod rate;
mod replay;
mod revocations;
mod seal;
mod trust;
mod verifier;

pub use answer::{AnswerKey, SealError, seal_answer};
pub use authority::{AUTHORITY_DAYS, Authority, DAEMON_DAYS};
pub use certificate::Certificate;
pub use error::{CredentialError, Distrust};
pub use files::Folder;
pub use identity::{Channel, Identity, Said};
pub use revocations::Revocations;
pub use seal::{NONCE_BYTES, Nonce, nonce};
pub use trust::Trust;
pub use verifier::{Sealed, Verified, Verifier};

use acl::DaemonId;

/// The longest name of a daemon that has a certificate: a guest's is longer.
const CERTIFIED_NAME_BYTES_MAX: usize = 40;

/// Whether a certificate may be made out to this name.
fn is_certifiable(name: &DaemonId) -> bool {
    name.as_str().len() <= CERTIFIED_NAME_BYTES_MAX && !name.is_guest()
}

#[cfg(test)]
mod tests;
