//! The shared ontology and the map: from the PDDL files that an ecosystem file names, or from its
//! tables `[rooms]` and `[doors]` and the standard ontology.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use acl::EcosystemId;
use ontology::BuildingPlan;
use pddl::{Diagnostic, Document, Domain, Problem, Span};
use serde_json::Value;
use terminal::pddl_files::{self, DomainText};
use terminal::report::{SourceText, similar_name};

use super::Interpreter;

/// Maximum number of objects of the map that an error message lists; the others are only counted.
const OBJECTS_LISTED_MAX: usize = 12;

/// Number of levels above the ecosystem file's folder that are searched for a file that is missing
/// at the path in the ecosystem file.
const FOLDERS_ABOVE_MAX: usize = 3;

/// Name of a map whose ecosystem has no valid name.
const NAMELESS_BUILDING: &str = "building";

/// The values of an ecosystem file that describe the building and its words.
pub(super) struct DescribedBuilding {
    pub(super) domain: Option<String>,
    pub(super) problem: Option<String>,
    pub(super) vocabulary: Option<String>,
    pub(super) rooms: BTreeMap<String, Value>,
    pub(super) doors: BTreeMap<String, Value>,
}

/// The shared ontology and the map, as far as they can be read.
pub(super) struct PddlFiles {
    pub(super) domain: Domain,
    pub(super) problem: Problem,
    /// The text in which the map is written.
    pub(super) map_source: Arc<SourceText>,
    /// Whether the map is made from `[rooms]` and `[doors]`.
    pub(super) is_of_tables: bool,
    /// The lines of the map that could not be read, or the names of places that are refused.
    damaged: String,
    /// Whether the ontology and the map are free of errors. If they are not, checks against them
    /// prove nothing.
    pub(super) are_sound: bool,
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Reads the ontology and the map. Mistakes are reported at their places in the PDDL files, or
    /// in the tables of the ecosystem file.
    pub(super) fn files(
        &mut self,
        name: Option<&EcosystemId>,
        described: DescribedBuilding,
    ) -> Option<PddlFiles> {
        let errors_before = self.errors();
        let DescribedBuilding { domain, problem, vocabulary, rooms, doors } = described;
        let has_table = |table: &&str| match *table {
            "rooms" => !rooms.is_empty() || self.place("rooms").is_some(),
            _ => !doors.is_empty() || self.place("doors").is_some(),
        };
        let table = ["rooms", "doors"].into_iter().find(has_table);
        let named = ["problem", "domain"]
            .into_iter()
            .find(|key| self.place(&format!("ecosystem.{key}")).is_some());
        match (table, named) {
            (Some(table), Some(key)) => {
                self.told_twice(table, key);
                None
            }
            (None, Some(_)) => {
                self.vocabulary_beside_domain(vocabulary.as_deref());
                self.named_files(domain, problem, errors_before)
            }
            (None, None) => {
                self.no_building();
                None
            }
            (Some(_), None) => {
                let domain = self.standard_or_extended(vocabulary)?;
                let name = name.map_or(NAMELESS_BUILDING, EcosystemId::as_str);
                self.tables(name, domain, (rooms, doors), errors_before)
            }
        }
    }

    /// Reads the two files that describe a building in PDDL.
    fn named_files(
        &mut self,
        domain: Option<String>,
        problem: Option<String>,
        errors_before: usize,
    ) -> Option<PddlFiles> {
        let domain = self.named_file("domain", domain, "domain.pddl");
        let problem = self.named_file("problem", problem, "map.pddl");
        let domain = domain.map(|source| pddl_files::domain_of(source, &mut self.report));
        let problem = problem.and_then(|source| {
            let problem = pddl_files::map_of(&source, domain.as_ref(), &mut self.report)?;
            let damaged = pddl_files::damaged_lines(
                &source.text,
                &pddl::parse_problem(&source.text).diagnostics,
            );
            Some((source, problem, damaged.join("\n")))
        });
        let are_sound = self.errors() == errors_before;
        let is_of_tables = false;
        match (domain, problem) {
            (
                Some(DomainText { domain: Some(domain), .. }),
                Some((map_source, problem, damaged)),
            ) => Some(PddlFiles { domain, problem, map_source, is_of_tables, damaged, are_sound }),
            _ => None,
        }
    }

    /// Makes the map from the tables `[rooms]` and `[doors]`.
    fn tables(
        &mut self,
        name: &str,
        domain: Domain,
        (rooms, doors): (BTreeMap<String, Value>, BTreeMap<String, Value>),
        errors_before: usize,
    ) -> Option<PddlFiles> {
        let map_source = Arc::clone(&self.layers.get(1)?.source);
        let (places, refused) = self.rooms(&rooms, &domain);
        let doors = self.doors(&doors, &places, &refused);
        let plan = BuildingPlan { places, doors };
        let problem = plan.map(name, &domain.name);
        self.report.add(&map_source, pddl::check_map(&domain, &problem));
        let are_sound = self.errors() == errors_before;
        let damaged = refused.join("\n");
        Some(PddlFiles { domain, problem, map_source, is_of_tables: true, damaged, are_sound })
    }

    /// Returns the standard ontology, extended by the vocabulary that the ecosystem file names, if it
    /// names one. Returns `None` if the vocabulary cannot be read.
    fn standard_or_extended(&mut self, vocabulary: Option<String>) -> Option<Domain> {
        let standard = ontology::standard_domain();
        if self.place("ecosystem.vocabulary").is_none() {
            return Some(standard.clone());
        }
        let source = self.named_file("vocabulary", vocabulary, "words.pddl")?;
        let extend = |more: &Domain| ontology::extended(standard, more);
        pddl_files::vocabulary_of(&source, extend, &mut self.report)
    }

    /// Reports that the building is described both by tables and by a PDDL file.
    fn told_twice(&mut self, table: &str, key: &str) {
        let message = format!("[{table}] and `{key}` of [ecosystem] both describe the building");
        let help = match key {
            "problem" => "take one of the two out: [rooms] and [doors] say what a map in PDDL says",
            _ => {
                "take one of the two out: with [rooms] the standard ontology is used, and \
                 vocabulary = \"FILE\" adds words to it"
            }
        };
        self.about_key(&format!("ecosystem.{key}"), |span| {
            Diagnostic::error(span, message).with_help(help)
        });
    }

    fn vocabulary_beside_domain(&mut self, vocabulary: Option<&str>) {
        if vocabulary.is_some() {
            self.about_key("ecosystem.vocabulary", |span| {
                let message = "`vocabulary` adds words to the standard ontology, and `domain` \
                               replaces it";
                Diagnostic::error(span, message).with_help("take one of the two out")
            });
        }
    }

    /// Reports that the file describes no building.
    fn no_building(&mut self) {
        let message = "the file says nothing of the building: `[rooms]` is missing";
        let help = "write its places, one in a line, such as\n[rooms]\noffice1 = {}\nor name a \
                    domain and a map in PDDL by `domain` and `problem` under [ecosystem]";
        // The built-in defaults have the table too, so only the texts of the user are searched.
        let written = self.layers.iter().skip(1).find_map(|layer| {
            layer.places.get("ecosystem").map(|place| (Arc::clone(&layer.source), place.key))
        });
        let found = |span| Diagnostic::error(span, message).with_help(help);
        match written {
            Some((source, span)) => self.report.add(&source, [found(span)]),
            None => self.about_file(found(Span::default())),
        }
    }

    fn errors(&self) -> usize {
        self.report.count(pddl::Severity::Error)
    }

    /// Reads a file that the ecosystem file names by a path relative to itself. If that fails,
    /// reports it and returns `None`.
    fn named_file(
        &mut self,
        key: &str,
        written: Option<String>,
        example: &str,
    ) -> Option<Arc<SourceText>> {
        let Some(written) = written else {
            self.missing("ecosystem", key, example);
            return None;
        };
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let path = folder.join(&written);
        match SourceText::read_as(&path, &shortened(&path).display().to_string()) {
            Ok(source) => self.of_kind(key, &written, source),
            Err(reason) => {
                let message = format!("`{written}` cannot be read: {reason}");
                let help = match path_meant(folder, &written) {
                    Some(path) => format!("did you mean `{path}`?"),
                    None => "paths are relative to the ecosystem file".to_owned(),
                };
                let path = format!("ecosystem.{key}");
                self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
                None
            }
        }
    }
}

impl Interpreter<'_> {
    /// Returns `source`, unless its text is clearly of the other kind. In that case reports a
    /// mistake and returns `None`: the paths of domain and map are easily swapped.
    fn of_kind(
        &mut self,
        key: &str,
        written: &str,
        source: Arc<SourceText>,
    ) -> Option<Arc<SourceText>> {
        let is = match pddl::parse_document(&source.text).value {
            Some(Document::Domain(_)) => ("domain", "a domain (types, predicates, functions)"),
            Some(Document::Problem(_)) => ("problem", "a map (objects and facts)"),
            Some(Document::ActionModel(_)) => ("model", "the action model of an agent"),
            None => return Some(source),
        };
        let expected = if key == "vocabulary" { "domain" } else { key };
        if is.0 == expected {
            return Some(source);
        }
        let message = format!("`{written}` is {}", is.1);
        let help = match key {
            "domain" => "`domain` names the file that begins with (define (domain …",
            "vocabulary" => "`vocabulary` names a file that begins with (define (domain …",
            _ => "`problem` names the file that begins with (define (problem …",
        };
        let path = format!("ecosystem.{key}");
        self.about_value(&path, |span| Diagnostic::error(span, message).with_help(help));
        None
    }
}

// === impl PddlFiles ===

impl PddlFiles {
    /// Returns an error message and a help text if the map has no object `name`. Returns `None` if
    /// the map has the object, or if the name occurs in a part of the map that could not be read.
    pub(super) fn unknown_object(&self, name: &str) -> Option<(String, String)> {
        if self.objects().any(|object| object == name) || self.is_damaged(name) {
            return None;
        }
        let message = match self.is_of_tables {
            true => format!("there is no `{name}` under [rooms]"),
            false => format!("there is no `{name}` on the map"),
        };
        if let Some(object) = self.objects().find(|object| object.eq_ignore_ascii_case(name)) {
            let help = format!("names are in lower case here: write \"{object}\"");
            return Some((message, help));
        }
        let help = match (pddl::nearest(name, self.objects()), self.is_of_tables) {
            (Some(nearest), _) => format!("did you mean `{nearest}`?"),
            (None, true) => format!("[rooms] has {}", self.some_objects()),
            (None, false) => format!("the map has {}", self.some_objects()),
        };
        Some((message, help))
    }

    /// Whether a name occurs in a part of the map that could not be read.
    fn is_damaged(&self, name: &str) -> bool {
        // The name of a refused place may have spaces.
        pddl_files::has_word(&self.damaged, name)
            || !name.is_empty() && self.damaged.lines().any(|line| line == name)
    }

    /// Whether the map or the ontology has an object named `name`.
    pub(super) fn has_object(&self, name: &str) -> bool {
        self.objects().any(|object| object.eq_ignore_ascii_case(name))
    }

    /// Lists objects of the map as a text, at most [`OBJECTS_LISTED_MAX`] of them.
    fn some_objects(&self) -> String {
        let mut names: Vec<String> =
            self.objects().take(OBJECTS_LISTED_MAX).map(str::to_owned).collect();
        let others = self.objects().count() - names.len();
        if others > 0 {
            names.push(format!("and {others} others"));
        }
        names.join(", ")
    }

    pub(super) fn objects(&self) -> impl Iterator<Item = &str> {
        let declared = self.problem.objects.iter().map(|declaration| &declaration.object);
        declared.chain(&self.domain.constants).map(|object| object.name.as_str())
    }
}

/// Removes detours (`x/..`) from a path, for display.
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

/// Returns the path, relative to `folder`, of the file that was probably meant by `written`: a file
/// of this path in a folder above, a file within the folder that `written` names, or a file with a
/// similar name.
fn path_meant(folder: &Path, written: &str) -> Option<String> {
    let path = folder.join(written);
    if path.is_dir() {
        let word = if written.is_empty() { "." } else { written.trim_end_matches('/') };
        let names = file_names(&path);
        let pddl = names.iter().find(|name| name.ends_with(".pddl"))?;
        return Some(format!("{word}/{pddl}"));
    }
    let mut above = written.to_owned();
    for _ in 0..FOLDERS_ABOVE_MAX {
        above.insert_str(0, "../");
        if folder.join(&above).is_file() {
            return Some(above);
        }
    }
    let wanted = path.file_name()?.to_string_lossy().into_owned();
    let near = similar_name(path.parent()?, &wanted)?;
    let parent = Path::new(written).parent().filter(|parent| !parent.as_os_str().is_empty());
    Some(parent.map_or(near.clone(), |parent| format!("{}/{near}", parent.display())))
}

/// Returns the names of the files in a folder, sorted, because the system returns them in any
/// order.
fn file_names(folder: &Path) -> Vec<String> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}
