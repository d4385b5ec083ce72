//! What can be wrong with files and certificates, and why something heard is not believed.

use std::io;
use std::path::PathBuf;

/// Why a credential cannot be made or used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CredentialError {
    /// A file or a folder cannot be used.
    #[error("use {}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// A file that is needed is not there.
    #[error("find {what}: there is no {}; {remedy}", path.display())]
    Missing {
        /// What it is.
        what: &'static str,
        /// Where it was looked for.
        path: PathBuf,
        /// What would be right.
        remedy: String,
    },
    /// Somebody else could read a key.
    #[error(
        "use the key {0}: others can read it (mode {mode:03o}); make it yours alone: chmod 600 {0}",
        path.display()
    )]
    Loose {
        /// The key.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// Anybody on this machine can put another in its place.
    #[error("trust {0}: anybody can write it (mode {mode:03o}); take that right away: chmod o-w {0}",
        path.display())]
    Writable {
        /// The file, or its folder.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file is not what it should be.
    #[error("read {}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// What is to be made is there already.
    #[error("make {}: it is there already, and what it has signed would be worth nothing without \
             it; move the folder away first, if that is meant", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// No certificate can be made out to this name.
    #[error(
        "make a certificate for `{0}`: of a daemon with a certificate the name has at most 40 \
         letters and no `--`, which stands in those of its guests"
    )]
    Name(String),
    /// A host name that cannot stand in a certificate.
    #[error("put `{0}` into a certificate: write a host name or an IP address")]
    Host(String),
    /// Nobody of this name has a certificate of this authority.
    #[error("revoke `{name}`: this authority has given it no certificate{}", others(known))]
    Unknown {
        /// The name.
        name: String,
        /// Who has one.
        known: Vec<String>,
    },
    /// The library that makes certificates declined.
    #[error("make a certificate: {0}")]
    Making(#[from] rcgen::Error),
    /// A certificate is not worth anything here.
    #[error("use the certificate {}: {why}", path.display())]
    Distrusted {
        /// The file.
        path: PathBuf,
        /// Why.
        why: Distrust,
    },
}

fn others(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; it has given some to {}", names.join(", ")),
    }
}

/// Why something heard is not believed. Completes “the message …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum Distrust {
    /// It has no seal.
    #[error("is not signed")]
    Unsigned,
    /// The seal cannot be read.
    #[error("has a seal that cannot be read")]
    Malformed,
    /// The certificate is not this authority's, or not one that may speak.
    #[error("is signed with a certificate that the ecosystem's authority has not made")]
    Stranger,
    /// The certificate is not valid yet, or no longer.
    #[error("is signed with a certificate that is not valid at this time")]
    Expired,
    /// The certificate was taken back.
    #[error("is signed with a certificate that was revoked")]
    Revoked,
    /// The signature is not one over this message.
    #[error("has a signature that is not one over it: it was changed, or signed by another")]
    Forged,
    /// The speaker's name is not the certificate's.
    #[error("is signed by a daemon in the name of another")]
    Impostor,
    /// It was heard before, or is of a former life.
    #[error("was heard before, or is of a former life")]
    Replayed,
    /// It is for another life of who heard it.
    #[error("is for a former life of this daemon: somebody plays it again, or its sender is late")]
    Belated,
    /// It was sealed too long ago.
    #[error("was held back for longer than anybody waits for it")]
    Overdue,
    /// Its sender has not been called yet, or had not when it said this: it may be old.
    #[error("was said before its daemon was called")]
    Uncalled,
    /// Its sender speaks too much.
    #[error("is one of too many")]
    Flooded,
}
