//! Grammar of plans in the format of the planning competitions.

use nom::bytes::complete::{tag_no_case, take_while1};
use nom::character::complete::{char, space0};
use nom::combinator::{map_opt, opt};
use nom::sequence::preceded;
use nom::{IResult, Parser};

use super::names;
use super::reader::{GrammarReader, excerpt};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, NodeContent, SyntaxNode};
use crate::tree::{Number, PlanStep};

const STEP: &str = "[TIME:] (ACTION NAME*) [[DURATION]]";

/// Parses the steps of a plan: `([TIME:] STEP [[DURATION]])*`. The text has brackets around a
/// duration.
pub(crate) fn plan_steps<'f>(reader: &mut GrammarReader<'f>, roots: Items<'f>) -> Vec<PlanStep> {
    let mut steps: Vec<PlanStep> = Vec::new();
    let mut time = None;
    for node in roots {
        match node.content() {
            NodeContent::List(_) => {
                let step = plan_step(reader, node);
                let time = time.take();
                steps.extend(step.map(|step| PlanStep { time, ..step }));
            }
            NodeContent::Symbol(word) => {
                match (step_time(word), step_duration(word), steps.last_mut()) {
                    (Some(number), _, _) if time.is_none() => time = Some(number),
                    (_, Some(number), Some(step)) if time.is_none() && step.duration.is_none() => {
                        step.duration = Some(number);
                    }
                    _ => {
                        let message = format!("expected a step, found `{}`", excerpt(node));
                        reader.report(Diagnostic::error(node.span(), message).with_rule(STEP));
                    }
                }
            }
            NodeContent::Damaged => {}
        }
    }
    steps
}

/// Parses one step of a plan: `(ACTION NAME*)`.
pub(crate) fn plan_step<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<PlanStep> {
    let mut items = reader.expect_list(node, "a step", STEP)?;
    let head = reader.expect(&mut items, "action", STEP)?;
    let action = names::name(reader, head, "an action")?;
    let count = items.count();
    let arguments: Vec<_> =
        items.filter_map(|node| names::name(reader, node, "an object")).collect();
    let complete = arguments.len() == count;
    let span = node.span();
    complete.then_some(PlanStep { action, arguments, time: None, duration: None, span })
}

/// Returns the number in a comment `; cost = NUMBER …` of a plan; `None` if there is no such
/// comment. Of several comments, the last is used.
pub(crate) fn plan_cost(text: &str) -> Option<Number> {
    let comments = text.lines().filter_map(|line| line.split_once(';'));
    comments.filter_map(|(_, comment)| cost(comment).ok()).map(|(_, cost)| cost).next_back()
}

/// Parses the comment with the cost of a plan: `;* [plan] cost (= | :) NUMBER`.
fn cost(comment: &str) -> IResult<&str, Number, ()> {
    let (rest, _) = opt(take_while1(|c| c == ';')).parse(comment)?;
    let (rest, _) = preceded(space0, opt(tag_no_case("plan"))).parse(rest)?;
    let (rest, _) = preceded(space0, tag_no_case("cost")).parse(rest)?;
    let (rest, _) = preceded(space0, char('=').or(char(':'))).parse(rest)?;
    let word = take_while1(|c: char| !c.is_whitespace());
    preceded(space0, map_opt(word, names::number)).parse(rest)
}

/// Parses the start time of a step: `TIME:`.
fn step_time(word: &str) -> Option<Number> {
    names::number(word.strip_suffix(':')?)
}

/// Parses the duration of a step, with its brackets: `[DURATION]`.
fn step_duration(word: &str) -> Option<Number> {
    names::number(word.strip_prefix('[')?.strip_suffix(']')?)
}
