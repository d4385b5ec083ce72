//! The ecosystem file: read, layered with defaults, environment and command line, understood.
//!
//! 1. `reader` holds the file's text, and `environment` the variables, against the `schema`; each
//!    becomes a `layer` of values with their places.
//! 2. The `config` crate merges the layers: `defaults.toml` < file < environment < command line.
//! 3. `meaning` makes an [`Ecosystem`] of what was written (`raw`), and says what does not fit.
//!
//! All mistakes are found in one pass; each points into the text where it was made.

mod ecosystem;
mod meaning;
mod raw;

mod schema;

mod reader;

mod syntax;

mod environment;

mod layer;

mod duration;

mod find;

#[cfg(test)]
mod tests;

use std::path::Path;
use std::sync::Arc;

use ::config::{Config, ConfigError, Value};
use agent::Mode;

pub(crate) use ::interfacing::{InterfaceEntry, RuleEntry};
pub(crate) use ecosystem::{AgentEntry, Ecosystem, SecuritySettings, is_pddl, wish_for};
pub(crate) use environment::{Variables, variables};
pub(crate) use find::{credentials_folder, find_ecosystem_file, resolve_ecosystem};
pub(crate) use meaning::moved_goal;
pub(crate) use syntax::is_syntax_error;

use layer::Layer;
use raw::Raw;
use terminal::report::{Report, Source};

/// What an ecosystem file may say of a plugin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct KnownPlugin {
    /// Its name.
    pub(crate) name: &'static str,
    /// The drivers it has.
    pub(crate) drivers: &'static [&'static str],
    /// Whether several daemons may host it.
    pub(crate) stands_by: bool,
}

/// What holds where nobody says anything.
const DEFAULTS: &str = include_str!("defaults.toml");
/// What that text is called.
const DEFAULTS_NAME: &str = "built-in defaults";

/// What the command line says, over everything else.
#[derive(Clone, Debug, Default)]
pub(crate) struct Overrides(Vec<(String, Value)>);

/// Everything that is wrong with an ecosystem file and the files it names.
#[derive(Clone, Debug)]
pub(crate) struct LoadError(Report);

/// An ecosystem file as far as it can be understood, and what is wrong with it.
#[derive(Debug)]
pub(crate) struct Reading {
    /// The ecosystem without what could not be understood; `None` where its name, its domain or its
    /// map is missing.
    pub(crate) ecosystem: Option<Ecosystem>,
    /// The mistakes and the doubts.
    pub(crate) report: Report,
    /// Whether all of the text is TOML. What seems to be missing may otherwise stand where nothing
    /// could be read.
    pub(crate) is_whole: bool,
}

// === impl Overrides ===

impl Overrides {
    /// Sets one key by its path, such as `building.time-scale`.
    #[must_use]
    pub(crate) fn with(mut self, path: &str, value: impl Into<Value>) -> Overrides {
        self.0.push((path.to_owned(), value.into()));
        self
    }

    /// `--mode`
    #[must_use]
    pub(crate) fn mode(self, mode: Option<Mode>) -> Overrides {
        match mode {
            None => self,
            Some(Mode::Centralized) => self.with("ecosystem.mode", "centralized"),
            Some(Mode::Decentralized) => self.with("ecosystem.mode", "decentralized"),
        }
    }

    /// `--connect`, any number of times; none leaves what the file says.
    #[must_use]
    pub(crate) fn connect(self, endpoints: &[String]) -> Overrides {
        if endpoints.is_empty() {
            return self;
        }
        self.with("zenoh.connect.endpoints", endpoints.to_vec())
    }
}

// === impl LoadError ===

impl LoadError {
    /// The mistakes, to be shown.
    pub(crate) fn into_report(self) -> Report {
        self.0
    }
}

// === impl Ecosystem ===

impl Ecosystem {
    /// Reads an ecosystem file and all that it names.
    pub(crate) fn load(
        file: &Path,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Result<Ecosystem, LoadError> {
        Ecosystem::load_with(file, &variables(), overrides, known_plugins)
    }

    /// The same with the environment as a parameter.
    pub(crate) fn load_with(
        file: &Path,
        variables: &Variables,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Result<Ecosystem, LoadError> {
        let Reading { ecosystem, report, .. } =
            Ecosystem::read_with(file, variables, overrides, known_plugins);
        match ecosystem {
            Some(ecosystem) if !report.has_errors() => Ok(ecosystem),
            _ => Err(LoadError(report)),
        }
    }

    /// Reads as much of an ecosystem file as can be understood.
    pub(crate) fn read(
        file: &Path,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Reading {
        Ecosystem::read_with(file, &variables(), overrides, known_plugins)
    }

    fn read_with(
        file: &Path,
        variables: &Variables,
        overrides: &Overrides,
        known_plugins: &[KnownPlugin],
    ) -> Reading {
        let mut report = Report::default();
        let source = match Source::read(file) {
            Ok(source) => source,
            Err(failure) => {
                report.add_failure(failure);
                return Reading { ecosystem: None, report, is_whole: false };
            }
        };
        let layers = read_layers(&source, variables, &mut report);
        let [_, Layer { is_whole, places, .. }, _] = &layers;
        let is_whole = *is_whole;
        if !is_whole && !places.contains_key("ecosystem") {
            return Reading { ecosystem: None, report, is_whole };
        }
        match merge(&layers, overrides) {
            Ok(raw) => {
                let (ecosystem, report) =
                    meaning::understand(file, raw, &layers, known_plugins, report);
                Reading { ecosystem, report, is_whole }
            }
            Err(err) => {
                report.add_failure(format_args!("merge the configuration: {err}"));
                Reading { ecosystem: None, report, is_whole }
            }
        }
    }
}

/// Defaults, file and environment, weakest first.
fn read_layers(source: &Arc<Source>, variables: &Variables, report: &mut Report) -> [Layer; 3] {
    let readings = [
        reader::read(&Source::new(DEFAULTS_NAME, DEFAULTS)),
        reader::read(source),
        environment::read(variables),
    ];
    readings.map(|(layer, diagnostics)| {
        report.add(&layer.source, diagnostics);
        layer
    })
}

fn merge(layers: &[Layer], overrides: &Overrides) -> Result<Raw, ConfigError> {
    let mut builder = Config::builder();
    for layer in layers {
        builder = builder.add_source(layer.clone());
    }
    for (path, value) in &overrides.0 {
        builder = builder.set_override(path, value.clone())?;
    }
    builder.build()?.try_deserialize()
}
