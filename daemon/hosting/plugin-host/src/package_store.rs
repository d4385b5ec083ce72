//! The plugin folder of a machine: one folder per package, and marker files with the decisions of
//! people.
//!
//! Every change of a package is one rename in that folder, so that a daemon that reads the folder at
//! any moment, and a machine that loses its power, has either the old or the new state. On a file
//! system that cannot exchange two folders at once, a change takes several renames; one that breaks
//! off is undone when a daemon starts. Files and folders with a name that begins with a dot are not
//! packages:
//!
//! - `.NAME.disabled`: the package is disabled.
//! - `.NAME.rights`: the rights that a person has allowed the package, one in a line.
//! - `.NAME.before`: the last version of the package that was ready, until a later one is.
//! - `.NAME.failed`: the version of the package that was rolled back.
//! - `.NAME.new`, `.NAME.removed`: a version that is being copied, or removed.
//! - `.NAME.swap`: a version in the middle of an exchange by several renames.
//!
//! A user that can write to the folder controls which programs run here. Therefore the folder and
//! everything in it is created with access for one user alone, regardless of the umask: this user,
//! or the [`FolderOwner`]. A folder that others can write to is refused.

use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use crate::manifest::PackageManifest;
use crate::package::{Package, PackageFaults, Stamp, stamp};
use crate::placing::{
    CopyFailure, FOLDER_MODE, FolderLock, FolderOwner, OTHERS_WRITE, copy, exchange, give,
    sync_all_in, sync_names_in, write,
};
use crate::rights::{Right, listed};

/// Largest number of packages on one machine; further packages are ignored.
const PACKAGES_MAX: usize = 256;

/// Name of the marker file which states that rights need a person's consent in this plugin folder.
/// A daemon writes the file when it first checks the folder. Packages that ran there before keep
/// the rights that they used.
const ASKED: &str = ".rights-are-asked";

/// The plugin folder of this machine, with its packages and marker files.
#[derive(Clone, Debug)]
pub struct PackageStore {
    /// Path of the plugin folder.
    pub folder: PathBuf,
    /// Owner of the folder and of what is made in it; `None` for this user.
    owner: Option<FolderOwner>,
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
    #[error("use {}: {writers} can write to it, and could run anything here: {cure}", path.display())]
    Writable {
        /// The plugin folder, or a file or folder in it, that other users can change.
        path: PathBuf,
        /// Description of the users that can write to the path, for the message.
        writers: &'static str,
        /// Description of how a person corrects that, for the message.
        cure: String,
    },
    /// This user may not read which rights a package was allowed.
    #[error(
        "read the rights that were allowed in {}: {source}; give the file to the user of the \
         daemon: sudo chown {user} {}",
        path.display(),
        path.display()
    )]
    Unreadable {
        /// The file with the rights.
        path: PathBuf,
        /// Number of this user.
        user: u32,
        /// Error of the system.
        #[source]
        source: io::Error,
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
    /// Returns the plugin folder at this path, which belongs to this user.
    pub fn new(folder: PathBuf) -> PackageStore {
        PackageStore { folder, owner: None }
    }

    /// Returns this plugin folder for a command that root runs, if `owner` is the user that runs
    /// the daemon. The folder and all that is made in it belong to that user.
    pub fn owned_by(self, owner: Option<FolderOwner>) -> PackageStore {
        PackageStore { owner, ..self }
    }

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
        self.write(&mark, "")?;
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
        if !self.folder.is_dir() {
            let made = folder.recursive(true).mode(FOLDER_MODE).create(&self.folder);
            let made = made.and_then(|()| give(&self.folder, self.owner));
            made.map_err(|source| failed("make", &self.folder, source))?;
        }
        self.check_writers()
    }

    /// Checks that only this user, root and the owner can change the plugin folder.
    ///
    /// # Errors
    ///
    /// Returns an error if another user owns the plugin folder or can write to it. A folder that
    /// does not exist is no error.
    pub fn check_writers(&self) -> Result<(), PackageStoreError> {
        self.others_cannot_write(&self.folder)
    }

    /// Checks that only this user, root and the owner can change the files of a package.
    ///
    /// # Errors
    ///
    /// Returns an error about the first file or folder that another user owns or can write to.
    pub(crate) fn check_writers_of(&self, name: &str) -> Result<(), PackageStoreError> {
        self.others_cannot_write(&self.package_folder(name))?;
        let mut folders = vec![self.package_folder(name)];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                self.others_cannot_write(&entry.path())?;
                if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                    folders.push(entry.path());
                }
            }
        }
        Ok(())
    }

    /// Returns the rights that a person has allowed to a package.
    ///
    /// # Errors
    ///
    /// Returns an error if the file with the rights is there and cannot be read.
    pub fn allowed(&self, name: &str) -> Result<Vec<Right>, PackageStoreError> {
        let path = self.aside(name, "rights");
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(source) if source.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(source) if source.kind() == io::ErrorKind::PermissionDenied => {
                let user = rustix::process::geteuid().as_raw();
                return Err(PackageStoreError::Unreadable { path, user, source });
            }
            Err(source) => return Err(failed("read", &path, source)),
        };
        // A line that is not a valid right is ignored.
        let text = String::from_utf8_lossy(&text);
        Ok(text.lines().filter_map(|line| line.trim().parse().ok()).collect())
    }

    /// Adds to the rights that a person has allowed to a package.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no package of this name, or the plugin folder cannot be
    /// written.
    pub fn allow(&self, name: &str, rights: &[Right]) -> Result<(), PackageStoreError> {
        self.known(name)?;
        let _lock = self.lock()?;
        self.note_rights(name, rights)
    }

    fn note_rights(&self, name: &str, rights: &[Right]) -> Result<(), PackageStoreError> {
        let mut all = self.allowed(name)?;
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
        self.write(&new, &text)?;
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
        self.write(
            &mark,
            "Packages that ask for more than the least wait until a person allows it.\n",
        )
    }

    /// Returns the rights that a new version of an installed package may use without new consent:
    /// the rights that were allowed. In a folder from versions without consent to rights, the
    /// rights that the installed version requests count as allowed.
    ///
    /// # Errors
    ///
    /// Returns an error if the file with the rights is there and cannot be read.
    pub fn kept_rights(&self, name: &str) -> Result<Vec<Right>, PackageStoreError> {
        let mut kept = self.allowed(name)?;
        if !self.folder.join(ASKED).exists()
            && let Ok(package) = Package::open(&self.package_folder(name))
        {
            kept.extend(package.manifest.permissions.asks());
        }
        Ok(kept)
    }

    /// Installs a package. An installed package of the same name is replaced, and kept as
    /// `.NAME.before` for a rollback; if it was never ready, the version before it is kept instead.
    /// `allowed` are the rights that a person allows with this call.
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
        let known = [self.kept_rights(&name)?.as_slice(), allowed].concat();
        let beyond = package.manifest.permissions.beyond(&known);
        if !beyond.is_empty() {
            return Err(PackageStoreError::NotAllowed { name, asks: beyond });
        }
        let _lock = self.lock()?;
        self.settle(&name)?;
        let new = self.aside(&name, "new");
        self.clear(&new)?;
        let copied = copy(from, &new, self.owner);
        copied.map_err(|CopyFailure { doing, path, source }| failed(doing, &path, source))?;
        // The files are on disk before the name of the package leads to them.
        sync_all_in(&new).map_err(|source| failed("write", &new, source))?;
        // The rights are written before the package is in place, so that a daemon that reads the
        // folder meanwhile finds them.
        self.note_rights(&name, &asks)?;
        self.put_in_place(&name, &new)?;
        Ok(package.manifest)
    }

    /// Puts the folder `new` in the place of a package. A replaced version that was ready becomes
    /// the version for a rollback.
    fn put_in_place(&self, name: &str, new: &Path) -> Result<(), PackageStoreError> {
        let (place, before) = (self.package_folder(name), self.aside(name, "before"));
        let refused = |source| failed("put in place", &place, source);
        if place.exists() {
            exchange(new, &place, &self.aside(name, "swap")).map_err(refused)?;
            // A version that is ready discards the one before it. So if that is still there, it is
            // the last one that worked, and the replaced one is not.
            match before.exists() {
                true => self.discard(name, new)?,
                false => fs::rename(new, &before).map_err(|error| failed("keep", new, error))?,
            }
        } else {
            // What a package left that a person has removed from the folder by hand.
            self.discard(name, &before)?;
            fs::rename(new, &place).map_err(refused)?;
        }
        sync_names_in(&self.folder).map_err(|source| failed("write", &self.folder, source))
    }

    /// Removes a package, together with its earlier versions, rights and marker files.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no package of this name, or it cannot be removed.
    pub fn remove(&self, name: &str) -> Result<(), PackageStoreError> {
        self.known(name)?;
        let _lock = self.lock()?;
        // One rename hides the package, so that a daemon never reads a package that is half
        // removed.
        self.discard(name, &self.package_folder(name))?;
        for what in ["before", "failed", "new", "swap", "disabled", "rights"] {
            self.clear(&self.aside(name, what))?;
        }
        Ok(())
    }

    /// Restores the version of a package from before the last upgrade, if the package is still the
    /// one that failed. Returns the stamp of the restored version; `None` if no such version is
    /// kept, or if the package was changed meanwhile.
    pub(crate) fn roll_back(
        &self,
        name: &str,
        failed_version: &Stamp,
    ) -> Result<Option<Stamp>, PackageStoreError> {
        // A command that holds the lock is putting in place another version.
        let Some(_lock) = self.lock_at_once()? else { return Ok(None) };
        let (place, before) = (self.package_folder(name), self.aside(name, "before"));
        if !before.exists() || stamp(&place) != *failed_version {
            return Ok(None);
        }
        let failed_one = self.aside(name, "failed");
        self.clear(&failed_one)?;
        let exchanged = exchange(&before, &place, &self.aside(name, "swap"));
        exchanged.map_err(|source| failed("put back", &before, source))?;
        fs::rename(&before, &failed_one).map_err(|source| failed("put aside", &before, source))?;
        Ok(Some(stamp(&place)))
    }

    /// Removes the version of a package from before the last upgrade, because the version with the
    /// stamp `ready` works. Afterwards the package cannot be rolled back. Does nothing if the
    /// package was changed meanwhile.
    pub(crate) fn discard_previous(&self, name: &str, ready: &Stamp) {
        let before = self.aside(name, "before");
        if !before.exists() {
            return;
        }
        let Ok(Some(_lock)) = self.lock_at_once() else { return };
        if stamp(&self.package_folder(name)) == *ready {
            // A version that cannot be removed does no harm.
            let _ = self.discard(name, &before);
        }
    }

    /// Puts back the packages that are missing because an exchange has broken off.
    pub(crate) fn put_back_missing(&self) -> Result<(), PackageStoreError> {
        let Ok(entries) = fs::read_dir(&self.folder) else { return Ok(()) };
        // A command that holds the lock is in the middle of its exchange.
        let Some(_lock) = self.lock_at_once()? else { return Ok(()) };
        let files = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        for file in files {
            let name = file.strip_prefix('.').and_then(|name| name.strip_suffix(".swap"));
            name.map_or(Ok(()), |name| self.settle(name))?;
        }
        Ok(())
    }

    /// Ends an exchange of a package that has broken off. The caller holds the lock.
    fn settle(&self, name: &str) -> Result<(), PackageStoreError> {
        let (place, swap) = (self.package_folder(name), self.aside(name, "swap"));
        match (place.exists(), swap.exists()) {
            (_, false) => Ok(()),
            (true, true) => self.discard(name, &swap),
            (false, true) => {
                fs::rename(&swap, &place).map_err(|source| failed("put back", &swap, source))
            }
        }
    }

    fn lock(&self) -> Result<FolderLock, PackageStoreError> {
        FolderLock::wait(&self.folder).map_err(|source| failed("lock", &self.folder, source))
    }

    fn lock_at_once(&self) -> Result<Option<FolderLock>, PackageStoreError> {
        FolderLock::at_once(&self.folder).map_err(|source| failed("lock", &self.folder, source))
    }

    fn known(&self, name: &str) -> Result<(), PackageStoreError> {
        let is_known =
            !name.is_empty() && !name.contains('/') && self.package_folder(name).is_dir();
        let unknown =
            || PackageStoreError::Unknown { name: name.to_owned(), folder: self.folder.clone() };
        is_known.then_some(()).ok_or_else(unknown)
    }

    /// Removes a version of a package. One rename hides it first, so that no version is ever half
    /// removed.
    fn discard(&self, name: &str, version: &Path) -> Result<(), PackageStoreError> {
        let removed = self.aside(name, "removed");
        self.clear(&removed)?;
        match fs::rename(version, &removed) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            Err(source) => Err(failed("remove", version, source)),
            Ok(()) => self.clear(&removed),
        }
    }

    fn clear(&self, path: &Path) -> Result<(), PackageStoreError> {
        let removed = match fs::symlink_metadata(path) {
            Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
            Ok(_) => fs::remove_file(path),
            Err(_) => Ok(()),
        };
        removed.map_err(|source| failed("remove", path, source))
    }

    fn write(&self, file: &Path, text: &str) -> Result<(), PackageStoreError> {
        write(file, text, self.owner).map_err(|source| failed("write", file, source))
    }

    /// Checks that this user, root and the owner alone can change a file or folder.
    fn others_cannot_write(&self, path: &Path) -> Result<(), PackageStoreError> {
        let Ok(metadata) = fs::symlink_metadata(path) else { return Ok(()) };
        // A link has no mode of its own, and its target is not part of the package.
        if metadata.is_symlink() {
            return Ok(());
        }
        let (shown, found) = (path.display(), metadata.uid());
        let own = rustix::process::geteuid().as_raw();
        let is_known = found == own || found == 0 || self.owner.is_some_and(|it| it.user == found);
        let (writers, cure) = match metadata.mode() & OTHERS_WRITE {
            0 if is_known => return Ok(()),
            // The daemon of that user could not use a folder that belongs to root.
            0 if own == 0 && path == self.folder => {
                let cure = format!("run althing as that user, with sudo -u '#{found}'");
                ("another user owns it and", cure)
            }
            0 => {
                let cure = format!("chown -R {} {shown}", self.rightful_user(own));
                ("another user owns it and", cure)
            }
            _ => ("other users", format!("chmod -R go-w {shown}")),
        };
        Err(PackageStoreError::Writable { path: path.to_owned(), writers, cure })
    }

    /// Returns the number of the user that the packages should belong to.
    fn rightful_user(&self, own: u32) -> u32 {
        let of_folder = || fs::metadata(&self.folder).ok().map(|folder| folder.uid());
        let owner = self.owner.map(|owner| owner.user);
        owner.or_else(|| of_folder().filter(|_| own == 0)).unwrap_or(own)
    }
}

fn failed(doing: &'static str, path: &Path, source: io::Error) -> PackageStoreError {
    PackageStoreError::Io { doing, path: path.to_owned(), source }
}

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::placing::exchange_in_steps;

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

    fn roll_back(package_store: &PackageStore) -> Option<Stamp> {
        let failed = stamp(&package_store.package_folder("lamp"));
        package_store.roll_back("lamp", &failed).expect("renamed")
    }

    #[test]
    fn packages_are_added_upgraded_rolled_back_and_removed() {
        let (source, place) =
            (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        let package_store = PackageStore::new(place.path().join("plugins"));
        assert!(package_store.names().is_empty(), "the folder is not there yet");
        package_store.add(&package(source.path(), "1.0"), &[]).expect("added");
        assert_eq!(
            (package_store.names(), version(&package_store)),
            (vec!["lamp".to_owned()], "1.0".to_owned())
        );
        package_store.add(&package(source.path(), "2.0"), &[]).expect("upgraded");
        assert_eq!(version(&package_store), "2.0");
        let restored = roll_back(&package_store).expect("there is a way back");
        assert_eq!(version(&package_store), "1.0");
        assert_eq!(restored, stamp(&package_store.package_folder("lamp")));
        assert_eq!(roll_back(&package_store), None, "there is no way back from here");
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
        let package_store = PackageStore::new(source.path().join("plugins"));
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
        assert_eq!(package_store.allowed("lamp").expect("read"), []);
    }

    #[test]
    fn packages_from_before_consent_was_required_keep_their_rights() {
        let place = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(place.path().to_owned());
        asking(place.path(), "network = true");
        package_store.allow_rights_in_use(|_| false).expect("written");
        assert_eq!(package_store.allowed("lamp").expect("read"), [], "it was copied by hand");
        package_store.allow_rights_in_use(|_| true).expect("not again");
        assert_eq!(package_store.allowed("lamp").expect("read"), []);
        fs::remove_file(place.path().join(ASKED)).expect("ours");
        assert_eq!(package_store.kept_rights("lamp").expect("read"), [Right::Network]);
        package_store.allow_rights_in_use(|name| name == "lamp").expect("written");
        assert_eq!(package_store.allowed("lamp").expect("read"), [Right::Network]);
    }

    /// Sets the modes of files explicitly, because changing the umask would affect the whole test
    /// process.
    #[test]
    fn files_are_writable_by_this_user_only_and_others_are_refused() {
        let source = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(source.path().join("plugins"));
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
        let package_store = PackageStore::new(source.path().join("plugins"));
        let path = package(source.path(), "");
        let error = package_store.add(&path, &[]).expect_err("no version");
        assert!(error.to_string().contains("plugin.toml:2:11: the version is empty"), "{error}");
        assert!(package_store.names().is_empty());
    }

    #[test]
    fn a_rollback_restores_the_last_version_that_was_ready() {
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins"));
        let of_it = || stamp(&package_store.package_folder("lamp"));
        let add = |version| package_store.add(&package(folder.path(), version), &[]);
        add("1.0").expect("added");
        package_store.discard_previous("lamp", &of_it());
        add("2.0").expect("upgraded");
        let second = of_it();
        // 2.0 fails, and 3.0 comes before the daemon rolls 2.0 back.
        add("3.0").expect("upgraded again");
        assert_eq!(package_store.roll_back("lamp", &second).expect("nothing"), None);
        assert_eq!(version(&package_store), "3.0", "it has not failed");
        // 2.0 gets ready so late that it has been replaced.
        package_store.discard_previous("lamp", &second);
        assert!(roll_back(&package_store).is_some());
        assert_eq!(version(&package_store), "1.0", "2.0 was never ready");
        add("4.0").expect("upgraded");
        package_store.discard_previous("lamp", &of_it());
        assert_eq!(roll_back(&package_store), None, "4.0 works");
    }

    #[test]
    fn a_package_is_there_at_each_moment_of_its_upgrades() {
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins"));
        let from = package(folder.path(), "1.0");
        package_store.add(&from, &[]).expect("added");
        let (ends, misses) = (AtomicBool::new(false), std::sync::atomic::AtomicUsize::new(0));
        let place = package_store.package_folder("lamp");
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !ends.load(Ordering::Relaxed) {
                    if !place.exists() {
                        misses.fetch_add(1, Ordering::Relaxed);
                    }
                }
            });
            // An upgrade waits for the disk, and a rollback does not.
            for _ in 0..3 {
                package_store.add(&from, &[]).expect("upgraded");
            }
            let aside = |what| package_store.aside("lamp", what);
            for _ in 0..500 {
                roll_back(&package_store).expect("there is a way back");
                fs::rename(aside("failed"), aside("before")).expect("ours");
            }
            ends.store(true, Ordering::Relaxed);
        });
        assert_eq!(misses.into_inner(), 0);
    }

    #[test]
    fn an_exchange_in_steps_that_breaks_off_is_undone() {
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins"));
        package_store.add(&package(folder.path(), "1.0"), &[]).expect("added");
        let (place, swap) =
            (package_store.package_folder("lamp"), package_store.aside("lamp", "swap"));
        let next = package(folder.path(), "2.0");
        exchange_in_steps(&next, &place, &swap).expect("exchanged");
        assert_eq!(version(&package_store), "2.0");
        assert!(next.exists() && !swap.exists());
        let error = exchange_in_steps(&folder.path().join("none"), &place, &swap);
        assert_eq!(error.expect_err("it is not there").kind(), io::ErrorKind::NotFound);
        assert_eq!(version(&package_store), "2.0");
        // The process ends after the first rename.
        fs::rename(&place, &swap).expect("ours");
        assert!(package_store.names().is_empty());
        package_store.put_back_missing().expect("put back");
        assert_eq!(version(&package_store), "2.0");
        // The process ends after the second one.
        fs::create_dir(&swap).expect("ours");
        package_store.put_back_missing().expect("there is nothing to put back");
        assert!(package_store.package_folder("lamp").exists() && !swap.exists());
    }

    #[test]
    fn commands_that_change_the_folder_take_turns() {
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins"));
        package_store.add(&package(folder.path(), "1.0"), &[]).expect("added");
        package_store.add(&package(folder.path(), "2.0"), &[]).expect("upgraded");
        let lock = package_store.lock().expect("it is ours");
        assert_eq!(roll_back(&package_store), None, "another version may come");
        assert_eq!(version(&package_store), "2.0");
        drop(lock);
        assert!(roll_back(&package_store).is_some());
    }

    /// Only root can give files away.
    #[test]
    fn root_gives_what_it_makes_to_the_user_of_the_daemon() {
        const DAEMON: FolderOwner = FolderOwner { user: 4_711, group: 4_712 };
        if !rustix::process::geteuid().is_root() {
            eprintln!("NOT TESTED: giving files away, because this user is not root");
            return;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins")).owned_by(Some(DAEMON));
        let path = asking(folder.path(), "network = true");
        fs::create_dir(path.join("library")).expect("made");
        std::os::unix::fs::symlink("plugin.toml", path.join("link")).expect("linked");
        package_store.add(&path, &[Right::Network]).expect("added");
        package_store.allow("lamp", &[Right::Memory(1 << 30)]).expect("written");
        package_store.set_disabled("lamp", true).expect("written");
        let mut found = vec![package_store.folder.clone()];
        let mut next = 0;
        while let Some(path) = found.get(next).cloned() {
            let about = fs::symlink_metadata(&path).expect("it is there");
            assert_eq!((about.uid(), about.gid()), (DAEMON.user, DAEMON.group), "{path:?}");
            if about.is_dir() {
                found.extend(fs::read_dir(path).expect("a folder").flatten().map(|it| it.path()));
            }
            next += 1;
        }
        assert_eq!(found.len(), 7, "{found:?}");
        // Root accepts what belongs to that user, and no cure gives it to root.
        package_store.check_writers_of("lamp").expect("the daemon's own");
        package_store.add(&path, &[]).expect("added again");
        let strict = PackageStore::new(package_store.folder.clone());
        let error = strict.check_writers().expect_err("the folder of another").to_string();
        assert!(error.contains("sudo -u '#4711'") && !error.contains("chown"), "{error}");
        fs::remove_dir_all(package_store.package_folder("lamp").join("library")).expect("ours");
        fs::create_dir(package_store.package_folder("lamp").join("library")).expect("made");
        let foreign = package_store.package_folder("lamp").join("library");
        give(&foreign, Some(FolderOwner { user: 4_713, group: 4_713 })).expect("root may");
        let error = package_store.check_writers_of("lamp").expect_err("of another").to_string();
        assert!(error.contains("chown -R 4711 "), "{error}");
    }

    #[test]
    fn rights_that_cannot_be_read_are_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let package_store = PackageStore::new(folder.path().join("plugins"));
        package_store.add(&package(folder.path(), "1.0"), &[]).expect("added");
        let rights = package_store.aside("lamp", "rights");
        fs::remove_file(&rights).expect("ours");
        assert_eq!(package_store.allowed("lamp").expect("none were allowed"), []);
        // A folder cannot be read as a file, not even by root.
        fs::create_dir(&rights).expect("ours");
        let error = package_store.allowed("lamp").expect_err("it cannot be read").to_string();
        assert!(error.contains(".lamp.rights"), "{error}");
        package_store.allow("lamp", &[Right::Network]).expect_err("they would be lost");
    }
}
