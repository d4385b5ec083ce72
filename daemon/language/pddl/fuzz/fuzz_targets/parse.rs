//! Fuzz target for any bytes. Parsing must end, the places of all mistakes must lie in the text,
//! and a text without mistakes must be printed to a text that parses to the same tree.
//!
//! Run `cargo +nightly fuzz run parse` in this folder.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pddl::{Diagnostic, Document, parse_document, text_from_bytes};

fuzz_target!(|bytes: &[u8]| {
    let text = text_from_bytes(bytes);
    let parsed = parse_document(&text);
    check_spans(&text, &parsed.diagnostics);
    if let Some(document) = &parsed.value {
        check_spans(&text, &check(document));
    }
    if let Ok(document) = parsed.into_result() {
        let printed = document.to_string();
        assert_eq!(parse_document(&printed).into_result(), Ok(document), "{printed}");
    }
});

fn check_spans(text: &str, diagnostics: &[Diagnostic]) {
    for diagnostic in diagnostics {
        assert!(text.get(diagnostic.span.range()).is_some(), "{diagnostic:?}");
    }
}

fn check(document: &Document) -> Vec<Diagnostic> {
    let home = pddl::Domain::named("home");
    match document {
        Document::Domain(domain) => pddl::check_domain(domain),
        Document::Problem(problem) => pddl::check_problem(&home, problem),
        Document::ActionModel(model) => pddl::check_action_model(&home, model),
    }
}
