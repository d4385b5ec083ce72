//! `plugin.toml`, the manifest of a package: parsing and checks, without access to files or a
//! clock.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use acl::content::{Method, Methods};
use acl::{AgentId, Millis, SCHEMA_VERSION};
use pddl::{Diagnostic, Span};
use serde::Deserialize;
use serde_json::Value;
use toml::Spanned;

use crate::rights::{Permissions, bytes_of, device_objection, read_objection};
use crate::wording::worded;

/// Longest manifest that is accepted, in bytes.
pub(crate) const MANIFEST_BYTES_MAX: u64 = 256 << 10;

/// Smallest limit of memory or disk that a manifest may request, in bytes (1 MiB).
const BYTES_LEAST: u64 = 1 << 20;
/// Default of the key `ready-within` of a manifest. It is enough for an interpreter on a small
/// board to start with its devices.
const READY_WITHIN_DEFAULT: Duration = Duration::from_secs(20);
/// Longest timeout of an action that a manifest may give; a longer one is reported as a mistake.
const TIMEOUT_MAX: Duration = Duration::from_secs(24 * 3_600);

/// Parsed contents of a package's manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct PackageManifest {
    /// Name of the package, which is also the name of its folder.
    pub name: String,
    /// Version of the package, for people.
    pub version: String,
    /// Description of the package, one line.
    pub about: String,
    /// Program of the package and the program's arguments. A program with a `/` is a file of the
    /// package.
    pub run: Vec<String>,
    /// Place of `run` in the text of the manifest; empty if `[executable]` names the program.
    pub run_place: Span,
    /// File with the template of the action model; `None` if the package has none.
    pub model: Option<PathBuf>,
    /// Time after the start within which all agents of the package must have joined.
    pub ready_within: Duration,
    /// Methods of the package by action. Agents of the package may offer only these actions.
    pub methods: Methods,
    /// Agents that the package brings if the ecosystem file names none for it.
    pub agents: Vec<OwnAgent>,
    /// Further agents that the package may bring while it runs: names of agents, or prefixes of
    /// names followed by `*`.
    pub brings: Vec<String>,
    /// Keys that the `config` of the package's agents may have.
    pub config: BTreeMap<String, ConfigKey>,
    /// Resources of the machine that the package asks to use.
    pub permissions: Permissions,
}

/// An agent that a package brings if the ecosystem file names none for the package.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnAgent {
    /// Name of the agent.
    pub name: AgentId,
    /// Driver that the agent uses; `None` if the manifest names none.
    pub driver: Option<String>,
    /// The `config` of the agent.
    pub config: Value,
}

/// One key that the `config` of a package's agents may have.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ConfigKey {
    /// Kind of value that the key takes.
    #[serde(rename = "type")]
    pub shape: ConfigShape,
    /// Description of the key, for people.
    #[serde(default)]
    pub about: String,
    /// Whether the key may be left out of a `config`.
    #[serde(default)]
    pub optional: bool,
}

/// Kind of value that a key in an agent's `config` takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ConfigShape {
    /// A text, such as `"office2"`.
    Text,
    /// A number, such as `12.5`.
    Number,
    /// A truth value, such as `true`.
    Flag,
    /// A list: `[ … ]`.
    List,
    /// A table: `{ … }`.
    Table,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawManifest {
    name: Spanned<String>,
    version: Spanned<String>,
    protocol: Spanned<String>,
    #[serde(default)]
    about: String,
    run: Option<Spanned<Vec<String>>>,
    #[serde(default)]
    executable: BTreeMap<String, String>,
    model: Option<PathBuf>,
    ready_within: Option<Spanned<String>>,
    #[serde(default)]
    action: BTreeMap<String, Spanned<RawAction>>,
    #[serde(default)]
    agent: Vec<RawManifestAgent>,
    #[serde(default)]
    brings: Vec<Spanned<String>>,
    #[serde(default)]
    config: BTreeMap<String, ConfigKey>,
    #[serde(default)]
    permissions: RawPermissions,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawAction {
    method: String,
    #[serde(default)]
    arguments: BTreeMap<String, String>,
    timeout: Spanned<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawManifestAgent {
    name: Spanned<String>,
    driver: Option<String>,
    #[serde(default)]
    config: Value,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RawPermissions {
    #[serde(default)]
    network: bool,
    #[serde(default)]
    devices: Vec<Spanned<PathBuf>>,
    #[serde(default)]
    read: Vec<Spanned<PathBuf>>,
    memory: Option<Spanned<String>>,
    cpu: Option<Spanned<f64>>,
    files: Option<u64>,
    processes: Option<u32>,
    disk: Option<Spanned<String>>,
}

impl PackageManifest {
    /// Parses and checks the text of a manifest.
    ///
    /// # Errors
    ///
    /// Returns all mistakes of the manifest, each with its place in the text.
    pub fn read(text: &str) -> Result<PackageManifest, Vec<Diagnostic>> {
        let raw: RawManifest = toml::from_str(text).map_err(|error| {
            vec![worded(text, error.message(), error.span().unwrap_or_default())]
        })?;
        let mut reading = ManifestReader { found: Vec::new() };
        let manifest = reading.manifest(raw);
        if reading.found.is_empty() { Ok(manifest) } else { Err(reading.found) }
    }

    /// Returns the first mistake in the `config` of an agent of this package; `None` if there is no
    /// mistake.
    pub fn problem_with(&self, config: &Value) -> Option<String> {
        let empty = serde_json::Map::new();
        let said = match config {
            Value::Null => &empty,
            Value::Object(said) => said,
            _ => return Some("config must be a table".to_owned()),
        };
        for (key, value) in said {
            let Some(known) = self.config.get(key) else {
                let known: Vec<_> = self.config.keys().map(|key| format!("`{key}`")).collect();
                let known = match known.len() {
                    0 => "none".to_owned(),
                    _ => known.join(", "),
                };
                let name = &self.name;
                return Some(format!("config has no key `{key}`; `{name}` has {known}"));
            };
            if !known.shape.fits(value) {
                let right = known.shape.expected();
                return Some(format!("config.{key} must be {right}, and is {value}"));
            }
        }
        let is_missing = |(key, known): &(&String, &ConfigKey)| {
            !known.optional && !said.contains_key(key.as_str())
        };
        let (key, known) = self.config.iter().find(is_missing)?;
        let about = if known.about.is_empty() { "" } else { ": " };
        Some(format!("config.{key} is missing{about}{}", known.about))
    }

    /// Whether the key `brings` of the manifest allows the package to bring `agent`.
    pub fn may_bring(&self, agent: &AgentId) -> bool {
        self.brings.iter().any(|pattern| match pattern.strip_suffix('*') {
            Some(beginning) => agent.as_str().starts_with(beginning),
            None => agent.as_str() == pattern,
        })
    }
}

impl ConfigShape {
    fn fits(self, value: &Value) -> bool {
        match self {
            ConfigShape::Text => value.is_string(),
            ConfigShape::Number => value.is_number(),
            ConfigShape::Flag => value.is_boolean(),
            ConfigShape::List => value.is_array(),
            ConfigShape::Table => value.is_object(),
        }
    }

    fn expected(self) -> &'static str {
        match self {
            ConfigShape::Text => "a text in quotes",
            ConfigShape::Number => "a number",
            ConfigShape::Flag => "true or false",
            ConfigShape::List => "a list in [ ]",
            ConfigShape::Table => "a table",
        }
    }
}

/// Reader of a manifest, which collects all mistakes.
struct ManifestReader {
    found: Vec<Diagnostic>,
}

impl ManifestReader {
    fn manifest(&mut self, raw: RawManifest) -> PackageManifest {
        self.name(&raw.name);
        if raw.version.get_ref().trim().is_empty() {
            self.wrong(&raw.version, "the version is empty", "write one, such as \"0.1.0\"");
        }
        self.protocol(&raw.protocol);
        let run_place = raw.run.as_ref().map(|run| span(run.span())).unwrap_or_default();
        let run = self.program(raw.run, &raw.executable, &raw.name);
        let ready_within = raw.ready_within.and_then(|said| self.duration(&said));
        let methods = raw.action.into_iter().filter_map(|(name, action)| {
            let method = self.method(&action)?;
            Some((name.to_lowercase(), method))
        });
        PackageManifest {
            methods: methods.collect(),
            agents: raw.agent.into_iter().filter_map(|agent| self.agent(agent)).collect(),
            brings: raw.brings.iter().filter_map(|pattern| self.pattern(pattern)).collect(),
            permissions: self.permissions(raw.permissions),
            name: raw.name.into_inner(),
            version: raw.version.into_inner(),
            about: raw.about,
            ready_within: ready_within.unwrap_or(READY_WITHIN_DEFAULT),
            run,
            run_place,
            model: raw.model,
            config: raw.config,
        }
    }

    fn wrong<T>(&mut self, place: &Spanned<T>, message: impl Into<String>, help: &str) {
        self.found.push(Diagnostic::error(span(place.span()), message).with_help(help));
    }

    fn name(&mut self, name: &Spanned<String>) {
        if let Err(error) = AgentId::new(name.get_ref()) {
            self.wrong(name, error.to_string(), "a name has lower-case letters, digits and `-`");
        }
    }

    /// Checks that the protocol versions of the plugin, such as `"2"` or `"2-3"`, include this
    /// daemon's version.
    fn protocol(&mut self, said: &Spanned<String>) {
        let (first, last) = said.get_ref().split_once('-').unwrap_or((said.get_ref(), ""));
        let first = first.trim().parse::<u32>();
        let last = if last.is_empty() { first.clone() } else { last.trim().parse() };
        match (first, last) {
            (Ok(first), Ok(last)) if first <= last => {
                if !(first..=last).contains(&SCHEMA_VERSION) {
                    let message = format!(
                        "the plugin speaks version {} of the protocol, this daemon {SCHEMA_VERSION}",
                        said.get_ref()
                    );
                    self.wrong(said, message, "get a version of the plugin for this Althing");
                }
            }
            _ => self.wrong(said, "no versions", "write \"2\", or a first and a last: \"2-3\""),
        }
    }

    fn program(
        &mut self,
        run: Option<Spanned<Vec<String>>>,
        executables: &BTreeMap<String, String>,
        name: &Spanned<String>,
    ) -> Vec<String> {
        let here = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
        match (run, executables.get(&here)) {
            (Some(run), _) if run.get_ref().first().is_none_or(|program| program.is_empty()) => {
                self.wrong(&run, "no program", "write a program and its arguments");
                Vec::new()
            }
            (Some(run), _) => run.into_inner(),
            (None, Some(executable)) => vec![format!("./{executable}")],
            (None, None) if executables.is_empty() => {
                let help = "run = [\"python3\", \"agent.py\"], or an executable for each target in \
                            [executable]";
                self.wrong(name, "nothing to run", help);
                Vec::new()
            }
            (None, None) => {
                let known: Vec<_> = executables.keys().map(String::as_str).collect();
                let message =
                    format!("it has no executable for {here}, only for {}", known.join(", "));
                self.wrong(name, message, "get one for this machine");
                Vec::new()
            }
        }
    }

    fn method(&mut self, action: &Spanned<RawAction>) -> Option<Method> {
        let RawAction { method, arguments, timeout } = action.get_ref();
        let timeout = Millis(self.duration(timeout)?);
        Some(Method { method: method.clone(), arguments: arguments.clone(), timeout })
    }

    fn duration(&mut self, said: &Spanned<String>) -> Option<Duration> {
        let duration = humantime::parse_duration(said.get_ref()).ok();
        let duration = duration.filter(|it| !it.is_zero() && *it <= TIMEOUT_MAX);
        if duration.is_none() {
            let message = format!("`{}` is no duration between zero and one day", said.get_ref());
            self.wrong(said, message, "write how long it may take, such as \"2s\"");
        }
        duration
    }

    fn agent(&mut self, agent: RawManifestAgent) -> Option<OwnAgent> {
        match AgentId::new(agent.name.get_ref()) {
            Ok(name) => Some(OwnAgent { name, driver: agent.driver, config: agent.config }),
            Err(error) => {
                let help = "a name has lower-case letters, digits and `-`";
                self.wrong(&agent.name, error.to_string(), help);
                None
            }
        }
    }

    fn pattern(&mut self, pattern: &Spanned<String>) -> Option<String> {
        let text = pattern.get_ref();
        let beginning = text.strip_suffix('*').unwrap_or(text);
        if beginning.is_empty() || AgentId::new(beginning.trim_end_matches('-')).is_err() {
            let message = format!("`{text}` names no agent and no beginning of names");
            self.wrong(pattern, message, "write a name, or the beginning of names: \"lamp-*\"");
            return None;
        }
        Some(text.clone())
    }

    fn permissions(&mut self, raw: RawPermissions) -> Permissions {
        let least = Permissions::default();
        let RawPermissions { network, devices, read, memory, cpu, files, processes, disk } = raw;
        let cpu = cpu.map_or(least.cpu, |said| {
            let cpu = *said.get_ref();
            if !(0.01..=64.0).contains(&cpu) {
                self.wrong(&said, format!("cpu {cpu}"), "write a share of one core: 0.01 to 64");
            }
            cpu
        });
        Permissions {
            network,
            devices: self.paths(devices, "devices", device_objection),
            read: self.paths(read, "read", read_objection),
            memory: memory.map_or(least.memory, |said| self.bytes(&said, "memory")),
            cpu,
            files: files.unwrap_or(least.files).max(16),
            processes: processes.unwrap_or(least.processes).max(1),
            disk: disk.map_or(least.disk, |said| self.bytes(&said, "disk")),
        }
    }

    fn bytes(&mut self, said: &Spanned<String>, what: &str) -> u64 {
        bytes_of(said.get_ref()).filter(|bytes| *bytes >= BYTES_LEAST).unwrap_or_else(|| {
            let message = format!("{what} `{}`", said.get_ref());
            self.wrong(said, message, "write at least \"1MiB\", such as \"64MiB\"");
            BYTES_LEAST
        })
    }

    /// Checks the paths in a list of the manifest, and reports each path that no plugin may use.
    fn paths(
        &mut self,
        paths: Vec<Spanned<PathBuf>>,
        what: &str,
        objection: impl Fn(&Path) -> Option<String>,
    ) -> Vec<PathBuf> {
        for path in &paths {
            if let Some(why) = objection(path.get_ref()) {
                let shown = path.get_ref().display();
                let message = format!("{what} `{shown}` cannot be given to a plugin: {why}");
                let help = "docs/plugins.md, “Rights”, says what can be given";
                self.wrong(path, message, help);
            }
        }
        paths.into_iter().map(Spanned::into_inner).collect()
    }
}

fn span(place: Range<usize>) -> Span {
    let at = |offset: usize| u32::try_from(offset).unwrap_or(u32::MAX);
    Span { start: at(place.start), end: at(place.end) }
}

/// Whether a path is relative and has no `..`, so that it stays within its package.
pub(crate) fn stays_within(path: &Path) -> bool {
    let is_plain =
        |part| matches!(part, std::path::Component::Normal(_) | std::path::Component::CurDir);
    path.components().all(is_plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = r#"
name = "thermometer"
version = "0.1.0"
protocol = "2"
run = ["python3", "agent.py"]
model = "model.pddl"

[action.report-temperature]
method = "read"
timeout = "2s"

[[agent]]
name = "py-1"
config = { location = "office2" }

[config.location]
type = "text"
about = "the room it stands in"

[permissions]
memory = "64MiB"
"#;

    #[test]
    fn omitted_keys_of_a_manifest_get_defaults() {
        let manifest = PackageManifest::read(WHOLE).expect("nothing is wrong");
        assert_eq!(manifest.permissions.memory, 64 << 20);
        assert!(!manifest.permissions.network, "least rights");
        assert_eq!(manifest.agents[0].name.as_str(), "py-1");
        assert_eq!(manifest.methods["report-temperature"].timeout.0, Duration::from_secs(2));
        assert_eq!(manifest.problem_with(&manifest.agents[0].config), None);
    }

    #[test]
    fn mistakes_of_a_manifest_have_a_place() {
        for (was, is, expected) in [
            ("protocol = \"2\"", "protocol = \"3-4\"", "speaks version 3-4 of the protocol"),
            ("protocol = \"2\"", "protocol = \"one\"", "no versions"),
            ("run = [\"python3\", \"agent.py\"]", "", "nothing to run"),
            ("run = [\"python3\", \"agent.py\"]", "run = []", "no program"),
            ("memory = \"64MiB\"", "devices = [\"/\"]", "devices `/` cannot be given to a plugin"),
            (
                "memory = \"64MiB\"",
                "read = [\"/home/anna\"]",
                "many programs and users share this folder",
            ),
            ("memory = \"64MiB\"", "disk = \"much\"", "disk `much`"),
            ("memory = \"64MiB\"", "memory = \"64\"", "memory `64`"),
            ("timeout = \"2s\"", "timeout = \"soon\"", "`soon` is no duration"),
            ("version = \"0.1.0\"", "version = \"1\"\nready-within = \"2\"", "`2` is no duration"),
            ("name = \"thermometer\"", "name = \"Thermo meter\"", "Thermo meter"),
            ("version = \"0.1.0\"", "versoin = \"0.1.0\"", "unknown key `versoin`"),
            ("type = \"text\"", "type = \"words\"", "\"words\" is not known here"),
        ] {
            let text = WHOLE.replacen(was, is, 1);
            let found = PackageManifest::read(&text).expect_err(expected);
            assert!(found[0].message.contains(expected), "{}", found[0].message);
            let at = found[0].span.start as usize..found[0].span.end as usize;
            assert!(text.get(at).is_some(), "{expected}");
        }
        let elsewhere =
            WHOLE.replacen("run = [\"python3\", \"agent.py\"]", "executable.riscv-none = \"x\"", 1);
        let found = PackageManifest::read(&elsewhere).expect_err("another machine");
        assert!(found[0].message.contains("only for riscv-none"), "{}", found[0].message);
    }

    #[test]
    fn a_config_is_checked_against_the_declared_keys() {
        let manifest = PackageManifest::read(WHOLE).expect("nothing is wrong");
        for (config, expected) in [
            (serde_json::json!({}), "config.location is missing: the room it stands in"),
            (serde_json::json!({ "location": 2 }), "config.location must be a text in quotes"),
            (serde_json::json!({ "room": "x" }), "config has no key `room`"),
        ] {
            let problem = manifest.problem_with(&config).unwrap_or_default();
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn paths_do_not_lead_out_of_a_package() {
        for (path, expected) in
            [("model.pddl", true), ("./a/b", true), ("../b", false), ("/b", false)]
        {
            assert_eq!(stays_within(Path::new(path)), expected, "{path}");
        }
    }
}
