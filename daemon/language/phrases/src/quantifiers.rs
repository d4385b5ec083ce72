//! The words of quantifiers: `every room`, `some camera`, `jedem Raum`.

use std::collections::{BTreeMap, BTreeSet};

use pddl::Name;

use crate::default_name::is_name;
use crate::pattern::GrammaticalCase;
use crate::token::{Token, letter_distance};
use crate::words_file::TypeWords;

/// The part of a word that stands for the name of a type that has no words of its own.
const TYPE: &str = "{type}";

/// Share of the letters of a type that may differ.
const LETTERS_MAX: f64 = 0.34;

/// The words of quantifiers of one language.
#[derive(Clone, Debug)]
pub(crate) struct QuantifierWords {
    own: BTreeMap<Name, TypeWords>,
    /// The words of all other types, with [`TYPE`] in them.
    others: TypeWords,
}

/// A quantifier that was read, and the number of its tokens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct QuantifierMatch {
    pub(crate) is_every: bool,
    pub(crate) ty: Name,
    pub(crate) length: usize,
}

// === impl QuantifierWords ===

impl QuantifierWords {
    pub(crate) fn new(others: &TypeWords) -> QuantifierWords {
        QuantifierWords { own: BTreeMap::new(), others: others.clone() }
    }

    pub(crate) fn add(&mut self, ty: Name, words: &TypeWords) {
        self.own.insert(ty, words.clone());
    }

    /// Says a quantifier over a type.
    pub(crate) fn say(&self, is_every: bool, ty: &Name, case: GrammaticalCase) -> String {
        let words = self.own.get(ty).unwrap_or(&self.others);
        let forms = if is_every { &words.every } else { &words.some };
        case.choose(forms).unwrap_or(TYPE).replace(TYPE, ty.spelled())
    }

    /// Reads the quantifier at the start of `tokens`; `None` if there is none. Of several, the one
    /// with the most words is read.
    pub(crate) fn read(&self, tokens: &[Token<'_>]) -> Option<QuantifierMatch> {
        let mut best: Option<QuantifierMatch> = None;
        let mut note = |found: Option<QuantifierMatch>| {
            if let Some(found) = found
                && best.as_ref().is_none_or(|best| best.length < found.length)
            {
                best = Some(found);
            }
        };
        for (ty, words) in &self.own {
            for (is_every, form) in forms(words) {
                let length = words_match(form, tokens);
                note(length.map(|length| QuantifierMatch { is_every, ty: ty.clone(), length }));
            }
        }
        for (is_every, form) in forms(&self.others) {
            note(template_match(form, tokens, is_every));
        }
        best
    }

    /// Reads a quantifier in a wrong form at the start of `tokens`, such as `all room` or `every
    /// rooms`; `None` if there is none. Also returns the share of the letters by which its type
    /// differs. If no types are `known`, any name may be one.
    pub(crate) fn read_near(
        &self,
        tokens: &[Token<'_>],
        known: &BTreeSet<&Name>,
    ) -> Option<(QuantifierMatch, f64)> {
        let (first, rest) = tokens.split_first()?;
        let all = self.own.values().chain(std::iter::once(&self.others));
        let begins = |form: &str| form.split_whitespace().next() == Some(first.lower.as_str());
        let (is_every, _) = all.flat_map(forms).find(|(_, form)| begins(form))?;
        let types: BTreeSet<&Name> = known.iter().copied().chain(self.own.keys()).collect();
        let is_possible = |ty: &&Name| known.is_empty() || known.contains(ty);
        let mut best: Option<(QuantifierMatch, f64)> = None;
        for ty in types.into_iter().filter(is_possible) {
            let words = self.own.get(ty).unwrap_or(&self.others);
            for (_, form) in forms(words) {
                let form = form.replace(TYPE, ty.spelled()).to_lowercase();
                let Some((_, noun)) = form.split_once(' ') else { continue };
                let count = noun.split_whitespace().count();
                let Some(said) = rest.get(..count).filter(|_| count > 0) else { continue };
                let said: Vec<_> = said.iter().map(|token| token.lower.as_str()).collect();
                let differs = letter_distance(&said.join(" "), noun);
                if differs <= LETTERS_MAX && best.as_ref().is_none_or(|best| differs < best.1) {
                    let (ty, length) = (ty.clone(), count + 1);
                    best = Some((QuantifierMatch { is_every, ty, length }, differs));
                }
            }
        }
        let open = || {
            let name = rest.first().filter(|one| known.is_empty() && is_name(one.text))?;
            let ty = Name::new(name.text);
            Some((QuantifierMatch { is_every, ty, length: 2 }, 0.0))
        };
        best.or_else(open)
    }

    /// Returns the words of all quantifiers, without the names of types.
    pub(crate) fn all_words(&self) -> impl Iterator<Item = &str> {
        let all = self.own.values().chain(std::iter::once(&self.others));
        let words = all.flat_map(forms).flat_map(|(_, form)| form.split_whitespace());
        words.filter(|word| !word.contains(TYPE))
    }

    /// Returns the quantifiers over the types `known` that are said, in all cases, for completion.
    pub(crate) fn all_forms(&self, known: impl IntoIterator<Item = Name>) -> Vec<String> {
        let mut said = Vec::new();
        for ty in known {
            let words = self.own.get(&ty).unwrap_or(&self.others);
            let forms = words.every.iter().chain(&words.some);
            said.extend(forms.map(|form| form.replace(TYPE, ty.spelled())));
        }
        said
    }

    /// Returns the types that have words of their own.
    pub(crate) fn own_types(&self) -> impl Iterator<Item = &Name> {
        self.own.keys()
    }
}

/// Returns all forms of a type: those for “every”, and those for “some”.
fn forms(words: &TypeWords) -> impl Iterator<Item = (bool, &str)> {
    let every = words.every.iter().chain(&words.all).map(|form| (true, form.as_str()));
    every.chain(words.some.iter().map(|form| (false, form.as_str())))
}

fn words_match(form: &str, tokens: &[Token<'_>]) -> Option<usize> {
    let mut length = 0;
    for word in form.split_whitespace() {
        let token = tokens.get(length)?;
        if !token.is_word() || token.lower != word.to_lowercase() {
            return None;
        }
        length += 1;
    }
    (length > 0).then_some(length)
}

/// Reads a form with [`TYPE`] in one of its words.
fn template_match(form: &str, tokens: &[Token<'_>], is_every: bool) -> Option<QuantifierMatch> {
    let (mut length, mut ty) = (0, None);
    for word in form.split_whitespace() {
        let token = tokens.get(length).filter(|token| token.is_word())?;
        match word.split_once(TYPE) {
            Some((before, after)) => {
                let name = token.text.strip_prefix(before)?.strip_suffix(after)?;
                ty = Some(Name::new(Some(name).filter(|name| is_name(name))?));
            }
            None if token.lower != word.to_lowercase() => return None,
            None => (),
        }
        length += 1;
    }
    ty.map(|ty| QuantifierMatch { is_every, ty, length })
}
