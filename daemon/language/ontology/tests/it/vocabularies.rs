//! Tests of the extension of the standard ontology by the words of one building.

use ontology::{STANDARD_NAME, extended, standard_domain};
use pddl::Domain;

fn domain(text: &str) -> Domain {
    let parsed = pddl::parse_domain(text);
    assert_eq!(parsed.diagnostics, [], "{text}");
    parsed.value.expect("a domain")
}

#[test]
fn a_vocabulary_adds_words_below_those_of_the_standard_ontology() {
    let more = domain(
        "(define (domain ward) (:types patient-room - room purpose)
           (:predicates (used-for ?r - room ?p - purpose) (quiet ?r - patient-room))
           (:functions (beds ?r - patient-room))
           (:derived (quiet ?r - patient-room) (not (motion ?r))))",
    );
    let (domain, mistakes) = extended(standard_domain(), &more);
    assert_eq!(mistakes, []);
    assert_eq!(domain.name, STANDARD_NAME);
    let types = pddl::Types::of(&domain);
    assert!(types.is_subtype("patient-room", "location"));
    for name in ["used-for", "known-temperature", "quiet"] {
        assert!(domain.predicates.iter().any(|known| known.name == name), "{name}");
    }
    assert!(domain.functions.iter().any(|known| known.name == "beds"));
}

#[test]
fn a_vocabulary_may_repeat_what_is_in_the_standard_ontology() {
    let (domain, mistakes) = extended(standard_domain(), standard_domain());
    assert_eq!(mistakes, []);
    assert_eq!(&domain, standard_domain());
}

#[test]
fn a_mistake_is_reported_at_its_place_in_the_vocabulary() {
    for (text, at, message) in [
        (
            "(define (domain w) (:types lift - room))",
            "lift",
            "the standard ontology declares the type `lift` differently",
        ),
        (
            "(define (domain w) (:predicates (swept ?a ?b - location)))",
            "swept",
            "the standard ontology declares the predicate `swept` differently",
        ),
        (
            "(define (domain w) (:functions (temperature ?l - location)))",
            "temperature",
            "the standard ontology declares the function `temperature` differently",
        ),
        (
            "(define (domain w) (:derived (swept ?l - location) (patrolled ?l)))",
            "(:derived",
            "`swept` is a fact in the standard ontology",
        ),
        (
            "(define (domain w) (:predicates (p)) (:action go :parameters () :effect (p)))",
            "(:action",
            "a vocabulary has no actions: take `go` out",
        ),
        ("(define (domain w) (:types ward - rom))", "rom", "rom"),
    ] {
        let parsed = pddl::parse_domain(text).value.expect("a domain");
        let (_, mistakes) = extended(standard_domain(), &parsed);
        let found = mistakes.iter().find(|found| found.message.contains(message));
        let found = found.unwrap_or_else(|| panic!("{text}: {mistakes:?}"));
        assert!(text[found.span.start as usize..].starts_with(at), "{text}: {found:?}");
    }
}
