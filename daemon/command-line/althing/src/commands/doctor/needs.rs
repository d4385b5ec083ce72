//! Checks of what the agents of this machine need: programs, device files, libraries.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};
use serde_json::Value;

use super::finding::{CheckFinding, DoctorCheck, Remedy};
use crate::commands::client::shell_word;
use crate::config::AgentEntry;
use crate::plugins;

/// Keys of a configuration that begin a command: the program and its arguments.
const COMMAND_KEYS: &[&str] = &["command", "on", "off", "state", "run"];

/// Programs that a driver runs, if its configuration names no other: any of `programs` will do, and
/// `package` of Debian has one.
struct DriverProgram {
    plugin: &'static str,
    driver: &'static str,
    /// Key of the configuration with which the driver runs the program; empty if it always does.
    with_key: &'static str,
    programs: &'static [&'static str],
    package: &'static str,
}

/// The programs of drivers. docs/screens.md and docs/cameras.md describe them.
const DRIVER_PROGRAMS: &[DriverProgram] = &[
    driver("screen", "browser", "", &["chromium", "chromium-browser", "google-chrome"], "chromium"),
    driver("screen", "browser", "television", &["cec-ctl"], "v4l-utils"),
    driver("screen", "mpv", "", &["mpv"], "mpv"),
    driver("screen", "mpv", "television", &["cec-ctl"], "v4l-utils"),
    driver("screen", "cec", "", &["cec-ctl"], "v4l-utils"),
    driver("ptz-camera", "v4l2", "", &["ffmpeg"], "ffmpeg"),
    driver("ptz-camera", "v4l2", "", &["v4l2-ctl"], "v4l-utils"),
    driver("ptz-camera", "motion", "source", &["motion"], "motion"),
    driver("ptz-camera", "motion", "record-seconds", &["ffmpeg"], "ffmpeg"),
    driver("ptz-camera", "onvif", "record-seconds", &["ffmpeg"], "ffmpeg"),
];

const fn driver(
    plugin: &'static str,
    driver: &'static str,
    with_key: &'static str,
    programs: &'static [&'static str],
    package: &'static str,
) -> DriverProgram {
    DriverProgram { plugin, driver, with_key, programs, package }
}

/// A program that an agent needs.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct NeededProgram {
    /// Names of which one is enough.
    names: Vec<String>,
    /// Debian's package of the program; `None` for a program of the file.
    package: Option<&'static str>,
}

/// Checks whether the programs that these agents run are installed.
pub(super) fn programs(agents: &[AgentEntry]) -> Vec<CheckFinding> {
    let check = DoctorCheck::Programs;
    let mut needed: BTreeMap<NeededProgram, Vec<&str>> = BTreeMap::new();
    for entry in agents {
        for program in needed_programs(entry) {
            needed.entry(program).or_default().push(entry.name.as_str());
        }
    }
    if needed.is_empty() {
        return vec![check.ok("the agents of this machine run no program")];
    }
    let count = needed.len();
    let missing = |(program, agents): (NeededProgram, Vec<&str>)| {
        let NeededProgram { names, package } = program;
        if names.iter().any(|name| is_executable(name)) {
            return None;
        }
        let (names, agents) = (names.join("` or `"), agents.join(", "));
        let text = format!("`{names}` is not installed, and {agents} needs it");
        let install = |package| format!("sudo apt-get install -y {package}");
        Some(check.problem(text, package.map(install).map(Remedy::Mend)))
    };
    let missing: Vec<_> = needed.into_iter().filter_map(missing).collect();
    match missing.is_empty() {
        true => vec![check.ok(format!("all {count} that agents run are installed"))],
        false => missing,
    }
}

/// Returns the driver of an agent: that of its entry, or its plugin's default.
fn driver_of(entry: &AgentEntry) -> &str {
    let default = || plugins::find(&entry.plugin).and_then(|plugin| plugin.drivers.first());
    entry.driver.as_deref().or_else(|| default().copied()).unwrap_or_default()
}

fn needed_programs(entry: &AgentEntry) -> Vec<NeededProgram> {
    if !entry.is_built_in() {
        // The package of a plugin is checked with the folder of plugins.
        return Vec::new();
    }
    let of_driver = DRIVER_PROGRAMS.iter().filter(|each| {
        let has_key = each.with_key.is_empty() || !entry.config[each.with_key].is_null();
        each.plugin == entry.plugin && each.driver == driver_of(entry) && has_key
    });
    let written = entry.config["program"].as_str();
    let mut needed: Vec<_> = of_driver
        .map(|each| match written.filter(|_| each.with_key.is_empty()) {
            Some(program) => NeededProgram { names: vec![program.to_owned()], package: None },
            None => NeededProgram {
                names: each.programs.iter().map(|&name| name.to_owned()).collect(),
                package: Some(each.package),
            },
        })
        .collect();
    commands(&entry.config, &mut needed);
    needed
}

/// Collects the programs of the commands in a configuration, at any depth.
fn commands(value: &Value, needed: &mut Vec<NeededProgram>) {
    let Value::Object(table) = value else { return };
    for (key, value) in table {
        let first = value.as_array().and_then(|words| words.first()?.as_str());
        match first.filter(|_| COMMAND_KEYS.contains(&key.as_str())) {
            Some(program) => {
                needed.push(NeededProgram { names: vec![program.to_owned()], package: None });
            }
            None => commands(value, needed),
        }
    }
}

/// Whether a program can be run: a file of this path if the name has a `/`, otherwise a file in a
/// folder of `PATH`.
fn is_executable(name: &str) -> bool {
    let is_program = |path: &Path| path.is_file() && access(path, Access::EXEC_OK).is_ok();
    if name.contains('/') {
        return is_program(Path::new(name));
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| is_program(&folder.join(name)))
}

/// Checks whether this user may use the device files and libraries that these agents need.
pub(super) fn devices(agents: &[AgentEntry]) -> Vec<CheckFinding> {
    let check = DoctorCheck::Devices;
    let mut wanted = BTreeMap::new();
    let mut findings = Vec::new();
    for entry in agents.iter().filter(|entry| entry.is_built_in()) {
        let agent = entry.name.as_str();
        device_files(&entry.config, &mut |path| {
            wanted.entry(PathBuf::from(path)).or_insert_with(Vec::new).push(agent);
        });
        match driver_of(entry) {
            "gpio" => {
                let folder = entry.config["chips"].as_str().unwrap_or("/dev");
                match chips(Path::new(folder)).as_slice() {
                    [] => findings.push(check.problem(
                        format!("{folder} has no GPIO chip, and {agent} needs a line of one"),
                        Remedy::look("gpiodetect"),
                    )),
                    chips => chips.iter().for_each(|chip| {
                        wanted.entry(chip.clone()).or_insert_with(Vec::new).push(agent);
                    }),
                }
            }
            "phidget" => findings.extend(phidget_library(entry)),
            _ => (),
        }
    }
    let count = wanted.len();
    let missing = wanted.iter().filter_map(|(path, agents)| device_mistake(path, agents));
    findings.extend(missing);
    match (findings.is_empty(), count) {
        (true, 0) => vec![check.ok("the agents of this machine use no device file")],
        (true, _) => vec![check.ok(format!("this user may use all {count} device files"))],
        (false, _) => findings,
    }
}

/// Calls `found` with each path in `/dev` that a configuration names.
fn device_files<'v>(value: &'v Value, found: &mut impl FnMut(&'v str)) {
    match value {
        Value::String(text) if text.starts_with("/dev/") => found(text),
        Value::Array(items) => items.iter().for_each(|item| device_files(item, found)),
        Value::Object(table) => table.values().for_each(|item| device_files(item, found)),
        _ => (),
    }
}

fn chips(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let is_chip = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        name.is_some_and(|name| name.starts_with("gpiochip"))
    };
    let mut chips: Vec<_> = entries.map(|entry| entry.path()).filter(is_chip).collect();
    chips.sort();
    chips
}

/// Returns the problem with a device file; `None` if this user may read and write it.
fn device_mistake(path: &Path, agents: &[&str]) -> Option<CheckFinding> {
    let (check, agents) = (DoctorCheck::Devices, agents.join(", "));
    let shown = path.display();
    let Ok(about) = fs::metadata(path) else {
        let word = shell_word(&path.parent().unwrap_or(path).to_string_lossy());
        let text = format!("{shown} does not exist, and {agents} needs it: is it plugged in?");
        return Some(check.problem(text, Remedy::look(format!("ls -l {word}"))));
    };
    if access(path, Access::READ_OK | Access::WRITE_OK).is_ok() {
        return None;
    }
    let text = format!("this user may not use {shown}, and {agents} needs it");
    let remedy = group(about.gid()).filter(|group| group != "root").map(|group| {
        Remedy::Mend(format!("sudo usermod -aG {group} \"$(id -un)\" && exec newgrp {group}"))
    });
    Some(check.problem(text, remedy))
}

/// Returns the name of a group of this machine.
fn group(id: u32) -> Option<String> {
    let groups = fs::read_to_string("/etc/group").ok()?;
    let named = |line: &str| {
        let mut words = line.split(':');
        let name = words.next()?;
        (words.nth(1)?.parse() == Ok(id)).then(|| name.to_owned())
    };
    groups.lines().find_map(named)
}

fn phidget_library(entry: &AgentEntry) -> Option<CheckFinding> {
    let library = entry.config["library"].as_str().map(Path::new);
    let error = phidget_link::Library::load(library).err()?;
    let text = format!("{} needs libphidget22: failed to {error}", entry.name);
    Some(DoctorCheck::Devices.problem(text, Remedy::mend("pip install Phidget22")))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use acl::AgentId;
    use serde_json::json;

    use super::*;
    use crate::commands::doctor::finding::CheckVerdict;

    fn entry(plugin: &str, driver: &str, config: Value) -> AgentEntry {
        AgentEntry {
            path: String::new(),
            name: AgentId::new("agent-1").expect("a name"),
            plugin: plugin.to_owned(),
            package: None,
            daemons: Vec::new(),
            driver: (!driver.is_empty()).then(|| driver.to_owned()),
            config: Arc::new(config),
        }
    }

    #[test]
    fn programs_of_drivers_and_of_the_file_are_needed() {
        let needed = |plugin: &str, driver: &str, config: Value| -> Vec<String> {
            let entry = entry(plugin, driver, config);
            needed_programs(&entry).into_iter().map(|it| it.names.join("|")).collect()
        };
        assert_eq!(needed("screen", "mpv", json!({})), ["mpv"]);
        assert_eq!(needed("screen", "mpv", json!({ "program": "/opt/mpv" })), ["/opt/mpv"]);
        let television = json!({ "television": "/dev/cec0" });
        assert_eq!(needed("screen", "mpv", television), ["mpv", "cec-ctl"]);
        assert_eq!(needed("screen", "", json!({})), [""; 0], "the default is simulated");
        let measured = json!({ "command": ["curl", "--silent"], "quantity": "temperature" });
        assert_eq!(needed("sensor", "command", measured), ["curl"]);
        let acts = json!({ "actions": { "ring": { "run": ["aplay", "bell.wav"] } } });
        assert_eq!(needed("command", "", acts), ["aplay"]);
    }

    #[test]
    fn a_missing_program_names_its_agents_and_its_package() {
        let there = entry("sensor", "command", json!({ "command": ["sh"] }));
        assert_eq!(programs(&[there])[0].verdict, CheckVerdict::Ok);
        let gone = entry("sensor", "command", json!({ "command": ["no-such-program"] }));
        let found = programs(&[gone]);
        assert!(found[0].text.contains("agent-1 needs it"), "{found:?}");
        assert_eq!(found[0].remedy, None, "no package is known");
    }

    #[test]
    fn a_missing_device_is_found_at_any_depth() {
        let config = json!({ "ports": [{ "device": "/dev/no-such-device" }] });
        let found = devices(&[entry("switch", "command", config)]);
        assert_eq!(found[0].verdict, CheckVerdict::Problem);
        assert_eq!(found[0].remedy, Remedy::look("ls -l /dev"));
        let null = devices(&[entry("switch", "command", json!({ "device": "/dev/null" }))]);
        assert_eq!(null[0].verdict, CheckVerdict::Ok);
        let folder = tempfile::tempdir().expect("a folder");
        let chips = json!({ "line": "gpiochip0/1", "chips": folder.path() });
        let board = devices(&[entry("switch", "gpio", chips)]);
        assert!(board[0].text.contains("no GPIO chip"), "{board:?}");
    }

    #[test]
    fn groups_are_named() {
        assert_eq!(group(0).as_deref(), Some("root"));
        assert_eq!(group(u32::MAX), None);
    }
}
