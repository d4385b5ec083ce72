//! Grammar of the effects of actions.

use super::condition::{self, Headed, headed, misplaced};
use super::expression;
use super::names;
use super::reader::{GrammarReader, Keyword};
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{Assign, Assignment, Effect, Span, Typed};

const EFFECT: &str = "(PREDICATE TERM*) | (not (PREDICATE TERM*)) | (and EFFECT*) \
    | (when CONDITION EFFECT) | (forall (VARIABLES) EFFECT) | (ASSIGNMENT FLUENT EXPRESSION)";
const DELETE: &str = "(not (PREDICATE TERM*))";
const WHEN: &str = "(when CONDITION EFFECT)";
const FORALL: &str = "(forall (VARIABLES) EFFECT)";
const ASSIGN: &str = "(assign|increase|decrease|scale-up|scale-down FLUENT EXPRESSION)";

/// Parses an effect: `() | (PREDICATE TERM*) | (not (PREDICATE TERM*)) | (and EFFECT*)
/// | (when CONDITION EFFECT) | (forall (VARIABLES) EFFECT) | (ASSIGNMENT FLUENT EXPRESSION)`.
pub(super) fn effect<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<Effect> {
    let (word, items) = match headed(reader, node, "an effect", EFFECT)? {
        Headed::Empty => return Some(Effect::nothing()),
        Headed::By(word, items) => (word, items),
    };
    let keyword = Keyword::of(word);
    if let Some(assignment) = assignment(keyword.as_str()) {
        let assign = assign(reader, assignment, items, node.span())?;
        return Some(Effect::Assign(Box::new(assign)));
    }
    match keyword.as_str() {
        "and" => Some(Effect::And(items.filter_map(|node| effect(reader, node)).collect())),
        "not" => delete(reader, items),
        "when" => when(reader, items),
        "forall" => {
            let (variables, node) = forall(reader, items)?;
            Some(Effect::Forall(variables, Box::new(effect(reader, node)?)))
        }
        "oneof" | "probabilistic" if items.into_iter().any(|item| item.list().is_some()) => {
            let what = format!("effects that are not certain (`{}`)", keyword.as_str());
            condition::unsupported(reader, node, &what)
        }
        "or" => misplaced(reader, node, "an effect must be certain", "`or` is for conditions"),
        "imply" => misplaced(reader, node, "`imply` belongs to conditions", "write `when`"),
        "exists" => misplaced(reader, node, "`exists` belongs to conditions", "write `forall`"),
        "=" => misplaced(reader, node, "`=` is a condition", "write `(assign FLUENT EXPRESSION)`"),
        _ => condition::atom(reader, node).map(Effect::Add),
    }
}

/// Parses the keyword of a numeric effect: `assign | increase | decrease | scale-up | scale-down`.
/// Returns `None` for any other word.
pub(super) fn assignment(keyword: &str) -> Option<Assignment> {
    match keyword {
        "assign" => Some(Assignment::Assign),
        "increase" => Some(Assignment::Increase),
        "decrease" => Some(Assignment::Decrease),
        "scale-up" => Some(Assignment::ScaleUp),
        "scale-down" => Some(Assignment::ScaleDown),
        _ => None,
    }
}

/// Parses a numeric effect: `(ASSIGNMENT FLUENT EXPRESSION)`.
pub(super) fn assign<'f>(
    reader: &mut GrammarReader<'f>,
    assignment: Assignment,
    mut items: Items<'f>,
    span: Span,
) -> Option<Assign> {
    let fluent = reader.expect(&mut items, "function", ASSIGN)?;
    let fluent = expression::fluent(reader, fluent);
    let value = reader.expect(&mut items, "value", ASSIGN)?;
    let value = expression::expression(reader, value);
    reader.expect_end(items, "a numeric effect", ASSIGN);
    Some(Assign { assignment, fluent: fluent?, value: value?, span })
}

/// Parses `(forall (VARIABLES) X)`. Returns the variables, and the node of `X`.
pub(super) fn forall<'f>(
    reader: &mut GrammarReader<'f>,
    mut items: Items<'f>,
) -> Option<(Vec<Typed>, SyntaxNode<'f>)> {
    let variables = reader.expect(&mut items, "list of variables", FORALL)?;
    let is_body = condition::is_body;
    let variables = names::listed_variables(reader, variables, &mut items, is_body, FORALL);
    let body = reader.expect(&mut items, "effect", FORALL)?;
    reader.expect_end(items, "`forall`", FORALL);
    Some((variables, body))
}

/// Parses an effect that deletes a fact: `(not (PREDICATE TERM*))`.
fn delete<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<Effect> {
    let node = reader.expect(&mut items, "atom", DELETE)?;
    let atom = condition::atom(reader, node);
    reader.expect_end(items, "`not`", DELETE);
    atom.map(Effect::Delete)
}

/// Parses a conditional effect: `(when CONDITION EFFECT)`.
fn when<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<Effect> {
    let condition = reader.expect(&mut items, "condition", WHEN)?;
    let condition = condition::condition(reader, condition);
    let node = reader.expect(&mut items, "effect", WHEN)?;
    let effect = effect(reader, node);
    reader.expect_end(items, "`when`", WHEN);
    Some(Effect::When(Box::new(condition?), Box::new(effect?)))
}
