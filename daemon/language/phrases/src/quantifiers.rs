//! The words of quantifiers: `every room`, `some camera`, `jedem Raum`.

use std::collections::BTreeMap;

use pddl::Name;

use crate::default_name::is_name;
use crate::pattern::GrammaticalCase;
use crate::token::Token;
use crate::words_file::TypeWords;

/// The part of a word that stands for the name of a type that has no words of its own.
const TYPE: &str = "{type}";

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
