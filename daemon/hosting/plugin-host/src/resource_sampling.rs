//! Measures the resources that a plugin takes, on a thread that may block on disks.

use std::path::PathBuf;
use std::time::Duration;

use tokio::time::Instant;

use crate::cgroup::{CgroupUsage, PluginCgroup};
use crate::usage::{self, DiskUsage, GroupUsage};

/// Minimum interval between counts of a plugin's files on disk.
const KEPT_EVERY: Duration = Duration::from_secs(1);
/// Minimum interval between counts of a plugin's files on disk, as a multiple of the duration of
/// the last count. It limits the share of time that is spent on counting.
const KEPT_SHARE: u32 = 20;

/// Resources that a plugin takes at one moment.
#[derive(Debug, Default)]
pub(crate) struct ResourceSample {
    /// Process group of the plugin.
    pub(crate) group: i32,
    /// Data folder of the plugin.
    pub(crate) home: PathBuf,
    pub(crate) usage: GroupUsage,
    /// Usage that the plugin's control group reports; `None` if the plugin has no control group.
    pub(crate) cgroup_usage: Option<CgroupUsage>,
    /// Disk space of the plugin's files; `None` if this sample has no count.
    pub(crate) disk_usage: Option<DiskUsage>,
}

impl ResourceSample {
    /// Returns the bytes of memory that the plugin holds. The count of its control group is
    /// preferred: it counts shared memory once, and includes memory that belongs to no process.
    /// Without a control group, the result is the sum over the plugin's processes.
    pub(crate) fn memory(&self) -> u64 {
        self.cgroup_usage.map_or(self.usage.memory, |taken| taken.memory)
    }
}

/// Sampler of the resources of one incarnation of a plugin.
pub(crate) struct ResourceSampler {
    group: i32,
    home: PathBuf,
    file_max: u64,
    next_kept: Instant,
    /// Number of descriptors in flight at the last count.
    in_flight: u64,
}

impl ResourceSampler {
    pub(crate) fn new(group: i32, home: PathBuf, file_max: u64) -> ResourceSampler {
        ResourceSampler { group, home, file_max, next_kept: Instant::now(), in_flight: 0 }
    }

    /// Measures the resources that the plugin takes now.
    pub(crate) async fn sample(&mut self, counted: Option<&PluginCgroup>) -> ResourceSample {
        let (group, home, file_max) = (self.group, self.home.clone(), self.file_max);
        let counts = Instant::now() >= self.next_kept;
        let counts_buffers = counted.is_none();
        let looking = tokio::task::spawn_blocking(move || {
            let usage = usage::usage(group, counts_buffers);
            let began = Instant::now();
            let kept = counts.then(|| usage::measure_disk(&home, group, file_max));
            (
                ResourceSample { group, home, usage, cgroup_usage: None, disk_usage: kept },
                began.elapsed(),
            )
        });
        // The thread pool is gone when the runtime shuts down; then the sample is empty.
        let Ok((mut look, took)) = looking.await else { return ResourceSample::default() };
        if counts {
            self.next_kept = Instant::now() + KEPT_EVERY.max(took * KEPT_SHARE);
        }
        if let Some(kept) = &mut look.disk_usage {
            // A program that passes a descriptor to a process has the descriptor in flight only for
            // a moment. Therefore the smaller of two successive counts is used.
            let before = std::mem::replace(&mut self.in_flight, kept.in_flight);
            kept.in_flight = kept.in_flight.min(before);
        }
        ResourceSample { cgroup_usage: counted.map(PluginCgroup::measure), ..look }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_count_of_a_control_group_takes_precedence() {
        // The sample has two processes that share memory.
        let usage = GroupUsage { memory: 200, ..GroupUsage::default() };
        let look = ResourceSample { usage, ..ResourceSample::default() };
        assert_eq!(look.memory(), 200);
        let taken = Some(CgroupUsage { memory: 110, ..CgroupUsage::default() });
        assert_eq!(ResourceSample { cgroup_usage: taken, ..look }.memory(), 110);
    }
}
