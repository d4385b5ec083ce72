//! Tests of the whole crate: files, signing in, sessions and the log, and random input everywhere.

mod files;
mod log;
mod random_input;
mod signing_in;

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::time::{Duration, SystemTime};

use tempfile::TempDir;

use crate::{
    Accounts, PasswordCost, PeopleFile, PersonName, PersonRecord, PersonRight, StoredPassword,
    StoredToken,
};

/// Password of every person in these tests.
const PASSWORD: &str = "correct horse battery";

/// Address of the caretaker.
const HOME: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 2));

/// Address of a guesser.
const AWAY: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 168, 1, 66));

fn start() -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs(1_795_900_000)
}

fn name(text: &str) -> PersonName {
    PersonName::new(text).expect("a name")
}

fn hashed(password: &str) -> StoredPassword {
    StoredPassword::hash(password, PasswordCost::FOR_TESTS).expect("memory")
}

fn record(of: &str, rights: &[PersonRight]) -> PersonRecord {
    PersonRecord {
        name: name(of),
        rights: rights.iter().copied().collect::<BTreeSet<_>>(),
        password: Some(hashed(PASSWORD)),
        tokens: Vec::new(),
        screen: None,
    }
}

/// A folder with a file of people.
struct PeopleFolder {
    folder: TempDir,
    file: PeopleFile,
}

impl PeopleFolder {
    fn new() -> PeopleFolder {
        let folder = tempfile::tempdir().expect("a folder");
        let file = PeopleFile::new(folder.path().join("people.toml"));
        PeopleFolder { folder, file }
    }

    fn with(people: &[&str]) -> PeopleFolder {
        let folder = PeopleFolder::new();
        people.iter().for_each(|of| folder.add(record(of, &[PersonRight::Look])));
        folder
    }

    fn add(&self, record: PersonRecord) {
        self.file.change(|people| people.add(record)).expect("a change");
    }

    /// Gives a person a token, and returns it.
    fn token(&self, of: &str, token: &str) -> String {
        let (text, stored) = StoredToken::make(name(token), start()).expect("random");
        self.file.change(|people| people.add_token(of, stored)).expect("a change");
        text
    }

    fn accounts(&self) -> Accounts {
        Accounts::open_with(self.file.path().to_owned(), PasswordCost::FOR_TESTS).expect("a file")
    }
}
