//! Random secrets, and the digests under which they are kept.

use std::fmt;

use base64::Engine as _;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;
use ring::digest::{SHA256, digest};
use ring::rand::{SecureRandom as _, SystemRandom};

use crate::error::AccountsError;

/// Length of a random secret, in bytes: no attacker guesses one of 2^256, however many attempts a
/// network carries. So a plain digest is enough to keep it, and it needs no limit of attempts.
const SECRET_BYTES: usize = 32;

/// Length of a digest, in bytes.
const DIGEST_BYTES: usize = 32;

/// Maximum length of a text that is looked up as a secret; longer ones are wrong without a look.
const SECRET_TEXT_BYTES_MAX: usize = 128;

/// The beginning of the digest of a token in a file, which names its function.
const DIGEST_PREFIX: &str = "sha256:";

/// The SHA-256 digest of a secret. Two digests are compared in place of two secrets, so that the time
/// of a comparison reveals nothing about a secret.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SecretDigest([u8; DIGEST_BYTES]);

/// Returns a new secret with 256 random bits, in letters that need no escape in a cookie or a header.
pub(crate) fn random_secret() -> Result<String, AccountsError> {
    Ok(BASE64_URL_SAFE_NO_PAD.encode(random::<SECRET_BYTES>()?))
}

/// Returns `N` random bytes.
pub(crate) fn random<const N: usize>() -> Result<[u8; N], AccountsError> {
    let mut bytes = [0; N];
    let filled = SystemRandom::new().fill(&mut bytes);
    filled.map_err(|_| AccountsError::Secret("the system gives no random bytes".to_owned()))?;
    Ok(bytes)
}

// === impl SecretDigest ===

impl SecretDigest {
    /// Returns the digest of a secret; `None` if the text is longer than any secret.
    pub fn of(secret: &str) -> Option<SecretDigest> {
        if secret.len() > SECRET_TEXT_BYTES_MAX {
            return None;
        }
        Some(SecretDigest::of_bytes(secret.as_bytes()))
    }

    /// Returns the digest of bytes of any length.
    pub(crate) fn of_bytes(bytes: &[u8]) -> SecretDigest {
        let mut copied = [0; DIGEST_BYTES];
        copied.copy_from_slice(digest(&SHA256, bytes).as_ref());
        SecretDigest(copied)
    }

    /// Returns the digest that a text of a file is: `sha256:` and 64 hexadecimal digits.
    pub(crate) fn parse(text: &str) -> Option<SecretDigest> {
        let digits = text.strip_prefix(DIGEST_PREFIX)?.as_bytes();
        if digits.len() != 2 * DIGEST_BYTES {
            return None;
        }
        let mut bytes = [0; DIGEST_BYTES];
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = digit(pair[0])? << 4 | digit(pair[1])?;
        }
        Some(SecretDigest(bytes))
    }
}

fn digit(letter: u8) -> Option<u8> {
    match letter {
        b'0'..=b'9' => Some(letter - b'0'),
        b'a'..=b'f' => Some(letter - b'a' + 10),
        _ => None,
    }
}

impl fmt::Display for SecretDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(DIGEST_PREFIX)?;
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for SecretDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SecretDigest(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_differ_and_are_long() {
        let (one, two) = (random_secret().expect("random"), random_secret().expect("random"));
        assert_ne!(one, two);
        assert_eq!(one.len(), 43);
        assert!(one.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_".contains(&byte)));
    }

    #[test]
    fn a_digest_is_read_as_it_is_written() {
        let digest = SecretDigest::of("secret").expect("short");
        let text = digest.to_string();
        assert_eq!(text, "sha256:2bb80d537b1da3e38bd30361aa855686bde0eacd7162fef6a25fe97bf527a25b");
        assert_eq!(SecretDigest::parse(&text), Some(digest));
        for wrong in ["", "sha256:", &text[1..], &text[..70], &text.to_uppercase(), "sha256:é"] {
            assert_eq!(SecretDigest::parse(wrong), None, "{wrong}");
        }
        assert_eq!(SecretDigest::of(&"x".repeat(SECRET_TEXT_BYTES_MAX + 1)), None);
        assert!(!format!("{digest:?}").contains("2bb8"));
    }
}
