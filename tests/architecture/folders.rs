//! Checks in which folder each crate is (ARCHITECTURE.md, “Folders”): each crate of `daemon/` and
//! `plugins/` is in the folder of a group, and the table names it there.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::{none, root};

/// Groups by their folders, from the root: each with the names of its crates and packages.
type Groups = BTreeMap<String, BTreeSet<String>>;

/// Returns the folders inside `folder`, sorted.
fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut folders: Vec<_> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// Whether `folder` has a crate or the package of a plugin.
fn is_unit(folder: &Path) -> bool {
    ["Cargo.toml", "plugin.toml"].iter().any(|file| folder.join(file).is_file())
}

/// Returns the folders of all crates and packages that are in a group, sorted.
pub(crate) fn units() -> Vec<PathBuf> {
    let groups = ["daemon", "plugins"].map(|top| folders_in(&root().join(top))).concat();
    groups.iter().flat_map(|group| folders_in(group)).filter(|unit| is_unit(unit)).collect()
}

/// Returns the folder of the crate `name`, which is in a group.
pub(crate) fn folder_of(name: &str) -> PathBuf {
    let found = units().into_iter().find(|unit| unit.ends_with(name));
    found.unwrap_or_else(|| panic!("`{name}` is no crate in a group of `daemon/` or `plugins/`"))
}

/// Returns a path relative to the root, as text.
fn shown(path: &Path) -> String {
    path.strip_prefix(root()).unwrap_or(path).display().to_string()
}

/// Returns the groups that exist.
fn existing() -> Groups {
    let mut groups = Groups::new();
    for unit in units() {
        let (Some(group), Some(name)) = (unit.parent(), unit.file_name()) else { continue };
        groups.entry(shown(group)).or_default().insert(name.to_string_lossy().into_owned());
    }
    groups
}

/// Returns the names in backticks of a cell.
fn names(cell: &str) -> impl Iterator<Item = String> + '_ {
    cell.split('`').skip(1).step_by(2).map(str::to_owned)
}

/// Returns the groups of the table under the heading “Folders”: folder, purpose, crates.
fn described(text: &str) -> Groups {
    let lines = text.lines().skip_while(|line| *line != "## Folders").skip(1);
    let rows =
        lines.take_while(|line| !line.starts_with("## ")).filter(|line| line.starts_with("| `"));
    rows.filter_map(|row| {
        let cells: Vec<_> = row.split('|').collect();
        Some((names(cells.get(1)?).next()?, names(cells.get(3)?).collect()))
    })
    .collect()
}

/// Returns what the table and the folders do not have in common.
fn differences(existing: &Groups, described: &Groups) -> Vec<String> {
    let pairs = |groups: &Groups| -> BTreeSet<String> {
        let of = |(folder, names): (&String, &BTreeSet<String>)| {
            names.iter().map(|name| format!("{folder}/{name}")).collect::<Vec<_>>()
        };
        groups.iter().flat_map(of).collect()
    };
    let (existing, described) = (pairs(existing), pairs(described));
    let missing =
        existing.difference(&described).map(|unit| format!("`{unit}` is not in the table"));
    let gone = described.difference(&existing).map(|unit| format!("`{unit}` is in the table only"));
    missing.chain(gone).collect()
}

#[test]
fn every_crate_is_in_a_group_of_the_table() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("it is committed");
    let existing = existing();
    assert!(existing.len() > 5, "{existing:?} are too few groups, so this test looks at nothing");
    none(&differences(&existing, &described(&text)), "the table “Folders” names every crate");
}

#[test]
fn no_crate_is_outside_of_the_groups() {
    let tops = ["daemon", "plugins"].map(|top| folders_in(&root().join(top))).concat();
    let outside = tops.iter().filter(|folder| is_unit(folder));
    let outside: Vec<_> = outside
        .map(|folder| format!("`{}` is in no group: move it into one", shown(folder)))
        .collect();
    none(&outside, "each crate is in the folder of a group");
}

// === the rule can fail ===

#[test]
fn a_crate_that_the_table_lacks_or_invents_is_found() {
    let text = "## Folders\n\n| folder | for | crates |\n|---|---|---|\n\
                | `daemon/one` | `x` and y | `a`, `b` |\n\n## Layers\n| `daemon/two` | z | `c` |\n";
    let table = described(text);
    let groups = |names: &[&str]| -> Groups {
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        [("daemon/one".to_owned(), names)].into_iter().collect()
    };
    assert_eq!(table, groups(&["a", "b"]));
    assert!(differences(&groups(&["a", "b"]), &table).is_empty());
    assert_eq!(differences(&groups(&["a"]), &table), ["`daemon/one/b` is in the table only"]);
    let more = groups(&["a", "b", "c"]);
    assert_eq!(differences(&more, &table), ["`daemon/one/c` is not in the table"]);
}
