//! Checks the language of comments and names, as far as it can be counted. The subject of a comment
//! comes first and has a name, and one name of a type has one meaning (CONTRIBUTING.md,
//! docs/glossary.md).

use std::collections::{BTreeMap, BTreeSet};

use crate::source::{comments, production, words};
use crate::{none, root};

/// Names of types that several crates define, with reasons.
const SHARED_NAMES: &[(&str, &str)] = &[
    ("BoxFuture", "the usual alias; gpio-lines knows no other crate of ours"),
    ("Config", "what the configuration of a plugin is called in its own crate"),
    ("Problem", "a PDDL problem, and the reasons why a message cannot be decoded"),
    ("Simulated", "the simulated driver of a plugin"),
];

/// Pronouns that a comment replaces by the name of the thing: the agent, the sender, the daemon.
const NAMELESS: &[&str] = &["who", "whom", "whose", "whoever", "nobody", "somebody", "anybody"];

/// Words that a doc comment does not open with.
const OPENINGS: &[&str] = &["What", "Who", "Whose", "Of", "Those", "It", "They", "Nobody"];

/// Comment lines in a thousand that may have one of [`NAMELESS`].
const NAMELESS_PER_MILLE: usize = 5;

/// Doc comments in a hundred that may open with one of [`OPENINGS`].
const OPENINGS_PER_CENT: usize = 1;

fn is_nameless(line: &str) -> bool {
    words(line).any(|(_, word)| NAMELESS.iter().any(|nameless| word.eq_ignore_ascii_case(nameless)))
}

/// The text of a line of a doc comment.
fn doc(line: &str) -> Option<&str> {
    line.strip_prefix("///").or_else(|| line.strip_prefix("//!"))
}

/// The first lines of doc comments, with their numbers.
fn openings(lines: &[(usize, String)]) -> impl Iterator<Item = &(usize, String)> {
    let is_doc = |line: &(usize, String)| doc(&line.1).is_some();
    lines.iter().enumerate().filter_map(move |(position, line)| {
        let before = position.checked_sub(1).and_then(|before| lines.get(before));
        let goes_on = before.is_some_and(|before| before.0 + 1 == line.0 && is_doc(before));
        (is_doc(line) && !goes_on).then_some(line)
    })
}

fn opens_badly(line: &str) -> bool {
    let first = doc(line).and_then(|text| words(text).next());
    first.is_some_and(|(_, first)| OPENINGS.contains(&first))
}

#[test]
fn comments_name_their_subject() {
    let (mut lines, mut docs) = (0, 0);
    let (mut nameless, mut openings_found) = (Vec::new(), Vec::new());
    for folder in ["daemon", "plugins"] {
        for (path, found) in comments(&root().join(folder)) {
            let file = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
            let at = |(number, line): &(usize, String)| format!("{file}:{number}: {line}");
            lines += found.len();
            nameless.extend(found.iter().filter(|(_, line)| is_nameless(line)).map(at));
            docs += openings(&found).count();
            let badly = openings(&found).filter(|(_, line)| opens_badly(line));
            openings_found.extend(badly.map(at));
        }
    }
    assert!(lines > 1000 && docs > 1000, "{lines} comments and {docs} doc comments are too few");
    if nameless.len() * 1000 <= lines * NAMELESS_PER_MILLE {
        nameless.clear();
    }
    if openings_found.len() * 100 <= docs * OPENINGS_PER_CENT {
        openings_found.clear();
    }
    none(&nameless, &format!("a comment names the thing instead of {NAMELESS:?}"));
    none(&openings_found, &format!("a doc comment opens with its subject, not with {OPENINGS:?}"));
}

/// Returns the names of the types that `code` defines outside of traits and implementations.
fn types_of(code: &str) -> Vec<&str> {
    let is_keyword = |word: &str| ["struct", "enum", "trait", "type"].contains(&word);
    let words: Vec<_> = words(code).collect();
    let is_indented = |at: usize| code[..at].ends_with("    ") && code[at..].starts_with("type");
    let pairs = words.windows(2).filter(|pair| is_keyword(pair[0].1) && !is_indented(pair[0].0));
    let is_name = |name: &&str| name.starts_with(char::is_uppercase);
    pairs.map(|pair| pair[1].1).filter(is_name).collect()
}

#[test]
fn a_type_name_has_one_meaning() {
    let mut crates: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for folder in ["daemon", "plugins"] {
        for (path, code) in production(&root().join(folder)) {
            let path = path.strip_prefix(root()).unwrap_or(&path).to_owned();
            let of: Vec<_> = path.components().take(3).map(|part| part.as_os_str()).collect();
            let of = of.join("/".as_ref()).to_string_lossy().into_owned();
            for name in types_of(&code) {
                crates.entry(name.to_owned()).or_default().insert(of.clone());
            }
        }
    }
    assert!(crates.len() > 1000, "{} types are too few", crates.len());
    let is_shared = |name: &str| SHARED_NAMES.iter().any(|(shared, _)| *shared == name);
    let several = crates.iter().filter(|(_, of)| of.len() > 1);
    let mut complaints: Vec<_> = several
        .filter(|(name, _)| !is_shared(name))
        .map(|(name, of)| format!("`{name}` is defined in {of:?}: give each a name of its own"))
        .collect();
    let is_needed = |name: &str| crates.get(name).is_some_and(|of| of.len() > 1);
    let unneeded = SHARED_NAMES.iter().filter(|(name, _)| !is_needed(name));
    complaints.extend(unneeded.map(|(name, why)| format!("`{name}` is not shared: drop “{why}”")));
    none(&complaints, "one name of a type has one meaning");
}

// === the rule can fail ===

#[test]
fn types_are_found_in_code_only() {
    let code =
        "pub struct One;\nenum Two {}\nimpl T for One {\n    type Out = u8;\n}\ntype Three = u8;";
    assert_eq!(types_of(code), ["One", "Two", "Three"]);
}

#[test]
fn forbidden_words_are_found() {
    assert!(is_nameless("/// Asks who holds a name."));
    assert!(!is_nameless("/// The whole of it."));
    assert!(opens_badly("/// Of what a package brings there is one."));
    assert!(!opens_badly("/// Office of the paper."));
    let lines = [(1, "/// One."), (2, "/// It goes on."), (4, "//! It begins."), (5, "// no doc")];
    let lines = lines.map(|(number, line)| (number, line.to_owned()));
    let first: Vec<_> = openings(&lines).map(|(number, _)| *number).collect();
    assert_eq!(first, [1, 4]);
}
