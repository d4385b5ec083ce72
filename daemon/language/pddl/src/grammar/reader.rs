//! State that all productions of the grammar share: the mistakes and the names found so far, and
//! the place of the current expression.

use std::borrow::Cow;

use foldhash::HashMap;
use foldhash::fast::RandomState;

use crate::diagnostic::{Diagnostic, DiagnosticList};
use crate::nearest::nearest;
use crate::sexpr::{Items, NodeContent, SyntaxNode};
use crate::tree::{Name, Span};

/// State of the parser for one text.
pub(crate) struct GrammarReader<'f> {
    /// Names by spelling. Each spelling is allocated once, even if it occurs several times in the
    /// text.
    names: HashMap<&'f str, Name>,
    problems: DiagnosticList,
    place: ExpressionPlace,
    copies_left: usize,
    /// Start of a list that was reported together with the word before it and must be skipped;
    /// `None` if there is none.
    passed_over: Option<u32>,
    /// Places of words with characters that were reported when the tree was built, in the order of
    /// the text.
    spoiled: Vec<Span>,
}

/// Maximum number of arguments that are repeated in the advice to write `(at r1 hall)` instead of
/// `at(r1, hall)`.
const CALL_WORDS_MAX: usize = 6;

/// Maximum number of variables that may be copied when nested `forall`s are flattened. A text that
/// needs more copies is an error; see [`GrammarReader::afford_copies`].
const COPIES_MAX: usize = 100_000;

/// Place of an expression. It determines which of the terms `?duration`, `#t` and `total-time` the
/// expression may contain.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ExpressionPlace {
    /// The expression is in an action, a goal or a fact.
    Plain,
    /// The expression is inside `:durative-action`, where `?duration` and `#t` are allowed.
    Durative,
    /// The expression is inside `:metric`, where `total-time` is allowed.
    Metric,
}

/// A word in lower case. It is borrowed from the text if the text has it in lower case, which is
/// the usual case.
pub(super) struct Keyword<'f>(Cow<'f, str>);

// === impl GrammarReader ===

impl<'f> GrammarReader<'f> {
    /// Creates the state for a text with `node_count` words and lists. The words at the places
    /// `spoiled` were reported already.
    pub(crate) fn new(
        problems: DiagnosticList,
        node_count: usize,
        spoiled: Vec<Span>,
    ) -> GrammarReader<'f> {
        // In the text of a building, about one node in ten has a new spelling.
        let names = HashMap::with_capacity_and_hasher(node_count / 10, RandomState::default());
        GrammarReader {
            names,
            problems,
            place: ExpressionPlace::Plain,
            copies_left: COPIES_MAX,
            passed_over: None,
            spoiled,
        }
    }

    pub(crate) fn into_diagnostics(self) -> Vec<Diagnostic> {
        self.problems.into_sorted()
    }

    /// Adds a mistake. A mistake at a word with a character that was reported is a consequence of
    /// that character, and is left out.
    pub(super) fn report(&mut self, diagnostic: Diagnostic) {
        let span = diagnostic.span;
        let next = self.spoiled.partition_point(|word| word.end < span.end);
        let word = self.spoiled.get(next);
        if !word.is_some_and(|word| word.start <= span.start && span.start < word.end) {
            self.problems.push(diagnostic);
        }
    }

    /// Returns the name with the spelling `word`, placed at `span`.
    pub(super) fn intern(&mut self, word: &'f str, span: Span) -> Name {
        if let Some(name) = self.names.get(word) {
            return name.at(span);
        }
        let name = Name::new(word);
        self.names.insert(word, name.clone());
        name.at(span)
    }

    /// Whether `count` more variables may be copied. The number of copies is limited, so that a
    /// short text cannot become a tree that exceeds the memory.
    pub(super) fn afford_copies(&mut self, count: usize) -> bool {
        let left = self.copies_left.checked_sub(count);
        self.copies_left = left.unwrap_or(0);
        left.is_some()
    }

    pub(super) fn place(&self) -> ExpressionPlace {
        self.place
    }

    /// Runs `production`, which parses expressions that stand at `place`.
    pub(super) fn within<T>(
        &mut self,
        place: ExpressionPlace,
        production: impl FnOnce(&mut GrammarReader<'f>) -> T,
    ) -> T {
        let outer = std::mem::replace(&mut self.place, place);
        let value = production(self);
        self.place = outer;
        value
    }

    /// Returns the next item of a list. If there is none, reports that `what` is missing and
    /// returns `None`.
    pub(super) fn expect(
        &mut self,
        items: &mut Items<'f>,
        what: &str,
        rule: &'static str,
    ) -> Option<SyntaxNode<'f>> {
        let node = items.find(|node| !self.is_already_reported(*node));
        if node.is_none() {
            let missing = Diagnostic::error(items.end(), format!("missing {what}"));
            self.report(missing.with_rule(rule));
        }
        node
    }

    /// Returns the items of a list. For any other node, reports that `what` is expected and returns
    /// `None`.
    pub(super) fn expect_list(
        &mut self,
        node: SyntaxNode<'f>,
        what: &str,
        rule: &'static str,
    ) -> Option<Items<'f>> {
        match node.content() {
            NodeContent::List(_) if self.is_already_reported(node) => None,
            NodeContent::List(items) => Some(items),
            NodeContent::Symbol(_) if self.report_call(node) => None,
            NodeContent::Symbol(word) => {
                let message = format!("expected {what}, found `{word}`");
                self.report(Diagnostic::error(node.span(), message).with_rule(rule));
                None
            }
            NodeContent::Damaged => None,
        }
    }

    /// Reports the next item of a list, if there is one, as one too many.
    pub(super) fn expect_end(&mut self, mut items: Items<'f>, what: &str, rule: &'static str) {
        if let Some(node) = items.find(|node| !self.is_call(*node)) {
            let message = format!("{what} ends before `{}`", excerpt(node));
            let mut more = Diagnostic::error(node.span(), message).with_rule(rule);
            let takes_one = rule.contains("CONDITION") || rule.contains("EFFECT");
            if takes_one && node.list().is_some() {
                more.help = Some("several are joined by `(and …)`".to_owned());
            }
            self.report(more);
        }
    }

    /// Reports a word that touches the list after it, like a call in other languages: `at(r1,
    /// hall)`. The list is skipped. Returns whether the word touches a list.
    pub(super) fn report_call(&mut self, word: SyntaxNode<'f>) -> bool {
        let Some(list) = word.touching_list() else { return false };
        if self.is_already_reported(list) {
            return true;
        }
        let name = excerpt(word);
        let inner = list.text().trim_matches(['(', ')']).replace(',', " ");
        let is_flat = !inner.contains(['(', ')']);
        let arguments: Vec<&str> = match is_flat {
            true => inner.split_whitespace().take(CALL_WORDS_MAX).collect(),
            false => vec!["…"],
        };
        let written = [&[name.as_str()], arguments.as_slice()].concat().join(" ");
        let message = format!("`{name}` stands before its parentheses");
        let call = Diagnostic::error(Span { end: list.span().end, ..word.span() }, message);
        self.report(call.with_help(format!("write `({written})`")));
        self.passed_over = Some(list.span().start);
        true
    }

    /// Whether a node is a list that touches the word before it. If so,
    /// [`GrammarReader::report_call`] reports the two, unless they have been reported already.
    pub(super) fn is_call(&mut self, node: SyntaxNode<'f>) -> bool {
        let Some(word) = node.touched_word() else { return false };
        self.report_call(word)
    }

    /// Whether a node is a list that was reported together with the word before it.
    pub(super) fn is_already_reported(&self, node: SyntaxNode<'f>) -> bool {
        self.passed_over == Some(node.span().start)
    }

    /// Returns the candidate that `word` most likely misspells; `None` if no candidate is similar
    /// enough, or if so many mistakes were found that no more are listed.
    pub(super) fn nearest(
        &self,
        word: &str,
        candidates: impl IntoIterator<Item = &'static str>,
    ) -> Option<&'static str> {
        if self.problems.is_full() { None } else { nearest(word, candidates) }
    }

    /// Reports a word that is not among `known`, and proposes the most similar of these words.
    pub(super) fn unknown(&mut self, node: SyntaxNode<'f>, what: &str, known: &[&'static str]) {
        let word = excerpt(node);
        let near = self.nearest(&word, known.iter().copied());
        let mut unknown = Diagnostic::error(node.span(), format!("unknown {what} `{word}`"))
            .with_suggestion(near);
        if near.is_none() {
            unknown = unknown.with_help(format!("known are {}", known.join(" ")));
        }
        self.report(unknown);
    }
}

// === impl Keyword ===

impl<'f> Keyword<'f> {
    pub(super) fn of(word: &'f str) -> Keyword<'f> {
        Keyword(match word.bytes().any(|byte| byte.is_ascii_uppercase()) {
            true => word.to_ascii_lowercase().into(),
            false => word.into(),
        })
    }

    pub(super) fn as_str(&self) -> &str {
        &self.0
    }
}

/// Returns the text of a node, shortened if it is long.
pub(super) fn excerpt(node: SyntaxNode<'_>) -> String {
    const CHARS_MAX: usize = 40;
    let text = node.text();
    let line = text.lines().next().unwrap_or("");
    let mut short: String = line.chars().take(CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}
