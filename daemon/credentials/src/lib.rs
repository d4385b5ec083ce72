//! Credentials of daemons: keys and certificates, the seals on messages, and revocations.
//!
//! - [`Authority`] makes certificates and revokes them; its key stays where it was made.
//! - [`CredentialFolder`] names the files, and refuses a key that other users can read.
//! - [`AnswerKey`] opens the answers of people, [`seal_answer`] seals them.
//! - [`DaemonIdentity`] seals outgoing messages, [`Verifier`] opens incoming ones.
//!
//! One Ed25519 key per daemon serves TLS and seals. The signed bytes begin with a different text in each,
//! so that a signature for one is never valid for the other. This crate knows nothing of Zenoh, nor of
//! rights: which daemon may send which message is decided in higher layers.
//!
//! Keys never leave this crate except as files, and no value that holds one is logged or shown.

mod answer;
mod authority;
mod certificate;
mod error;
mod files;
mod identity;
mod replay;
mod revocations;
mod seal;
mod token_bucket;
mod trust;
mod verifier;

pub use answer::{AnswerKey, SealError, seal_answer};
pub use authority::{AUTHORITY_DAYS, Authority, DAEMON_DAYS};
pub use certificate::Certificate;
pub use error::{CredentialError, DistrustReason};
pub use files::CredentialFolder;
pub use identity::{DaemonIdentity, SealChannel, SequenceState};
pub use revocations::Revocations;
pub use seal::{NONCE_BYTES, Nonce, nonce};
pub use trust::Trust;
pub use verifier::{SealedMessage, VerifiedOrigin, Verifier};

use acl::DaemonId;

/// Maximum length of a certified daemon name, in bytes; the name of a guest is longer.
const CERTIFIED_NAME_BYTES_MAX: usize = 40;

/// Whether a certificate may be issued for this name.
fn is_certifiable(name: &DaemonId) -> bool {
    name.as_str().len() <= CERTIFIED_NAME_BYTES_MAX && !name.is_guest()
}

#[cfg(test)]
mod tests;
