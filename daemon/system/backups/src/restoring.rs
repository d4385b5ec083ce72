//! Restores an archive: unpacks it beside the places where its parts belong, and then puts all parts
//! in place by renaming. What was there is kept under another name.

use std::collections::BTreeMap;
use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::syncfs;
use rustix::process::geteuid;

use crate::error::{BackupError, failed};
use crate::owners::OwnerNames;
use crate::reading::{BackupContents, EntryContent, PartEntry, visit};
use crate::writing::beside;

/// Permissions of a folder that is made above a place; the places themselves get those that they
/// had.
const FOLDER_MODE: u32 = 0o755;

/// Permissions of what is unpacked, until it is whole.
const PRIVATE: u32 = 0o700;

/// Number of names that are tried for what was there before.
const NAMES_MAX: usize = 1_000;

/// The place of a part on this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RestoreTarget {
    /// The folder of the part.
    pub folder: PathBuf,
    /// The way in which the part takes its place.
    pub manner: TargetManner,
}

/// The way in which a part takes its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetManner {
    /// The folder is replaced as a whole.
    Whole,
    /// Each file is replaced by itself: the folder has files of others, too.
    Single,
}

/// The way in which an archive is restored.
#[derive(Clone, Debug)]
pub struct RestoreOptions {
    /// Whether what is there already is replaced, and kept under another name.
    pub replaces: bool,
    /// Text by which the name of what was there is made unique, such as a time.
    pub stamp: String,
}

/// One file or folder that was put in place.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct RestoredPlace {
    /// The place.
    pub place: PathBuf,
    /// Name of what was there before; `None` if there was nothing.
    pub before: Option<PathBuf>,
}

/// The folders and files into which an archive is unpacked; they are removed with this value. Each is
/// beside its place, and so on the same file system.
#[derive(Default)]
struct Staging {
    /// By the name of the part: the folder beside the place of a whole part.
    folders: BTreeMap<String, PathBuf>,
    /// The files of parts whose files take their places one by one.
    files: Vec<Move>,
}

/// A file or folder that is to be renamed to its place.
#[derive(Clone, Debug)]
struct Move {
    from: PathBuf,
    place: PathBuf,
}

/// Restores an archive to `targets`, by the name of the part; a part without a target is left out.
/// Returns what the archive has, and the places that were changed.
///
/// # Errors
///
/// Returns an error if the archive cannot be used, if there is other content where a part belongs and
/// it is not to be replaced, or if there is no room. Nothing is changed then.
pub fn restore(
    archive: &Path,
    targets: &BTreeMap<String, RestoreTarget>,
    options: &RestoreOptions,
) -> Result<(BackupContents, Vec<RestoredPlace>), BackupError> {
    let mut staging = Staging::default();
    let owners = OwnerNames::read();
    let contents = visit(archive, |entry| {
        let Some(target) = targets.get(&entry.part) else {
            return entry.bytes.copy_to(|_| Ok(()));
        };
        match staging.path_of(target, entry)? {
            Some(path) => unpack(&path, entry, &owners),
            None => Ok(()),
        }
    })?;
    let files = staging.files.iter().map(|each| &each.from);
    for folder in staging.folders.values().chain(files) {
        let on_disk = File::open(folder).and_then(|folder| Ok(syncfs(folder)?));
        on_disk.map_err(failed("write", folder))?;
    }
    let moves = staging.moves(targets);
    if !options.replaces {
        refuse_occupied(&moves)?;
    }
    let places = put_in_place(&moves, &options.stamp)?;
    drop(staging);
    Ok((contents, places))
}

/// Makes the folder above a place.
fn make_above(place: &Path) -> Result<(), BackupError> {
    let above = place.parent().unwrap_or(Path::new("/"));
    let made = DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(above);
    made.map_err(failed("make the folder", above))
}

/// Makes an empty folder; what an earlier run has left there is removed.
fn make_new(folder: &Path) -> Result<(), BackupError> {
    match fs::remove_dir_all(folder) {
        Ok(()) => (),
        Err(error) if error.kind() == io::ErrorKind::NotFound => (),
        Err(error) => return Err(failed("remove", folder)(error)),
    }
    DirBuilder::new().mode(PRIVATE).create(folder).map_err(failed("make the folder", folder))
}

/// Writes one entry to `path`.
fn unpack(path: &Path, entry: &mut PartEntry<'_>, owners: &OwnerNames) -> Result<(), BackupError> {
    match &entry.content {
        EntryContent::Folder => {
            let made = DirBuilder::new().recursive(true).mode(PRIVATE).create(path);
            made.map_err(failed("make the folder", path))?;
        }
        EntryContent::File => {
            let made = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path);
            let mut file = made.map_err(failed("write", path))?;
            entry.bytes.copy_to(|bytes| file.write_all(bytes).map_err(failed("write", path)))?;
        }
        EntryContent::Link(target) => {
            symlink(target, path).map_err(failed("write", path))?;
        }
    }
    // Only root may give files away; the files of others belong to whoever restores them.
    if geteuid().is_root() {
        owners.give(path, &entry.user, &entry.group).map_err(failed("give away", path))?;
    }
    let mode = match &entry.content {
        // What is in a folder is unpacked after it.
        EntryContent::Folder => Some(entry.mode | PRIVATE),
        EntryContent::File => Some(entry.mode),
        EntryContent::Link(_) => None,
    };
    if let Some(mode) = mode {
        let given = fs::set_permissions(path, Permissions::from_mode(mode));
        given.map_err(failed("set the rights of", path))?;
    }
    Ok(())
}

/// Whether two files have the same content.
fn is_same(one: &Path, other: &Path) -> bool {
    let read = |path: &Path| -> io::Result<Vec<u8>> {
        let mut content = Vec::new();
        File::open(path)?.read_to_end(&mut content)?;
        Ok(content)
    };
    matches!((read(one), read(other)), (Ok(one), Ok(other)) if one == other)
}

/// Returns an error if a place has other content. An empty folder counts as nothing.
fn refuse_occupied(moves: &[Move]) -> Result<(), BackupError> {
    let mut occupied = moves.iter().map(|each| &each.place).filter(|place| is_occupied(place));
    match occupied.next() {
        None => Ok(()),
        Some(first) => {
            Err(BackupError::Occupied { first: first.clone(), others: occupied.count() })
        }
    }
}

fn is_occupied(place: &Path) -> bool {
    match fs::symlink_metadata(place) {
        Err(_) => false,
        Ok(about) if about.is_dir() => {
            fs::read_dir(place).map_or(true, |mut entries| entries.next().is_some())
        }
        Ok(_) => true,
    }
}

/// Renames everything to its place. After a failure, all that was renamed is renamed back.
fn put_in_place(moves: &[Move], stamp: &str) -> Result<Vec<RestoredPlace>, BackupError> {
    let mut done: Vec<(&Move, Option<PathBuf>)> = Vec::new();
    for each in moves {
        match put_one(each, stamp) {
            Ok(before) => done.push((each, before)),
            Err(source) => {
                let stuck = undo(&done);
                return Err(BackupError::Place { path: each.place.clone(), source, stuck });
            }
        }
    }
    let place = |(each, before): (&Move, Option<PathBuf>)| RestoredPlace {
        place: each.place.clone(),
        before,
    };
    Ok(done.into_iter().map(place).collect())
}

/// Renames one file or folder to its place. Returns the name of what was there before. After a
/// failure, the place is as it was.
fn put_one(each: &Move, stamp: &str) -> io::Result<Option<PathBuf>> {
    if let Some(above) = each.place.parent() {
        DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(above)?;
    }
    let before = match fs::symlink_metadata(&each.place) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error),
        Ok(_) => {
            let aside = free_name(&each.place, stamp)?;
            fs::rename(&each.place, &aside)?;
            Some(aside)
        }
    };
    if let Err(error) = fs::rename(&each.from, &each.place) {
        if let Some(aside) = &before {
            fs::rename(aside, &each.place)?;
        }
        return Err(error);
    }
    Ok(before)
}

/// Renames everything back, the last first. Returns the places with which that failed, each with the
/// name of what was there.
fn undo(done: &[(&Move, Option<PathBuf>)]) -> Vec<(PathBuf, PathBuf)> {
    let mut stuck = Vec::new();
    for (each, before) in done.iter().rev() {
        let back = fs::rename(&each.place, &each.from).and_then(|()| match before {
            Some(aside) => fs::rename(aside, &each.place),
            None => Ok(()),
        });
        if let (Err(_), Some(aside)) = (back, before) {
            stuck.push((each.place.clone(), aside.clone()));
        }
    }
    stuck
}

fn free_name(place: &Path, stamp: &str) -> io::Result<PathBuf> {
    let name = place.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for number in 0..NAMES_MAX {
        let ending = if number == 0 { String::new() } else { format!("-{number}") };
        let path = place.with_file_name(format!("{name}.before-{stamp}{ending}"));
        if fs::symlink_metadata(&path).is_err() {
            return Ok(path);
        }
    }
    Err(io::Error::other("there are too many older ones beside it"))
}

// === impl Staging ===

impl Staging {
    /// Returns the path to which an entry is unpacked, and makes the folder above it. Returns `None`
    /// for a folder of a part whose files take their places one by one.
    fn path_of(
        &mut self,
        target: &RestoreTarget,
        entry: &PartEntry<'_>,
    ) -> Result<Option<PathBuf>, BackupError> {
        match target.manner {
            TargetManner::Whole => {
                let path = self.folder_of(&entry.part, target)?.join(&entry.path);
                if !entry.path.as_os_str().is_empty() {
                    make_above(&path)?;
                }
                Ok(Some(path))
            }
            TargetManner::Single if matches!(entry.content, EntryContent::Folder) => Ok(None),
            TargetManner::Single => {
                let place = target.folder.join(&entry.path);
                make_above(&place)?;
                let from = beside(&place, "restoring");
                // What an earlier run has left.
                let _ = fs::remove_file(&from);
                self.files.push(Move { from: from.clone(), place });
                Ok(Some(from))
            }
        }
    }

    /// Returns the folder into which a whole part is unpacked, and makes it for the first entry.
    fn folder_of(&mut self, part: &str, target: &RestoreTarget) -> Result<PathBuf, BackupError> {
        if let Some(folder) = self.folders.get(part) {
            return Ok(folder.clone());
        }
        make_above(&target.folder)?;
        let folder = beside(&target.folder, "restoring");
        make_new(&folder)?;
        self.folders.insert(part.to_owned(), folder.clone());
        Ok(folder)
    }

    /// Returns what is to be renamed. Files that are in place already with the same content are left
    /// out.
    fn moves(&self, targets: &BTreeMap<String, RestoreTarget>) -> Vec<Move> {
        let folders = self.folders.iter().filter_map(|(part, folder)| {
            let place = targets.get(part)?.folder.clone();
            Some(Move { from: folder.clone(), place })
        });
        let files = self.files.iter().filter(|each| !is_same(&each.from, &each.place)).cloned();
        folders.chain(files).collect()
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        for folder in self.folders.values() {
            // A part that was put in place is no longer there.
            let _ = fs::remove_dir_all(folder);
        }
        for each in &self.files {
            let _ = fs::remove_file(&each.from);
        }
    }
}
