//! The nearest text: finds the phrase that a text most likely means, and corrects its words. Each text
//! is read before it is suggested, so that none is suggested that is not understood.

use std::cmp::Reverse;

use pddl::{Name, Span};

use crate::alignment::{AlignedSentence, Alignment};
use crate::not_understood::NotUnderstood;
use crate::numbers;
use crate::phrasebook::{Phrase, PhraseKind};
use crate::reading::{self, PhraseReader};
use crate::token::{Token, TokenKind};

/// Longest sentence that is compared with the phrases, in words. The cost grows with the length.
const WORDS_MAX: usize = 32;

/// Largest distance of a phrase that is suggested, as a share of its words.
const DISTANCE_MAX: f64 = 0.62;

/// Maximum number of phrases that are tried for a suggestion.
const TRIED_MAX: usize = 6;

/// Distance, beyond that of the nearest phrase, up to which another one is suggested, too.
const ALTERNATIVE: f64 = 0.08;

/// Returns the answer to the sentence that begins at `start`.
pub(crate) fn refuse(reader: &PhraseReader<'_>, start: usize) -> NotUnderstood {
    let Some(first) = reader.tokens.get(start) else { return reader.refuse_end() };
    if first.kind != TokenKind::Word || reader.may_end(start) {
        return reader.refuse_opener(start);
    }
    let end = sentence_end(reader, start);
    let said = reader.words(start, end);
    if !reader.may_suggest() {
        return NotUnderstood::new(first.span(), format!("`{said}` is not understood"));
    }
    if let Some(answer) = numbers::refuse(reader, start, end) {
        return answer;
    }
    let found = alignments(reader, start, end);
    let best = found.first().filter(|best| is_near(best));
    let mut answer = reason(reader, best, start, end);
    answer.is_near = best.is_some();
    suggest(reader, &found, start, end, &mut answer);
    if let Some(best) = best.filter(|best| answer.nearest.is_empty() && best.has_gap()) {
        answer.why = format!("{}; a name is missing: `{}`", answer.why, best.sentence());
    }
    answer
}

/// Returns the text if it is understood, or else with its other mistakes corrected, too; `None` if it
/// is not understood then either.
pub(crate) fn mended(reader: &PhraseReader<'_>, text: &str) -> Option<String> {
    let left = reader.corrections.checked_sub(1)?;
    match reading::read_correcting(reader.book, text, reader.names, left) {
        Ok(_) => Some(text.to_owned()),
        Err(wrong) => wrong.nearest.into_iter().next().filter(|_| wrong.is_near),
    }
}

fn is_near(alignment: &Alignment) -> bool {
    alignment.shares_word && alignment.distance <= DISTANCE_MAX
}

/// Returns the phrases with the words of the sentence `start..end`, the nearest one first. Of several
/// phrases that say the same, the nearest one is there.
fn alignments(reader: &PhraseReader<'_>, start: usize, end: usize) -> Vec<Alignment> {
    if end - start > WORDS_MAX {
        return Vec::new();
    }
    let sentence = AlignedSentence::new(reader, start, end);
    let phrases = reader.book.phrases.iter();
    let known = phrases.filter(|phrase| reader.names.has_symbol(phrase.symbol.as_str()));
    let aligned = known.filter_map(|phrase| Some((phrase, sentence.align_phrase(phrase)?)));
    let mut found: Vec<(&Phrase, Alignment)> = aligned.collect();
    found.sort_by(|(_, one), (_, other)| {
        let shares = Reverse(one.shares_word).cmp(&Reverse(other.shares_word));
        shares.then(one.distance.total_cmp(&other.distance))
    });
    let mut known: Vec<(&Name, PhraseKind)> = Vec::new();
    found.retain(|(phrase, _)| {
        let meaning = (&phrase.symbol, phrase.kind);
        let is_new = !known.contains(&meaning);
        known.push(meaning);
        is_new
    });
    found.into_iter().map(|(_, alignment)| alignment).collect()
}

/// Returns the answer with the place and the reason.
fn reason(
    reader: &PhraseReader<'_>,
    best: Option<&Alignment>,
    start: usize,
    end: usize,
) -> NotUnderstood {
    let said = reader.words(start, end);
    let differs = best.and_then(|best| best.differs_at).unwrap_or(start);
    let Some(token) = reader.tokens.get(differs).filter(|_| differs < end) else {
        let at = end.checked_sub(1).and_then(|last| reader.tokens.get(last));
        let at = at.map_or(Span::new(0, 0), Token::span);
        return NotUnderstood::new(at, format!("`{said}` ends too early"));
    };
    let is_word = best.is_some_and(|best| !best.is_of_known_words) && reader.term(token).is_none();
    let what = if is_word { token.text } else { said };
    NotUnderstood::new(token.span(), format!("`{what}` is not understood"))
}

/// Adds the nearest texts that are understood to an answer.
fn suggest(
    reader: &PhraseReader<'_>,
    found: &[Alignment],
    start: usize,
    end: usize,
    answer: &mut NotUnderstood,
) {
    let Some(first) = found.first() else { return };
    let limit = first.distance + ALTERNATIVE;
    let near = found.iter().filter(|one| is_near(one) && one.distance <= limit);
    // Next to a phrase, its negation is near, too, and says the contrary.
    let near = near.filter(|one| first.is_negation || !one.is_negation);
    for alignment in near.filter(|one| !one.has_gap()).take(TRIED_MAX) {
        let text = corrected(reader, start, end, alignment);
        answer.nearest.extend(text.filter(|text| !answer.nearest.contains(text)));
        if answer.nearest.len() >= reader.suggested_max() {
            return;
        }
    }
    if answer.nearest.is_empty() && !answer.is_near {
        let mut far = found.iter().filter(|one| !one.has_gap());
        let shared = far.clone().filter(|one| one.shares_word).take(TRIED_MAX);
        answer
            .nearest
            .extend(shared.into_iter().find_map(|one| corrected(reader, start, end, one)));
        // An example at least shows how a condition is written. It is about an object that exists.
        if answer.nearest.is_empty()
            && !reader.names.is_open()
            && let Some(example) = far.find(|one| one.is_plain)
        {
            let example = example.sentence();
            answer.why = format!("{}; a condition is written as in `{example}`", answer.why);
        }
    }
}

/// Returns the text with the sentence `start..end` corrected. If other parts of the text cannot be
/// corrected, returns the sentence alone; `None` if it is not understood.
fn corrected(
    reader: &PhraseReader<'_>,
    start: usize,
    end: usize,
    alignment: &Alignment,
) -> Option<String> {
    let sentence = alignment.sentence();
    let from = reader.tokens.get(start).map_or(0, |token| token.start);
    let last = end.checked_sub(1).and_then(|last| reader.tokens.get(last));
    let to = last.map_or(reader.text.len(), |token| token.start + token.text.len());
    let whole = mended(reader, &reader.replaced(from, to, &sentence));
    let alone = || {
        let read = reading::read_correcting(reader.book, &sentence, reader.names, 0);
        read.ok().filter(|_| reader.is_first_correction() && reader.scope.is_empty())?;
        Some(sentence)
    };
    whole.or_else(alone)
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
