//! Checks of the words of an ecosystem: their keys, and their symbols and arguments against a domain.
//! Mistakes within a phrase are found when it is read ([`crate::pattern`]).

use std::collections::BTreeMap;

use pddl::{Diagnostic, Domain, Name, Span};
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

use crate::pattern::Pattern;
use crate::words_file::OwnWords;

/// The tables of the words of a language, each with the keys of its entries.
const TABLES: [(&str, &[&str]); 3] = [
    ("predicates", &["phrase", "negated", "also"]),
    ("functions", &["phrase", "unit", "units", "also"]),
    ("types", &["every", "some", "all"]),
];

/// A mistake in the words of an ecosystem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WordsMistake {
    /// The keys on the way to the mistake, within the words of a language: `predicates`, `lit`,
    /// `phrase`.
    pub path: Vec<String>,
    /// The mistake, as a sentence without a period.
    pub message: String,
    /// What would be right; `None` if the message says it.
    pub help: Option<String>,
    /// Whether the words cannot be used; otherwise an agent may bring what they are about.
    pub is_error: bool,
}

/// The keys of a table, and those of the tables in it.
#[derive(Deserialize)]
#[serde(untagged)]
enum KeyTree {
    Table(BTreeMap<String, KeyTree>),
    Other(IgnoredAny),
}

/// What a symbol is in a domain.
enum Declared {
    Predicate(usize),
    Function(usize),
}

// === impl WordsMistake ===

impl WordsMistake {
    fn new(path: &[&str], message: String, help: Option<String>, is_error: bool) -> WordsMistake {
        let path = path.iter().map(|&key| key.to_owned()).collect();
        WordsMistake { path, message, help, is_error }
    }

    /// Returns the mistake as a diagnostic at `span`.
    pub fn diagnostic(&self, span: Span) -> Diagnostic {
        let found = match self.is_error {
            true => Diagnostic::error(span, self.message.clone()),
            false => Diagnostic::warning(span, self.message.clone()),
        };
        match &self.help {
            Some(help) => found.with_help(help.clone()),
            None => found,
        }
    }
}

/// Returns the keys in the words of a language, as they stand in a file, that have no meaning.
pub fn key_mistakes<'de>(words: impl Deserializer<'de>) -> Vec<WordsMistake> {
    let mut found = Vec::new();
    // Other values than tables are reported when the words are read.
    let Ok(KeyTree::Table(tables)) = KeyTree::deserialize(words) else { return found };
    for (table, entries) in &tables {
        let Some((_, known)) = TABLES.iter().find(|(known, _)| known == table) else {
            found.push(unknown_key(&[table], &TABLES.map(|(known, _)| known)));
            continue;
        };
        let KeyTree::Table(entries) = entries else { continue };
        for (symbol, words) in entries {
            let KeyTree::Table(words) = words else { continue };
            let unknown = words.keys().filter(|key| !known.contains(&key.as_str()));
            found.extend(unknown.map(|key| unknown_key(&[table, symbol, key], known)));
        }
    }
    found
}

fn unknown_key(path: &[&str], known: &[&str]) -> WordsMistake {
    let key = path.last().copied().unwrap_or_default();
    let help = match pddl::nearest(key, known.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("known are {}", known.join(", ")),
    };
    WordsMistake::new(path, format!("unknown key `{key}`"), Some(help), true)
}

// === impl OwnWords ===

impl OwnWords {
    /// Returns the words of predicates, functions and types that a domain does not declare, and the
    /// phrases that do not have one place for each argument.
    pub fn mistakes(&self, domain: &Domain) -> Vec<WordsMistake> {
        let mut found = Vec::new();
        for (symbol, words) in &self.predicates {
            let path = ["predicates", symbol.as_str()];
            let arity = match declared(domain, symbol) {
                Some(Declared::Predicate(arity)) => arity,
                Some(Declared::Function(_)) => {
                    found.push(wrong_table(path, "function", "functions"));
                    continue;
                }
                None => {
                    let known = domain.predicates.iter().map(|one| one.name.as_str());
                    found.push(undeclared(path, "predicate", known));
                    continue;
                }
            };
            let said = [("phrase", Some(&words.phrase)), ("negated", words.negated.as_ref())];
            let said = said.into_iter().filter_map(|(key, text)| Some((key, text?)));
            let all = said.chain(words.also.iter().map(|text| ("also", text)));
            found.extend(all.filter_map(|(key, text)| wrong_places(path, key, text, arity)));
        }
        for (symbol, words) in &self.functions {
            let path = ["functions", symbol.as_str()];
            let arity = match declared(domain, symbol) {
                Some(Declared::Function(arity)) => arity,
                Some(Declared::Predicate(_)) => {
                    found.push(wrong_table(path, "predicate", "predicates"));
                    continue;
                }
                None => {
                    let known = domain.functions.iter().map(|one| one.name.as_str());
                    found.push(undeclared(path, "function", known));
                    continue;
                }
            };
            let all = std::iter::once(("phrase", &words.phrase));
            let all = all.chain(words.also.iter().map(|text| ("also", text)));
            found.extend(all.filter_map(|(key, text)| wrong_places(path, key, text, arity)));
        }
        let types = pddl::Types::of(domain);
        for ty in self.types.keys().filter(|ty| !types.contains(Name::new(ty).as_str())) {
            let known = types.iter().map(Name::as_str);
            found.push(undeclared(["types", ty.as_str()], "type", known));
        }
        found
    }
}

fn declared(domain: &Domain, symbol: &str) -> Option<Declared> {
    let name = Name::new(symbol);
    let predicate = domain.predicates.iter().find(|one| one.name == name);
    let predicate = predicate.map(|one| Declared::Predicate(one.parameters.len()));
    let function = || domain.functions.iter().find(|one| one.name == name);
    predicate.or_else(|| function().map(|one| Declared::Function(one.parameters.len())))
}

fn wrong_table(path: [&str; 2], what: &str, table: &str) -> WordsMistake {
    let message = format!("`{}` is a {what}; its words stand under `{table}`", path[1]);
    WordsMistake::new(&path, message, None, true)
}

fn undeclared<'n>(
    path: [&str; 2],
    what: &str,
    known: impl Iterator<Item = &'n str>,
) -> WordsMistake {
    let help = match pddl::nearest(path[1], known) {
        Some(near) => format!("did you mean `{near}`?"),
        None => {
            "neither the ontology nor an agent of this file declares it; the words wait for an \
                 agent that does"
                .to_owned()
        }
    };
    let message = format!("no {what} is named `{}`", path[1]);
    WordsMistake::new(&path, message, Some(help), false)
}

/// Returns the mistake if a phrase does not have one place for each of `arity` arguments.
fn wrong_places(path: [&str; 2], key: &str, text: &str, arity: usize) -> Option<WordsMistake> {
    let [table, symbol] = path;
    // Places that are not numbered from 1, each once, are reported when the words are read.
    let places = Pattern::read(symbol, text).ok()?.arity;
    if places == arity {
        return None;
    }
    let of = |count: usize, what: &str| match count {
        0 => format!("no {what}"),
        1 => format!("1 {what}"),
        _ => format!("{count} {what}s"),
    };
    let (places, arguments) = (of(places, "place"), of(arity, "argument"));
    let message = format!("the phrase `{text}` has {places}, and `{symbol}` has {arguments}");
    let help = match arity {
        0 => "write the phrase without a place".to_owned(),
        1 => "write `{1}` once, where the argument stands".to_owned(),
        2 => "write `{1}` and `{2}` once each, where the arguments stand".to_owned(),
        _ => format!("write `{{1}}` to `{{{arity}}}` once each, where the arguments stand"),
    };
    Some(WordsMistake::new(&[table, symbol, key], message, Some(help), true))
}
