//! The owners of files, by their names: the same user has another number on another machine.

use std::fs;
use std::io;
use std::os::unix::fs::lchown;
use std::path::Path;

/// The files in which the system keeps the numbers of users and groups.
const USERS: &str = "/etc/passwd";
const GROUPS: &str = "/etc/group";

/// The users and groups of this machine.
pub(crate) struct OwnerNames {
    users: Vec<(String, u32)>,
    groups: Vec<(String, u32)>,
}

impl OwnerNames {
    /// Reads the names. A file that cannot be read has none; users of a directory service are not
    /// found.
    pub(crate) fn read() -> OwnerNames {
        let names = |file| entries(&fs::read_to_string(file).unwrap_or_default());
        OwnerNames { users: names(USERS), groups: names(GROUPS) }
    }

    /// Returns the name of a user; empty if there is none.
    pub(crate) fn user(&self, number: u64) -> &str {
        name_of(&self.users, number)
    }

    /// Returns the name of a group; empty if there is none.
    pub(crate) fn group(&self, number: u64) -> &str {
        name_of(&self.groups, number)
    }

    /// Gives a file the owner and the group with these names, as far as this machine has them.
    pub(crate) fn give(&self, path: &Path, user: &str, group: &str) -> io::Result<()> {
        let (user, group) = (number_of(&self.users, user), number_of(&self.groups, group));
        if user.is_none() && group.is_none() {
            return Ok(());
        }
        lchown(path, user, group)
    }
}

fn entries(text: &str) -> Vec<(String, u32)> {
    let entry = |line: &str| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        Some((name.to_owned(), fields.nth(1)?.parse().ok()?))
    };
    text.lines().filter_map(entry).collect()
}

fn name_of(all: &[(String, u32)], number: u64) -> &str {
    let found = all.iter().find(|(_, other)| u64::from(*other) == number);
    found.map(|(name, _)| name.as_str()).unwrap_or_default()
}

fn number_of(all: &[(String, u32)], name: &str) -> Option<u32> {
    all.iter().find(|(other, _)| !name.is_empty() && other == name).map(|(_, number)| *number)
}
