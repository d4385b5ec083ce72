//! Grammar of the durations, conditions and effects of durative actions (PDDL 2.1).

use super::condition::{self, Headed, headed, misplaced, unsupported};
use super::effect;
use super::expression;
use super::reader::{GrammarReader, Keyword};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{
    Assignment, Comparison, DurationConstraint, TimeSpecifier, TimedCondition, TimedEffect, Typed,
};

const DURATION: &str = "() | (=|<=|>= ?duration EXPRESSION) \
    | (at start|end DURATION) | (and DURATION*)";
const TIMED_CONDITION: &str = "() | (at start|end CONDITION) | (over all CONDITION) \
    | (and TIMED*) | (forall (VARIABLES) TIMED)";
const TIMED_EFFECT: &str = "() | (at start|end EFFECT) | (and TIMED*) \
    | (forall (VARIABLES) TIMED) | (when TIMED-CONDITION TIMED) \
    | (increase|decrease FLUENT EXPRESSION-WITH-#t)";
const WHEN: &str = "(when TIMED-CONDITION TIMED-EFFECT)";

/// Parses the constraints on a duration:
/// `() | (=|<=|>= ?duration EXPRESSION) | (at start|end DURATION) | (and DURATION*)`.
pub(super) fn duration<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Vec<DurationConstraint> {
    let mut constraints = Vec::new();
    collect_duration(reader, node, None, &mut constraints);
    constraints
}

fn collect_duration<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    when: Option<TimeSpecifier>,
    constraints: &mut Vec<DurationConstraint>,
) {
    let Some(Headed::By(word, mut items)) = headed(reader, node, "a duration", DURATION) else {
        return;
    };
    let comparison = match Keyword::of(word).as_str() {
        "=" => Comparison::Equal,
        "<=" => Comparison::LessOrEqual,
        ">=" => Comparison::GreaterOrEqual,
        "and" => return items.for_each(|node| collect_duration(reader, node, when, constraints)),
        "at" => {
            if let Some((when, inner)) = timed(reader, node, items, DURATION) {
                collect_duration(reader, inner, Some(when), constraints);
            }
            return;
        }
        _ => return reader.unknown(node, "duration", &["=", "<=", ">=", "and", "at"]),
    };
    let Some(subject) = reader.expect(&mut items, "`?duration`", DURATION) else { return };
    if !subject.symbol().is_some_and(|word| word.eq_ignore_ascii_case("?duration")) {
        let message = "a duration constrains `?duration`, on the left";
        reader.report(Diagnostic::error(subject.span(), message).with_rule(DURATION));
    }
    let Some(value) = reader.expect(&mut items, "expression", DURATION) else { return };
    if let Some(value) = expression::expression(reader, value) {
        constraints.push(DurationConstraint { when, comparison, value });
    }
    reader.expect_end(items, "a duration", DURATION);
}

/// Parses `start|end|all X` after `at` or `over`. Returns the time, which is the first word, and
/// the node of `X`.
fn timed<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    mut items: Items<'f>,
    rule: &'static str,
) -> Option<(TimeSpecifier, SyntaxNode<'f>)> {
    let over = node.head().is_some_and(|word| word.eq_ignore_ascii_case("over"));
    let time = reader.expect(&mut items, "time", rule)?;
    let when = match (over, Keyword::of(time.symbol().unwrap_or("")).as_str()) {
        (false, "start") => TimeSpecifier::Start,
        (false, "end") => TimeSpecifier::End,
        (true, "all") => TimeSpecifier::OverAll,
        (true, _) => return misplaced(reader, time, "no such time", "write `over all`"),
        (false, _) => {
            return misplaced(reader, node, "no such time", "write `at start …` or `at end …`");
        }
    };
    let inner = reader.expect(&mut items, "what is timed", rule)?;
    reader.expect_end(items, "a timed part", rule);
    Some((when, inner))
}

/// Parses timed conditions: `() | (at start|end CONDITION) | (over all CONDITION) | (and TIMED*)
/// | (forall (VARIABLES) TIMED)`.
pub(super) fn conditions<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Vec<TimedCondition> {
    let mut conditions = Vec::new();
    collect_conditions(reader, node, &[], &mut conditions);
    conditions
}

fn collect_conditions<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    outer: &[Typed],
    conditions: &mut Vec<TimedCondition>,
) {
    let what = "a timed condition";
    let Some(Headed::By(word, items)) = headed(reader, node, what, TIMED_CONDITION) else {
        return;
    };
    if !reader.afford_copies(outer.len()) {
        let message = "the variables of `forall` stand for too many conditions";
        return reader.report(Diagnostic::error(node.span(), message));
    }
    match Keyword::of(word).as_str() {
        "and" => items.for_each(|node| collect_conditions(reader, node, outer, conditions)),
        "forall" => {
            if let Some((variables, body)) = effect::forall(reader, items) {
                let forall = [outer, &variables].concat();
                collect_conditions(reader, body, &forall, conditions);
            }
        }
        "at" | "over" => {
            let timed = timed(reader, node, items, TIMED_CONDITION);
            let Some((when, inner)) = timed else { return };
            if let Some(condition) = condition::condition(reader, inner) {
                conditions.push(TimedCondition { forall: outer.to_vec(), when, condition });
            }
        }
        "preference" => drop(unsupported::<()>(reader, node, "preferences")),
        _ => report_untimed(reader, node, "condition", TIMED_CONDITION),
    }
}

/// Parses a timed effect: `() | (at start|end EFFECT) | (and TIMED*) | (forall (VARIABLES) TIMED)
/// | (when TIMED-CONDITION TIMED) | (increase|decrease FLUENT EXPRESSION-WITH-#t)`.
pub(super) fn effect<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<TimedEffect> {
    let (word, items) = match headed(reader, node, "a timed effect", TIMED_EFFECT)? {
        Headed::Empty => return Some(TimedEffect::And(Vec::new())),
        Headed::By(word, items) => (word, items),
    };
    let keyword = Keyword::of(word);
    match keyword.as_str() {
        "and" => Some(TimedEffect::And(items.filter_map(|node| effect(reader, node)).collect())),
        "at" => {
            let (when, inner) = timed(reader, node, items, TIMED_EFFECT)?;
            Some(TimedEffect::At(when, effect::effect(reader, inner)?))
        }
        "over" => misplaced(reader, node, "no effect lasts `over all`", "write `at end`"),
        "forall" => {
            let (variables, body) = effect::forall(reader, items)?;
            Some(TimedEffect::Forall(variables, Box::new(effect(reader, body)?)))
        }
        "when" => when(reader, items),
        _ => match effect::assignment(keyword.as_str()) {
            Some(assignment @ (Assignment::Increase | Assignment::Decrease)) => {
                let assign = effect::assign(reader, assignment, items, node.span())?;
                Some(TimedEffect::Continuous(Box::new(assign)))
            }
            _ => {
                report_untimed(reader, node, "effect", TIMED_EFFECT);
                None
            }
        },
    }
}

/// Parses a conditional effect: `(when TIMED-CONDITION TIMED-EFFECT)`.
fn when<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<TimedEffect> {
    let condition = reader.expect(&mut items, "condition", WHEN)?;
    let conditions = conditions(reader, condition);
    let node = reader.expect(&mut items, "effect", WHEN)?;
    let effect = effect(reader, node);
    reader.expect_end(items, "`when`", WHEN);
    Some(TimedEffect::When(conditions, Box::new(effect?)))
}

fn report_untimed(
    reader: &mut GrammarReader<'_>,
    node: SyntaxNode<'_>,
    what: &str,
    rule: &'static str,
) {
    let message = format!("this {what} of a durative action says no time");
    let diagnostic = Diagnostic::error(node.span(), message).with_rule(rule);
    reader.report(diagnostic.with_help("write `(at start …)`, `(at end …)` or `(over all …)`"));
}
