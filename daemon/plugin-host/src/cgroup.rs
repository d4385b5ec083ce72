//! Control groups (cgroup v2): where the daemon was given a part of their tree (systemd's `Delegate=yes`),
//! each plugin is a group of its own, whose memory, processes and computing the kernel counts and bounds.
//!
//! The kernel lets no group have processes and parts at once, so the daemon itself moves into a part.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Where the tree is mounted.
const ROOT: &str = "/sys/fs/cgroup";
/// What is counted.
const CONTROLLERS: [&str; 3] = ["cpu", "memory", "pids"];
/// The part that the daemon is in.
const OWN: &str = "daemon";
/// Microseconds within which a group's share of a processor is counted: the kernel's own choice.
const PERIOD: u32 = 100_000;
/// How systemd marks a group that it has given away.
const DELEGATED: [&str; 2] = ["user.delegate", "trusted.delegate"];

/// The part of the tree that this daemon was given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Tree(PathBuf);

/// The group of one life of a plugin; dropped, it is removed with all that is in it.
#[derive(Debug)]
pub(crate) struct Group {
    folder: PathBuf,
    /// What a former life in the same group had taken.
    before: Taken,
}

/// What a group has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Taken {
    /// Bytes that it holds, whatever for.
    pub(crate) memory: u64,
    /// Time on a processor, of all processes that were ever in it.
    pub(crate) cpu: Duration,
    /// How often a process was ended because the group held more than it may.
    pub(crate) ended: u64,
}

impl Tree {
    /// Finds the part of this process, and divides it.
    ///
    /// # Errors
    ///
    /// Why it has none; for a person.
    pub(crate) fn find() -> Result<Tree, String> {
        let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
        let own = groups.lines().find_map(|line| line.strip_prefix("0::"));
        let own = own.ok_or("this machine has no control groups of version 2")?;
        let folder = Path::new(ROOT).join(own.trim_start_matches('/'));
        Tree::divided(&folder).map_or_else(|| Tree::at(&folder), Ok)
    }

    /// The tree of which this is the daemon's own part, as it was divided before it began anew.
    fn divided(part: &Path) -> Option<Tree> {
        let folder = part.parent().filter(|_| part.file_name().is_some_and(|name| name == OWN))?;
        let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
        let enabled = read("cgroup.subtree_control");
        let is_divided =
            CONTROLLERS.iter().all(|name| enabled.split_whitespace().any(|it| it == *name));
        // One that another has divided has parts that are not this daemon's to make.
        let is_given = !rustix::process::geteuid().is_root() || is_marked(folder);
        let is_writable = rustix::fs::access(folder, rustix::fs::Access::WRITE_OK).is_ok();
        (is_divided && is_given && is_writable && read("cgroup.procs").trim().is_empty())
            .then(|| Tree(folder.to_owned()))
    }

    fn at(folder: &Path) -> Result<Tree, String> {
        let shown = folder.display();
        let read = |file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
        let known = read("cgroup.controllers");
        let missing =
            CONTROLLERS.iter().find(|name| !known.split_whitespace().any(|it| it == **name));
        if let Some(missing) = missing {
            return Err(format!("the control group {shown} has no `{missing}`"));
        }
        if rustix::process::geteuid().is_root() && !is_marked(folder) {
            return Err(format!(
                "the control group {shown} was not given to this daemon (Delegate=yes)"
            ));
        }
        let own = std::process::id().to_string();
        let others = read("cgroup.procs");
        if others.lines().any(|process| process != own) {
            return Err(format!("the control group {shown} has other processes than this daemon"));
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
                "the control group {shown} was not given to this daemon (Delegate=yes): {error}"
            )
        })?;
        Ok(Tree(folder.to_owned()))
    }

    /// Makes a group for a plugin.
    ///
    /// # Errors
    ///
    /// If the kernel refuses.
    pub(crate) fn group(&self, name: &str, memory: u64, tasks: u64) -> io::Result<Group> {
        let folder = self.0.join(format!("plugin-{name}"));
        make(&folder)?;
        let mut group = Group { folder, before: Taken::default() };
        group.before = Taken { memory: 0, ..group.taken() };
        group.write("memory.max", &memory.to_string())?;
        // Together with memory, what was swapped out would be more than it may hold.
        match group.write("memory.swap.max", "0") {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => (),
        }
        group.write("memory.oom.group", "1")?;
        group.write("pids.max", &tasks.to_string())?;
        // A former life in the same group may have been slowed.
        group.write("cpu.max", &format!("max {PERIOD}"))?;
        Ok(group)
    }
}

impl Group {
    /// Where it is; a process joins it by writing to its `cgroup.procs`.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// What it has taken so far.
    pub(crate) fn taken(&self) -> Taken {
        let number = |file: &str, key: &str| -> u64 {
            let text = fs::read_to_string(self.folder.join(file)).unwrap_or_default();
            let line = text.lines().find_map(|line| match key {
                "" => Some(line),
                key => line.strip_prefix(key),
            });
            line.and_then(|value| value.trim().parse().ok()).unwrap_or(0)
        };
        Taken {
            memory: number("memory.current", ""),
            cpu: Duration::from_micros(number("cpu.stat", "usage_usec "))
                .saturating_sub(self.before.cpu),
            ended: number("memory.events", "oom_kill ").saturating_sub(self.before.ended),
        }
    }

    /// Lets it compute no more than this share of a processor from now on.
    pub(crate) fn slow_down(&self, share: f64) {
        let quota = (share * f64::from(PERIOD)).max(1_000.0).round();
        // Without it, it is slowed by its priority.
        let _ = self.write("cpu.max", &format!("{quota} {PERIOD}"));
    }

    fn write(&self, file: &str, text: &str) -> io::Result<()> {
        fs::write(self.folder.join(file), text)
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        // Whatever is still in it, wherever its process group is.
        let _ = self.write("cgroup.kill", "1");
        // The kernel lets go of a group when its last process is gone; a next life uses it again.
        let _ = fs::remove_dir(&self.folder);
    }
}

/// Whether systemd has given a group away. Root may write anywhere; that says nothing.
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
    fn a_tree_that_nobody_gave_away_is_left_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let problem = Tree::at(folder.path()).expect_err("it has no controllers");
        assert!(problem.contains("has no `cpu`"), "{problem}");
        let write =
            |file: &str, text: &str| fs::write(folder.path().join(file), text).expect("a file");
        write("cgroup.controllers", "cpuset cpu io memory pids");
        write("cgroup.procs", "1\n2\n");
        let problem = Tree::at(folder.path()).expect_err("it is another's");
        assert!(problem.contains("given to this daemon") || problem.contains("other processes"));
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
        assert_eq!(Tree::divided(&part), None, "nobody has divided it");
        write("cgroup.subtree_control", "cpu memory pids\n");
        assert_eq!(Tree::divided(folder.path()), None, "it is no part");
        let is_root = rustix::process::geteuid().is_root();
        let expected = (!is_root).then(|| Tree(folder.path().to_owned()));
        assert_eq!(Tree::divided(&part), expected, "as root only what systemd has marked");
        write("cgroup.procs", "1\n");
        assert_eq!(Tree::divided(&part), None, "others are in it");
    }

    #[test]
    fn what_a_group_has_taken_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("plugin-x");
        fs::create_dir(&path).expect("made");
        let write = |file: &str, text: &str| fs::write(path.join(file), text).expect("a file");
        write("memory.current", "4096\n");
        write("cpu.stat", "usage_usec 2500000\nuser_usec 1\n");
        write("memory.events", "low 0\noom 1\noom_kill 1\n");
        let before = Taken { memory: 0, cpu: Duration::from_secs(1), ended: 0 };
        let group = Group { folder: path.clone(), before };
        let expected = Taken { memory: 4096, cpu: Duration::from_millis(1_500), ended: 1 };
        assert_eq!(group.taken(), expected);
        let none = Group { folder: folder.path().join("none"), before };
        assert_eq!(none.taken(), Taken::default());
    }

    #[test]
    fn a_group_that_is_used_again_is_not_slow_any_more() {
        let folder = tempfile::tempdir().expect("a folder");
        let tree = Tree(folder.path().to_owned());
        let share = || fs::read_to_string(folder.path().join("plugin-x/cpu.max")).expect("a file");
        let group = tree.group("x", 1 << 20, 8).expect("files can be written there");
        group.slow_down(0.5);
        assert_eq!(share(), "50000 100000");
        drop(group);
        let _again = tree.group("x", 1 << 20, 8).expect("files can be written there");
        assert_eq!(share(), "max 100000");
    }
}
