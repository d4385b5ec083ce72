//! Tests of goals in words: asked for, answered and shown in English and German, with PDDL on request.

use crate::support::{Office, finish, office, stderr, stdout};

/// Runs a command as a person does at a terminal of a language; the other tests compare PDDL.
fn spoken(office: &Office, locale: &str, arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = office.command(arguments);
    command.env_remove("ALTHING_PDDL").env("LC_ALL", locale);
    let output = finish(&mut command);
    (output.status.code(), stdout(&output) + &stderr(&output))
}

#[test]
fn a_goal_is_asked_for_in_words() {
    let office = office();
    let english = |arguments: &[&str]| spoken(&office, "C.UTF-8", arguments);
    let german = |arguments: &[&str]| spoken(&office, "de_DE.UTF-8", arguments);

    let (code, plan) = english(&["goal", "temperature of office1 known", "--dry-run"]);
    assert_eq!(code, Some(0), "{plan}");
    assert!(plan.starts_with("temperature of office1 known\n"), "{plan}");
    let (code, plan) = german(&["goal", "Temperatur von office1 bekannt", "--dry-run"]);
    assert_eq!(code, Some(0), "{plan}");
    assert!(plan.starts_with("Temperatur von office1 bekannt\n"), "{plan}");

    let (code, said) = english(&["goal", "temperature of office1 known"]);
    assert_eq!(code, Some(0), "{said}");
    let (_, state) = english(&["state"]);
    assert!(state.contains("temperature of office1 known"), "{state}");
    assert!(state.contains("temperature of office1 is 20.5 °C"), "{state}");
    let (_, state) = english(&["state", "--pddl"]);
    assert!(state.contains("(known-temperature office1)"), "{state}");
    let (_, state) = english(&["state", "--language", "de"]);
    assert!(state.contains("Temperatur von office1 ist 20,5 °C"), "{state}");
    let (_, json) = english(&["state", "--json"]);
    assert!(json.contains("(known-temperature office1)"), "programs get PDDL: {json}");

    // The robot wants this by itself.
    let (_, goals) = english(&["goals"]);
    assert!(goals.contains(" corridor patrolled\n"), "{goals}");
    let (_, goals) = german(&["goals"]);
    assert!(goals.contains(" corridor kontrolliert\n"), "{goals}");
}

#[test]
fn words_that_are_not_understood_are_answered_with_the_nearest() {
    let office = office();
    let english = |arguments: &[&str]| spoken(&office, "C.UTF-8", arguments);

    let (code, said) = english(&["goal", "temperature of ofice1 known"]);
    assert_eq!(code, Some(33), "{said}");
    let expected = "1:16: error: `ofice1` is not understood; did you mean \
                    `temperature of office1 known`?";
    assert!(said.contains(expected), "{said}");

    let (code, said) = english(&["goal", "temperature of office1 knwon"]);
    assert_eq!(code, Some(33), "{said}");
    assert!(said.contains("did you mean `temperature of office1 known`?"), "{said}");

    // There is no plan: the explanation speaks in words, too.
    let never = "(mounted-on thermometer-office2 turtlebot-1)";
    let (code, said) = english(&["goal", never]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("`thermometer-office2 mounted on turtlebot-1`"), "{said}");
    let (_, said) = english(&["goal", never, "--pddl"]);
    assert!(said.contains(&format!("`{never}`")), "{said}");
}

#[test]
fn a_file_has_goals_and_words_of_its_own() {
    let office = Office::new();
    let check = |goal: &str, words: &str| {
        let rest = std::fs::read_to_string(Office::file()).expect("the file is there");
        let domains = Office::file()
            .parent()
            .and_then(|folder| folder.parent())
            .map(|root| root.join("domains").display().to_string());
        let rest = rest.replace("../domains", &domains.expect("the file is in a folder"));
        let goals = format!("[goals]\nmine = \"{goal}\"\n");
        let file = office.write("own.toml", &(rest.replacen("[goals]\n", &goals, 1) + words));
        let (code, said) = spoken(&office, "C.UTF-8", &["check", &file.display().to_string()]);
        // Messages are folded to the width of a terminal.
        (code, said.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    let (code, said) = check("temperature of every room known", "");
    assert_eq!(code, Some(0), "{said}");
    let words = "\n[words.en.predicates]\npatrolled = { phrase = \"{1} looked after\" }\n";
    let (code, said) = check("corridor looked after", words);
    assert_eq!(code, Some(0), "{said}");
    let (code, said) = check("corridor looked aftr", words);
    assert_eq!(code, Some(33), "{said}");
    assert!(said.contains("did you mean `corridor looked after`?"), "{said}");
    let words = "\n[words.en.predicates]\npatrolled = { phrase = \"{2} looked after\" }\n";
    let (code, said) = check("temperature of every room known", words);
    assert_eq!(code, Some(33), "{said}");
    assert!(said.contains("`[words.en]` cannot be used"), "{said}");
}

#[test]
fn a_shell_completes_words() {
    let office = office();
    let (code, said) = spoken(&office, "C.UTF-8", &["completions", "--words", "temperature of o"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(said, "temperature of office1\ntemperature of office2\n");
}
