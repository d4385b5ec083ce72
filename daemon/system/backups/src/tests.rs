//! Tests of archives, with files in temporary folders.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use flate2::Compression;
use flate2::write::GzEncoder;
use tar::{Builder, EntryType, Header};
use tempfile::TempDir;

use super::*;
use crate::manifest::{DIGESTS, MANIFEST};
use crate::steady::hexadecimal;

/// A machine with state and configuration, in a folder of its own.
struct Machine {
    folder: TempDir,
}

impl Machine {
    fn new() -> Machine {
        let machine = Machine { folder: tempfile::tempdir().expect("a folder") };
        machine.write("state/hub/journal.redb", "goals of the building");
        machine.write("state/hub/stops.json", "{}");
        machine.write("state/hub/history.history/000000000000.redb", "long ago");
        machine.write("etc/althing.toml", "[ecosystem]\nname = \"office\"\n");
        fs::set_permissions(machine.path("state/hub"), fs::Permissions::from_mode(0o700))
            .expect("changed");
        machine
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        fs::write(path, text).expect("written");
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| error.to_string())
    }

    fn parts(&self) -> Vec<BackupPart> {
        let is_history = |path: &Path| path.extension().is_some_and(|it| it == "history");
        let state = BackupPart::of_folder("state", &self.path("state"), &is_history);
        let configuration = BackupPart {
            name: "configuration".to_owned(),
            root: self.path("etc"),
            paths: vec![PathBuf::from("althing.toml")],
            follows_links: true,
        };
        vec![configuration, state.expect("a folder")]
    }

    fn manifest(&self, parts: &[BackupPart]) -> BackupManifest {
        BackupManifest {
            format: BACKUP_FORMAT,
            made_by: "0.1.0".to_owned(),
            made_at: "2026-11-28T08:00:00Z".to_owned(),
            machine: "hub".to_owned(),
            ecosystem: "office".to_owned(),
            file: PathBuf::from("althing.toml"),
            state_format: 1,
            parts: parts.iter().map(|part| (part.name.clone(), part.root.clone())).collect(),
            left_out: vec!["history".to_owned()],
        }
    }

    fn back_up(&self) -> PathBuf {
        let (archive, parts) = (self.path("backup.tar.gz"), self.parts());
        let length = write_backup(&archive, &self.manifest(&parts), &parts).expect("written");
        assert_eq!(fs::metadata(&archive).expect("it is there").len(), length);
        archive
    }

    fn targets(&self) -> BTreeMap<String, RestoreTarget> {
        let target = |folder: &str, manner| RestoreTarget { folder: self.path(folder), manner };
        BTreeMap::from([
            ("state".to_owned(), target("state", TargetManner::Whole)),
            ("configuration".to_owned(), target("etc", TargetManner::Single)),
        ])
    }

    fn restore(&self, archive: &Path, replaces: bool) -> Result<Vec<RestoredPlace>, BackupError> {
        let options = RestoreOptions { replaces, stamp: "now".to_owned() };
        unpack(archive, &self.targets())?.put_in_place(&options)
    }

    /// Writes an archive that is whole, with entries that [`write_backup`] does not write. The text
    /// of an entry is its content, or the target of a link.
    fn craft(&self, entries: &[(&str, EntryType, &str)]) -> PathBuf {
        let archive = self.path("crafted.tar.gz");
        let file = fs::File::create(&archive).expect("created");
        let mut builder = Builder::new(GzEncoder::new(file, Compression::fast()));
        let mut add = |name: &str, kind: EntryType, text: &str| {
            let mut header = Header::new_gnu();
            header.set_mode(0o777);
            header.set_entry_type(kind);
            header.set_size(if kind.is_symlink() { 0 } else { text.len() as u64 });
            let added = match kind.is_symlink() {
                true => builder.append_link(&mut header, name, text),
                false => builder.append_data(&mut header, name, text.as_bytes()),
            };
            added.expect("added");
        };
        let manifest = serde_json::to_string(&self.manifest(&self.parts())).expect("a text");
        add(MANIFEST, EntryType::Regular, &manifest);
        let mut digests = String::new();
        for (name, kind, text) in entries {
            add(name, *kind, text);
            if kind.is_file() {
                let digest = ring::digest::digest(&ring::digest::SHA256, text.as_bytes());
                digests += &format!("{}  {name}\n", hexadecimal(&digest));
            }
        }
        add(DIGESTS, EntryType::Regular, &digests);
        builder.into_inner().and_then(GzEncoder::finish).expect("written");
        archive
    }

    /// Returns the names of hidden files, which no operation may leave behind.
    fn leftovers(&self) -> Vec<String> {
        let folders = ["", "etc", "state"].map(|folder| self.path(folder));
        let entries = folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten();
        let names = entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
        names.filter(|name| name.starts_with('.')).collect()
    }
}

#[test]
fn what_was_archived_is_on_another_machine_as_it_was() {
    let one = Machine::new();
    symlink("journal.redb", one.path("state/hub/newest")).expect("linked");
    let archive = one.back_up();
    let mode = fs::metadata(&archive).expect("it is there").permissions().mode();
    assert_eq!(mode & 0o777, 0o600, "keys are in it");
    let contents = inspect(&archive).expect("it is whole");
    assert_eq!(contents.manifest.ecosystem, "office");

    let other = Machine { folder: tempfile::tempdir().expect("a folder") };
    let places = other.restore(&archive, false).expect("there is nothing");
    assert_eq!(places.len(), 2, "{places:?}");
    assert_eq!(other.read("state/hub/journal.redb"), "goals of the building");
    assert_eq!(other.read("state/hub/newest"), "goals of the building");
    assert_eq!(other.read("etc/althing.toml"), one.read("etc/althing.toml"));
    assert!(!other.path("state/hub/history.history").exists(), "it was left out");
    let mode = fs::metadata(other.path("state/hub")).expect("it is there").permissions().mode();
    assert_eq!(mode & 0o777, 0o700);
    assert_eq!(other.leftovers(), [""; 0]);
}

#[test]
fn what_is_there_is_replaced_only_on_request_and_kept_aside() {
    let machine = Machine::new();
    let archive = machine.back_up();
    machine.write("state/hub/journal.redb", "later goals");
    machine.write("etc/other.toml", "of another ecosystem");
    let error = machine.restore(&archive, false).expect_err("the state is there");
    assert!(error.to_string().contains("--replace"), "{error}");
    assert_eq!(machine.read("state/hub/journal.redb"), "later goals");
    assert_eq!(machine.leftovers(), [""; 0]);

    let places = machine.restore(&archive, true).expect("it is replaced");
    assert_eq!(places.len(), 1, "the file of the ecosystem is the same: {places:?}");
    assert_eq!(machine.read("state/hub/journal.redb"), "goals of the building");
    assert_eq!(machine.read("state.before-now/hub/journal.redb"), "later goals");
    assert_eq!(machine.read("etc/other.toml"), "of another ecosystem");
    machine.restore(&archive, true).expect("again");
    assert!(machine.path("state.before-now-1").exists(), "the older one is kept, too");
}

#[test]
fn a_damaged_archive_changes_nothing() {
    let machine = Machine::new();
    machine.write("state/hub/long", &"many goals ".repeat(9_000));
    let archive = machine.back_up();
    let whole = fs::read(&archive).expect("it is there");
    machine.write("state/hub/journal.redb", "later goals");
    for length in [0, 10, whole.len() / 2, whole.len() - 9] {
        fs::write(&archive, &whole[..length]).expect("written");
        let error = machine.restore(&archive, true).expect_err("it is cut off");
        assert!(error.to_string().contains("backup.tar.gz"), "{error}");
    }
    for place in [whole.len() / 3, whole.len() / 2] {
        let mut torn = whole.clone();
        torn[place] ^= 0x55;
        fs::write(&archive, &torn).expect("written");
        machine.restore(&archive, true).expect_err("a bit is wrong");
    }
    assert_eq!(machine.read("state/hub/journal.redb"), "later goals");
    assert_eq!(machine.leftovers(), [""; 0]);
    assert!(!machine.path("state.before-now").exists());
}

#[test]
fn an_archive_of_a_newer_version_is_refused_by_name() {
    let machine = Machine::new();
    let (archive, parts) = (machine.path("backup.tar.gz"), machine.parts());
    let manifest = BackupManifest {
        format: BACKUP_FORMAT + 1,
        made_by: "9.0.0".to_owned(),
        ..machine.manifest(&parts)
    };
    write_backup(&archive, &manifest, &parts).expect("written");
    let error = machine.restore(&archive, true).expect_err("it is newer").to_string();
    assert!(error.contains("althing 9.0.0 made it"), "{error}");
    assert_eq!(inspect(&archive).expect_err("it is newer").to_string(), error);
}

#[test]
fn names_that_lead_elsewhere_are_refused() {
    let machine = Machine::new();
    let (archive, mut parts) = (machine.path("backup.tar.gz"), machine.parts());
    machine.write("etc/secret", "of others");
    // The link comes after all files, so that nothing is written through it.
    symlink("/", machine.path("state/root")).expect("linked");
    parts[1].paths.push(PathBuf::from("root"));
    let manifest = machine.manifest(&parts);
    write_backup(&archive, &manifest, &parts).expect("written");
    machine.restore(&archive, true).expect("a link is a link");
    // A part that the manifest does not name.
    let mut fewer = machine.manifest(&parts);
    fewer.parts.remove("state");
    write_backup(&archive, &fewer, &parts).expect("written");
    let error = machine.restore(&archive, true).expect_err("no such part").to_string();
    assert!(error.contains("belongs to no part"), "{error}");
    fs::write(&archive, "no archive").expect("written");
    let error = machine.restore(&archive, true).expect_err("no archive").to_string();
    assert!(error.contains("it is no backup of althing"), "{error}");
}

#[test]
fn nothing_is_unpacked_through_a_link() {
    const FILE: EntryType = EntryType::Regular;
    const FOLDER: EntryType = EntryType::Directory;
    const LINK: EntryType = EntryType::Symlink;
    let machine = Machine::new();
    let outside = machine.path("outside");
    fs::create_dir(&outside).expect("made");
    let mode = || fs::metadata(&outside).expect("it is there").permissions().mode() & 0o777;
    fs::set_permissions(&outside, fs::Permissions::from_mode(0o750)).expect("ours");
    let elsewhere = outside.to_str().expect("a text");
    let state = ("state", FOLDER, "");
    let link = ("state/x", LINK, elsewhere);
    for (last, problem) in [
        (("state/x/job", FILE, "rm"), "state/x/job is below a link"),
        (("state/x/job", LINK, "/"), "state/x/job is below a link"),
        (("state/x", FOLDER, ""), "state/x is there twice"),
        (("state/./x", FOLDER, ""), "x is there twice"),
        (("state/y", FILE, ""), "state/y comes after a link"),
        (("configuration/y", LINK, elsewhere), "configuration/y is a link"),
    ] {
        let archive = machine.craft(&[state, link, last]);
        let error = machine.restore(&archive, true).expect_err(problem).to_string();
        assert!(error.contains(problem), "{problem}: {error}");
        assert_eq!(fs::read_dir(&outside).expect("a folder").count(), 0, "{problem}");
        assert_eq!(mode(), 0o750, "{problem}");
        assert_eq!(machine.leftovers(), [""; 0]);
    }
    let twice = [state, ("state/y", FILE, "one"), ("state/y", FILE, "two")];
    let error = inspect(&machine.craft(&twice)).expect_err("which one?").to_string();
    assert!(error.contains("state/y is there twice"), "{error}");
    let plain = [state, ("state/y", FILE, "one"), link];
    machine.restore(&machine.craft(&plain), true).expect("nothing is wrong with it");
    assert_eq!(machine.read("state/y"), "one");
}

#[test]
fn an_archive_that_is_unpacked_only_leaves_nothing() {
    let machine = Machine::new();
    let archive = machine.back_up();
    machine.write("state/hub/journal.redb", "later goals");
    let unpacked = unpack(&archive, &machine.targets()).expect("there is room");
    assert!(!machine.leftovers().is_empty(), "it is beside its place");
    drop(unpacked);
    assert_eq!(machine.leftovers(), [""; 0]);
    assert_eq!(machine.read("state/hub/journal.redb"), "later goals");
}

#[test]
fn an_archive_that_cannot_be_written_leaves_the_old_one() {
    let machine = Machine::new();
    let archive = machine.back_up();
    let before = fs::read(&archive).expect("it is there");
    let (mut parts, manifest) = (machine.parts(), machine.manifest(&machine.parts()));
    // A folder where a file was is what the writing stumbles over, as over a full disk.
    parts[0].paths.push(PathBuf::from("gone/../../state/hub"));
    parts[0].root = machine.path("state/hub/stops.json");
    write_backup(&archive, &manifest, &parts).expect_err("no such folder");
    assert_eq!(fs::read(&archive).expect("it is there"), before);
    assert_eq!(machine.leftovers(), [""; 0]);
    let full = Path::new("/dev/full/backup");
    let error = write_backup(full, &manifest, &machine.parts()).expect_err("no folder");
    assert!(error.to_string().contains("/dev/full/backup"), "{error}");
}

#[test]
fn a_file_that_is_written_meanwhile_is_archived_as_it_was_at_one_moment() {
    let machine = Machine::new();
    let path = machine.path("state/hub/journal.redb");
    let block = |number: u8| vec![number; 300_000];
    fs::write(&path, block(0)).expect("written");
    let ends = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for number in 1..=u8::MAX {
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                let mut file = OpenOptions::new().write(true).open(&path).expect("it is there");
                file.write_all(&block(number)).expect("written");
            }
        });
        let archive = machine.back_up();
        ends.store(true, Ordering::Relaxed);
        let other = Machine { folder: tempfile::tempdir().expect("a folder") };
        other.restore(&archive, false).expect("there is nothing");
        let copied = fs::read(other.path("state/hub/journal.redb")).expect("it is there");
        assert_eq!(copied.len(), 300_000);
        // At one moment a write may be half done: a beginning of it, and the rest of the one before.
        let changes = copied.windows(2).filter(|pair| pair[0] != pair[1]);
        let changes: Vec<&[u8]> = changes.collect();
        let is_one_moment = match changes.as_slice() {
            [] => true,
            [pair] => pair[1].checked_add(1) == Some(pair[0]),
            _ => false,
        };
        assert!(is_one_moment, "several moments are in it: {changes:?}");
    });
}
