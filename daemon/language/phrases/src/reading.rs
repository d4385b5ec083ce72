//! Reading: converts a text to a goal.
//!
//! ```text
//! goal     = piece (", and" piece)*  |  piece (", or" piece)*
//! piece    = "for" QUANTIFIER [NAME] ":" piece
//!          | "if" piece "then" piece
//!          | unit ("and" unit)*  |  unit ("or" unit)*
//! unit     = "not" unit | sentence | "(" PDDL ")"
//! sentence = PHRASE | PHRASE COMPARISON (NUMBER [UNIT] | PHRASE)
//! ```
//!
//! A comma alone joins as the next `and` or `or` does. At the place of an argument stands an object,
//! or a quantifier: `every room`, whose scope is the sentence.

use pddl::{Atom, Compare, Comparison, Condition, Expression, FluentTerm, Name, Number, Span};
use pddl::{Term, TypeExpr, Typed};

use crate::default_name::{default_name, is_name};
use crate::known_names::KnownNames;
use crate::likeness::likeness;
use crate::nearest;
use crate::not_understood::NotUnderstood;
use crate::numbers;
use crate::pattern::{Pattern, PhrasePart};
use crate::phrasebook::{COMPARISONS, Phrase, PhraseKind, Phrasebook};
use crate::token::{Token, TokenKind, tokens};

/// Longest text that is read, in bytes. A building has at most some hundred rooms to enumerate.
const BYTES_MAX: usize = 64 << 10;

/// Maximum depth of nested pieces and negations, so that recursion is safe on any thread.
const DEPTH_MAX: usize = 32;

/// Maximum number of mistakes of one text that are corrected for a suggestion.
const CORRECTIONS_MAX: usize = 4;

/// Maximum number of texts that are suggested.
const SUGGESTED_MAX: usize = 2;

/// Reads a goal.
pub(crate) fn read(
    book: &Phrasebook,
    text: &str,
    names: &KnownNames,
) -> Result<Condition, NotUnderstood> {
    read_correcting(book, text, names, CORRECTIONS_MAX).map_err(|mut wrong| {
        if text.len() <= BYTES_MAX {
            wrong.likeness = likeness(book, &tokens(text));
        }
        wrong
    })
}

/// Reads a goal. If it is not understood, at most `corrections` mistakes are corrected in what is
/// suggested.
pub(crate) fn read_correcting(
    book: &Phrasebook,
    text: &str,
    names: &KnownNames,
    corrections: usize,
) -> Result<Condition, NotUnderstood> {
    if text.len() > BYTES_MAX {
        let why = format!("the text is longer than {BYTES_MAX} bytes");
        return Err(NotUnderstood::new(Span::new(0, 0), why));
    }
    let tokens = tokens(text);
    let mut reader = PhraseReader::new(book, names, text, tokens);
    reader.corrections = corrections;
    let goal = reader.goal()?;
    match reader.tokens.get(reader.at) {
        None => Ok(goal),
        Some(_) => Err(reader.refuse_rest()),
    }
}

/// `and` or `or`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Connective {
    And,
    Or,
}

/// One condition, or conditions that commas join.
enum PhrasePiece {
    One(Condition),
    /// Conditions with nothing but commas between them.
    List(Vec<Condition>),
}

/// An argument that was read.
#[derive(Clone, Debug)]
enum PhraseArgument {
    Term(Term),
    Quantified { is_every: bool, ty: Name, variable: Option<Name> },
}

/// A phrase that was read: the arguments in the order of the text, each with its index.
struct PhraseMatch {
    end: usize,
    arguments: Vec<(usize, PhraseArgument)>,
}

/// The state of reading one text.
pub(crate) struct PhraseReader<'r> {
    pub(crate) book: &'r Phrasebook,
    pub(crate) names: &'r KnownNames,
    pub(crate) text: &'r str,
    pub(crate) tokens: Vec<Token<'r>>,
    pub(crate) at: usize,
    /// The variables that may be used here, the outermost first.
    pub(crate) scope: Vec<Name>,
    depth: usize,
    /// Number of mistakes that may still be corrected in a suggestion.
    pub(crate) corrections: usize,
}

// === impl Connective ===

impl Connective {
    fn join(self, conditions: Vec<Condition>) -> Condition {
        match self {
            Connective::And => Condition::And(conditions),
            Connective::Or => Condition::Or(conditions),
        }
    }
}

// === impl PhraseReader ===

impl<'r> PhraseReader<'r> {
    /// Creates the reader of a text that was split into `tokens`.
    pub(crate) fn new(
        book: &'r Phrasebook,
        names: &'r KnownNames,
        text: &'r str,
        tokens: Vec<Token<'r>>,
    ) -> PhraseReader<'r> {
        let (at, scope, depth) = (0, Vec::new(), 0);
        PhraseReader { book, names, text, tokens, at, scope, depth, corrections: CORRECTIONS_MAX }
    }

    fn goal(&mut self) -> Result<Condition, NotUnderstood> {
        if self.tokens.is_empty() {
            return Err(NotUnderstood::new(Span::new(0, 0), "the text says nothing"));
        }
        let first = self.piece()?;
        let Some(connective) = self.loose_connective() else {
            return Ok(match first {
                PhrasePiece::One(condition) => condition,
                PhrasePiece::List(conditions) => Condition::And(conditions),
            });
        };
        let mut conditions = Vec::new();
        let mut note = |piece| match piece {
            PhrasePiece::One(condition) => conditions.push(condition),
            PhrasePiece::List(listed) => conditions.extend(listed),
        };
        note(first);
        loop {
            // The comma and the connective.
            self.at += 2;
            note(self.piece()?);
            match self.loose_connective() {
                Some(next) if next == connective => (),
                Some(_) => return Err(self.refuse_loose_mixture()),
                None => return Ok(connective.join(conditions)),
            }
        }
    }

    fn piece(&mut self) -> Result<PhrasePiece, NotUnderstood> {
        self.descend()?;
        let book = self.book;
        let piece = if self.is_word(self.at, &book.grammar.before_quantifier)
            && book.quantifiers.read(self.rest(1)).is_some()
        {
            self.quantified_piece().map(PhrasePiece::One)
        } else if self.is_word(self.at, &book.grammar.when) {
            self.conditional_piece().map(PhrasePiece::One)
        } else {
            self.group()
        };
        self.depth -= 1;
        piece
    }

    fn whole_piece(&mut self) -> Result<Condition, NotUnderstood> {
        Ok(match self.piece()? {
            PhrasePiece::One(condition) => condition,
            PhrasePiece::List(conditions) => Condition::And(conditions),
        })
    }

    fn descend(&mut self) -> Result<(), NotUnderstood> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            let why = format!("conditions are nested more than {DEPTH_MAX} deep");
            return Err(NotUnderstood::new(self.here(), why));
        }
        Ok(())
    }

    /// Reads `for every room r: …`.
    fn quantified_piece(&mut self) -> Result<Condition, NotUnderstood> {
        let (book, at) = (self.book, self.at);
        let Some(found) = book.quantifiers.read(self.rest(1)) else {
            return Err(nearest::refuse(self, at));
        };
        if !self.names.has_type(&found.ty) {
            return Err(self.refuse_type(&found, at + found.length));
        }
        self.at += 1 + found.length;
        let named = self.tokens.get(self.at).filter(|token| token.is_word());
        let named = named.map(|token| token.text.trim_start_matches('?').to_owned());
        let variable = match named {
            Some(name) if is_name(&name) => {
                self.at += 1;
                Name::new(&name)
            }
            _ => default_name(&found.ty, &self.scope),
        };
        if self.tokens.get(self.at).is_none_or(|token| token.kind != TokenKind::Colon) {
            let why = format!(
                "after `{}` and the name of one, such as `{variable}`, a colon is expected: \
                 `{} {variable}: …`",
                self.words(at, at + 1 + found.length),
                self.words(at, at + 1 + found.length),
            );
            return Err(NotUnderstood::new(self.here(), why));
        }
        self.at += 1;
        self.scope.push(variable.clone());
        let inner = self.whole_piece();
        self.scope.pop();
        Ok(quantify(found.is_every, variable, found.ty, inner?))
    }

    /// Reads `if … then …`.
    fn conditional_piece(&mut self) -> Result<Condition, NotUnderstood> {
        self.at += 1;
        let premise = self.whole_piece()?;
        // A comma may stand before `then`.
        if self.is_comma(self.at) && self.is_word(self.at + 1, &self.book.grammar.then) {
            self.at += 1;
        }
        if !self.is_word(self.at, &self.book.grammar.then) {
            let then = self.book.grammar.then.first().map_or("then", String::as_str);
            let why = format!("`{then}` is expected after the condition");
            return Err(NotUnderstood::new(self.here(), why));
        }
        self.at += 1;
        let conclusion = self.whole_piece()?;
        Ok(Condition::Imply(Box::new(premise), Box::new(conclusion)))
    }

    /// Reads units joined by `and`, by `or`, or by commas only.
    fn group(&mut self) -> Result<PhrasePiece, NotUnderstood> {
        let start = self.at;
        let mut units = vec![self.unit()?];
        let mut connective: Option<Connective> = None;
        loop {
            if let Some(next) = self.connective(self.at) {
                if connective.is_some_and(|known| known != next) {
                    return Err(self.refuse_mixture(start));
                }
                connective = Some(next);
                self.at += 1;
            } else if self.is_comma(self.at)
                && self.connective(self.at + 1).is_none()
                && !self.is_word(self.at + 1, &self.book.grammar.then)
                && self.at + 1 < self.tokens.len()
            {
                self.at += 1;
            } else {
                break;
            }
            units.push(self.unit()?);
        }
        let only = if units.len() == 1 { units.pop() } else { None };
        Ok(match (only, connective) {
            (Some(only), _) => PhrasePiece::One(only),
            (None, Some(connective)) => PhrasePiece::One(connective.join(units)),
            (None, None) => PhrasePiece::List(units),
        })
    }

    fn unit(&mut self) -> Result<Condition, NotUnderstood> {
        let Some(token) = self.tokens.get(self.at) else {
            return Err(self.refuse_end());
        };
        match token.kind {
            TokenKind::Embedded => return self.embedded(),
            TokenKind::Unclosed => {
                let why = "unclosed `(`; PDDL stands between `(` and `)`";
                return Err(NotUnderstood::new(Span::new(token.start, token.start + 1), why));
            }
            _ => (),
        }
        if self.is_word(self.at, &self.book.grammar.not) {
            self.descend()?;
            self.at += 1;
            let inner = self.unit()?;
            self.depth -= 1;
            return Ok(Condition::Not(Box::new(inner)));
        }
        match self.sentence() {
            Some(condition) => Ok(condition),
            None => Err(nearest::refuse(self, self.at)),
        }
    }

    /// Reads PDDL in parentheses.
    fn embedded(&mut self) -> Result<Condition, NotUnderstood> {
        let token = &self.tokens[self.at];
        let read = pddl::parse_condition(token.text).into_result();
        let condition = read.map_err(|found| {
            let first = found.iter().find(|one| one.is_error());
            let (span, why) = match first {
                Some(one) => (one.span, one.message.clone()),
                None => (Span::new(0, 0), "it is no PDDL".to_owned()),
            };
            let start = token.start + span.start as usize;
            NotUnderstood::new(Span::new(start, token.start + span.end as usize), why)
        })?;
        self.at += 1;
        Ok(condition)
    }

    /// Reads a sentence: the longest one that is followed by what may follow.
    fn sentence(&mut self) -> Option<Condition> {
        let mut matches: Vec<(&Phrase, PhraseMatch)> = Vec::new();
        let book = self.book;
        for phrase in &book.phrases {
            matches.extend(self.phrase(&phrase.pattern, self.at).map(|found| (phrase, found)));
        }
        matches.sort_by_key(|(_, found)| std::cmp::Reverse(found.end));
        matches.into_iter().find_map(|(phrase, found)| match phrase.kind {
            PhraseKind::Function => self.comparison(phrase, found),
            _ => self.may_end(found.end).then(|| {
                self.at = found.end;
                self.condition(found.arguments, |terms| atom(phrase, terms))
            }),
        })
    }

    /// Reads the comparison after the phrase of a function.
    fn comparison(&mut self, left: &Phrase, found: PhraseMatch) -> Option<Condition> {
        let (comparison, after) = self.comparison_words(found.end)?;
        let mut arguments = found.arguments;
        let arity = left.pattern.arity;
        if let Some((number, end)) = self.number(&left.symbol, after) {
            self.at = end;
            let right = Expression::Number(Number(number));
            return Some(self.condition(arguments, |terms| {
                compare(comparison, fluent(&left.symbol, terms), right.clone())
            }));
        }
        let book = self.book;
        let functions = book.phrases.iter().filter(|phrase| phrase.kind == PhraseKind::Function);
        let (right, found) = functions
            .filter_map(|phrase| Some((phrase, self.phrase(&phrase.pattern, after)?)))
            .filter(|(_, found)| self.may_end(found.end))
            .max_by_key(|(_, found)| found.end)?;
        self.at = found.end;
        arguments.extend(found.arguments.into_iter().map(|(index, one)| (index + arity, one)));
        Some(self.condition(arguments, |mut terms| {
            let others = terms.split_off(arity);
            let right = Expression::Fluent(fluent(&right.symbol, others));
            compare(comparison, fluent(&left.symbol, terms), right)
        }))
    }

    /// Reads the words of a comparison. Returns the comparison and the position after them.
    pub(crate) fn comparison_words(&self, at: usize) -> Option<(Comparison, usize)> {
        let mut best = None::<(Comparison, usize)>;
        for comparison in COMPARISONS {
            for words in self.book.comparison(comparison) {
                if let Some(end) = self.words_end(words, at)
                    && best.is_none_or(|(_, known)| known < end)
                {
                    best = Some((comparison, end));
                }
            }
        }
        best
    }

    /// Reads a number and the unit of `function`. Returns the number and the position after them.
    pub(crate) fn number(&self, function: &Name, at: usize) -> Option<(f64, usize)> {
        let token = self.tokens.get(at).filter(|token| token.is_word())?;
        let (digits, glued) = numbers::split(token.text);
        let number = numbers::read(digits, self.book.grammar.decimal)?;
        let units = self.book.units(function);
        if !glued.is_empty() {
            let is_unit = units.iter().any(|unit| unit.eq_ignore_ascii_case(glued));
            return (is_unit && self.may_end(at + 1)).then_some((number, at + 1));
        }
        let ends = units.iter().filter_map(|unit| self.words_end(unit, at + 1));
        let end = ends.max().unwrap_or(at + 1);
        self.may_end(end).then_some((number, end))
    }

    /// Returns the position after the words of `phrase`; `None` if they do not stand at `at`.
    fn words_end(&self, phrase: &str, at: usize) -> Option<usize> {
        let mut end = at;
        for word in phrase.split_whitespace() {
            let token = self.tokens.get(end).filter(|token| token.is_word())?;
            if token.lower != word.to_lowercase() {
                return None;
            }
            end += 1;
        }
        Some(end)
    }

    /// Reads a phrase at the position `start`.
    fn phrase(&self, pattern: &Pattern, start: usize) -> Option<PhraseMatch> {
        let (mut end, mut arguments) = (start, Vec::new());
        for part in &pattern.parts {
            let token = self.tokens.get(end).filter(|token| token.is_word())?;
            match part {
                PhrasePart::Word { lower, .. } if token.lower != *lower => return None,
                PhrasePart::Word { .. } => end += 1,
                PhrasePart::Place { index, .. } => {
                    let (argument, after) = self.argument(end)?;
                    arguments.push((*index, argument));
                    end = after;
                }
            }
        }
        Some(PhraseMatch { end, arguments })
    }

    /// Reads an argument: an object, a variable or a quantifier.
    fn argument(&self, at: usize) -> Option<(PhraseArgument, usize)> {
        let found = self.book.quantifiers.read(&self.tokens[at..]);
        if let Some(found) = found.filter(|found| self.names.has_type(&found.ty)) {
            let mut end = at + found.length;
            let named = self.tokens.get(end).and_then(|token| token.text.strip_prefix('?'));
            let variable = named.filter(|name| is_name(name)).map(Name::new);
            end += usize::from(variable.is_some());
            let (is_every, ty) = (found.is_every, found.ty);
            return Some((PhraseArgument::Quantified { is_every, ty, variable }, end));
        }
        let term = self.term(self.tokens.get(at)?)?;
        Some((PhraseArgument::Term(term), at + 1))
    }

    /// Returns the variable or object that a word names; `None` if it names none.
    pub(crate) fn term(&self, token: &Token<'_>) -> Option<Term> {
        let bare = token.text.strip_prefix('?').unwrap_or(token.text);
        let lower = bare.to_lowercase();
        if let Some(variable) = self.scope.iter().rev().find(|name| name.as_str() == lower) {
            return Some(Term::Variable(variable.clone()));
        }
        if bare.len() < token.text.len() {
            return None;
        }
        if let Some(object) = self.names.object(bare) {
            return Some(Term::Object(object.clone()));
        }
        let is_free = self.names.is_open() && is_name(bare) && !self.is_reserved(&token.lower);
        is_free.then(|| Term::Object(Name::new(bare)))
    }

    fn is_reserved(&self, word: &str) -> bool {
        let grammar = &self.book.grammar;
        let lists = [&grammar.and, &grammar.or, &grammar.not, &grammar.then];
        lists.iter().any(|words| words.iter().any(|reserved| reserved == word))
    }

    /// Makes a condition of the arguments in the order of the text: a quantifier for each argument
    /// that has one, the first one outermost.
    fn condition(
        &self,
        arguments: Vec<(usize, PhraseArgument)>,
        inner: impl FnOnce(Vec<Term>) -> Condition,
    ) -> Condition {
        let mut taken = self.scope.clone();
        let mut quantifiers = Vec::new();
        let mut terms: Vec<(usize, Term)> = Vec::with_capacity(arguments.len());
        for (index, argument) in arguments {
            let term = match argument {
                PhraseArgument::Term(term) => term,
                PhraseArgument::Quantified { is_every, ty, variable } => {
                    let name = variable.unwrap_or_else(|| default_name(&ty, &taken));
                    taken.push(name.clone());
                    quantifiers.push((is_every, name.clone(), ty));
                    Term::Variable(name)
                }
            };
            terms.push((index, term));
        }
        terms.sort_by_key(|(index, _)| *index);
        let inner = inner(terms.into_iter().map(|(_, term)| term).collect());
        let wrap = |inner, (is_every, name, ty)| quantify(is_every, name, ty, inner);
        quantifiers.into_iter().rev().fold(inner, wrap)
    }

    // === looking ahead ===

    fn rest(&self, after: usize) -> &[Token<'_>] {
        self.tokens.get(self.at + after..).unwrap_or_default()
    }

    pub(crate) fn is_word(&self, at: usize, words: &[String]) -> bool {
        self.tokens.get(at).is_some_and(|token| token.is_word() && words.contains(&token.lower))
    }

    pub(crate) fn is_comma(&self, at: usize) -> bool {
        self.tokens.get(at).is_some_and(|token| token.kind == TokenKind::Comma)
    }

    pub(crate) fn connective(&self, at: usize) -> Option<Connective> {
        let grammar = &self.book.grammar;
        match at {
            _ if self.is_word(at, &grammar.and) => Some(Connective::And),
            _ if self.is_word(at, &grammar.or) => Some(Connective::Or),
            _ => None,
        }
    }

    /// Returns the connective after a comma.
    fn loose_connective(&self) -> Option<Connective> {
        if self.is_comma(self.at) { self.connective(self.at + 1) } else { None }
    }

    /// Whether a sentence may end before the token `at`.
    pub(crate) fn may_end(&self, at: usize) -> bool {
        match self.tokens.get(at) {
            None => true,
            Some(token) => {
                token.kind == TokenKind::Comma
                    || self.connective(at).is_some()
                    || self.is_word(at, &self.book.grammar.then)
            }
        }
    }

    pub(crate) fn words(&self, from: usize, to: usize) -> &str {
        let start = self.tokens.get(from).map_or(self.text.len(), |token| token.start);
        let last = to.checked_sub(1).and_then(|last| self.tokens.get(last));
        let end = last.map_or(self.text.len(), |token| token.start + token.text.len());
        self.text.get(start..end.max(start)).unwrap_or_default()
    }

    /// Returns the text with the bytes `from..to` replaced.
    pub(crate) fn replaced(&self, from: usize, to: usize, by: &str) -> String {
        let before = self.text.get(..from).unwrap_or_default().trim_start();
        let after = self.text.get(to..).unwrap_or_default().trim_end();
        format!("{before}{by}{after}").trim().to_owned()
    }

    /// Whether texts may be suggested; not while too many mistakes are corrected already.
    pub(crate) fn may_suggest(&self) -> bool {
        self.corrections > 0
    }

    /// Whether this text is the one that was written, and not a corrected one.
    pub(crate) fn is_first_correction(&self) -> bool {
        self.corrections == CORRECTIONS_MAX
    }

    /// Returns the number of texts that may be suggested. Of a corrected text, one is enough.
    pub(crate) fn suggested_max(&self) -> usize {
        if self.is_first_correction() { SUGGESTED_MAX } else { 1 }
    }

    /// Whether the condition that is read stands within no other one.
    pub(crate) fn is_outermost_piece(&self) -> bool {
        self.depth == 1
    }

    pub(crate) fn here(&self) -> Span {
        let end = self.text.trim_end().len();
        self.tokens.get(self.at).map_or(Span::new(end, end), Token::span)
    }
}

fn quantify(is_every: bool, name: Name, ty: Name, inner: Condition) -> Condition {
    let variables = vec![Typed { name, ty: TypeExpr::of(ty) }];
    match is_every {
        true => Condition::Forall(variables, Box::new(inner)),
        false => Condition::Exists(variables, Box::new(inner)),
    }
}

fn atom(phrase: &Phrase, arguments: Vec<Term>) -> Condition {
    let span = Span::default();
    if let (PhraseKind::Same, [one, other]) = (phrase.kind, arguments.as_slice()) {
        return Condition::Equal(one.clone(), other.clone(), span);
    }
    let atom = Condition::Atom(Atom { predicate: phrase.symbol.clone(), arguments, span });
    match phrase.kind {
        PhraseKind::Negation => Condition::Not(Box::new(atom)),
        _ => atom,
    }
}

fn fluent(function: &Name, arguments: Vec<Term>) -> FluentTerm {
    FluentTerm { function: function.clone(), arguments, span: Span::default() }
}

fn compare(comparison: Comparison, left: FluentTerm, right: Expression) -> Condition {
    let left = Expression::Fluent(left);
    Condition::Compare(Box::new(Compare { comparison, left, right, span: Span::default() }))
}
