//! Names of people.

use std::borrow::Borrow;
use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

/// Maximum length of a person's name, in bytes. A name stands in columns of tables, and in the names
/// of agents that speak for the person.
pub const NAME_BYTES_MAX: usize = 32;

/// The name of a person: 1 to 32 of `a-z`, `0-9`, `-` and `_`; it begins with a letter.
///
/// So a name needs no escape in a file, a path, a key expression or a page.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct PersonName(Arc<str>);

/// Reason why a text is not the name of a person.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{written}` is no name of a person: a name has 1 to 32 of a-z, 0-9, - and _, and begins \
         with a letter"
)]
pub struct PersonNameError {
    /// The text that is not a name: its first characters, without control characters.
    pub written: String,
}

// === impl PersonName ===

impl PersonName {
    /// Returns the name that `text` is.
    ///
    /// # Errors
    ///
    /// Returns an error if `text` has another form.
    pub fn new(text: &str) -> Result<PersonName, PersonNameError> {
        let is_inner = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_');
        let begins = text.as_bytes().first().is_some_and(u8::is_ascii_lowercase);
        if begins && text.len() <= NAME_BYTES_MAX && text.bytes().all(is_inner) {
            return Ok(PersonName(text.into()));
        }
        let shown = text.chars().filter(|c| !c.is_control()).take(NAME_BYTES_MAX);
        Err(PersonNameError { written: shown.collect() })
    }

    /// Returns the name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for PersonName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl Borrow<str> for PersonName {
    fn borrow(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for PersonName {
    type Error = PersonNameError;

    fn try_from(text: String) -> Result<PersonName, PersonNameError> {
        PersonName::new(&text)
    }
}

impl From<PersonName> for String {
    fn from(name: PersonName) -> String {
        name.0.as_ref().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_one_form() {
        for name in ["a", "anna", "night-porter_2", &"a".repeat(NAME_BYTES_MAX)] {
            assert_eq!(PersonName::new(name).expect(name).as_str(), name);
        }
        for name in ["", "Anna", "1a", "-a", "_a", "an na", "änna", "a/b", "a.b", "a\0", "root\n"]
        {
            assert!(PersonName::new(name).is_err(), "{name:?}");
        }
        assert!(PersonName::new(&"a".repeat(NAME_BYTES_MAX + 1)).is_err());
    }

    #[test]
    fn an_error_shows_no_control_characters_and_not_everything() {
        let error = PersonName::new(&"\u{1b}x".repeat(1_000)).expect_err("control characters");
        assert_eq!(error.written, "x".repeat(NAME_BYTES_MAX));
    }

    #[test]
    fn a_name_is_checked_when_it_is_read_from_json() {
        assert!(serde_json::from_str::<PersonName>("\"anna\"").is_ok());
        assert!(serde_json::from_str::<PersonName>("\"Anna\"").is_err());
    }
}
