//! Control groups (cgroup v2). The machine may have delegated a part of its tree of control groups
//! to the daemon (systemd's `Delegate=yes`). Then each plugin gets a group of its own, in which the
//! kernel counts and limits memory, processes and processor time.
//!
//! The kernel does not let a group have both processes and subgroups, so the daemon moves itself
//! into a subgroup.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Path where the tree of control groups is mounted.
const ROOT: &str = "/sys/fs/cgroup";
/// Controllers of the kernel that count the resources of plugins.
const CONTROLLERS: [&str; 3] = ["cpu", "memory", "pids"];
/// Name of the subgroup that the daemon moves itself into.
const OWN: &str = "daemon";
/// Period over which the kernel counts a group's share of a processor, in microseconds. This is the
/// kernel's default.
const PERIOD: u32 = 100_000;
/// Extended attributes by which systemd marks a group as delegated.
const DELEGATED: [&str; 2] = ["user.delegate", "trusted.delegate"];

/// Part of the machine's tree of control groups that was delegated to this daemon.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CgroupTree(PathBuf);

/// Control group of one incarnation of a plugin. When this value is dropped, all processes in the
/// group are killed and the group is removed.
#[derive(Debug)]
pub(crate) struct PluginCgroup {
    folder: PathBuf,
    /// Usage that earlier incarnations left in the counters of the group; it is subtracted from
    /// each measurement.
    before: CgroupUsage,
}

/// Resources that the processes of a control group have taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CgroupUsage {
    /// Bytes of memory of any kind that the group holds.
    pub(crate) memory: u64,
    /// Processor time of all processes that were ever in the group.
    pub(crate) cpu: Duration,
    /// Number of processes that the kernel killed because the group exceeded its memory limit.
    pub(crate) ended: u64,
}

impl CgroupTree {
    /// Finds the control group of this process, and divides the group into subgroups if it is not
    /// divided yet.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if no part of the tree of control groups is delegated to
    /// this daemon.
    pub(crate) fn find() -> Result<CgroupTree, String> {
        let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
        let own = groups.lines().find_map(|line| line.strip_prefix("0::"));
        let own = own.ok_or("this machine has no control groups of version 2")?;
        let folder = Path::new(ROOT).join(own.trim_start_matches('/'));
        CgroupTree::divided(&folder).map_or_else(|| CgroupTree::at(&folder), Ok)
    }

    /// Returns the delegated part of the tree, if `part` is the subgroup that the daemon made for
    /// itself before it re-executed itself. Returns `None` if `part` is another group, or may not
    /// be used.
    fn divided(part: &Path) -> Option<CgroupTree> {
        let folder = part.parent().filter(|_| part.file_name().is_some_and(|name| name == OWN))?;
        let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
        let enabled = read("cgroup.subtree_control");
        let is_divided =
            CONTROLLERS.iter().all(|name| enabled.split_whitespace().any(|it| it == *name));
        // If another process has divided the group, this daemon may not make subgroups in it.
        let is_given = !rustix::process::geteuid().is_root() || is_marked(folder);
        let is_writable = rustix::fs::access(folder, rustix::fs::Access::WRITE_OK).is_ok();
        (is_divided && is_given && is_writable && read("cgroup.procs").trim().is_empty())
            .then(|| CgroupTree(folder.to_owned()))
    }

    fn at(folder: &Path) -> Result<CgroupTree, String> {
        let shown = folder.display();
        let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
        let known = read("cgroup.controllers");
        let missing =
            CONTROLLERS.iter().find(|name| !known.split_whitespace().any(|it| it == **name));
        if let Some(missing) = missing {
            return Err(format!("the control group {shown} has no `{missing}` controller"));
        }
        if rustix::process::geteuid().is_root() && !is_marked(folder) {
            return Err(format!(
                "the control group {shown} is not delegated to this daemon (Delegate=yes)"
            ));
        }
        let own = std::process::id().to_string();
        let others = read("cgroup.procs");
        if others.lines().any(|process| process != own) {
            return Err(format!(
                "the control group {shown} contains processes other than this daemon"
            ));
        }
        let divide = || -> io::Result<()> {
            let part = folder.join(OWN);
            make(&part)?;
            fs::write(part.join("cgroup.procs"), &own)?;
            let enabled = CONTROLLERS.map(|name| format!("+{name}")).join(" ");
            fs::write(folder.join("cgroup.subtree_control"), enabled)
        };
        divide().map_err(|error| {
            format!(
                "the control group {shown} is not delegated to this daemon (Delegate=yes): {error}"
            )
        })?;
        Ok(CgroupTree(folder.to_owned()))
    }

    /// Creates the control group of a plugin, with limits of `memory` bytes and `tasks` threads.
    ///
    /// # Errors
    ///
    /// Returns an error if the kernel refuses to create or to limit the group.
    pub(crate) fn group(&self, name: &str, memory: u64, tasks: u64) -> io::Result<PluginCgroup> {
        let folder = self.0.join(format!("plugin-{name}"));
        make(&folder)?;
        let mut group = PluginCgroup { folder, before: CgroupUsage::default() };
        group.before = CgroupUsage { memory: 0, ..group.measure() };
        group.write("memory.max", &memory.to_string())?;
        // Swap is forbidden: memory and swap together would exceed the limit. The file is missing
        // if the kernel has no swap.
        match group.write("memory.swap.max", "0") {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => (),
        }
        group.write("memory.oom.group", "1")?;
        group.write("pids.max", &tasks.to_string())?;
        // An earlier incarnation in the same group may have been slowed down.
        group.write("cpu.max", &format!("max {PERIOD}"))?;
        Ok(group)
    }
}

impl PluginCgroup {
    /// Returns the folder of the control group. A process joins the group by writing to the file
    /// `cgroup.procs` in that folder.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the usage of this incarnation so far. A value that cannot be read is zero.
    pub(crate) fn measure(&self) -> CgroupUsage {
        let number = |file: &str, key: &str| -> u64 {
            let text = fs::read_to_string(self.folder.join(file)).unwrap_or_default();
            let line = text.lines().find_map(|line| match key {
                "" => Some(line),
                key => line.strip_prefix(key),
            });
            line.and_then(|value| value.trim().parse().ok()).unwrap_or(0)
        };
        CgroupUsage {
            memory: number("memory.current", ""),
            cpu: Duration::from_micros(number("cpu.stat", "usage_usec "))
                .saturating_sub(self.before.cpu),
            ended: number("memory.events", "oom_kill ").saturating_sub(self.before.ended),
        }
    }

    /// Limits the control group to `share` of a processor from now on.
    pub(crate) fn slow_down(&self, share: f64) {
        let quota = (share * f64::from(PERIOD)).max(1_000.0).round();
        // If this fails, only the lower priority of its processes slows the group down.
        let _ = self.write("cpu.max", &format!("{quota} {PERIOD}"));
    }

    fn write(&self, file: &str, text: &str) -> io::Result<()> {
        fs::write(self.folder.join(file), text)
    }
}

impl Drop for PluginCgroup {
    fn drop(&mut self) {
        // Kills all processes that are still in the group, whatever their process group.
        let _ = self.write("cgroup.kill", "1");
        // The kernel removes a group only after its last process is gone. If that takes longer, the
        // next incarnation reuses the group.
        let _ = fs::remove_dir(&self.folder);
    }
}

/// Whether systemd has delegated the control group with this folder. Write access is no evidence:
/// root may write to every group.
fn is_marked(folder: &Path) -> bool {
    DELEGATED.iter().any(|mark| {
        let mut value = [0; 8];
        rustix::fs::getxattr(folder, *mark, &mut value).is_ok_and(|length| value[..length] == *b"1")
    })
}

fn make(folder: &Path) -> io::Result<()> {
    match fs::create_dir(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_that_is_not_delegated_is_left_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let problem = CgroupTree::at(folder.path()).expect_err("it has no controllers");
        assert!(problem.contains("has no `cpu`"), "{problem}");
        let write =
            |file: &str, text: &str| fs::write(folder.path().join(file), text).expect("a file");
        write("cgroup.controllers", "cpuset cpu io memory pids");
        write("cgroup.procs", "1\n2\n");
        let problem = CgroupTree::at(folder.path()).expect_err("it is another's");
        let expected = ["delegated to this daemon", "processes other"];
        assert!(expected.iter().any(|text| problem.contains(text)), "{problem}");
        assert!(!folder.path().join(OWN).exists(), "nothing was made there");
    }

    #[test]
    fn a_tree_is_divided_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let part = folder.path().join(OWN);
        fs::create_dir(&part).expect("made");
        let write =
            |file: &str, text: &str| fs::write(folder.path().join(file), text).expect("a file");
        write("cgroup.procs", "");
        assert_eq!(CgroupTree::divided(&part), None, "nobody has divided it");
        write("cgroup.subtree_control", "cpu memory pids\n");
        assert_eq!(CgroupTree::divided(folder.path()), None, "it is no part");
        let is_root = rustix::process::geteuid().is_root();
        let expected = (!is_root).then(|| CgroupTree(folder.path().to_owned()));
        assert_eq!(CgroupTree::divided(&part), expected, "as root only what systemd has marked");
        write("cgroup.procs", "1\n");
        assert_eq!(CgroupTree::divided(&part), None, "others are in it");
    }

    #[test]
    fn the_usage_of_a_group_is_measured() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("plugin-x");
        fs::create_dir(&path).expect("made");
        let write = |file: &str, text: &str| fs::write(path.join(file), text).expect("a file");
        write("memory.current", "4096\n");
        write("cpu.stat", "usage_usec 2500000\nuser_usec 1\n");
        write("memory.events", "low 0\noom 1\noom_kill 1\n");
        let before = CgroupUsage { memory: 0, cpu: Duration::from_secs(1), ended: 0 };
        let group = PluginCgroup { folder: path.clone(), before };
        let expected = CgroupUsage { memory: 4096, cpu: Duration::from_millis(1_500), ended: 1 };
        assert_eq!(group.measure(), expected);
        let none = PluginCgroup { folder: folder.path().join("none"), before };
        assert_eq!(none.measure(), CgroupUsage::default());
    }

    #[test]
    fn a_reused_group_has_no_processor_limit() {
        let folder = tempfile::tempdir().expect("a folder");
        let tree = CgroupTree(folder.path().to_owned());
        let share = || fs::read_to_string(folder.path().join("plugin-x/cpu.max")).expect("a file");
        let group = tree.group("x", 1 << 20, 8).expect("files can be written there");
        group.slow_down(0.5);
        assert_eq!(share(), "50000 100000");
        drop(group);
        let _again = tree.group("x", 1 << 20, 8).expect("files can be written there");
        assert_eq!(share(), "max 100000");
    }
}
