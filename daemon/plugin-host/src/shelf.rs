//! The folder in which a machine's packages are: one folder each, and what people have said of them.
//!
//! Everything here is a rename in that folder, so that a daemon which looks at any moment sees the
//! old or the new. What begins with a dot is no package: `.NAME.disabled`, `.NAME.before` (what was
//! there before the last upgrade), `.NAME.failed` (an upgrade that was taken back).

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::manifest::Manifest;
use crate::package::{Faults, Package};

/// More packages on one machine are not looked at.
const PACKAGES_MAX: usize = 256;

/// The folder.
#[derive(Clone, Debug)]
pub struct Shelf {
    /// Where it is.
    pub folder: PathBuf,
}

/// Why something could not be done with a package. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShelfError {
    /// What is to be added is no whole package.
    #[error("add a package that is not whole: {}", .0.first())]
    Faulty(Box<Faults>),
    /// There is none of this name.
    #[error("find a plugin `{name}` in {}", folder.display())]
    Unknown {
        /// The name.
        name: String,
        /// Where it is not.
        folder: PathBuf,
    },
    /// The file system declined.
    #[error("{doing} {}: {source}", path.display())]
    Io {
        /// What was being done.
        doing: &'static str,
        /// With what.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
}

impl Shelf {
    /// The packages, by name.
    pub fn names(&self) -> Vec<String> {
        let Ok(entries) = fs::read_dir(&self.folder) else { return Vec::new() };
        let folders = entries.flatten().filter(|entry| entry.path().is_dir());
        let names = folders.filter_map(|entry| entry.file_name().into_string().ok());
        let mut names: Vec<_> = names.filter(|name| !name.starts_with('.')).collect();
        names.sort();
        names.truncate(PACKAGES_MAX);
        names
    }

    /// Where a package of this name is.
    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn aside(&self, name: &str, what: &str) -> PathBuf {
        self.folder.join(format!(".{name}.{what}"))
    }

    /// Whether a person has taken it out of use.
    pub fn is_disabled(&self, name: &str) -> bool {
        self.aside(name, "disabled").exists()
    }

    /// Takes a package out of use, or into use again; whatever was given up is begun anew.
    ///
    /// # Errors
    ///
    /// If there is none of this name, or the folder cannot be written.
    pub fn set_disabled(&self, name: &str, is_disabled: bool) -> Result<(), ShelfError> {
        self.known(name)?;
        let mark = self.aside(name, "disabled");
        // Written before it is removed: whoever watches the folder sees that something was said.
        fs::write(&mark, "").map_err(|source| failed("write", &mark, source))?;
        if !is_disabled {
            fs::remove_file(&mark).map_err(|source| failed("remove", &mark, source))?;
        }
        Ok(())
    }

    /// Puts a package in, in place of what has its name.
    ///
    /// # Errors
    ///
    /// If it is not whole, or cannot be copied.
    pub fn add(&self, from: &Path) -> Result<Manifest, ShelfError> {
        let package = Package::open(from).map_err(|faults| ShelfError::Faulty(Box::new(faults)))?;
        let name = package.manifest.name.clone();
        fs::create_dir_all(&self.folder).map_err(|source| failed("make", &self.folder, source))?;
        let (new, before) = (self.aside(&name, "new"), self.aside(&name, "before"));
        self.clear(&new)?;
        copy(from, &new)?;
        let place = self.at(&name);
        if place.exists() {
            self.clear(&before)?;
            fs::rename(&place, &before).map_err(|source| failed("put aside", &place, source))?;
        }
        fs::rename(&new, &place).map_err(|source| failed("put in place", &place, source))?;
        Ok(package.manifest)
    }

    /// Takes a package away, with what was before it.
    ///
    /// # Errors
    ///
    /// If there is none of this name, or it cannot be removed.
    pub fn remove(&self, name: &str) -> Result<(), ShelfError> {
        self.known(name)?;
        // Out of sight at once: a daemon never sees half of it.
        let gone = self.aside(name, "removed");
        self.clear(&gone)?;
        let place = self.at(name);
        fs::rename(&place, &gone).map_err(|source| failed("remove", &place, source))?;
        for what in ["removed", "before", "failed", "disabled"] {
            self.clear(&self.aside(name, what))?;
        }
        Ok(())
    }

    /// Puts back what was there before the last upgrade; `false` if nothing was.
    pub(crate) fn roll_back(&self, name: &str) -> Result<bool, ShelfError> {
        let (place, before) = (self.at(name), self.aside(name, "before"));
        if !before.exists() {
            return Ok(false);
        }
        let failed_one = self.aside(name, "failed");
        self.clear(&failed_one)?;
        fs::rename(&place, &failed_one).map_err(|source| failed("put aside", &place, source))?;
        fs::rename(&before, &place).map_err(|source| failed("put back", &before, source))?;
        Ok(true)
    }

    /// The upgrade has proved itself: there is no way back any more.
    pub(crate) fn keep(&self, name: &str) {
        // What stays is in nobody's way.
        let _ = self.clear(&self.aside(name, "before"));
    }

    fn known(&self, name: &str) -> Result<(), ShelfError> {
        let is_known = !name.is_empty() && !name.contains('/') && self.at(name).is_dir();
        let unknown = || ShelfError::Unknown { name: name.to_owned(), folder: self.folder.clone() };
        is_known.then_some(()).ok_or_else(unknown)
    }

    fn clear(&self, path: &Path) -> Result<(), ShelfError> {
        let removed = match fs::symlink_metadata(path) {
            Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
            Ok(_) => fs::remove_file(path),
            Err(_) => Ok(()),
        };
        removed.map_err(|source| failed("remove", path, source))
    }
}

fn failed(doing: &'static str, path: &Path, source: io::Error) -> ShelfError {
    ShelfError::Io { doing, path: path.to_owned(), source }
}

/// Copies a folder and what is in it, links as links.
fn copy(from: &Path, to: &Path) -> Result<(), ShelfError> {
    fs::create_dir(to).map_err(|source| failed("make", to, source))?;
    let entries = fs::read_dir(from).map_err(|source| failed("read", from, source))?;
    for entry in entries.flatten() {
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        let metadata =
            fs::symlink_metadata(&path).map_err(|source| failed("read", &path, source))?;
        let copied = if metadata.is_dir() {
            copy(&path, &to)?;
            Ok(())
        } else if metadata.is_symlink() {
            fs::read_link(&path).and_then(|target| std::os::unix::fs::symlink(target, &to))
        } else if metadata.is_file() {
            fs::copy(&path, &to).map(drop)
        } else {
            Ok(())
        };
        copied.map_err(|source| failed("copy", &path, source))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn package(folder: &Path, version: &str) -> PathBuf {
        let path = folder.join("lamp");
        fs::create_dir_all(&path).expect("a folder");
        let text =
            format!("name = \"lamp\"\nversion = \"{version}\"\nprotocol = \"1\"\nrun = [\"sh\"]\n");
        fs::write(path.join("plugin.toml"), text).expect("a file");
        path
    }

    fn version(shelf: &Shelf) -> String {
        Package::open(&shelf.at("lamp")).expect("it is whole").manifest.version
    }

    #[test]
    fn packages_are_added_upgraded_taken_back_and_removed() {
        let (source, place) =
            (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        let shelf = Shelf { folder: place.path().join("plugins") };
        assert!(shelf.names().is_empty(), "the folder is not there yet");
        shelf.add(&package(source.path(), "1.0")).expect("added");
        assert_eq!((shelf.names(), version(&shelf)), (vec!["lamp".to_owned()], "1.0".to_owned()));
        shelf.add(&package(source.path(), "2.0")).expect("upgraded");
        assert_eq!(version(&shelf), "2.0");
        assert!(shelf.roll_back("lamp").expect("renamed"));
        assert_eq!(version(&shelf), "1.0");
        assert!(!shelf.roll_back("lamp").expect("nothing"), "there is no way back from here");
        shelf.set_disabled("lamp", true).expect("written");
        assert!(shelf.is_disabled("lamp"));
        shelf.set_disabled("lamp", false).expect("removed");
        assert!(!shelf.is_disabled("lamp"));
        shelf.remove("lamp").expect("removed");
        let left = fs::read_dir(&shelf.folder).expect("a folder").count();
        assert_eq!((shelf.names().len(), left), (0, 0));
        let error = shelf.remove("lamp").expect_err("it is gone");
        assert!(error.to_string().starts_with("find a plugin `lamp` in "), "{error}");
    }

    #[test]
    fn what_is_not_whole_is_not_added() {
        let source = tempfile::tempdir().expect("a folder");
        let shelf = Shelf { folder: source.path().join("plugins") };
        let path = package(source.path(), "");
        let error = shelf.add(&path).expect_err("no version");
        assert!(error.to_string().contains("plugin.toml:2:11: a version says"), "{error}");
        assert!(shelf.names().is_empty());
    }
}
