//! Writes a file completely or not at all. After a full disk, after a crash, and for a reader at
//! any time, the file contains either the whole old text or the whole new one.
//!
//! The new text is written to a file in the same folder, synchronised to the disk, and renamed. A
//! target that cannot be replaced in this way is written in place: a pipe, a terminal, or a file in
//! a read-only folder.

use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

/// Writes `text` to `file`, in place of the old text.
pub(crate) fn write(file: &Path, text: &str) -> io::Result<()> {
    let known = fs::metadata(file);
    // A target that is not a regular file cannot be replaced. Neither can the missing target of a
    // link.
    let is_special = known.as_ref().is_ok_and(|known| !known.is_file());
    let is_dangling = known.is_err() && file.is_symlink();
    if is_special || is_dangling {
        return in_place(file, text);
    }
    // If the path is a link, the link stays, and the file that it points to is replaced.
    let target = fs::canonicalize(file).unwrap_or_else(|_| file.to_owned());
    match replace(&target, text, known.ok()) {
        Err(err) if is_of_folder(&err) && target.is_file() => in_place(&target, text),
        written => written,
    }
}

fn replace(file: &Path, text: &str, known: Option<fs::Metadata>) -> io::Result<()> {
    let folder = folder(file);
    let mut builder = tempfile::Builder::new();
    builder.prefix(".plan-");
    // The umask is applied to these permissions, as for any new file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut new = builder.tempfile_in(&folder)?;
    if let Some(known) = known {
        keep_as_it_was(new.as_file(), &known)?;
    }
    new.write_all(text.as_bytes())?;
    new.as_file().sync_all()?;
    new.persist(file).map_err(|err| err.error)?;
    // The rename is on the disk only after the folder has been synchronised; not all systems
    // support this.
    let _ = File::open(&folder).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Gives a new file the permissions and the owner of the old file, as far as this process is
/// allowed to change them.
fn keep_as_it_was(new: &File, known: &fs::Metadata) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let _ = std::os::unix::fs::fchown(new, Some(known.uid()), Some(known.gid()));
    }
    let permissions: Permissions = known.permissions();
    new.set_permissions(permissions)
}

/// Writes the new text over the old one in the same file, and truncates the file only after the
/// whole new text is written.
fn in_place(file: &Path, text: &str) -> io::Result<()> {
    let mut open = File::options().write(true).create(true).truncate(false).open(file)?;
    open.write_all(text.as_bytes())?;
    match open.metadata()?.is_file() {
        true => open.set_len(text.len() as u64).and_then(|()| open.sync_all()),
        false => open.flush(),
    }
}

/// Whether an error means that no file can be created in the folder of the target.
fn is_of_folder(err: &io::Error) -> bool {
    matches!(err.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem)
}

fn folder(file: &Path) -> PathBuf {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new(".")).to_owned()
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    fn folder_with(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join(name);
        fs::write(&file, text).expect("it can be written");
        (folder, file)
    }

    #[test]
    fn a_new_file_and_an_old_one_hold_the_whole_text() {
        let (folder, file) = folder_with("plan", "a long old text\n");
        write(&file, "new\n").expect("it can be written");
        assert_eq!(fs::read_to_string(&file).expect("it is there"), "new\n");
        let other = folder.path().join("other");
        write(&other, "new\n").expect("it can be written");
        assert_eq!(fs::read_to_string(&other).expect("it is there"), "new\n");
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2, "nothing is left");
    }

    #[test]
    fn rights_are_kept() {
        let (_folder, file) = folder_with("plan", "old");
        fs::set_permissions(&file, Permissions::from_mode(0o640)).expect("they can be set");
        write(&file, "new").expect("it can be written");
        let mode = fs::metadata(&file).expect("it is there").permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
    }

    #[test]
    fn a_link_stays_a_link() {
        let (folder, file) = folder_with("plan", "old");
        let link = folder.path().join("link");
        symlink(&file, &link).expect("a link");
        write(&link, "new").expect("it can be written");
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&file).expect("it is there"), "new");
        let dangling = folder.path().join("dangling");
        symlink(folder.path().join("nothing-yet"), &dangling).expect("a link");
        write(&dangling, "new").expect("it can be written");
        assert_eq!(
            fs::read_to_string(folder.path().join("nothing-yet")).expect("it is there"),
            "new"
        );
    }

    #[test]
    fn a_failed_write_leaves_the_old_text() {
        let (folder, file) = folder_with("plan", "old");
        let taken = folder.path().join("taken");
        fs::create_dir(&taken).expect("a folder");
        assert!(write(&taken, "new").is_err());
        assert!(write(&folder.path().join("no/such/folder"), "new").is_err());
        assert_eq!(fs::read_to_string(&file).expect("it is there"), "old");
    }

    #[test]
    fn a_device_is_written_to() {
        write(Path::new("/dev/null"), "new").expect("it can be written");
    }
}
