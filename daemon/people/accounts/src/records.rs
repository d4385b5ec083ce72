//! People as a file lists them: each with rights, the hash of a password, and tokens of programs.

use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

use time::OffsetDateTime;

use crate::error::AccountsError;
use crate::password::StoredPassword;
use crate::person_name::PersonName;
use crate::right::{Person, PersonRight};
use crate::secret::{SecretDigest, random_secret};

/// Maximum number of people in a file. A building has tens, a campus hundreds.
pub const PEOPLE_MAX: usize = 1_000;

/// Maximum number of tokens of one person.
pub const TOKENS_MAX: usize = 32;

/// Maximum length of the name of an agent, in bytes.
const AGENT_BYTES_MAX: usize = 64;

/// The beginning of every token, by which people and scanners of leaked secrets recognise one.
const TOKEN_PREFIX: &str = "althing_";

/// A person in a file of people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PersonRecord {
    /// Name of the person.
    pub name: PersonName,
    /// Rights of the person.
    pub rights: BTreeSet<PersonRight>,
    /// Hash of the password; `None` for a person that signs in with tokens only.
    pub password: Option<StoredPassword>,
    /// Tokens of the programs that act for the person.
    pub tokens: Vec<StoredToken>,
    /// The agent on which the screen is, if this is no person, but the screen of an agent.
    pub screen: Option<String>,
}

/// A token of a program, as a file keeps it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredToken {
    /// Name of the token, by which it is removed.
    pub name: PersonName,
    /// Digest of the token.
    pub digest: SecretDigest,
    /// Day on which the token was made, such as `2026-11-28`; empty if a person has written the token
    /// without one.
    pub added: String,
}

/// All people of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PeopleRecords {
    people: BTreeMap<PersonName, PersonRecord>,
}

/// Whether a text has the form of an agent's name, which needs no escape in a file.
pub(crate) fn is_agent_name(text: &str) -> bool {
    let is_inner = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_');
    let begins = text.as_bytes().first().is_some_and(u8::is_ascii_lowercase);
    begins && text.len() <= AGENT_BYTES_MAX && text.bytes().all(is_inner)
}

// === impl PersonRecord ===

impl PersonRecord {
    /// Returns the person without secrets.
    pub fn person(&self) -> Person {
        let (name, rights) = (self.name.clone(), self.rights.clone());
        Person { name, rights, screen: self.screen.clone() }
    }

    /// Returns the screen of an agent, which has this token and no rights.
    pub fn screen(name: PersonName, agent: &str, token: StoredToken) -> PersonRecord {
        let (rights, tokens) = (BTreeSet::new(), vec![token]);
        PersonRecord { name, rights, password: None, tokens, screen: Some(agent.to_owned()) }
    }
}

// === impl StoredToken ===

impl StoredToken {
    /// Makes a new token. Returns its text, which is shown once, and what is kept of it.
    ///
    /// # Errors
    ///
    /// Returns an error if the system gives no random bytes.
    pub fn make(name: PersonName, now: SystemTime) -> Result<(String, StoredToken), AccountsError> {
        let added = OffsetDateTime::from(now).date().to_string();
        let text = format!("{TOKEN_PREFIX}{}", random_secret()?);
        let digest = SecretDigest::of_bytes(text.as_bytes());
        Ok((text, StoredToken { name, digest, added }))
    }
}

// === impl PeopleRecords ===

impl PeopleRecords {
    /// Returns the people, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = &PersonRecord> {
        self.people.values()
    }

    /// Returns the person with this name; `None` if there is none.
    pub fn get(&self, name: &str) -> Option<&PersonRecord> {
        self.people.get(name)
    }

    /// Returns the person with this name.
    ///
    /// # Errors
    ///
    /// Returns an error, which lists other names, if there is none.
    pub fn find(&self, name: &str) -> Result<&PersonRecord, AccountsError> {
        self.get(name).ok_or_else(|| self.unknown(name))
    }

    /// Returns the number of people.
    pub fn len(&self) -> usize {
        self.people.len()
    }

    /// Whether there are no people.
    pub fn is_empty(&self) -> bool {
        self.people.is_empty()
    }

    /// Returns the person that has the token with this digest.
    pub(crate) fn with_token(&self, digest: &SecretDigest) -> Option<&PersonRecord> {
        self.iter().find(|person| person.tokens.iter().any(|token| token.digest == *digest))
    }

    /// Adds a person.
    ///
    /// # Errors
    ///
    /// Returns an error if there is a person of the same name, or no room for another.
    pub fn add(&mut self, person: PersonRecord) -> Result<(), AccountsError> {
        if self.people.contains_key(&person.name) {
            return Err(AccountsError::Exists(person.name.to_string()));
        }
        if self.people.len() >= PEOPLE_MAX {
            return Err(AccountsError::TooMany {
                what: "the file is full of people",
                max: PEOPLE_MAX,
            });
        }
        self.people.insert(person.name.clone(), person);
        Ok(())
    }

    /// Removes a person, and returns it.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no person of this name.
    pub fn remove(&mut self, name: &str) -> Result<PersonRecord, AccountsError> {
        self.people.remove(name).ok_or_else(|| self.unknown(name))
    }

    /// Sets the password of a person; its sessions end.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no person of this name, or if it is a screen.
    pub fn set_password(
        &mut self,
        name: &str,
        password: StoredPassword,
    ) -> Result<(), AccountsError> {
        self.no_screen(name)?.password = Some(password);
        Ok(())
    }

    /// Sets the rights of a person.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no person of this name, or if it is a screen.
    pub fn set_rights(
        &mut self,
        name: &str,
        rights: BTreeSet<PersonRight>,
    ) -> Result<(), AccountsError> {
        self.no_screen(name)?.rights = rights;
        Ok(())
    }

    /// Adds a token to a person.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such person, if it is a screen, if it has a token of the same
    /// name, or if it has no room for another.
    pub fn add_token(&mut self, name: &str, token: StoredToken) -> Result<(), AccountsError> {
        let person = self.no_screen(name)?;
        if person.tokens.iter().any(|other| other.name == token.name) {
            return Err(AccountsError::TokenExists {
                person: name.to_owned(),
                token: token.name.to_string(),
            });
        }
        if person.tokens.len() >= TOKENS_MAX {
            return Err(AccountsError::TooMany {
                what: "the person has many tokens",
                max: TOKENS_MAX,
            });
        }
        person.tokens.push(token);
        Ok(())
    }

    /// Removes a token of a person.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no such person, or no such token.
    pub fn remove_token(&mut self, name: &str, token: &str) -> Result<(), AccountsError> {
        let person = self.get_mut(name)?;
        let Some(at) = person.tokens.iter().position(|known| known.name.as_str() == token) else {
            let known = person.tokens.iter().map(|known| known.name.to_string()).collect();
            let (person, token) = (name.to_owned(), token.to_owned());
            return Err(AccountsError::TokenUnknown { person, token, known });
        };
        person.tokens.remove(at);
        Ok(())
    }

    fn get_mut(&mut self, name: &str) -> Result<&mut PersonRecord, AccountsError> {
        if !self.people.contains_key(name) {
            return Err(self.unknown(name));
        }
        self.people.get_mut(name).ok_or_else(|| AccountsError::Exists(name.to_owned()))
    }

    /// Returns a person that is no screen.
    fn no_screen(&mut self, name: &str) -> Result<&mut PersonRecord, AccountsError> {
        let person = self.get_mut(name)?;
        match &person.screen {
            Some(agent) => {
                let (name, agent) = (name.to_owned(), agent.clone());
                Err(AccountsError::Screen { name, agent })
            }
            None => Ok(person),
        }
    }

    fn unknown(&self, name: &str) -> AccountsError {
        /// How many people an error lists.
        const LISTED_MAX: usize = 8;
        let shown: String = name.chars().filter(|c| !c.is_control()).take(64).collect();
        let known = self.people.keys().take(LISTED_MAX).map(PersonName::to_string).collect();
        AccountsError::Unknown { name: shown, known }
    }
}
