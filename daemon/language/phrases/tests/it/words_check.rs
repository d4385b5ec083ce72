//! Checks that mistakes in the words of an ecosystem are found.

use phrases::{OwnWords, WordsMistake, key_mistakes};

const DOMAIN: &str = "(define (domain d) (:requirements :typing)
    (:types room robot - object)
    (:predicates (lit ?r - room) (at ?b - robot ?r - room) (stopped) (shows ?a ?b ?c - object))
    (:functions (temperature ?r - room)))";

fn told(found: Vec<WordsMistake>) -> Vec<String> {
    let tell = |one: WordsMistake| {
        let diagnostic = one.diagnostic(pddl::Span::default());
        let help = diagnostic.help.unwrap_or_default();
        format!("{}: {}: {}; {help}", one.path.join("."), diagnostic.severity, diagnostic.message)
    };
    found.into_iter().map(tell).collect()
}

#[track_caller]
fn check(words: &str, expected: &[&str]) {
    let own: OwnWords = toml::from_str(words).expect("TOML");
    let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
    assert_eq!(told(own.mistakes(&domain)), expected, "{words}");
}

#[test]
fn each_argument_has_one_place() {
    check(
        "[predicates]\nlit = { phrase = \"shines\" }",
        &["predicates.lit.phrase: error: the phrase `shines` has no place, and `lit` has 1 \
           argument; write `{1}` once, where the argument stands"],
    );
    check(
        "[predicates]\nLit = { phrase = \"{1} lit\", negated = \"{1} dark at {2}\", \
         also = [\"bright\"] }",
        &[
            "predicates.Lit.negated: error: the phrase `{1} dark at {2}` has 2 places, and `Lit` \
             has 1 argument; write `{1}` once, where the argument stands",
            "predicates.Lit.also: error: the phrase `bright` has no place, and `Lit` has 1 \
             argument; write `{1}` once, where the argument stands",
        ],
    );
    check(
        "[predicates]\nat = { phrase = \"{1} there\" }\nshows = { phrase = \"{1} shows\" }\n\
         stopped = { phrase = \"{1} stopped\" }",
        &[
            "predicates.at.phrase: error: the phrase `{1} there` has 1 place, and `at` has 2 \
             arguments; write `{1}` and `{2}` once each, where the arguments stand",
            "predicates.shows.phrase: error: the phrase `{1} shows` has 1 place, and `shows` has \
             3 arguments; write `{1}` to `{3}` once each, where the arguments stand",
            "predicates.stopped.phrase: error: the phrase `{1} stopped` has 1 place, and `stopped` \
             has no argument; write the phrase without a place",
        ],
    );
    check(
        "[functions]\ntemperature = { phrase = \"warmth\", also = [\"warmth of {1}\"] }",
        &["functions.temperature.phrase: error: the phrase `warmth` has no place, and \
           `temperature` has 1 argument; write `{1}` once, where the argument stands"],
    );
    check(
        "[predicates]\nlit = { phrase = \"{1} shines\" }\nat = { phrase = \"in {2} is {1}\" }\n\
         stopped = { phrase = \"all stopped\" }\n[functions]\n\
         temperature = { phrase = \"warmth of {1}\" }\n\
         [types]\nroom = { every = [\"every room\"], some = [\"a room\"] }\n\
         object = { every = [\"every thing\"], some = [\"a thing\"] }",
        &[],
    );
}

#[test]
fn a_symbol_is_declared() {
    check(
        "[predicates]\nlitt = { phrase = \"{1} shines at {2}\" }",
        &["predicates.litt: warning: no predicate is named `litt`; did you mean `lit`?"],
    );
    check(
        "[functions]\ntemprature = { phrase = \"warmth of {1}\" }\n\
         [types]\nrooom = { every = [\"every room\"], some = [\"a room\"] }",
        &[
            "functions.temprature: warning: no function is named `temprature`; did you mean \
             `temperature`?",
            "types.rooom: warning: no type is named `rooom`; did you mean `room`?",
        ],
    );
    check(
        "[predicates]\nhaunted = { phrase = \"{1} haunted\" }",
        &[
            "predicates.haunted: warning: no predicate is named `haunted`; neither the ontology nor \
           an agent of this file declares it; the words wait for an agent that does",
        ],
    );
    check(
        "[predicates]\ntemperature = { phrase = \"{1} warm\" }\n\
         [functions]\nlit = { phrase = \"light of {1}\" }",
        &[
            "predicates.temperature: error: `temperature` is a function; its words stand under \
             `functions`; ",
            "functions.lit: error: `lit` is a predicate; its words stand under `predicates`; ",
        ],
    );
}

#[test]
fn a_misspelt_key_is_found_where_it_stands() {
    let check = |words: &str, expected: &[&str]| {
        let found = toml::Deserializer::parse(words).expect("TOML");
        assert_eq!(told(key_mistakes(found)), expected, "{words}");
    };
    check(
        "[predicates]\nlit = { phrse = \"{1} lit\" }\nat = { phrase = \"x\", negatd = \"y\" }",
        &[
            "predicates.at.negatd: error: unknown key `negatd`; did you mean `negated`?",
            "predicates.lit.phrse: error: unknown key `phrse`; did you mean `phrase`?",
        ],
    );
    check(
        "[predicats]\nlit = { phrase = \"{1} lit\" }\n[types]\nroom = { evry = [] }",
        &[
            "predicats: error: unknown key `predicats`; did you mean `predicates`?",
            "types.room.evry: error: unknown key `evry`; did you mean `every`?",
        ],
    );
    check(
        "[functions]\ntemperature = { phrase = \"{1}\", color = \"x\" }\nhumidity = 3",
        &[
            "functions.temperature.color: error: unknown key `color`; known are phrase, unit, units, \
           also",
        ],
    );
    check("[predicates]\nlit = { phrase = \"{1} lit\", also = [] }", &[]);
}
