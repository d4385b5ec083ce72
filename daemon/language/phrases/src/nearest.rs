//! The nearest text: finds the phrase that a text most likely means, and corrects its words.

use pddl::{Name, Span};

use crate::not_understood::NotUnderstood;
use crate::pattern::PhrasePart;
use crate::phrasebook::{Phrase, PhraseKind};
use crate::reading::PhraseReader;
use crate::token::{Token, TokenKind};

/// Longest sentence that is compared with the phrases, in words. The cost grows with the length.
const WORDS_MAX: usize = 32;

/// Largest distance of a phrase that is suggested, as a share of its words.
const DISTANCE_MAX: f64 = 0.62;

/// Maximum number of phrases that are suggested.
const SUGGESTED_MAX: usize = 2;

/// Distance, beyond that of the nearest phrase, up to which another one is suggested, too.
const ALTERNATIVE: f64 = 0.08;

/// Distance between a phrase and a text for a word that one of them lacks.
const MISSING: f64 = 0.8;

/// The same for a word of at most three letters, such as `of`, which tells little.
const SHORT_MISSING: f64 = 0.3;

/// Distance for an object of a type that does not fit its place.
const MISFIT: f64 = 0.5;

/// Share of the letters of a word that may differ.
const LETTERS_MAX: f64 = 0.5;

/// One way to make a phrase of the words of a text.
#[derive(Clone, Debug, Default)]
struct Alignment {
    distance: f64,
    /// The words of the corrected sentence.
    words: Vec<String>,
    /// The position of the first word that differs; `None` if none does.
    differs_at: Option<usize>,
    is_negation: bool,
    /// Whether a word of the phrase itself stands in the text, and not only its arguments.
    shares_word: bool,
}

/// Returns the answer to the sentence that begins at `start`.
pub(crate) fn refuse(reader: &PhraseReader<'_>, start: usize) -> NotUnderstood {
    let end = sentence_end(reader, start);
    let Some(first) = reader.tokens.get(start) else {
        return NotUnderstood::new(Span::new(0, 0), "a condition is expected");
    };
    let said = reader.words(start, end);
    if first.kind != TokenKind::Word || end == start {
        let why = format!("`{}` begins no condition", first.text);
        return NotUnderstood::new(first.span(), why);
    }
    let mut found: Vec<Alignment> = match end - start > WORDS_MAX {
        true => Vec::new(),
        false => {
            let phrases = reader.book.phrases.iter();
            let is_known = |phrase: &&Phrase| reader.names.has_symbol(phrase.symbol.as_str());
            let known = phrases.filter(|phrase| phrase.is_said).filter(is_known);
            known.filter_map(|phrase| align_phrase(reader, phrase, start, end)).collect()
        }
    };
    found.sort_by(|one, other| {
        let shares = other.shares_word.cmp(&one.shares_word);
        shares.then(one.distance.total_cmp(&other.distance))
    });
    let is_near = |one: &&Alignment| one.shares_word && one.distance <= DISTANCE_MAX;
    let best = found.first().filter(is_near).cloned();
    let differs = best.as_ref().and_then(|best| best.differs_at).unwrap_or(start);
    let mut answer = match reader.tokens.get(differs).filter(|_| differs < end) {
        Some(token) => {
            NotUnderstood::new(token.span(), reason(reader, token, said, best.is_some()))
        }
        None => {
            let at = reader.tokens.get(end - 1).map_or(first.span(), Token::span);
            NotUnderstood::new(at, format!("`{said}` ends too early"))
        }
    };
    answer.is_near = best.is_some();
    let shared = found.first().filter(|best| best.shares_word);
    answer.distance = shared.map_or(f64::INFINITY, |best| best.distance);
    let limit = answer.distance + ALTERNATIVE;
    // Next to a phrase, its negation is near, too, and says the contrary.
    let may_negate = best.as_ref().is_some_and(|best| best.is_negation);
    let near = found.iter().filter(|one| is_near(one) && one.distance <= limit);
    let near = near.filter(|one| may_negate || !one.is_negation);
    for alignment in near {
        let text = whole_text(reader, start, end, &alignment.words.join(" "));
        if !answer.nearest.contains(&text) && answer.nearest.len() < SUGGESTED_MAX {
            answer.nearest.push(text);
        }
    }
    if answer.nearest.is_empty() {
        // Nothing is near: the first phrases at least show how a condition is written.
        answer.nearest.extend(found.first().map(|best| best.words.join(" ")));
    }
    answer
}

fn reason(reader: &PhraseReader<'_>, token: &Token<'_>, said: &str, is_near: bool) -> String {
    let is_new = reader.term(token).is_none();
    match is_near {
        true if is_new => format!("`{}` is not understood", token.text),
        true => format!("`{said}` is not understood"),
        false => format!("`{said}` is not understood"),
    }
}

/// Returns the text with the sentence `start..end` replaced.
fn whole_text(reader: &PhraseReader<'_>, start: usize, end: usize, sentence: &str) -> String {
    let from = reader.tokens.get(start).map_or(0, |token| token.start);
    let last = end.checked_sub(1).and_then(|last| reader.tokens.get(last));
    let to = last.map_or(reader.text.len(), |token| token.start + token.text.len());
    let before = reader.text.get(..from).unwrap_or_default().trim_start();
    let after = reader.text.get(to..).unwrap_or_default().trim_end();
    format!("{before}{sentence}{after}")
}

/// Returns the position after the sentence that begins at `start`.
fn sentence_end(reader: &PhraseReader<'_>, start: usize) -> usize {
    let is_inner = |at: usize| {
        reader.tokens.get(at).is_some_and(Token::is_word) && (at == start || !reader.may_end(at))
    };
    let mut end = start;
    while is_inner(end) {
        end += 1;
    }
    end
}

fn align_phrase(
    reader: &PhraseReader<'_>,
    phrase: &Phrase,
    start: usize,
    end: usize,
) -> Option<Alignment> {
    let comparison = (start + 1..end).find_map(|at| Some((at, reader.comparison_words(at)?.1)));
    let head_end = comparison.map_or(end, |(at, _)| at);
    let mut alignment = match (phrase.kind, comparison) {
        (PhraseKind::Function, _) | (_, None) => align(reader, phrase, start, head_end),
        // Only functions are compared.
        (_, Some(_)) => return None,
    };
    if phrase.kind == PhraseKind::Function {
        let tail = match comparison {
            Some((at, after)) => compared(reader, phrase, at, after, end),
            None => Alignment::of(MISSING, example(reader, phrase, None), Some(head_end)),
        };
        alignment = alignment.with(tail.distance, Some(tail.words.join(" ")), tail.differs_at);
    }
    // By the length of the text, so that of two phrases the one that lacks less is nearer.
    alignment.distance /= (head_end - start).max(1) as f64;
    alignment.is_negation = phrase.kind == PhraseKind::Negation;
    Some(alignment)
}

/// Corrects a comparison: its words begin at `at`, and a number is expected at `after`.
fn compared(
    reader: &PhraseReader<'_>,
    phrase: &Phrase,
    at: usize,
    after: usize,
    end: usize,
) -> Alignment {
    let comparison = reader.words(at, after);
    if reader.number(&phrase.symbol, after).is_some() {
        return Alignment::of(0.0, reader.words(at, end).to_owned(), None);
    }
    let number = reader.tokens.get(after).filter(|_| after < end).map(|token| {
        let is_inner = |c: char| c.is_ascii_digit() || "+-.,".contains(c);
        token.text.split_once(|c| !is_inner(c)).map_or(token.text, |(number, _)| number)
    });
    match number.filter(|number| number.contains(|c: char| c.is_ascii_digit())) {
        Some(number) => {
            let unit = reader.book.units(&phrase.symbol).first().map_or("", String::as_str);
            let words = format!("{comparison} {number} {unit}");
            let differs = if after + 1 < end { after + 1 } else { after };
            Alignment::of(SHORT_MISSING, words.trim_end().to_owned(), Some(differs))
        }
        None => {
            let words = example(reader, phrase, Some(comparison));
            Alignment::of(MISSING, words, Some(after))
        }
    }
}

/// Returns a comparison as an example, with the words `comparison` if they are given.
fn example(reader: &PhraseReader<'_>, phrase: &Phrase, comparison: Option<&str>) -> String {
    let known = reader.book.comparison(pddl::Comparison::GreaterOrEqual).first();
    let comparison = comparison.or(known.map(String::as_str)).unwrap_or_default();
    match reader.book.units(&phrase.symbol).first() {
        Some(unit) => format!("{comparison} 20 {unit}"),
        None => format!("{comparison} 20"),
    }
}

/// Aligns the parts of a phrase with the words `start..end` at the smallest distance.
fn align(reader: &PhraseReader<'_>, phrase: &Phrase, start: usize, end: usize) -> Alignment {
    let parts = &phrase.pattern.parts;
    // `row[at]` is the best alignment of the parts so far with the first words up to `start + at`.
    let length = end - start;
    let mut row: Vec<Alignment> = Vec::with_capacity(length + 1);
    row.push(Alignment::default());
    for at in 0..length {
        let extra = row[at].with(missing(reader.tokens[start + at].text), None, Some(start + at));
        row.push(extra);
    }
    for part in parts {
        let lacking = |from: &Alignment, at: usize| {
            let (distance, word) = lacking_part(reader, phrase, part);
            from.with(distance, Some(word), Some(start + at))
        };
        let mut next: Vec<Alignment> = vec![lacking(&row[0], 0)];
        for at in 1..=length {
            let token = &reader.tokens[start + at - 1];
            let mut best = lacking(&row[at], at);
            let extra = next[at - 1].with(missing(token.text), None, Some(start + at - 1));
            let mut others = vec![extra];
            others.extend(taken(reader, phrase, part, start, at, &row));
            for other in others {
                if other.distance < best.distance {
                    best = other;
                }
            }
            next.push(best);
        }
        row = next;
    }
    row.pop().unwrap_or_default()
}

/// Returns the alignments in which a part stands for the last words before `start + at`.
fn taken(
    reader: &PhraseReader<'_>,
    phrase: &Phrase,
    part: &PhrasePart,
    start: usize,
    at: usize,
    row: &[Alignment],
) -> Option<Alignment> {
    let position = start + at - 1;
    let token = &reader.tokens[position];
    match part {
        PhrasePart::Word { said, lower } => {
            let distance = letters(&token.lower, lower);
            let differs = (distance > 0.0).then_some(position);
            (distance <= LETTERS_MAX).then(|| {
                let taken = row[at - 1].with(distance, Some(said.clone()), differs);
                Alignment { shares_word: true, ..taken }
            })
        }
        PhrasePart::Place { index, case } => {
            for (from, before) in row.iter().enumerate().take(at) {
                let quantifiers = &reader.book.quantifiers;
                let Some(found) = quantifiers.read(&reader.tokens[start + from..]) else {
                    continue;
                };
                if start + from + found.length != start + at {
                    continue;
                }
                if reader.names.has_type(&found.ty) {
                    let words = reader.words(start + from, start + at).to_owned();
                    return Some(before.with(0.0, Some(words), None));
                }
                let known = reader.names.types();
                let near = pddl::nearest(found.ty.as_str(), known.iter().map(|ty| ty.as_str()))?;
                let distance = letters(found.ty.as_str(), near);
                let words = quantifiers.say(found.is_every, &Name::new(near), *case);
                return Some(before.with(distance, Some(words), Some(position)));
            }
            let fitting = || reader.names.fitting(phrase.symbol.as_str(), *index);
            if reader.term(token).is_some() {
                let fits = fitting().any(|name| name.as_str() == token.lower);
                let is_open = fitting().next().is_none();
                let distance = if fits || is_open { 0.0 } else { MISFIT };
                let differs = (distance > 0.0).then_some(position);
                return Some(row[at - 1].with(distance, Some(token.text.to_owned()), differs));
            }
            let fitting = fitting();
            let near = pddl::nearest(token.text, fitting.map(Name::spelled))?;
            let distance = letters(&token.lower, &near.to_lowercase());
            Some(row[at - 1].with(distance, Some(near.to_owned()), Some(position)))
        }
    }
}

/// Returns the distance for a part that the text lacks, and the word that is put in its place.
fn lacking_part(reader: &PhraseReader<'_>, phrase: &Phrase, part: &PhrasePart) -> (f64, String) {
    match part {
        PhrasePart::Word { said, .. } => (missing(said), said.clone()),
        PhrasePart::Place { index, .. } => {
            let mut fitting = reader.names.fitting(phrase.symbol.as_str(), *index);
            let object = fitting.next().map_or("…", Name::spelled);
            (MISSING, object.to_owned())
        }
    }
}

fn missing(word: &str) -> f64 {
    if word.chars().count() <= 3 { SHORT_MISSING } else { MISSING }
}

/// Returns the share of the letters by which two words differ.
fn letters(one: &str, other: &str) -> f64 {
    if one == other { 0.0 } else { 1.0 - strsim::normalized_damerau_levenshtein(one, other) }
}

// === impl Alignment ===

impl Alignment {
    fn of(distance: f64, words: String, differs_at: Option<usize>) -> Alignment {
        Alignment { distance, words: vec![words], differs_at, ..Alignment::default() }
    }

    fn with(&self, distance: f64, word: Option<String>, differs: Option<usize>) -> Alignment {
        let mut next = self.clone();
        next.distance += distance;
        next.words.extend(word);
        next.differs_at = next.differs_at.or(differs);
        next
    }
}
