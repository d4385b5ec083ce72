//! Checks what is suggested for texts that are not understood, with and without known objects, and in
//! the language that a text resembles.

use expect_test::{Expect, expect};
use phrases::{KnownNames, Language, Phrasebook};

const DOMAIN: &str = "(define (domain d) (:requirements :typing)
    (:types location mobile-base - object room corridor - location)
    (:predicates (known-temperature ?r - room) (known-co2 ?r - room) (motion ?l - location)
        (swept ?l - location) (lit ?r - room) (at ?b - mobile-base ?l - location)
        (fan-on ?f - object) (installed ?a - object ?l - location))
    (:functions (temperature ?r - room) (humidity ?r - room) (co2 ?r - room)))";

const PROBLEM: &str = "(define (problem p) (:domain d)
    (:objects kitchen bath - room hall - corridor robot - mobile-base))";

fn known() -> KnownNames {
    let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
    let problem = pddl::parse_problem(PROBLEM).into_result().expect("a problem");
    KnownNames::of(&domain, &problem)
}

/// Returns the answer of the language that `text` resembles, and checks that each suggestion is
/// understood in it. `chosen` is the language of the person.
#[track_caller]
fn answer(chosen: Language, text: &str, names: &KnownNames) -> String {
    let others = Language::ALL.into_iter().filter(|other| *other != chosen);
    let books: Vec<_> = std::iter::once(chosen).chain(others).map(Phrasebook::standard).collect();
    let answers =
        books.iter().map(|book| book.read(text, names).expect_err("it is not understood"));
    let answer = answers.reduce(|known, other| known.nearer(other)).expect("there are languages");
    for near in &answer.nearest {
        assert_ne!(near, text, "the text itself is suggested");
        let read = books.iter().any(|book| book.read(near, names).is_ok());
        assert!(read, "`{near}` is suggested for `{text}`, and not understood");
    }
    answer.diagnostic().located(text)
}

/// Checks an answer that is the same whether objects are known or not.
#[track_caller]
fn check(text: &str, expected: Expect) {
    let open = answer(Language::English, text, &KnownNames::default());
    expected.assert_eq(&open);
    assert_eq!(answer(Language::English, text, &known()), open);
}

/// Checks that `meant` is the first suggestion, whichever language is chosen.
#[track_caller]
fn meant(text: &str, meant: &str) {
    for names in [KnownNames::default(), known()] {
        for chosen in Language::ALL {
            let answer = answer(chosen, text, &names);
            assert!(answer.contains(&format!("did you mean `{meant}`")), "{answer}");
        }
    }
}

#[test]
fn a_number_has_the_mark_of_its_language() {
    check(
        "temperature of kitchen at least 21,5 °C",
        expect![
            "1:33: error: `21,5` is no number in English; numbers have a point (`21.5`); did you mean `temperature of kitchen at least 21.5 °C`?"
        ],
    );
    check(
        "temperature of kitchen at least 21.5.1 °C",
        expect![
            "1:33: error: `21.5.1` is no number in English; numbers have at most one point, and no other mark (`21.5`); did you mean `temperature of kitchen at least 21.5 °C`?"
        ],
    );
    check(
        "CO₂ of kitchen below 1,000 ppm",
        expect![
            "1:22: error: `1,000` is no number in English; numbers have no mark between thousands (`1000`); did you mean `CO₂ of kitchen below 1000 ppm` or `CO₂ of kitchen below 1.000 ppm`?"
        ],
    );
    check(
        "Temperatur von kitchen mindestens 1.000,5 °C",
        expect![
            "1:35: error: `1.000,5` is no number in German; numbers have at most one comma, and no other mark (`1000,5`); did you mean `Temperatur von kitchen mindestens 1000,5 °C`?"
        ],
    );
    let humidity = "humidity of kitchen below 60.5";
    meant("humidity of kitchen below 60,5", humidity);
    meant("humidity of kitchen below 60,5%", "humidity of kitchen below 60.5%");
    meant("humidity of kitchen below 60,5 ppm", "humidity of kitchen below 60.5 %");
    meant(
        "not humidity of kitchen below -0,5 and moton in hall",
        "not humidity of kitchen below -0.5 and motion in hall",
    );
    meant("temperature of kitchen atleast 21,5", "temperature of kitchen at least 21.5");
    meant("Feuchte von kitchen unter 6.0.5 %", "Feuchte von kitchen unter 6,0 %");
}

#[test]
fn the_period_of_a_sentence_ends_a_number_and_a_unit() {
    let book = Phrasebook::standard(Language::English);
    for text in ["humidity of kitchen below 60.5.", "humidity of kitchen below 60.5 %."] {
        let read = book.parse(text, &known());
        assert_eq!(read.as_deref(), Ok("(< (humidity kitchen) 60.5)"), "{text}");
    }
}

#[test]
fn and_beside_or_is_answered_with_the_rule_and_the_commas() {
    check(
        "temperature of hall known and light in bath on or kitchen swept",
        expect![
            "1:48: error: `and` and `or` together leave open what belongs to which; a comma says it: `A and B, or C`; did you mean `temperature of hall known and light in bath on, or kitchen swept` or `temperature of hall known, and light in bath on or kitchen swept`?"
        ],
    );
    check(
        "kitchen gekehrt oder bath gekehrt und hall gekehrt",
        expect![
            "1:35: error: `und` and `oder` together leave open what belongs to which; a comma says it: `A und B, oder C`; did you mean `kitchen gekehrt, oder bath gekehrt und hall gekehrt` or `kitchen gekehrt oder bath gekehrt, und hall gekehrt`?"
        ],
    );
    check(
        "for every room r: r swept and light in r on or motion in r",
        expect![
            "1:45: error: `and` and `or` together leave open what belongs to which; after a colon or `if`, a part in PDDL says it, in parentheses"
        ],
    );
    check(
        "kitchen swept, and bath swept, or hall swept",
        expect![
            "1:30: error: `, and` and `, or` together leave open what belongs to which; write all of one kind without a comma, as in `A and B, or C`, or a part in PDDL, in parentheses"
        ],
    );
    meant(
        "kitchen swpt and bath swept or hall swept",
        "kitchen swept and bath swept, or hall swept",
    );
}

#[test]
fn what_is_missing_at_a_junction_is_named() {
    check("robot at kitchen and", expect!["1:21: error: something must follow `and`"]);
    check("robot at kitchen or not", expect!["1:24: error: something must follow `not`"]);
    check("robot steht bei kitchen und", expect!["1:28: error: something must follow `und`"]);
    check("for every room r:", expect!["1:18: error: something must follow `:`"]);
    check(
        "kitchen swept,",
        expect!["1:14: error: something must follow `,`; did you mean `kitchen swept`?"],
    );
    check(
        "kitchen swept or and bath swept",
        expect![
            "1:18: error: `and` joins two conditions, and a condition is missing before it; did you mean `kitchen swept or bath swept`?"
        ],
    );
}

#[test]
fn the_answer_is_in_the_language_that_the_text_resembles() {
    for chosen in Language::ALL {
        let said = |text: &str| answer(chosen, text, &known());
        let expected =
            "1:1: error: `kitchen is warm` is not understood; a condition is written as in";
        assert!(said("kitchen is warm").starts_with(expected), "{}", said("kitchen is warm"));
        for german in ["eingebaut", "gekehrt", "bei", "beleuchtet"] {
            assert!(!said("kitchen is warm").contains(german), "{}", said("kitchen is warm"));
        }
        assert!(said("kitchen temperature").contains("`temperature of kitchen known`"));
        assert!(said("Temperatur kitchen").contains("`Temperatur von kitchen bekannt`"));
    }
    meant("hall gekert", "hall gekehrt");
    meant("kitchen is swept", "kitchen swept");
    meant("light in kitchen is on", "light in kitchen on");
    meant("Licht in kitchen ist an", "Licht in kitchen an");
}

#[test]
fn the_nearest_phrase_has_the_words_in_any_order() {
    meant("kitchen temperature known", "temperature of kitchen known");
    meant("kitchen CO₂ known", "CO₂ of kitchen known");
    meant("known temperature of kitchen", "temperature of kitchen known");
    meant("kitchen temperature at least 21", "temperature of kitchen at least 21");
    meant("every room temperature known", "temperature of every room known");
    meant("kitchen light on", "light in kitchen on");
    meant("swept kitchen", "kitchen swept");
    meant("at robot kitchen", "robot at kitchen");
    meant("kitchen Temperatur bekannt", "Temperatur von kitchen bekannt");
}

#[test]
fn a_quantifier_in_a_wrong_form_is_corrected() {
    meant("temperature of all room known", "temperature of every room known");
    meant("all room swept and motion in hall", "every room swept and motion in hall");
    meant("motion in all place", "motion in every place");
    meant("Temperatur von jeden Räume bekannt", "Temperatur von jedem Raum bekannt");
    let said = answer(Language::English, "motion in some places", &known());
    assert!(said.contains("did you mean `motion in some place`?"), "{said}");
    let said = answer(Language::English, "einem Räume gekehrt", &known());
    assert!(said.contains("did you mean `ein Raum gekehrt`?"), "{said}");
    let said = answer(Language::English, "for every rom r: r swept", &known());
    assert!(said.contains("did you mean `for every room r: r swept`?"), "{said}");
}

#[test]
fn a_missing_name_is_no_suggestion() {
    let said = |text: &str| answer(Language::English, text, &KnownNames::default());
    let expected =
        expect!["1:8: error: `motion in` ends too early; a name is missing: `motion in …`"];
    expected.assert_eq(&said("motion in"));
    assert!(!said("temperature known").contains("CO₂"), "{}", said("temperature known"));
}
