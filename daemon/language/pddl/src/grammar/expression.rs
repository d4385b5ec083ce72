//! Grammar of numeric expressions.

use super::condition::{Headed, headed, unsupported};
use super::names;
use super::reader::{ExpressionPlace, GrammarReader, Keyword};
use crate::diagnostic::Diagnostic;
use crate::parentheses::too_deep;
use crate::sexpr::{Items, NodeContent, SyntaxNode};
use crate::tree::{Expression, FluentTerm, Operator, Span};

const EXPRESSION: &str = "NUMBER | (FUNCTION TERM*) | (- EXPRESSION) \
    | (+|* EXPRESSION EXPRESSION+) | (-|/ EXPRESSION EXPRESSION)";
const FLUENT: &str = "(FUNCTION TERM*)";

/// Parses a numeric expression:
/// `NUMBER | FUNCTION | (FUNCTION TERM*) | ?duration | #t | total-time | (total-time)
/// | (- EXPRESSION) | (+|* EXPRESSION EXPRESSION+) | (-|/ EXPRESSION EXPRESSION)`.
pub(super) fn expression<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<Expression> {
    if let NodeContent::Symbol(word) = node.content() {
        return word_expression(reader, node, word);
    }
    let (word, items) = match headed(reader, node, "an expression", EXPRESSION)? {
        Headed::By(word, items) => (word, items),
        Headed::Empty => {
            let empty = Diagnostic::error(node.span(), "expected an expression, found `()`");
            reader.report(empty.with_rule(EXPRESSION));
            return None;
        }
    };
    match word {
        "+" => apply(reader, Operator::Add, items, node.span()),
        "-" => apply(reader, Operator::Subtract, items, node.span()),
        "*" => apply(reader, Operator::Multiply, items, node.span()),
        "/" => apply(reader, Operator::Divide, items, node.span()),
        _ if is_total_time(reader, word) && items.peek().is_none() => {
            Some(Expression::TotalTime(node.span()))
        }
        _ if reader.place() == ExpressionPlace::Metric
            && word.eq_ignore_ascii_case("is-violated") =>
        {
            unsupported(reader, node, "preferences (`is-violated`)")
        }
        _ => fluent(reader, node).map(Expression::Fluent),
    }
}

/// Parses a function with its arguments: `(FUNCTION TERM*) | FUNCTION`.
pub(super) fn fluent<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<FluentTerm> {
    let mut items = match node.content() {
        NodeContent::List(items) => items,
        NodeContent::Symbol(_) if reader.report_call(node) => return None,
        NodeContent::Symbol(_) => node.alone(),
        NodeContent::Damaged => return None,
    };
    let head = reader.expect(&mut items, "function", FLUENT)?;
    let function = names::applied(reader, head, "a function", FLUENT)?;
    if items.into_iter().any(|node| node.list().is_some()) && is_arithmetic(function.as_str()) {
        let message = format!("PDDL has no `{function}`");
        let unknown = Diagnostic::error(head.span(), message).with_rule(EXPRESSION);
        reader.report(unknown.with_help("it computes with `+`, `-`, `*` and `/`"));
        return None;
    }
    let arguments = names::terms(reader, items)?;
    Some(FluentTerm { function, arguments, span: node.span() })
}

/// Whether a word is an operator of other languages on numbers.
fn is_arithmetic(word: &str) -> bool {
    matches!(
        word,
        "^" | "**"
            | "%"
            | "mod"
            | "div"
            | "min"
            | "max"
            | "abs"
            | "sqrt"
            | "pow"
            | "exp"
            | "log"
            | "floor"
            | "ceil"
            | "round"
            | "sum"
            | "plus"
            | "minus"
            | "times"
            | "×"
            | "·"
            | "÷"
    )
}

/// Parses an expression that is a single word: `NUMBER | FUNCTION | ?duration | #t | total-time`.
fn word_expression<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    word: &'f str,
) -> Option<Expression> {
    if let Some(number) = names::numeral(reader, node) {
        return Some(Expression::Number(number));
    }
    // A function is printed with parentheses, which adds a level of nesting.
    if node.is_deepest() {
        reader.report(too_deep(node.span()));
        return None;
    }
    let durative = reader.place() == ExpressionPlace::Durative;
    match Keyword::of(word).as_str() {
        "?duration" if durative => Some(Expression::Duration(node.span())),
        "#t" if durative => Some(Expression::ContinuousTime(node.span())),
        _ if is_total_time(reader, word) => Some(Expression::TotalTime(node.span())),
        special @ ("?duration" | "#t") => {
            let message = format!("`{special}` has a value only in a durative action");
            reader.report(Diagnostic::error(node.span(), message));
            None
        }
        _ if word.starts_with('?') => {
            let message = format!("expected an expression, found the variable `{word}`");
            let diagnostic = Diagnostic::error(node.span(), message).with_rule(EXPRESSION);
            reader.report(diagnostic.with_help(format!("apply a function: `(FUNCTION {word})`")));
            None
        }
        _ => fluent(reader, node).map(Expression::Fluent),
    }
}

fn is_total_time(reader: &GrammarReader<'_>, word: &str) -> bool {
    reader.place() == ExpressionPlace::Metric && word.eq_ignore_ascii_case("total-time")
}

/// Parses an operator and its operands: `OPERATOR EXPRESSION+`.
fn apply<'f>(
    reader: &mut GrammarReader<'f>,
    operator: Operator,
    items: Items<'f>,
    span: Span,
) -> Option<Expression> {
    // `f(x)` is one operand, which is reported. The lists in `(+(f) 1)` and `(+ 1(f))` touch an
    // operator and a number, and are operands of their own.
    let is_operand = |node: &SyntaxNode<'f>| {
        let is_name = |word: SyntaxNode<'f>| word.text().starts_with(char::is_alphabetic);
        !node.touched_word().is_some_and(is_name)
    };
    let fits = |count: usize| match operator {
        Operator::Add | Operator::Multiply => count >= 2,
        Operator::Subtract => count == 1 || count == 2,
        Operator::Divide => count == 2,
    };
    let wrong_number = |count: usize| {
        let message = format!("wrong number of operands: {count}");
        Diagnostic::error(span, message).with_rule(EXPRESSION)
    };
    let count = items.filter(is_operand).count();
    if !fits(count) {
        reader.report(wrong_number(count));
        return None;
    }
    let read: Vec<Expression> = items.filter_map(|node| expression(reader, node)).collect();
    if read.len() < count {
        return None;
    }
    if !fits(read.len()) {
        reader.report(wrong_number(read.len()));
        return None;
    }
    match <[Expression; 1]>::try_from(read) {
        Ok([operand]) => Some(Expression::Negate(Box::new(operand))),
        Err(operands) => Some(Expression::Apply(operator, operands)),
    }
}
