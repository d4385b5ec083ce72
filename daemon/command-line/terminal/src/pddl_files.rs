//! Reads a domain and a problem, and collects all diagnostics about them.
//!
//! The commands `plan`, `validate` and `check` and the reader of the ecosystem file share this
//! module, so that all of them treat a PDDL file in the same way.

use std::path::Path;
use std::sync::Arc;

use pddl::factored::FactoredTask;
use pddl::{ActionModel, Diagnostic, Domain, Parsed, Problem, Span};

use crate::pddl_cures;
use crate::report::{DiagnosticReport, SourceText};

/// A domain and a problem without errors, and their texts.
pub struct PddlTask {
    /// The parsed domain.
    pub domain: Domain,
    /// The parsed problem.
    pub problem: Problem,
    /// Text of the domain.
    pub domain_source: Arc<SourceText>,
    /// Text of the problem.
    pub problem_source: Arc<SourceText>,
    /// Warnings about the domain and the problem.
    pub report: DiagnosticReport,
    /// The merged files of all agents, if the task is a folder with files for each agent.
    pub factored: Option<FactoredTask>,
}

/// The text of a domain, and as much of the domain as can be parsed.
pub struct DomainText {
    /// Text of the domain.
    pub source: Arc<SourceText>,
    /// The part of the domain that can be parsed; `None` if there is none.
    pub domain: Option<Domain>,
    /// Lines of the text that cannot be parsed. The declarations in these lines are missing in
    /// `domain`.
    damaged: Vec<String>,
}

/// Reads the files of a domain and a problem.
///
/// # Errors
///
/// Returns the diagnostics of both files if one of them cannot be read, has errors, or if the two
/// are swapped.
pub fn read_task(domain: &Path, problem: &Path) -> Result<PddlTask, DiagnosticReport> {
    let mut report = DiagnosticReport::default();
    let domain = read(domain, &mut report).map(|source| domain_of(source, &mut report));
    let problem = read(problem, &mut report);
    if let (Some(domain), Some(problem)) = (&domain, &problem)
        && are_swapped(domain, problem)
    {
        let mut report = DiagnosticReport::default();
        let (first, second) = (&domain.source.name, &problem.name);
        let message =
            format!("`{first}` holds a problem, and `{second}` a domain: name the domain first");
        report.add_general(Diagnostic::error(Span::default(), message));
        return Err(report);
    }
    let problem = problem.map(|source| {
        let problem = problem_of(&source, domain.as_ref(), &mut report);
        (source, problem)
    });
    match (domain, problem) {
        (
            Some(DomainText { source: domain_source, domain: Some(domain), .. }),
            Some((problem_source, Some(problem))),
        ) if !report.has_errors() => {
            let factored = None;
            Ok(PddlTask { domain, problem, domain_source, problem_source, report, factored })
        }
        _ => Err(report.refused()),
    }
}

/// Whether the two texts are swapped: the text given as the domain is a problem, and the other is a
/// domain.
fn are_swapped(domain: &DomainText, problem: &SourceText) -> bool {
    domain.domain.is_none()
        && pddl::parse_problem(&domain.source.text).value.is_some()
        && pddl::parse_domain(&problem.text).value.is_some()
}

/// Reads a file. If the file cannot be read, adds an error to the report and returns `None`.
pub fn read(path: &Path, report: &mut DiagnosticReport) -> Option<Arc<SourceText>> {
    SourceText::read(path).map_err(|failure| report.add_failure(failure)).ok()
}

/// Returns the text that most likely contains an error that the planner reports without a place.
/// This is the domain if it has an error even with an empty problem, otherwise the problem.
pub fn likely_faulty_text(task: &PddlTask) -> &Arc<SourceText> {
    let nothing = Problem::named("nothing", task.domain.name.clone());
    match planner::validate::World::initial(&task.domain, &nothing) {
        Ok(_) => &task.problem_source,
        Err(_) => &task.domain_source,
    }
}

/// Parses a domain as far as possible, and adds the diagnostics about it to the report.
pub fn domain_of(source: Arc<SourceText>, report: &mut DiagnosticReport) -> DomainText {
    let Parsed { value: domain, diagnostics } = pddl::parse_domain(&source.text);
    let damaged = damaged_lines(&source.text, &diagnostics);
    let checked = domain.as_ref().map(pddl::check_domain).unwrap_or_default();
    report.add(&source, merged(&source.text, &damaged, diagnostics, checked));
    DomainText { source, domain, damaged }
}

/// Parses a domain that extends another one, and adds the diagnostics about it to the report.
/// `extend` returns the extended domain and the mistakes in the extension. Returns `None` if nothing
/// of the extension can be parsed.
pub fn vocabulary_of(
    source: &Arc<SourceText>,
    extend: impl FnOnce(&Domain) -> (Domain, Vec<Diagnostic>),
    report: &mut DiagnosticReport,
) -> Option<Domain> {
    let Parsed { value, diagnostics } = pddl::parse_domain(&source.text);
    let damaged = damaged_lines(&source.text, &diagnostics);
    let (domain, checked) = value.as_ref().map(extend).unzip();
    report.add(source, merged(&source.text, &damaged, diagnostics, checked.unwrap_or_default()));
    domain
}

/// Parses a problem, and checks it against its domain if the domain is known. Reports an error if
/// the problem has no goal. Returns `None` if the problem cannot be parsed.
pub fn problem_of(
    source: &Arc<SourceText>,
    domain: Option<&DomainText>,
    report: &mut DiagnosticReport,
) -> Option<Problem> {
    let problem = problem_by(source, domain, report, pddl::check_problem);
    if let Some(problem) = problem.as_ref().filter(|problem| problem.goal.is_always())
        && !pddl::states_goal(&source.text)
    {
        let message = format!("problem `{}` has no `:goal`", problem.name);
        let help = "say what is to be true at the end; `(:goal (and))` asks for nothing";
        let missing = Diagnostic::error(problem.name.span(), message);
        report.add(source, [missing.with_rule("(:goal CONDITION)").with_help(help)]);
    }
    if let (Some(problem), Some(DomainText { domain: Some(domain), .. })) = (&problem, domain) {
        report.add(source, pddl::check_metric_values(domain, problem));
    }
    problem
}

/// Parses the map of a building, and checks it against the domain: the domain must declare the
/// predicate of each fact.
pub fn map_of(
    source: &Arc<SourceText>,
    domain: Option<&DomainText>,
    report: &mut DiagnosticReport,
) -> Option<Problem> {
    problem_by(source, domain, report, pddl::check_map)
}

fn problem_by(
    source: &Arc<SourceText>,
    domain: Option<&DomainText>,
    report: &mut DiagnosticReport,
    check: fn(&Domain, &Problem) -> Vec<Diagnostic>,
) -> Option<Problem> {
    let Parsed { value, diagnostics } = pddl::parse_problem(&source.text);
    let checked =
        |domain: &Domain| value.as_ref().map(|problem| check(domain, problem)).unwrap_or_default();
    let found = checked_against(source, domain, diagnostics, checked);
    report.add(source, pddl_cures::improved(&source.text, found));
    value
}

/// Parses an action model, and checks the model against the ontology if the ontology is known.
pub fn action_model_of(
    source: &Arc<SourceText>,
    ontology: Option<&DomainText>,
    report: &mut DiagnosticReport,
) -> Option<ActionModel> {
    let Parsed { value, diagnostics } = pddl::parse_action_model(&source.text);
    let checked = |ontology: &Domain| {
        value.as_ref().map(|model| pddl::check_action_model(ontology, model)).unwrap_or_default()
    };
    report.add(source, checked_against(source, ontology, diagnostics, checked));
    value
}

fn checked_against(
    source: &SourceText,
    domain: Option<&DomainText>,
    parsed: Vec<Diagnostic>,
    check: impl FnOnce(&Domain) -> Vec<Diagnostic>,
) -> Vec<Diagnostic> {
    let mut damaged = damaged_lines(&source.text, &parsed);
    let Some(DomainText { domain: Some(domain), damaged: foreign, .. }) = domain else {
        return parsed;
    };
    damaged.extend(foreign.iter().cloned());
    merged(&source.text, &damaged, parsed, check(domain))
}

/// Merges the diagnostics of the parser and the check. Leaves out those that only follow from
/// another error: if a declaration cannot be parsed, every use of its name would be “unknown”.
fn merged(
    text: &str,
    damaged: &[String],
    parsed: Vec<Diagnostic>,
    checked: Vec<Diagnostic>,
) -> Vec<Diagnostic> {
    let is_consequence = |found: &Diagnostic| {
        let word = text.get(found.span.range()).unwrap_or("");
        damaged.iter().any(|lines| has_word(lines, word))
    };
    let mut all = parsed;
    all.extend(checked.into_iter().filter(|found| !is_consequence(found)));
    all.sort_by_key(|found| (found.span.start, found.span.end));
    all
}

/// Returns the lines of a text that contain errors, according to `diagnostics`.
pub fn damaged_lines(text: &str, diagnostics: &[Diagnostic]) -> Vec<String> {
    let errors = diagnostics.iter().filter(|found| found.is_error());
    errors.map(|found| marked_lines(text, found).to_owned()).collect()
}

fn marked_lines<'t>(text: &'t str, found: &Diagnostic) -> &'t str {
    let start = text.floor_char_boundary(found.span.start as usize);
    let end = text.floor_char_boundary(found.span.end as usize).max(start);
    let start = text[..start].rfind('\n').map_or(0, |newline| newline + 1);
    let end = text[end..].find('\n').map_or(text.len(), |newline| end + newline);
    &text[start..end]
}

/// Whether a text contains the word `word`, in upper, lower or mixed case.
pub fn has_word(text: &str, word: &str) -> bool {
    let is_break = |c: char| c.is_whitespace() || "(),;".contains(c);
    !word.is_empty() && text.split(is_break).any(|other| other.eq_ignore_ascii_case(word))
}
