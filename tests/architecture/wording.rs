//! The language of comments, as far as it can be counted: the subject comes first and has a name
//! (CONTRIBUTING.md, docs/glossary.md).

use crate::source::{comments, words};
use crate::{none, root};

/// Pronouns in whose place a comment names the thing: the agent, the sender, the daemon.
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

// === the rule can fail ===

#[test]
fn riddles_are_found() {
    assert!(is_nameless("/// Asks who holds a name."));
    assert!(!is_nameless("/// The whole of it."));
    assert!(opens_badly("/// Of what a package brings there is one."));
    assert!(!opens_badly("/// Office of the paper."));
    let lines = [(1, "/// One."), (2, "/// It goes on."), (4, "//! It begins."), (5, "// no doc")];
    let lines = lines.map(|(number, line)| (number, line.to_owned()));
    let first: Vec<_> = openings(&lines).map(|(number, _)| *number).collect();
    assert_eq!(first, [1, 4]);
}
