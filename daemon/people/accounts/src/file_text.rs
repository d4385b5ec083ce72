//! The text of a file of people: reads it, with all mistakes at their places, and writes it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::ops::Range;

use pddl::{Diagnostic, Span};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::password::StoredPassword;
use crate::person_name::PersonName;
use crate::records::{
    PEOPLE_MAX, PeopleRecords, PersonRecord, StoredToken, TOKENS_MAX, is_agent_name,
};
use crate::right::PersonRight;
use crate::secret::SecretDigest;

/// The first lines of a written file.
const HEAD: &str = "\
# People of this ecosystem, and their rights. Written by `althing people`, which keeps no comments.
# Passwords and tokens are stored as hashes. Keep the file readable for the daemon's user only.
";

/// Maximum number of mistakes that are reported. A file with more of them has another format.
const MISTAKES_MAX: usize = 50;

/// The keys whose values are no secrets.
const SHOWN_KEYS: [&str; 5] = ["rights", "name", "added", "file", "screen"];

/// The result of reading the text of a file of people.
#[derive(Clone, Debug, Default)]
pub struct PeopleText {
    /// People that could be read.
    pub records: PeopleRecords,
    /// Mistakes in the text, sorted by place.
    pub mistakes: Vec<Diagnostic>,
    /// Place of each name that could be read.
    pub places: BTreeMap<PersonName, Span>,
    /// Place of the value of `screen`, for each screen.
    pub screen_places: BTreeMap<PersonName, Span>,
}

/// Collects what can be read, and the mistakes.
#[derive(Default)]
struct PeopleReader {
    read: PeopleText,
    /// Digests of all tokens, to find one that stands twice.
    digests: BTreeSet<SecretDigest>,
}

/// Reads the text of a file of people. Reading continues after a mistake, so that all are reported.
pub fn read_people(text: &str) -> PeopleText {
    let mut reader = PeopleReader::default();
    let (tree, failures) = DeTable::parse_recoverable(text);
    for failure in failures.iter().take(MISTAKES_MAX) {
        let message = format!("not TOML: {}", failure.message());
        reader.error(failure.span().unwrap_or(0..0), message, None);
    }
    reader.top(tree.get_ref());
    let mut read = reader.read;
    read.mistakes.sort_by_key(|mistake| (mistake.span.start, mistake.span.end));
    read.mistakes.truncate(MISTAKES_MAX);
    read
}

/// Returns a text of a file of people without passwords and hashes, with its length and lines
/// unchanged, so that a place in it can be shown.
///
/// Only headers and the values of a few harmless keys stay: the key of a password may be misspelled, and a
/// password may stand in a comment.
pub fn without_secrets(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for line in text.split_inclusive('\n') {
        let code = line.split_once('#').map_or(line, |(code, _)| code);
        let key = code.split_once('=').map(|(key, _)| key);
        let clear = match key {
            Some(key) if SHOWN_KEYS.contains(&key.trim()) => code.len(),
            Some(key) => key.len(),
            None if code.trim_start().starts_with('[') => code.len(),
            None => 0,
        };
        let (clear, hidden) = line.split_at(clear);
        shown.push_str(clear);
        for c in hidden.chars() {
            match c {
                ' ' | '=' | '\n' | '\r' => shown.push(c),
                c => shown.extend(std::iter::repeat_n('*', c.len_utf8())),
            }
        }
    }
    shown
}

/// Returns the text of a file with these people.
pub(crate) fn write_people(records: &PeopleRecords) -> String {
    let mut text = HEAD.to_owned();
    for PersonRecord { name, rights, password, tokens, screen } in records.iter() {
        let rights: Vec<_> = rights.iter().map(|right| format!("\"{right}\"")).collect();
        // None of these texts needs an escape: names, words, PHC strings, digits and dates.
        let _ = write!(text, "\n[people.{name}]\nrights = [{}]\n", rights.join(", "));
        if let Some(agent) = screen {
            let _ = writeln!(text, "screen = \"{agent}\"");
        }
        if let Some(password) = password {
            let _ = writeln!(text, "password = \"{}\"", password.as_str());
        }
        for StoredToken { name: token, digest, added } in tokens {
            let _ = writeln!(text, "\n[[people.{name}.token]]\nname = \"{token}\"");
            let _ = writeln!(text, "hash = \"{digest}\"");
            if !added.is_empty() {
                let _ = writeln!(text, "added = \"{added}\"");
            }
        }
    }
    text
}

// === impl PeopleReader ===

impl PeopleReader {
    fn error(&mut self, at: Range<usize>, message: impl Into<String>, help: Option<String>) {
        let found = Diagnostic::error(Span::new(at.start, at.end), message);
        self.read.mistakes.push(match help {
            Some(help) => found.with_help(help),
            None => found,
        });
    }

    fn top(&mut self, table: &DeTable<'_>) {
        for (key, value) in table {
            match (key.get_ref().as_ref(), value.get_ref()) {
                ("people", DeValue::Table(people)) => self.people(people),
                ("people", _) => {
                    self.error(value.span(), "`people` must be a table", help("[people.anna]"));
                }
                (other, _) => self.unknown_key(key.span(), "", other, &["people"]),
            }
        }
    }

    fn people(&mut self, people: &DeTable<'_>) {
        for (key, value) in people {
            let name = match PersonName::new(key.get_ref()) {
                Ok(name) => name,
                Err(error) => {
                    self.error(key.span(), error.to_string(), None);
                    continue;
                }
            };
            let DeValue::Table(entry) = value.get_ref() else {
                self.error(
                    value.span(),
                    format!("`people.{name}` must be a table"),
                    help(&format!("[people.{name}]")),
                );
                continue;
            };
            let record = self.person(&name, key.span(), entry);
            let at = key.span();
            self.read.places.insert(name, Span::new(at.start, at.end));
            if self.read.records.add(record).is_err() {
                let message = format!("a file has at most {PEOPLE_MAX} people");
                return self.error(key.span(), message, None);
            }
        }
    }

    fn person(&mut self, name: &PersonName, at: Range<usize>, entry: &DeTable<'_>) -> PersonRecord {
        const KEYS: [&str; 4] = ["rights", "password", "token", "screen"];
        let mut rights = None;
        let mut record = PersonRecord {
            name: name.clone(),
            rights: BTreeSet::new(),
            password: None,
            tokens: Vec::new(),
            screen: None,
        };
        for (key, value) in entry {
            match key.get_ref().as_ref() {
                "rights" => rights = Some(self.rights(value)),
                "password" => record.password = self.password(name, value),
                "token" => record.tokens = self.tokens(name, value),
                "screen" => {
                    let at = Span::new(value.span().start, value.span().end);
                    self.read.screen_places.insert(name.clone(), at);
                    record.screen = self.screen(value);
                }
                other => self.unknown_key(key.span(), &format!("people.{name}"), other, &KEYS),
            }
        }
        if rights.is_none() {
            let message = format!("`people.{name}` has no rights");
            self.error(at.clone(), message, help("rights = [\"look\", \"ask\"]"));
        }
        record.rights = rights.unwrap_or_default();
        if record.screen.is_some() && (!record.rights.is_empty() || record.password.is_some()) {
            let message = format!("`people.{name}` is a screen, and has rights or a password");
            let only = "a screen may look at its agent, answer for it and stop it: write `rights = []`, \
                        and no password";
            self.error(at, message, Some(only.to_owned()));
        }
        record
    }

    fn screen(&mut self, value: &Spanned<DeValue<'_>>) -> Option<String> {
        match value.get_ref() {
            DeValue::String(agent) if is_agent_name(agent) => Some(agent.to_string()),
            _ => {
                let message = "`screen` must be the name of the agent on which the screen is";
                self.error(value.span(), message, help("screen = \"turtlebot-1\""));
                None
            }
        }
    }

    fn rights(&mut self, value: &Spanned<DeValue<'_>>) -> BTreeSet<PersonRight> {
        let mut rights = BTreeSet::new();
        let DeValue::Array(list) = value.get_ref() else {
            let message = "`rights` must be a list of words in quotes";
            self.error(value.span(), message, help("rights = [\"look\", \"ask\"]"));
            return rights;
        };
        for element in list.iter() {
            let DeValue::String(word) = element.get_ref() else {
                self.error(element.span(), "a right is a word in quotes", None);
                continue;
            };
            match PersonRight::parse(word) {
                Some(right) if rights.insert(right) => (),
                Some(right) => {
                    self.error(element.span(), format!("`{right}` stands here twice"), None);
                }
                None => {
                    let words = PersonRight::ALL.map(PersonRight::as_str);
                    let help = match pddl::nearest(word, words) {
                        Some(near) => format!("did you mean \"{near}\"?"),
                        None => format!("rights are {}", words.join(", ")),
                    };
                    self.error(element.span(), "there is no such right", Some(help));
                }
            }
        }
        rights
    }

    fn password(
        &mut self,
        name: &PersonName,
        value: &Spanned<DeValue<'_>>,
    ) -> Option<StoredPassword> {
        let make = || Some(format!("store a new one: althing people password {name}"));
        let DeValue::String(text) = value.get_ref() else {
            self.error(value.span(), "`password` must be the hash of one, in quotes", make());
            return None;
        };
        match StoredPassword::parse(text) {
            Ok(password) => {
                if password.is_weak() {
                    let at = value.span();
                    let message = "the hash of this password is cheaper to guess than a new one";
                    let found = Diagnostic::warning(Span::new(at.start, at.end), message);
                    self.read.mistakes.push(found.with_help(make().unwrap_or_default()));
                }
                Some(password)
            }
            Err(problem) => {
                let message = format!("`password` must be an argon2id hash: {problem}");
                self.error(value.span(), message, make());
                None
            }
        }
    }

    fn tokens(&mut self, person: &PersonName, value: &Spanned<DeValue<'_>>) -> Vec<StoredToken> {
        let mut tokens: Vec<StoredToken> = Vec::new();
        let DeValue::Array(list) = value.get_ref() else {
            let form = format!("[[people.{person}.token]]");
            self.error(value.span(), "`token` must be a list of tables", help(&form));
            return tokens;
        };
        for element in list.iter() {
            let DeValue::Table(entry) = element.get_ref() else {
                self.error(element.span(), "a token is a table with name, hash and added", None);
                continue;
            };
            let Some(token) = self.token(element.span(), entry) else { continue };
            if tokens.iter().any(|other| other.name == token.name) {
                let message = format!("`{person}` has two tokens called `{}`", token.name);
                self.error(element.span(), message, None);
            } else if !self.digests.insert(token.digest) {
                let message = format!("the token `{}` has the hash of another token", token.name);
                self.error(element.span(), message, None);
            } else if tokens.len() >= TOKENS_MAX {
                let message = format!("a person has at most {TOKENS_MAX} tokens");
                self.error(element.span(), message, None);
                break;
            } else {
                tokens.push(token);
            }
        }
        tokens
    }

    fn token(&mut self, at: Range<usize>, entry: &DeTable<'_>) -> Option<StoredToken> {
        const KEYS: [&str; 3] = ["name", "hash", "added"];
        let (mut name, mut digest, mut added) = (None, None, None);
        let before = self.read.mistakes.len();
        for (key, value) in entry {
            let word = key.get_ref().as_ref();
            let DeValue::String(text) = value.get_ref() else {
                match KEYS.contains(&word) {
                    true => self.error(value.span(), format!("`{word}` must be in quotes"), None),
                    false => self.unknown_key(key.span(), "token", word, &KEYS),
                }
                continue;
            };
            let wrong = match word {
                "name" => match PersonName::new(text) {
                    Ok(read) => {
                        name = Some(read);
                        continue;
                    }
                    Err(_) => "a token's name has the form of a person's: a-z, 0-9, - and _",
                },
                "hash" => {
                    digest = SecretDigest::parse(text);
                    if digest.is_some() {
                        continue;
                    }
                    "`hash` must be \"sha256:\" and 64 hexadecimal digits in lower case"
                }
                "added" if is_day(text) => {
                    added = Some(text.to_string());
                    continue;
                }
                "added" => "`added` must be a day, such as \"2026-11-28\"",
                other => {
                    self.unknown_key(key.span(), "token", other, &KEYS);
                    continue;
                }
            };
            self.error(value.span(), wrong, None);
        }
        if self.read.mistakes.len() == before && (name.is_none() || digest.is_none()) {
            self.error(at, "a token has a name and a hash", None);
        }
        Some(StoredToken { name: name?, digest: digest?, added: added.unwrap_or_default() })
    }

    fn unknown_key(&mut self, at: Range<usize>, within: &str, name: &str, known: &[&str]) {
        let help = match pddl::nearest(name, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("known are {}", known.join(", ")),
        };
        let within = match within {
            "" => String::new(),
            within => format!(" in `{within}`"),
        };
        let shown: String = name.chars().filter(|c| !c.is_control()).take(40).collect();
        self.error(at, format!("unknown key `{shown}`{within}"), Some(help));
    }
}

fn help(form: &str) -> Option<String> {
    Some(format!("write {form}"))
}

/// Whether a text has the form of a day: `2026-11-28`.
fn is_day(text: &str) -> bool {
    text.len() == 10
        && text.bytes().enumerate().all(|(at, byte)| match at {
            4 | 7 => byte == b'-',
            _ => byte.is_ascii_digit(),
        })
}
