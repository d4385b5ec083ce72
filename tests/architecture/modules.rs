//! Checks which top-level modules of one crate import each other in a circle.
//!
//! The imports of a module are the paths in its production source that begin with `crate`, `super`
//! or `self`. A name that the root of the crate re-exports counts as an import of its module. The
//! root itself names all modules, so it is no part of a circle.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::source::{item_length, line_of, production, words};
use crate::{none, root};

/// Folders with crates.
const FOLDERS: &[&str] = &["daemon", "plugins", "tests/laboratory"];

/// Circles that stay, each with its reason. Prefer to move a type to the module that owns it.
const CIRCLES: &[Circle] = &[
    circle(
        "althing",
        &["commands", "prompt"],
        "the prompt runs commands, and two commands (`keyboard`, `up --keyboard`) open the prompt",
    ),
    circle(
        "phrases",
        &[
            "alignment",
            "completion",
            "likeness",
            "nearest",
            "numbers",
            "phrasebook",
            "reading",
            "saying",
            "sentences",
        ],
        "the phrase book has the words that these read and say with, and is what calls them; a \
         text that is not understood is corrected, and each correction is read in turn",
    ),
];

/// A known circle of modules.
#[derive(Clone, Copy, Debug)]
struct Circle {
    of: &'static str,
    modules: &'static [&'static str],
    reason: &'static str,
}

const fn circle(
    of: &'static str,
    modules: &'static [&'static str],
    reason: &'static str,
) -> Circle {
    Circle { of, modules, reason }
}

/// A source file of a crate.
struct SourceFile {
    /// Path of the file, for complaints.
    file: String,
    /// Module that the file contains; empty for the root.
    module: Vec<String>,
    code: String,
}

/// The imports among the top-level modules of a crate: for each module the modules that it imports,
/// each with one place.
type Imports = BTreeMap<String, BTreeMap<String, String>>;

// === paths in source ===

/// Returns the tokens of `code`, each with its start: words, `::`, and single other characters.
fn tokens(code: &str) -> Vec<(usize, &str)> {
    let ends: BTreeMap<_, _> = words(code).collect();
    let (mut tokens, mut skipped) = (Vec::new(), 0);
    for (start, char) in code.char_indices().filter(|(_, char)| !char.is_whitespace()) {
        if start < skipped {
            continue;
        }
        let token = match ends.get(&start) {
            Some(word) => *word,
            None if code[start..].starts_with("::") => "::",
            None => &code[start..start + char.len_utf8()],
        };
        skipped = start + token.len();
        tokens.push((start, token));
    }
    tokens
}

fn is_word(token: &str) -> bool {
    token.starts_with(|first: char| first.is_alphanumeric() || first == '_')
}

/// Reads a path or a tree of paths at the start of `tokens`, such as `a::{b, c::d}`. Returns its
/// paths, without the new names after `as`.
fn paths(tokens: &mut &[(usize, &str)]) -> Vec<Vec<String>> {
    let mut path = Vec::new();
    while let Some(((_, token), rest)) = tokens.split_first() {
        match *token {
            "{" => {
                *tokens = rest;
                return branches(tokens)
                    .into_iter()
                    .map(|branch| [&*path, &*branch].concat())
                    .collect();
            }
            word if is_word(word) || word == "*" => path.push(word.to_owned()),
            _ => break,
        }
        *tokens = rest;
        let [(_, "::"), (_, next), ..] = *rest else { break };
        if !is_word(next) && !["{", "*"].contains(&next) {
            break;
        }
        *tokens = &rest[1..];
    }
    vec![path]
}

/// Reads the branches of a tree up to its `}`.
fn branches(tokens: &mut &[(usize, &str)]) -> Vec<Vec<String>> {
    let mut all = Vec::new();
    while let Some(((_, token), rest)) = tokens.split_first() {
        match *token {
            "}" => {
                *tokens = rest;
                break;
            }
            "as" => *tokens = rest.get(1..).unwrap_or_default(),
            token if is_word(token) || token == "{" || token == "*" => all.extend(paths(tokens)),
            _ => *tokens = rest,
        }
    }
    all
}

/// Returns the modules in braces inside `code`, each with its range.
fn inline_modules<'c>(
    code: &str,
    tokens: &[(usize, &'c str)],
) -> Vec<(std::ops::Range<usize>, &'c str)> {
    let declared = tokens.windows(3).filter_map(|window| match window {
        [(start, "mod"), (_, name), (_, "{")] => Some((*start, *name)),
        _ => None,
    });
    declared.map(|(start, name)| (start..start + item_length(&code[start..]), name)).collect()
}

/// Returns the paths in `code` that begin with `crate`, `super` or `self`, each from the root of
/// the crate and with its start. `module` is the module that contains the code.
fn absolute_paths(code: &str, module: &[String]) -> Vec<(usize, Vec<String>)> {
    let tokens = tokens(code);
    let inline = inline_modules(code, &tokens);
    let mut found = Vec::new();
    for (index, (start, head)) in tokens.iter().enumerate() {
        let is_head = ["crate", "super", "self"].contains(head)
            && tokens.get(index + 1).is_some_and(|(_, next)| *next == "::")
            && (index == 0 || tokens[index - 1].1 != "::");
        if !is_head {
            continue;
        }
        let around = inline.iter().filter(|(range, _)| range.contains(start));
        let names = around.map(|(_, name)| (*name).to_owned());
        let here: Vec<_> = module.iter().cloned().chain(names).collect();
        for path in paths(&mut &tokens[index..]) {
            found.push((*start, absolute(&here, &path)));
        }
    }
    found
}

/// Returns `path`, which stands in the module `here`, from the root of the crate.
fn absolute(here: &[String], path: &[String]) -> Vec<String> {
    let mut base = here.to_vec();
    let mut rest = path;
    while let [first, others @ ..] = rest {
        match first.as_str() {
            "crate" => base.clear(),
            "super" => drop(base.pop()),
            "self" => (),
            _ => break,
        }
        rest = others;
    }
    base.extend(rest.iter().cloned());
    base
}

/// Returns the names that the root of a crate re-exports, each with its top-level module.
fn re_exports(root: &str, modules: &BTreeSet<String>) -> BTreeMap<String, String> {
    let tokens = tokens(root);
    let mut names = BTreeMap::new();
    for (index, (_, token)) in tokens.iter().enumerate() {
        if *token != "use" {
            continue;
        }
        for path in paths(&mut &tokens[index + 1..]) {
            let path = absolute(&[], &path);
            if let (Some(first), Some(last)) = (path.first(), path.last())
                && modules.contains(first)
                && first != last
            {
                names.insert(last.clone(), first.clone());
            }
        }
    }
    names
}

// === imports and circles ===

/// Returns the imports among the top-level modules of the crate with these files.
fn imports(files: &[SourceFile]) -> Imports {
    let modules: BTreeSet<_> =
        files.iter().filter_map(|file| file.module.first().cloned()).collect();
    let roots = files.iter().filter(|file| file.module.is_empty());
    let names: BTreeMap<_, _> = roots.flat_map(|root| re_exports(&root.code, &modules)).collect();
    let mut imports = Imports::new();
    for SourceFile { file, module, code } in files {
        let Some(own) = module.first() else { continue };
        for (start, path) in absolute_paths(code, module) {
            let Some(first) = path.first() else { continue };
            let target = if modules.contains(first) { Some(first) } else { names.get(first) };
            if let Some(target) = target.filter(|target| *target != own) {
                let place = || format!("{file}:{}", line_of(code, start));
                let of_module = imports.entry(own.clone()).or_default();
                of_module.entry(target.clone()).or_insert_with(place);
            }
        }
    }
    imports
}

/// Returns all modules that `from` imports, directly or through others.
fn reached<'i>(imports: &'i Imports, from: &str) -> BTreeSet<&'i str> {
    let (mut reached, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(module) = open.pop() {
        let targets = imports.get(module).into_iter().flat_map(BTreeMap::keys);
        for target in targets {
            if reached.insert(target.as_str()) {
                open.push(target);
            }
        }
    }
    reached
}

/// Returns the circles: the largest sets of modules of which each imports all others, directly or
/// not.
fn circles(imports: &Imports) -> BTreeSet<Vec<&str>> {
    let reached: BTreeMap<_, _> =
        imports.keys().map(|module| (module.as_str(), reached(imports, module))).collect();
    let mut circles = BTreeSet::new();
    for (module, targets) in &reached {
        let returns = |target: &&str| reached.get(target).is_some_and(|back| back.contains(module));
        let circle: Vec<_> = targets.iter().copied().filter(returns).collect();
        if !circle.is_empty() {
            circles.insert(circle);
        }
    }
    circles
}

/// Returns complaints about circles of the crate `of` that are not known, and about known ones that
/// do not exist any more.
fn complaints(of: &str, imports: &Imports, known: &[Circle]) -> Vec<String> {
    let circles = circles(imports);
    let known: Vec<_> = known.iter().filter(|circle| circle.of == of).collect();
    let is_known = |circle: &Vec<&str>| known.iter().any(|known| known.modules == *circle);
    let new = circles.iter().filter(|&circle| !is_known(circle)).map(|circle| {
        let within = |(module, targets): (&String, &BTreeMap<String, String>)| {
            let inside = targets.iter().filter(|(target, _)| circle.contains(&target.as_str()));
            let inside = inside.map(|(target, place)| format!("{module} → {target} ({place})"));
            inside.collect::<Vec<_>>()
        };
        let inside = imports.iter().filter(|(module, _)| circle.contains(&module.as_str()));
        let steps: Vec<_> = inside.flat_map(within).collect();
        format!("`{of}` has a new circle {circle:?}: {}", steps.join(", "))
    });
    let gone = known.iter().filter(|known| !circles.contains(known.modules)).map(|known| {
        format!("`{of}` has no circle {:?} any more: drop “{}”", known.modules, known.reason)
    });
    new.chain(gone).collect()
}

// === the workspace ===

/// Returns the name of the crate that contains the file at `path`, and the file's module; `None` if
/// the file belongs to no library or is a program of its own.
fn placed(path: &Path) -> Option<(String, Vec<String>)> {
    let parts: Vec<_> = path.iter().filter_map(|part| part.to_str()).collect();
    let src = parts.iter().rposition(|part| *part == "src")?;
    let crate_name = parts.get(src.checked_sub(1)?)?;
    let (file, folders) = parts[src + 1..].split_last()?;
    let mut module: Vec<_> = folders.iter().map(|folder| (*folder).to_owned()).collect();
    match file.strip_suffix(".rs")? {
        "mod" => (),
        "lib" | "main" if folders.is_empty() => (),
        name => module.push(name.to_owned()),
    }
    let is_program = module.first().is_some_and(|first| first == "bin");
    (!is_program).then(|| ((*crate_name).to_owned(), module))
}

#[test]
fn no_circle_of_modules_is_unexplained() {
    let root = root();
    let mut crates: BTreeMap<String, Vec<SourceFile>> = BTreeMap::new();
    for (path, code) in FOLDERS.iter().flat_map(|folder| production(&root.join(folder))) {
        let file = path.strip_prefix(&root).unwrap_or(&path);
        if let Some((crate_name, module)) = placed(file) {
            let file = file.display().to_string();
            crates.entry(crate_name).or_default().push(SourceFile { file, module, code });
        }
    }
    let unknown = CIRCLES.iter().filter(|circle| !crates.contains_key(circle.of));
    let mut found: Vec<_> =
        unknown.map(|circle| format!("`{}` is no crate any more", circle.of)).collect();
    for (name, files) in &crates {
        found.extend(complaints(name, &imports(files), CIRCLES));
    }
    none(&found, "modules do not import each other in a circle");
}

// === the rule can fail ===

fn names(path: &str) -> Vec<String> {
    path.split("::").filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

fn file(module: &str, code: &str) -> SourceFile {
    SourceFile { file: format!("{module}.rs"), module: names(module), code: code.to_owned() }
}

#[test]
fn paths_are_read() {
    let check = |module: &str, code: &str, expected: &[&str]| {
        let found = absolute_paths(code, &names(module));
        let found: Vec<_> = found.into_iter().map(|(_, path)| path.join("::")).collect();
        assert_eq!(found, expected, "{code}");
    };
    check("a", "use crate::b::C;", &["b::C"]);
    check("a", "use crate::{b, c::{self, D as E}, f::*};", &["b", "c::self", "c::D", "f::*"]);
    check(
        "a",
        "fn f(x: &crate::b::C<u8>) -> crate::d::E { self::g::<u8>() }",
        &["b::C", "d::E", "a::g"],
    );
    check("a::b", "use super::c; use super::super::d::E;", &["a::c", "d::E"]);
    check(
        "a",
        "mod b { use super::c; mod d { use super::super::super::e::F; } }",
        &["a::c", "e::F"],
    );
    check("a", "use std::fmt::{self, Debug}; pub(crate) fn f(self) {} self.g();", &[]);
    check("a", "let s = Self::new(); x::crate_name(); $crate::b::m!();", &["b::m"]);
}

#[test]
fn re_exported_names_count_as_their_module() {
    let root =
        file("", "mod a; mod b; pub use a::{One, two::Two}; pub(crate) use crate::b::Three;");
    let modules = BTreeSet::from(["a".to_owned(), "b".to_owned()]);
    let found = re_exports(&root.code, &modules);
    let found: Vec<_> = found.iter().map(|(name, of)| (name.as_str(), of.as_str())).collect();
    assert_eq!(found, [("One", "a"), ("Three", "b"), ("Two", "a")]);
    let files = [root, file("a", "use crate::Three;"), file("b", "fn f(x: crate::One) {}")];
    assert_eq!(circles(&imports(&files)), BTreeSet::from([vec!["a", "b"]]));
}

#[test]
fn circles_are_found_without_the_modules_that_lead_to_them() {
    let files = [
        file("a", "use crate::b::x;"),
        file("b::x", "use super::y; use crate::c::{y, z};"),
        file("b::y", "use super::x;"),
        file("c", "use crate::a; use crate::d;"),
        file("d", "use crate::e;"),
        file("e", "use super::d;"),
        file("f", "use crate::a; use crate::unknown;"),
    ];
    let imports = imports(&files);
    assert_eq!(circles(&imports), BTreeSet::from([vec!["a", "b", "c"], vec!["d", "e"]]));
}

#[test]
fn new_and_former_circles_are_complained_of() {
    let files = [file("a", "use crate::b;"), file("b", "\nuse crate::a;")];
    let imports = imports(&files);
    let check = |of: &str, known: &[Circle], expected: &[&str]| {
        let found = complaints(of, &imports, known);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        let all = found.iter().zip(expected);
        all.for_each(|(found, expected)| assert!(found.contains(expected), "{found}"));
    };
    let known = circle("k", &["a", "b"], "why");
    check("k", &[known], &[]);
    check("other", &[known], &["a → b (a.rs:1), b → a (b.rs:2)"]);
    check("k", &[circle("k", &["a", "c"], "why")], &["new circle", "drop “why”"]);
    check("k", &[known, circle("k", &["c", "d"], "former")], &["drop “former”"]);
}

#[test]
fn files_are_placed_in_modules() {
    let check = |path: &str, expected: Option<(&str, &str)>| {
        let expected = expected.map(|(name, module)| (name.to_owned(), names(module)));
        assert_eq!(placed(Path::new(path)), expected, "{path}");
    };
    check("daemon/agents/agent/src/lib.rs", Some(("agent", "")));
    check("daemon/group/agent/src/router/inbound.rs", Some(("agent", "router::inbound")));
    check("daemon/planning/planner/src/search/mod.rs", Some(("planner", "search")));
    check("daemon/a/src/b/main.rs", Some(("a", "b::main")));
    check("daemon/a/src/bin/b.rs", None);
    check("daemon/a/build.rs", None);
}
