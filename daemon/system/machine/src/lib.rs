//! Memory of the machine, as far as this process may use it, and figures of this process.
//!
//! - The figures come from `/proc` and `/sys/fs/cgroup` of Linux. A function returns `None` if
//!   Linux does not report the figure.
//! - A process may be allowed less memory than the machine has: its control group, the groups above
//!   it and its address space can have limits. The smallest limit counts.

mod process;

use std::fs;
use std::path::{Path, PathBuf};

pub use process::{ProcessFigures, process_figures};

/// Folders in which the kernel describes the machine and its processes.
#[derive(Clone, Debug)]
pub struct Kernel {
    proc: PathBuf,
    cgroups: PathBuf,
}

impl Default for Kernel {
    fn default() -> Kernel {
        Kernel { proc: "/proc".into(), cgroups: "/sys/fs/cgroup".into() }
    }
}

/// Returns the maximum number of bytes that this process may use, whatever other processes use.
pub fn memory_total() -> Option<u64> {
    Kernel::default().memory_total()
}

/// Returns the number of bytes that this process could use now without causing the kernel to swap
/// memory out or to kill a process.
pub fn memory_available() -> Option<u64> {
    Kernel::default().memory_available()
}

/// Returns the number of bytes of memory that this process uses (its resident set).
pub fn memory_resident() -> Option<u64> {
    Kernel::default().memory_resident()
}

// === impl Kernel ===

impl Kernel {
    /// Returns a `Kernel` that reads other folders, for tests.
    pub fn at(proc: impl Into<PathBuf>, cgroups: impl Into<PathBuf>) -> Kernel {
        Kernel { proc: proc.into(), cgroups: cgroups.into() }
    }

    /// Returns the maximum number of bytes that this process may use, like the function
    /// [`memory_total`].
    pub fn memory_total(&self) -> Option<u64> {
        let machine = self.meminfo("MemTotal:");
        let groups = self.groups().into_iter().filter_map(|group| limit(&group));
        machine.into_iter().chain(groups).chain(self.address_space()).min()
    }

    /// Returns the number of bytes that this process could use now, like the function
    /// [`memory_available`].
    pub fn memory_available(&self) -> Option<u64> {
        let machine = self.meminfo("MemAvailable:");
        let groups = self
            .groups()
            .into_iter()
            .filter_map(|group| Some(limit(&group)?.saturating_sub(taken(&group).unwrap_or(0))));
        machine.into_iter().chain(groups).chain(self.address_space()).min()
    }

    /// Returns the number of bytes of memory that this process uses, like the function
    /// [`memory_resident`].
    pub fn memory_resident(&self) -> Option<u64> {
        kibibytes(&fs::read_to_string(self.proc.join("self/status")).ok()?, "VmRSS:")
    }

    fn meminfo(&self, key: &str) -> Option<u64> {
        kibibytes(&fs::read_to_string(self.proc.join("meminfo")).ok()?, key)
    }

    /// Returns the limit of this process's address space in bytes; `None` if there is no limit.
    fn address_space(&self) -> Option<u64> {
        let limits = fs::read_to_string(self.proc.join("self/limits")).ok()?;
        let line = limits.lines().find(|line| line.starts_with("Max address space"))?;
        line.split_whitespace().nth(3)?.parse().ok()
    }

    /// Returns the folders of the control groups of this process, each followed by those above it.
    fn groups(&self) -> Vec<PathBuf> {
        let text = fs::read_to_string(self.proc.join("self/cgroup")).unwrap_or_default();
        let mut groups = Vec::new();
        for line in text.lines() {
            let mut parts = line.splitn(3, ':').skip(1);
            let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else { continue };
            let root = match controllers {
                "" => self.cgroups.clone(),
                controllers if controllers.split(',').any(|one| one == "memory") => {
                    self.cgroups.join("memory")
                }
                _ => continue,
            };
            let own = root.join(path.trim_start_matches('/'));
            let above = own.ancestors().take_while(|group| group.starts_with(&root));
            groups.extend(above.map(Path::to_owned));
        }
        groups
    }
}

/// Returns the memory limit of a control group in bytes; `None` if there is no limit.
fn limit(group: &Path) -> Option<u64> {
    // The first file is of version 2 of control groups, the second of version 1, where a number
    // beyond all memory means no limit.
    number(&group.join("memory.max")).or_else(|| number(&group.join("memory.limit_in_bytes")))
}

/// Returns the memory that a control group uses, without file caches that the kernel would free.
fn taken(group: &Path) -> Option<u64> {
    let current = number(&group.join("memory.current"))
        .or_else(|| number(&group.join("memory.usage_in_bytes")))?;
    let statistics = fs::read_to_string(group.join("memory.stat")).unwrap_or_default();
    let files = statistics.lines().find_map(|line| line.strip_prefix("inactive_file "));
    let files = files.and_then(|files| files.trim().parse().ok()).unwrap_or(0);
    Some(current.saturating_sub(files))
}

fn number(file: &Path) -> Option<u64> {
    fs::read_to_string(file).ok()?.trim().parse().ok()
}

/// Returns the number of bytes in a line `KEY NUMBER kB`; `None` if there is no such line.
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.starts_with(key))?;
    let kibibytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    kibibytes.checked_mul(1 << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    fn kernel(files: &[(&str, &str)]) -> (tempfile::TempDir, Kernel) {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in files {
            let file = folder.path().join(name);
            fs::create_dir_all(file.parent().expect("a folder")).expect("it can be made");
            fs::write(file, text).expect("it can be written");
        }
        let kernel = Kernel::at(folder.path().join("proc"), folder.path().join("groups"));
        (folder, kernel)
    }

    const MEMINFO: (&str, &str) =
        ("proc/meminfo", "MemTotal:        4096 kB\nMemFree: 5 kB\nMemAvailable:    2048 kB\n");

    #[test]
    fn without_control_groups_the_memory_of_the_machine_counts() {
        let (_folder, kernel) = kernel(&[MEMINFO]);
        assert_eq!(kernel.memory_total(), Some(4 * MIB));
        assert_eq!(kernel.memory_available(), Some(2 * MIB));
    }

    #[test]
    fn the_smallest_limit_of_all_groups_counts() {
        let (_folder, kernel) = kernel(&[
            MEMINFO,
            ("proc/self/cgroup", "0::/system/althing\n"),
            ("groups/system/memory.max", "3145728\n"),
            ("groups/system/memory.current", "2621440\n"),
            ("groups/system/memory.stat", "anon 7\ninactive_file 524288\n"),
            ("groups/system/althing/memory.max", "max\n"),
        ]);
        assert_eq!(kernel.memory_total(), Some(3 * MIB));
        assert_eq!(kernel.memory_available(), Some(MIB));
    }

    #[test]
    fn groups_of_version_1_and_the_address_space_count() {
        let (_folder, kernel) = kernel(&[
            MEMINFO,
            ("proc/self/cgroup", "5:cpu:/x\n4:memory:/x\n"),
            ("groups/memory/x/memory.limit_in_bytes", "2097152\n"),
            (
                "proc/self/limits",
                "Limit Soft Hard Units\nMax address space 1048576 unlimited bytes\n",
            ),
        ]);
        assert_eq!(kernel.memory_total(), Some(MIB));
    }

    #[test]
    fn unreported_figures_are_none() {
        let (_folder, kernel) = kernel(&[]);
        assert_eq!(kernel.memory_total(), None);
        assert_eq!(kernel.memory_resident(), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn this_machine_reports_its_memory() {
        let total = memory_total().expect("it is told");
        assert!(memory_available().expect("it is told") <= total);
        assert!(memory_resident().expect("it is told") > 0);
    }
}
