//! The ecosystem file: reads it, merges it with the built-in defaults, the environment and the
//! command line, and checks the meaning of the result.
//!
//! 1. `reader` checks the text of the file, and `environment` the variables, against the `schema`;
//!    each becomes a `layer` of values with their places.
//! 2. The `config` crate merges the layers: `defaults.toml` < file < environment < command line.
//! 3. `interpret` turns the merged values (`raw`) into an [`Ecosystem`], and reports values that
//!    are inconsistent.
//!
//! All mistakes are found in one pass; each is reported at its place in the text that contains it.

mod ecosystem;
mod goal_cures;
mod interpret;
mod raw;

mod schema;

mod reader;

mod syntax;

mod environment;

mod layer;

mod duration;

mod name_text;
pub(crate) mod number_text;

mod mistake_location;

mod search_paths;

#[cfg(test)]
mod tests;

use std::path::Path;
use std::sync::Arc;

use ::config::{Config, ConfigError, Value};
use agent::Mode;

pub(crate) use ::interfacing::{InterfaceEntry, RuleEntry};
#[cfg(feature = "web")]
pub(crate) use ecosystem::WebSettings;
pub(crate) use ecosystem::{
    AgentEntry, DEFAULT_AGENTS, Ecosystem, SecuritySettings, is_pddl, plain_goal,
};
pub(crate) use environment::{Variables, variables};
pub(crate) use interpret::moved_goal;
pub(crate) use mistake_location::MistakeLocation;
pub(crate) use search_paths::{credentials_folder, find_ecosystem_file, resolve_ecosystem};
pub(crate) use syntax::is_syntax_error;

use layer::Layer;
use raw::RawConfig;
use terminal::report::{DiagnosticReport, SourceText};

/// The properties of a plugin that the checks of ecosystem files need to know.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KnownPlugin {
    /// The name of the plugin.
    pub(crate) name: &'static str,
    /// The names of the drivers that the plugin offers; the first is the default.
    pub(crate) drivers: &'static [&'static str],
    /// Whether several daemons may host one agent of the plugin: one of them hosts the leader, and
    /// the others host standbys.
    pub(crate) stands_by: bool,
}

/// The values of keys that neither the file, the environment nor the command line sets.
const DEFAULTS: &str = include_str!("defaults.toml");
/// The name of the text [`DEFAULTS`] in messages.
const DEFAULTS_NAME: &str = "built-in defaults";

/// Values from the command line; they override the values of all other layers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Overrides(Vec<(String, Value)>);

/// All mistakes in an ecosystem file and the files that it names.
#[derive(Clone, Debug)]
pub(crate) struct ConfigLoadError(DiagnosticReport);

/// The result of reading an ecosystem file: what can be understood of it, and its mistakes.
#[derive(Debug)]
pub(crate) struct ParsedEcosystem {
    /// The ecosystem, without the parts that could not be understood; `None` if its name, its
    /// domain or its map is missing.
    pub(crate) ecosystem: Option<Ecosystem>,
    /// The errors and warnings that were found.
    pub(crate) report: DiagnosticReport,
    /// Whether the whole text is valid TOML. If it is not, a key that seems to be missing may stand
    /// in a part that could not be parsed.
    pub(crate) is_whole: bool,
}

// === impl Overrides ===

impl Overrides {
    /// Adds a value for one key, given by its path, such as `building.time-scale`.
    #[must_use]
    pub(crate) fn with(mut self, path: &str, value: impl Into<Value>) -> Overrides {
        self.0.push((path.to_owned(), value.into()));
        self
    }

    /// Adds the planning mode from `--mode`; `None` changes nothing.
    #[must_use]
    pub(crate) fn mode(self, mode: Option<Mode>) -> Overrides {
        match mode {
            None => self,
            Some(Mode::Centralized) => self.with("ecosystem.mode", "centralized"),
            Some(Mode::Decentralized) => self.with("ecosystem.mode", "decentralized"),
        }
    }

    /// Adds the endpoints from `--connect`, which the user may give several times; an empty list
    /// changes nothing.
    #[must_use]
    pub(crate) fn connect(self, endpoints: &[String]) -> Overrides {
        if endpoints.is_empty() {
            return self;
        }
        self.with("zenoh.connect.endpoints", endpoints.to_vec())
    }
}

// === impl ConfigLoadError ===

impl ConfigLoadError {
    /// Returns the report of the mistakes, for display.
    pub(crate) fn into_report(self) -> DiagnosticReport {
        self.0
    }
}

// === impl Ecosystem ===

impl Ecosystem {
    /// Reads an ecosystem file and all files that it names. Any mistake is an error.
    pub(crate) fn load(
        file: &Path,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Result<Ecosystem, ConfigLoadError> {
        Ecosystem::load_with(file, &variables(), overrides, known_plugins)
    }

    /// Reads an ecosystem file as [`Ecosystem::load`] does, with `variables` in place of the
    /// environment.
    pub(crate) fn load_with(
        file: &Path,
        variables: &Variables,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Result<Ecosystem, ConfigLoadError> {
        let ParsedEcosystem { ecosystem, report, .. } =
            Ecosystem::read_with(file, variables, overrides, known_plugins);
        match ecosystem {
            Some(ecosystem) if !report.has_errors() => Ok(ecosystem),
            _ => Err(ConfigLoadError(report)),
        }
    }

    /// Reads an ecosystem file. Returns all parts that can be understood, and all mistakes.
    pub(crate) fn read(
        file: &Path,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> ParsedEcosystem {
        Ecosystem::read_with(file, &variables(), overrides, known_plugins)
    }

    /// Reads a text as [`Ecosystem::read`] reads the file `file`, which may have another text, or
    /// not exist.
    pub(crate) fn read_text(
        file: &Path,
        text: &str,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> ParsedEcosystem {
        let name = terminal::visible::line(&file.display().to_string()).into_owned();
        let source = SourceText::new(name, text);
        Ecosystem::read_source(file, &source, &variables(), overrides, known_plugins)
    }

    fn read_with(
        file: &Path,
        variables: &Variables,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> ParsedEcosystem {
        match SourceText::read(file) {
            Ok(source) => {
                Ecosystem::read_source(file, &source, variables, overrides, known_plugins)
            }
            Err(failure) => {
                let mut report = DiagnosticReport::default();
                report.add_failure(failure);
                ParsedEcosystem { ecosystem: None, report, is_whole: false }
            }
        }
    }

    fn read_source(
        file: &Path,
        source: &Arc<SourceText>,
        variables: &Variables,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> ParsedEcosystem {
        let mut report = DiagnosticReport::default();
        let layers = read_layers(source, variables, &mut report);
        let [_, Layer { is_whole, places, .. }, _] = &layers;
        let is_whole = *is_whole;
        if !is_whole && !places.contains_key("ecosystem") {
            return ParsedEcosystem { ecosystem: None, report, is_whole };
        }
        match merge(&layers, overrides) {
            Ok(raw) => {
                let layers = &layers;
                let time_zone = raw.ecosystem.time_zone.clone();
                let privacy = raw.ecosystem.privacy;
                let written_agents = raw.agent.iter().filter_map(|agent| agent.name.clone());
                let meaning = interpret::Interpreter {
                    file,
                    layers,
                    known_plugins,
                    time_zone,
                    privacy,
                    written_agents: written_agents.collect(),
                    report,
                };
                let (ecosystem, report) = interpret::interpret(meaning, raw);
                ParsedEcosystem { ecosystem, report, is_whole }
            }
            Err(err) => {
                report.add_failure(format_args!("merge the configuration: {err}"));
                ParsedEcosystem { ecosystem: None, report, is_whole }
            }
        }
    }
}

/// Reads the layers of defaults, file and environment, in the order of increasing precedence.
fn read_layers(
    source: &Arc<SourceText>,
    variables: &Variables,
    report: &mut DiagnosticReport,
) -> [Layer; 3] {
    let readings = [
        reader::read(&SourceText::new(DEFAULTS_NAME, DEFAULTS)),
        reader::read(source),
        environment::read(variables),
    ];
    readings.map(|(layer, diagnostics)| {
        report.add(&layer.source, diagnostics);
        layer
    })
}

fn merge(layers: &[Layer], overrides: &Overrides) -> Result<RawConfig, ConfigError> {
    let mut builder = Config::builder();
    for layer in layers {
        builder = builder.add_source(layer.clone());
    }
    for (path, value) in &overrides.0 {
        builder = builder.set_override(path, value.clone())?;
    }
    builder.build()?.try_deserialize()
}
