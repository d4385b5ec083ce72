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
pub(crate) use ecosystem::{AgentEntry, Ecosystem, SecuritySettings, wish_for};
pub(crate) use environment::{Variables, variables};
pub(crate) use find::{credentials_folder, find_ecosystem_file, resolve_ecosystem};

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
        let mut report = Report::default();
        let source = Source::read(file).map_err(|failure| {
            report.add_failure(failure);
            LoadError(report.clone())
        })?;
        let layers = read_layers(&source, variables, &mut report);
        let [_, file_layer, _] = &layers;
        if !file_layer.is_whole && !file_layer.places.contains_key("ecosystem") {
            // What seems to be missing may stand where nothing could be read.
            return Err(LoadError(report));
        }
        let raw = merge(&layers, overrides).map_err(|err| {
            report.add_failure(format_args!("merge the configuration: {err}"));
            LoadError(report.clone())
        })?;
        meaning::understand(file, raw, &layers, known_plugins, report).map_err(LoadError)
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
