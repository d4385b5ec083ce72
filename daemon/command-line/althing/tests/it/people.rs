//! `althing people`: people are added, changed and removed in files, and mistakes in these are found.

use std::fs::{self, Permissions};
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};

use accounts::{Accounts, LoggedRequest, PasswordCost, PeopleFile, PersonName, RequestLog};
use expect_test::expect;
use serde_json::{Value, json};

use crate::sandbox::Sandbox;

const DOMAIN: &str = "(define (domain house) (:types room) (:predicates (warm ?r - room)))";

const MAP: &str = "\
(define (problem house-map) (:domain house) (:objects kitchen - room)
  (:init (warm kitchen)) (:goal (and)))";

const ECOSYSTEM: &str = r#"[ecosystem]
name = "house"
domain = "house.pddl"
problem = "map.pddl"

[[agent]]
name = "domain-maintainer"
plugin = "domain-maintainer"
"#;

const PASSWORD: &str = "correct horse battery";

fn house() -> Sandbox {
    Sandbox::new(&[("house.pddl", DOMAIN), ("map.pddl", MAP), ("althing.toml", ECOSYSTEM)])
}

/// Runs `althing` with a line on standard input; returns whether it succeeded, and what it printed.
fn typed(sandbox: &Sandbox, arguments: &str, line: &str) -> (bool, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_althing"));
    command.args(arguments.split_whitespace()).current_dir(sandbox.path()).env_clear();
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the binary runs");
    let mut input = child.stdin.take().expect("a pipe");
    // A command that needs no line may have ended.
    let _ = input.write_all(line.as_bytes());
    drop(input);
    let output = child.wait_with_output().expect("it ends");
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8(text).expect("UTF-8"))
}

fn people(sandbox: &Sandbox) -> Value {
    sandbox.check("people --json", 0).json()["people"].clone()
}

#[test]
fn the_first_person_is_added_and_signs_in() {
    let house = house();
    assert_eq!(people(&house), json!([]));
    let (is_done, text) = typed(&house, "people add anna --role caretaker", PASSWORD);
    assert!(is_done && text.starts_with("added `anna` (look, ask, admit, stop)"), "{text}");
    assert!(!text.contains(PASSWORD), "{text}");
    let path = house.path().join("people.toml");
    let mode = fs::metadata(&path).expect("a file").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let accounts = Accounts::open_with(path, PasswordCost::FOR_TESTS).expect("a file");
    let home = [127, 0, 0, 1].into();
    let now = std::time::SystemTime::now();
    assert!(accounts.sign_in("anna", PASSWORD, home, now).is_ok());
    assert!(accounts.sign_in("anna", "another", home, now).is_err());
}

#[test]
fn people_are_listed_without_hashes() {
    let house = house();
    house.check("people add anna --generate --rights stop,look", 0);
    house.check("people add bot --no-password", 0);
    house.check("people token add bot wall", 0);
    let added = &people(&house)[1]["tokens"][0]["added"];
    assert_eq!(added.as_str().map(str::len), Some(10));
    let shown = house.check("people", 0).stdout;
    let day = added.as_str().unwrap_or_default();
    expect![[r#"
        NAME                 PASSWORD  RIGHTS                                 TOKENS
        anna                 yes       look, stop
        bot                  no        look, ask                              wall (DAY)
    "#]]
    .assert_eq(&shown.replace(day, "DAY"));
    let json = house.check("people --json", 0).stdout;
    assert!(!json.contains("argon2") && !json.contains("sha256"), "{json}");
}

#[test]
fn a_screen_of_a_robot_is_added_with_a_link_and_removed() {
    let house = house();
    let refused = house.check("people add-screen domain-maintainer", 33).stderr;
    assert!(refused.contains("`[web]` in its file"), "{refused}");
    let web = format!("{ECOSYSTEM}\n[web]\nlisten = \"127.0.0.1:8650\"\n");
    fs::write(house.path().join("althing.toml"), web).expect("written");
    let refused = house.check("people add-screen domain-maintainr", 33).stderr;
    assert!(refused.contains("did you mean `domain-maintainer`?"), "{refused}");
    let added = house.check("people add-screen domain-maintainer --json", 0).json();
    assert_eq!(added["name"], "domain-maintainer-screen", "{added}");
    let link = added["link"].as_str().expect("a link");
    let token = link
        .strip_prefix("http://127.0.0.1:8650/robot/domain-maintainer#screen=")
        .unwrap_or_else(|| panic!("{link}"));
    let text = fs::read_to_string(house.path().join("people.toml")).expect("a file");
    assert!(text.contains("screen = \"domain-maintainer\"") && !text.contains(token), "{text}");
    let accounts = Accounts::open_with(house.path().join("people.toml"), PasswordCost::FOR_TESTS);
    let screen = accounts.expect("a file").screen(token).expect("the screen");
    assert!(screen.is_screen_of("domain-maintainer"));
    let listed = house.check("people", 0).stdout;
    assert!(listed.contains("the screen of domain-maintainer"), "{listed}");
    let refused = house.check("people rights domain-maintainer-screen --role visitor", 33).stderr;
    assert!(refused.contains("it is the screen of `domain-maintainer`"), "{refused}");
    house.check("people add-screen domain-maintainer", 33);
    house.check("people remove domain-maintainer-screen", 0);
    assert_eq!(people(&house), json!([]));
}

#[test]
fn passwords_rights_and_tokens_are_changed() {
    let house = house();
    let made = house.check("people add anna --generate --json", 0).json();
    let first = made["password"].as_str().expect("a password").to_owned();
    assert_eq!(first.len(), 23);
    let (is_done, text) = typed(&house, "people password anna", &format!("{PASSWORD}\r\n"));
    assert!(is_done, "{text}");
    house.check("people rights anna --role operator", 0);
    let token = house.check("people token add anna wall --json", 0).json();
    let token = token["token"].as_str().expect("a token").to_owned();
    let path = house.path().join("people.toml");
    let accounts = Accounts::open_with(path, PasswordCost::FOR_TESTS).expect("a file");
    let (home, now) = ([127, 0, 0, 1].into(), std::time::SystemTime::now());
    assert!(accounts.sign_in("anna", PASSWORD, home, now).is_ok());
    assert!(accounts.sign_in("anna", &first, home, now).is_err());
    let person = accounts.program(&token, home, now).expect("a token");
    assert_eq!(person.rights.len(), 5);
    house.check("people token remove anna wall", 0);
    house.check("people remove anna", 0);
    assert_eq!(people(&house), json!([]));
}

#[test]
fn mistakes_are_refused_and_change_nothing() {
    let house = house();
    house.check("people add anna --generate", 0);
    let before = people(&house);
    for (arguments, line, expected) in [
        ("people add anna", PASSWORD, "failed to add `anna`: there is a person of this name"),
        ("people add Anna", PASSWORD, "`Anna` is no name of a person"),
        ("people add domain-maintainer", PASSWORD, "there is an agent called `domain-maintainer`"),
        ("people add ben", "short", "failed to use this password: it is too short"),
        ("people add ben", "", "standard input ended before there was a password"),
        ("people password ben", PASSWORD, "there is no person of this name; there are anna"),
        ("people remove ben", "", "there is no person of this name; there are anna"),
        ("people token remove anna wall", "", "`anna` has none of this name"),
        ("people rights anna --rights lok", "", "invalid value 'lok'"),
        ("people rights anna", "", "required"),
        ("people add ben --ecosystem nowhere", PASSWORD, "find an ecosystem called `nowhere`"),
    ] {
        let (is_done, text) = typed(&house, arguments, line);
        assert!(!is_done && text.contains(expected), "{arguments}: {text}");
    }
    assert_eq!(people(&house), before);
    let wrong = house.check("people remove ben --json", 33).json();
    assert_eq!(wrong["status"], "bad-input");
}

#[test]
fn two_commands_at_once_lose_nothing() {
    let house = house();
    let add = |name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_althing"));
        command.args(["people", "add", name, "--no-password"]).current_dir(house.path());
        command.env_clear().stdout(Stdio::null()).spawn().expect("the binary runs")
    };
    let mut all: Vec<_> = ["a", "b", "c", "d", "e", "f"].map(add).into();
    assert!(all.iter_mut().all(|child| child.wait().expect("it ends").success()));
    assert_eq!(people(&house).as_array().map(Vec::len), Some(6));
}

#[test]
fn the_file_of_people_is_checked_with_its_ecosystem() {
    let house = house();
    house.check("check althing.toml", 0);
    house.write(
        "people.toml",
        b"[people.domain-maintainer]\nrights = [\"lok\"]\npassword = \"hunter2hunter2\"\n\n\
          [people.hall]\nrights = []\nscreen = \"domain-maintaner\"\n",
    );
    let path = house.path().join("people.toml");
    fs::set_permissions(&path, Permissions::from_mode(0o600)).expect("ours");
    house.check("check people.toml", 33);
    let run = house.check("check althing.toml", 33);
    assert!(!run.stderr.contains("hunter2"), "{}", run.stderr);
    for expected in [
        "error: there is an agent called `domain-maintainer`",
        "people.toml:1:9",
        "error: there is no such right",
        "did you mean \"look\"?",
        "error: `password` must be an argon2id hash",
        "althing people password domain-maintainer",
        "is called `domain-maintaner`",
        "people.toml:7:10",
        "did you mean `domain-maintainer`?",
    ] {
        assert!(run.stderr.contains(expected), "{expected}\n{}", run.stderr);
    }
    fs::set_permissions(&path, Permissions::from_mode(0o666)).expect("ours");
    let run = house.check("check althing.toml", 33);
    assert!(run.stderr.contains("others can write it (mode 666)"), "{}", run.stderr);
}

#[test]
fn an_ecosystem_names_another_file() {
    let house = house();
    house.write("althing.toml", format!("{ECOSYSTEM}\n[people]\nfile = \"us.toml\"\n").as_bytes());
    let run = house.check("check althing.toml", 0);
    assert!(run.stderr.contains("us.toml, so nobody can sign in"), "{}", run.stderr);
    house.check("people add anna --generate", 0);
    assert!(house.path().join("us.toml").is_file() && !house.path().join("people.toml").exists());
    let run = house.check("check althing.toml", 0);
    assert!(!run.stderr.contains("us.toml"), "{}", run.stderr);
    // An empty path is one mistake, and is no reason to speak of the default file.
    house.write("althing.toml", format!("{ECOSYSTEM}\n[people]\nfile = \"\"\n").as_bytes());
    let run = house.check("check althing.toml", 33);
    assert!(run.stderr.contains("1 error") && !run.stderr.contains("warning"), "{}", run.stderr);
}

#[test]
fn the_doctor_finds_a_file_that_others_can_read() {
    let house = house();
    let finding = |house: &Sandbox| {
        let report = house.run("doctor althing.toml --json").json();
        let checks = report["checks"].as_array().cloned().unwrap_or_default();
        checks.into_iter().find(|check| check["check"] == "people").expect("the check of people")
    };
    assert_eq!(finding(&house)["verdict"], "ok");
    house.check("people add anna --generate", 0);
    assert_eq!(finding(&house)["text"], "1 person can sign in");
    let path = house.path().join("people.toml");
    fs::set_permissions(&path, Permissions::from_mode(0o644)).expect("ours");
    let found = finding(&house);
    assert_eq!(found["verdict"], "problem");
    let mend = found["remedy"]["command"].as_str().expect("a command");
    assert!(mend.starts_with("chmod 600 ") && mend.ends_with("people.toml"), "{mend}");
    fs::set_permissions(&path, Permissions::from_mode(0o600)).expect("ours");
    assert_eq!(finding(&house)["verdict"], "ok");
}

#[test]
fn the_log_shows_requests_of_one_person_or_all() {
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().to_str().expect("UTF-8").to_owned();
    let house = house().with_variable("ALTHING_STATE_DIR", &state);
    let shown = house.check("people log", 0).stdout;
    assert!(shown.starts_with("no request is logged in"), "{shown}");
    let daemon = folder.path().join("house/hall-pi");
    fs::create_dir_all(&daemon).expect("a folder");
    let log = RequestLog::open(&daemon).expect("a log");
    for (name, what) in [("anna", "goal (warm kitchen)"), ("ben", "stop\u{1b}[31m")] {
        log.record(LoggedRequest {
            at: std::time::SystemTime::now(),
            person: PersonName::new(name).ok(),
            from: [192, 168, 1, 2].into(),
            through: "hall-pi".to_owned(),
            what: what.to_owned(),
            outcome: "done".to_owned(),
        });
    }
    drop(log);
    let shown = house.check("people log", 0).stdout;
    assert!(shown.contains("hall-pi        goal (warm kitchen): done"), "{shown}");
    assert!(shown.contains("stop␛[31m"), "{shown}");
    let of_anna = house.check("people log anna --json", 0).json();
    assert_eq!(of_anna["requests"].as_array().map(Vec::len), Some(1));
    assert_eq!(of_anna["requests"][0]["what"], "goal (warm kitchen)");
    let newest = house.check("people log --last 1 --json", 0).json();
    assert_eq!(newest["requests"][0]["person"], "ben");
}

/// The file of the tests above is what the library reads, too.
#[test]
fn a_written_file_has_no_mistakes() {
    let house = house();
    house.check("people add anna --generate", 0);
    house.check("people token add anna wall", 0);
    let path = house.path().join("people.toml");
    assert_eq!(PeopleFile::new(&path).read().expect("a file").len(), 1);
    house.check("check people.toml", 0).shows(
        expect![[r#"
            people.toml: people (1 person): ok
        "#]],
        expect![""],
    );
}
