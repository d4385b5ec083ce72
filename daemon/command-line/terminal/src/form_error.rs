//! Parses the error messages of serde about a text (JSON or TOML) that has the wrong form. A caller
//! then expresses the error in words for the author of the text, because serde uses terms of Rust:
//! “invalid type: map, expected a sequence”.

use std::borrow::Cow;

/// An error in the form of a text that serde reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FormError<'a> {
    /// The text has a key that is not allowed at its place.
    UnknownKey {
        /// The key that is not allowed.
        key: &'a str,
        /// The keys that are allowed at the place of the key.
        known: Vec<&'a str>,
    },
    /// The text lacks this key, which is required.
    MissingKey(&'a str),
    /// The text has a word that is not one of those allowed at its place.
    UnknownWord {
        /// The word that is not allowed.
        word: &'a str,
        /// The words that are allowed at the place of the word.
        known: Vec<&'a str>,
    },
    /// The text has a value of another kind than expected.
    Kind {
        /// Serde's description of the value; [`got`] turns it into words for the author.
        got: &'a str,
        /// Serde's name of the expected type; [`kind`] turns it into words for the author.
        wanted: &'a str,
    },
    /// The text has a value that matches none of the allowed forms.
    NoForm,
}

impl<'a> FormError<'a> {
    /// Parses a message of serde, or of a format that uses serde. Returns `None` if the message
    /// describes none of these errors.
    pub fn of(said: &'a str) -> Option<FormError<'a>> {
        let said = without_place(said.trim());
        if let Some(rest) = said.strip_prefix("unknown field ") {
            let (key, known) = first_and_rest(rest)?;
            return Some(FormError::UnknownKey { key, known });
        }
        if let Some(rest) = said.strip_prefix("missing field ") {
            return Some(FormError::MissingKey(first_and_rest(rest)?.0));
        }
        if let Some(rest) = said.strip_prefix("unknown variant ") {
            let (word, known) = first_and_rest(rest)?;
            return Some(FormError::UnknownWord { word, known });
        }
        if said.starts_with("data did not match any variant") {
            return Some(FormError::NoForm);
        }
        let invalid = ["invalid type: ", "invalid value: ", "invalid length "];
        let rest = invalid.iter().find_map(|prefix| said.strip_prefix(prefix))?;
        let (got, wanted) = rest.rsplit_once(", expected ")?;
        Some(FormError::Kind { got, wanted })
    }
}

/// Removes the place (line and column) that `serde_json` appends to a message.
fn without_place(said: &str) -> &str {
    match said.rsplit_once(" at line ") {
        Some((before, place)) if place.contains(" column ") => before,
        _ => said,
    }
}

/// Returns the first word that stands between backquotes in a text, and the further ones. Returns
/// `None` if there is none.
fn first_and_rest(text: &str) -> Option<(&str, Vec<&str>)> {
    let mut quoted = text.split('`').skip(1).step_by(2);
    Some((quoted.next()?, quoted.collect()))
}

/// Converts serde's name of an expected type to words for the author of the text: `a sequence`
/// becomes `a list in [ ]`.
pub fn kind(wanted: &str) -> Cow<'_, str> {
    let whole = |to: u32| Cow::from(format!("a whole number from 0 to {to}"));
    match wanted {
        "f32" | "f64" => "a number".into(),
        "u8" => whole(u8::MAX.into()),
        "u16" => whole(u16::MAX.into()),
        "u32" | "u64" | "usize" => "a whole number, 0 or more".into(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".into(),
        "a boolean" => "true or false".into(),
        "a string" | "path string" | "a borrowed string" => "a text in quotes".into(),
        "a sequence" => "a list in [ ]".into(),
        "a map" | "string or map" => "a table in { }".into(),
        wanted if wanted.starts_with("struct ") => "a table in { }".into(),
        wanted if wanted.starts_with("internally tagged enum ") => "a table in { }".into(),
        wanted if wanted.starts_with("enum ") => "one of its words in quotes".into(),
        wanted => wanted.into(),
    }
}

/// Converts serde's description of a value to words for the author of the text: ``string "x"``
/// becomes ``the text "x"``, and `map` becomes `a table`.
pub fn got(said: &str) -> String {
    let within = |prefix: &str| said.strip_prefix(prefix).map(|rest| rest.trim_matches('`'));
    match said {
        "sequence" => "a list".to_owned(),
        "map" => "a table".to_owned(),
        "null" | "unit value" => "empty".to_owned(),
        said => None
            .or_else(|| said.strip_prefix("string ").map(|text| format!("the text {text}")))
            .or_else(|| within("integer ").map(str::to_owned))
            .or_else(|| within("floating point ").map(str::to_owned))
            .or_else(|| within("boolean ").map(str::to_owned))
            .unwrap_or_else(|| said.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_serde_are_parsed() {
        let key = FormError::UnknownKey { key: "rooom", known: vec!["room", "name"] };
        let word = FormError::UnknownWord { word: "requst", known: vec!["request", "cancel"] };
        let list = FormError::Kind { got: "map", wanted: "a sequence" };
        for (said, expected) in [
            ("unknown field `rooom`, expected `room` or `name`", Some(key)),
            ("missing field `name`\n", Some(FormError::MissingKey("name"))),
            (
                "unknown variant `requst`, expected `request` or `cancel` at line 1 column 26",
                Some(word),
            ),
            ("invalid type: map, expected a sequence at line 2 column 0", Some(list)),
            ("data did not match any variant of untagged enum A", Some(FormError::NoForm)),
            ("`soon` is no duration", None),
        ] {
            assert_eq!(FormError::of(said), expected, "{said}");
        }
    }
}
