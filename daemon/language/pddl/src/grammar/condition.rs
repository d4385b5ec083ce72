//! Grammar of the conditions of actions, effects, axioms and goals.

use super::expression;
use super::names;
use super::reader::{ExpressionPlace, GrammarReader, Keyword, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, NodeContent, SyntaxNode};
use crate::tree::{Atom, Compare, Comparison, Condition, Span, Typed};

const CONDITION: &str = "(PREDICATE TERM*) | (not|and|or|imply CONDITION*) \
    | (exists|forall (VARIABLES) CONDITION) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)";
const ATOM: &str = "(PREDICATE TERM*)";
const NOT: &str = "(not CONDITION)";
const IMPLY: &str = "(imply CONDITION CONDITION)";
const QUANTIFIED: &str = "(exists|forall (VARIABLES) CONDITION)";
const COMPARE: &str = "(COMPARISON EXPRESSION EXPRESSION)";
const EQUAL: &str = "(= TERM TERM) | (= EXPRESSION EXPRESSION)";

/// Parses a condition: `() | (PREDICATE TERM*) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)
/// | (not CONDITION) | (and CONDITION*) | (or CONDITION*) | (imply CONDITION CONDITION) | (exists
/// (VARIABLES) CONDITION) | (forall (VARIABLES) CONDITION)`.
pub(crate) fn condition<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<Condition> {
    let (word, items) = match headed(reader, node, "a condition", CONDITION)? {
        Headed::Empty => return Some(Condition::always()),
        Headed::By(word, items) => (word, items),
    };
    match Keyword::of(word).as_str() {
        "and" => Some(Condition::And(conditions(reader, items))),
        "or" => Some(Condition::Or(conditions(reader, items))),
        "not" => not(reader, items),
        "imply" => imply(reader, items),
        "exists" => {
            let (variables, body) = quantified(reader, items)?;
            Some(Condition::Exists(variables, body))
        }
        "forall" => {
            let (variables, body) = quantified(reader, items)?;
            Some(Condition::Forall(variables, body))
        }
        "=" => equal(reader, items, node.span()),
        "<" => compare(reader, Comparison::Less, items, node.span()),
        "<=" => compare(reader, Comparison::LessOrEqual, items, node.span()),
        ">=" => compare(reader, Comparison::GreaterOrEqual, items, node.span()),
        ">" => compare(reader, Comparison::Greater, items, node.span()),
        // A preference contains a condition, which is a list. Without a list, `preference` is the
        // name of a predicate.
        "preference" if items.into_iter().any(|item| item.list().is_some()) => {
            preference(reader, node, items)
        }
        "always" | "sometime" | "within" | "at-most-once" | "sometime-after"
        | "sometime-before" | "always-within" | "hold-during" | "hold-after"
            if items.into_iter().any(|item| item.list().is_some()) =>
        {
            unsupported(reader, node, &format!("constraints on trajectories (`{word}`)"))
        }
        "when" => misplaced(reader, node, "`when` belongs to effects", "write `imply`"),
        "assign" | "increase" | "decrease" | "scale-up" | "scale-down" => {
            let help = "compare with `<`, `<=`, `=`, `>=` or `>`";
            misplaced(reader, node, "a numeric effect is no condition", help)
        }
        _ => atom(reader, node).map(Condition::Atom),
    }
}

/// Parses a predicate with its arguments: `(PREDICATE TERM*)`.
pub(super) fn atom<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Atom> {
    let mut items = reader.expect_list(node, "an atom", ATOM)?;
    let head = reader.expect(&mut items, "predicate", ATOM)?;
    if let Some(help) = foreign(head.symbol().unwrap_or("")) {
        let message = format!("PDDL has no `{}`", excerpt(head));
        reader.report(Diagnostic::error(head.span(), message).with_help(help));
        return None;
    }
    let predicate = names::applied(reader, head, "a predicate", ATOM)?;
    if let Some(argument) = items.into_iter().find(|node| node.list().is_some()) {
        return nested(reader, head, argument);
    }
    let arguments = names::terms(reader, items)?;
    Some(Atom { predicate, arguments, span: node.span() })
}

/// Returns advice to replace an operator of another language by PDDL; `None` for any other word.
fn foreign(word: &str) -> Option<&'static str> {
    Some(match word {
        "!=" | "<>" | "/=" | "~=" | "≠" => "write `(not (= … …))`",
        "==" => "write `(= … …)`",
        "&&" | "&" | "∧" => "write `(and … …)`",
        "||" | "|" | "∨" => "write `(or … …)`",
        "!" | "~" | "¬" => "write `(not …)`",
        "->" | "=>" | "→" | "⇒" => "write `(imply … …)`",
        "<->" | "<=>" | "↔" | "⇔" => EQUIVALENCE,
        "≤" => "write `(<= … …)`",
        "≥" => "write `(>= … …)`",
        "∃" => "write `(exists (VARIABLES) CONDITION)`",
        "∀" => "write `(forall (VARIABLES) CONDITION)`",
        "+=" => "write `(increase FLUENT EXPRESSION)`",
        "-=" => "write `(decrease FLUENT EXPRESSION)`",
        ":=" => "write `(assign FLUENT EXPRESSION)`",
        _ => return None,
    })
}

/// Keywords of conditions and effects with arguments that are not terms.
const KEYWORDS: &[&str] = &[
    "and",
    "or",
    "not",
    "imply",
    "exists",
    "forall",
    "when",
    "assign",
    "increase",
    "decrease",
    "scale-up",
    "scale-down",
];

const EQUIVALENCE: &str = "write `(and (imply A B) (imply B A))`";

/// Returns advice to replace an operator that other languages write as a word; `None` for any other
/// word.
fn foreign_word(word: &str) -> Option<&'static str> {
    Some(match Keyword::of(word).as_str() {
        "implies" | "implied" | "implication" => "did you mean `imply`?",
        "if" => "write `(imply A B)` in a condition, and `(when CONDITION EFFECT)` in an effect",
        "iff" | "equiv" | "equivalent" => EQUIVALENCE,
        "some" | "forsome" | "for-some" | "any" | "there-exists" => "did you mean `exists`?",
        "every" | "each" | "foreach" | "for-each" => "did you mean `forall`?",
        "xor" => "write `(or (and A (not B)) (and (not A) B))`",
        "nand" => "write `(not (and …))`",
        "nor" => "write `(not (or …))`",
        "eq" | "equal" | "equals" => "did you mean `=`?",
        "set" => "did you mean `assign`?",
        _ => return None,
    })
}

/// Reports a predicate with a list as an argument. If the predicate is similar to a keyword, or an
/// operator of another language, what PDDL has instead is proposed.
fn nested<T>(
    reader: &mut GrammarReader<'_>,
    head: SyntaxNode<'_>,
    argument: SyntaxNode<'_>,
) -> Option<T> {
    let word = head.symbol().unwrap_or("");
    if let Some(help) = foreign_word(word) {
        let unknown = Diagnostic::error(head.span(), format!("unknown keyword `{word}`"));
        reader.report(unknown.with_help(help));
        return None;
    }
    let near = reader.nearest(word, KEYWORDS.iter().copied());
    let diagnostic = match near {
        Some(_) => Diagnostic::error(head.span(), format!("unknown keyword `{word}`")),
        None => {
            let message =
                format!("expected a variable or an object, found `{}`", excerpt(argument));
            Diagnostic::error(argument.span(), message).with_rule(ATOM)
        }
    };
    reader.report(diagnostic.with_suggestion(near));
    None
}

/// A list, split after its first word.
pub(super) enum Headed<'f> {
    /// The empty list `()`.
    Empty,
    /// A list `(WORD …)`: the word, and the items after it.
    By(&'f str, Items<'f>),
}

/// Splits the list `()` or `(WORD …)` after its first word. For any other node, reports that `what`
/// is expected.
pub(super) fn headed<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    what: &str,
    rule: &'static str,
) -> Option<Headed<'f>> {
    let mut items = match node.content() {
        NodeContent::List(_) if reader.is_already_reported(node) => return None,
        NodeContent::List(items) => items,
        NodeContent::Symbol(_) if reader.report_call(node) => return None,
        NodeContent::Symbol(word) => {
            let message = format!("expected {what}, found `{word}`");
            let diagnostic = Diagnostic::error(node.span(), message).with_rule(rule);
            reader.report(diagnostic.with_help(format!("write `({word})`")));
            return None;
        }
        NodeContent::Damaged => return None,
    };
    let Some(head) = items.next() else { return Some(Headed::Empty) };
    match head.content() {
        NodeContent::Symbol(word) => Some(Headed::By(word, items)),
        NodeContent::List(_) => {
            let message = format!("{what} begins with a word, not with `{}`", excerpt(head));
            let diagnostic = Diagnostic::error(head.span(), message).with_rule(rule);
            reader.report(diagnostic.with_help("several are joined by `(and …)`"));
            None
        }
        NodeContent::Damaged => None,
    }
}

/// Reports a PDDL feature that this crate does not support. Returns `None`.
pub(super) fn unsupported<T>(
    reader: &mut GrammarReader<'_>,
    node: SyntaxNode<'_>,
    what: &str,
) -> Option<T> {
    reader.report(Diagnostic::unsupported(node.span(), format!("{what} are not supported")));
    None
}

/// Parses `(preference [NAME] CONDITION)` to find mistakes in the condition, then reports the
/// preference as unsupported.
fn preference<'f, T>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    mut items: Items<'f>,
) -> Option<T> {
    if items.peek().is_some_and(|first| first.symbol().is_some()) {
        items.next();
    }
    for inner in items {
        condition(reader, inner);
    }
    unsupported(reader, node, "preferences")
}

/// Reports a node in the wrong place. Returns `None`.
pub(super) fn misplaced<T>(
    reader: &mut GrammarReader<'_>,
    node: SyntaxNode<'_>,
    message: &str,
    help: &str,
) -> Option<T> {
    reader.report(Diagnostic::error(node.span(), message).with_help(help));
    None
}

/// Parses any number of conditions: `CONDITION*`.
fn conditions<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>) -> Vec<Condition> {
    items.filter_map(|node| condition(reader, node)).collect()
}

/// Parses a negation, `(not CONDITION)`; `items` are the items after the keyword.
fn not<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<Condition> {
    let node = reader.expect(&mut items, "condition", NOT)?;
    let inner = condition(reader, node);
    reader.expect_end(items, "`not`", NOT);
    inner.map(|inner| Condition::Not(Box::new(inner)))
}

/// Parses an implication, `(imply CONDITION CONDITION)`; `items` are the items after the keyword.
fn imply<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<Condition> {
    let premise = reader.expect(&mut items, "condition", IMPLY)?;
    let premise = condition(reader, premise);
    let conclusion = reader.expect(&mut items, "second condition", IMPLY)?;
    let conclusion = condition(reader, conclusion);
    reader.expect_end(items, "`imply`", IMPLY);
    Some(Condition::Imply(Box::new(premise?), Box::new(conclusion?)))
}

/// Parses a quantifier after its keyword: `(VARIABLES) CONDITION`. Returns the variables and the
/// condition.
fn quantified<'f>(
    reader: &mut GrammarReader<'f>,
    mut items: Items<'f>,
) -> Option<(Vec<Typed>, Box<Condition>)> {
    let variables = reader.expect(&mut items, "list of variables", QUANTIFIED)?;
    let variables = names::listed_variables(reader, variables, &mut items, is_body, QUANTIFIED);
    let body = reader.expect(&mut items, "condition", QUANTIFIED)?;
    let body = condition(reader, body)?;
    reader.expect_end(items, "a quantifier", QUANTIFIED);
    Some((variables, Box::new(body)))
}

/// Whether an item after the variables of a quantifier is the quantified body, and not a type.
pub(super) fn is_body(node: SyntaxNode<'_>) -> bool {
    node.list().is_some() && !node.head().is_some_and(|word| word.eq_ignore_ascii_case("either"))
}

/// Parses an equation: `(= TERM TERM) | (= EXPRESSION EXPRESSION)`.
///
/// Two words are terms. If either side is a list or a number, the equation compares numbers, except
/// for `(= ?x 1)`: a variable stands for an object, so `1` is the name of one, too.
fn equal<'f>(reader: &mut GrammarReader<'f>, items: Items<'f>, span: Span) -> Option<Condition> {
    let is_list = |node: SyntaxNode<'f>| node.list().is_some();
    let is_of_objects =
        items.into_iter().any(is_object_variable) && !items.into_iter().any(is_list);
    if !is_of_objects && items.into_iter().any(|node| is_numeric(reader, node)) {
        return compare(reader, Comparison::Equal, items, span);
    }
    let mut items = items;
    let left = reader.expect(&mut items, "term", EQUAL)?;
    let left = names::term(reader, left);
    let right = reader.expect(&mut items, "second term", EQUAL)?;
    let right = names::term(reader, right);
    reader.expect_end(items, "`=`", EQUAL);
    Some(Condition::Equal(left?, right?, span))
}

/// Whether a node is a variable, and not the duration of an action.
fn is_object_variable(node: SyntaxNode<'_>) -> bool {
    let is_variable = |word: &str| word.starts_with('?') && !word.eq_ignore_ascii_case("?duration");
    node.symbol().is_some_and(is_variable)
}

fn is_numeric(reader: &GrammarReader<'_>, node: SyntaxNode<'_>) -> bool {
    match node.content() {
        NodeContent::List(_) => true,
        NodeContent::Symbol(word) => {
            let is_special = word.eq_ignore_ascii_case("?duration") || word == "#t";
            names::number(word).is_some()
                || (is_special && reader.place() == ExpressionPlace::Durative)
        }
        NodeContent::Damaged => false,
    }
}

/// Parses a comparison of numbers: `(COMPARISON EXPRESSION EXPRESSION)`.
fn compare<'f>(
    reader: &mut GrammarReader<'f>,
    comparison: Comparison,
    mut items: Items<'f>,
    span: Span,
) -> Option<Condition> {
    let left = reader.expect(&mut items, "expression", COMPARE)?;
    let left = expression::expression(reader, left);
    let right = reader.expect(&mut items, "second expression", COMPARE)?;
    let right = expression::expression(reader, right);
    reader.expect_end(items, "a comparison", COMPARE);
    let compare = Compare { comparison, left: left?, right: right?, span };
    Some(Condition::Compare(Box::new(compare)))
}
