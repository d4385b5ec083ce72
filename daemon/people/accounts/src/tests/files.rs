//! Files of people: what is written is read again, mistakes are found at their places, and changes
//! are whole.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Child, Command};

use super::{PASSWORD, PeopleFolder, hashed, name, record, start};
use crate::{
    AccountsError, PeopleFile, PeopleRecords, PersonRecord, PersonRight, StoredToken, TOKENS_MAX,
    read_people, without_secrets,
};

/// Variable with the file that [`one_of_two_processes`] changes; a test process has no arguments.
const FILE_OF_CHILD: &str = "ACCOUNTS_TEST_FILE";

/// Variable with the beginning of the names that [`one_of_two_processes`] adds.
const NAMES_OF_CHILD: &str = "ACCOUNTS_TEST_NAMES";

/// People that each process adds.
const ADDED_BY_CHILD: usize = 20;

fn mistakes(text: &str) -> Vec<(String, String)> {
    let read = read_people(text);
    let place = |found: &pddl::Diagnostic| text[found.span.range()].to_owned();
    read.mistakes.iter().map(|found| (place(found), found.message.clone())).collect()
}

#[test]
fn a_file_is_read_as_it_is_written() {
    let folder = PeopleFolder::new();
    assert!(folder.file.read().expect("no file").is_empty());
    folder.add(record("anna", &[PersonRight::Look, PersonRight::Stop]));
    folder.add(record("ben", &[]));
    folder.token("anna", "dashboard");
    folder.token("anna", "wall-display");
    let people = folder.file.read().expect("a file");
    assert_eq!(people.len(), 2);
    let anna = people.get("anna").expect("anna");
    assert!(anna.person().may(PersonRight::Stop) && !anna.person().may(PersonRight::Ask));
    let tokens: Vec<_> = anna.tokens.iter().map(|token| token.name.as_str()).collect();
    assert_eq!(tokens, ["dashboard", "wall-display"]);
    assert_eq!(anna.tokens[0].added, "2026-11-28");
    let text = fs::read_to_string(folder.file.path()).expect("a text");
    let read = read_people(&text);
    assert_eq!(read.records, people);
    assert!(read.mistakes.iter().all(|found| !found.is_error()), "{:?}", read.mistakes);
    assert!(!text.contains(PASSWORD) && !text.contains("althing_"), "{text}");
}

#[test]
fn a_token_without_a_day_stays_one() {
    let folder = PeopleFolder::new();
    let hash = format!("sha256:{}", "ab".repeat(32));
    let token = format!("[[people.anna.token]]\nname = \"one\"\nhash = \"{hash}\"\n");
    fs::write(folder.file.path(), format!("[people.anna]\nrights = []\n{token}")).expect("a file");
    fs::set_permissions(folder.file.path(), Permissions::from_mode(0o600)).expect("ours");
    folder.add(record("ben", &[]));
    assert_eq!(folder.file.read().expect("a file").get("anna").map(|it| it.tokens.len()), Some(1));
}

#[test]
fn a_file_is_for_its_user_alone_and_nothing_is_left_beside_it() {
    let folder = PeopleFolder::with(&["anna"]);
    let mode = fs::metadata(folder.file.path()).expect("a file").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    assert_eq!(folder.file.loose_mode(), None);
    fs::set_permissions(folder.file.path(), Permissions::from_mode(0o644)).expect("ours");
    assert_eq!(folder.file.loose_mode(), Some(0o644));
    assert!(folder.file.read().is_ok(), "reading by others is a finding of the doctor");
    fs::set_permissions(folder.file.path(), Permissions::from_mode(0o620)).expect("ours");
    let error = folder.file.read().expect_err("others can write it").to_string();
    assert!(error.contains("chmod 600"), "{error}");
    let names = fs::read_dir(folder.folder.path()).expect("a folder").count();
    assert_eq!(names, 1);
}

#[test]
fn a_link_to_a_file_stays_one() {
    let folder = PeopleFolder::with(&["anna"]);
    let link = folder.folder.path().join("link.toml");
    std::os::unix::fs::symlink(folder.file.path(), &link).expect("a link");
    let linked = PeopleFile::new(&link);
    linked.change(|people| people.add(record("ben", &[]))).expect("a change");
    assert!(fs::symlink_metadata(&link).expect("a link").is_symlink());
    assert_eq!(folder.file.read().expect("a file").len(), 2);
}

#[test]
fn what_is_no_file_of_people_is_refused() {
    let folder = PeopleFolder::new();
    fs::create_dir(folder.file.path()).expect("a folder");
    assert!(folder.file.read().expect_err("a folder").to_string().contains("no regular file"));
    fs::remove_dir(folder.file.path()).expect("ours");
    fs::write(folder.file.path(), [0xff, 0xfe, 0x00]).expect("a file");
    assert!(folder.file.read().expect_err("bytes").to_string().contains("UTF-8"));
    fs::write(folder.file.path(), " ".repeat((4 << 20) + 1)).expect("a file");
    assert!(matches!(folder.file.read(), Err(AccountsError::TooLong { .. })));
}

#[test]
fn mistakes_are_found_at_their_places() {
    let good = hashed(PASSWORD);
    let text = format!(
        "[people.Anna]\nrights = []\n\
         [people.ben]\nrights = [\"look\", \"aks\", \"look\", 3]\npasword = \"x\"\n\
         [people.carl]\npassword = \"hunter22222\"\n\
         [people.dora]\nrights = \"look\"\npassword = \"{}\"\n\
         [[people.dora.token]]\nname = \"a b\"\nhash = \"sha256:00\"\nadded = \"today\"\n\
         [[people.dora.token]]\n\
         [persons]\n",
        good.as_str()
    );
    let found = mistakes(&text);
    let expected = [
        ("Anna", "`Anna` is no name of a person"),
        ("\"aks\"", "there is no such right"),
        ("\"look\"", "`look` stands here twice"),
        ("3", "a right is a word in quotes"),
        ("pasword", "unknown key `pasword` in `people.ben`"),
        ("carl", "`people.carl` has no rights"),
        ("\"hunter22222\"", "`password` must be an argon2id hash: it is no hash of a password"),
        ("\"look\"", "`rights` must be a list of words in quotes"),
        ("\"a b\"", "a token's name has the form of a person's"),
        ("\"sha256:00\"", "`hash` must be \"sha256:\" and 64 hexadecimal digits"),
        ("\"today\"", "`added` must be a day"),
        ("persons", "unknown key `persons`"),
    ];
    for (place, message) in expected {
        let is_it = |(at, said): &&(String, String)| at == place && said.starts_with(message);
        assert!(found.iter().any(|each| is_it(&each)), "{place}: {message}\n{found:#?}");
    }
    assert!(found.iter().any(|(_, said)| said == "a token has a name and a hash"), "{found:#?}");
    let weak = "the hash of this password is cheaper to guess than a new one";
    assert!(found.iter().any(|(_, said)| said == weak), "{found:#?}");
    assert_eq!(found.len(), expected.len() + 2, "{found:#?}");
}

#[test]
fn tokens_that_stand_twice_are_found() {
    let hash = format!("sha256:{}", "ab".repeat(32));
    let token = |of: &str, name: &str| {
        format!("[[people.{of}.token]]\nname = \"{name}\"\nhash = \"{hash}\"\n")
    };
    let people = "[people.anna]\nrights = []\n[people.ben]\nrights = []\n";
    let text = format!("{people}{}{}", token("anna", "one"), token("ben", "two"));
    let found = mistakes(&text);
    assert!(found[0].1.contains("has the hash of another token"), "{found:?}");
    let text = format!("{people}{}{}", token("anna", "one"), token("anna", "one"));
    assert!(mistakes(&text)[0].1.contains("two tokens called `one`"), "{text}");
}

#[test]
fn a_message_about_a_mistake_shows_no_secret() {
    let folder = PeopleFolder::new();
    let text = "[people.anna]\nrights = [\"lok\"]\npassword = \"hunter2 passwörd\" # hush\n";
    fs::write(folder.file.path(), text).expect("a file");
    fs::set_permissions(folder.file.path(), Permissions::from_mode(0o600)).expect("ours");
    let error = folder.file.read().expect_err("mistakes");
    let said = format!("{error} {error:?}");
    assert!(!said.contains("hunter2") && !said.contains("hush"), "{said}");
    let shown = without_secrets(text);
    assert_eq!(shown.len(), text.len());
    assert_eq!(shown.lines().count(), text.lines().count());
    assert!(shown.starts_with("[people.anna]\nrights = [\"lok\"]\npassword = ***"), "{shown}");
    let misspelled =
        "[people.anna] # hunter2 = hunter2\npasword = \"hunter2\"\n\"\"\"hunter2\n# hunter2\n";
    let shown = without_secrets(misspelled);
    assert!(shown.starts_with("[people.anna] *") && !shown.contains("hunter2"), "{shown}");
    let inline = "people = { anna = { rights = [], password = \"x y\" } } # \"z\"\nrights = []\n";
    let shown = without_secrets(inline);
    assert!(!shown.contains('x') && !shown.contains('z'), "{shown}");
    assert!(shown.ends_with("\nrights = []\n"), "{shown}");
}

#[test]
fn changes_are_refused_with_the_names_that_there_are() {
    let folder = PeopleFolder::with(&["anna", "ben"]);
    let error = folder.file.change(|people| people.remove("carl")).expect_err("unknown");
    assert!(error.to_string().ends_with("there are anna, ben"), "{error}");
    let error = folder.file.change(|people| people.add(record("anna", &[]))).expect_err("twice");
    assert!(matches!(error, AccountsError::Exists(_)), "{error}");
    folder.token("anna", "one");
    let error = folder.file.change(|people| people.remove_token("anna", "two"));
    assert!(error.expect_err("unknown").to_string().ends_with("there are one"));
    for more in 1..TOKENS_MAX {
        folder.token("anna", &format!("t{more}"));
    }
    let (_, full) = crate::StoredToken::make(super::name("full"), start()).expect("random");
    let error = folder.file.change(|people| people.add_token("anna", full));
    assert!(matches!(error, Err(AccountsError::TooMany { .. })));
}

/// A file that ends anywhere has mistakes or fewer people, and never other people or other rights.
#[test]
fn a_torn_file_gives_no_person_more_rights() {
    let folder = PeopleFolder::new();
    folder.add(record("anna", &[PersonRight::Look]));
    folder.add(record("annabel", &[PersonRight::Look, PersonRight::Ask, PersonRight::Change]));
    folder.token("anna", "one");
    let whole = folder.file.read().expect("a file");
    let text = fs::read_to_string(folder.file.path()).expect("a text");
    for end in 0..text.len() {
        let Some(torn) = text.get(..end) else { continue };
        for person in read_people(torn).records.iter() {
            let known = whole.get(person.name.as_str());
            let known = known.map(|known| known.rights.clone()).unwrap_or_default();
            assert!(person.rights.is_subset(&known), "{end}: {person:?}");
        }
    }
}

#[test]
fn a_change_that_fails_leaves_the_file() {
    let folder = PeopleFolder::with(&["anna"]);
    let before = fs::read_to_string(folder.file.path()).expect("a text");
    fs::write(folder.file.path(), format!("{before}[people.ben\n")).expect("ours");
    let error = folder.file.change(|people| people.add(record("carl", &[]))).expect_err("torn");
    assert!(matches!(error, AccountsError::Mistakes { .. }), "{error}");
    let after = fs::read_to_string(folder.file.path()).expect("a text");
    assert_eq!(after, format!("{before}[people.ben\n"));
}

/// Runs in a process of its own, started by the next test.
#[test]
#[ignore = "a part of `two_processes_lose_no_change_of_each_other`"]
fn one_of_two_processes() {
    let path = std::env::var_os(FILE_OF_CHILD).expect("the other test sets it");
    let begin = std::env::var(NAMES_OF_CHILD).expect("the other test sets it");
    let file = PeopleFile::new(PathBuf::from(path));
    for number in 0..ADDED_BY_CHILD {
        let person = record(&format!("{begin}{number}"), &[]);
        file.change(|people| people.add(person)).expect("a change");
    }
}

#[test]
fn two_processes_lose_no_change_of_each_other() {
    let folder = PeopleFolder::new();
    let program = std::env::current_exe().expect("this test");
    let child = |begin: &str| -> Child {
        Command::new(&program)
            .args(["--exact", "tests::files::one_of_two_processes", "--ignored"])
            .env(FILE_OF_CHILD, folder.file.path())
            .env(NAMES_OF_CHILD, begin)
            .stdout(std::process::Stdio::null())
            .spawn()
            .expect("a process")
    };
    let mut children = [child("a"), child("b")];
    let ended = children.each_mut().map(|child| child.wait().expect("it ends").success());
    assert_eq!(ended, [true, true]);
    assert_eq!(folder.file.read().expect("a file").len(), 2 * ADDED_BY_CHILD);
}

#[test]
fn a_screen_has_a_token_and_neither_rights_nor_a_password() {
    let folder = PeopleFolder::with(&["anna"]);
    let (token, stored) = StoredToken::make(name("screen"), start()).expect("random");
    let screen = PersonRecord::screen(name("hall-screen"), "turtlebot-1", stored);
    folder.add(screen.clone());
    let text = fs::read_to_string(folder.file.path()).expect("written");
    assert!(text.contains("rights = []\nscreen = \"turtlebot-1\"\n"), "{text}");
    assert_eq!(folder.file.read().expect("a file").get("hall-screen"), Some(&screen));

    let accounts = folder.accounts();
    let person = accounts.screen(&token).expect("the screen");
    assert!(person.is_screen_of("turtlebot-1") && !person.is_screen_of("turtlebot-2"));
    assert!(PersonRight::ALL.iter().all(|right| !person.may(*right)));
    let of_anna = folder.token("anna", "laptop");
    assert_eq!(folder.accounts().screen(&of_anna), None, "this one is of a person");

    let change = |what: fn(&mut PeopleRecords) -> Result<(), AccountsError>| {
        folder.file.change(what).expect_err("it is a screen").to_string()
    };
    let rights = change(|people| people.set_rights("hall-screen", [PersonRight::Ask].into()));
    let password = change(|people| people.set_password("hall-screen", hashed(PASSWORD)));
    for error in [rights, password] {
        assert!(error.contains("the screen of `turtlebot-1`"), "{error}");
    }
    folder.file.change(|people| people.remove("hall-screen")).expect("removed");
    let removed = folder.accounts();
    assert_eq!(removed.screen(&token), None);
}

#[test]
fn mistakes_about_screens_are_found_at_their_places() {
    let found = mistakes("[people.a]\nrights = []\nscreen = \"No Name\"\n");
    assert_eq!(found[0].0, "\"No Name\"", "{found:?}");
    let found = mistakes("[people.a]\nrights = [\"ask\"]\nscreen = \"robot\"\n");
    assert!(found[0].1.contains("is a screen, and has rights"), "{found:?}");
}
