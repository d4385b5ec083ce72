//! Likeness: how much a text resembles the texts of a language.

use std::collections::BTreeSet;

use crate::phrasebook::{COMPARISONS, Phrasebook};
use crate::token::{Token, letter_distance};

/// Share of the letters by which a word may differ from one of the language.
const LETTERS_MAX: f64 = 0.25;

/// How much a word with slips counts, because it may also be a word of another language.
const WITH_SLIPS: f64 = 0.25;

/// Number of letters up to which a word counts only if it is written correctly.
const SHORT: usize = 4;

/// Maximum number of words that are compared with those of the language.
const WORDS_MAX: usize = 64;

/// Returns the number of words of a text that are words of the language; a word with slips counts
/// less.
pub(crate) fn likeness(book: &Phrasebook, tokens: &[Token<'_>]) -> f64 {
    let known = vocabulary(book);
    let words = tokens.iter().filter(|token| token.is_word()).take(WORDS_MAX);
    words.map(|token| one_word(&known, &token.lower)).sum()
}

fn one_word(known: &BTreeSet<String>, word: &str) -> f64 {
    if known.contains(word) {
        return 1.0;
    }
    if word.chars().count() <= SHORT {
        return 0.0;
    }
    let nearest = known.iter().map(|known| letter_distance(word, known)).fold(1.0, f64::min);
    if nearest <= LETTERS_MAX { WITH_SLIPS * (1.0 - nearest) } else { 0.0 }
}

/// Returns all words of a language in lower case.
fn vocabulary(book: &Phrasebook) -> BTreeSet<String> {
    let grammar = &book.grammar;
    let lists = [
        &grammar.and,
        &grammar.or,
        &grammar.not,
        &grammar.when,
        &grammar.then,
        &grammar.before_quantifier,
    ];
    let mut known: BTreeSet<String> = lists.into_iter().flatten().cloned().collect();
    let mut note = |text: &str| known.extend(text.split_whitespace().map(str::to_lowercase));
    for comparison in COMPARISONS {
        book.comparison(comparison).iter().for_each(|words| note(words));
    }
    book.units.values().flatten().for_each(|unit| note(unit));
    book.quantifiers.all_words().for_each(&mut note);
    for phrase in &book.phrases {
        phrase.pattern.words().for_each(&mut note);
    }
    known
}
