//! Alignment: makes a phrase of the words of a sentence, at the smallest distance.

use std::collections::BTreeSet;

use pddl::Name;

use crate::pattern::PhrasePart;
use crate::phrasebook::{COMPARISONS, Phrase, PhraseKind};
use crate::quantifiers::QuantifierMatch;
use crate::reading::PhraseReader;
use crate::token::{Token, letter_distance};

/// Stands in a corrected sentence for the name of an object that the text lacks.
pub(crate) const GAP: &str = "…";

/// Distance between a phrase and a text for a word that one of them lacks.
const MISSING: f64 = 0.8;

/// The same for a word of at most three small letters, such as `of`, which tells little.
const SHORT_MISSING: f64 = 0.3;

/// Distance for an object of a type that does not fit its place.
const MISFIT: f64 = 0.5;

/// Distance for a word of a phrase at the place of an object, where any name may be an object.
const WORD_AS_OBJECT: f64 = 0.6;

/// Distance for words that stand in another order than those of the phrase.
const REORDERED: f64 = 0.25;

/// Distance for a quantifier in a wrong form, such as `all room`.
const WRONG_FORM: f64 = 0.1;

/// Distance for a phrase that is read and not said, so that of two equal ones the other is nearer.
const UNSAID: f64 = 0.02;

/// Share of the letters of a word that may differ.
const LETTERS_MAX: f64 = 0.4;

/// Share of the letters of a word that may differ if the words stand in another order.
const LETTERS_REORDERED_MAX: f64 = 0.34;

/// Share of the letters of a comparison that may differ.
const COMPARISON_LETTERS_MAX: f64 = 0.3;

/// Maximum number of words of a comparison with slips.
const COMPARISON_WORDS_MAX: usize = 3;

/// One way to make a phrase of the words of a text.
#[derive(Clone, Debug, Default)]
pub(crate) struct Alignment {
    pub(crate) distance: f64,
    /// The words of the corrected sentence.
    pub(crate) words: Vec<String>,
    /// The position of the first word that differs; `None` if none does.
    pub(crate) differs_at: Option<usize>,
    /// Whether each word is right, and only their order or form is wrong.
    pub(crate) is_of_known_words: bool,
    pub(crate) is_negation: bool,
    /// Whether the phrase is a predicate of one argument, such as an example has.
    pub(crate) is_plain: bool,
    /// Whether a word of the phrase itself stands in the text, and not only its arguments.
    pub(crate) shares_word: bool,
}

/// The sentence `start..end` of a text, with the quantifiers in it.
pub(crate) struct AlignedSentence<'s, 'r> {
    reader: &'s PhraseReader<'r>,
    start: usize,
    end: usize,
    quantifiers: Vec<SentenceQuantifier>,
    comparison: Option<SentenceComparison>,
    /// The words of all phrases in lower case.
    words: BTreeSet<&'s str>,
}

/// The words of a comparison in a sentence, correct or nearly so.
struct SentenceComparison {
    from: usize,
    to: usize,
    words: String,
    distance: f64,
}

/// A quantifier in a sentence, correct or nearly so.
struct SentenceQuantifier {
    from: usize,
    to: usize,
    found: QuantifierMatch,
    distance: f64,
    /// The first word that differs; `None` if the quantifier stays as it is.
    differs_at: Option<usize>,
    /// Whether the words are right, and only their form is wrong.
    is_form: bool,
}

// === impl AlignedSentence ===

impl<'s, 'r> AlignedSentence<'s, 'r> {
    pub(crate) fn new(
        reader: &'s PhraseReader<'r>,
        start: usize,
        end: usize,
    ) -> AlignedSentence<'s, 'r> {
        let quantifiers = (start..end).filter_map(|from| quantifier(reader, from, end)).collect();
        let words = reader.book.phrases.iter().flat_map(|phrase| phrase.pattern.words()).collect();
        AlignedSentence {
            reader,
            start,
            end,
            quantifiers,
            comparison: comparison(reader, start, end),
            words,
        }
    }

    /// Aligns a phrase with the sentence; `None` if the phrase is of another kind.
    pub(crate) fn align_phrase(&self, phrase: &Phrase) -> Option<Alignment> {
        let (start, end) = (self.start, self.end);
        let comparison = self.comparison.as_ref();
        let is_function = phrase.kind == PhraseKind::Function;
        let head_end = match comparison {
            Some(one) if !is_function && self.has_digit(one.to) => return None,
            Some(one) if is_function => one.from,
            // Without a number, a word such as `is` was perhaps only put in.
            _ => end,
        };
        let mut alignment = self.align(phrase, head_end);
        if let Some(free) = self.align_freely(phrase, head_end)
            && free.distance < alignment.distance
        {
            alignment = free;
        }
        if is_function {
            let tail = match comparison {
                Some(one) => self.compared(phrase, one),
                None => Alignment::of(MISSING, self.example(phrase, None), Some(head_end)),
            };
            alignment = alignment.with(tail.distance, Some(tail.words.join(" ")), tail.differs_at);
        }
        if !phrase.is_said {
            alignment.distance += UNSAID;
        }
        // By the length of the text, so that of two phrases the one that lacks less is nearer.
        alignment.distance /= (head_end - start).max(1) as f64;
        alignment.is_negation = phrase.kind == PhraseKind::Negation;
        alignment.is_plain = phrase.kind == PhraseKind::Predicate && phrase.pattern.arity == 1;
        Some(alignment)
    }

    fn has_digit(&self, at: usize) -> bool {
        at < self.end && has_digit(self.reader, at)
    }

    /// Corrects a comparison, after which a number is expected.
    fn compared(&self, phrase: &Phrase, one: &SentenceComparison) -> Alignment {
        let (reader, end, after) = (self.reader, self.end, one.to);
        let comparison = one.words.as_str();
        if reader.number(&phrase.symbol, after).is_some() {
            let words = format!("{comparison} {}", reader.words(after, end));
            return Alignment::of(one.distance, words, (one.distance > 0.0).then_some(one.from));
        }
        let number = reader.tokens.get(after).filter(|_| after < end).map(|token| {
            let is_inner = |c: char| c.is_ascii_digit() || "+-−.,".contains(c);
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
                let words = self.example(phrase, Some(comparison));
                Alignment::of(MISSING, words, Some(after))
            }
        }
    }

    /// Returns a comparison as an example, with the words `comparison` if they are given.
    fn example(&self, phrase: &Phrase, comparison: Option<&str>) -> String {
        let book = self.reader.book;
        let known = book.comparison(pddl::Comparison::GreaterOrEqual).first();
        let comparison = comparison.or(known.map(String::as_str)).unwrap_or_default();
        match book.units(&phrase.symbol).first() {
            Some(unit) => format!("{comparison} 20 {unit}"),
            None => format!("{comparison} 20"),
        }
    }

    // === in the order of the text ===

    /// Aligns the parts of a phrase with the words up to `end` at the smallest distance.
    fn align(&self, phrase: &Phrase, end: usize) -> Alignment {
        let (start, tokens) = (self.start, &self.reader.tokens);
        // `row[at]` is the best alignment of the parts so far with the first words up to
        // `start + at`.
        let length = end - start;
        let mut row: Vec<Alignment> = Vec::with_capacity(length + 1);
        row.push(Alignment::default());
        for at in 0..length {
            let extra = row[at].with(missing(tokens[start + at].text), None, Some(start + at));
            row.push(extra);
        }
        for part in &phrase.pattern.parts {
            let lacking = |from: &Alignment, at: usize| {
                let (distance, word) = self.lacking_part(phrase, part);
                from.with(distance, Some(word), Some(start + at))
            };
            let mut next: Vec<Alignment> = vec![lacking(&row[0], 0)];
            for at in 1..=length {
                let token = &tokens[start + at - 1];
                let mut best = lacking(&row[at], at);
                let extra = next[at - 1].with(missing(token.text), None, Some(start + at - 1));
                let mut others = vec![extra];
                self.taken(phrase, part, at, &row, &mut others);
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

    /// Appends the alignments in which a part stands for the last words before `start + at`.
    fn taken(
        &self,
        phrase: &Phrase,
        part: &PhrasePart,
        at: usize,
        row: &[Alignment],
        into: &mut Vec<Alignment>,
    ) {
        let position = self.start + at - 1;
        let token = &self.reader.tokens[position];
        match part {
            PhrasePart::Word { said, lower } => {
                let distance = letter_distance(&token.lower, lower);
                let differs = (distance > 0.0).then_some(position);
                if distance <= LETTERS_MAX {
                    let taken = row[at - 1].with(distance, Some(said.clone()), differs);
                    into.push(Alignment { shares_word: true, ..taken });
                }
            }
            PhrasePart::Place { index, .. } => {
                let ends_here = |one: &&SentenceQuantifier| one.to == position + 1;
                for one in self.quantifiers.iter().filter(ends_here) {
                    let words = self.quantifier_words(one, part);
                    let before = &row[one.from - self.start];
                    let mut taken = before.with(one.distance, Some(words), one.differs_at);
                    taken.is_of_known_words |= one.is_form;
                    into.push(taken);
                }
                if let Some((distance, words)) = self.object(phrase, *index, token) {
                    let differs = (distance > 0.0).then_some(position);
                    into.push(row[at - 1].with(distance, Some(words), differs));
                }
            }
        }
    }

    /// Returns the words of a quantifier at a place.
    fn quantifier_words(&self, one: &SentenceQuantifier, part: &PhrasePart) -> String {
        match (one.differs_at, part) {
            (Some(_), PhrasePart::Place { case, .. }) => {
                self.reader.book.quantifiers.say(one.found.is_every, &one.found.ty, *case)
            }
            _ => self.reader.words(one.from, one.to).to_owned(),
        }
    }

    /// Returns the object that a word names at a place, and the distance; `None` if it names none.
    fn object(&self, phrase: &Phrase, index: usize, token: &Token<'_>) -> Option<(f64, String)> {
        let names = self.reader.names;
        let fitting = || names.fitting(phrase.symbol.as_str(), index);
        if self.reader.term(token).is_some() {
            let fits = fitting().any(|name| name.as_str() == token.lower);
            let is_open = fitting().next().is_none();
            let distance = match fits || is_open {
                true if names.is_open() && self.words.contains(token.lower.as_str()) => {
                    WORD_AS_OBJECT
                }
                true => 0.0,
                false => MISFIT,
            };
            return Some((distance, token.text.to_owned()));
        }
        let near = pddl::nearest(token.text, fitting().map(Name::spelled))?;
        Some((letter_distance(&token.lower, &near.to_lowercase()), near.to_owned()))
    }

    /// Returns the distance for a part that the text lacks, and the word that is put in its place.
    fn lacking_part(&self, phrase: &Phrase, part: &PhrasePart) -> (f64, String) {
        match part {
            PhrasePart::Word { said, .. } => (missing(said), said.clone()),
            PhrasePart::Place { index, .. } => {
                let mut fitting = self.reader.names.fitting(phrase.symbol.as_str(), *index);
                let object = fitting.next().map_or(GAP, Name::spelled);
                (MISSING, object.to_owned())
            }
        }
    }

    // === in any order ===

    /// Aligns the parts of a phrase with the words up to `end`, whatever their order is; `None` if a
    /// place has no word, or if no word of the phrase is there.
    fn align_freely(&self, phrase: &Phrase, end: usize) -> Option<Alignment> {
        let parts = &phrase.pattern.parts;
        let mut is_free: Vec<bool> = vec![true; end - self.start];
        let mut taken: Vec<Option<(usize, f64, String)>> = vec![None; parts.len()];
        // The words of the phrase first, so that none of them becomes an object.
        for (part, taken) in parts.iter().zip(&mut taken) {
            let PhrasePart::Word { said, lower } = part else { continue };
            let free = (self.start..end).filter(|at| is_free[at - self.start]);
            let near = free.map(|at| (at, letter_distance(&self.reader.tokens[at].lower, lower)));
            let best = near.min_by(|one, other| one.1.total_cmp(&other.1));
            if let Some((at, distance)) = best.filter(|best| best.1 <= LETTERS_REORDERED_MAX) {
                is_free[at - self.start] = false;
                *taken = Some((at, distance, said.clone()));
            }
        }
        taken.iter().flatten().next()?;
        for (part, taken) in parts.iter().zip(&mut taken) {
            if matches!(part, PhrasePart::Place { .. }) {
                *taken = Some(self.free_argument(phrase, part, end, &mut is_free)?);
            }
        }
        let mut alignment =
            Alignment { shares_word: true, is_of_known_words: true, ..Alignment::default() };
        for (part, taken) in parts.iter().zip(&taken) {
            alignment = match taken {
                Some((_, distance, words)) => alignment.with(*distance, Some(words.clone()), None),
                None => {
                    let (distance, word) = self.lacking_part(phrase, part);
                    alignment.with(distance, Some(word), None)
                }
            };
        }
        let extra = (self.start..end).filter(|at| is_free[at - self.start]);
        let extra: f64 = extra.map(|at| missing(self.reader.tokens[at].text)).sum();
        Some(alignment.with(extra + REORDERED, None, Some(self.start)))
    }

    /// Takes the first free words that can stand at a place; those that fit it best.
    fn free_argument(
        &self,
        phrase: &Phrase,
        part: &PhrasePart,
        end: usize,
        is_free: &mut [bool],
    ) -> Option<(usize, f64, String)> {
        let PhrasePart::Place { index, .. } = part else { return None };
        let mut options: Vec<(usize, usize, f64, String)> = Vec::new();
        for one in self.quantifiers.iter().filter(|one| one.to <= end) {
            options.push((one.from, one.to, one.distance, self.quantifier_words(one, part)));
        }
        let is_in_quantifier =
            |at: usize| self.quantifiers.iter().any(|one| one.from <= at && at < one.to);
        for at in (self.start..end).filter(|at| !is_in_quantifier(*at)) {
            let found = self.object(phrase, *index, &self.reader.tokens[at]);
            options.extend(found.map(|(distance, words)| (at, at + 1, distance, words)));
        }
        options.retain(|(from, to, ..)| {
            is_free[from - self.start..to - self.start].iter().all(|is_free| *is_free)
        });
        options.sort_by_key(|(from, ..)| *from);
        let best = options.into_iter().min_by(|one, other| one.2.total_cmp(&other.2));
        let (from, to, distance, words) = best?;
        is_free[from - self.start..to - self.start].fill(false);
        Some((from, distance, words))
    }
}

/// Returns the quantifier at `from`, correct or nearly so; `None` if there is none.
fn quantifier(reader: &PhraseReader<'_>, from: usize, end: usize) -> Option<SentenceQuantifier> {
    let (words, names) = (&reader.book.quantifiers, reader.names);
    let tokens = reader.tokens.get(from..end)?;
    let of_type = |found: QuantifierMatch| {
        let mut to = from + found.length;
        let known = names.types();
        let (found, distance, differs_at) = match names.has_type(&found.ty) {
            true => {
                let is_variable = |token: &Token<'_>| token.text.starts_with('?');
                to += usize::from(tokens.get(found.length).is_some_and(is_variable));
                (found, 0.0, None)
            }
            false => {
                let near = pddl::nearest(found.ty.as_str(), known.iter().map(|ty| ty.as_str()))?;
                let distance = letter_distance(found.ty.as_str(), near);
                (QuantifierMatch { ty: Name::new(near), ..found }, distance, Some(to - 1))
            }
        };
        Some(SentenceQuantifier { from, to, found, distance, differs_at, is_form: false })
    };
    if let Some(quantifier) = words.read(tokens).and_then(of_type) {
        return Some(quantifier);
    }
    let (found, differs) = words.read_near(tokens, &names.types())?;
    let (to, distance, differs_at) = (from + found.length, WRONG_FORM + differs, Some(from));
    Some(SentenceQuantifier { from, to, found, distance, differs_at, is_form: true })
}

/// Returns the comparison in the sentence `start..end`: a correct one, or else one with slips before a
/// number, such as `atleast 21`.
fn comparison(reader: &PhraseReader<'_>, start: usize, end: usize) -> Option<SentenceComparison> {
    let right = (start + 1..end).find_map(|from| {
        let to = reader.comparison_words(from)?.1;
        let words = reader.words(from, to).to_owned();
        Some(SentenceComparison { from, to, words, distance: 0.0 })
    });
    if right.is_some() {
        return right;
    }
    let number = (start + 2..end).find(|at| has_digit(reader, *at))?;
    let lists = COMPARISONS.iter().flat_map(|one| reader.book.comparison(*one));
    let near = lists.flat_map(|words| {
        let plain = words.to_lowercase().replace(' ', "");
        (number.saturating_sub(COMPARISON_WORDS_MAX).max(start + 1)..number).map(move |from| {
            let said: String = (from..number).map(|at| reader.tokens[at].lower.as_str()).collect();
            (from, words, letter_distance(&said, &plain))
        })
    });
    let near = near.filter(|(.., distance)| *distance <= COMPARISON_LETTERS_MAX);
    let best = near.min_by(|one, other| one.2.total_cmp(&other.2));
    let (from, words, distance) = best?;
    let distance = distance.max(WRONG_FORM);
    Some(SentenceComparison { from, to: number, words: words.clone(), distance })
}

fn has_digit(reader: &PhraseReader<'_>, at: usize) -> bool {
    let token = reader.tokens.get(at).filter(|token| reader.term(token).is_none());
    token.is_some_and(|token| token.text.contains(|c: char| c.is_ascii_digit()))
}

fn missing(word: &str) -> f64 {
    let is_short = word.chars().count() <= 3 && word.chars().all(char::is_lowercase);
    if is_short { SHORT_MISSING } else { MISSING }
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

    /// Returns the corrected sentence.
    pub(crate) fn sentence(&self) -> String {
        self.words.join(" ")
    }

    /// Whether a name is missing in the corrected sentence, because no object is known.
    pub(crate) fn has_gap(&self) -> bool {
        self.words.iter().any(|word| word == GAP)
    }
}
