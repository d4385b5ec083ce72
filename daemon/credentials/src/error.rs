//! Errors of files and certificates, and the reasons why a message is not believed.

use std::io;
use std::path::PathBuf;

/// Why a credential cannot be made or used. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CredentialError {
    /// A file or a folder cannot be used.
    #[error("use {}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        #[source]
        source: io::Error,
    },
    /// A required file does not exist.
    #[error("find {what}: there is no {}; {remedy}", path.display())]
    Missing {
        /// Description of the file.
        what: &'static str,
        /// Path at which it was looked for.
        path: PathBuf,
        /// The remedy.
        remedy: String,
    },
    /// Other users can read a key.
    #[error(
        "use the key {0}: others can read it (mode {mode:03o}); make it yours alone: chmod 600 {0}",
        path.display()
    )]
    Loose {
        /// The key.
        path: PathBuf,
        /// The permissions of the key.
        mode: u32,
    },
    /// Every user of this machine can replace the file.
    #[error("trust {0}: every user can write it (mode {mode:03o}); forbid that: chmod o-w {0}",
        path.display())]
    Writable {
        /// The file, or its folder.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file does not have the expected content.
    #[error("read {}: {problem}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// The file to create exists already.
    #[error("make {}: it exists already, and without it the certificates that it has signed are \
             worth nothing; to make a new one, move the folder away first", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// No certificate can be made out to this name.
    #[error(
        "make a certificate for `{0}`: the name of a daemon with a certificate has at most 40 \
         letters and no `--`, which marks the names of its guests"
    )]
    Name(String),
    /// A host name that cannot stand in a certificate.
    #[error("put `{0}` into a certificate: write a host name or an IP address")]
    Host(String),
    /// The authority has issued no certificate for this name.
    #[error("revoke `{name}`: this authority has given it no certificate{}", others(known))]
    Unknown {
        /// The name.
        name: String,
        /// Names for which it has issued one.
        known: Vec<String>,
    },
    /// The library that makes certificates returned an error.
    #[error("make a certificate: {0}")]
    Making(#[from] rcgen::Error),
    /// A certificate is not valid here.
    #[error("use the certificate {}: {why}", path.display())]
    Distrusted {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: DistrustReason,
    },
}

fn others(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; it has given some to {}", names.join(", ")),
    }
}

/// Why a message is not believed. Completes “the message …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum DistrustReason {
    /// The message has no seal.
    #[error("is not signed")]
    Unsigned,
    /// The seal cannot be read.
    #[error("has a seal that cannot be read")]
    Malformed,
    /// The certificate is not this authority's, or is not a daemon's.
    #[error("is signed with a certificate that the ecosystem's authority has not made")]
    Stranger,
    /// The certificate is not valid yet, or has expired.
    #[error("is signed with a certificate that is not valid at this time")]
    Expired,
    /// The certificate was revoked.
    #[error("is signed with a certificate that was revoked")]
    Revoked,
    /// The signature does not match the message.
    #[error("has a signature that does not match: it was changed, or signed by another daemon")]
    Forged,
    /// The sender's name does not match the certificate.
    #[error("is signed by a daemon in the name of another")]
    Impostor,
    /// The message was received before, or is of an earlier incarnation of its sender.
    #[error("was received before, or is of an earlier incarnation")]
    Replayed,
    /// The message is for an earlier incarnation of its receiver.
    #[error("is for an earlier incarnation of this daemon: it is replayed, or its sender is late")]
    OldReceiver,
    /// The message was sealed too long ago.
    #[error("was delayed for longer than any receiver waits")]
    Delayed,
    /// The sender has not answered a call yet, or had not when it sent this: the message may be old.
    #[error("was sent before its daemon answered a roll call")]
    NotSynced,
    /// The sender exceeds its rate limit.
    #[error("exceeds the message rate of its sender")]
    Flooded,
}
