//! Looks at what a plugin takes, four times a second, on a thread that may wait for disks.

use std::path::PathBuf;
use std::time::Duration;

use tokio::time::Instant;

use crate::cgroup::{Group, Taken};
use crate::usage::{self, Kept, Usage};

/// How often at most it is counted what a plugin keeps on disk.
const KEPT_EVERY: Duration = Duration::from_secs(1);
/// So many times as long as the last count took, none is made.
const KEPT_SHARE: u32 = 20;

/// What a plugin takes at one moment.
#[derive(Debug, Default)]
pub(crate) struct Look {
    /// Its process group.
    pub(crate) group: i32,
    /// Its own folder.
    pub(crate) home: PathBuf,
    pub(crate) usage: Usage,
    /// What its control group has taken, if it has one.
    pub(crate) taken: Option<Taken>,
    /// What it keeps on disk, where that was counted.
    pub(crate) kept: Option<Kept>,
}

impl Look {
    /// Bytes of memory that it holds: as its control group counts them, which knows what processes share
    /// and what is in none of them, or as far as its processes say.
    pub(crate) fn memory(&self) -> u64 {
        self.taken.map_or(self.usage.memory, |taken| taken.memory)
    }
}

/// Looks at one life of a plugin.
pub(crate) struct Looking {
    group: i32,
    home: PathBuf,
    file_max: u64,
    next_kept: Instant,
}

impl Looking {
    pub(crate) fn new(group: i32, home: PathBuf, file_max: u64) -> Looking {
        Looking { group, home, file_max, next_kept: Instant::now() }
    }

    /// What it takes now.
    pub(crate) async fn look(&mut self, counted: Option<&Group>) -> Look {
        let (group, home, file_max) = (self.group, self.home.clone(), self.file_max);
        let counts = Instant::now() >= self.next_kept;
        let looking = tokio::task::spawn_blocking(move || {
            let usage = usage::usage(group);
            let began = Instant::now();
            let kept = counts.then(|| usage::kept(&home, group, file_max));
            (Look { group, home, usage, taken: None, kept }, began.elapsed())
        });
        // It ends with the runtime, and then nothing more is looked at.
        let Ok((look, took)) = looking.await else { return Look::default() };
        if counts {
            self.next_kept = Instant::now() + KEPT_EVERY.max(took * KEPT_SHARE);
        }
        Look { taken: counted.map(Group::taken), ..look }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_of_a_control_group_decides() {
        // Two processes that share what they hold.
        let usage = Usage { memory: 200, ..Usage::default() };
        let look = Look { usage, ..Look::default() };
        assert_eq!(look.memory(), 200);
        let taken = Some(Taken { memory: 110, ..Taken::default() });
        assert_eq!(Look { taken, ..look }.memory(), 110);
    }
}
