//! Completion: the words that may follow a text that is not finished.

use std::collections::BTreeSet;

use pddl::Name;

use crate::known_names::KnownNames;
use crate::pattern::PhrasePart;
use crate::phrasebook::{COMPARISONS, Phrase, PhraseKind, Phrasebook};
use crate::reading::PhraseReader;
use crate::token::{Token, TokenKind, tokens};

/// Returns the offset of the word under the cursor, and the words that it can become.
pub(crate) fn complete(
    book: &Phrasebook,
    before: &str,
    names: &KnownNames,
) -> (usize, Vec<String>) {
    let start = before
        .rfind(char::is_whitespace)
        .map_or(0, |space| space + before[space..].chars().next().map_or(1, char::len_utf8));
    let (context, word) = before.split_at(start);
    let tokens = tokens(context);
    let reader = PhraseReader::new(book, names, context, tokens);
    let word = word.to_lowercase();
    let mut fitting = BTreeSet::new();
    for candidate in candidates(&reader) {
        // Only one word is completed at a time.
        let first = candidate.split_whitespace().next().unwrap_or_default();
        if first.to_lowercase().starts_with(&word) {
            fitting.insert(first.to_owned());
        }
    }
    (start, fitting.into_iter().collect())
}

fn candidates(reader: &PhraseReader<'_>) -> Vec<String> {
    let grammar = &reader.book.grammar;
    let first = |words: &[String]| words.first().cloned().unwrap_or_default();
    let start = sentence_start(reader);
    let mut words = Vec::new();
    if start == reader.tokens.len() {
        words.push(first(&grammar.not));
        if start == 0 || reader.tokens[start - 1].kind != TokenKind::Word {
            words.extend([first(&grammar.before_quantifier), first(&grammar.when)]);
        }
    }
    for phrase in &reader.book.phrases {
        if phrase.is_said && reader.names.has_symbol(phrase.symbol.as_str()) {
            after_phrase(reader, phrase, start, &mut words);
        }
    }
    words
}

/// Returns the position of the first word of the sentence that is not finished.
fn sentence_start(reader: &PhraseReader<'_>) -> usize {
    let grammar = &reader.book.grammar;
    let is_border = |at: usize| {
        let token = &reader.tokens[at];
        !token.is_word()
            || [&grammar.and, &grammar.or, &grammar.not, &grammar.when, &grammar.then]
                .iter()
                .any(|words| reader.is_word(at, words))
    };
    (0..reader.tokens.len()).rev().find(|at| is_border(*at)).map_or(0, |border| border + 1)
}

/// Appends the words that may follow if the sentence is that of `phrase`.
fn after_phrase(reader: &PhraseReader<'_>, phrase: &Phrase, start: usize, words: &mut Vec<String>) {
    let mut at = start;
    for part in &phrase.pattern.parts {
        let rest = &reader.tokens[at..];
        match (part, rest.first()) {
            (PhrasePart::Word { said, .. }, None) => return words.push(said.clone()),
            (PhrasePart::Word { lower, .. }, Some(token)) if token.lower == *lower => at += 1,
            (PhrasePart::Word { .. }, Some(_)) => return,
            (PhrasePart::Place { index, .. }, _) => match place(reader, phrase, *index, rest) {
                Ok(length) => at += length,
                Err(next) => return words.extend(next),
            },
        }
    }
    if at > reader.tokens.len() {
        return;
    }
    let grammar = &reader.book.grammar;
    let is_whole = at == reader.tokens.len();
    match phrase.kind {
        PhraseKind::Function if is_whole => {
            let said = COMPARISONS.iter().filter_map(|one| reader.book.comparison(*one).first());
            words.extend(said.cloned());
        }
        PhraseKind::Function => (),
        _ if is_whole => {
            words.extend(
                [&grammar.and, &grammar.or].into_iter().filter_map(|one| one.first()).cloned(),
            );
        }
        _ => (),
    }
}

/// Returns the number of words that stand at a place, or the words that may.
fn place(
    reader: &PhraseReader<'_>,
    phrase: &Phrase,
    index: usize,
    rest: &[Token<'_>],
) -> Result<usize, Vec<String>> {
    let quantifiers = &reader.book.quantifiers;
    if let Some(found) = quantifiers.read(rest) {
        return Ok(found.length);
    }
    let types: BTreeSet<Name> = match reader.names.types() {
        known if known.is_empty() => quantifiers.own_types().cloned().collect(),
        known => known.into_iter().cloned().collect(),
    };
    let forms = quantifiers.all_forms(types);
    let Some(token) = rest.first() else {
        let objects = reader.names.fitting(phrase.symbol.as_str(), index);
        let objects = objects.map(|name| name.spelled().to_owned());
        return Err(objects.chain(forms).collect());
    };
    if let [only] = rest
        && let next = begun(&forms, &only.lower)
        && !next.is_empty()
    {
        return Err(next);
    }
    if reader.term(token).is_some() { Ok(1) } else { Err(Vec::new()) }
}

/// Returns the second words of the forms that begin with `word`.
fn begun(forms: &[String], word: &str) -> Vec<String> {
    let rest = forms.iter().filter_map(|form| form.split_once(' '));
    let rest = rest.filter(|(first, _)| first.to_lowercase() == word);
    rest.map(|(_, rest)| rest.to_owned()).collect()
}
