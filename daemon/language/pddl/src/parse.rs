//! Parsing: converts a text to a tree and diagnostics.
//!
//! Each function parses one kind of text. It reads the whole text, reports every mistake, and
//! returns the tree of the parts without mistakes. [`Parsed::into_result`] is for callers that
//! require a text without errors.

use crate::diagnostic::{DiagnosticList, Parsed};
use crate::grammar::{self, GrammarReader};
use crate::sexpr::{Forest, Items, SyntaxNode};
use crate::tree::{
    ActionModel, Condition, Document, Domain, InitElement, Metric, Plan, PlanStep, Problem,
};

/// Parses a file of any kind: a domain, a problem or an action model.
///
/// ```
/// let parsed = pddl::parse_document("(define (domain lamp) (:predicates (on)))");
/// assert_eq!(parsed.into_result().unwrap().to_string(), "\
/// (define (domain lamp)
///   (:predicates (on)))
/// ");
/// ```
pub fn parse_document(text: &str) -> Parsed<Document> {
    read(text, |reader, roots| grammar::document(reader, roots, None))
}

/// Parses `(define (domain NAME) …)`.
pub fn parse_domain(text: &str) -> Parsed<Domain> {
    read(text, |reader, roots| {
        match grammar::document(reader, roots, Some(grammar::DocumentKind::Domain))? {
            Document::Domain(domain) => Some(domain),
            Document::Problem(_) | Document::ActionModel(_) => None,
        }
    })
}

/// Parses `(define (problem NAME) …)`.
pub fn parse_problem(text: &str) -> Parsed<Problem> {
    read(text, |reader, roots| {
        match grammar::document(reader, roots, Some(grammar::DocumentKind::Problem))? {
            Document::Problem(problem) => Some(problem),
            Document::Domain(_) | Document::ActionModel(_) => None,
        }
    })
}

/// Whether the text of a problem has a `:goal`, even an empty one.
///
/// ```
/// let problem = "(define (problem p) (:domain d) (:goal (and)))";
/// assert!(pddl::states_goal(problem));
/// assert!(!pddl::states_goal(&problem.replace("(:goal (and))", "")));
/// ```
pub fn states_goal(text: &str) -> bool {
    let forest = Forest::read(text, &mut DiagnosticList::default());
    let is_goal =
        |node: SyntaxNode<'_>| node.head().is_some_and(|head| head.eq_ignore_ascii_case(":goal"));
    forest.roots().any(|root| root.list().is_some_and(|mut items| items.any(is_goal)))
}

/// Parses `(define (agent NAME) …)`.
pub fn parse_action_model(text: &str) -> Parsed<ActionModel> {
    read(text, |reader, roots| {
        match grammar::document(reader, roots, Some(grammar::DocumentKind::ActionModel))? {
            Document::ActionModel(model) => Some(model),
            Document::Domain(_) | Document::Problem(_) => None,
        }
    })
}

/// Parses a text that consists of a single condition, such as a goal.
pub fn parse_condition(text: &str) -> Parsed<Condition> {
    read(text, |reader, roots| grammar::single(reader, roots, "condition", grammar::condition))
}

/// Parses a text that consists of a metric, written as in a problem.
///
/// ```
/// let text = "(:metric minimize (+ (total-cost) (* 2 (waits))))";
/// let metric = pddl::parse_metric(text).into_result().unwrap();
/// assert_eq!(metric.to_string(), text);
/// for wrong in ["minimize (total-cost)", "(:goal (and))", "(:metric (total-cost))", ""] {
///     assert!(pddl::parse_metric(wrong).into_result().is_err(), "{wrong}");
/// }
/// ```
pub fn parse_metric(text: &str) -> Parsed<Metric> {
    read(text, |reader, roots| grammar::single(reader, roots, "metric", grammar::metric_section))
}

/// Parses one element of `:init`: a fact, its negation, or the value of a function.
pub fn parse_init_element(text: &str) -> Parsed<InitElement> {
    read(text, |reader, roots| grammar::single(reader, roots, "fact", grammar::init_element))
}

/// Parses a text that consists of elements of `:init`.
pub fn parse_init_elements(text: &str) -> Parsed<Vec<InitElement>> {
    read(text, |reader, roots| Some(grammar::init_elements(reader, roots)))
}

/// Parses a plan in the format of the International Planning Competition (IPC). The cost is taken
/// from a comment `; cost = N`, if there is one.
pub fn parse_plan(text: &str) -> Parsed<Plan> {
    read(text, |reader, roots| {
        let steps = grammar::plan_steps(reader, roots);
        Some(Plan { steps, cost: grammar::plan_cost(text) })
    })
}

/// Parses one step of a plan: `(move turtlebot-1 corridor office1)`.
pub fn parse_step(text: &str) -> Parsed<PlanStep> {
    read(text, |reader, roots| grammar::single(reader, roots, "step", grammar::plan_step))
}

/// Decodes the text of a file. Bytes that are not valid UTF-8 are decoded as Latin-1, which older
/// competition files have in their comments.
///
/// ```
/// assert_eq!(pddl::text_from_bytes(b"; Thi\xe9baux"), "; Thi\u{e9}baux");
/// ```
pub fn text_from_bytes(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect::<String>().into(),
    }
}

/// Builds the tree of parentheses of a text, and parses it with `meaning`.
fn read<T>(
    text: &str,
    meaning: impl for<'f> FnOnce(&mut GrammarReader<'f>, Items<'f>) -> Option<T>,
) -> Parsed<T> {
    let mut problems = DiagnosticList::default();
    let forest = Forest::read(text, &mut problems);
    let mut reader = GrammarReader::new(problems, forest.len(), forest.spoiled());
    let value = meaning(&mut reader, forest.roots());
    Parsed { value, diagnostics: reader.into_diagnostics() }
}
