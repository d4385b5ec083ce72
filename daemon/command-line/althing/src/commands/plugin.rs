//! `althing plugin`: manages the packages of plugins, on this machine and in a running ecosystem.

mod allow;
mod check;

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use agent::Resource;
use plugin_host::{
    ConfinementStatus, Package, PackageStore, PackageStoreError, PluginList, PluginStatus,
};
use serde_json::json;
use terminal::report::DiagnosticReport;
use terminal::{exit, output, visible};

use crate::cli::AskArgs;
use crate::cli::plugin::{
    PluginAddArgs, PluginArgs, PluginCommand, PluginLogsArgs, PluginNameArgs, PluginPlaceArgs,
};
use crate::commands::client::{self, EcosystemView};
use crate::config::{self, Ecosystem, Overrides};
use crate::{hosting, plugins};

/// Runs `althing plugin`: lists, checks, installs, changes or removes packages.
pub(super) fn run(args: &PluginArgs) -> ExitCode {
    match &args.command {
        PluginCommand::List(args) => client::with_view(args, list),
        PluginCommand::Check(args) => check::run(args),
        PluginCommand::Add(args) => add(args),
        PluginCommand::Allow(args) => allow::run(args),
        PluginCommand::Remove(args) => {
            change(args, "removed", |package_store, name| package_store.remove(name))
        }
        PluginCommand::Enable(args) => {
            change(args, "enabled", |package_store, name| package_store.set_disabled(name, false))
        }
        PluginCommand::Disable(args) => {
            change(args, "disabled", |package_store, name| package_store.set_disabled(name, true))
        }
        PluginCommand::Logs(args) => logs(args),
    }
}

/// Queries the state of the plugins of all daemons.
pub(super) async fn plugins(view: &EcosystemView) -> Vec<PluginList> {
    view.directory(None).await;
    let answers = view.ask(Resource::Plugins, None).await;
    let read = |answer: &bytes::Bytes| serde_json::from_slice(answer).ok();
    let mut plugins: Vec<PluginList> = answers.iter().filter_map(read).collect();
    plugins.sort_by(|one, other| one.daemon.cmp(&other.daemon));
    plugins.dedup_by(|one, other| one.daemon == other.daemon);
    plugins
}

async fn list(view: &EcosystemView, json: bool) -> ExitCode {
    let found = plugins(view).await;
    if json {
        let value = json!({ "ecosystem": view.name, "daemons": found });
        return output::print_json(&value, exit::DONE);
    }
    let all: Vec<_> = found
        .iter()
        .flat_map(|plugins| plugins.plugins.iter().map(move |status| (plugins, status)))
        .collect();
    let mut text = String::new();
    if all.is_empty() {
        for plugins in &found {
            let (folder, daemon) = (&plugins.folder, &plugins.daemon);
            let _ = writeln!(
                text,
                "`{daemon}` has no plugins: althing plugin add FOLDER, or copy one into {folder}"
            );
        }
        found.iter().for_each(|plugins| text += &confined(plugins));
        return output::print(text, exit::DONE);
    }
    let _ = writeln!(
        text,
        "{:<20} {:<10} {:<14} {:<12} AGENTS",
        "PLUGIN", "VERSION", "DAEMON", "STATE"
    );
    for (plugins, status) in all {
        text += &line(plugins, status);
    }
    text.push('\n');
    found.iter().for_each(|plugins| text += &confined(plugins));
    output::print(text, exit::DONE)
}

/// Describes in one line how far a daemon confines its plugins.
fn confined(plugins: &PluginList) -> String {
    let PluginList { daemon, confinement, .. } = plugins;
    let ConfinementStatus { not_enforced, limits, .. } = confinement;
    let said = match not_enforced.as_slice() {
        // A daemon of another version does not report this.
        [] if limits.is_empty() => return String::new(),
        [] => format!("`{daemon}` enforces the whole confinement of plugins"),
        lacks => format!("not enforced on `{daemon}`, of a plugin: {}", lacks.join("; ")),
    };
    let taken = "the memory and processor time of plugins are";
    output::folded(&format!("{said}; {taken} {limits}"), 4) + "\n"
}

fn line(plugins: &PluginList, status: &PluginStatus) -> String {
    let agents: Vec<_> = status.agents.iter().map(acl::AgentId::as_str).collect();
    let state = status.state.as_str();
    let line = format!(
        "{:<20} {:<10} {:<14} {state:<12} {}",
        status.name,
        status.version,
        plugins.daemon,
        agents.join(", ")
    );
    let mut text = output::folded(line.trim_end(), 4);
    text.push('\n');
    let lacks = not_enforced_here(&status.not_enforced);
    for said in [&status.reason, &status.advice, &lacks].into_iter().flatten() {
        text += &output::folded(&format!("    {}", visible::line(said)), 4);
        text.push('\n');
    }
    text
}

/// Describes the parts of a plugin's confinement that its machine does not enforce; `None` if it
/// enforces all parts.
fn not_enforced_here(lacks: &[String]) -> Option<String> {
    (!lacks.is_empty()).then(|| format!("not enforced here: {}", lacks.join("; ")))
}

fn add(args: &PluginAddArgs) -> ExitCode {
    let json = args.print.json;
    let package_store = match package_store(&args.place) {
        Ok(package_store) => package_store,
        Err(problem) => return super::wrong(&format!("failed to {problem}"), json),
    };
    // The path is resolved, because messages name a package by its folder.
    let from = args.package.canonicalize().unwrap_or_else(|_| args.package.clone());
    let added = Package::open(&from).map_err(|faults| PackageStoreError::Faulty(Box::new(faults)));
    let added = added.and_then(|package| {
        let name = &package.manifest.name;
        let was =
            Package::open(&package_store.package_folder(name)).ok().map(|was| was.manifest.version);
        let beyond = package.manifest.permissions.beyond(&package_store.kept_rights(name)?);
        let command = format!("althing plugin add {}", args.package.display());
        match allow::consent(name, &beyond, &args.rights.allow, &command, json) {
            Ok(consent) => package_store.add(&from, &consent).map(|manifest| Ok((manifest, was))),
            Err(code) => Ok(Err(code)),
        }
    });
    match added {
        Ok(Ok((manifest, was))) => {
            let (name, version) = (&manifest.name, &manifest.version);
            let folder = package_store.package_folder(name).display().to_string();
            if json {
                let value = json!({ "plugin": name, "version": version, "folder": folder });
                return output::print_json(&value, exit::DONE);
            }
            let before = was.map(|was| format!(" in place of {was}")).unwrap_or_default();
            let said = format!("added {name} {version}{before}, in {folder}\n");
            output::print(
                said + "A daemon that runs here starts it now: althing plugin list\n",
                exit::DONE,
            )
        }
        Ok(Err(code)) => code,
        Err(PackageStoreError::Faulty(faults)) => {
            let mut report = DiagnosticReport::default();
            check::add_faults(*faults, &mut report);
            output::show(&report, json, "bad-input", exit::BAD_INPUT)
        }
        Err(error) => super::wrong(&format!("failed to {error}"), json),
    }
}

fn change(
    args: &PluginNameArgs,
    done: &str,
    change: impl FnOnce(&PackageStore, &str) -> Result<(), PackageStoreError>,
) -> ExitCode {
    let json = args.print.json;
    let name = &args.name;
    let changed = package_store(&args.place).and_then(|package_store| {
        change(&package_store, name).map_err(|error| known_or_near(&package_store, name, error))
    });
    match changed {
        Ok(()) if json => {
            output::print_json(&json!({ "plugin": name, "status": done }), exit::DONE)
        }
        Ok(()) => output::print(format!("{done} {name}\n"), exit::DONE),
        Err(problem) => super::wrong(&format!("failed to {problem}"), json),
    }
}

/// Returns the text of `error`. If the error is that no plugin has the name `name`, the text
/// contains the name that was probably meant.
fn known_or_near(package_store: &PackageStore, name: &str, error: PackageStoreError) -> String {
    match error {
        PackageStoreError::Unknown { .. } => {
            match pddl::nearest(name, package_store.names().iter().map(String::as_str)) {
                Some(near) => format!("{error}; did you mean `{near}`?"),
                None => error.to_string(),
            }
        }
        error => error.to_string(),
    }
}

fn package_store(place: &PluginPlaceArgs) -> Result<PackageStore, String> {
    if let Some(folder) = &place.folder {
        return Ok(hosting::packages_in(folder.clone()));
    }
    let file = match &place.ecosystem {
        Some(asked) => Some(config::resolve_ecosystem(asked)?),
        None => config::find_ecosystem_file(),
    };
    let said = match file {
        Some(file) => load(&file)?.plugins.folder,
        None => None,
    };
    Ok(hosting::packages_in(hosting::plugins_folder(said.as_deref())))
}

/// Reads an ecosystem file. Mistakes in the file are shown to the user.
fn load(file: &Path) -> Result<Ecosystem, String> {
    let read = Ecosystem::load(file, &Overrides::default(), &plugins::known());
    read.map_err(|error| {
        output::show_to_person(&error.into_report());
        format!("read {}", file.display())
    })
}

fn logs(args: &PluginLogsArgs) -> ExitCode {
    let ask = AskArgs { reach: args.reach.clone(), print: args.print.clone() };
    let (name, lines) = (args.name.clone(), args.lines);
    client::with_view(&ask, async move |view: &EcosystemView, json: bool| {
        let found = plugins(view).await;
        let of_it = |status: &&PluginStatus| status.name == name;
        let status = found.iter().flat_map(|plugins| &plugins.plugins).find(of_it);
        let Some(status) = status else {
            let known = found.iter().flat_map(|plugins| &plugins.plugins);
            let near = pddl::nearest(&name, known.map(|status| status.name.as_str()));
            let hint = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
            return super::wrong(&format!("there is no plugin `{name}` here{hint}"), json);
        };
        let text = match std::fs::read_to_string(&status.log) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => {
                return super::wrong(&format!("failed to read {}: {error}", status.log), json);
            }
        };
        let all: Vec<_> = text.lines().collect();
        let last = all.get(all.len().saturating_sub(lines)..).unwrap_or_default();
        if json {
            return output::print_json(&json!({ "plugin": name, "lines": last }), exit::DONE);
        }
        if last.is_empty() {
            return output::print(format!("{name} has printed nothing\n"), exit::DONE);
        }
        output::print(last.join("\n") + "\n", exit::DONE)
    })
}
