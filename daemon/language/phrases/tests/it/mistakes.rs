//! Checks the answers to texts that are not understood.

use expect_test::{Expect, expect};
use phrases::{KnownNames, Language, Phrasebook};

const DOMAIN: &str = "(define (domain d) (:requirements :typing)
    (:types location mobile-base preset - object room corridor - location)
    (:predicates (known-temperature ?r - room) (motion ?l - location) (swept ?l - location)
        (at ?b - mobile-base ?l - location))
    (:functions (temperature ?r - room)))";

const PROBLEM: &str = "(define (problem p) (:domain d)
    (:objects office1 office2 - room hall - corridor turtlebot-1 - mobile-base))";

fn names() -> KnownNames {
    let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
    let problem = pddl::parse_problem(PROBLEM).into_result().expect("a problem");
    KnownNames::of(&domain, &problem)
}

#[track_caller]
fn check(text: &str, expected: Expect) {
    let book = Phrasebook::standard(Language::English);
    let answer = book.read(text, &names()).expect_err("it is not understood");
    expected.assert_eq(&answer.diagnostic().located(text));
}

#[test]
fn a_slip_is_answered_with_the_nearest_text() {
    check(
        "temprature of office1 known",
        expect![
            "1:1: error: `temprature` is not understood; did you mean `temperature of office1 known`?"
        ],
    );
    check(
        "temperature of ofice1 known",
        expect![
            "1:16: error: `ofice1` is not understood; did you mean `temperature of office1 known`?"
        ],
    );
    check(
        "temperature office1 known",
        expect![
            "1:13: error: `temperature office1 known` is not understood; did you mean `temperature of office1 known`?"
        ],
    );
    check(
        "temperature of office1",
        expect![
            "1:16: error: `temperature of office1` ends too early; did you mean `temperature of office1 known` or `temperature of office1 at least 20 °C`?"
        ],
    );
    check(
        "office1 temperature known",
        expect![
            "1:1: error: `office1 temperature known` is not understood; did you mean `temperature of office1 known`?"
        ],
    );
    check(
        "turtlebot-1 at hall and moton in hall",
        expect![
            "1:25: error: `moton` is not understood; did you mean `turtlebot-1 at hall and motion in hall`?"
        ],
    );
    check(
        "temperature of office1 at least warm",
        expect![
            "1:33: error: `warm` is not understood; did you mean `temperature of office1 at least 20 °C`?"
        ],
    );
    check(
        "temperature of office1 at least 21 °F",
        expect![
            "1:36: error: `°F` is not understood; did you mean `temperature of office1 at least 21 °C`?"
        ],
    );
    check(
        "temperature of every rom known",
        expect![
            "1:22: error: `rom` is not understood; did you mean `temperature of every room known`?"
        ],
    );
    check(
        "make me a coffee",
        expect![
            "1:1: error: `make me a coffee` is not understood; a condition is written as in `hall swept`"
        ],
    );
}

#[test]
fn a_sentence_that_is_built_wrongly_is_answered_with_the_reason() {
    check("", expect!["1:1: error: the text says nothing"]);
    check("office1 swept and", expect!["1:18: error: something must follow `and`"]);
    check(
        "office1 swept and office2 swept or hall swept",
        expect![
            "1:33: error: `and` and `or` together leave open what belongs to which; a comma says it: `A and B, or C`; did you mean `office1 swept and office2 swept, or hall swept` or `office1 swept, and office2 swept or hall swept`?"
        ],
    );
    check("if office1 swept", expect!["1:17: error: `then` is expected after the condition"]);
    check(
        "for every room r office1 swept",
        expect![
            "1:18: error: after `for every room` and the name of one, such as `r`, a colon is expected: `for every room r: …`"
        ],
    );
    check(
        "(known-temperature office1",
        expect!["1:1: error: unclosed `(`; PDDL stands between `(` and `)`"],
    );
    check(
        "office1 swept and (and (x)",
        expect!["1:19: error: unclosed `(`; PDDL stands between `(` and `)`"],
    );
    check(
        "office1 swept, then office2 swept",
        expect!["1:14: error: `,` does not continue the sentence"],
    );
}

#[test]
fn words_are_completed() {
    let check = |before: &str, expected: &[&str]| {
        let book = Phrasebook::standard(Language::English);
        let (start, words) = book.complete(before, &names());
        assert_eq!(words, expected, "{before}");
        assert!(before.is_char_boundary(start));
    };
    check("temp", &["temperature"]);
    check("temperature of o", &["office1", "office2"]);
    check("temperature of e", &["every"]);
    check("temperature of every r", &["robot", "room"]);
    check("temperature of every room ", &["above", "at", "below", "is", "known", "not"]);
    check("temperature of office1 kn", &["known"]);
    check("temperature of office1 known a", &["and"]);
    check("temperature of office1 known and mo", &["motion"]);
}
