//! Reads an archive, and checks it from its first byte to its last.
//!
//! Nothing of an archive is trusted: a name leads to no place outside of its part, neither by itself
//! nor through a link that comes before it, and a content counts only when its digest is right.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Component, Path, PathBuf};

use flate2::read::GzDecoder;
use ring::digest::{Context, SHA256};
use serde::Serialize;
use tar::{Archive, Entry, EntryType};

use crate::error::{BackupError, failed};
use crate::manifest::{
    BACKUP_FORMAT, BackupManifest, DIGESTS, MANIFEST, MANIFEST_BYTES_MAX, ManifestVersion,
    digest_name,
};
use crate::steady::hexadecimal;

/// Maximum number of entries that are read: a building's state has hundreds, a package with a Python
/// of its own some thousands.
const ENTRIES_MAX: usize = 1_000_000;

/// Longest list of digests that is read, in bytes: that of the entries above, with usual names.
const DIGESTS_BYTES_MAX: u64 = 256 << 20;

/// Maximum number of bytes behind the last entry; tar fills a block with zeros.
const PADDING_BYTES_MAX: u64 = 1 << 20;

/// Number of bytes that are read at once.
const CHUNK_BYTES: usize = 64 << 10;

/// Description of an archive that was found whole.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BackupContents {
    /// Origin and parts of the archive.
    pub manifest: BackupManifest,
    /// Number of files, folders and links.
    pub entries: usize,
    /// Number of bytes of all files.
    pub bytes: u64,
}

/// Content of one entry.
pub(crate) enum EntryContent {
    Folder,
    File,
    Link(PathBuf),
}

/// One entry of a part.
pub(crate) struct PartEntry<'a> {
    /// Name of the part.
    pub(crate) part: String,
    /// Path below the folder of the part; empty for that folder itself.
    pub(crate) path: PathBuf,
    pub(crate) content: EntryContent,
    pub(crate) mode: u32,
    pub(crate) user: String,
    pub(crate) group: String,
    /// The bytes of a file; it must be read to its end.
    pub(crate) bytes: CheckedBytes<'a>,
}

/// The entries of an archive that were read. A forged archive may order them so that one would be
/// unpacked through another.
#[derive(Default)]
struct ReadEntries {
    names: BTreeSet<PathBuf>,
    links: BTreeSet<PathBuf>,
}

/// The bytes of one file, which are counted and digested while they are read.
pub(crate) struct CheckedBytes<'a> {
    entry: Entry<'a, GzDecoder<BufReader<File>>>,
    archive: &'a Path,
    context: Context,
    length: u64,
}

// === impl ReadEntries ===

impl ReadEntries {
    /// Adds an entry. Returns what is wrong with it; `None` if it leads nowhere else.
    fn add(&mut self, name: &Path, content: &EntryContent) -> Option<&'static str> {
        let is_link = matches!(content, EntryContent::Link(_));
        if name.ancestors().skip(1).any(|above| self.links.contains(above)) {
            return Some("is below a link");
        }
        if !self.names.insert(name.to_owned()) {
            return Some("is there twice");
        }
        if is_link {
            self.links.insert(name.to_owned());
        } else if !self.links.is_empty() {
            return Some("comes after a link");
        }
        None
    }
}

// === impl CheckedBytes ===

impl CheckedBytes<'_> {
    /// Passes the bytes to `write`, chunk by chunk.
    pub(crate) fn copy_to(
        &mut self,
        mut write: impl FnMut(&[u8]) -> Result<(), BackupError>,
    ) -> Result<(), BackupError> {
        let mut chunk = vec![0; CHUNK_BYTES];
        loop {
            let count = match self.entry.read(&mut chunk) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(damaged(self.archive, error.to_string())),
            };
            let part = chunk.get(..count).unwrap_or_default();
            self.context.update(part);
            self.length += part.len() as u64;
            write(part)?;
        }
    }
}

/// Checks an archive without writing anything.
///
/// # Errors
///
/// Returns an error if the file is no archive, if a newer version made it, or if it is damaged.
pub fn inspect(archive: &Path) -> Result<BackupContents, BackupError> {
    visit(archive, |entry| entry.bytes.copy_to(|_| Ok(())))
}

/// Reads an archive, and passes each entry of its parts to `take`.
pub(crate) fn visit(
    archive: &Path,
    mut take: impl FnMut(&mut PartEntry<'_>) -> Result<(), BackupError>,
) -> Result<BackupContents, BackupError> {
    let file = File::open(archive).map_err(failed("read", archive))?;
    let mut reader = Archive::new(GzDecoder::new(BufReader::new(file)));
    let foreign = |problem: String| BackupError::Foreign { path: archive.to_owned(), problem };
    let mut entries = reader.entries().map_err(|error| foreign(error.to_string()))?;
    let first = entries.next().ok_or_else(|| foreign("it is empty".to_owned()))?;
    let manifest = manifest(archive, first.map_err(|error| foreign(error.to_string()))?)?;
    let mut contents = BackupContents { manifest, entries: 0, bytes: 0 };
    let mut digests: BTreeMap<String, String> = BTreeMap::new();
    let mut known = ReadEntries::default();
    for entry in entries {
        let entry = entry.map_err(|error| damaged(archive, error.to_string()))?;
        let name = entry.path().map_err(|error| damaged(archive, error.to_string()))?.into_owned();
        if name == Path::new(DIGESTS) {
            compare(archive, entry, &digests)?;
            drain(archive, reader.into_inner())?;
            return Ok(contents);
        }
        contents.entries += 1;
        if contents.entries > ENTRIES_MAX {
            return Err(damaged(archive, format!("it has more than {ENTRIES_MAX} entries")));
        }
        let mut entry = part_entry(archive, &contents.manifest, &name, entry)?;
        if let Some(problem) = known.add(&name, &entry.content) {
            return Err(damaged(archive, format!("{} {problem}", digest_name(&name))));
        }
        take(&mut entry)?;
        contents.bytes += entry.bytes.length;
        if matches!(entry.content, EntryContent::File) {
            let digest = hexadecimal(&entry.bytes.context.finish());
            digests.insert(digest_name(&name), digest);
        }
    }
    Err(damaged(archive, "it is cut off: its end is missing".to_owned()))
}

/// Reads what follows the last entry, so that the checksum of the whole archive is compared.
fn drain(archive: &Path, rest: GzDecoder<BufReader<File>>) -> Result<(), BackupError> {
    let read = io::copy(&mut rest.take(PADDING_BYTES_MAX), &mut io::sink());
    match read {
        Ok(length) if length < PADDING_BYTES_MAX => Ok(()),
        Ok(_) => Err(damaged(archive, "something follows its end".to_owned())),
        Err(error) => Err(damaged(archive, error.to_string())),
    }
}

fn manifest(
    archive: &Path,
    entry: Entry<'_, GzDecoder<BufReader<File>>>,
) -> Result<BackupManifest, BackupError> {
    let foreign = |problem: String| BackupError::Foreign { path: archive.to_owned(), problem };
    let name = entry.path().map(|name| name.into_owned()).unwrap_or_default();
    if name != Path::new(MANIFEST) {
        return Err(foreign(format!("it does not begin with {MANIFEST}")));
    }
    let mut text = Vec::new();
    let read = entry.take(MANIFEST_BYTES_MAX).read_to_end(&mut text);
    read.map_err(|error| damaged(archive, error.to_string()))?;
    let version: ManifestVersion =
        serde_json::from_slice(&text).map_err(|error| foreign(error.to_string()))?;
    if version.format > BACKUP_FORMAT {
        let made_by = version.made_by.chars().filter(|char| !char.is_control()).take(40).collect();
        return Err(BackupError::Newer {
            path: archive.to_owned(),
            found: version.format,
            made_by,
        });
    }
    serde_json::from_slice(&text).map_err(|error| damaged(archive, error.to_string()))
}

fn part_entry<'a>(
    archive: &'a Path,
    manifest: &BackupManifest,
    name: &Path,
    entry: Entry<'a, GzDecoder<BufReader<File>>>,
) -> Result<PartEntry<'a>, BackupError> {
    let wrong = |problem: &str| damaged(archive, format!("{} {problem}", digest_name(name)));
    let is_plain = |component: &Component<'_>| matches!(component, Component::Normal(_));
    let mut components = name.components();
    let part = match components.next() {
        Some(Component::Normal(part)) => part.to_string_lossy().into_owned(),
        _ => return Err(wrong("is no name of an entry")),
    };
    if !manifest.parts.contains_key(&part) || !components.clone().all(|each| is_plain(&each)) {
        return Err(wrong("belongs to no part"));
    }
    let path = components.as_path().to_owned();
    let header = entry.header();
    let content = match header.entry_type() {
        EntryType::Regular => EntryContent::File,
        EntryType::Directory => EntryContent::Folder,
        EntryType::Symlink => {
            let target = entry.link_name().ok().flatten();
            EntryContent::Link(target.ok_or_else(|| wrong("is a link to nothing"))?.into_owned())
        }
        _ => return Err(wrong("is neither a file nor a folder")),
    };
    let text = |name: Result<Option<&str>, _>| name.ok().flatten().unwrap_or_default().to_owned();
    Ok(PartEntry {
        part,
        path,
        content,
        // No bits that give a program the rights of its owner.
        mode: header.mode().unwrap_or(0o600) & 0o777,
        user: text(header.username().map_err(drop)),
        group: text(header.groupname().map_err(drop)),
        bytes: CheckedBytes { entry, archive, context: Context::new(&SHA256), length: 0 },
    })
}

/// Compares the digests of what was read with those at the end of the archive.
fn compare(
    archive: &Path,
    entry: Entry<'_, GzDecoder<BufReader<File>>>,
    read: &BTreeMap<String, String>,
) -> Result<(), BackupError> {
    let mut text = String::new();
    let end = entry.take(DIGESTS_BYTES_MAX).read_to_string(&mut text);
    end.map_err(|error| damaged(archive, error.to_string()))?;
    let mut said: BTreeMap<&str, &str> = BTreeMap::new();
    for line in text.lines() {
        let (digest, name) = line
            .split_once("  ")
            .ok_or_else(|| damaged(archive, "its digests cannot be read".to_owned()))?;
        said.insert(name, digest);
    }
    if let Some((name, _)) = read
        .iter()
        .find(|(name, digest)| said.get(name.as_str()).is_none_or(|said| said != &digest.as_str()))
    {
        return Err(damaged(archive, format!("{name} has another content than was archived")));
    }
    if let Some(name) = said.keys().find(|name| !read.contains_key(**name)) {
        return Err(damaged(archive, format!("{name} is missing in it")));
    }
    Ok(())
}

pub(crate) fn damaged(archive: &Path, problem: String) -> BackupError {
    let problem = problem.chars().map(|char| if char.is_control() { ' ' } else { char }).collect();
    BackupError::Damaged { path: archive.to_owned(), problem }
}
