//! `althing restore`: puts in place what `althing backup` has written.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ::backups::{
    BackupContents, BackupManifest, RestoreOptions, RestoreTarget, RestoredPlace, TargetManner,
    inspect, unpack,
};
use acl::EcosystemId;
use jiff::Zoned;
use serde_json::json;
use terminal::{exit, output, visible};

use crate::cli::backup::RestoreArgs;
use crate::commands::client::shell_word;
use crate::commands::{byte_count, in_runtime, wrong};
use crate::hosting::{self, ClosedEntrance, STATE_FORMAT};

/// Runs `althing restore`.
pub(super) fn run(args: &RestoreArgs) -> ExitCode {
    hosting::restrict_umask();
    in_runtime(async {
        match put_back(args).await {
            Ok(exit) => exit,
            Err(problem) => wrong(&problem, args.print.json),
        }
    })
}

/// Restores the archive. The error is a sentence for a person.
async fn put_back(args: &RestoreArgs) -> Result<ExitCode, String> {
    let contents = inspect(&args.file).map_err(|error| format!("failed to {error}"))?;
    let manifest = &contents.manifest;
    if manifest.state_format > STATE_FORMAT {
        return Err(format!(
            "failed to restore the state in {}: it has format {}, of althing {}, and this version \
             reads up to {STATE_FORMAT}; install that version first",
            args.file.display(),
            manifest.state_format,
            visible::line(&manifest.made_by),
        ));
    }
    let ecosystem = EcosystemId::new(&manifest.ecosystem)
        .map_err(|error| format!("failed to read {}: {error}", args.file.display()))?;
    let targets = targets(manifest, &ecosystem, args.configuration.as_deref());
    if args.check {
        return Ok(show(args, &contents, &targets));
    }
    drop(without_daemons(&ecosystem).await?);
    let unpacked = unpack(&args.file, &targets).map_err(|error| format!("failed to {error}"))?;
    // The unpacking takes minutes if there is a history, and a daemon may have started meanwhile.
    let entrance = without_daemons(&ecosystem).await?;
    let stamp = Zoned::now().strftime("%Y-%m-%dT%H%M%S").to_string();
    let options = RestoreOptions { replaces: args.replace, stamp };
    let places = unpacked.put_in_place(&options).map_err(|error| format!("failed to {error}"))?;
    drop(entrance);
    let file = targets.get("configuration").map(|target| target.folder.join(&manifest.file));
    if args.print.json {
        let value = json!({ "status": "ok", "manifest": manifest, "places": places, "file": file });
        return Ok(output::print_json(&value, exit::DONE));
    }
    Ok(output::print(report(args, manifest, &places, file.as_deref()), exit::DONE))
}

/// Keeps the daemons of an ecosystem from starting on this machine, as long as the returned value
/// exists.
///
/// # Errors
///
/// Returns a sentence for a person if a daemon of the ecosystem is running.
async fn without_daemons(ecosystem: &EcosystemId) -> Result<ClosedEntrance, String> {
    let folder = hosting::runtime_base().join(ecosystem.as_str());
    let entrance = ClosedEntrance::close(&folder).await;
    let entrance = entrance.map_err(|error| format!("failed to {error}"))?;
    match entrance.daemons.first() {
        None => Ok(entrance),
        Some(daemon) => Err(format!(
            "the daemon `{daemon}` of `{ecosystem}` is running on this machine; stop it first: \
             sudo systemctl stop althing"
        )),
    }
}

/// Returns the places of the parts on this machine.
fn targets(
    manifest: &BackupManifest,
    ecosystem: &EcosystemId,
    configuration: Option<&Path>,
) -> BTreeMap<String, RestoreTarget> {
    let before = manifest.parts.get("configuration").cloned().unwrap_or_default();
    let now = configuration.map_or(before.clone(), Path::to_owned);
    // Folders beside the ecosystem file move with it.
    let beside = |root: &Path| root.join(&manifest.file).parent().map(Path::to_owned);
    let (beside_before, beside_now) = (beside(&before), beside(&now));
    let moved = |folder: &PathBuf| {
        let rest = folder.strip_prefix(beside_before.as_ref()?).ok()?;
        Some(beside_now.as_ref()?.join(rest))
    };
    let target = |(name, folder): (&String, &PathBuf)| {
        let (folder, manner) = match name.as_str() {
            "configuration" => (now.clone(), TargetManner::Single),
            "keys" => (moved(folder).unwrap_or_else(|| folder.clone()), TargetManner::Whole),
            "plugins" => {
                let default = || hosting::plugins_folder(None);
                (moved(folder).unwrap_or_else(default), TargetManner::Whole)
            }
            "state" => (hosting::state_base().join(ecosystem.as_str()), TargetManner::Whole),
            _ => return None,
        };
        Some((name.clone(), RestoreTarget { folder, manner }))
    };
    manifest.parts.iter().filter_map(target).collect()
}

/// Prints what is in an archive, and where it would be put.
fn show(
    args: &RestoreArgs,
    contents: &BackupContents,
    targets: &BTreeMap<String, RestoreTarget>,
) -> ExitCode {
    if args.print.json {
        let value = json!({ "status": "ok", "contents": contents });
        return output::print_json(&value, exit::DONE);
    }
    let BackupContents { manifest, entries, bytes } = contents;
    let mut text = format!(
        "{} is whole: `{}`, made on {} at {} by althing {}\n{entries} entries, {}\n",
        args.file.display(),
        manifest.ecosystem,
        manifest.machine,
        manifest.made_at,
        manifest.made_by,
        byte_count(*bytes),
    );
    for (name, root) in &manifest.parts {
        let target = targets.get(name).map(|target| format!(", to {}", target.folder.display()));
        let target = target.unwrap_or_default();
        text.push_str(&format!("  {name:<14} from {}{target}\n", root.display()));
    }
    if !manifest.left_out.is_empty() {
        text.push_str(&format!("left out: {}\n", manifest.left_out.join(", ")));
    }
    output::print(text, exit::DONE)
}

fn report(
    args: &RestoreArgs,
    manifest: &BackupManifest,
    places: &[RestoredPlace],
    file: Option<&Path>,
) -> String {
    let mut text = format!(
        "restored `{}` from {}, made on {} at {}\n",
        manifest.ecosystem,
        args.file.display(),
        manifest.machine,
        manifest.made_at,
    );
    if places.is_empty() {
        text.push_str("all of it was in place already\n");
    }
    for RestoredPlace { place, before } in places {
        text.push_str(&format!("  {}\n", place.display()));
        if let Some(before) = before {
            text.push_str(&format!("    what was there is now {}\n", before.display()));
        }
    }
    if let Some(file) = file {
        let word = shell_word(&file.to_string_lossy());
        text.push_str(&format!("Next: althing check {word}\nand then start the daemon.\n"));
    }
    text
}
