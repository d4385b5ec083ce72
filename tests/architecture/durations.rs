//! Durations: each one that is written as a number has a name, and the name a comment with its
//! reason. The settings that people may change are fields with comments, and are exempt.

use std::ops::Range;

use crate::source::{code, line_of, production, read, without_tests, words};
use crate::{none, root};

/// Beginning of every constructor of a duration.
const MADE: &str = "Duration::from_";

/// Files in which durations have names of another kind, with reasons.
const NAMED_OTHERWISE: &[(&str, &str)] =
    &[("daemon/agents/agent/src/settings.rs", "the fields of the settings are the names")];

/// Returns the places of constants and statics in `code`, from their name to their `;`.
fn constants(code: &str) -> Vec<Range<usize>> {
    let items = words(code).filter(|(_, word)| matches!(*word, "const" | "static"));
    let named = |(start, word): (usize, &str)| {
        let start = start + word.len();
        let name = code[start..].trim_start();
        // `const fn`, `*const T` and parameters are no constants.
        let is_upper = name.starts_with(|char: char| char.is_ascii_uppercase() || char == '_');
        is_upper.then(|| start..start + length_to_semicolon(&code[start..]))
    };
    items.filter_map(named).collect()
}

/// Returns the length of `code` up to the first `;` outside brackets.
fn length_to_semicolon(code: &str) -> usize {
    let mut depth = 0_usize;
    for (index, char) in code.char_indices() {
        match char {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            ';' if depth == 0 => return index,
            _ => (),
        }
    }
    code.len()
}

/// Returns the lines of durations in `code` that are written as numbers outside constants.
fn unnamed(code: &str) -> Vec<usize> {
    let constants = constants(code);
    let is_number = |place: &usize| {
        let rest = &code[*place + MADE.len()..];
        let argument = rest.split_once('(').and_then(|(_, rest)| rest.split_once(')'));
        argument.is_some_and(|(argument, _)| {
            argument.contains(|char: char| char.is_ascii_digit())
                && argument.chars().all(|char| char.is_ascii_digit() || "_. *+/".contains(char))
        })
    };
    let places = code.match_indices(MADE).map(|(place, _)| place).filter(is_number);
    let unnamed = places.filter(|place| !constants.iter().any(|range| range.contains(place)));
    unnamed.map(|place| line_of(code, place)).collect()
}

/// Returns the lines of constant durations in `source` that have no comment. One comment may be
/// about several constants in a row.
fn unexplained(source: &str) -> Vec<usize> {
    let code = without_tests(&code(source));
    let lines: Vec<&str> = source.lines().map(str::trim).collect();
    let is_constant = |line: usize| {
        let line = lines[line - 1];
        line.split(' ').take(2).any(|word| word == "const") && line.contains(": ")
    };
    let constants = constants(&code).into_iter();
    let durations = constants.filter(|range| code[range.clone()].contains("Duration ="));
    let starts = durations.map(|range| line_of(&code, range.start));
    let has_no_comment = |start: &usize| {
        let first = (1..*start).rev().take_while(|line| is_constant(*line)).last();
        let above = first.unwrap_or(*start).checked_sub(2);
        !above.is_some_and(|above| lines[above].starts_with("//"))
    };
    starts.filter(has_no_comment).collect()
}

#[test]
fn every_duration_has_a_name_and_a_reason() {
    let root = root();
    let mut complaints = Vec::new();
    let mut exempt = Vec::new();
    for folder in ["daemon", "plugins"] {
        for (path, code) in production(&root.join(folder)) {
            let file = path.strip_prefix(&root).unwrap_or(&path).display().to_string();
            let found = unnamed(&code);
            if NAMED_OTHERWISE.iter().any(|(known, _)| *known == file) {
                exempt.extend((!found.is_empty()).then(|| file.clone()));
            } else {
                let at = |line| format!("{file}:{line}: a duration without a name");
                complaints.extend(found.into_iter().map(at));
            }
            let at = |line| format!("{file}:{line}: a duration without a reason");
            complaints.extend(unexplained(&read(&path)).into_iter().map(at));
        }
    }
    let unused = NAMED_OTHERWISE.iter().filter(|(known, _)| !exempt.iter().any(|it| it == known));
    complaints.extend(unused.map(|(file, why)| format!("{file} needs no exception: drop “{why}”")));
    none(&complaints, "a duration is a named constant with a comment, or a setting");
}

// === the rules can fail ===

#[test]
fn durations_without_a_name_are_found() {
    for (source, expected) in [
        ("fn a() {\n    sleep(Duration::from_secs(5));\n}", vec![2]),
        ("fn a() { b.min(Duration::from_millis(24 * 3_600)) }", vec![1]),
        ("const A: Duration = Duration::from_secs(5);", vec![]),
        ("const A: [Duration; 2] = [\n    Duration::from_secs(5),\n    B];", vec![]),
        ("const fn a() -> Duration { Duration::from_secs(5) }", vec![1]),
        ("fn a() { Duration::from_secs(seconds) }", vec![]),
        ("fn a() { Duration::from_secs_f64(meters / 2.0) }", vec![]),
    ] {
        assert_eq!(unnamed(&code(source)), expected, "{source}");
    }
}

#[test]
fn durations_without_a_reason_are_found() {
    for (source, expected) in [
        ("/// Why.\nconst A: Duration = B;", vec![]),
        ("/// Why.\nconst A: Duration = B;\npub const C: Duration = D;", vec![]),
        ("use a;\nconst A: Duration = B;", vec![2]),
        ("const A: Duration = B;", vec![1]),
        ("/// Why.\nconst A: Duration = B;\n\nconst C: Duration = D;", vec![4]),
        ("const A: usize = 3;", vec![]),
    ] {
        assert_eq!(unexplained(source), expected, "{source}");
    }
}
