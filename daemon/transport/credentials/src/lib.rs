//! Credentials of daemons: keys and certificates, the seals on messages, and revocations.
//!
//! - [`Authority`] issues certificates and revokes them; the key of the authority stays where it
//!   was made.
//! - [`PageAuthority`] issues the certificates by which browsers know the pages of daemons.
//! - [`CredentialFolder`] gives the paths of the files in a folder of credentials. A key that other
//!   users can read is refused.
//! - [`AnswerKey`] opens the answers of people; [`seal_answer`] seals them.
//! - [`DaemonIdentity`] seals outgoing messages; [`Verifier`] verifies the seals of incoming ones.
//!
//! Each daemon has one Ed25519 key, which serves both TLS and seals; a page for browsers has another. The signed bytes begin with a
//! different text for each use, so that a signature for one use is never valid for the other. This
//! crate does not depend on Zenoh and does not handle rights: which daemon may send which message
//! is decided in higher layers.
//!
//! Keys never leave this crate except as files, and no value that holds a key is logged or shown.

mod answer;
mod authority;
mod certificate;
mod error;
mod files;
mod identity;
mod page_authority;
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
pub use identity::{DaemonIdentity, SequenceState};
pub use page_authority::{PAGE_DAYS, PageAuthority};
pub use revocations::Revocations;
pub use seal::{NONCE_BYTES, Nonce, SealChannel, nonce};
pub use trust::Trust;
pub use verifier::{SealedMessage, VerifiedOrigin, Verifier};

use acl::DaemonId;

/// Maximum length of a daemon's name in a certificate, in bytes. No certificate is issued or
/// accepted for a longer name. The name of a guest may be longer.
const CERTIFIED_NAME_BYTES_MAX: usize = 40;

/// Whether a certificate may be issued for the daemon `name`.
fn is_certifiable(name: &DaemonId) -> bool {
    name.as_str().len() <= CERTIFIED_NAME_BYTES_MAX && !name.is_guest()
}

#[cfg(test)]
mod tests;
