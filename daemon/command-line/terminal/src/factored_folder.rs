//! Reads a factored task: a folder with the files `domain-AGENT.pddl` and `problem-AGENT.pddl` of each
//! agent, as in the CoDMAP competition. The files are merged into one task.

use std::path::Path;

use pddl::factored::{AgentFiles, FactoredTask, merge_factored};
use pddl::{Diagnostic, Domain, Parsed, Problem, Span};

use crate::pddl_files::PddlTask;
use crate::report::{DiagnosticReport, SourceText, reason};

/// Maximum number of agents in a folder. CoDMAP has at most ten.
const AGENTS_MAX: usize = 256;

/// Reads the files of all agents in a folder, and merges them.
///
/// # Errors
///
/// Returns the diagnostics if the folder has no such files, if a file cannot be read or parsed, or if
/// the files contradict each other.
pub fn read_factored(folder: &Path) -> Result<PddlTask, DiagnosticReport> {
    let mut report = DiagnosticReport::default();
    let agents = match agents_in(folder) {
        Ok(agents) => agents,
        Err(why) => return Err(refusal(report, folder, &why)),
    };
    let mut tasks = Vec::new();
    for agent in agents {
        let path = |kind: &str| folder.join(format!("{kind}-{agent}.pddl"));
        let domain = parsed::<Domain>(&path("domain"), pddl::parse_domain, &mut report);
        let problem = parsed::<Problem>(&path("problem"), pddl::parse_problem, &mut report);
        if let (Some(domain), Some(problem)) = (domain, problem) {
            tasks.push(AgentFiles { agent, domain, problem });
        }
    }
    if report.has_errors() {
        return Err(report.refused());
    }
    match merge_factored(&tasks) {
        Ok(merged) => checked(folder, merged, report),
        Err(why) => Err(refusal(report, folder, &why)),
    }
}

/// Returns the names of the agents with files in a folder, sorted.
///
/// # Errors
///
/// Returns the reason if the folder cannot be read or has no such files.
pub fn agents_in(folder: &Path) -> Result<Vec<String>, String> {
    let mut agents = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| reason(&error))? {
        let name = entry.map_err(|error| reason(&error))?.file_name();
        let agent = name.to_str().and_then(|name| {
            name.strip_prefix("domain-")?.strip_suffix(".pddl").map(str::to_owned)
        });
        agents.extend(agent);
    }
    agents.sort();
    if let Some(wrong) = agents.iter().find(|agent| !is_name(agent)) {
        return Err(format!(
            "`{wrong}` cannot be the name of an agent, as in `domain-{wrong}.pddl`: use letters, \
             digits, `-` and `_`, and begin with a letter"
        ));
    }
    match agents.len() {
        0 => Err("it has no file `domain-AGENT.pddl`".to_owned()),
        1..=AGENTS_MAX => Ok(agents),
        count => Err(format!("it has files of {count} agents; {AGENTS_MAX} are possible")),
    }
}

/// Whether a text can be a part of names in PDDL.
fn is_name(text: &str) -> bool {
    text.starts_with(|first: char| first.is_ascii_alphabetic())
        && text.chars().all(|letter| letter.is_ascii_alphanumeric() || "-_".contains(letter))
}

fn parsed<T>(
    path: &Path,
    parse: fn(&str) -> Parsed<T>,
    report: &mut DiagnosticReport,
) -> Option<T> {
    let source = crate::pddl_files::read(path, report)?;
    let Parsed { value, diagnostics } = parse(&source.text);
    report.add(&source, diagnostics);
    value
}

/// Checks a merged task like one that was read from two files. The places of mistakes are in the text
/// of the merged task.
fn checked(
    folder: &Path,
    merged: FactoredTask,
    mut report: DiagnosticReport,
) -> Result<PddlTask, DiagnosticReport> {
    let name = |what: &str| format!("{} ({what}, merged)", folder.display());
    let domain_source = SourceText::new(name("domain"), merged.domain.to_string());
    let problem_source = SourceText::new(name("problem"), merged.problem.to_string());
    let domain = crate::pddl_files::domain_of(domain_source.clone(), &mut report);
    let problem = crate::pddl_files::problem_of(&problem_source, Some(&domain), &mut report);
    match (domain.domain, problem) {
        (Some(domain), Some(problem)) if !report.has_errors() => {
            let factored = Some(merged);
            Ok(PddlTask { domain, problem, domain_source, problem_source, report, factored })
        }
        _ => Err(report.refused()),
    }
}

fn refusal(mut report: DiagnosticReport, folder: &Path, why: &str) -> DiagnosticReport {
    let message = format!("`{}` is no factored task: {why}", folder.display());
    let help = "name a folder with `domain-AGENT.pddl` and `problem-AGENT.pddl` for each agent, or a \
                domain and a problem";
    report.add_general(Diagnostic::error(Span::default(), message).with_help(help));
    report.refused()
}
