//! A phrase with places for arguments: `temperature of {1} known`.

use crate::words_file::WordsError;

/// The grammatical case in which a quantifier stands at a place. Objects are not inflected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum GrammaticalCase {
    #[default]
    Nominative,
    Accusative,
    Dative,
}

/// A part of a phrase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PhrasePart {
    /// A word, as it is said and in lower case.
    Word { said: String, lower: String },
    /// The place of the argument `index`, which counts from 0.
    Place { index: usize, case: GrammaticalCase },
}

/// A phrase with places for arguments. Each argument has one place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Pattern {
    pub(crate) parts: Vec<PhrasePart>,
    /// Number of arguments.
    pub(crate) arity: usize,
}

/// Maximum number of words and places of a phrase.
const PARTS_MAX: usize = 24;

// === impl GrammaticalCase ===

impl GrammaticalCase {
    /// Returns the form for this case; words with fewer forms use the last one.
    pub(crate) fn choose(self, forms: &[String]) -> Option<&str> {
        let index = match self {
            GrammaticalCase::Nominative => 0,
            GrammaticalCase::Accusative => 1,
            GrammaticalCase::Dative => 2,
        };
        forms.get(index).or(forms.last()).map(String::as_str)
    }

    fn named(name: &str) -> Option<GrammaticalCase> {
        match name {
            "accusative" => Some(GrammaticalCase::Accusative),
            "dative" => Some(GrammaticalCase::Dative),
            _ => None,
        }
    }
}

// === impl Pattern ===

impl Pattern {
    /// Reads a phrase from a words file.
    pub(crate) fn read(symbol: &str, text: &str) -> Result<Pattern, WordsError> {
        let wrong = |why: String| WordsError { symbol: symbol.to_owned(), why };
        let mut parts = Vec::new();
        for word in text.split_whitespace() {
            let part = match word.strip_prefix('{').and_then(|rest| rest.strip_suffix('}')) {
                Some(inner) => place(inner).ok_or_else(|| {
                    wrong(format!(
                        "`{word}` is no place; write `{{1}}` for the first argument, or \
                         `{{1:dative}}` or `{{1:accusative}}` for its case"
                    ))
                })?,
                None if word.contains(['{', '}', '(', ')', ',', ':', '`', '?']) => {
                    return Err(wrong(format!(
                        "`{word}` is no word of a phrase; words are separated by spaces and have \
                         no marks"
                    )));
                }
                None => PhrasePart::Word { said: word.to_owned(), lower: word.to_lowercase() },
            };
            parts.push(part);
        }
        let mut indices: Vec<usize> = parts.iter().filter_map(PhrasePart::index).collect();
        let arity = indices.len();
        indices.sort_unstable();
        if !indices.iter().copied().eq(0..arity) {
            return Err(wrong(format!(
                "the places of `{text}` are not `{{1}}`, `{{2}}` and so on, each once"
            )));
        }
        if parts.len() == arity {
            return Err(wrong(format!("the phrase `{text}` has no word")));
        }
        if parts.len() > PARTS_MAX {
            return Err(wrong(format!("the phrase has more than {PARTS_MAX} words")));
        }
        Ok(Pattern { parts, arity })
    }

    /// Returns the words of the phrase in lower case.
    pub(crate) fn words(&self) -> impl Iterator<Item = &str> {
        self.parts.iter().filter_map(|part| match part {
            PhrasePart::Word { lower, .. } => Some(lower.as_str()),
            PhrasePart::Place { .. } => None,
        })
    }
}

impl PhrasePart {
    fn index(&self) -> Option<usize> {
        match self {
            PhrasePart::Place { index, .. } => Some(*index),
            PhrasePart::Word { .. } => None,
        }
    }
}

fn place(inner: &str) -> Option<PhrasePart> {
    let (number, case) = match inner.split_once(':') {
        Some((number, case)) => (number, GrammaticalCase::named(case)?),
        None => (inner, GrammaticalCase::Nominative),
    };
    let index = number.parse::<usize>().ok()?.checked_sub(1)?;
    Some(PhrasePart::Place { index, case })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_phrase_has_each_place_once() {
        let pattern = Pattern::read("at", "{1} steht bei {2:dative}").expect("a phrase");
        assert_eq!((pattern.arity, pattern.parts.len()), (2, 4));
        for wrong in ["{1}", "", "a {2}", "a {1} {1}", "a {0}", "a {x}", "a {1:x}", "a, b", "a{1}"]
        {
            assert!(Pattern::read("at", wrong).is_err(), "{wrong}");
        }
    }
}
