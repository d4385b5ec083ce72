//! Warns about files with secrets that are not there or that other users can read. The agents that
//! need them do not start, or reach nothing, and only their machine has the files.

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use pddl::{Diagnostic, Span};
use serde_json::Value;

use super::Reviewer;

/// The end of the keys of a `config` that name a file with a secret.
const KEY_END: &str = "-file";

/// Permissions that no file with a secret gives: others read or change it, the group changes it.
const TOO_OPEN: u32 = 0o027;

impl Reviewer<'_> {
    /// Warns about files with secrets, if all agents are on one machine, which is probably this one.
    pub(super) fn secret_files(&mut self) {
        let ecosystem = self.ecosystem;
        if ecosystem.daemons.len() > 1 {
            return;
        }
        for entry in ecosystem.agents.iter().filter(|entry| entry.is_built_in()) {
            let mut named = Vec::new();
            collect_files(&entry.config, format!("{}.config", entry.path), &mut named);
            for (path, file) in named {
                let whole = ecosystem.folder.join(file);
                if let Some((message, help)) = mistake(&whole, entry.name.as_str()) {
                    let found = Diagnostic::warning(Span::default(), message).with_help(help);
                    self.report_value(&path, found);
                }
            }
        }
    }
}

/// Collects the files with secrets that a `config` names, each with the path of its key.
fn collect_files<'v>(value: &'v Value, path: String, named: &mut Vec<(String, &'v str)>) {
    match value {
        Value::Object(table) => {
            for (key, value) in table {
                let path = format!("{path}.{key}");
                match value.as_str().filter(|_| key.ends_with(KEY_END)) {
                    Some(file) => named.push((path, file)),
                    None => collect_files(value, path, named),
                }
            }
        }
        Value::Array(list) => {
            for (index, value) in list.iter().enumerate() {
                collect_files(value, format!("{path}.{index}"), named);
            }
        }
        _ => (),
    }
}

/// Returns what is wrong with a file, and how it is mended.
fn mistake(file: &Path, agent: &str) -> Option<(String, String)> {
    let shown = file.display();
    match file.metadata() {
        Ok(data) if data.mode() & TOO_OPEN != 0 => Some((
            format!("other users can read or change {shown} (mode {:03o})", data.mode() & 0o777),
            format!("close it: chmod 600 {shown}"),
        )),
        Ok(_) => None,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Some((
            format!("there is no file {shown}"),
            format!(
                "the machine that hosts `{agent}` needs it: one line with the secret, mode 600"
            ),
        )),
        // A file that this user may not look at is checked by the daemon.
        Err(_) => None,
    }
}
