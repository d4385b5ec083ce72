//! The first entry of an archive: its format, its origin and its parts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// Format of the archives that this version writes, which is also the newest that it reads.
pub const BACKUP_FORMAT: u64 = 1;

/// Name of the first entry.
pub(crate) const MANIFEST: &str = "althing-backup.json";

/// Name of the last entry: the digests of all files, as `sha256sum --check` reads them. An archive
/// without it is cut off.
pub(crate) const DIGESTS: &str = "SHA256SUMS";

/// Longest manifest that is read, in bytes: some parts with their paths.
pub(crate) const MANIFEST_BYTES_MAX: u64 = 1 << 20;

/// The origin of an archive, and its parts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BackupManifest {
    /// Number of the format.
    pub format: u64,
    /// Version of the program that made the archive.
    pub made_by: String,
    /// Time at which the archive was made, as people write it.
    pub made_at: String,
    /// Name of the machine.
    pub machine: String,
    /// Name of the ecosystem.
    pub ecosystem: String,
    /// Path of the ecosystem file within the part `configuration`.
    pub file: PathBuf,
    /// Number of the format of the state.
    pub state_format: u64,
    /// The folder that each part was taken from, by the name of the part.
    pub parts: BTreeMap<String, PathBuf>,
    /// Names of what was left out.
    #[serde(default)]
    pub left_out: Vec<String>,
}

/// The fields that every version of the manifest has.
#[derive(Debug, Deserialize)]
pub(crate) struct ManifestVersion {
    pub(crate) format: u64,
    #[serde(default)]
    pub(crate) made_by: String,
}

/// Returns the name of an entry as the list of digests has it: on one line.
pub(crate) fn digest_name(name: &Path) -> String {
    name.to_string_lossy().replace('\n', "\\n")
}
