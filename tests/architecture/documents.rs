//! Checks that the source files named in documents exist, so that a renamed file is renamed there,
//! too.

use std::fs;
use std::path::Path;

use crate::source::{read, rust_files};
use crate::{none, root};

/// Returns the paths of Rust files that a document names, each in backticks.
fn named(document: &str) -> Vec<&str> {
    let is_path = |text: &&str| {
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "/_.-".contains(letter);
        text.ends_with(".rs") && text.chars().all(is_plain)
    };
    document.split('`').skip(1).step_by(2).filter(is_path).collect()
}

/// Whether any of `files` has the path `end`, which may be the last part of a longer path.
fn is_there(files: &[String], end: &str) -> bool {
    files.iter().any(|file| file == end || file.ends_with(&format!("/{end}")))
}

#[test]
fn documents_name_source_files_that_exist() {
    let root = root();
    let relative = |path: &Path| path.to_string_lossy().into_owned();
    let files: Vec<_> = rust_files(&root).iter().map(|path| relative(path)).collect();
    let mut documents = Vec::new();
    for folder in [root.clone(), root.join("docs")] {
        let entries = fs::read_dir(&folder).expect("the folder is there").flatten();
        let pages = entries.map(|entry| entry.path());
        documents.extend(pages.filter(|path| path.extension().is_some_and(|it| it == "md")));
    }
    assert!(documents.len() > 10, "the documents are found");
    let mut complaints = Vec::new();
    for document in documents {
        let text = read(&document);
        let missing = named(&text).into_iter().filter(|name| !is_there(&files, name));
        complaints.extend(missing.map(|name| format!("{} names `{name}`", relative(&document))));
    }
    none(&complaints, "documents name source files that exist");
}

#[test]
fn paths_in_backticks_are_found() {
    let text = "see `a/b.rs` and `c.rs`, not `d.rs x`, `e.py` or f.rs";
    assert_eq!(named(text), ["a/b.rs", "c.rs"]);
    let files = ["/root/a/b.rs".to_owned()];
    assert!(is_there(&files, "a/b.rs") && is_there(&files, "b.rs"));
    assert!(!is_there(&files, "x/b.rs") && !is_there(&files, ".rs"));
}
