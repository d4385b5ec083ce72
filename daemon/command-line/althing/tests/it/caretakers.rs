//! Mistakes of people who write their first ecosystem file: each is reported once, at its place, with
//! the cure in their own terms.

use crate::mistakes::{ERROR, MAP, SCHOOL, WARNING, check, file, map, sandbox, told};

const WARM: &str = "\"(forall (?r - room) (known-temperature ?r))\"";

/// Checks that one mistake in the goal `warm` is reported once, in its line.
#[track_caller]
fn warm(goal: &str, words: &[&str]) {
    file(WARM, goal, ERROR, 64, words);
}

#[test]
fn goals_as_in_other_languages() {
    let cure = ["a goal stands in parentheses", "write (known-temperature class-a)"];
    warm("\"known-temperature class-a\"", &cure);
    warm("\"known-temperature(class-a)\"", &["write `(known-temperature class-a)`"]);
    let cure = ["begins with its sign", "write (>= (temperature class-a) 21)"];
    warm("\"(temperature class-a) >= 21\"", &cure);
    warm("\"(temperature class-a) >= 21 °C\"", &cure);
    let unit = ["a comparison ends before `C`", "write the number alone, without a unit"];
    warm("\"(>= (temperature class-a) 21 C)\"", &unit);
    warm("\"(known-temperature ?r)\"", &["unknown variable `?r`", "(forall (?r - room) …)"]);
    warm("\"(known-temperature)\"", &["takes 1 argument", "(known-temperature class-a)"]);
    warm("„(known-temperature class-a)“", &["not the quote", "a straight one"]);
}

#[test]
fn keys_with_other_names() {
    let lunch = "{ goal = \"(presented menu entrance)\", keep = \"maintain\" }";
    let keep = lunch.replace("\"maintain\"", "true");
    file(lunch, &keep, ERROR, 65, &["write keep = \"maintain\""]);
    let condition = lunch.replace("goal =", "condition =");
    file(lunch, &condition, ERROR, 65, &["unknown key `condition`", "did you mean `goal`?"]);
    file("plugin = \"screen\"", "plguin = \"screen\"", ERROR, 47, &["did you mean `plugin`?"]);
    file("plugin = \"screen\"", "type = \"screen\"", ERROR, 47, &["did you mean `plugin`?"]);
    let swapped = "name = \"screen\"\nplugin = \"screen-door\"";
    let words = ["are swapped", "write name = \"screen-door\" and plugin = \"screen\""];
    file("name = \"screen-door\"\nplugin = \"screen\"", swapped, ERROR, 47, &words);
}

#[test]
fn names_with_capitals_umlauts_and_digits() {
    let plugin = "plugin = \"screen\"";
    file(plugin, "plugin = \"Screen\"", ERROR, 47, &["did you mean `screen`?"]);
    let driver = "plugin = \"screen\"\ndriver = \"Simulated\"";
    file(plugin, driver, ERROR, 48, &["did you mean `simulated`?"]);
    let daemon = "daemon = \"rover-laptop\"";
    file(daemon, "daemon = \"Küchen-PC\"", ERROR, 54, &["such as `kuechen-pc`"]);
    file(daemon, "daemon = \"101-pi\"", ERROR, 54, &["such as `pi-101`"]);
    let name = "name = \"village-school\"";
    file(name, "name = \"Village School\"", ERROR, 2, &["such as `village-school`"]);
    let mounted = "mounted-on = \"rover\"";
    let cure = ["`rover-eye` is this agent itself", "the robot that carries it"];
    file(mounted, "mounted-on = \"rover-eye\"", ERROR, 61, &cure);
}

#[test]
fn signs_of_other_systems() {
    let path = "domain = \"../words/domain.pddl\"";
    let told = told(&SCHOOL.replace(path, "domain = \"..\\words\\domain.pddl\""), MAP);
    let slashes = |(_, place, text): &(String, String, String)| {
        place == "files/school.toml:3" && text.contains("\"../words/domain.pddl\"")
    };
    assert!(told.iter().any(slashes), "{told:#?}");
    file("speed = 0.3", "speed\u{a0}= 0.3", ERROR, 55, &["a no-break space", "a normal space"]);
    let config = "config = { mounted-on = \"rover\" }";
    file(config, "config = { mounted-on = \"rover\"; }", ERROR, 61, &["`;`", "take it out"]);
    let name = "name = \"thermometer-a\"";
    file(name, "name = `thermometer-a`", ERROR, 28, &["write \"thermometer-a\""]);
}

#[test]
fn tables_in_the_wrong_form() {
    let config = "config = { location = \"class-a\" }";
    let told = told(&SCHOOL.replace(config, "[config]\nlocation = \"class-a\""), MAP);
    assert!(told.iter().any(|(_, _, text)| text.contains("write [agent.config]")), "{told:#?}");
    let entry = "[[agent]]\nname = \"thermometer-a\"";
    let words = ["an entry of its own: write [[agent]]", "name = \"thermometer-a\""];
    file(entry, "[agent.thermometer-a]", ERROR, 27, &words);
}

#[test]
fn files_of_another_format() {
    for (text, words) in [
        ("ecosystem:\n  name: school\n", ["this is YAML", "write [ecosystem] in a line"]),
        ("{\"ecosystem\": {\"name\": \"school\"}}", ["this is JSON", "[ecosystem] in a line"]),
    ] {
        check(text, MAP, ERROR, "files/school.toml:1", &words);
    }
    let latin = SCHOOL.replace("Today: soup", "Käsespätzle");
    let bytes: Vec<u8> =
        latin.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect();
    sandbox(&bytes, MAP.as_bytes()).check("check files/school.toml", 0);
}

#[test]
fn a_file_in_the_next_folder() {
    let sandbox = sandbox(SCHOOL.as_bytes(), MAP.as_bytes());
    for command in ["check school.toml", "up school.toml"] {
        let run = sandbox.run(command);
        let said = run.stderr.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains("did you mean `files/school.toml`?"), "{said}");
    }
}

#[test]
fn mistakes_in_the_map_are_reported_once() {
    // A parenthesis is missing inside a fact.
    let fact = "(connected class-a passage) (= (distance class-a passage) 4)";
    let broken = "(connected class-a passage (= (distance class-a passage) 4)";
    map(fact, broken, ERROR, 9, &["a `)` is missing: write it after `passage`"]);
    // A room was removed, and what uses it is still there.
    let removed = MAP.replace("class-a class-b entrance", "class-a class-b");
    let told = told(SCHOOL, &removed);
    let in_map = |(_, place, _): &&(String, String, String)| place.starts_with("words/");
    let [(_, place, text)] = &told.iter().filter(in_map).collect::<Vec<_>>()[..] else {
        panic!("one report on the map: {told:#?}")
    };
    assert_eq!(place, "words/school.pddl:12");
    assert!(text.contains("unknown object `entrance`; declare it under `:objects`"), "{text}");
    let words = ["unknown predicate `stairs`", "declare it in the domain"];
    map("(= (total-cost) 0)", "(= (total-cost) 0) (stairs passage)", ERROR, 7, &words);
    // The rooms are declared as corridors.
    let words = ["3 places are declared as `corridor`", "write `- room` after these places"];
    let told = self::told(
        &SCHOOL.replace("(presented menu entrance)", "(known-temperature class-a)"),
        &MAP.replace("entrance - room", "entrance - corridor"),
    );
    let found = told.iter().filter(|(severity, place, text)| {
        severity == WARNING
            && place == "words/school.pddl:4"
            && words.iter().all(|w| text.contains(w))
    });
    assert_eq!(found.count(), 1, "{told:#?}");
}

#[test]
fn a_command_that_does_not_exist() {
    let sandbox = sandbox(SCHOOL.as_bytes(), MAP.as_bytes());
    let run = sandbox.check("goalz", 64);
    assert!(run.stderr.contains("did you mean `althing goal"), "{}", run.stderr);
    let run = sandbox.check("frobnicate", 64);
    let words = "there is no command `althing frobnicate`; `althing help` lists the commands";
    assert!(run.stderr.contains(words), "{}", run.stderr);
}
