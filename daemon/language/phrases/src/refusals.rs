//! Refusals: the answers to sentences that are joined wrongly, and to types that do not exist.

use pddl::Name;

use crate::nearest;
use crate::not_understood::NotUnderstood;
use crate::pattern::GrammaticalCase;
use crate::quantifiers::QuantifierMatch;
use crate::reading::{Connective, PhraseReader};
use crate::token::{Token, TokenKind};

// === impl PhraseReader ===

impl PhraseReader<'_> {
    /// Returns the answer to a text that ends where a condition is expected.
    pub(crate) fn refuse_end(&self) -> NotUnderstood {
        let last = self.at.checked_sub(1).and_then(|last| self.tokens.get(last));
        let why = match last {
            Some(last) => format!("something must follow `{}`", last.text),
            None => "a condition is expected".to_owned(),
        };
        let mut answer = NotUnderstood::new(self.here(), why);
        answer.is_near = self.at > 1;
        answer
    }

    /// Returns the answer to a word or mark at `at` that begins no condition, such as `and`.
    pub(crate) fn refuse_opener(&self, at: usize) -> NotUnderstood {
        let Some(token) = self.tokens.get(at) else { return self.refuse_end() };
        let why = match self.connective(at) {
            Some(_) => format!(
                "`{}` joins two conditions, and a condition is missing before it",
                token.text
            ),
            None => format!("`{}` begins no condition", token.text),
        };
        self.without(at, NotUnderstood::new(token.span(), why))
    }

    /// Returns the answer to what follows a whole goal.
    pub(crate) fn refuse_rest(&self) -> NotUnderstood {
        let Some(token) = self.tokens.get(self.at) else { return self.refuse_end() };
        let is_last = self.at + 1 == self.tokens.len();
        let why = match token.kind {
            TokenKind::Comma if is_last => "something must follow `,`".to_owned(),
            _ => format!("`{}` does not continue the sentence", token.text),
        };
        let mut answer = NotUnderstood::new(token.span(), why);
        answer.is_near = true;
        if is_last { self.without(self.at, answer) } else { answer }
    }

    /// Adds to an answer the text without the token `at`, if that is understood.
    fn without(&self, at: usize, mut answer: NotUnderstood) -> NotUnderstood {
        if let Some(token) = self.tokens.get(at) {
            // The white space on one of its sides goes, too.
            let to = token.start + token.text.len();
            let from = self.text.get(..token.start).map_or(0, |before| before.trim_end().len());
            let from = if at == 0 { token.start } else { from };
            answer.nearest.extend(nearest::mended(self, &self.replaced(from, to, "")));
        }
        answer.is_near = at > 0 || !answer.nearest.is_empty();
        answer
    }

    /// Returns the answer to `and` beside `or` among the conditions that begin at `start`.
    pub(crate) fn refuse_mixture(&self, start: usize) -> NotUnderstood {
        let [and, or] = self.connective_words();
        let open = format!("`{and}` and `{or}` together leave open what belongs to which");
        let is_whole = self.is_outermost_piece();
        let when = self.book.grammar.when.first().map_or("if", String::as_str);
        let why = match is_whole {
            true => format!("{open}; a comma says it: `A {and} B, {or} C`"),
            // A comma ends the scope of the colon or of `if`.
            false => {
                format!("{open}; after a colon or `{when}`, a part in PDDL says it, in parentheses")
            }
        };
        let mut answer = NotUnderstood::new(self.here(), why);
        answer.is_near = true;
        if is_whole && self.may_suggest() {
            for connective in [Connective::Or, Connective::And] {
                let text = self.with_commas(start, connective);
                let mended = text.and_then(|text| nearest::mended(self, &text));
                answer.nearest.extend(mended);
            }
            answer.nearest.truncate(self.suggested_max());
        }
        answer
    }

    /// Returns the answer to `, and` beside `, or`.
    pub(crate) fn refuse_loose_mixture(&self) -> NotUnderstood {
        let [and, or] = self.connective_words();
        let why = format!(
            "`, {and}` and `, {or}` together leave open what belongs to which; write all of one kind \
             without a comma, as in `A {and} B, {or} C`, or a part in PDDL, in parentheses"
        );
        let mut answer = NotUnderstood::new(self.here(), why);
        answer.is_near = true;
        answer
    }

    fn connective_words(&self) -> [String; 2] {
        let grammar = &self.book.grammar;
        [&grammar.and, &grammar.or].map(|words| words.first().cloned().unwrap_or_default())
    }

    /// Returns the text with a comma before each `connective` among the conditions that begin at
    /// `start`; `None` if one is nowhere missing.
    fn with_commas(&self, start: usize, connective: Connective) -> Option<String> {
        let is_end = |at: &usize| self.is_comma(*at) && self.connective(at + 1).is_some();
        let end = (self.at..self.tokens.len()).find(is_end).unwrap_or(self.tokens.len());
        let is_here = |at: &usize| self.connective(*at) == Some(connective);
        let mut text = self.text.to_owned();
        let mut is_other = false;
        // From the end, so that the places before stay where they are.
        for at in (start + 1..end).rev().filter(is_here) {
            let Some(before) = self.tokens.get(at - 1) else { continue };
            if before.kind != TokenKind::Comma {
                text.insert(before.start + before.text.len(), ',');
                is_other = true;
            }
        }
        is_other.then_some(text)
    }

    /// Returns the answer to a quantifier over a type that the ecosystem does not have; `last` is the
    /// position of its last word.
    pub(crate) fn refuse_type(&self, found: &QuantifierMatch, last: usize) -> NotUnderstood {
        let span = self.tokens.get(last).map_or_else(|| self.here(), Token::span);
        let mut answer = NotUnderstood::new(span, format!("there is no type `{}`", found.ty));
        let known = self.names.types();
        let near = pddl::nearest(found.ty.as_str(), known.iter().map(|ty| ty.spelled()));
        let first = (last + 1).checked_sub(found.length).and_then(|first| self.tokens.get(first));
        if let (Some(near), Some(first)) = (near, first) {
            let case = GrammaticalCase::Accusative;
            let said = self.book.quantifiers.say(found.is_every, &Name::new(near), case);
            let text = self.replaced(first.start, span.end as usize, &said);
            answer.nearest.extend(nearest::mended(self, &text));
        }
        answer.is_near = !answer.nearest.is_empty();
        answer
    }
}
