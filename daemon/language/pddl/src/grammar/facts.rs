//! Grammar of the elements of `:init`.

use super::condition;
use super::expression;
use super::names;
use super::reader::{GrammarReader, Keyword, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{Atom, FluentTerm, InitElement, Number, Term};

const ELEMENT: &str = "(PREDICATE NAME*) | (not (PREDICATE NAME*)) \
    | (unknown (PREDICATE NAME*)) | (= FLUENT NUMBER) | (at NUMBER ELEMENT)";
const VALUE: &str = "(= FLUENT NUMBER)";

/// Parses the elements of `:init`: `ELEMENT*`.
pub(crate) fn init_elements<'f>(
    reader: &mut GrammarReader<'f>,
    items: Items<'f>,
) -> Vec<InitElement> {
    items.filter_map(|node| init_element(reader, node)).collect()
}

/// Parses one element of `:init`: `(PREDICATE NAME*) | (not (PREDICATE NAME*))
/// | (unknown (PREDICATE NAME*)) | (= FLUENT NUMBER) | (at NUMBER ELEMENT)`.
pub(crate) fn init_element<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<InitElement> {
    let mut items = reader.expect_list(node, "a fact", ELEMENT)?;
    let head = reader.expect(&mut items, "predicate", ELEMENT)?;
    match Keyword::of(head.symbol().unwrap_or("")).as_str() {
        "not" => about(reader, items, "`not`").map(InitElement::Not),
        // A predicate with this name has objects as arguments, not a list.
        "unknown" if items.peek().is_some_and(|node| node.list().is_some()) => {
            about(reader, items, "`unknown`").map(InitElement::Unknown)
        }
        "=" => value(reader, items),
        "at" if is_timed(items) => timed(reader, items),
        "and" => {
            let and = Diagnostic::error(head.span(), "facts stand side by side");
            reader.report(and.with_help("leave `and` out").with_rule(ELEMENT));
            None
        }
        _ => {
            let atom = condition::atom(reader, node)?;
            ground(reader, &atom.arguments).then_some(InitElement::Atom(atom))
        }
    }
}

/// Parses the only fact after the keyword `word`, which is `not` or `unknown`.
fn about<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>, word: &str) -> Option<Atom> {
    let inner = reader.expect(&mut items, "fact", ELEMENT)?;
    reader.expect_end(items, word, ELEMENT);
    let atom = condition::atom(reader, inner)?;
    ground(reader, &atom.arguments).then_some(atom)
}

/// Whether the word `at` begins a timed literal: the next items are a time and a list, and not the
/// arguments of a predicate.
fn is_timed(mut items: Items<'_>) -> bool {
    let time = items.next().and_then(SyntaxNode::symbol).and_then(names::number);
    time.is_some() && items.next().is_some_and(|node| node.list().is_some())
}

/// Parses a timed initial literal: `(at NUMBER ELEMENT)`.
fn timed<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<InitElement> {
    let time = items.next().and_then(SyntaxNode::symbol).and_then(names::number)?;
    let inner = reader.expect(&mut items, "fact", ELEMENT)?;
    let element = init_element(reader, inner)?;
    reader.expect_end(items, "a timed fact", ELEMENT);
    if matches!(element, InitElement::At(..)) {
        reader.report(Diagnostic::error(inner.span(), "a fact has one time").with_rule(ELEMENT));
        return None;
    }
    Some(InitElement::At(time, Box::new(element)))
}

/// Parses the value of a function: `(= FLUENT NUMBER)`.
fn value<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<InitElement> {
    let fluent = reader.expect(&mut items, "function", VALUE)?;
    if let (Some(_), Some(function)) = (fluent.symbol().and_then(names::number), items.peek())
        && function.list().is_some()
    {
        let message = format!("the number `{}` stands before its function", excerpt(fluent));
        let turned = Diagnostic::error(fluent.span(), message).with_rule(VALUE);
        let help = format!("write `(= {} {})`", excerpt(function), excerpt(fluent));
        reader.report(turned.with_help(help));
        return None;
    }
    let fluent: Option<FluentTerm> = expression::fluent(reader, fluent);
    let node = reader.expect(&mut items, "number", VALUE)?;
    let number = init_number(reader, node);
    reader.expect_end(items, "`=`", VALUE);
    let (fluent, number) = (fluent?, number?);
    ground(reader, &fluent.arguments).then_some(InitElement::Assign(fluent, number))
}

fn init_number<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Number> {
    let number = names::numeral(reader, node);
    if number.is_none() {
        let message = format!("expected a number, found `{}`", excerpt(node));
        reader.report(Diagnostic::error(node.span(), message).with_rule(VALUE));
    }
    number
}

/// Whether all arguments are objects. Variables among them are reported.
fn ground(reader: &mut GrammarReader<'_>, arguments: &[Term]) -> bool {
    let mut ground = true;
    for argument in arguments {
        if let Term::Variable(name) = argument {
            ground = false;
            let message = format!("`?{name}` is a variable, and facts are about objects");
            reader.report(Diagnostic::error(name.span(), message));
        }
    }
    ground
}
