//! Errors of files and certificates, and the reasons why a message is rejected.

use std::io;
use std::path::PathBuf;

/// Reason why a credential cannot be made or used. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CredentialError {
    /// A file or a folder of credentials cannot be read or written.
    #[error("use {}: {source}", path.display())]
    Io {
        /// Path of the file or folder that cannot be read or written.
        path: PathBuf,
        /// Error that the system returned.
        #[source]
        source: io::Error,
    },
    /// A required file does not exist.
    #[error("find {what}: there is no {}; {remedy}", path.display())]
    Missing {
        /// Description of the missing file.
        what: &'static str,
        /// Path at which the missing file was looked for.
        path: PathBuf,
        /// Description of how to get the missing file.
        remedy: String,
    },
    /// Other users can read a file that contains a private key.
    #[error(
        "use the key {0}: others can read it (mode {mode:03o}); make it yours alone: chmod 600 {0}",
        path.display()
    )]
    Loose {
        /// Path of the key file that others can read.
        path: PathBuf,
        /// Permissions of the key file, as a Unix mode.
        mode: u32,
    },
    /// Every user of this machine can replace a file that has to be trusted.
    #[error("trust {0}: every user can write it (mode {mode:03o}); forbid that: chmod o-w {0}",
        path.display())]
    Writable {
        /// Path of the file that every user can replace, or of its folder.
        path: PathBuf,
        /// Permissions of that file or folder, as a Unix mode.
        mode: u32,
    },
    /// A file does not have the expected content.
    #[error("read {}: {problem}", path.display())]
    Malformed {
        /// Path of the file with unexpected content.
        path: PathBuf,
        /// Description of what is wrong with the content.
        problem: String,
    },
    /// A file that is to be created exists already.
    #[error("make {}: it exists already, and without it the certificates that it has signed are \
             worth nothing; to make a new one, move the folder away first", path.display())]
    Exists {
        /// Path of the file that exists already.
        path: PathBuf,
    },
    /// No certificate can be made for a daemon of this name.
    #[error(
        "make a certificate for `{0}`: the name of a daemon with a certificate has at most 40 \
         letters and no `--`, which marks the names of its guests"
    )]
    Name(String),
    /// This host name cannot be put into a certificate.
    #[error("put `{0}` into a certificate: write a host name or an IP address")]
    Host(String),
    /// The page authority may not vouch for a host.
    #[error(
        "put `{host}` into a certificate of a page: browsers believe {0} only for the hosts that \
         were named when it was made; to make another one, move its folder away first, and let the \
         phones trust the new one", authority.display()
    )]
    NotVouched {
        /// The host.
        host: String,
        /// Path of the certificate of the page authority.
        authority: PathBuf,
    },
    /// The authority has issued no certificate for the name that was asked for.
    #[error("revoke `{name}`: this authority has given it no certificate{}", others(known))]
    Unknown {
        /// Name for which the authority has issued no certificate.
        name: String,
        /// Names for which the authority has issued certificates.
        known: Vec<String>,
    },
    /// The library that makes certificates returned this error.
    #[error("make a certificate: {0}")]
    Making(#[from] rcgen::Error),
    /// A certificate is not valid in this ecosystem.
    #[error("use the certificate {}: {why}", path.display())]
    Distrusted {
        /// Path of the file with the certificate that is not valid here.
        path: PathBuf,
        /// Reason why the certificate is not valid here.
        why: DistrustReason,
    },
}

fn others(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; it has given some to {}", names.join(", ")),
    }
}

/// Reason why a message is rejected. The message of the error completes “the message …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum DistrustReason {
    /// The message has no seal.
    #[error("is not signed")]
    Unsigned,
    /// The seal cannot be read.
    #[error("has a seal that cannot be read")]
    Malformed,
    /// The certificate of the sender was not issued by this ecosystem's authority, or is not one of
    /// a daemon.
    #[error("is signed with a certificate that the ecosystem's authority has not made")]
    Stranger,
    /// The certificate of the sender is not valid yet, or has expired.
    #[error("is signed with a certificate that is not valid at this time")]
    Expired,
    /// The certificate of the sender was revoked.
    #[error("is signed with a certificate that was revoked")]
    Revoked,
    /// The signature does not match the message.
    #[error("has a signature that does not match: it was changed, or signed by another daemon")]
    Forged,
    /// The sender's name does not match the certificate.
    #[error("is signed by a daemon in the name of another")]
    Impostor,
    /// The message was received before, or comes from an earlier incarnation of its sender.
    #[error("was received before, or is of an earlier incarnation")]
    Replayed,
    /// The message was sent to an earlier incarnation of its receiver.
    #[error("is for an earlier incarnation of this daemon: it is replayed, or its sender is late")]
    OldReceiver,
    /// The message was sealed too long before it arrived.
    #[error("was delayed for longer than any receiver waits")]
    Delayed,
    /// The sender has not yet answered a roll call of this daemon (the query to all daemons), or
    /// sent the message before that answer. So the message may be a recording.
    #[error("was sent before its daemon answered a roll call")]
    NotSynced,
    /// The sender exceeds its rate limit.
    #[error("exceeds the message rate of its sender")]
    Flooded,
}
