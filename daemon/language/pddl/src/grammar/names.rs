//! Grammar of names, variables, terms and typed lists.

use super::reader::{GrammarReader, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, NodeContent, SyntaxNode};
use crate::tree::{Name, Number, Span, Term, TypeExpr, Typed};

const NAME: &str = "NAME = a letter or digit, then letters, digits, `-` and `_`";
const VARIABLE: &str = "VARIABLE = ?NAME";
/// Maximum number of alternatives of a type; a type with more is an error. Every name of a typed
/// list has its own copy of the type, and types are compared pairwise. With the limit, a short text
/// cannot become many large types.
const ALTERNATIVES_MAX: usize = 16;

/// Maximum number of words that a message quotes from a list of variables without parentheses.
/// Further words are replaced by “…”.
const BARE_WORDS_MAX: usize = 12;

const TYPE: &str = "TYPE = NAME | (either NAME+)";

/// Kind of the entries of a typed list.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ListEntryKind {
    Variables,
    Names,
}

/// Whether a word is a keyword in places where a predicate or a function may occur.
pub(super) fn is_reserved(word: &str) -> bool {
    if word.len() > "scale-down".len() {
        return false;
    }
    let reserved = super::reader::Keyword::of(word);
    matches!(
        reserved.as_str(),
        "and"
            | "or"
            | "not"
            | "imply"
            | "exists"
            | "forall"
            | "when"
            | "either"
            | "="
            | "<"
            | "<="
            | ">"
            | ">="
            | "+"
            | "-"
            | "*"
            | "/"
            | "assign"
            | "increase"
            | "decrease"
            | "scale-up"
            | "scale-down"
    )
}

/// Parses a `NAME`. In messages, `what` describes the purpose of the name.
pub(super) fn name<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    what: &str,
) -> Option<Name> {
    match node.content() {
        NodeContent::Symbol(word) => checked_name(reader, word, word, node.span(), what),
        NodeContent::List(_) => {
            let message = format!("expected {what}, found `{}`", excerpt(node));
            reader.report(Diagnostic::error(node.span(), message).with_rule(NAME));
            None
        }
        NodeContent::Damaged => None,
    }
}

/// Parses the `NAME` of a predicate or function with arguments. Keywords and numbers are reported.
pub(super) fn applied<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    what: &str,
    rule: &'static str,
) -> Option<Name> {
    let name = name(reader, node, what)?;
    if !is_reserved(name.as_str()) && number(name.as_str()).is_none() {
        return Some(name);
    }
    let message = format!("expected {what}, found `{name}`");
    reader.report(Diagnostic::error(node.span(), message).with_rule(rule));
    None
}

/// Parses a variable: `?NAME`.
pub(super) fn variable<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Name> {
    variable_after(reader, node, false)
}

/// Parses a variable: `?NAME`. A word without `?` after a variable without a type is probably a
/// type with a missing dash.
fn variable_after<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    is_after_variable: bool,
) -> Option<Name> {
    let Some(word) = node.symbol() else {
        return name(reader, node, "a variable");
    };
    if let Some(bare) = word.strip_prefix('?') {
        return checked_name(reader, bare, word, node.span(), "a variable");
    }
    let diagnostic = Diagnostic::error(node.span(), format!("expected a variable, found `{word}`"));
    let help = match is_after_variable {
        true => format!("write `- {word}` for the type of the variable before it, or `?{word}`"),
        false => format!("write `?{word}`"),
    };
    reader.report(diagnostic.with_help(help).with_rule(VARIABLE));
    None
}

/// Parses a term: `VARIABLE | NAME`.
pub(super) fn term<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Term> {
    if node.symbol().is_some_and(|word| word.starts_with('?')) {
        variable(reader, node).map(Term::Variable)
    } else {
        name(reader, node, "a variable or an object").map(Term::Object)
    }
}

/// Parses any number of terms: `TERM*`.
pub(super) fn terms<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Option<Vec<Term>> {
    let mut terms = Vec::with_capacity(items.count());
    let mut complete = true;
    for node in items {
        match term(reader, node) {
            Some(term) => terms.push(term),
            None => complete = false,
        }
    }
    complete.then_some(terms)
}

/// Parses a number; `None` if the word is not a number.
pub(super) fn number(word: &str) -> Option<Number> {
    let digits = word.strip_prefix(['-', '+']).unwrap_or(word);
    let starts_well =
        digits.strip_prefix('.').unwrap_or(digits).starts_with(|c: char| c.is_ascii_digit());
    if !starts_well {
        return None;
    }
    word.parse().ok().filter(|value: &f64| value.is_finite()).map(Number)
}

/// Parses a number, with a warning if it has more digits than are stored; `None` if the node is not
/// a number.
pub(super) fn numeral<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Number> {
    let word = node.symbol()?;
    let value = number(word)?;
    if !keeps_digits(word, value) {
        let message = format!("`{}` has more digits than are kept", excerpt(node));
        let warning = Diagnostic::warning(node.span(), message);
        reader.report(warning.with_help(format!("it is read as {value}")));
    }
    Some(value)
}

/// Whether the stored value has all digits of a number. Fifteen digits are always stored, and often
/// more.
fn keeps_digits(word: &str, value: Number) -> bool {
    /// Number of digits that every 64-bit binary number preserves.
    const KEPT: usize = 15;
    if word.len() <= KEPT {
        return true;
    }
    let written = significant_digits(word);
    written.len() <= KEPT || written == significant_digits(&value.to_string())
}

/// Returns the significant digits of a number, without sign, point, exponent, leading zeros and
/// trailing zeros.
fn significant_digits(word: &str) -> String {
    let mantissa = word.split(['e', 'E']).next().unwrap_or("");
    let digits: String = mantissa.chars().filter(char::is_ascii_digit).collect();
    digits.trim_matches('0').to_owned()
}

/// Parses the variables of an action, a quantifier or an axiom: `(VARIABLE* [- TYPE])*`.
pub(super) fn variables<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Vec<Typed> {
    typed_list(reader, items, ListEntryKind::Variables)
}

/// Parses variables in parentheses: `(VARIABLES)`. `node` is the first node, and `rest` are the
/// items after it.
///
/// Missing parentheses are reported. In this case the variables end before the first item for which
/// `is_end` returns `true`.
pub(super) fn listed_variables<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    rest: &mut Items<'f>,
    is_end: impl Fn(SyntaxNode<'f>) -> bool,
    rule: &'static str,
) -> Vec<Typed> {
    if !node.symbol().is_some_and(|word| word.starts_with('?')) {
        let items = reader.expect_list(node, "a list of variables", rule);
        return items.map(|items| variables(reader, items)).unwrap_or_default();
    }
    let bare = rest.until(is_end);
    *rest = rest.after(bare);
    let bare = node.with(bare);
    let words: Vec<&str> = bare.take(BARE_WORDS_MAX).map(SyntaxNode::text).collect();
    let more = if bare.count() > words.len() { " …" } else { "" };
    let message = "the parentheses around the variables are missing";
    let missing = Diagnostic::error(node.span(), message).with_rule(rule);
    reader.report(missing.with_help(format!("write `({}{more})`", words.join(" "))));
    variables(reader, bare)
}

/// Parses a list of entries with their types: `(ENTRY* [- TYPE])*`.
pub(super) fn typed_list<'f>(
    reader: &mut GrammarReader<'f>,
    mut items: Items<'f>,
    entries: ListEntryKind,
) -> Vec<Typed> {
    let mut typed: Vec<Typed> = Vec::new();
    let mut untyped_from = 0;
    while let Some(node) = items.next() {
        let ty = match node.symbol() {
            Some("-") => opt_type(reader, &mut items, node),
            Some(word) if word.starts_with('-') => glued_type(reader, node, &word[1..]),
            _ => {
                let entry = match entries {
                    ListEntryKind::Variables => {
                        variable_after(reader, node, untyped_from < typed.len())
                    }
                    ListEntryKind::Names => name(reader, node, "a name"),
                };
                typed.extend(entry.map(|name| Typed { name, ty: TypeExpr::default() }));
                continue;
            }
        };
        if let Some(ty) = ty {
            // The last entry of a group takes the type itself; the other entries get copies.
            for entry in &mut typed[untyped_from..] {
                entry.ty.clone_from(&ty);
            }
        }
        untyped_from = typed.len();
    }
    typed
}

/// Parses the `TYPE` after a dash; `dash` is the node of the dash.
pub(super) fn opt_type<'f>(
    reader: &mut GrammarReader<'f>,
    items: &mut Items<'f>,
    dash: SyntaxNode<'f>,
) -> Option<TypeExpr> {
    let Some(node) = items.next() else {
        let missing = Diagnostic::error(dash.span(), "no type after `-`").with_rule(TYPE);
        reader.report(missing);
        return None;
    };
    type_expr(reader, node)
}

/// Parses `-TYPE`, and reports the missing space after the dash.
fn glued_type<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    word: &'f str,
) -> Option<TypeExpr> {
    let span = Span { start: node.span().start + 1, ..node.span() };
    let glued = Diagnostic::warning(node.span(), format!("no space between `-` and `{word}`"));
    reader.report(glued.with_help(format!("write `- {word}`")));
    let name = checked_name(reader, word, word, span, "a type")?;
    Some(TypeExpr { alternatives: vec![name] })
}

/// Parses a type: `NAME | (either NAME+)`.
pub(super) fn type_expr<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<TypeExpr> {
    let Some(mut items) = node.list() else {
        return name(reader, node, "a type").map(|name| TypeExpr { alternatives: vec![name] });
    };
    let either = items.next().and_then(SyntaxNode::symbol).unwrap_or("");
    if !either.eq_ignore_ascii_case("either") || items.peek().is_none() {
        let message = format!("expected a type, found `{}`", excerpt(node));
        reader.report(Diagnostic::error(node.span(), message).with_rule(TYPE));
        return None;
    }
    if items.count() > ALTERNATIVES_MAX {
        let message = format!("an `either` of more than {ALTERNATIVES_MAX} types");
        let large = Diagnostic::error(node.span(), message).with_rule(TYPE);
        reader.report(large.with_help("give them a supertype in common"));
        return None;
    }
    let alternatives = items.filter_map(|node| name(reader, node, "a type")).collect();
    Some(TypeExpr { alternatives })
}

/// Returns `bare` as a name if it is valid, and otherwise reports it. `word` is the spelling in the
/// text.
fn checked_name<'f>(
    reader: &mut GrammarReader<'f>,
    bare: &'f str,
    word: &str,
    span: Span,
    what: &str,
) -> Option<Name> {
    // Fast path: nearly all names have only letters, digits, `-` and `_`.
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
    if bare.bytes().all(is_plain) && bare.bytes().next().is_some_and(|byte| byte != b'-') {
        return Some(reader.intern(bare, span));
    }
    let wrong_start = bare.starts_with(['-', ':', '?']) || bare.is_empty();
    let stranger = bare.chars().find(|c| is_strange(*c));
    if !wrong_start && stranger.is_none() {
        return Some(reader.intern(bare, span));
    }
    let mut diagnostic =
        Diagnostic::error(span, format!("expected {what}, found `{word}`")).with_rule(NAME);
    if bare.starts_with('?') {
        diagnostic.help = Some("variables have no place here".to_owned());
    } else if let Some(stranger) = stranger {
        let code = u32::from(stranger);
        diagnostic.help = Some(match stranger.is_whitespace() {
            true => format!("U+{code:04X} looks like a space, but is none in PDDL"),
            false if stranger == ',' => "separate names by spaces, not by commas".to_owned(),
            false if is_visible(stranger) => format!("a name cannot hold `{stranger}`"),
            false => format!("a name cannot hold U+{code:04X}, which cannot be seen"),
        });
    }
    reader.report(diagnostic);
    None
}

/// Whether a forbidden character would be visible in a message.
fn is_visible(c: char) -> bool {
    !c.is_control() && c != '\u{feff}'
}

/// Whether a character is forbidden in names, even though the parser is lenient: punctuation of
/// other languages, and invisible characters.
fn is_strange(c: char) -> bool {
    match c {
        '?' | '"' | '\'' | '`' | '[' | ']' | '{' | '}' | ',' | '\\' | '\u{feff}' => true,
        _ => c.is_control() || (!c.is_ascii() && c.is_whitespace()),
    }
}
