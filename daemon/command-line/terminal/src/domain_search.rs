//! Finds the domain of a problem by the domain name in the problem. If several domains have that
//! name, the file names decide, because collections of problems name the files of a pair alike.

use std::path::{Path, PathBuf};

use crate::pddl_files::{self, DomainText};
use crate::report::{DiagnosticReport, SourceText};
use pddl::Name;

/// Maximum number of files of one folder that are searched for a domain: those with the names that
/// are most similar to the name of the problem. A folder of problems may hold thousands.
const CANDIDATES_MAX: usize = 100;

/// Returns the domain named `name` from the domains that the user gave. If several have that name,
/// returns the one with the most similar file name. Returns `None` if none has that name.
pub fn domain_given<'d>(
    path: &Path,
    name: &Name,
    given: &'d [DomainText],
) -> Option<&'d DomainText> {
    let named = given.iter().filter(|text| is_named(text, name));
    named.min_by_key(|text| distance(Path::new(&text.source.name), path))
}

/// Returns the domain `name` from the `.pddl` files in the folder of the problem's file `path`, or
/// in the folder above, where collections of problems keep it. Returns `None` if no file has that
/// domain.
pub fn nearby_domain(path: &Path, name: &Name) -> Option<DomainText> {
    let folder = path.parent()?;
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let above = here.join("..");
    let candidates = [here, &above].into_iter().flat_map(|folder| domain_files(folder, path));
    candidates.filter(|candidate| candidate != path).find_map(|candidate| {
        let source = SourceText::read(&candidate).ok()?;
        // Diagnostics of the domain are not needed here.
        let text = pddl_files::domain_of(source, &mut DiagnosticReport::default());
        is_named(&text, name).then_some(text)
    })
}

fn is_named(text: &DomainText, name: &Name) -> bool {
    text.domain.as_ref().is_some_and(|domain| domain.name == *name)
}

/// Returns the files of a folder that may contain the domain of the problem in `path`, the likely
/// ones first. The files are sorted, because the system lists a folder in any order.
fn domain_files(folder: &Path, path: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "pddl"))
        .collect();
    files.sort_by_cached_key(|candidate| (distance(candidate, path), candidate.clone()));
    files.truncate(CANDIDATES_MAX);
    files
}

/// Returns how badly the file name of a domain fits that of a problem:
///
/// - 0: it names this problem, as `p07-domain` and `domain_p07` name `p07`;
/// - 1: it has no word besides `domain`, so that it fits all problems without a domain of their
///   own;
/// - 2: it names another problem;
/// - 3: it lacks the word `domain`.
pub(crate) fn distance(domain: &Path, problem: &Path) -> usize {
    let own = words(domain);
    let Some(at) = own.iter().position(|word| word == "domain") else { return 3 };
    let rest: Vec<&String> = own[..at].iter().chain(&own[at + 1..]).collect();
    let belongs = words(problem).iter().zip(&rest).filter(|(a, b)| a == *b).count() == rest.len();
    match (belongs, rest.len()) {
        (true, 1..) => 0,
        (_, 0) => 1,
        _ => 2,
    }
}

fn words(path: &Path) -> Vec<String> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    stem.split(['-', '_']).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(domain: &str, problem: &str, expected: usize) {
        assert_eq!(distance(Path::new(domain), Path::new(problem)), expected);
    }

    #[test]
    fn a_domain_is_matched_to_a_problem_by_file_names() {
        check("p07-domain.pddl", "p07.pddl", 0);
        check("domain_p270_2.pddl", "p270_2.pddl", 0);
        check("p42-domain.pddl", "p42-s82-n3-l4-f50.pddl", 0);
        check("domain.pddl", "p07.pddl", 1);
        check("p08-domain.pddl", "p07.pddl", 2);
        check("p08.pddl", "p07.pddl", 3);
    }
}
