//! Tests of properties that all trees and all texts have.

use pddl::{Diagnostic, Document, text_from_bytes};
use proptest::prelude::*;

use crate::generate;

/// Words with a meaning in PDDL, and some unusual words.
const WORDS: &[&str] = &[
    "(",
    ")",
    "(",
    ")",
    "(define",
    "(domain d)",
    "(problem p)",
    "(agent a)",
    "(:domain d)",
    "(:requirements",
    "(:types",
    "(:constants",
    "(:objects",
    "(:predicates",
    "(:functions",
    "(:init",
    "(:goal",
    "(:metric",
    "(:action",
    "(:durative-action",
    "(:derived",
    "(:private",
    ":agent",
    ":parameters",
    ":precondition",
    ":effect",
    ":duration",
    ":condition",
    "(and",
    "(or",
    "(not",
    "(imply",
    "(exists",
    "(forall",
    "(when",
    "(=",
    "(<",
    "(increase",
    "(assign",
    "(at",
    "start",
    "end",
    "(over",
    "all",
    "(either",
    "-",
    "-x",
    "?x",
    "?",
    "?duration",
    "#t",
    "total-time",
    "minimize",
    "5",
    "-1.5",
    "1e999",
    "x",
    "y",
    "(p ?x)",
    "(f)",
    "; x\n",
    ";\r",
    "\u{feff}",
    "\u{a0}",
    "ä",
    "[1.0]",
    "0:",
    "\"",
    "\0",
];

/// Checks any text. The places of its mistakes must lie in the text, and a text without mistakes
/// must be printed to a text that parses to the same tree.
fn check_text(text: &str) -> Result<(), TestCaseError> {
    let document = pddl::parse_document(text);
    check_spans(text, &document.diagnostics)?;
    if let Ok(document) = document.into_result() {
        let printed = document.to_string();
        let returned = pddl::parse_document(&printed).into_result();
        prop_assert_eq!(returned, Ok(document), "{}", printed);
    }
    let condition = pddl::parse_condition(text);
    check_spans(text, &condition.diagnostics)?;
    if let Ok(condition) = condition.into_result() {
        let printed = condition.to_string();
        prop_assert_eq!(pddl::parse_condition(&printed).into_result(), Ok(condition));
    }
    let facts = pddl::parse_init_elements(text);
    check_spans(text, &facts.diagnostics)?;
    let plan = pddl::parse_plan(text);
    check_spans(text, &plan.diagnostics)
}

fn check_spans(text: &str, diagnostics: &[Diagnostic]) -> Result<(), TestCaseError> {
    for diagnostic in diagnostics {
        let notes = diagnostic.notes.iter().map(|note| note.span);
        for span in notes.chain([diagnostic.span]) {
            prop_assert!(
                text.get(span.range()).is_some(),
                "{:?} {:?} {:?}",
                diagnostic,
                span,
                text
            );
        }
    }
    Ok(())
}

/// Runs the semantic checks on the parsed tree. No check may panic, and every place must lie in the
/// text.
fn check_meaning(text: &str) -> Result<(), TestCaseError> {
    let home = pddl::Domain::named("home");
    let diagnostics = match pddl::parse_document(text).value {
        Some(Document::Domain(domain)) => pddl::check_domain(&domain),
        Some(Document::Problem(problem)) => pddl::check_problem(&home, &problem),
        Some(Document::ActionModel(model)) => pddl::check_action_model(&home, &model),
        None => Vec::new(),
    };
    check_spans(text, &diagnostics)
}

proptest! {
    #[test]
    fn printed_texts_parse_to_the_same_value(document in generate::document()) {
        let printed = document.to_string();
        let parsed = pddl::parse_document(&printed);
        prop_assert!(parsed.is_ok(), "{:?}\n{}", parsed.diagnostics, printed);
        prop_assert_eq!(parsed.value, Some(document), "{}", printed);
        check_meaning(&printed)?;
    }

    #[test]
    fn a_printed_goal_parses_to_the_same_value_on_one_or_several_lines(goal in generate::goal()) {
        for printed in [format!("{goal}"), format!("{goal:#}")] {
            prop_assert_eq!(pddl::parse_condition(&printed).into_result(), Ok(goal.clone()));
        }
    }

    #[test]
    fn a_printed_plan_parses_to_the_same_value(plan in generate::plan()) {
        let printed = plan.to_string();
        prop_assert_eq!(pddl::parse_plan(&printed).into_result(), Ok(plan), "{}", printed);
    }

    #[test]
    fn any_bytes_are_parsed_without_a_panic(
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        check_text(&text_from_bytes(&bytes))?;
    }

    #[test]
    fn any_text_is_parsed_without_a_panic(text in ".{0,60}") {
        check_text(&text)?;
        check_text(&format!("(define (domain d) {text})"))?;
    }

    #[test]
    fn any_words_are_parsed_without_a_panic(
        words in proptest::collection::vec(proptest::sample::select(WORDS), 0..60),
        glue in prop_oneof![Just(" "), Just("")],
    ) {
        let text = words.join(glue);
        check_text(&text)?;
        check_meaning(&text)?;
    }

    #[test]
    fn a_mutated_text_is_parsed_without_a_panic(
        document in generate::document(),
        at in any::<prop::sample::Index>(),
        word in proptest::sample::select(WORDS),
        length in 0_usize..8,
    ) {
        let mut characters: Vec<char> = document.to_string().chars().collect();
        let start = at.index(characters.len());
        let end = (start + length).min(characters.len());
        characters.splice(start..end, word.chars());
        let text: String = characters.into_iter().collect();
        check_text(&text)?;
        check_meaning(&text)?;
    }
}
