//! What is wrong with the form of a `plugin.toml`, in the words of its author.
//!
//! Serde speaks of Rust: “invalid type: map, expected a sequence”. Here that becomes “`agent` must be a
//! list”, and what to write.

use std::ops::Range;

use pddl::{Diagnostic, Span, nearest};

/// Where the rest stands.
const DOCS: &str = "docs/plugins.md says what a plugin.toml has";

/// What could stand at the keys that are needed.
const EXAMPLES: &[(&str, &str)] = &[
    ("name", "name = \"thermometer\""),
    ("version", "version = \"0.1.0\""),
    ("protocol", "protocol = \"1\""),
    ("method", "method = \"read\""),
    ("timeout", "timeout = \"2s\""),
    ("type", "type = \"text\""),
];

/// Keys that are lists of tables.
const LISTS_OF_TABLES: &[&str] = &["agent"];

/// Words what the reader of the file says of the bytes at `place`.
pub(crate) fn worded(text: &str, said: &str, place: Range<usize>) -> Diagnostic {
    let said = said.trim();
    let span = Span { start: offset(place.start), end: offset(place.end) };
    let (message, help) = if let Some(rest) = said.strip_prefix("unknown field ") {
        unknown_key(&quoted(rest))
    } else if let Some(rest) = said.strip_prefix("missing field ") {
        missing_key(&quoted(rest))
    } else if let Some(rest) = said.strip_prefix("unknown variant ") {
        unknown_word(&quoted(rest))
    } else if let Some((_, wanted)) =
        said.strip_prefix("invalid ").and_then(|rest| rest.rsplit_once(", expected "))
    {
        wrong_kind(key_at(text, place.start), wanted)
    } else {
        (said.to_owned(), DOCS.to_owned())
    };
    Diagnostic::error(span, message).with_help(help)
}

fn offset(place: usize) -> u32 {
    u32::try_from(place).unwrap_or(u32::MAX)
}

/// What stands in backquotes.
fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

fn unknown_key(names: &[&str]) -> (String, String) {
    let (key, known) = names.split_first().map_or(("", &[][..]), |(key, known)| (*key, known));
    let help = match (key, nearest(key, known.iter().copied())) {
        ("plugin" | "package", _) => {
            "`name`, `version` and `run` stand at the top of the file, under no table".to_owned()
        }
        (_, Some(meant)) => format!("did you mean `{meant}`?"),
        _ => format!("known are {}", known.join(", ")),
    };
    (format!("unknown key `{key}`"), help)
}

fn missing_key(names: &[&str]) -> (String, String) {
    let key = names.first().copied().unwrap_or_default();
    let example = EXAMPLES.iter().find(|(name, _)| *name == key);
    let help = example.map_or_else(|| DOCS.to_owned(), |(_, example)| format!("write {example}"));
    (format!("`{key}` is missing"), help)
}

fn unknown_word(names: &[&str]) -> (String, String) {
    let (word, known) = names.split_first().map_or(("", &[][..]), |(word, known)| (*word, known));
    let known: Vec<_> = known.iter().map(|known| format!("\"{known}\"")).collect();
    (format!("\"{word}\" is not known here"), format!("write {}", known.join(" or ")))
}

/// Of serde's names of types, those that a file can have.
fn wrong_kind(key: &str, wanted: &str) -> (String, String) {
    let is_table_wanted = wanted.contains("map") || wanted.contains("struct");
    let kind = match wanted {
        wanted if wanted.contains("bool") => "true or false, without quotes",
        wanted if wanted.contains("sequence") => "a list",
        wanted if wanted.contains("string") => "a text in quotes",
        "f32" | "f64" => "a number",
        _ if is_table_wanted => "a table",
        _ => "a whole number that is not negative",
    };
    let help = match kind {
        "a list" if LISTS_OF_TABLES.contains(&key) => format!("write [[{key}]]"),
        "a list" => format!("write {key} = [\"…\"]"),
        "a text in quotes" => EXAMPLES.iter().find(|(name, _)| *name == key).map_or_else(
            || format!("write {key} = \"…\""),
            |(_, example)| format!("write {example}"),
        ),
        "a table" => format!("write [{key}], and its keys below"),
        _ => DOCS.to_owned(),
    };
    (format!("`{key}` must be {kind}"), help)
}

/// The key whose value, or whose table, stands at a place.
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
    use crate::manifest::Manifest;

    /// The first mistake of a manifest, with what would be right.
    fn said(text: &str) -> String {
        let found = Manifest::read(text).expect_err("it is wrong");
        let help = found[0].help.clone().unwrap_or_default();
        format!("{}: {help}", found[0].message)
    }

    #[test]
    fn mistakes_of_form_are_told_in_the_authors_words() {
        let head = "name = \"a\"\nversion = \"1\"\nprotocol = \"1\"\nrun = [\"a\"]\n";
        for (text, expected) in [
            ("[plugin]\nname = \"a\"", "unknown key `plugin`: `name`, `version` and `run` stand"),
            ("name = \"a\"\nversion = 1", "`version` must be a text in quotes: write version = \""),
            ("name = \"a\"\nversion = \"1\"", "`protocol` is missing: write protocol = \"1\""),
            (&format!("{head}[agent]\nname = \"x\""), "`agent` must be a list: write [[agent]]"),
            (&format!("{head}[[agents]]"), "unknown key `agents`: did you mean `agent`?"),
            (&format!("{head}[permissions]\nnetwork = \"yes\""), "must be true or false"),
            (&format!("{head}[permissions]\nfiles = -1"), "`files` must be a whole number"),
            (&format!("{head}[permissions]\ncpu = \"half\""), "`cpu` must be a number"),
            (&format!("{head}[permissions]\ndevices = \"/dev/a\""), "`devices` must be a list"),
            (&format!("{head}[config]\nroom = \"text\""), "`room` must be a table"),
        ] {
            let said = said(text);
            assert!(said.contains(expected), "{text}\n{said}");
        }
    }
}
