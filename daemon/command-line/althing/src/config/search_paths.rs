//! The places where ecosystem files and keys are searched for if the user names none.

use std::path::{Path, PathBuf};

use rustix::process::geteuid;

/// Folder of the state of the packaged daemon.
const PACKAGED_STATE: &str = "/var/lib/althing";

/// File name of an ecosystem file that is used if the user names no file.
const FILE: &str = "althing.toml";

/// Returns the ecosystem file to use if the user names none: `./althing.toml`, otherwise
/// `althing.toml` in the user's or the system's configuration folder; `None` if there is none.
pub(crate) fn find_ecosystem_file() -> Option<PathBuf> {
    let mut places = vec![PathBuf::from(FILE)];
    places.extend(configuration_folders().into_iter().map(|folder| folder.join(FILE)));
    places.into_iter().find(|path| path.is_file())
}

/// Returns the path of an ecosystem file. The user gives the path itself or the name of the
/// ecosystem, as in `--ecosystem`.
///
/// A name stands for a file `NAME.toml` in the current folder, in `ecosystems/` below it, or in a
/// configuration folder. The error text completes the sentence “failed to …” and lists the folders
/// that were searched.
pub(crate) fn resolve_ecosystem(file_or_name: &str) -> Result<PathBuf, String> {
    let given = PathBuf::from(file_or_name);
    if given.is_file() {
        return Ok(given);
    }
    if acl::EcosystemId::new(file_or_name).is_err() {
        return Err(format!("read `{file_or_name}`: there is no such file"));
    }
    let mut folders = vec![PathBuf::from("."), PathBuf::from("ecosystems")];
    folders.extend(configuration_folders());
    let file = format!("{file_or_name}.toml");
    let found = folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file());
    found.ok_or_else(|| {
        let folders: Vec<String> =
            folders.iter().map(|folder| folder.display().to_string()).collect();
        format!("find an ecosystem called `{file_or_name}`: no `{file}` in {}", folders.join(", "))
    })
}

/// Returns the folder of an ecosystem's keys and certificates if the ecosystem file names none.
/// This is `keys/NAME` in the first configuration folder that contains it. If none contains it yet,
/// it is `keys/NAME` in the user's configuration folder; for root on a machine with the packaged
/// daemon, in the system's.
pub(crate) fn credentials_folder(ecosystem: &acl::EcosystemId) -> PathBuf {
    let folders = configuration_folders();
    let folders: Vec<_> =
        folders.iter().map(|folder| folder.join("keys").join(ecosystem.as_str())).collect();
    let found = folders.iter().find(|folder| folder.join("authority.pem").is_file());
    let first = if is_packaged() { folders.last() } else { folders.first() };
    found.or(first).cloned().unwrap_or_else(|| PathBuf::from("keys"))
}

/// Whether root runs this process on a machine with the packaged daemon, whose configuration is the
/// system's.
fn is_packaged() -> bool {
    geteuid().is_root() && Path::new(PACKAGED_STATE).is_dir()
}

/// Returns the configuration folders: the user's first, then the system's.
fn configuration_folders() -> Vec<PathBuf> {
    let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty());
    let home = || Some(Path::new(&variable("HOME")?).join(".config"));
    let user = variable("XDG_CONFIG_HOME").map(PathBuf::from).or_else(home);
    let system = Some(PathBuf::from("/etc"));
    [user, system].into_iter().flatten().map(|folder| folder.join("althing")).collect()
}
