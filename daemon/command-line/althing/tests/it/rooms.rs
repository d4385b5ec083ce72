//! Buildings without PDDL: mistakes in `[rooms]`, `[doors]`, `vocabulary` and `reasoning` are
//! reported once, at their place, in the words of rooms and doors.

use expect_test::expect;

use crate::sandbox::Sandbox;

const SCHOOL: &str = r#"[ecosystem]
name = "village-school"

[rooms]
class-a = { floor = 0, area = 42.5 }
class-b = { floor = 0 }
entrance = { kind = "hall", staff-only = true }
passage = "corridor"

[doors]
passage = { class-a = 4, class-b = { length = 6.0 }, entrance = { length = 9, one-way = true } }
entrance = { passage = { length = 9.5, one-way = true } }

[[agent]]
name = "thermometer-a"
plugin = "temperature-sensor"
config = { location = "class-a" }

[[agent]]
name = "rover"
plugin = "turtlebot"
config = { start = "passage", speed = 0.3 }

[goals]
warm = "(known-temperature class-a)"
seen = "(at rover class-b)"
"#;

const WORDS: &str = "\
(define (domain village)
  (:types class-room - room purpose)
  (:predicates (used-for ?r - room ?p - purpose) (beside ?a ?b - room))
  (:functions (seats ?r - class-room)))
";

/// Returns the reports on a file: severity, line, and message with help.
fn told(file: &str) -> Vec<(String, u64, String)> {
    told_with(file, WORDS)
}

fn told_with(file: &str, words: &str) -> Vec<(String, u64, String)> {
    let sandbox = Sandbox::new(&[("school.toml", file), ("words.pddl", words)]);
    let json = sandbox.run("check school.toml --json").json();
    let diagnostics = json["diagnostics"].as_array().expect("a list").iter();
    let told = diagnostics.map(|found| {
        let text = |key: &str| found[key].as_str().unwrap_or_default().to_owned();
        let line = found["line"].as_u64().unwrap_or_default();
        (text("severity"), line, format!("{} | {}", text("message"), text("help")))
    });
    told.collect()
}

/// Checks that a change of the file is one mistake.
#[track_caller]
fn check(from: &str, to: &str, severity: &str, line: u64, words: &[&str]) {
    assert!(SCHOOL.contains(from), "{from}");
    let told = told(&SCHOOL.replacen(from, to, 1));
    let [(is, at, text)] = &told[..] else { panic!("one mistake is made: {told:#?}") };
    assert_eq!((is.as_str(), *at), (severity, line), "{text}");
    for word in words {
        assert!(text.contains(word), "no `{word}`: {text}");
    }
}

const ERROR: &str = "error";
const WARNING: &str = "warning";

#[test]
fn a_building_of_tables_has_no_reports_and_a_map() {
    assert_eq!(told(SCHOOL), []);
    let sandbox = Sandbox::new(&[("school.toml", SCHOOL)]);
    sandbox.check("check school.toml", 0).shows(
        expect![[r#"
            school.toml: ecosystem village-school (8 agents on one machine, decentralized): ok
        "#]],
        expect![""],
    );
    sandbox.check("check --print map school.toml", 0).shows(
        expect![[r#"
        (define (problem village-school-map)
          (:domain smart-office)
          (:objects class-a class-b - room entrance - hall passage - corridor floor-0 - floor)
          (:init
            (= (total-cost) 0)
            (= (area class-a) 42.5)
            (on-floor class-a floor-0)
            (on-floor class-b floor-0)
            (staff-only entrance)
            (connected entrance passage)
            (= (distance entrance passage) 9.5)
            (connected passage class-a)
            (= (distance passage class-a) 4)
            (connected class-a passage)
            (= (distance class-a passage) 4)
            (connected passage class-b)
            (= (distance passage class-b) 6)
            (connected class-b passage)
            (= (distance class-b passage) 6)
            (connected passage entrance)
            (= (distance passage entrance) 9))
          (:goal (and))
          (:metric minimize (total-cost)))
    "#]],
        expect![""],
    );
    let run = sandbox.check("check --print ontology school.toml", 0);
    assert!(run.stdout.starts_with("(define (domain smart-office)"), "{}", run.stdout);
    sandbox.write("map.pddl", sandbox.run("check school.toml --print map").stdout.as_bytes());
    sandbox.write("words.pddl", run.stdout.as_bytes());
    sandbox.check("check words.pddl map.pddl", 0);
}

#[test]
fn names_of_rooms() {
    let cure = "write kueche = {}, and `kueche` wherever it is named";
    check(
        "class-b = { floor = 0 }\n",
        "class-b = {}\n\"Küche\" = {}\n",
        ERROR,
        7,
        &["`Küche`", cure],
    );
    check("class-b = { floor = 0 }\n", "class-b = {}\n217 = {}\n", ERROR, 7, &["room-217"]);
    check("class-b = { floor = 0 }\n", "class-b = {}\n\"My Room\" = {}\n", ERROR, 7, &["my-room"]);
    // A refused name is reported at the room and at the agent, and not at the doors.
    let upper = SCHOOL.replace("class-a", "Class-A");
    let told = told(&upper);
    assert_eq!(told.len(), 2, "{told:#?}");
    assert!(told[0].2.contains("write class-a"), "{told:#?}");
    assert!(told[1].2.contains("config of `thermometer-a`"), "{told:#?}");
    check("class-b = { floor = 0 }", "class-a = { floor = 0 }", ERROR, 6, &["is there already"]);
}

#[test]
fn what_is_said_of_rooms() {
    let line = "class-b = { floor = 0 }";
    let kind = |kind: &str| format!("class-b = {{ kind = {kind} }}");
    check(line, &kind("\"kichen\""), ERROR, 6, &["no kind of place `kichen`", "`kitchen`"]);
    check(line, &kind("\"xyzzy\""), ERROR, 6, &["known are location, ", "vocabulary"]);
    check(line, &kind("3"), ERROR, 6, &["the kind of `class-b` must be a text"]);
    check(line, "class-b = 3", ERROR, 6, &["must be a table", "write class-b = {}"]);
    check(line, "class-b = { floor = 1.5 }", ERROR, 6, &["whole number or a name"]);
    check(line, "class-b = { floor = \"First Floor\" }", ERROR, 6, &["write \"first-floor\""]);
    check(line, "class-b = { flor = 0 }", ERROR, 6, &["unknown key `flor`", "`floor`"]);
    check(line, "class-b = { area = \"12 m\" }", ERROR, 6, &["must be a number", "area = 12"]);
    check(line, "class-b = { staff-only = \"yes\" }", ERROR, 6, &["either true or false"]);
    check(line, "class-b = { on-floor = true }", ERROR, 6, &["names something else"]);
    check(line, "class-b = { xyzzy = true }", ERROR, 6, &["unknown key `xyzzy`", "vocabulary"]);
}

#[test]
fn doors() {
    let a = "class-a = 4";
    let unknown = ["there is no `clas-a` under [rooms]", "did you mean `class-a`?"];
    check(a, "clas-a = 4", ERROR, 11, &unknown);
    check("entrance = { passage", "entrace = { passage", ERROR, 12, &["did you mean `entrance`?"]);
    check(a, "class-a = -4", ERROR, 11, &["from `passage` to `class-a` cannot be -4 m long"]);
    check(a, "class-a = 0", ERROR, 11, &["cannot be 0 m long", "more than 0"]);
    check(a, "class-a = nan", ERROR, 11, &["must be a number"]);
    check(a, "class-a = 4000", ERROR, 11, &["cannot be 4000 m long", "at most 1000"]);
    check(a, "class-a = \"4 m\"", ERROR, 11, &["must be a number", "class-a = 4"]);
    check(a, "class-a = \"far\"", ERROR, 11, &["must be a number", "class-a = 4.0"]);
    check(a, "class-a = 4, passage = 3", ERROR, 11, &["leads from `passage` to itself"]);
    check(a, "class-a = { lenght = 4 }", ERROR, 11, &["unknown key `lenght`", "`length`"]);
    check(a, "class-a = { length = 4, one-way = 1 }", ERROR, 11, &["write one-way = true"]);
    check(a, "class-a = {}", WARNING, 11, &["has no length: 1 m is assumed"]);
    check(
        "one-way = true } }\nentrance",
        "one-way = true } }\nclass-b = 3\nentrance",
        ERROR,
        12,
        &["the doors of `class-b` must be a table of places and lengths"],
    );
    let again =
        "entrance = { passage = { length = 9.5, one-way = true } }\nclass-a = { passage = 4 }";
    let back = "entrance = { passage = { length = 9.5, one-way = true } }";
    check(back, again, WARNING, 13, &["between `class-a` and `passage` is there already"]);
    let other = again.replace("passage = 4 }", "passage = 5 }");
    check(back, &other, ERROR, 13, &["is there already", "one-way = true in both"]);
    // Without any length, one sentence is enough.
    let names = r#"passage = ["class-a", "class-b"]"#;
    let short = SCHOOL.replace(
        "passage = { class-a = 4, class-b = { length = 6.0 }, entrance = { length = 9, one-way = true } }",
        names,
    );
    let told = told(&short.replace(
        "entrance = { passage = { length = 9.5, one-way = true } }",
        "entrance = \"passage\"\nclass-a = \"class-b\"",
    ));
    assert_eq!(told.len(), 1, "{told:#?}");
    assert!(told[0].2.contains("4 doors have no length"), "{told:#?}");
}

#[test]
fn a_room_without_a_way() {
    let line = "class-b = { floor = 0 }\n";
    let lone = "class-b = {}\nattic = {}\n";
    let cure = "such as passage = { attic = 4.0 }";
    check(line, lone, WARNING, 7, &["no robot can reach `attic`: no door leads there", cure]);
    let meant = SCHOOL.replace(line, "class-b = {}\nattic = {}   # no way in\n");
    assert_eq!(told(&meant), []);
    // Robots cannot leave a place through a door that leads into it only.
    let one_way = "entrance = { passage = { length = 9.5, one-way = true } }\n";
    assert_eq!(told(&SCHOOL.replace(one_way, "")), []);
}

#[test]
fn agents_in_rooms() {
    let words = ["there is no `class-z` under [rooms]", "`class-a`"];
    check("location = \"class-a\"", "location = \"class-z\"", ERROR, 17, &words);
    let cure = "passage = { kind = \"room\" }";
    check(
        "location = \"class-a\"",
        "location = \"passage\"",
        WARNING,
        17,
        &["works in a room", cure],
    );
}

#[test]
fn two_descriptions_of_a_building() {
    let name = "name = \"village-school\"";
    let both = [&format!("{name}\nproblem = \"map.pddl\""), "[rooms] and `problem`"];
    check(name, both[0], ERROR, 3, &[both[1], "take one of the two out"]);
    let domain = format!("{name}\ndomain = \"words.pddl\"");
    check(name, &domain, ERROR, 3, &["[rooms] and `domain`", "vocabulary = \"FILE\""]);
    let rooms = SCHOOL.find("[rooms]").expect("rooms")..SCHOOL.find("[goals]").expect("goals");
    check(&SCHOOL[rooms], "", ERROR, 1, &["says nothing of the building: `[rooms]` is missing"]);
}

#[test]
fn a_vocabulary_adds_words() {
    let name = "name = \"village-school\"";
    let with = format!("{name}\nvocabulary = \"words.pddl\"");
    let file = SCHOOL.replacen(name, &with, 1).replacen(
        "class-b = { floor = 0 }",
        "class-b = { kind = \"class-room\", seats = 30, used-for = [\"music\", \"art\"], beside = \"class-a\" }",
        1,
    );
    assert_eq!(told(&file), []);
    let sandbox = Sandbox::new(&[("school.toml", &file), ("words.pddl", WORDS)]);
    let map = sandbox.check("check --print map school.toml", 0).stdout;
    for fact in ["(used-for class-b music)", "(= (seats class-b) 30)", "(beside class-b class-a)"] {
        assert!(map.contains(fact), "{fact}: {map}");
    }
    sandbox.check("check words.pddl", 0).shows(
        expect![[r#"
            words.pddl: vocabulary village (2 predicates, 0 actions): ok
        "#]],
        expect![""],
    );
    let told = told(&file.replace("beside = \"class-a\"", "beside = \"class-z\""));
    assert!(
        matches!(&told[..], [(_, 7, text)] if text.contains("there is no `class-z`")),
        "{told:#?}"
    );
    let told = told_with(&file, &WORDS.replace("(:functions", "(:functions (area ?r - room)"));
    assert!(
        matches!(&told[..], [(_, 4, text)] if text.contains("`area` differently")),
        "{told:#?}"
    );
    let other = format!("{name}\nvocabulary = \"word.pddl\"");
    let found = self::told(&SCHOOL.replacen(name, &other, 1));
    assert!(
        matches!(&found[..], [(_, 3, text)] if text.contains("did you mean `words.pddl`?")),
        "{found:#?}"
    );
}

#[test]
fn agents_that_reason_by_themselves() {
    let name = "name = \"village-school\"";
    let on = |daemons: &str| SCHOOL.replacen(name, &format!("{name}\nreasoning = {daemons}"), 1);
    let assigned = |file: &str| file.replace("config = {", "daemon = \"pi\"\nconfig = {");
    let sandbox = Sandbox::new(&[("school.toml", &assigned(&on("[\"desk\", \"pi\"]")))]);
    sandbox.check("check school.toml", 0).shows(
        expect![[r#"
            school.toml: ecosystem village-school (9 agents, 2 daemons, decentralized): ok
        "#]],
        expect![""],
    );
    // Daemons are named, and none of them is to reason.
    let told_of = told(&assigned(SCHOOL));
    let [(severity, 1, text)] = &told_of[..] else { panic!("one report: {told_of:#?}") };
    assert_eq!(severity, WARNING);
    assert!(
        text.contains("no agent of the file plans") && text.contains("reasoning = \"pi\""),
        "{text}"
    );
    let own = "\n[[agent]]\nname = \"wishes\"\nplugin = \"plan-requester\"\ndaemon = \"pi\"\n";
    let told_of = told(&(assigned(&on("\"pi\"")) + own));
    let is_error = |(severity, ..): &&(String, u64, String)| severity == ERROR;
    let errors: Vec<_> = told_of.iter().filter(is_error).collect();
    assert!(
        matches!(&errors[..], [(_, 3, text)] if text.contains("has a `plan-requester`")),
        "{told_of:#?}"
    );
    let taken = "name = \"thermometer-a\"";
    check(taken, "name = \"journal\"", ERROR, 15, &["an agent that every ecosystem needs"]);
    check(name, &format!("{name}\nreasoning = \"Desk 1\""), ERROR, 3, &["cannot be the name of"]);
}
