//! Grammar of problems.

use std::sync::Arc;

use super::definition::Sections;
use super::reader::{ExpressionPlace, GrammarReader, Keyword, excerpt};
use super::{condition, declarations, expression, facts, names};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{Condition, Metric, MetricDirection, Name, Problem, Span};

const SECTIONS: &[&str] = &[":domain", ":requirements", ":objects", ":init", ":goal", ":metric"];
const DOMAIN: &str = "(:domain NAME)";
const GOAL: &str = "(:goal CONDITION)";
const METRIC: &str = "(:metric minimize|maximize EXPRESSION)";

/// Parses a problem: `(define (problem NAME) (:domain NAME) [REQUIREMENTS] [OBJECTS] [INIT] [GOAL]
/// [METRIC])`, with the sections in any order.
pub(super) fn problem<'f>(reader: &mut GrammarReader<'f>, name: Name, items: Items<'f>) -> Problem {
    let mut domain = None;
    let mut problem = Problem::named(name, Name::new(""));
    let mut objects = Vec::new();
    let mut sections = Sections::new(items, SECTIONS);
    while let Some(section) = sections.next(reader) {
        let items = section.items;
        match section.keyword {
            ":domain" => domain = domain_name(reader, items),
            ":requirements" => {
                problem.requirements.extend(declarations::requirements(reader, items))
            }
            ":objects" => objects.extend(declarations::objects(reader, items)),
            ":init" => problem.init.extend(facts::init_elements(reader, items)),
            ":goal" => problem.goal = goal(reader, items).unwrap_or_default(),
            _ => problem.metric = metric(reader, items, section.span),
        }
    }
    problem.objects = Arc::new(objects);
    problem.domain = domain.unwrap_or_else(|| missing_domain(reader, sections.end()));
    problem
}

/// Parses the section with the name of the domain: `(:domain NAME)`.
pub(super) fn domain_name<'f>(
    reader: &mut GrammarReader<'f>,
    mut items: Items<'f>,
) -> Option<Name> {
    let node = reader.expect(&mut items, "name", DOMAIN)?;
    reader.expect_end(items, "`:domain`", DOMAIN);
    let name = names::name(reader, node, "a name");
    // A wrong name was reported already; it must not be reported as missing, too.
    Some(name.unwrap_or_else(|| Name::placeholder(node.span())))
}

/// Reports that the name of the domain is missing. Returns a placeholder.
pub(super) fn missing_domain(reader: &mut GrammarReader<'_>, end: Span) -> Name {
    reader.report(Diagnostic::error(end, "missing `(:domain NAME)`").with_rule(DOMAIN));
    Name::placeholder(end)
}

/// Parses the section with the goal: `(:goal CONDITION)`.
fn goal<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>) -> Option<Condition> {
    let node = reader.expect(&mut items, "condition", GOAL)?;
    if let Some(more) = items.find(|more| !reader.is_call(*more)) {
        let message = format!("a goal is one condition, `{}` is another", excerpt(more));
        let several = Diagnostic::error(more.span(), message).with_rule(GOAL);
        reader.report(several.with_help("join them: `(and …)`"));
    }
    condition::condition(reader, node)
}

/// Parses a text that is a single metric: `(:metric minimize|maximize EXPRESSION)`.
pub(crate) fn metric_section<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
) -> Option<Metric> {
    let mut items = reader.expect_list(node, "a metric", METRIC)?;
    let head = reader.expect(&mut items, "`:metric`", METRIC)?;
    if Keyword::of(head.symbol().unwrap_or("")).as_str() != ":metric" {
        reader.unknown(head, "section", &[":metric"]);
        return None;
    }
    metric(reader, items, node.span())
}

/// Parses the content of a metric: `minimize|maximize EXPRESSION`.
fn metric<'f>(reader: &mut GrammarReader<'f>, mut items: Items<'f>, span: Span) -> Option<Metric> {
    let node = reader.expect(&mut items, "`minimize` or `maximize`", METRIC)?;
    let direction = direction(reader, node);
    let node = reader.expect(&mut items, "expression", METRIC)?;
    let expression =
        reader.within(ExpressionPlace::Metric, |reader| expression::expression(reader, node));
    reader.expect_end(items, "a metric", METRIC);
    Some(Metric { direction: direction?, expression: expression?, span })
}

/// Parses the direction of a metric: `minimize | maximize`.
fn direction<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<MetricDirection> {
    match Keyword::of(node.symbol().unwrap_or("")).as_str() {
        "minimize" => Some(MetricDirection::Minimize),
        "maximize" => Some(MetricDirection::Maximize),
        _ => {
            reader.unknown(node, "direction", &["minimize", "maximize"]);
            None
        }
    }
}
