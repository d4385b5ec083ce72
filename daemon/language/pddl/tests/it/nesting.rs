//! Tests of texts that are nested deeper than a stack allows, and of short texts that would become
//! large trees. Every operation must end on a thread with a small stack.

use pddl::{NESTING_MAX, Parsed};

/// Size of the stack in bytes in a debug build: half the size of a standard thread's stack.
const STACK_BYTES: usize = 1 << 20;

/// Runs all operations that recurse over a tree: parsing, printing, comparing, hashing, dropping.
fn check(text: String, is_ok: bool) {
    let everything = move || {
        let parsed = pddl::parse_document(&text);
        assert_eq!(parsed.is_ok(), is_ok, "{:?}", parsed.diagnostics.first());
        let Parsed { value, diagnostics } = parsed;
        // The number of mistakes must not grow with the number of parentheses.
        assert!(diagnostics.len() < 2_000);
        if let Some(document) = value {
            assert_eq!(document.clone(), document);
            let printed = document.to_string();
            assert!(pddl::parse_document(&printed).is_ok());
            assert!(format!("{document:?}").contains("name"));
            if let pddl::Document::Domain(domain) = &document {
                pddl::check_domain(domain);
            }
        }
        pddl::parse_condition(&text);
        pddl::parse_init_elements(&text);
        pddl::parse_plan(&text);
    };
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(everything);
    thread.expect("a thread can be had").join().expect("nothing overflows");
}

fn domain(condition: &str) -> String {
    format!("(define (domain d) (:predicates (p)) (:action a :precondition {condition}))")
}

fn nested(open: &str, inner: &str, depth: usize) -> String {
    open.repeat(depth) + inner + &")".repeat(depth)
}

#[test]
fn the_deepest_accepted_condition_is_safe() {
    // The definition, the action and the innermost atom add one level each.
    for open in ["(not ", "(and ", "(imply (p) ", "(forall (?x) ", "(when (p) "] {
        check(domain(&nested(open, "(p)", NESTING_MAX - 3)), !open.starts_with("(when"));
    }
    for (inner, is_ok) in [("1", true), ("(f)", false), ("f", false)] {
        let expression = format!("(= 0 {})", nested("(- ", inner, NESTING_MAX - 3));
        check(domain(&expression), is_ok);
    }
}

#[test]
fn one_level_deeper_is_rejected() {
    check(domain(&nested("(not ", "(p)", NESTING_MAX - 2)), false);
}

#[test]
fn a_hundred_thousand_parentheses_do_not_overflow_the_stack() {
    check("(".repeat(100_000), false);
    check(")".repeat(100_000), false);
    check(nested("(", "", 100_000), false);
    check(domain(&nested("(not ", "(p)", 100_000)), false);
    check("(define (domain d) ".to_owned() + &"(:action ".repeat(100_000), false);
}

#[test]
fn a_short_text_cannot_become_a_large_tree() {
    let many = |word: &str| format!("{word} ").repeat(2_000);
    let alternatives =
        format!("(define (domain d) (:types {} - (either {})))", many("t"), many("s"));
    check(alternatives, false);
    let conditions = format!("(forall ({}) (and {}))", many("?x"), "(at start (p)) ".repeat(2_000));
    check(
        format!("(define (domain d) (:durative-action a :duration () :condition {conditions}))"),
        false,
    );
}
