//! The length of functions, as a ratchet: known long functions may only shrink, and no other
//! function may exceed the limit.

use crate::source::{Function, functions, production};
use crate::{none, root};

/// Maximum length of a function in lines, from `fn` to the last brace.
const LINES_MAX: usize = 67;

/// Longer functions, by file and name, with the lines they may have. Never add one.
const KNOWN: &[(&str, &str, usize)] = &[];

/// Returns complaints about functions of one file that exceed their limit, and about known
/// functions that no longer do.
fn too_long(file: &str, functions: &[Function], known: &[(&str, &str, usize)]) -> Vec<String> {
    let limit = |name: &str| {
        let entry = known.iter().find(|(of, known, _)| *of == file && *known == name);
        entry.map_or(LINES_MAX, |(_, _, lines)| *lines)
    };
    let grown = functions.iter().filter(|function| function.lines > limit(&function.name)).map(
        |Function { name, line, lines }| {
            format!("{file}:{line}: `{name}` has {lines} lines, more than {}", limit(name))
        },
    );
    let is_long = |name: &str| {
        functions.iter().any(|function| function.name == name && function.lines > LINES_MAX)
    };
    let shrunk = known
        .iter()
        .filter(|(of, name, _)| *of == file && !is_long(name))
        .map(|(of, name, _)| format!("{of}: `{name}` is short enough now: drop it from KNOWN"));
    grown.chain(shrunk).collect()
}

#[test]
fn no_function_grows_past_the_limit() {
    let root = root();
    let files: Vec<_> = ["daemon", "plugins"]
        .iter()
        .flat_map(|folder| production(&root.join(folder)))
        .map(|(path, code)| {
            let file = path.strip_prefix(&root).unwrap_or(&path).display().to_string();
            (file, functions(&code))
        })
        .collect();
    let mut complaints: Vec<_> =
        files.iter().flat_map(|(file, functions)| too_long(file, functions, KNOWN)).collect();
    let gone = KNOWN.iter().filter(|(file, ..)| !files.iter().any(|(known, _)| known == file));
    complaints.extend(gone.map(|(file, ..)| format!("{file} is gone: drop it from KNOWN")));
    none(&complaints, "a function past 67 lines is taken apart");
}

// === the rule can fail ===

#[test]
fn known_long_functions_may_only_shrink() {
    let check = |lines, known: &[(&str, &str, usize)], complaints| {
        let function = Function { name: "f".to_owned(), line: 1, lines };
        assert_eq!(too_long("a.rs", &[function], known).len(), complaints, "{lines}, {known:?}");
    };
    check(LINES_MAX, &[], 0);
    check(LINES_MAX + 1, &[], 1);
    check(90, &[("a.rs", "f", 90)], 0);
    check(91, &[("a.rs", "f", 90)], 1);
    check(60, &[("a.rs", "f", 90)], 1);
    check(90, &[("b.rs", "f", 90)], 1);
}
