//! Checks the interfaces of an ecosystem file against both ecosystems, before anything is opened.
//! Each mistake is reported at its place in the text.

use std::collections::BTreeMap;
use std::path::Path;

use acl::AgentId;
use pddl::{ActionModel, Diagnostic, Domain, ObjectDeclaration, Privacy, Problem, Span};
use terminal::report::DiagnosticReport;

use ::interfacing::export::{self, EcosystemFiles};
use ::interfacing::translate::Translator;
use ::interfacing::vocabulary::{AgentMapping, InterfaceVocabulary, RuleDirection};

use crate::config::{Ecosystem, InterfaceEntry, KnownPlugin, Overrides, RuleEntry};
use crate::hosting;

/// The other ecosystem that an interface connects to.
pub(crate) struct PeerEcosystem {
    pub(crate) ecosystem: Ecosystem,
}

/// Reads the file of the other ecosystem, and checks the interface with index `index` against it.
///
/// # Errors
///
/// Returns the mistakes in the other ecosystem's file. If that has none, returns the mistakes in
/// the rules of the interface.
pub(crate) fn load(
    ecosystem: &Ecosystem,
    index: usize,
    known_plugins: &[KnownPlugin],
) -> Result<PeerEcosystem, DiagnosticReport> {
    let mut report = DiagnosticReport::default();
    let Some(other) = read(ecosystem, index, known_plugins, &mut report) else {
        return Err(report);
    };
    let mut desk = InterfaceCheck { ecosystem, index, report };
    desk.check_against(&other);
    if desk.report.has_errors() {
        return Err(desk.report);
    }
    Ok(PeerEcosystem { ecosystem: other })
}

/// Returns the mistakes in all interfaces of an ecosystem file.
pub(crate) fn check(ecosystem: &Ecosystem, known_plugins: &[KnownPlugin]) -> DiagnosticReport {
    let mut report = DiagnosticReport::default();
    for index in 0..ecosystem.interfaces.len() {
        if let Some(other) = read(ecosystem, index, known_plugins, &mut report) {
            let mut desk = InterfaceCheck { ecosystem, index, report: DiagnosticReport::default() };
            desk.check_against(&other);
            report.extend(desk.report);
        }
    }
    report
}

fn read(
    ecosystem: &Ecosystem,
    index: usize,
    known_plugins: &[KnownPlugin],
    report: &mut DiagnosticReport,
) -> Option<Ecosystem> {
    let file: &Path = &ecosystem.interfaces[index].file;
    if !file.exists() {
        let message = format!("`{}` cannot be read: there is no such file", file.display());
        let help = "paths are relative to the ecosystem file";
        let found = Diagnostic::error(Span::default(), message).with_help(help);
        say(ecosystem, &format!("interface.{index}.ecosystem"), found, report);
        return None;
    }
    // The command line and the environment concern only this ecosystem.
    let variables = crate::config::Variables::new();
    match Ecosystem::load_with(file, &variables, &Overrides::default(), known_plugins) {
        Ok(other) => Some(other),
        Err(error) => {
            report.extend(error.into_report());
            None
        }
    }
}

/// Reports the mistake `found` at the value with the path `path`, or at the nearest entry around
/// it.
fn say(ecosystem: &Ecosystem, path: &str, mut found: Diagnostic, report: &mut DiagnosticReport) {
    match ecosystem.places.find(path) {
        Some((source, place, is_it)) => {
            found.span = if is_it { place.value } else { place.key };
            report.add(&source, [found]);
        }
        None => report.add_general(found),
    }
}

/// The data of the check of one interface.
struct InterfaceCheck<'d> {
    ecosystem: &'d Ecosystem,
    index: usize,
    report: DiagnosticReport,
}

impl InterfaceCheck<'_> {
    fn entry(&self) -> &InterfaceEntry {
        &self.ecosystem.interfaces[self.index]
    }

    fn say(&mut self, path: &str, found: Diagnostic) {
        let path = format!("interface.{}.{path}", self.index);
        say(self.ecosystem, &path, found, &mut self.report);
    }

    fn check_against(&mut self, other: &Ecosystem) {
        let ours = self.ecosystem;
        if other.name == ours.name {
            let message = format!("the other ecosystem is called `{}` too", ours.name);
            let help = "two ecosystems of one name cannot be told apart";
            self.say("ecosystem", Diagnostic::error(Span::default(), message).with_help(help));
            return;
        }
        // A vocabulary must not have private words, so these have to be known here.
        let (our_models, their_models) =
            (hosting::whole_models(ours), hosting::whole_models(other));
        self.words(other, &our_models, &their_models);
        self.map_secrets(other);
        let entry = self.entry().clone();
        for (index, rule) in entry.imports.iter().enumerate() {
            let path = format!("import.{index}");
            self.is_known(&path, rule, &their_models);
            self.rule(&path, rule, RuleDirection::Import, (ours, other), &their_models);
        }
        for (index, rule) in entry.exports.iter().enumerate() {
            let path = format!("export.{index}");
            self.rule(&path, rule, RuleDirection::Export, (other, ours), &our_models);
        }
    }

    /// Warns if a rule imports an agent that the other ecosystem's file does not name. There is no
    /// warning if that file names no agents at all.
    fn is_known(&mut self, path: &str, rule: &RuleEntry, models: &Models) {
        let Some(agent) = rule.agent.as_ref().filter(|agent| !models.contains_key(*agent)) else {
            return;
        };
        if models.is_empty() {
            return;
        }
        let near = pddl::nearest(agent.as_str(), models.keys().map(AgentId::as_str));
        let message = format!("the other ecosystem's file has no actuator `{agent}`");
        let found = Diagnostic::warning(Span::default(), message).with_suggestion(near);
        self.say(&format!("{path}.agent"), found);
    }

    /// Warns about each word of the vocabulary that is not declared in the ecosystem of the lent
    /// agents.
    fn words(&mut self, other: &Ecosystem, our_models: &Models, their_models: &Models) {
        let entry = self.entry().clone();
        let ours = DeclaredNames::of(&self.ecosystem.domain, &self.ecosystem.problem, our_models);
        let theirs = DeclaredNames::of(&other.domain, &other.problem, their_models);
        let sorts = [
            ("types", "type", &entry.types, &ours.types, &theirs.types),
            ("predicates", "predicate", &entry.predicates, &ours.predicates, &theirs.predicates),
            ("functions", "function", &entry.functions, &ours.functions, &theirs.functions),
            ("objects", "object", &entry.objects, &ours.objects, &theirs.objects),
        ];
        let (imports, exports) = (!entry.imports.is_empty(), !entry.exports.is_empty());
        for (table, sort, words, ours, theirs) in sorts {
            for (our, their) in words {
                let (is_ours, is_theirs) = (ours.contains(our), theirs.contains(their));
                // An agent brings its words into the ecosystem that borrows it, so the words need
                // to exist only in the ecosystem that lends it.
                let (lends, is_there, word, known) = match (imports, exports) {
                    (true, true) => ("either ecosystem", is_ours || is_theirs, their, theirs),
                    (true, false) => ("the other ecosystem", is_theirs, their, theirs),
                    (false, _) => ("this ecosystem", is_ours, our, ours),
                };
                if is_there {
                    continue;
                }
                let near = pddl::nearest(word, known.iter().map(String::as_str));
                let message = format!("there is no {sort} `{word}` in {lends}");
                let found = Diagnostic::warning(Span::default(), message).with_suggestion(near);
                self.say(&format!("{table}.{our}"), found);
            }
        }
    }

    /// Reports those parts of a rule that cannot pass the interface, as far as the action model of
    /// the rule's agent is known.
    fn rule(
        &mut self,
        path: &str,
        rule: &RuleEntry,
        way: RuleDirection,
        (near, far): (&Ecosystem, &Ecosystem),
        models: &Models,
    ) {
        self.goals(path, rule);
        let Some(passage) = AgentMapping::of(rule, &far.name, way) else { return };
        let Some(model) = models.get(&passage.agent) else { return };
        let words = InterfaceVocabulary::of(self.entry(), way);
        self.secrets(&passage, &words, far, model, way);
        let shores = EcosystemFiles {
            far: (&far.domain, &far.problem),
            near: (&near.domain, &near.problem),
        };
        match export::export(&words, &passage, shores, model, &Default::default()) {
            Ok(exported) => {
                for left_out in exported.excluded {
                    let ours = match way {
                        RuleDirection::Import => &left_out.near,
                        RuleDirection::Export => &left_out.action,
                    };
                    let found = Diagnostic::error(Span::default(), left_out.to_string());
                    let found = match left_out.help() {
                        Some(help) => found.with_help(help),
                        None => found,
                    };
                    self.say(&format!("{path}.actions.{ours}"), found);
                }
            }
            Err(why) => self.say(
                &format!("{path}.agent"),
                Diagnostic::error(Span::default(), why).with_help(
                    "a proxy agent needs a type: export one of its types, under `types`",
                ),
            ),
        }
    }

    /// Reports words of the vocabulary that are private to the agent of a rule: private words never
    /// pass an interface.
    fn secrets(
        &mut self,
        passage: &AgentMapping,
        words: &InterfaceVocabulary,
        far: &Ecosystem,
        model: &ActionModel,
        way: RuleDirection,
    ) {
        let files = (&*far.domain, &*far.problem);
        let translator = Translator::of_model(words, passage, files, model);
        // Objects that are private in the map are excluded here: `map_secrets` reports them.
        let of_all = Translator::of_ontology(words, files);
        let tables = [
            ("predicates", &words.predicates),
            ("functions", &words.functions),
            ("objects", &words.objects),
        ];
        for (table, words) in tables {
            let is_secret = |word: &str| {
                translator.is_private(word) && !(table == "objects" && of_all.is_private(word))
            };
            for (word, near) in words.iter().filter(|(word, _)| is_secret(word)) {
                let ours = match way {
                    RuleDirection::Import => near.as_str(),
                    RuleDirection::Export => word.as_str(),
                };
                let message = format!("`{word}` is private to `{}`", passage.agent);
                let help = "nothing private ever passes: take it out";
                let found = Diagnostic::error(Span::default(), message).with_help(help);
                self.say(&format!("{table}.{ours}"), found);
            }
        }
    }

    /// Reports objects of the vocabulary that are private in one of the maps: private objects never
    /// pass an interface, in either direction.
    fn map_secrets(&mut self, other: &Ecosystem) {
        let ours = self.ecosystem;
        for (our, their) in &self.entry().objects.clone() {
            for (ecosystem, word) in [(ours, our), (other, their)] {
                let is_it = |it: &&ObjectDeclaration| it.object.name == word.as_str();
                let declared = ecosystem.problem.objects.iter().find(is_it);
                if declared.is_some_and(|it| matches!(it.privacy, Privacy::Private(_))) {
                    let message = format!("`{word}` is private in the map of `{}`", ecosystem.name);
                    let help = "nothing private ever passes: take it out";
                    let found = Diagnostic::error(Span::default(), message).with_help(help);
                    self.say(&format!("objects.{our}"), found);
                }
            }
        }
    }

    /// Reports predicates in the goals of a rule that are not in the vocabulary.
    fn goals(&mut self, path: &str, rule: &RuleEntry) {
        let known = self.entry().predicates.clone();
        for goal in rule.goals.iter().filter(|goal| !known.contains_key(*goal)) {
            let near = pddl::nearest(goal, known.keys().map(String::as_str));
            let message = format!("goals about `{goal}` cannot pass: it is not under `predicates`");
            let found = Diagnostic::error(Span::default(), message).with_suggestion(near);
            self.say(&format!("{path}.goals"), found);
        }
    }
}

type Models = BTreeMap<AgentId, ActionModel>;

/// The words that an ecosystem declares.
struct DeclaredNames {
    types: Vec<String>,
    predicates: Vec<String>,
    functions: Vec<String>,
    objects: Vec<String>,
}

impl DeclaredNames {
    fn of(domain: &Domain, map: &Problem, models: &Models) -> DeclaredNames {
        let text = |name: &pddl::Name| name.as_str().to_owned();
        let mut words = DeclaredNames {
            types: domain.types.iter().map(|it| text(&it.name)).collect(),
            predicates: domain.predicates.iter().map(|it| text(&it.name)).collect(),
            functions: domain.functions.iter().map(|it| text(&it.name)).collect(),
            objects: domain.constants.iter().map(|it| text(&it.name)).collect(),
        };
        words.types.push("object".to_owned());
        words.objects.extend(map.objects.iter().map(|it| text(&it.object.name)));
        for model in models.values() {
            words.types.extend(model.types.iter().map(|it| text(&it.name)));
            words.predicates.extend(model.predicates.iter().map(|it| text(&it.name)));
            words.functions.extend(model.functions.iter().map(|it| text(&it.name)));
            words.objects.extend(model.objects.iter().map(|it| text(&it.object.name)));
        }
        words
    }
}
