//! The seal on a message: the bytes that are sent in addition to the payload, and the bytes that
//! are signed.
//!
//! ```text
//! 1 byte    version
//! 8 bytes   incarnation of the sender
//! 8 bytes   sequence number of the message in that incarnation and channel
//! 8 bytes   time of sealing, in milliseconds since that incarnation began
//! 8 bytes   incarnation of the receiving daemon; 0 for a broadcast or an unknown incarnation
//! 1 byte    length of the sender's name; 0 if the sender is the owner of the certificate
//! …         name of the sender
//! 64 bytes  Ed25519 signature
//! …         certificate of the key, in DER
//! ```
//!
//! The sender is a daemon or a guest of a daemon. All numbers are big-endian.
//!
//! The signed bytes are, in this order: a text that only this protocol uses; the channel; the four
//! numbers; the sender, the key expression and the nonce, each with its length; and the SHA-256 of
//! the payload. The payload is hashed so that a message of 16 MiB need not be copied to be signed.

use ring::digest::{SHA256, digest};
use ring::rand::{SecureRandom as _, SystemRandom};

/// Kind of a sealed message. Messages of one channel arrive nearly in order; messages of two
/// channels often overtake each other, so each channel has its own sequence numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum SealChannel {
    /// Messages to one agent, and messages to all agents.
    Message = 0,
    /// Action models and heartbeats, which travel at a lower priority.
    AgentState = 1,
    /// Answers to questions. A nonce binds an answer to its question, so answers have no sequence
    /// numbers.
    Answer = 2,
    /// Messages of a daemon to its own agents. The daemon itself does not verify them; others may
    /// overhear them, and never act on them, so they have no sequence numbers that count.
    Internal = 3,
}

const VERSION: u8 = 3;
const NUMBERS_BYTES: usize = 8;
pub(crate) const SIGNATURE_BYTES: usize = 64;

/// Maximum length of a certificate in a seal, in bytes. A seal with a longer one is malformed.
/// Certificates that this crate issues have some 500 bytes.
const CERTIFICATE_BYTES_MAX: usize = 4_096;

/// Prefix of the signed bytes, so that no other signature of the key is valid for a message.
const CONTEXT: &[u8] = b"althing seal 3";

/// Length of a [`Nonce`], in bytes.
pub const NONCE_BYTES: usize = 16;

/// Random value in a question; it binds an answer to that question alone.
pub type Nonce = [u8; NONCE_BYTES];

/// Returns an unpredictable nonce; `None` if the system has no randomness.
pub fn nonce() -> Option<Nonce> {
    let mut nonce = [0; NONCE_BYTES];
    SystemRandom::new().fill(&mut nonce).ok().map(|()| nonce)
}

/// A seal that was parsed and is not verified yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seal<'s> {
    pub(crate) incarnation: u64,
    pub(crate) number: u64,
    pub(crate) at: u64,
    pub(crate) to: u64,
    /// Name of the sender; empty if the sender is the owner of the certificate and not a guest.
    pub(crate) sender: &'s str,
    pub(crate) signature: &'s [u8],
    pub(crate) certificate: &'s [u8],
}

/// The signed fields of a seal, without the payload.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SignedFields<'s> {
    pub(crate) channel: SealChannel,
    pub(crate) incarnation: u64,
    pub(crate) number: u64,
    pub(crate) at: u64,
    pub(crate) to: u64,
    pub(crate) sender: &'s str,
    pub(crate) key_expr: &'s str,
    /// Nonce of the question that is answered; empty if the message is no answer.
    pub(crate) nonce: &'s [u8],
}

// === impl Seal ===

impl<'s> Seal<'s> {
    pub(crate) fn write(&self) -> Vec<u8> {
        let Seal { incarnation, number, at, to, sender: signer, signature, certificate } = *self;
        let length = 2 + 4 * NUMBERS_BYTES + signer.len() + signature.len() + certificate.len();
        let mut bytes = Vec::with_capacity(length);
        bytes.push(VERSION);
        bytes.extend(incarnation.to_be_bytes());
        bytes.extend(number.to_be_bytes());
        bytes.extend(at.to_be_bytes());
        bytes.extend(to.to_be_bytes());
        // A name has at most 64 bytes.
        bytes.push(u8::try_from(signer.len()).unwrap_or(u8::MAX));
        bytes.extend(signer.as_bytes());
        bytes.extend(signature);
        bytes.extend(certificate);
        bytes
    }

    /// Parses a seal that comes from outside. Returns `None` if the seal is malformed or of another
    /// version.
    pub(crate) fn read(bytes: &'s [u8]) -> Option<Seal<'s>> {
        let (version, rest) = bytes.split_first()?;
        let (incarnation, rest) = rest.split_first_chunk::<NUMBERS_BYTES>()?;
        let (number, rest) = rest.split_first_chunk::<NUMBERS_BYTES>()?;
        let (at, rest) = rest.split_first_chunk::<NUMBERS_BYTES>()?;
        let (to, rest) = rest.split_first_chunk::<NUMBERS_BYTES>()?;
        let (length, rest) = rest.split_first()?;
        let (signer, rest) = rest.split_at_checked(usize::from(*length))?;
        let (signature, certificate) = rest.split_at_checked(SIGNATURE_BYTES)?;
        if *version != VERSION || certificate.len() > CERTIFICATE_BYTES_MAX {
            return None;
        }
        Some(Seal {
            incarnation: u64::from_be_bytes(*incarnation),
            number: u64::from_be_bytes(*number),
            at: u64::from_be_bytes(*at),
            to: u64::from_be_bytes(*to),
            sender: std::str::from_utf8(signer).ok()?,
            signature,
            certificate,
        })
    }
}

// === impl SignedFields ===

impl SignedFields<'_> {
    /// Returns the bytes to sign for these fields and `payload`.
    pub(crate) fn bytes(&self, payload: &[u8]) -> Vec<u8> {
        let SignedFields { channel, incarnation, number, at, to, sender: signer, key_expr, nonce } =
            *self;
        let mut bytes = Vec::with_capacity(CONTEXT.len() + key_expr.len() + signer.len() + 104);
        bytes.extend(CONTEXT);
        bytes.push(channel as u8);
        bytes.extend(incarnation.to_be_bytes());
        bytes.extend(number.to_be_bytes());
        bytes.extend(at.to_be_bytes());
        bytes.extend(to.to_be_bytes());
        for part in [signer.as_bytes(), key_expr.as_bytes(), nonce] {
            bytes.extend(u64::try_from(part.len()).unwrap_or(u64::MAX).to_be_bytes());
            bytes.extend(part);
        }
        bytes.extend(digest(&SHA256, payload).as_ref());
        bytes
    }
}
