//! `althing backup`: writes all that must outlive this machine to one file. Which files belong to an
//! ecosystem is in [`sources`].

mod sources;

use std::process::ExitCode;

use ::backups::{BACKUP_FORMAT, BackupManifest, BackupPart, write_backup};
use jiff::Zoned;
use serde_json::json;
use terminal::{exit, output};

use self::sources::BackupSources;
use crate::cli::backup::BackupArgs;
use crate::commands::{byte_count, wrong};
use crate::config::{self, Ecosystem, Overrides};
use crate::hosting::{self, STATE_FORMAT};
use crate::plugins;

/// Runs `althing backup`.
pub(super) fn run(args: &BackupArgs) -> ExitCode {
    hosting::restrict_umask();
    match back_up(args) {
        Ok(exit) => exit,
        Err(problem) => wrong(&problem, args.print.json),
    }
}

/// Writes the archive. The error is a sentence for a person.
fn back_up(args: &BackupArgs) -> Result<ExitCode, String> {
    let path = match &args.ecosystem {
        Some(asked) => {
            config::resolve_ecosystem(asked).map_err(|problem| format!("failed to {problem}"))?
        }
        None => config::find_ecosystem_file().ok_or_else(|| {
            "there is no althing.toml here nor in the configuration folders; name the ecosystem \
             file with --ecosystem"
                .to_owned()
        })?,
    };
    let read = Ecosystem::read(&path, &Overrides::default(), &plugins::known());
    // A mistake elsewhere in the file does not matter here.
    let Some(ecosystem) = read.ecosystem else {
        output::show_to_person(&read.report);
        return Err(format!("failed to read {}", path.display()));
    };
    let failed = |error: ::backups::BackupError| format!("failed to {error}");
    let sources = BackupSources::find(&path, &ecosystem, &args.without).map_err(failed)?;
    let manifest = manifest(&ecosystem, &sources, args);
    let bytes = write_backup(&args.file, &manifest, &sources.parts).map_err(failed)?;
    if args.print.json {
        let value =
            json!({ "status": "ok", "file": args.file, "bytes": bytes, "manifest": manifest });
        return Ok(output::print_json(&value, exit::DONE));
    }
    let mut text = format!(
        "backed up `{}` to {} ({})\n",
        ecosystem.name,
        args.file.display(),
        byte_count(bytes)
    );
    for BackupPart { name, root, paths, .. } in &sources.parts {
        text.push_str(&format!("  {name:<14} {}: {} entries\n", root.display(), paths.len()));
    }
    if !manifest.left_out.is_empty() {
        text.push_str(&format!("left out: {}\n", manifest.left_out.join(", ")));
    }
    text.push_str("Keys and passwords are in it: only its owner can read it; keep it so.\n");
    Ok(output::print(text, exit::DONE))
}

fn manifest(ecosystem: &Ecosystem, sources: &BackupSources, args: &BackupArgs) -> BackupManifest {
    let parts = &sources.parts;
    let mut left_out: Vec<_> = args.without.iter().map(|each| each.as_str().to_owned()).collect();
    left_out.sort();
    left_out.dedup();
    BackupManifest {
        format: BACKUP_FORMAT,
        made_by: env!("CARGO_PKG_VERSION").to_owned(),
        made_at: Zoned::now().strftime("%Y-%m-%d %H:%M:%S %:z").to_string(),
        machine: hosting::host_name().map(|name| name.to_string()).unwrap_or_default(),
        ecosystem: ecosystem.name.to_string(),
        file: sources.file.clone(),
        state_format: STATE_FORMAT,
        parts: parts.iter().map(|part| (part.name.clone(), part.root.clone())).collect(),
        left_out,
    }
}
