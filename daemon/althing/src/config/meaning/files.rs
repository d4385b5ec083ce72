//! The files that an ecosystem names: the shared ontology and the map.

use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use pddl::{Diagnostic, Domain, Problem};
use terminal::pddl_files::{self, DomainText};
use terminal::report::Source;

use super::Meaning;

/// Both files, as far as they can be read.
pub(super) struct Files {
    pub(super) domain: Domain,
    pub(super) problem: Problem,
    /// Whether both are free of errors, so that what is checked against them means something.
    pub(super) are_sound: bool,
}

// === impl Meaning ===

impl Meaning<'_> {
    /// Reads both; their own mistakes are reported in their own texts.
    pub(super) fn files(
        &mut self,
        domain: Option<String>,
        problem: Option<String>,
    ) -> Option<Files> {
        let errors_before = self.errors();
        let domain = self.named_file("domain", domain, "domain.pddl");
        let problem = self.named_file("problem", problem, "map.pddl");
        let domain = domain.map(|source| pddl_files::domain_of(source, &mut self.report));
        let problem =
            problem.map(|source| pddl_files::map_of(&source, domain.as_ref(), &mut self.report));
        let are_sound = self.errors() == errors_before;
        match (domain, problem) {
            (Some(DomainText { domain: Some(domain), .. }), Some(Some(problem))) => {
                Some(Files { domain, problem, are_sound })
            }
            _ => None,
        }
    }

    fn errors(&self) -> usize {
        self.report.count(pddl::Severity::Error)
    }

    /// The text of a file that the ecosystem file names relative to itself.
    fn named_file(
        &mut self,
        key: &str,
        written: Option<String>,
        example: &str,
    ) -> Option<Arc<Source>> {
        let Some(written) = written else {
            self.missing("ecosystem", key, example);
            return None;
        };
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let path = folder.join(&written);
        match Source::read_as(&path, &shortened(&path).display().to_string()) {
            Ok(source) => Some(source),
            Err(reason) => {
                let message = format!("`{written}` cannot be read: {reason}");
                let help = match similar_file(&path) {
                    Some(name) => format!("did you mean `{name}`?"),
                    None => "paths are relative to the ecosystem file".to_owned(),
                };
                let path = format!("ecosystem.{key}");
                self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
                None
            }
        }
    }
}

// === impl Files ===

impl Files {
    /// What is wrong with the name of a place that is to be on the map, and what would be right.
    pub(super) fn unknown_object(&self, name: &str) -> Option<(String, String)> {
        if self.has_object(name) {
            return None;
        }
        let help = match pddl::nearest(name, self.objects()) {
            Some(nearest) => format!("did you mean `{nearest}`?"),
            None => format!("the map has {}", self.objects().collect::<Vec<_>>().join(", ")),
        };
        Some((format!("there is no `{name}` on the map"), help))
    }

    /// Whether the map or the ontology has an object of that name.
    pub(super) fn has_object(&self, name: &str) -> bool {
        self.objects().any(|object| object.eq_ignore_ascii_case(name))
    }

    fn objects(&self) -> impl Iterator<Item = &str> {
        let declared = self.problem.objects.iter().map(|declaration| &declaration.object);
        declared.chain(&self.domain.constants).map(|object| object.name.as_str())
    }
}

/// The path without `x/..`, for people to read.
fn shortened(path: &Path) -> PathBuf {
    let mut short = PathBuf::new();
    for component in path.components() {
        let last = short.components().next_back();
        match (component, last) {
            (Component::ParentDir, Some(Component::Normal(_))) => {
                short.pop();
            }
            _ => short.push(component),
        }
    }
    short
}

/// The file in the same folder whose name was likely meant.
fn similar_file(path: &Path) -> Option<String> {
    let wanted = path.file_name()?.to_string_lossy().into_owned();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new("."))).ok()?;
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    // Folders list their files in any order.
    names.sort();
    pddl::nearest(&wanted, names.iter().map(String::as_str)).map(str::to_owned)
}
