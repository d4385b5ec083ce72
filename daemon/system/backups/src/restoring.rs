//! Restores an archive: unpacks it beside the places where its parts belong, and then puts all parts
//! in place by renaming. What was there is kept under another name.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};

use rustix::fs::syncfs;
use rustix::process::geteuid;

use crate::error::{BackupError, StuckPlace, failed};
use crate::manifest::digest_name;
use crate::owners::OwnerNames;
use crate::reading::{BackupContents, EntryContent, PartEntry, damaged, visit};
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

/// An archive that was checked to its end and unpacked beside the places where its parts belong. What
/// is not put in place is removed with this value.
pub struct UnpackedBackup {
    /// Description of the archive.
    pub contents: BackupContents,
    targets: BTreeMap<String, RestoreTarget>,
    staging: Staging,
}

/// Unpacks an archive beside `targets`, by the name of the part; a part without a target is left out.
///
/// # Errors
///
/// Returns an error if the archive cannot be used, or if there is no room. Nothing is changed then.
pub fn unpack(
    archive: &Path,
    targets: &BTreeMap<String, RestoreTarget>,
) -> Result<UnpackedBackup, BackupError> {
    let mut staging = Staging::default();
    let owners = OwnerNames::read();
    let contents = visit(archive, |entry| {
        let Some(target) = targets.get(&entry.part) else {
            return entry.bytes.copy_to(|_| Ok(()));
        };
        match staging.path_of(archive, target, entry)? {
            Some(path) => unpack_entry(&path, entry, &owners),
            None => Ok(()),
        }
    })?;
    let files = staging.files.iter().map(|each| &each.from);
    for folder in staging.folders.values().chain(files) {
        let on_disk = File::open(folder).and_then(|folder| Ok(syncfs(folder)?));
        on_disk.map_err(failed("write", folder))?;
    }
    Ok(UnpackedBackup { contents, targets: targets.clone(), staging })
}

impl UnpackedBackup {
    /// Puts all parts in place. Returns the places that were changed, when they are on disk.
    ///
    /// # Errors
    ///
    /// Returns an error if there is other content where a part belongs and it is not to be replaced,
    /// or if a part cannot be put in place. Nothing is changed then, as far as the error says.
    pub fn put_in_place(self, options: &RestoreOptions) -> Result<Vec<RestoredPlace>, BackupError> {
        let moves = self.staging.moves(&self.targets);
        if !options.replaces {
            refuse_occupied(&moves)?;
        }
        let places = put_in_place(&moves, &options.stamp)?;
        let folders: BTreeSet<_> = moves.iter().filter_map(|each| each.place.parent()).collect();
        for folder in folders {
            let on_disk = File::open(folder).and_then(|folder| Ok(syncfs(folder)?));
            on_disk.map_err(failed("put on disk what was restored to", folder))?;
        }
        Ok(places)
    }
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
fn unpack_entry(
    path: &Path,
    entry: &mut PartEntry<'_>,
    owners: &OwnerNames,
) -> Result<(), BackupError> {
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
            Err((source, own)) => {
                let stuck = own.into_iter().chain(undo(&done)).collect();
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
/// failure, the place is as it was, unless the error has it.
fn put_one(each: &Move, stamp: &str) -> Result<Option<PathBuf>, (io::Error, Option<StuckPlace>)> {
    let before = put_aside(&each.place, stamp).map_err(|error| (error, None))?;
    match fs::rename(&each.from, &each.place) {
        Ok(()) => Ok(before),
        Err(error) => Err((error, put_back(&each.place, false, before.as_deref()))),
    }
}

/// Renames what is at a place. Returns its new name; `None` if there is nothing.
fn put_aside(place: &Path, stamp: &str) -> io::Result<Option<PathBuf>> {
    if let Some(above) = place.parent() {
        DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(above)?;
    }
    match fs::symlink_metadata(place) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
        Ok(_) => {
            let aside = free_name(place, stamp)?;
            fs::rename(place, &aside)?;
            Ok(Some(aside))
        }
    }
}

/// Renames everything back, the last first. Returns the places with which that failed.
fn undo(done: &[(&Move, Option<PathBuf>)]) -> Vec<StuckPlace> {
    let back = |(each, before): &(&Move, Option<PathBuf>)| {
        let is_new = fs::rename(&each.place, &each.from).is_err();
        put_back(&each.place, is_new, before.as_deref())
    };
    done.iter().rev().filter_map(back).collect()
}

/// Renames the former content of a place back. `is_new` is whether the new content is still there.
/// Returns the place if that failed.
fn put_back(place: &Path, is_new: bool, before: Option<&Path>) -> Option<StuckPlace> {
    let is_back = !is_new && before.is_none_or(|before| fs::rename(before, place).is_ok());
    let stuck =
        || StuckPlace { place: place.to_owned(), is_new, before: before.map(Path::to_owned) };
    (!is_back).then(stuck)
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
        archive: &Path,
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
            // The files of such a part are archived without their links, and what follows a link here
            // could be unpacked through it.
            TargetManner::Single if matches!(entry.content, EntryContent::Link(_)) => {
                let name = Path::new(&entry.part).join(&entry.path);
                Err(damaged(archive, format!("{} is a link", digest_name(&name))))
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_that_cannot_be_put_back_is_named_with_its_cure() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let mut moves = Vec::new();
        for name in ["new", "old"] {
            fs::create_dir(at(&format!("staging-{name}"))).expect("made");
            let from = at(&format!("staging-{name}/{name}"));
            fs::create_dir(&from).expect("made");
            moves.push(Move { from, place: at(name) });
        }
        fs::create_dir(at("old")).expect("made");
        let done: Vec<_> =
            moves.iter().map(|each| (each, put_one(each, "now").expect("it is ours"))).collect();
        // Nothing can be renamed to a folder that is gone.
        for name in ["new", "old"] {
            fs::remove_dir(at(&format!("staging-{name}"))).expect("it is empty");
        }
        let stuck = undo(&done);
        let before = at("old.before-now");
        let places: Vec<_> =
            stuck.iter().map(|it| (it.place.clone(), it.is_new, it.before.clone())).collect();
        assert_eq!(places, [(at("old"), true, Some(before.clone())), (at("new"), true, None)]);
        let source = io::Error::other("no room");
        let said = BackupError::Place { path: at("third"), source, stuck }.to_string();
        let (old, new) = (at("old"), at("new"));
        let (old, new, before) = (old.display(), new.display(), before.display());
        assert!(said.contains(&format!("move {old} away, and {before} back to it")), "{said}");
        assert!(said.contains(&format!("remove {new}, which was not there")), "{said}");
    }

    #[test]
    fn a_place_that_cannot_be_filled_is_as_it_was() {
        let folder = tempfile::tempdir().expect("a folder");
        let place = folder.path().join("old");
        fs::create_dir(&place).expect("made");
        let each = Move { from: folder.path().join("none"), place: place.clone() };
        let (_, stuck) = put_one(&each, "now").expect_err("there is nothing to rename");
        assert_eq!(stuck, None);
        assert!(place.is_dir());
    }
}
