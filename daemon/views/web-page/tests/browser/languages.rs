//! The message catalogues: each language has the same messages with the same values, and every
//! message that the pages name is there.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets")
}

fn catalogue(language: &str) -> BTreeMap<String, String> {
    let file = assets().join(format!("messages/{language}.json"));
    let text = std::fs::read_to_string(file).expect("a catalogue");
    serde_json::from_str(&text).expect("texts by keys")
}

/// Returns the names of the values in a message: `{n} steps` has `n`.
fn values(message: &str) -> BTreeSet<&str> {
    message
        .split('{')
        .skip(1)
        .filter_map(|part| part.split_once('}'))
        .map(|(name, _)| name)
        .collect()
}

/// Returns the texts of all scripts of the pages, without those of others.
fn scripts() -> Vec<String> {
    let mut texts = vec![std::fs::read_to_string(assets().join("app.js")).expect("a script")];
    for folder in ["lib", "pages"] {
        let files = std::fs::read_dir(assets().join(folder)).expect("a folder");
        texts.extend(
            files.map(|file| {
                std::fs::read_to_string(file.expect("a file").path()).expect("a script")
            }),
        );
    }
    texts
}

#[test]
fn all_languages_have_the_same_messages() {
    let english = catalogue("en");
    let files = std::fs::read_dir(assets().join("messages")).expect("a folder");
    let mut languages = 0;
    for file in files {
        let name = file.expect("a file").file_name().into_string().expect("a plain name");
        let language = name.strip_suffix(".json").expect("a catalogue");
        let other = catalogue(language);
        let keys =
            |messages: &BTreeMap<String, String>| messages.keys().cloned().collect::<Vec<_>>();
        assert_eq!(keys(&english), keys(&other), "{language}");
        for (key, message) in &other {
            assert_eq!(values(message), values(&english[key]), "{key} in {language}");
            assert!(!message.trim().is_empty(), "{key} in {language}");
        }
        languages += 1;
    }
    assert!(languages >= 2, "English and one more");
}

#[test]
fn every_message_that_a_page_names_is_there() {
    let english = catalogue("en");
    let mut named = 0;
    for script in scripts() {
        let places = script.match_indices("t(\"");
        // `forget("…")` ends in the same letter.
        let is_own = |at: usize| !script[..at].ends_with(|before: char| before.is_alphanumeric());
        for (at, call) in places.filter(|(at, _)| is_own(*at)) {
            let part = &script[at + call.len()..];
            let Some((key, _)) = part.split_once('"') else { continue };
            let is_key = key.contains('.')
                && key.chars().all(|c| c.is_ascii_lowercase() || ".-".contains(c));
            if !is_key {
                continue;
            }
            named += 1;
            let is_there =
                english.contains_key(key) || english.contains_key(&format!("{key}.other"));
            assert!(is_there, "{key}");
        }
    }
    assert!(named > 200, "only {named} were found");
}

#[test]
fn every_sentence_that_is_translated_has_its_message_and_values() {
    let english = catalogue("en");
    let file = assets().join("lib/told.js");
    let script = std::fs::read_to_string(file).expect("a script");
    let sentences: Vec<_> = script
        .lines()
        .filter_map(|line| line.trim().strip_prefix("[\"")?.split_once("\", /"))
        .collect();
    assert!(sentences.len() > 40, "only {} were found", sentences.len());
    for (key, pattern) in sentences {
        let message = english
            .get(&format!("told.{key}"))
            .or_else(|| english.get(&format!("told.{key}.other")))
            .unwrap_or_else(|| panic!("{key}"));
        let groups = pattern.split("(?<").skip(1).filter_map(|part| part.split_once('>'));
        let groups: BTreeSet<_> = groups.map(|(name, _)| name).collect();
        assert_eq!(groups, values(message), "{key}");
    }
}
