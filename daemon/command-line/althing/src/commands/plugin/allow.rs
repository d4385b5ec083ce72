//! Asks a person to allow the rights that a plugin requests beyond the default ones. The person
//! answers yes or no at the terminal; a script allows the rights by `--allow`.

use std::io::{self, IsTerminal as _};
use std::process::ExitCode;

use plugin_host::{Package, PackageStoreError, Right, listed};
use serde_json::json;
use terminal::{exit, output};

use crate::cli::plugin::PluginAllowArgs;
use crate::commands::consent::is_agreed;
use crate::commands::wrong;

/// Runs `althing plugin allow`: grants an installed package the rights that it requests.
pub(super) fn run(args: &PluginAllowArgs) -> ExitCode {
    let (json, name) = (args.print.json, &args.name);
    let failed = |problem: String| wrong(&format!("failed to {problem}"), json);
    let package_store = match super::package_store(&args.place) {
        Ok(package_store) => package_store,
        Err(problem) => return failed(problem),
    };
    if !package_store.package_folder(name).is_dir() {
        let unknown =
            PackageStoreError::Unknown { name: name.clone(), folder: package_store.folder.clone() };
        return failed(super::known_or_near(&package_store, name, unknown));
    }
    let package = match Package::open(&package_store.package_folder(name)) {
        Ok(package) => package,
        Err(faults) => return failed(format!("read its package: {}", faults.first())),
    };
    let allowed = match package_store.allowed(name) {
        Ok(allowed) => allowed,
        Err(error) => return failed(error.to_string()),
    };
    let beyond = package.manifest.permissions.beyond(&allowed);
    let command = format!("althing plugin allow {name}");
    let consent = match consent(name, &beyond, &args.rights.allow, &command, json) {
        Ok(consent) => consent,
        Err(code) => return code,
    };
    let noted = package_store.allow(name, &consent).and_then(|()| package_store.allowed(name));
    let allowed = match noted {
        Ok(allowed) => allowed,
        Err(error) => return failed(error.to_string()),
    };
    if json {
        let allowed: Vec<_> = allowed.iter().map(Right::to_string).collect();
        return output::print_json(&json!({ "plugin": name, "allowed": allowed }), exit::DONE);
    }
    match consent.is_empty() {
        true => output::print(format!("{name} has all rights that it asks for\n"), exit::DONE),
        false => output::print(format!("allowed {name} {}\n", listed(&consent)), exit::DONE),
    }
}

/// Asks the user to grant the rights in `beyond`, except those that `allowed` covers. Returns all
/// of `beyond` if the user consents, otherwise an exit code. If there is no terminal, prints
/// `command` with the `--allow` options that a script needs.
pub(super) fn consent(
    name: &str,
    beyond: &[Right],
    allowed: &[Right],
    command: &str,
    json: bool,
) -> Result<Vec<Right>, ExitCode> {
    for right in allowed.iter().filter(|right| !beyond.iter().any(|asked| right.covers(asked))) {
        output::print_note(&format!("note: `{name}` does not ask for {right}, or has it already"));
    }
    let is_covered = |asked: &&Right| allowed.iter().any(|right| right.covers(asked));
    let missing: Vec<Right> = beyond.iter().filter(|asked| !is_covered(asked)).cloned().collect();
    if missing.is_empty() {
        return Ok(beyond.to_vec());
    }
    if json {
        let asks: Vec<_> = missing.iter().map(Right::to_string).collect();
        let value = json!({ "status": "not-allowed", "plugin": name, "asks": asks });
        return Err(output::print_json(&value, exit::NOT_ALLOWED));
    }
    let wants: Vec<_> = missing.iter().map(|right| format!("  {}\n", right.meaning())).collect();
    let wants = wants.concat();
    if !io::stdin().is_terminal() || !io::stderr().is_terminal() {
        let words: Vec<_> = missing.iter().map(|right| format!(" --allow {right}")).collect();
        output::print_note(&format!(
            "error: `{name}` asks for the right\n{wants}and no terminal is here to ask for \
             consent. To allow that: {command}{}",
            words.concat()
        ));
        return Err(exit::with(exit::NOT_ALLOWED));
    }
    if is_agreed(&format!("`{name}` asks for the right\n{wants}Allow that? [y/N]")) {
        return Ok(beyond.to_vec());
    }
    output::print_note("nothing was allowed, and nothing was changed");
    Err(exit::with(exit::NOT_ALLOWED))
}
