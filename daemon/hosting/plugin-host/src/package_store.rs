//! The plugin folder of a machine: one folder per package, and marker files with the decisions of
//! people.
//!
//! Every change is one rename in that folder, so that a daemon that reads the folder at any moment
//! finds either the old or the new state. Files and folders with a name that begins with a dot are
//! not packages:
//!
//! - `.NAME.disabled`: the package is disabled.
//! - `.NAME.rights`: the rights that a person has allowed the package, one in a line.
//! - `.NAME.before`: the version of the package before the last upgrade.
//! - `.NAME.failed`: the version of the package that was rolled back.
//!
//! A user that can write to the folder controls which programs run here. Therefore the folder and
//! everything in it is created with access for this user alone, regardless of the umask. A folder
//! that others can write to is refused.

use std::fs::{self, DirBuilder, OpenOptions, Permissions};
use std::io::{self, Write as _};
use std::os::unix::fs::{
    DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _,
};
use std::path::{Path, PathBuf};

use crate::manifest::PackageManifest;
use crate::package::{Package, PackageFaults};
use crate::rights::{Right, listed};

/// Largest number of packages on one machine; further packages are ignored.
const PACKAGES_MAX: usize = 256;

/// File mode of a folder that only this user can enter.
const FOLDER_MODE: u32 = 0o700;
/// Bits of a file mode that let the group or other users write.
const OTHERS_WRITE: u32 = 0o022;
/// Mask of all bits of a file mode.
const MODE: u32 = 0o7777;

/// Name of the marker file which states that rights need a person's consent in this plugin folder.
/// A daemon writes the file when it first checks the folder. Packages that ran there before keep
/// the rights that they used.
const ASKED: &str = ".rights-are-asked";

/// The plugin folder of this machine, with its packages and marker files.
#[derive(Clone, Debug)]
pub struct PackageStore {
    /// Path of the plugin folder.
    pub folder: PathBuf,
}

/// Reason why an operation on a package failed. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PackageStoreError {
    /// The package to be added has mistakes.
    #[error("add the package, which has a mistake: {}", .0.first())]
    Faulty(Box<PackageFaults>),
    /// The plugin folder has no package of this name.
    #[error("find a plugin `{name}` in {}", folder.display())]
    Unknown {
        /// Name of the requested package.
        name: String,
        /// The plugin folder that was searched.
        folder: PathBuf,
    },
    /// The package asks for rights that were not allowed.
    #[error("let `{name}` use {}: that is not allowed yet", listed(asks))]
    NotAllowed {
        /// Name of the requested package.
        name: String,
        /// Rights that the package asks for and that were not allowed.
        asks: Vec<Right>,
    },
    /// Other users can change files of the plugin folder.
    #[error("use {}: {who} can write to it, and could run anything here: {cure}", path.display())]
    Writable {
        /// The plugin folder, or a file or folder in it, that other users can change.
        path: PathBuf,
        /// Description of the users that can write to the path, for the message.
        who: &'static str,
        /// Command that corrects the access rights of the path.
        cure: String,
    },
    /// An operation on a file or folder failed.
    #[error("{doing} {}: {source}", path.display())]
    Io {
        /// The file operation that failed.
        doing: &'static str,
        /// Path of the file or folder on which the operation failed.
        path: PathBuf,
        /// Error of the system.
        #[source]
        source: io::Error,
    },
}

impl PackageStore {
    /// Returns the names of the packages in the plugin folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let Ok(entries) = fs::read_dir(&self.folder) else { return Vec::new() };
        let folders = entries.flatten().filter(|entry| entry.path().is_dir());
        let names = folders.filter_map(|entry| entry.file_name().into_string().ok());
        let mut names: Vec<_> = names.filter(|name| !name.starts_with('.')).collect();
        names.sort();
        names.truncate(PACKAGES_MAX);
        names
    }

    /// Returns the path of the folder of the package with this name.
    pub fn package_folder(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn aside(&self, name: &str, what: &str) -> PathBuf {
        self.folder.join(format!(".{name}.{what}"))
    }

    /// Whether a person has disabled the package with this name.
    pub fn is_disabled(&self, name: &str) -> bool {
        self.aside(name, "disabled").exists()
    }

    /// Disables or enables a package. Enabling also restarts a package that was given up after
    /// failures.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no package of this name, or the plugin folder cannot be
    /// written.
    pub fn set_disabled(&self, name: &str, is_disabled: bool) -> Result<(), PackageStoreError> {
        self.known(name)?;
        let mark = self.aside(name, "disabled");
        // The marker file is written even if it is removed next, so that a daemon that watches the
        // folder notices a change.
        write(&mark, "")?;
        if !is_disabled {
            fs::remove_file(&mark).map_err(|source| failed("remove", &mark, source))?;
        }
        Ok(())
    }

    /// Creates the plugin folder if it does not exist.
    ///
    /// # Errors
    ///
    /// Returns an error if the plugin folder cannot be created, or other users can write to it.
    pub fn make(&self) -> Result<(), PackageStoreError> {
        let mut folder = DirBuilder::new();
        let made = folder.recursive(true).mode(FOLDER_MODE).create(&self.folder);
        made.map_err(|source| failed("make", &self.folder, source))?;
        self.check_writers()
    }

    /// Checks that only this user and root can change the plugin folder.
    ///
    /// # Errors
    ///
    /// Returns an error if another user owns the plugin folder or can write to it. A folder that
    /// does not exist is no error.
    pub fn check_writers(&self) -> Result<(), PackageStoreError> {
        others_cannot_write(&self.folder)
    }

    /// Checks that only this user and root can change the files of a package.
    ///
    /// # Errors
    ///
    /// Returns an error about the first file or folder that another user owns or can write to.
    pub(crate) fn check_writers_of(&self, name: &str) -> Result<(), PackageStoreError> {
        others_cannot_write(&self.package_folder(name))?;
        let mut folders = vec![self.package_folder(name)];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                others_cannot_write(&entry.path())?;
                if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                    folders.push(entry.path());
                }
            }
        }
        Ok(())
    }

    /// Returns the rights that a person has allowed to a package.
    pub fn allowed(&self, name: &str) -> Vec<Right> {
        let text = fs::read_to_string(self.aside(name, "rights")).unwrap_or_default();
        // A line that is not a valid right is ignored.
        text.lines().filter_map(|line| line.trim().parse().ok()).collect()
    }

    /// Adds to the rights that a person has allowed to a package.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no package of this name, or the plugin folder cannot be
    /// written.
    pub fn allow(&self, name: &str, rights: &[Right]) -> Result<(), PackageStoreError> {
        self.known(name)?;
        self.note_rights(name, rights)
    }

    fn note_rights(&self, name: &str, rights: &[Right]) -> Result<(), PackageStoreError> {
        let mut all = self.allowed(name);
        all.retain(|known| !rights.iter().any(|right| right.covers(known)));
        all.extend(
            rights
                .iter()
                .filter(|right| !all.iter().any(|it| it.covers(right)))
                .cloned()
                .collect::<Vec<_>>(),
        );
        let text: String = all.iter().map(|right| format!("{right}\n")).collect();
        let (place, new) = (self.aside(name, "rights"), self.aside(name, "rights-new"));
        write(&new, &text)?;
        fs::rename(&new, &place).map_err(|source| failed("write", &place, source))
    }

    /// Allows each package the rights that it already uses. Does so once per plugin folder, for
    /// folders from versions without consent to rights. `has_run` returns `true` for the packages
    /// that have run here.
    pub(crate) fn allow_rights_in_use(
        &self,
        has_run: impl Fn(&str) -> bool,
    ) -> Result<(), PackageStoreError> {
        let mark = self.folder.join(ASKED);
        if mark.exists() || !self.folder.exists() {
            return Ok(());
        }
        for name in self.names().iter().filter(|name| has_run(name)) {
            if let Ok(package) = Package::open(&self.package_folder(name)) {
                let asks = package.manifest.permissions.asks();
                let rights = listed(&asks);
                tracing::info!(plugin = name, rights, "keeps the rights that it has used so far");
                self.note_rights(name, &asks)?;
            }
        }
        write(&mark, "Packages that ask for more than the least wait until a person allows it.\n")
    }

    /// Returns the rights that a new version of an installed package may use without new consent:
    /// the rights that were allowed. In a folder from versions without consent to rights, the
    /// rights that the installed version requests count as allowed.
    pub fn kept_rights(&self, name: &str) -> Vec<Right> {
        let mut kept = self.allowed(name);
        if !self.folder.join(ASKED).exists()
            && let Ok(package) = Package::open(&self.package_folder(name))
        {
            kept.extend(package.manifest.permissions.asks());
        }
        kept
    }

    /// Installs a package. An installed package of the same name is replaced, and kept as
    /// `.NAME.before` for a rollback. `allowed` are the rights that a person allows with this call.
    ///
    /// # Errors
    ///
    /// Returns an error if the package has mistakes, asks for rights that were not allowed, or
    /// cannot be copied.
    pub fn add(
        &self,
        from: &Path,
        allowed: &[Right],
    ) -> Result<PackageManifest, PackageStoreError> {
        let package =
            Package::open(from).map_err(|faults| PackageStoreError::Faulty(Box::new(faults)))?;
        let name = package.manifest.name.clone();
        self.make()?;
        let asks = package.manifest.permissions.asks();
        let known = [self.kept_rights(&name).as_slice(), allowed].concat();
        let beyond = package.manifest.permissions.beyond(&known);
        if !beyond.is_empty() {
            return Err(PackageStoreError::NotAllowed { name, asks: beyond });
        }
        let (new, before) = (self.aside(&name, "new"), self.aside(&name, "before"));
        self.clear(&new)?;
        copy(from, &new)?;
        let place = self.package_folder(&name);
        // The rights are written before the package is in place, so that a daemon that reads the
        // folder meanwhile finds them.
        self.note_rights(&name, &asks)?;
        if place.exists() {
            self.clear(&before)?;
            fs::rename(&place, &before).map_err(|source| failed("put aside", &place, source))?;
        }
        fs::rename(&new, &place).map_err(|source| failed("put in place", &place, source))?;
        Ok(package.manifest)
    }

    /// Removes a package, together with its earlier versions, rights and marker files.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no package of this name, or it cannot be removed.
    pub fn remove(&self, name: &str) -> Result<(), PackageStoreError> {
        self.known(name)?;
        // One rename hides the package, so that a daemon never reads a package that is half
        // removed.
        let gone = self.aside(name, "removed");
        self.clear(&gone)?;
        let place = self.package_folder(name);
        fs::rename(&place, &gone).map_err(|source| failed("remove", &place, source))?;
        for what in ["removed", "before", "failed", "disabled", "rights"] {
            self.clear(&self.aside(name, what))?;
        }
        Ok(())
    }

    /// Restores the version of a package from before the last upgrade. Returns `false` if no such
    /// version is kept.
    pub(crate) fn roll_back(&self, name: &str) -> Result<bool, PackageStoreError> {
        let (place, before) = (self.package_folder(name), self.aside(name, "before"));
        if !before.exists() {
            return Ok(false);
        }
        let failed_one = self.aside(name, "failed");
        self.clear(&failed_one)?;
        fs::rename(&place, &failed_one).map_err(|source| failed("put aside", &place, source))?;
        fs::rename(&before, &place).map_err(|source| failed("put back", &before, source))?;
        Ok(true)
    }

    /// Removes the version of a package from before the last upgrade, because the new version
    /// works. Afterwards the package cannot be rolled back.
    pub(crate) fn discard_previous(&self, name: &str) {
        // A version that cannot be removed does no harm.
        let _ = self.clear(&self.aside(name, "before"));
    }

    fn known(&self, name: &str) -> Result<(), PackageStoreError> {
        let is_known =
            !name.is_empty() && !name.contains('/') && self.package_folder(name).is_dir();
        let unknown =
            || PackageStoreError::Unknown { name: name.to_owned(), folder: self.folder.clone() };
        is_known.then_some(()).ok_or_else(unknown)
    }

    fn clear(&self, path: &Path) -> Result<(), PackageStoreError> {
        let removed = match fs::symlink_metadata(path) {
            Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
            Ok(_) => fs::remove_file(path),
            Err(_) => Ok(()),
        };
        removed.map_err(|source| failed("remove", path, source))
    }
}

fn failed(doing: &'static str, path: &Path, source: io::Error) -> PackageStoreError {
    PackageStoreError::Io { doing, path: path.to_owned(), source }
}

/// Writes a file that only this user can read, regardless of the umask.
fn write(file: &Path, text: &str) -> Result<(), PackageStoreError> {
    let opened = OpenOptions::new().create(true).truncate(true).write(true).mode(0o600).open(file);
    let written = opened.and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|source| failed("write", file, source))
}

fn others_cannot_write(path: &Path) -> Result<(), PackageStoreError> {
    let Ok(metadata) = fs::symlink_metadata(path) else { return Ok(()) };
    // A link has no mode of its own, and its target is not part of the package.
    if metadata.is_symlink() {
        return Ok(());
    }
    let shown = path.display();
    let own = rustix::process::geteuid().as_raw();
    let (who, cure) = match metadata.mode() & OTHERS_WRITE {
        0 if metadata.uid() == own || metadata.uid() == 0 => return Ok(()),
        0 => ("another user owns it and", format!("chown -R {own} {shown}")),
        _ => ("other users", format!("chmod -R go-w {shown}")),
    };
    Err(PackageStoreError::Writable { path: path.to_owned(), who, cure })
}

/// Copies a folder with all its contents; links are copied as links. Only this user can write to
/// the copy.
fn copy(from: &Path, to: &Path) -> Result<(), PackageStoreError> {
    let made = DirBuilder::new().mode(FOLDER_MODE).create(to);
    made.map_err(|source| failed("make", to, source))?;
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
            let mode = metadata.mode() & MODE & !OTHERS_WRITE & 0o777;
            fs::copy(&path, &to)
                .and_then(|_| fs::set_permissions(&to, Permissions::from_mode(mode)))
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
            format!("name = \"lamp\"\nversion = \"{version}\"\nprotocol = \"2\"\nrun = [\"sh\"]\n");
        fs::write(path.join("plugin.toml"), text).expect("a file");
        path
    }

    fn version(package_store: &PackageStore) -> String {
        Package::open(&package_store.package_folder("lamp")).expect("it is whole").manifest.version
    }

    #[test]
    fn packages_are_added_upgraded_rolled_back_and_removed() {
        let (source, place) =
            (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        let package_store = PackageStore { folder: place.path().join("plugins") };
        assert!(package_store.names().is_empty(), "the folder is not there yet");
        package_store.add(&package(source.path(), "1.0"), &[]).expect("added");
        assert_eq!(
            (package_store.names(), version(&package_store)),
            (vec!["lamp".to_owned()], "1.0".to_owned())
        );
        package_store.add(&package(source.path(), "2.0"), &[]).expect("upgraded");
        assert_eq!(version(&package_store), "2.0");
        assert!(package_store.roll_back("lamp").expect("renamed"));
        assert_eq!(version(&package_store), "1.0");
        assert!(
            !package_store.roll_back("lamp").expect("nothing"),
            "there is no way back from here"
        );
        package_store.set_disabled("lamp", true).expect("written");
        assert!(package_store.is_disabled("lamp"));
        package_store.set_disabled("lamp", false).expect("removed");
        assert!(!package_store.is_disabled("lamp"));
        package_store.remove("lamp").expect("removed");
        let left = fs::read_dir(&package_store.folder).expect("a folder").count();
        assert_eq!((package_store.names().len(), left), (0, 0));
        let error = package_store.remove("lamp").expect_err("it is gone");
        assert!(error.to_string().starts_with("find a plugin `lamp` in "), "{error}");
    }

    fn asking(folder: &Path, permissions: &str) -> PathBuf {
        let path = package(folder, "1.0");
        let manifest = path.join("plugin.toml");
        let text = fs::read_to_string(&manifest).expect("a file");
        fs::write(manifest, format!("{text}[permissions]\n{permissions}\n")).expect("a file");
        path
    }

    #[test]
    fn extra_rights_need_consent_and_are_kept_until_they_grow() {
        let source = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore { folder: source.path().join("plugins") };
        let path = asking(source.path(), "network = true\ndevices = [\"/dev/i2c-1\"]");
        let error = package_store.add(&path, &[Right::Network]).expect_err("half of it");
        assert!(error.to_string().contains("devices=/dev/i2c-1: that is not allowed"), "{error}");
        assert!(package_store.names().is_empty());
        let device = Right::Device("/dev/i2c-1".into());
        package_store.add(&path, &[Right::Network, device.clone()]).expect("all of it");
        package_store.add(&path, &[]).expect("it asks for no more than before");
        let path = asking(source.path(), "network = true\nmemory = \"1GiB\"");
        let error = package_store.add(&path, &[]).expect_err("it has grown");
        assert!(error.to_string().contains("use memory=1GiB"), "{error}");
        package_store.allow("lamp", &[Right::Memory(1 << 30)]).expect("written");
        package_store.add(&path, &[]).expect("it was allowed before");
        package_store.remove("lamp").expect("removed");
        assert_eq!(package_store.allowed("lamp"), []);
    }

    #[test]
    fn packages_from_before_consent_was_required_keep_their_rights() {
        let place = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore { folder: place.path().to_owned() };
        asking(place.path(), "network = true");
        package_store.allow_rights_in_use(|_| false).expect("written");
        assert_eq!(package_store.allowed("lamp"), [], "it was copied by hand");
        package_store.allow_rights_in_use(|_| true).expect("not again");
        assert_eq!(package_store.allowed("lamp"), []);
        fs::remove_file(place.path().join(ASKED)).expect("ours");
        assert_eq!(package_store.kept_rights("lamp"), [Right::Network]);
        package_store.allow_rights_in_use(|name| name == "lamp").expect("written");
        assert_eq!(package_store.allowed("lamp"), [Right::Network]);
    }

    /// Sets the modes of files explicitly, because changing the umask would affect the whole test
    /// process.
    #[test]
    fn files_are_writable_by_this_user_only_and_others_are_refused() {
        let source = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore { folder: source.path().join("plugins") };
        let path = package(source.path(), "1.0");
        fs::write(path.join("agent"), "").expect("a file");
        let open = |path: &Path| {
            fs::set_permissions(path, Permissions::from_mode(0o777)).expect("our own");
        };
        open(&path);
        open(&path.join("agent"));
        package_store.add(&path, &[]).expect("added");
        let mode = |path: PathBuf| fs::symlink_metadata(path).expect("there").mode() & 0o777;
        let modes = [
            package_store.folder.clone(),
            package_store.package_folder("lamp"),
            package_store.package_folder("lamp").join("agent"),
        ]
        .map(mode);
        assert_eq!(modes, [0o700, 0o700, 0o755]);
        assert_eq!(mode(package_store.aside("lamp", "rights")), 0o600);
        package_store.check_writers_of("lamp").expect("nobody");
        open(&package_store.package_folder("lamp").join("agent"));
        let error = package_store.check_writers_of("lamp").expect_err("anybody").to_string();
        assert!(error.contains("chmod -R go-w ") && error.contains("agent"), "{error}");
        open(&package_store.folder);
        let error = package_store.add(&path, &[]).expect_err("anybody").to_string();
        assert!(error.contains("plugins: other users can write to it"), "{error}");
    }

    #[test]
    fn a_package_with_a_mistake_is_not_added() {
        let source = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore { folder: source.path().join("plugins") };
        let path = package(source.path(), "");
        let error = package_store.add(&path, &[]).expect_err("no version");
        assert!(error.to_string().contains("plugin.toml:2:11: the version is empty"), "{error}");
        assert!(package_store.names().is_empty());
    }
}
