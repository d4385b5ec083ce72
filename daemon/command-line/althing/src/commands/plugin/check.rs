//! `althing plugin check`: reads the files of a package, then starts the package's program within
//! its confinement, as a daemon would, and reports whether the package's agents have joined.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use agent::Host;
use pddl::Domain;
use plugin_host::{Launcher, Package, PackageFaults, Right, Trial, TrialFailure, TrialSuccess};
use serde_json::{Value, json};
use terminal::report::{DiagnosticReport, SourceText};
use terminal::{exit, output};

use super::not_enforced_here;
use crate::cli::plugin::PluginCheckArgs;
use crate::commands::{in_runtime, wrong};
use crate::config::{self, Ecosystem};
use crate::hosting::ITSELF;

/// The results of the packages that have been checked so far.
#[derive(Default)]
struct PackageCheck {
    report: DiagnosticReport,
    /// Text to print: one line for each correct package.
    text: String,
    json: Vec<Value>,
}

/// Runs `althing plugin check`: checks each package, independently of the others.
pub(super) fn run(args: &PluginCheckArgs) -> ExitCode {
    in_runtime(check(args))
}

async fn check(args: &PluginCheckArgs) -> ExitCode {
    let json = args.print.json;
    let ecosystem = match ecosystem(args) {
        Ok(ecosystem) => ecosystem,
        Err(problem) => return wrong(&format!("failed to {problem}"), json),
    };
    let mut desk = PackageCheck::default();
    for folder in &args.packages {
        // Messages name a package by its folder, and a plugin sees the absolute path, so the path
        // is resolved.
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        match Package::open(&folder) {
            Ok(package) if args.files_only => desk.right(&package, None),
            Ok(package) => {
                let beyond = package.manifest.permissions.beyond(&args.rights.allow);
                match beyond.as_slice() {
                    [] => desk.try_out(package, ecosystem.as_ref()).await,
                    beyond => desk.not_started(&package, beyond),
                }
            }
            Err(faults) => add_faults(faults, &mut desk.report),
        }
    }
    if desk.report.has_errors() {
        return output::show(&desk.report, json, "bad-input", exit::BAD_INPUT);
    }
    if json {
        return output::print_json(&json!({ "status": "ok", "packages": desk.json }), exit::DONE);
    }
    output::print(desk.text, exit::DONE)
}

/// Returns the ecosystem in which packages are tried; `None` if there is no ecosystem file, or if
/// only the files of packages are checked.
fn ecosystem(args: &PluginCheckArgs) -> Result<Option<Ecosystem>, String> {
    if args.files_only {
        return Ok(None);
    }
    let file = match &args.ecosystem {
        Some(asked) => Some(config::resolve_ecosystem(asked)?),
        None => config::find_ecosystem_file(),
    };
    file.map(|file| super::load(&file)).transpose()
}

impl PackageCheck {
    async fn try_out(&mut self, package: Package, ecosystem: Option<&Ecosystem>) {
        let host = match ecosystem {
            Some(ecosystem) => Host::new((*ecosystem.domain).clone(), (*ecosystem.problem).clone()),
            None => without_ecosystem(&package),
        };
        let launcher = Launcher(PathBuf::from(ITSELF));
        let requires_confinement =
            ecosystem.is_some_and(|ecosystem| ecosystem.plugins.requires_confinement);
        let (name, within) = (&package.manifest.name, package.manifest.ready_within);
        if output::is_stderr_terminal() {
            output::print_note(&format!("starting {name}, which has {within:?} to be ready"));
        }
        let trial = Trial { package: package.clone(), launcher, host, requires_confinement };
        match trial.run().await {
            Ok(worked) => self.right(&package, Some(&worked)),
            Err(TrialFailure { why, advice }) => {
                let faults = package.fault_of_program(format!("it does not start: {why}"), advice);
                add_faults(faults, &mut self.report);
            }
        }
    }

    /// Reports that a plugin was not started, because no person has granted the rights in `beyond`.
    fn not_started(&mut self, package: &Package, beyond: &[Right]) {
        let words: Vec<_> = beyond.iter().map(|right| format!(" --allow {right}")).collect();
        let (name, version) = (&package.manifest.name, &package.manifest.version);
        let asks: Vec<_> = beyond.iter().map(Right::to_string).collect();
        let value = json!({ "plugin": name, "version": version, "started": false, "asks": asks });
        self.json.push(value);
        let said = format!(
            "{name} {version}: nothing is wrong with its files; it was not started, because it asks \
             for rights that are not allowed; to try it with them: althing plugin check{} {}",
            words.concat(),
            package.folder.display()
        );
        let _ = writeln!(self.text, "{}", output::folded(&said, 4));
    }

    fn right(&mut self, package: &Package, worked: Option<&TrialSuccess>) {
        let (name, version) = (&package.manifest.name, &package.manifest.version);
        let mut value = json!({ "plugin": name, "version": version, "started": worked.is_some() });
        let said = match worked {
            None => "nothing is wrong with its files; it was not started".to_owned(),
            Some(TrialSuccess { program, took, agents, not_enforced }) => {
                value["program"] = json!(program);
                value["not-enforced"] = json!(not_enforced);
                value["agents"] = json!(agents);
                let (took, program) = (took.as_secs_f64(), program.display());
                let ran = format!("it ran within its confinement, as {program}");
                match agents.is_empty() {
                    true => format!("nothing is wrong; {ran}; it brings no agent of its own"),
                    false => format!("nothing is wrong; {ran}, and was ready after {took:.1} s"),
                }
            }
        };
        let line = output::folded(&format!("{name} {version}: {said}"), 4);
        let _ = writeln!(self.text, "{line}");
        if let Some(said) = worked.and_then(|worked| not_enforced_here(&worked.not_enforced)) {
            let _ = writeln!(self.text, "{}", output::folded(&format!("    {said}"), 4));
        }
        self.json.push(value);
    }
}

/// Returns the context in which a package is tried if there is no ecosystem file. Its domain has
/// the name that the package's action model requires, and no contents.
fn without_ecosystem(package: &Package) -> Host {
    let named = package.manifest.agents.first().and_then(|agent| {
        let (_, model) = package.model(&agent.name, &agent.config).ok()??;
        Some(model.domain.to_string())
    });
    let name = named.unwrap_or_else(|| "trial".to_owned());
    let domain: Option<Domain> = pddl::parse_domain(&format!("(define (domain {name}))")).value;
    let map = format!("(define (problem trial) (:domain {name}) (:init) (:goal (and)))");
    let map = pddl::parse_problem(&map).value;
    let (domain, map) =
        (domain.expect("invariant: it is valid PDDL"), map.expect("invariant: it is valid PDDL"));
    Host::new(domain, map)
}

/// Adds the mistakes in a package to `report`.
pub(super) fn add_faults(faults: PackageFaults, report: &mut DiagnosticReport) {
    let PackageFaults { file, text, found } = faults;
    if text.is_empty() {
        found.into_iter().for_each(|mistake| report.add_general(mistake));
    } else {
        report.add(&SourceText::new(file.display().to_string(), text), found);
    }
}
