//! Checks of the folders that a daemon uses on this machine, and of the space that is left there.
//! Nothing is created.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use acl::{DaemonId, EcosystemId};
use plugin_host::Package;
use rustix::fs::{Access, access, statvfs};
use rustix::process::geteuid;

use super::finding::{CheckFinding, CheckVerdict, DoctorCheck, Remedy, names, size};
use crate::commands::client::shell_word;
use crate::hosting;

/// The permission bits with which other users could write in a folder.
const OTHERS_WRITE: u32 = 0o022;

/// Space below which a folder of state is a problem, and below which it is a note. Journals and
/// ledgers of a building need some tens of megabytes.
const SPACE_PROBLEM: u64 = 32 << 20;
const SPACE_NOTE: u64 = 512 << 20;

/// Mistake of a folder, and the command that mends it.
struct FolderMistake {
    text: String,
    remedy: Option<Remedy>,
}

/// Checks the folder of the daemons' sockets.
pub(super) fn runtime(name: Option<&EcosystemId>, daemon: Option<&DaemonId>) -> Vec<CheckFinding> {
    let check = DoctorCheck::RuntimeFolder;
    let base = hosting::runtime_base();
    let own = name.map(|name| base.join(name.as_str()));
    let all = [Some(&base), own.as_ref()].into_iter().flatten();
    let mut mistakes: Vec<_> = all.filter_map(|folder| mistake(folder, true)).collect();
    if let (Some(own), Some(daemon)) = (&own, daemon)
        && let Err(error) = hosting::socket_in(own, daemon.as_str())
    {
        let shorter = format!("export ALTHING_RUNTIME_DIR=/tmp/althing-{}", geteuid().as_raw());
        mistakes.push(FolderMistake {
            text: format!("failed to {error}"),
            remedy: Remedy::mend(shorter),
        });
    }
    of_mistakes(check, mistakes, || existing(&base, "daemons make it, for you alone"))
}

/// Checks the folder in which a daemon's agents store what must survive a restart.
pub(super) fn state(name: Option<&EcosystemId>, daemon: Option<&DaemonId>) -> Vec<CheckFinding> {
    let base = hosting::state_base();
    let ecosystem = name.map(|name| base.join(name.as_str()));
    let own = ecosystem.as_ref().zip(daemon).map(|(folder, daemon)| folder.join(daemon.as_str()));
    let all = [Some(&base), ecosystem.as_ref(), own.as_ref()].into_iter().flatten();
    let mut mistakes: Vec<_> = all.filter_map(|folder| mistake(folder, false)).collect();
    if let Some(Err(error)) = own.as_deref().map(hosting::check_state) {
        let remedy = Remedy::look("althing restore --help");
        mistakes.push(FolderMistake { text: format!("failed to {error}"), remedy });
    }
    of_mistakes(DoctorCheck::StateFolder, mistakes, || existing(&base, "daemons make it"))
}

/// Checks the folder of plugins, and reads the packages in it.
pub(super) fn plugins(said: Option<&Path>) -> Vec<CheckFinding> {
    let check = DoctorCheck::PluginsFolder;
    let folder = hosting::plugins_folder(said);
    if !folder.exists() {
        return vec![
            check.ok(format!("{} does not exist: there are no plugins", folder.display())),
        ];
    }
    let store = hosting::packages_in(folder.clone());
    let mut mistakes: Vec<_> = mistake(&folder, false).into_iter().collect();
    if let Err(error) = store.check_writers() {
        let word = shell_word(&folder.to_string_lossy());
        mistakes.push(FolderMistake {
            text: format!("failed to {error}"),
            remedy: Remedy::mend(format!("chmod go-w {word}")),
        });
    }
    let packages = store.names();
    for name in &packages {
        let package = store.package_folder(name);
        if let Err(faults) = Package::open(&package) {
            let word = shell_word(&package.to_string_lossy());
            mistakes.push(FolderMistake {
                text: format!("the package `{name}` has mistakes: {}", faults.first()),
                remedy: Remedy::look(format!("althing plugin check {word}")),
            });
        }
    }
    of_mistakes(check, mistakes, || match packages.as_slice() {
        [] => format!("{}: no plugins", folder.display()),
        some => format!("{}: {}", folder.display(), names(some)),
    })
}

/// Checks the space on the disks of these folders.
pub(super) fn disk() -> Vec<CheckFinding> {
    let check = DoctorCheck::Disk;
    let (state, runtime) = (hosting::state_base(), hosting::runtime_base());
    let look = |folder: &Path| {
        let there = existing_part(folder);
        let word = shell_word(&there.to_string_lossy());
        match space(there) {
            Ok((bytes, files)) => {
                let text = format!("{} free for {}", size(bytes), folder.display());
                match space_verdict(bytes, files) {
                    CheckVerdict::Ok => check.ok(text),
                    CheckVerdict::Note => check.note(text, Remedy::look(format!("df -h {word}"))),
                    CheckVerdict::Problem if files == Some(0) => {
                        let text = format!("no file can be created in {}", folder.display());
                        check.problem(text, Remedy::look(format!("df -i {word}")))
                    }
                    CheckVerdict::Problem => {
                        let text = format!("only {text}: goals, plans and ledgers are lost");
                        check.problem(text, Remedy::look(format!("df -h {word}")))
                    }
                }
            }
            Err(error) => check.note(format!("{}: {error}", there.display()), None),
        }
    };
    let state_finding = look(&state);
    // The sockets are a few files without content, so only the number of files matters.
    let sockets = space(existing_part(&runtime)).ok().filter(|(_, files)| *files == Some(0));
    let full = sockets.map(|_| look(&runtime));
    [Some(state_finding), full].into_iter().flatten().collect()
}

/// Returns the free bytes of the file system of a folder, and the number of files that can still be
/// created; `None` if the file system has no such limit.
fn space(folder: &Path) -> io::Result<(u64, Option<u64>)> {
    let about = statvfs(folder)?;
    let files = (about.f_files > 0).then_some(about.f_favail);
    Ok((about.f_bavail.saturating_mul(about.f_frsize), files))
}

fn space_verdict(bytes: u64, files: Option<u64>) -> CheckVerdict {
    match bytes {
        _ if files == Some(0) => CheckVerdict::Problem,
        0..SPACE_PROBLEM => CheckVerdict::Problem,
        SPACE_PROBLEM..SPACE_NOTE => CheckVerdict::Note,
        _ => CheckVerdict::Ok,
    }
}

fn of_mistakes(
    check: DoctorCheck,
    mistakes: Vec<FolderMistake>,
    ok: impl FnOnce() -> String,
) -> Vec<CheckFinding> {
    if mistakes.is_empty() {
        return vec![check.ok(ok())];
    }
    let problem = |FolderMistake { text, remedy }| check.problem(text, remedy);
    mistakes.into_iter().map(problem).collect()
}

fn existing(folder: &Path, otherwise: &str) -> String {
    match folder.is_dir() {
        true => folder.display().to_string(),
        false => format!("{} does not exist yet: {otherwise}", folder.display()),
    }
}

/// Returns the nearest folder that exists: the folder itself, or one above it.
fn existing_part(folder: &Path) -> &Path {
    folder.ancestors().find(|part| part.exists()).unwrap_or(Path::new("/"))
}

/// Returns the mistake of a folder; `None` if a daemon of this user can use or make it. With
/// `is_private`, no other user may write in it, because that user could impersonate a daemon.
fn mistake(folder: &Path, is_private: bool) -> Option<FolderMistake> {
    let word = shell_word(&folder.to_string_lossy());
    let said = |text: String, remedy| Some(FolderMistake { text, remedy });
    let about = match fs::metadata(folder) {
        Ok(about) => about,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let above = existing_part(folder);
            if access(above, Access::WRITE_OK | Access::EXEC_OK).is_ok() && above.is_dir() {
                return None;
            }
            let text = format!("{} does not exist, and cannot be made", folder.display());
            let made = format!("sudo install -d -m 700 -o \"$(id -un)\" {word}");
            return said(text, Remedy::mend(made));
        }
        Err(error) => return said(format!("{}: {error}", folder.display()), None),
    };
    if !about.is_dir() {
        let text = format!("{} is a file, and must be a folder", folder.display());
        return said(text, Remedy::mend(format!("mv {word} {word}.before")));
    }
    let user = geteuid().as_raw();
    if is_private && about.uid() != user && !hosting::is_for_root(folder) {
        let text = format!("{} belongs to another user ({})", folder.display(), about.uid());
        return said(text, Remedy::mend(format!("sudo chown -R \"$(id -un)\" {word}")));
    }
    if is_private && about.mode() & OTHERS_WRITE != 0 {
        let mode = about.mode() & 0o777;
        let text = format!("other users can write in {} (mode {mode:o})", folder.display());
        return said(text, Remedy::mend(format!("chmod 700 {word}")));
    }
    if let Err(error) = access(folder, Access::WRITE_OK | Access::EXEC_OK) {
        let text = format!("{} cannot be written: {error}", folder.display());
        let own = about.uid() == user;
        let mend = match own {
            true => format!("chmod u+rwx {word}"),
            false => format!("sudo chown -R \"$(id -un)\" {word}"),
        };
        // Permissions do not help on a file system that is read-only.
        let is_permission = error == rustix::io::Errno::ACCESS;
        return said(text, is_permission.then_some(Remedy::Mend(mend)));
    }
    None
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_folder_that_others_can_write_is_mended_by_its_command() {
        let outer = tempfile::tempdir().expect("a folder");
        let folder = outer.path().join("run");
        assert!(mistake(&folder, true).is_none(), "it can be made");
        fs::create_dir(&folder).expect("it can be made");
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o777)).expect("ours");
        let found = mistake(&folder, true).expect("others can write");
        assert!(found.text.contains("mode 777"), "{}", found.text);
        let Some(Remedy::Mend(command)) = found.remedy else { panic!("a command") };
        let ran = std::process::Command::new("sh").args(["-c", &command]).status();
        assert!(ran.expect("sh is there").success());
        assert!(mistake(&folder, true).is_none(), "mended");
    }

    #[test]
    fn a_file_in_place_of_a_folder_is_put_aside() {
        let outer = tempfile::tempdir().expect("a folder");
        let file = outer.path().join("a state");
        fs::write(&file, "").expect("a file");
        let found = mistake(&file, false).expect("no folder");
        let Some(Remedy::Mend(command)) = found.remedy else { panic!("a command") };
        let ran = std::process::Command::new("sh").args(["-c", &command]).status();
        assert!(ran.expect("sh is there").success());
        assert!(mistake(&file, false).is_none(), "mended");
    }

    #[test]
    fn little_space_is_a_note_and_then_a_problem() {
        assert_eq!(space_verdict(1 << 40, None), CheckVerdict::Ok);
        assert_eq!(space_verdict(100 << 20, Some(7)), CheckVerdict::Note);
        assert_eq!(space_verdict(1 << 20, Some(7)), CheckVerdict::Problem);
        assert_eq!(space_verdict(1 << 40, Some(0)), CheckVerdict::Problem);
    }
}
