//! Rewords the parser's messages about a `plugin.toml` for the author of the file.
//!
//! For example, “invalid type: map, expected a sequence” becomes “`agent` must be a list in [ ],
//! and is a table”, with advice on how to correct the line.

use std::ops::Range;

use pddl::{Diagnostic, Span, nearest};
use terminal::form_error::{self, FormError};

/// Help text for mistakes without more specific advice.
const DOCS: &str = "docs/plugins.md says what a plugin.toml has";

/// Keys of a `plugin.toml`, each with an example line.
const EXAMPLES: &[(&str, &str)] = &[
    ("name", "name = \"thermometer\""),
    ("version", "version = \"0.1.0\""),
    ("protocol", "protocol = \"2\""),
    ("method", "method = \"read\""),
    ("timeout", "timeout = \"2s\""),
    ("type", "type = \"text\""),
    ("network", "network = true"),
    ("cpu", "cpu = 0.5"),
    ("files", "files = 128"),
    ("processes", "processes = 4"),
];

/// Keys of a `plugin.toml` with a list of tables as their value.
const LISTS_OF_TABLES: &[&str] = &["agent"];

/// Converts the parser's message about the bytes at `place` to a diagnostic for the author of the
/// file.
pub(crate) fn worded(text: &str, said: &str, place: Range<usize>) -> Diagnostic {
    let offset = |place| u32::try_from(place).unwrap_or(u32::MAX);
    let span = Span { start: offset(place.start), end: offset(place.end) };
    let (message, help) = match FormError::of(said) {
        Some(FormError::UnknownKey { key, known }) => {
            (format!("unknown key `{key}`"), in_place_of(key, &known))
        }
        Some(FormError::MissingKey(key)) => (format!("`{key}` is missing"), write(key)),
        Some(FormError::UnknownWord { word, known }) => (
            format!("\"{word}\" is not known here"),
            format!("write \"{}\"", known.join("\" or \"")),
        ),
        Some(FormError::Kind { got, wanted }) => {
            let key = key_at(text, place.start);
            let (wanted, got) = (form_error::kind(wanted), form_error::got(got));
            let help = match &*wanted {
                "a list in [ ]" if LISTS_OF_TABLES.contains(&key) => format!("write [[{key}]]"),
                "a list in [ ]" => format!("write {key} = [\"…\"]"),
                _ => write(key),
            };
            (format!("`{key}` must be {wanted}, and is {got}"), help)
        }
        Some(FormError::NoForm) | None => (said.trim().to_owned(), DOCS.to_owned()),
    };
    Diagnostic::error(span, message).with_help(help)
}

/// Returns advice about a key that a `plugin.toml` must not have.
fn in_place_of(key: &str, known: &[&str]) -> String {
    match nearest(key, known.iter().copied()) {
        _ if ["plugin", "package"].contains(&key) => {
            "`name`, `version` and `run` stand at the top of the file, under no table".to_owned()
        }
        Some(meant) => format!("did you mean `{meant}`?"),
        None => format!("known are {}", known.join(", ")),
    }
}

/// Returns advice to write a line such as the example for this key.
fn write(key: &str) -> String {
    let example = EXAMPLES.iter().find(|(name, _)| *name == key);
    example.map_or_else(|| DOCS.to_owned(), |(_, example)| format!("write {example}"))
}

/// Returns the key of the line at the byte offset `place`, or the name of the table if the line is
/// a table header.
fn key_at(text: &str, place: usize) -> &str {
    let begin = text.get(..place).and_then(|before| before.rfind('\n')).map_or(0, |at| at + 1);
    let line = text.get(begin..).and_then(|rest| rest.lines().next()).unwrap_or_default().trim();
    let key = match line.strip_prefix('[') {
        Some(table) => table.trim_start_matches('[').split(']').next(),
        None => line.split('=').next(),
    };
    key.unwrap_or_default().trim()
}

#[cfg(test)]
mod tests {
    use crate::manifest::PackageManifest;

    /// Returns the first mistake of a manifest, with its help text.
    fn said(text: &str) -> String {
        let found = PackageManifest::read(text).expect_err("it is wrong");
        let help = found[0].help.clone().unwrap_or_default();
        format!("{}: {help}", found[0].message)
    }

    #[test]
    fn mistakes_of_form_name_the_key_and_give_advice() {
        let head = "name = \"a\"\nversion = \"1\"\nprotocol = \"2\"\nrun = [\"a\"]\n";
        for (text, expected) in [
            ("[plugin]\nname = \"a\"", "unknown key `plugin`: `name`, `version` and `run` stand"),
            ("name = \"a\"\nversion = 1", "must be a text in quotes, and is 1: write version = \""),
            ("name = \"a\"\nversion = \"1\"", "`protocol` is missing: write protocol = \"2\""),
            (&format!("{head}[agent]\nname = \"x\""), "`agent` must be a list in [ ], and is a"),
            (&format!("{head}[agent]\nname = \"x\""), "table: write [[agent]]"),
            (&format!("{head}[[agents]]"), "unknown key `agents`: did you mean `agent`?"),
            (&format!("{head}[permissions]\nnetwork = \"yes\""), "must be true or false, and is"),
            (&format!("{head}[permissions]\nfiles = -1"), "`files` must be a whole number"),
            (&format!("{head}[permissions]\ncpu = \"half\""), "`cpu` must be a number"),
            (&format!("{head}[permissions]\ndevices = \"/dev/a\""), "write devices = [\"…\"]"),
            (&format!("{head}[config]\nroom = \"text\""), "`room` must be a table"),
        ] {
            let said = said(text);
            assert!(said.contains(expected), "{text}\n{said}");
        }
    }
}
