//! Makes an archive.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use tar::{Builder, EntryType, Header};

use crate::error::{BackupError, failed};
use crate::manifest::{BackupManifest, DIGESTS, MANIFEST, digest_name};
use crate::owners::OwnerNames;
use crate::steady;

/// Permissions of an archive, which has keys in it.
const ARCHIVE_MODE: u32 = 0o600;

/// Deepest folder that is looked into. The state is a few levels deep; a link in a circle is not
/// followed.
const DEPTH_MAX: usize = 64;

/// Files that belong together, below one folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackupPart {
    /// Name of the part, such as `state`.
    pub name: String,
    /// The folder that the part is taken from.
    pub root: PathBuf,
    /// Paths of folders, files and symbolic links below the root; folders come before their content.
    pub paths: Vec<PathBuf>,
    /// Whether symbolic links are replaced by the files that they name.
    pub follows_links: bool,
}

/// A symbolic link of an archive. Links come after all files, so that no file is unpacked through a
/// link.
struct ArchivedLink {
    name: PathBuf,
    header: Header,
    target: PathBuf,
}

// === impl BackupPart ===

impl BackupPart {
    /// Returns the part with all that is below `root`, except what `is_left_out` names by its path
    /// below the root. Sockets and devices are not taken.
    ///
    /// # Errors
    ///
    /// Returns an error if a folder cannot be read.
    pub fn of_folder(
        name: &str,
        root: &Path,
        is_left_out: &dyn Fn(&Path) -> bool,
    ) -> Result<BackupPart, BackupError> {
        let mut paths = vec![PathBuf::new()];
        let mut waiting = vec![PathBuf::new()];
        while let Some(folder) = waiting.pop() {
            let whole = root.join(&folder);
            let entries = fs::read_dir(&whole).map_err(failed("read the folder", &whole))?;
            for entry in entries {
                let entry = entry.map_err(failed("read the folder", &whole))?;
                let path = folder.join(entry.file_name());
                let kind = entry.file_type().map_err(failed("read", entry.path()))?;
                if is_left_out(&path) || path.components().count() > DEPTH_MAX {
                    continue;
                }
                if kind.is_dir() {
                    waiting.push(path.clone());
                }
                if kind.is_dir() || kind.is_file() || kind.is_symlink() {
                    paths.push(path);
                }
            }
        }
        // A folder is a prefix of its content, and so comes before it.
        paths.sort();
        Ok(BackupPart { name: name.to_owned(), root: root.to_owned(), paths, follows_links: false })
    }
}

/// Writes the archive `archive`, which takes the place of an older one when it is whole and on disk.
/// Returns its length. The parts are read one after the other.
///
/// # Errors
///
/// Returns an error if a file cannot be read, if it changes all the time, or if the archive cannot
/// be written. The older archive is then as it was.
pub fn write_backup(
    archive: &Path,
    manifest: &BackupManifest,
    parts: &[BackupPart],
) -> Result<u64, BackupError> {
    let folder = folder_of(archive);
    let beside = beside(archive, "partial");
    // What an earlier run has left, if it was ended in the middle.
    let _ = fs::remove_file(&beside);
    let made = write_whole(archive, &beside, folder, manifest, parts);
    if made.is_err() {
        let _ = fs::remove_file(&beside);
    }
    made
}

fn write_whole(
    archive: &Path,
    beside: &Path,
    folder: &Path,
    manifest: &BackupManifest,
    parts: &[BackupPart],
) -> Result<u64, BackupError> {
    let refused = |source| BackupError::Write { path: archive.to_owned(), source };
    let file = OpenOptions::new().write(true).create_new(true).mode(ARCHIVE_MODE).open(beside);
    let file = file.map_err(refused)?;
    let mut writer = ArchiveWriter {
        archive,
        folder,
        builder: Builder::new(GzEncoder::new(BufWriter::new(file), Compression::default())),
        owners: OwnerNames::read(),
        digests: String::new(),
        links: Vec::new(),
    };
    let text = serde_json::to_vec_pretty(manifest).map_err(io::Error::other).map_err(refused)?;
    writer.add_text(MANIFEST, &text)?;
    for part in parts {
        for path in &part.paths {
            writer.add(part, path)?;
        }
    }
    let file = writer.finish()?;
    file.sync_all().map_err(refused)?;
    let length = file.metadata().map_err(refused)?.len();
    fs::rename(beside, archive).map_err(refused)?;
    // The name is on disk, too, before anyone relies on it.
    File::open(folder).and_then(|folder| folder.sync_all()).map_err(refused)?;
    Ok(length)
}

/// An archive that is being written.
struct ArchiveWriter<'a> {
    archive: &'a Path,
    folder: &'a Path,
    builder: Builder<GzEncoder<BufWriter<File>>>,
    owners: OwnerNames,
    digests: String,
    links: Vec<ArchivedLink>,
}

// === impl ArchiveWriter ===

impl ArchiveWriter<'_> {
    /// Adds a folder, a file or a symbolic link of a part.
    fn add(&mut self, part: &BackupPart, path: &Path) -> Result<(), BackupError> {
        let whole = part.root.join(path);
        let about = match part.follows_links {
            true => fs::metadata(&whole),
            false => fs::symlink_metadata(&whole),
        };
        let about = match about {
            Ok(about) => about,
            // A file that an agent has replaced or removed meanwhile.
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(failed("read", whole)(error)),
        };
        let mut header = Header::new_gnu();
        header.set_mode(about.mode() & 0o7777);
        header.set_uid(u64::from(about.uid()));
        header.set_gid(u64::from(about.gid()));
        header.set_mtime(u64::try_from(about.mtime()).unwrap_or(0));
        let (user, group) = (about.uid(), about.gid());
        let named = header
            .set_username(self.owners.user(u64::from(user)))
            .and_then(|()| header.set_groupname(self.owners.group(u64::from(group))));
        named.map_err(|source| self.refused(source))?;
        let name = Path::new(&part.name).join(path);
        if about.is_dir() {
            header.set_entry_type(EntryType::Directory);
            header.set_size(0);
            let added = self.builder.append_data(&mut header, &name, io::empty());
            return added.map_err(|source| self.refused(source));
        }
        if about.is_symlink() {
            header.set_entry_type(EntryType::Symlink);
            header.set_size(0);
            let target = fs::read_link(&whole).map_err(failed("read", &whole))?;
            self.links.push(ArchivedLink { name, header, target });
            return Ok(());
        }
        let mut copy = match steady::copy(&whole, self.folder) {
            Err(BackupError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
                return Ok(());
            }
            // The copy is beside the archive, where there is no room for it.
            Err(BackupError::Io { what: "copy", source, .. }) => return Err(self.refused(source)),
            copy => copy?,
        };
        header.set_entry_type(EntryType::Regular);
        header.set_size(copy.length);
        let added = self.builder.append_data(&mut header, &name, &mut copy.content);
        added.map_err(|source| self.refused(source))?;
        let digest = steady::hexadecimal(&copy.digest);
        self.digests.push_str(&format!("{digest}  {}\n", digest_name(&name)));
        Ok(())
    }

    fn add_text(&mut self, name: &str, text: &[u8]) -> Result<(), BackupError> {
        let mut header = Header::new_gnu();
        header.set_mode(ARCHIVE_MODE);
        header.set_size(text.len() as u64);
        let added = self.builder.append_data(&mut header, name, text);
        added.map_err(|source| self.refused(source))
    }

    /// Adds the links and the digests, and returns the file with all that was written.
    fn finish(mut self) -> Result<File, BackupError> {
        for ArchivedLink { name, mut header, target } in std::mem::take(&mut self.links) {
            let added = self.builder.append_link(&mut header, &name, &target);
            added.map_err(|source| self.refused(source))?;
        }
        let digests = std::mem::take(&mut self.digests);
        self.add_text(DIGESTS, digests.as_bytes())?;
        let archive = self.archive.to_owned();
        let refused = |source| BackupError::Write { path: archive.clone(), source };
        let encoder = self.builder.into_inner().map_err(refused)?;
        let mut buffer = encoder.finish().map_err(refused)?;
        buffer.flush().map_err(refused)?;
        buffer.into_inner().map_err(|error| refused(error.into_error()))
    }

    fn refused(&self, source: io::Error) -> BackupError {
        BackupError::Write { path: self.archive.to_owned(), source }
    }
}

/// Returns the folder of a file.
fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns the path of a hidden file beside `path`.
pub(crate) fn beside(path: &Path, what: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{what}"))
}
