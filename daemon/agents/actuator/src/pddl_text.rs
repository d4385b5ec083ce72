//! PDDL text that a device builds from its own literals and from names that were validated on
//! input.

use pddl::ActionModel;
use serde::Deserialize;

use crate::device::OwnFact;

/// The name of a place on the map, as a config gives it. The name is a valid PDDL name.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct PlaceName(String);

/// Error for a text that cannot be the name of a place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` cannot be the name of a place: use lower-case letters, digits, `-` and `_`, and begin \
     with a letter, as the map does"
)]
pub struct InvalidPlaceName(String);

impl PlaceName {
    /// Returns the name of the place as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for PlaceName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for PlaceName {
    type Error = InvalidPlaceName;

    fn try_from(name: String) -> Result<PlaceName, InvalidPlaceName> {
        let is_plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-_".contains(&b);
        let begins = name.bytes().next().is_some_and(|b| b.is_ascii_lowercase());
        if begins && name.bytes().all(is_plain) {
            Ok(PlaceName(name))
        } else {
            Err(InvalidPlaceName(name))
        }
    }
}

/// Parses a device's action model.
///
/// # Panics
///
/// Panics if the text is not a valid action model. Such a text is a bug of the device's plugin,
/// whatever its config contains.
pub fn model_of(text: &str) -> ActionModel {
    let parsed = pddl::parse_action_model(text);
    assert!(parsed.is_ok(), "a device's own model: {:?}\n{text}", parsed.diagnostics);
    parsed.value.expect("invariant: a text without errors has a value")
}

/// Parses facts of a device that stay known until the device reports otherwise.
///
/// Returns no facts if the text cannot be parsed, and logs the error: a device may have measured a
/// value that PDDL cannot express, such as infinity, and goes on with its next value.
pub fn facts_of(text: &str) -> Vec<OwnFact> {
    let parsed = pddl::parse_init_elements(text);
    if !parsed.is_ok() {
        tracing::error!("dropped facts that cannot be read: {:?}: {text}", parsed.diagnostics);
        return Vec::new();
    }
    parsed.value.into_iter().flatten().map(OwnFact::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_that_pddl_cannot_express_are_dropped() {
        assert_eq!(facts_of("(known-temperature r) (= (temperature r) 21.5)").len(), 2);
        for number in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            let text = format!("(known-temperature r) (= (temperature r) {number})");
            assert_eq!(facts_of(&text).len(), 0, "{number}");
        }
    }
}
