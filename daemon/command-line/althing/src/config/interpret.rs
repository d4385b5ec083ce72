//! Turns the merged values of all layers into an ecosystem: checks names, references, files,
//! durations and goals.
//!
//! The checks continue after a mistake, so that all mistakes are found. A mistake is reported at
//! the place of the value in effect: in the environment if a variable overrides the file, otherwise
//! in the file.

mod agents;

mod doors;

mod files;

mod goals;

mod hardware_stops;

mod interfaces;

mod metrics;

mod reasoning;

mod rights;

mod rooms;

mod safeguards;

mod timing;

mod watchdogs;

mod web;

mod words;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::building::Quantity;
use acl::{DaemonId, EcosystemId, InvalidName};
use agent::{AdmissionPolicy, AllowedNames, ModelPrivacy, Rights};
use pddl::{Diagnostic, Span};

use super::ecosystem::{AgentEntry, BuildingSettings, Ecosystem, PluginSettings, SourceTexts};
use super::layer::{KeyValueSpan, Layer, SourceMap};
use super::raw::{RawBuilding, RawConfig, RawEcosystem, RawPlugins};
use super::{InterfaceEntry, KnownPlugin};
use files::{DescribedBuilding, PddlFiles};
pub(crate) use goals::relocate as moved_goal;
use reasoning::FileHosts;
use terminal::report::{DiagnosticReport, SourceText};

/// The file of people if the ecosystem file names none.
const PEOPLE_FILE: &str = "people.toml";

/// The data that all checks of the configuration share: the places of values, and the mistakes
/// found so far.
pub(super) struct Interpreter<'l> {
    pub(super) file: &'l Path,
    pub(super) layers: &'l [Layer],
    pub(super) known_plugins: &'l [KnownPlugin],
    /// Name of the time zone of the ecosystem; `None` if the file names none.
    pub(super) time_zone: Option<String>,
    /// From which agents `:private` declarations of models are kept.
    pub(super) privacy: ModelPrivacy,
    /// Names of all agents of the file. Entries with mistakes count, too.
    pub(super) written_agents: BTreeSet<String>,
    pub(super) report: DiagnosticReport,
}

/// The ecosystem, as far as it can be understood, and all mistakes.
type InterpretedEcosystem = (Option<Ecosystem>, DiagnosticReport);

/// Turns the merged values into an ecosystem, leaving out what has mistakes. The ecosystem is
/// `None` if its name, its domain or its map is missing. The returned report contains all mistakes,
/// those that `meaning` has already included.
///
/// The pattern for `raw` has no `..`, so that a new table cannot be overlooked here. The time zone
/// and the privacy are in `meaning`.
pub(super) fn interpret(mut meaning: Interpreter<'_>, raw: RawConfig) -> InterpretedEcosystem {
    let RawConfig {
        ecosystem: RawEcosystem { name, domain, problem, vocabulary, reasoning, mode, daemons, .. },
        rooms,
        doors,
        zenoh,
        agent,
        interface,
        mut goals,
        timing,
        limits,
        security,
        rights,
        people,
        safeguards,
        hardware_stops,
        plugins,
        metrics,
        web,
        building,
        words,
    } = raw;
    let (path, layers, name) = (meaning.file, meaning.layers, meaning.name(name));
    let described = DescribedBuilding { domain, problem, vocabulary, rooms, doors };
    let files = meaning.files(name.as_ref(), described);
    let hosts = FileHosts { reasoning, interface: &interface, daemons: &daemons, web: &web };
    let (agents, limited) = meaning.all_agents(agent, &hosts, files.as_ref());
    let interfaces = meaning.interfaces(interface, &agents, files.as_ref());
    let daemons = with_hosts(meaning.daemons(&daemons), &agents, &interfaces);
    let (words, metrics) = (meaning.words(words, &mut goals), meaning.metrics(metrics));
    let (goals, settings) = (meaning.goals(goals), meaning.settings(&timing, &limits, &agents));
    let (security, plugins) = (meaning.security(security, name.as_ref()), meaning.plugins(plugins));
    let rights = with_borrowed_agents(meaning.rights(&rights, &agents, &limited), &interfaces);
    let safeguards = meaning.safeguards(safeguards, &agents, files.as_ref());
    let hardware_stops = meaning.hardware_stops(hardware_stops, &agents, files.as_ref());
    let (web, building) = (meaning.web(web, &daemons), meaning.building(building, files.as_ref()));
    let (report, whole) = (meaning.into_report(&agents), (name, files, layers.get(1)));
    let (Some(name), Some(files), Some(file)) = whole else { return (None, report) };
    let ecosystem = Ecosystem {
        name,
        folder: path.parent().unwrap_or(Path::new("")).to_owned(),
        domain: Arc::new(files.domain),
        problem: Arc::new(files.problem),
        mode,
        daemons,
        agents,
        interfaces,
        goals,
        zenoh,
        settings,
        security,
        rights,
        people: beside(path, people.file.as_deref().unwrap_or(PEOPLE_FILE)),
        is_people_file_named: people.file.is_some(),
        safeguards,
        hardware_stops,
        plugins,
        metrics,
        web,
        building,
        words,
        places: SourceMap::of(layers),
        sources: SourceTexts { file: Arc::clone(&file.source), map: files.map_source },
        are_files_sound: files.are_sound,
    };
    (Some(ecosystem), report)
}

/// Returns the path of a file that an ecosystem file names, relative to its own folder.
fn beside(file: &Path, named: &str) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(named)
}

/// Adds the daemons that host agents or interfaces to those that the file lists.
fn with_hosts(
    mut daemons: BTreeSet<DaemonId>,
    agents: &[AgentEntry],
    interfaces: &[InterfaceEntry],
) -> BTreeSet<DaemonId> {
    daemons.extend(agents.iter().flat_map(|agent| agent.daemons.clone()));
    daemons.extend(interfaces.iter().filter_map(|interface| interface.daemon.clone()));
    daemons
}

/// Lets each daemon that runs an interface also bring the agents that the interface borrows.
fn with_borrowed_agents(mut rights: Rights, interfaces: &[InterfaceEntry]) -> Rights {
    if let AllowedNames::These(newcomers) = &mut rights.newcomers {
        newcomers.extend(interfaces.iter().filter_map(|interface| interface.daemon.clone()));
    }
    rights
}

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Returns all mistakes, in the order of the text, after the checks that need all agents.
    fn into_report(mut self, agents: &[AgentEntry]) -> DiagnosticReport {
        self.warn_unwatched_robots(agents);
        self.warn_idle_domains(agents);
        self.report.sort();
        self.report
    }

    /// Returns the settings for plugins. If the folder of packages is relative, it is relative to
    /// the ecosystem file's folder.
    fn plugins(&self, raw: RawPlugins) -> PluginSettings {
        let RawPlugins { folder, admit, confinement } = raw;
        let beside = |folder: String| self.file.parent().unwrap_or(Path::new("")).join(folder);
        let admit = match admit.as_str() {
            "listed" => AdmissionPolicy::Listed,
            "ask" => AdmissionPolicy::Ask,
            // The schema allows no other value.
            _ => AdmissionPolicy::All,
        };
        let requires_confinement = confinement == "require";
        PluginSettings { folder: folder.map(beside), admit, requires_confinement }
    }

    /// Returns the place of the value at `path` in the layer with the highest precedence: the
    /// environment overrides the file.
    fn place(&self, path: &str) -> Option<(Arc<SourceText>, KeyValueSpan)> {
        self.layers.iter().rev().find_map(|layer| {
            layer.places.get(path).map(|place| (Arc::clone(&layer.source), *place))
        })
    }

    /// Reports a mistake in the value at `path`; `make` receives the span of the value and returns
    /// the diagnostic.
    fn about_value(&mut self, path: &str, make: impl FnOnce(Span) -> Diagnostic) {
        match self.place(path) {
            Some((source, place)) => self.report.add(&source, [make(place.value)]),
            None => self.report.add_general(make(Span::default())),
        }
    }

    /// Reports a mistake in the key or entry at `path`; `make` receives the span of the key and
    /// returns the diagnostic.
    fn about_key(&mut self, path: &str, make: impl FnOnce(Span) -> Diagnostic) {
        match self.place(path) {
            Some((source, place)) => self.report.add(&source, [make(place.key)]),
            None => self.about_file(make(Span::default())),
        }
    }

    /// Reports a mistake that concerns the ecosystem file as a whole.
    fn about_file(&mut self, diagnostic: Diagnostic) {
        match self.layers.get(1) {
            Some(file) => self.report.add(&file.source, [diagnostic]),
            None => self.report.add_general(diagnostic),
        }
    }

    /// Reports that a required key is missing. Does nothing if the key is in the file: then its
    /// value was wrong, which is reported already.
    fn missing(&mut self, table: &str, key: &str, example: &str) {
        if self.place(&super::reader::join(table, key)).is_some() {
            return;
        }
        let spoken = super::reader::display_path(table);
        let message = format!("`{key}` is missing in `{spoken}`");
        let help = format!("write {key} = \"{example}\"");
        // The built-in defaults have the table too, so only the texts of the user are searched.
        let written = self.layers.iter().skip(1).rev().find_map(|layer| {
            layer.places.get(table).map(|place| (Arc::clone(&layer.source), place.key))
        });
        match written {
            Some((source, span)) => {
                self.report.add(&source, [Diagnostic::error(span, message).with_help(help)]);
            }
            None => {
                let help = format!("{help} under [{spoken}]");
                self.about_file(Diagnostic::error(Span::default(), message).with_help(help));
            }
        }
    }

    /// Reports that the value at `path` is not a valid name.
    fn invalid_name(&mut self, path: &str, err: &InvalidName) {
        let message = format!("`{}` cannot be the name of {}", err.name, err.what);
        let help = match crate::config::name_text::suggestion(&err.name) {
            Some(meant) => format!("{}, such as `{meant}`", err.rule),
            None => err.rule.to_owned(),
        };
        self.about_value(path, |span| Diagnostic::error(span, message).with_help(help));
    }

    fn name(&mut self, name: Option<String>) -> Option<EcosystemId> {
        let Some(name) = name else {
            self.missing("ecosystem", "name", "smart-office");
            return None;
        };
        EcosystemId::new(&name).map_err(|err| self.invalid_name("ecosystem.name", &err)).ok()
    }

    fn daemons(&mut self, names: &[String]) -> BTreeSet<DaemonId> {
        let mut daemons = BTreeSet::new();
        for (index, name) in names.iter().enumerate() {
            let path = format!("ecosystem.daemons.{index}");
            match DaemonId::new(name) {
                Ok(daemon) if daemons.insert(daemon.clone()) => (),
                Ok(daemon) => self.about_value(&path, |span| {
                    Diagnostic::warning(span, format!("daemon `{daemon}` is listed twice"))
                }),
                Err(err) => self.invalid_name(&path, &err),
            }
        }
        daemons
    }

    /// Reports quantities in `conditions` that places of the simulated building cannot have.
    fn quantities(&mut self, conditions: &BTreeMap<String, BTreeMap<String, f64>>) {
        for (place, values) in conditions {
            for name in values.keys().filter(|name| Quantity::named(name).is_none()) {
                let known: Vec<_> = Quantity::all().map(Quantity::name).collect();
                let message = format!("unknown quantity `{name}`");
                let help = match pddl::nearest(name, known.iter().copied()) {
                    Some(nearest) => format!("did you mean `{nearest}`?"),
                    None => format!("known are {}", known.join(", ")),
                };
                self.about_key(&format!("building.conditions.{place}.{name}"), |span| {
                    Diagnostic::error(span, message).with_help(help)
                });
            }
        }
    }

    /// Returns the settings of the simulated building. Reports a place in them that is not on the
    /// map.
    fn building(&mut self, raw: RawBuilding, files: Option<&PddlFiles>) -> BuildingSettings {
        let RawBuilding { temperatures, conditions, time_scale, socket } = raw;
        let under = |key: &'static str, place: &String| (format!("{key}.{place}"), place.clone());
        let temperate = temperatures.keys().map(|place| under("temperatures", place));
        let conditioned = conditions.keys().map(|place| under("conditions", place));
        for (path, place) in temperate.chain(conditioned) {
            if let Some((message, help)) = files.and_then(|files| files.unknown_object(&place)) {
                let path = format!("building.{path}");
                self.about_key(&path, |span| Diagnostic::error(span, message).with_help(help));
            }
        }
        self.quantities(&conditions);
        let beside = |socket: String| self.file.parent().unwrap_or(Path::new("")).join(socket);
        BuildingSettings { temperatures, conditions, time_scale, socket: socket.map(beside) }
    }
}
