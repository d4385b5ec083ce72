//! Answers of people, sealed so that only the agent that asked can read them, because other agents
//! receive all messages too.
//!
//! Each question has a key pair of its own, which the agent that asks drops together with the
//! question. A sealed answer does not show its author, and only that agent can open it. The scheme
//! does not prove that the public key in a question belongs to the agent that asks: in an ecosystem
//! without certificates a participant can pose as another agent.

use crypto_box::aead::OsRng;
use crypto_box::{KEY_SIZE, PublicKey, SecretKey};

/// Maximum length of an answer, in bytes; a longer one is not sealed or opened.
const ANSWER_BYTES_MAX: usize = 4 << 10;

/// Number of bytes that sealing adds to an answer: a public key and a tag.
const SEAL_BYTES: usize = 48;

/// The key pair that belongs to one question.
pub struct AnswerKey(SecretKey);

/// Reason why an answer cannot be sealed or read. The message completes “the answer …”.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SealError {
    /// The public key in the question is not valid.
    #[error("cannot be sealed: the key of the question is not 64 hexadecimal digits")]
    NoKey,
    /// The answer is longer than allowed.
    #[error("is longer than {ANSWER_BYTES_MAX} bytes")]
    TooLong,
    /// The answer was sealed to the key of another question, or was changed on its way.
    #[error("was not sealed to the key of this question")]
    Foreign,
}

// === impl AnswerKey ===

impl AnswerKey {
    /// Generates the key pair for a new question.
    pub fn new() -> AnswerKey {
        AnswerKey(SecretKey::generate(&mut OsRng))
    }

    /// Returns the public key in hexadecimal, as the question contains it.
    pub fn public(&self) -> String {
        to_hex(self.0.public_key().as_bytes())
    }

    /// Opens an answer that was sealed to this key, and returns its text.
    ///
    /// # Errors
    ///
    /// Returns an error if the answer is too long or was not sealed to this key.
    pub fn open(&self, sealed: &str) -> Result<String, SealError> {
        if sealed.len() > 2 * (ANSWER_BYTES_MAX + SEAL_BYTES) {
            return Err(SealError::TooLong);
        }
        let sealed = from_hex(sealed).ok_or(SealError::Foreign)?;
        let text = self.0.unseal(&sealed).map_err(|_| SealError::Foreign)?;
        String::from_utf8(text).map_err(|_| SealError::Foreign)
    }
}

impl Default for AnswerKey {
    fn default() -> AnswerKey {
        AnswerKey::new()
    }
}

/// Seals the answer `text` to the public key `key`, which its question contains.
///
/// # Errors
///
/// Returns an error if `key` is not a public key, or the answer is too long.
pub fn seal_answer(key: &str, text: &str) -> Result<String, SealError> {
    let key = from_hex(key).and_then(|bytes| <[u8; KEY_SIZE]>::try_from(bytes).ok());
    let key = PublicKey::from_bytes(key.ok_or(SealError::NoKey)?);
    if text.len() > ANSWER_BYTES_MAX {
        return Err(SealError::TooLong);
    }
    let sealed = key.seal(&mut OsRng, text.as_bytes()).map_err(|_| SealError::NoKey)?;
    Ok(to_hex(&sealed))
}

fn to_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn from_hex(digits: &str) -> Option<Vec<u8>> {
    let is_digits = digits.len().is_multiple_of(2) && digits.bytes().all(|b| b.is_ascii_hexdigit());
    let pairs = (0..digits.len()).step_by(2).filter(|_| is_digits);
    let read: Option<Vec<u8>> =
        pairs.map(|at| u8::from_str_radix(&digits[at..at + 2], 16).ok()).collect();
    read.filter(|_| is_digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_key_of_the_question_opens_an_answer() {
        let (asker, other) = (AnswerKey::new(), AnswerKey::new());
        for text in ["2718", "", "gr\u{fc}n \u{1f511}"] {
            let sealed = seal_answer(&asker.public(), text).expect("a key");
            assert_eq!(asker.open(&sealed).as_deref(), Ok(text));
            assert_eq!(other.open(&sealed), Err(SealError::Foreign));
            let again = seal_answer(&asker.public(), text).expect("a key");
            assert_ne!(sealed, again, "two equal answers do not look alike");
        }
    }

    #[test]
    fn rubbish_is_refused() {
        let key = AnswerKey::new();
        let sealed = seal_answer(&key.public(), "2718").expect("a key");
        let mut changed = sealed.clone();
        let last = if changed.pop() == Some('0') { '1' } else { '0' };
        changed.push(last);
        for rubbish in [&changed, "", "abc", "zz", "\u{fc}\u{fc}", &sealed[..90]] {
            assert_eq!(key.open(rubbish), Err(SealError::Foreign), "{rubbish}");
        }
        for rubbish in ["", "12", &"g".repeat(64), &"\u{fc}".repeat(32), &"0".repeat(66)] {
            assert_eq!(seal_answer(rubbish, "2718"), Err(SealError::NoKey), "{rubbish}");
        }
        let long = "x".repeat(ANSWER_BYTES_MAX + 1);
        assert_eq!(seal_answer(&key.public(), &long), Err(SealError::TooLong));
        assert_eq!(key.open(&"00".repeat(5_000)), Err(SealError::TooLong));
    }
}
