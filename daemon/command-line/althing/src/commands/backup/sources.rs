//! The files that belong to an ecosystem on this machine.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Component, Path, PathBuf};

use ::backups::{BackupError, BackupPart};
use toml::{Table, Value};

use crate::cli::backup::LeftOutArg;
use crate::config::{self, Ecosystem};
use crate::hosting;

/// Longest file that is taken because the ecosystem file names it, in bytes. Maps, passwords and
/// certificates are shorter; what is longer is no configuration.
const NAMED_BYTES_MAX: u64 = 16 << 20;

/// Folders whose files belong to the system, although an ecosystem file may name them.
const SYSTEM: &[&str] = &["/dev", "/proc", "/run", "/sys", "/usr", "/bin", "/lib", "/sbin"];

/// Permission bits that make a file a program.
const EXECUTABLE: u32 = 0o111;

/// Maximum number of ecosystem files that are read: an interface names the file of another one.
const FILES_MAX: usize = 32;

/// The parts of a backup.
pub(super) struct BackupSources {
    pub(super) parts: Vec<BackupPart>,
    /// Path of the ecosystem file within the part `configuration`.
    pub(super) file: PathBuf,
}

// === impl BackupSources ===

impl BackupSources {
    /// Finds the files of an ecosystem that was read from `path`.
    pub(super) fn find(
        path: &Path,
        ecosystem: &Ecosystem,
        without: &[LeftOutArg],
    ) -> Result<BackupSources, BackupError> {
        let file = normalized(path);
        let mut files = named_files(&file);
        files.extend(Some(normalized(&ecosystem.people)).filter(|people| people.is_file()));
        let root = common_folder(&files);
        let below = |path: &PathBuf| path.strip_prefix(&root).map(Path::to_owned).ok();
        let configuration = BackupPart {
            name: "configuration".to_owned(),
            root: root.clone(),
            paths: files.iter().filter_map(below).collect(),
            follows_links: true,
        };
        let mut parts = vec![configuration];
        let keys = match &ecosystem.security {
            Some(security) => security.folder.clone(),
            None => config::credentials_folder(&ecosystem.name),
        };
        let mut add = |name: &str, folder: &Path, is_left_out: &dyn Fn(&Path) -> bool| {
            if folder.is_dir() {
                parts.push(BackupPart::of_folder(name, &normalized(folder), is_left_out)?);
            }
            Ok::<(), BackupError>(())
        };
        let all = |_: &Path| false;
        add("keys", &keys, &all)?;
        if !without.contains(&LeftOutArg::Plugins) {
            add("plugins", &hosting::plugins_folder(ecosystem.plugins.folder.as_deref()), &all)?;
        }
        let state = hosting::state_base().join(ecosystem.name.as_str());
        add("state", &state, &|path| is_left_out(path, without))?;
        if let Some(state) = parts.last_mut().filter(|part| part.name == "state") {
            put_ledgers_last(&mut state.paths);
        }
        let file = file.strip_prefix(&root).map(Path::to_owned).unwrap_or_default();
        Ok(BackupSources { parts, file })
    }
}

/// Moves the ledgers behind the Journals. A plan of a Journal whose steps the ledger does not know
/// would be carried out twice; a ledger that knows more than the Journal only repeats the outcome.
fn put_ledgers_last(paths: &mut [PathBuf]) {
    paths.sort_by_key(|path| path.extension().is_some_and(|ending| ending == "tokens"));
}

/// Whether a file of the state is left out.
fn is_left_out(path: &Path, without: &[LeftOutArg]) -> bool {
    let is_history = path.extension().is_some_and(|ending| ending == "history");
    let is_picture = path.file_name().is_some_and(|name| name == "pictures" || name == "motion");
    (is_history && without.contains(&LeftOutArg::History))
        || (is_picture && without.contains(&LeftOutArg::Pictures))
}

/// Returns an ecosystem file, the files that it names, and those that are named by ecosystem files
/// among them.
fn named_files(file: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::from([file.to_owned()]);
    let mut unread = vec![file.to_owned()];
    for _ in 0..FILES_MAX {
        let Some(next) = unread.pop() else { break };
        let text = fs::read_to_string(&next).unwrap_or_default();
        // A file that cannot be parsed is archived all the same.
        let Ok(table) = text.parse::<Table>() else { continue };
        let folder = next.parent().unwrap_or(Path::new("/"));
        let mut texts = Vec::new();
        table.values().for_each(|value| collect_texts(value, &mut texts));
        for text in texts {
            let path = normalized(&folder.join(text));
            if is_configuration(&path) && found.insert(path.clone()) {
                unread.extend(path.extension().is_some_and(|it| it == "toml").then_some(path));
            }
        }
    }
    found
}

fn collect_texts<'a>(value: &'a Value, texts: &mut Vec<&'a str>) {
    match value {
        Value::String(text) => texts.push(text),
        Value::Array(values) => values.iter().for_each(|value| collect_texts(value, texts)),
        Value::Table(table) => table.values().for_each(|value| collect_texts(value, texts)),
        _ => (),
    }
}

/// Whether a path that an ecosystem file names is a file of people, and no program or part of the
/// system.
fn is_configuration(path: &Path) -> bool {
    let is_system = SYSTEM.iter().any(|folder| path.starts_with(folder));
    let about = fs::metadata(path).ok().filter(|about| !is_system && about.is_file());
    about.is_some_and(|about| {
        about.len() <= NAMED_BYTES_MAX && about.permissions().mode() & EXECUTABLE == 0
    })
}

/// Returns the deepest folder that contains all files.
fn common_folder(files: &BTreeSet<PathBuf>) -> PathBuf {
    let mut folders = files.iter().filter_map(|file| file.parent());
    let first = folders.next().unwrap_or(Path::new("/")).to_owned();
    folders.fold(first, |common, folder| {
        let same = common.components().zip(folder.components());
        same.take_while(|(one, other)| one == other).map(|(one, _)| one).collect()
    })
}

/// Returns an absolute path without detours (`x/..`).
fn normalized(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut plain = PathBuf::new();
    for component in absolute.components() {
        match component {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => (),
            other => plain.push(other),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_the_ecosystem_file_names_are_found_where_they_are() {
        let outer = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            let path = outer.path().join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(&path, text).expect("written");
            path
        };
        let file = write(
            "ecosystems/office.toml",
            "[ecosystem]\nname = \"office\"\ndomain = \"../domains/office.pddl\"\n\
             [[interface]]\nfile = \"house.toml\"\n\
             [[agent]]\nname = \"sh\"\nconfig = { command = [\"/bin/sh\", \"missing\"] }\n",
        );
        write("ecosystems/house.toml", "[ecosystem]\nproblem = \"house/map.pddl\"\n");
        write("domains/office.pddl", "(define (domain office))");
        write("ecosystems/house/map.pddl", "(define (problem house))");
        write("ecosystems/unnamed.toml", "");
        let files = named_files(&normalized(&file));
        assert_eq!(common_folder(&files), normalized(outer.path()));
        let below: Vec<_> =
            files.iter().filter_map(|file| file.strip_prefix(outer.path()).ok()).collect();
        let expected = [
            "domains/office.pddl",
            "ecosystems/house/map.pddl",
            "ecosystems/house.toml",
            "ecosystems/office.toml",
        ];
        assert_eq!(below, expected.map(Path::new));
    }

    #[test]
    fn ledgers_are_read_after_journals() {
        let mut paths = ["", "hub", "hub/arm.tokens", "hub/journal.redb"].map(PathBuf::from);
        put_ledgers_last(&mut paths);
        assert_eq!(paths, ["", "hub", "hub/journal.redb", "hub/arm.tokens"].map(PathBuf::from));
    }
}
