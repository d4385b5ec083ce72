//! Reads just enough Rust to find words, functions and test modules. It is no full parser, because
//! a test of the architecture should not need a compiler's front end to build.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders without source of this project.
const FOREIGN: &[&str] = &["target", "corpus", "artifacts", "vendor"];

/// Folders with Rust that runs in no daemon: tests, benchmarks, examples, fuzz targets.
const ASIDE: &[&str] = &["tests", "benches", "examples", "fuzz"];

/// A function, with its length in lines from `fn` to its last brace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Function {
    pub(crate) name: String,
    pub(crate) line: usize,
    pub(crate) lines: usize,
}

/// Returns all files under `folder` with the ending `.rs`, sorted.
pub(crate) fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    collect(folder, &mut files);
    files.sort();
    files
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && !FOREIGN.contains(&name) {
            collect(&path, files);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
}

/// Returns a file's text.
pub(crate) fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("read {}: {error}", path.display()))
}

/// Returns the production files under `folder`, each with its code: without comments, texts, and
/// items compiled for tests only.
pub(crate) fn production(folder: &Path) -> Vec<(PathBuf, String)> {
    let files = production_files(folder).into_iter();
    files.map(|(path, source)| (path, without_tests(&code(&source)))).collect()
}

/// Returns the comments of the production files under `folder`: the lines that begin with `//`,
/// each with its number.
pub(crate) fn comments(folder: &Path) -> Vec<(PathBuf, Vec<(usize, String)>)> {
    let files = production_files(folder).into_iter();
    files.map(|(path, source)| (path, comments_of(&source))).collect()
}

fn comments_of(source: &str) -> Vec<(usize, String)> {
    let code = code(source);
    let tests: Vec<_> = test_items(&code)
        .into_iter()
        .map(|(start, item)| line_of(&code, start)..=line_of(&code, start + item.len()))
        .collect();
    let lines = source.lines().map(str::trim).zip(1..);
    lines
        .filter(|(line, number)| {
            line.starts_with("//") && !tests.iter().any(|test| test.contains(number))
        })
        .map(|(line, number)| (number, line.to_owned()))
        .collect()
}

/// Returns the production files under `folder`, each with its source.
fn production_files(folder: &Path) -> Vec<(PathBuf, String)> {
    let is_aside = |path: &Path| {
        path.strip_prefix(folder).is_ok_and(|path| {
            path.components().any(|part| ASIDE.iter().any(|aside| part.as_os_str() == *aside))
        })
    };
    let files = rust_files(folder);
    let tests: BTreeSet<_> =
        files.iter().flat_map(|path| test_modules(path, &code(&read(path)))).collect();
    files
        .into_iter()
        .filter(|path| !is_aside(path) && !tests.iter().any(|test| is_of(path, test)))
        .map(|path| {
            let source = read(&path);
            (path, source)
        })
        .collect()
}

/// Whether `path` is the file of `module` (a path without ending), or lies below it.
fn is_of(path: &Path, module: &Path) -> bool {
    path.with_extension("") == *module || path.starts_with(module)
}

/// Returns the modules in files of their own that `code` declares for tests only, as paths without
/// ending.
fn test_modules(path: &Path, code: &str) -> Vec<PathBuf> {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    let folder = match stem {
        "lib" | "main" | "mod" => path.parent().unwrap_or(path).to_owned(),
        _ => path.with_extension(""),
    };
    test_items(code)
        .into_iter()
        .filter_map(|(_, item)| item.trim().strip_prefix("mod ")?.strip_suffix(';'))
        .map(|name| folder.join(name.trim()))
        .collect()
}

/// Returns code with the items under `#[cfg(test)]` blanked out. Line numbers are preserved.
pub(crate) fn without_tests(code: &str) -> String {
    let mut rest = code.to_owned();
    for (start, item) in test_items(code) {
        let blank: String = item.chars().map(blanked).collect();
        rest.replace_range(start..start + item.len(), &blank);
    }
    rest
}

/// Returns the items under `#[cfg(test)]`, each with its start.
fn test_items(code: &str) -> Vec<(usize, &str)> {
    const ATTRIBUTE: &str = "#[cfg(test)]";
    code.match_indices(ATTRIBUTE)
        .map(|(start, _)| start + ATTRIBUTE.len())
        .map(|start| (start, &code[start..start + item_length(&code[start..])]))
        .collect()
}

/// Returns the length of the item at the start of `code`: to its `;`, or to the end of its braces.
pub(crate) fn item_length(code: &str) -> usize {
    let (mut depth, mut braces) = (0_i32, 0_i32);
    for (index, char) in code.char_indices() {
        match char {
            '(' | '[' => depth += 1,
            ')' | ']' => depth -= 1,
            '{' => braces += 1,
            '}' => braces -= 1,
            _ => (),
        }
        let is_end = match char {
            ';' => depth == 0 && braces == 0,
            '}' => depth == 0 && braces <= 0,
            _ => false,
        };
        if is_end {
            return index + char.len_utf8();
        }
    }
    code.len()
}

/// Returns the functions of `code` that have a body.
pub(crate) fn functions(code: &str) -> Vec<Function> {
    words(code)
        .filter(|(_, word)| *word == "fn")
        .filter_map(|(start, _)| {
            let (_, name) = words(&code[start + 2..]).next()?;
            let named = code[start + 2..].trim_start().starts_with(name);
            let item = &code[start..start + item_length(&code[start..])];
            let line = code[..start].lines().count().max(1);
            let has_body = item.ends_with('}') && named;
            has_body.then(|| Function { name: name.to_owned(), line, lines: item.lines().count() })
        })
        .collect()
}

/// Returns the words of `code`, each with its start.
pub(crate) fn words(code: &str) -> impl Iterator<Item = (usize, &str)> {
    let is_word = |char: char| char.is_alphanumeric() || char == '_';
    code.split(move |char| !is_word(char))
        .map(move |word| (word.as_ptr().addr() - code.as_ptr().addr(), word))
        .filter(|(_, word)| !word.is_empty())
}

/// Returns the line of the byte at `index`, counted from 1.
pub(crate) fn line_of(code: &str, index: usize) -> usize {
    code[..index].matches('\n').count() + 1
}

/// Returns source with comments, strings and characters blanked out. Line numbers are preserved.
pub(crate) fn code(source: &str) -> String {
    let mut code = String::with_capacity(source.len());
    let mut rest = source;
    let mut before = ' ';
    while let Some(first) = rest.chars().next() {
        let skipped = not_code(rest, before);
        let taken = skipped.max(first.len_utf8());
        if skipped == 0 {
            code.push(first);
        } else {
            code.extend(rest[..skipped].chars().map(blanked));
        }
        before = first;
        rest = &rest[taken..];
    }
    code
}

fn blanked(char: char) -> char {
    if char == '\n' { '\n' } else { ' ' }
}

/// Returns the number of bytes at the start of `rest` that are a comment, a string or a character.
fn not_code(rest: &str, before: char) -> usize {
    let is_inside_word = before.is_alphanumeric() || before == '_';
    if rest.starts_with("//") {
        rest.find('\n').unwrap_or(rest.len())
    } else if rest.starts_with("/*") {
        block_comment(rest)
    } else if let Some(quoted) = rest.strip_prefix('"') {
        1 + text(quoted)
    } else if rest.starts_with('\'') {
        character(rest)
    } else if is_inside_word {
        0
    } else {
        raw_text(rest)
    }
}

fn block_comment(rest: &str) -> usize {
    let mut depth = 0_i32;
    for (index, _) in rest.char_indices() {
        if rest[index..].starts_with("/*") {
            depth += 1;
        } else if rest[index..].starts_with("*/") {
            depth -= 1;
            if depth == 0 {
                return index + 2;
            }
        }
    }
    rest.len()
}

/// Returns the length of a string after its opening quote, including its closing one.
fn text(rest: &str) -> usize {
    let mut is_escaped = false;
    for (index, char) in rest.char_indices() {
        match char {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return index + 1,
            _ => (),
        }
    }
    rest.len()
}

/// Returns the length of `r"…"`, `r#"…"#`, `br"…"`, or 0.
fn raw_text(rest: &str) -> usize {
    let prefix = ["r", "br", "cr"].into_iter().find(|prefix| {
        rest.strip_prefix(prefix).is_some_and(|rest| rest.trim_start_matches('#').starts_with('"'))
    });
    let Some(prefix) = prefix else { return 0 };
    let body = &rest[prefix.len()..];
    let fences = body.len() - body.trim_start_matches('#').len();
    let end = format!("\"{}", "#".repeat(fences));
    let opened = prefix.len() + fences + 1;
    rest[opened..].find(&end).map_or(rest.len(), |index| opened + index + end.len())
}

/// Returns the length of `'c'`, or 0 if the quote begins a lifetime.
fn character(rest: &str) -> usize {
    let mut chars = rest.char_indices().skip(1);
    match (chars.next(), chars.next()) {
        (Some((_, '\\')), Some((after, _))) => {
            // An escaped character may be a quote itself, so the end is searched after it.
            let escaped = rest[after..].chars().next().map_or(0, char::len_utf8);
            rest[after + escaped..].find('\'').map_or(0, |index| after + escaped + index + 1)
        }
        (Some(_), Some((index, '\''))) => index + 1,
        _ => 0,
    }
}

// === tests of the reader ===

/// Checks names and lengths of the functions in `source`.
#[track_caller]
fn check_functions(source: &str, expected: &[(&str, usize)]) {
    let functions = functions(&without_tests(&code(source)));
    let found: Vec<_> =
        functions.iter().map(|function| (function.name.as_str(), function.lines)).collect();
    assert_eq!(found, expected, "{source}");
}

#[test]
fn functions_are_measured() {
    check_functions("fn one() {}\n", &[("one", 1)]);
    check_functions("fn two(a: [u8; 4])\nwhere A: B {\n}\n", &[("two", 3)]);
    check_functions("trait T { fn declared(&self); fn given(&self) {\n\n} }", &[("given", 3)]);
    check_functions("fn outer() {\n fn inner() {}\n}", &[("outer", 3), ("inner", 1)]);
    check_functions("type F = fn(u8) -> u8; struct S { f: fn() }", &[]);
}

#[test]
fn braces_that_are_not_code_do_not_count() {
    check_functions("fn a() { let s = \"}\\\"}\"; \n}", &[("a", 2)]);
    check_functions("fn a() { let s = r#\"}\"}\"#; \n}", &[("a", 2)]);
    check_functions("fn a<'a>(x: &'a str) { let c = '}'; let d = '\\''; // }\n}", &[("a", 2)]);
    check_functions("fn a() { /* } /* } */ } */ \n}", &[("a", 2)]);
    check_functions("fn a() { matcher\"}\" \n}", &[("a", 2)]);
}

#[test]
fn tests_are_no_production() {
    let source = "fn a() {}\n#[cfg(test)]\nmod tests {\n fn b() { x.unwrap() }\n}\nfn c() {}\n";
    check_functions(source, &[("a", 1), ("c", 1)]);
    assert_eq!(without_tests(&code(source)).lines().count(), source.lines().count());
}

#[test]
fn comments_of_tests_are_not_those_of_production() {
    let source =
        "//! One.\nfn a() {} // beside\n#[cfg(test)]\nmod tests {\n    // Two.\n}\n/// Three.\n";
    let found: Vec<_> = comments_of(source).into_iter().map(|(number, _)| number).collect();
    assert_eq!(found, [1, 7]);
}

#[test]
fn test_modules_in_files_of_their_own_are_found() {
    let found = |path| test_modules(Path::new(path), "#[cfg(test)]\nmod tests;\nmod other;");
    assert_eq!(found("a/src/lib.rs"), [PathBuf::from("a/src/tests")]);
    assert_eq!(found("a/src/world.rs"), [PathBuf::from("a/src/world/tests")]);
    assert!(is_of(Path::new("a/src/tests.rs"), Path::new("a/src/tests")));
    assert!(is_of(Path::new("a/src/tests/guests.rs"), Path::new("a/src/tests")));
    assert!(!is_of(Path::new("a/src/tested.rs"), Path::new("a/src/tests")));
}

#[test]
fn lines_are_counted_from_one() {
    let code = "a\nb\n";
    let lines: Vec<_> = words(code).map(|(start, word)| (word, line_of(code, start))).collect();
    assert_eq!(lines, [("a", 1), ("b", 2)]);
}
