//! Checks goals with their words in both languages, in both directions.

use phrases::{KnownNames, Language, OwnWords, Phrasebook};

fn condition(pddl: &str) -> pddl::Condition {
    pddl::parse_condition(pddl).into_result().expect("PDDL")
}

/// Checks that a goal is said with these words, and that these words are read as the goal.
#[track_caller]
fn check(language: Language, pddl: &str, words: &str) {
    let book = Phrasebook::standard(language);
    let goal = condition(pddl);
    assert_eq!(book.say(&goal), words);
    assert_eq!(book.read(words, &KnownNames::default()), Ok(goal));
}

#[track_caller]
fn english(pddl: &str, words: &str) {
    check(Language::English, pddl, words);
}

#[track_caller]
fn german(pddl: &str, words: &str) {
    check(Language::German, pddl, words);
}

/// Checks that words are read as a goal, although it is said in another way.
#[track_caller]
fn read(language: Language, words: &str, pddl: &str) {
    let read = Phrasebook::standard(language).read(words, &KnownNames::default());
    assert_eq!(read, Ok(condition(pddl)), "{words}");
}

#[test]
fn facts_and_comparisons() {
    english("(known-temperature office1)", "temperature of office1 known");
    english("(not (known-temperature office1))", "temperature of office1 not known");
    english("(not (motion hall))", "no motion in hall");
    english("(at turtlebot-1 hall)", "turtlebot-1 at hall");
    english("(>= (temperature office1) 21)", "temperature of office1 at least 21 °C");
    english("(< (co2 office1) 800.5)", "CO₂ of office1 below 800.5 ppm");
    english("(> (temperature a) (temperature b))", "temperature of a above temperature of b");
    english("(= (brightness lamp-1) 40)", "brightness of lamp-1 is 40 %");
    german("(known-temperature office1)", "Temperatur von office1 bekannt");
    german("(>= (temperature office1) 21.5)", "Temperatur von office1 mindestens 21,5 °C");
    english("(not (at r1 hall))", "not r1 at hall");
    german("(not (lit office1))", "Licht in office1 aus");
}

#[test]
fn quantifiers() {
    english("(forall (?r - room) (known-temperature ?r))", "temperature of every room known");
    english("(exists (?m - mobile-base) (at ?m hall))", "some robot at hall");
    english("(not (forall (?r - room) (swept ?r)))", "not every room swept");
    english("(forall (?r - room) (not (swept ?r)))", "every room not swept");
    english("(forall (?place - room) (swept ?place))", "every room ?place swept");
    english(
        "(exists (?c - camera) (exists (?p - preset) (looks-at ?c ?p)))",
        "some camera looks at some preset",
    );
    english(
        "(forall (?r - room) (and (swept ?r) (lit ?r)))",
        "for every room r: r swept and light in r on",
    );
    english(
        "(forall (?o - office) (imply (lit ?o) (swept ?o)))",
        "for every office o: if light in o on then o swept",
    );
    german("(forall (?r - room) (known-temperature ?r))", "Temperatur von jedem Raum bekannt");
    german("(forall (?r - room) (swept ?r))", "jeder Raum gekehrt");
    german("(exists (?k - kitchen) (lit ?k))", "Licht in einer Küche an");
    german(
        "(forall (?r - room) (or (swept ?r) (lit ?r)))",
        "für jeden Raum r: r gekehrt oder Licht in r an",
    );
}

#[test]
fn junctions() {
    english("(and (swept a) (swept b) (lit c))", "a swept and b swept and light in c on");
    english("(or (and (swept a) (lit a)) (swept b))", "a swept and light in a on, or b swept");
    english("(and (or (swept a) (lit a)) (swept b))", "a swept or light in a on, and b swept");
    english("(and (and (swept a) (lit a)) (swept b))", "a swept and light in a on, and b swept");
    english("(and (swept a) (odd a b))", "a swept and (odd a b)");
    english("(and (swept a))", "(and (swept a))");
    english("(and)", "(and)");
    german("(and (swept a) (swept b))", "a gekehrt und b gekehrt");
}

#[test]
fn other_ways_to_say_it() {
    let (en, de) = (Language::English, Language::German);
    read(en, "Temperature in Office1 known.", "(known-temperature office1)");
    read(en, "a swept, b swept and light in c on", "(and (swept a) (swept b) (lit c))");
    read(en, "a swept, b swept, and light in c on", "(and (swept a) (swept b) (lit c))");
    read(en, "a swept, b swept", "(and (swept a) (swept b))");
    read(en, "temperature of all rooms known", "(forall (?r - room) (known-temperature ?r))");
    read(en, "each kitchen swept", "(forall (?k - kitchen) (swept ?k))");
    read(en, "temperature of office1 >= 21", "(>= (temperature office1) 21)");
    read(en, "temperature of office1 at least 21°C", "(>= (temperature office1) 21)");
    read(en, "temperature of office1 more than 21 degrees", "(> (temperature office1) 21)");
    read(en, "humidity of every room below 60%", "(forall (?r - room) (< (humidity ?r) 60))");
    read(
        en,
        "for every room: temperature of r known",
        "(forall (?r - room) (known-temperature ?r))",
    );
    read(en, "not temperature of a known", "(not (known-temperature a))");
    read(en, "not (known-light hall)", "(not (known-light hall))");
    read(de, "Temperatur in office1 über 21 Grad", "(> (temperature office1) 21)");
    read(de, "alle Räume gekehrt", "(forall (?r - room) (swept ?r))");
}

#[test]
fn facts_that_are_no_goals() {
    let book = Phrasebook::standard(Language::English);
    let said = |fact: &str| {
        book.print_fact(&pddl::parse_init_element(fact).into_result().expect("a fact"))
    };
    assert_eq!(said("(= (temperature office1) 20.5)"), "temperature of office1 is 20.5 °C");
    assert_eq!(said("(unknown (motion hall))"), "unknown whether motion in hall");
    assert_eq!(said("(not (lit hall))"), "light in hall off");
    assert_eq!(said("(unknown (odd hall))"), "(unknown (odd hall))");
}

#[test]
fn an_ecosystem_has_words_of_its_own() {
    let own = "[predicates]\nconfidential = { phrase = \"{1} is confidential\" }\n\
               lit = { phrase = \"{1} is bright\", negated = \"{1} is dark\" }\n\
               [types]\nspot = { every = [\"every spot of ours\"], some = [\"a spot of ours\"] }";
    let own: OwnWords = toml::from_str(own).expect("TOML");
    let book = Phrasebook::standard(Language::English).with_own(&own).expect("they fit");
    let said = |goal: &str| book.say(&condition(goal));
    assert_eq!(said("(confidential office1)"), "office1 is confidential");
    assert_eq!(said("(not (lit office1))"), "office1 is dark");
    assert_eq!(said("(forall (?s - spot) (lit ?s))"), "every spot of ours is bright");
    let read = book.read("light in office1 on", &KnownNames::default());
    assert!(read.is_err(), "the standard phrase is replaced");
}
