//! Resources that the processes of a plugin take, read from `/proc`.
//!
//! All processes of the plugin's process group count, also ended processes until their parents have
//! waited for them. If the plugin has no control group (`cgroup`), this is the only measurement of
//! its resources.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::buffers;

/// Maximum number of files in a plugin's data folder that are counted; the count stops there.
pub(crate) const FILES_MAX: u64 = 10_000;

/// Number of bytes in one of the blocks that `stat` counts.
const BLOCK: u64 = 512;

/// Maximum length of a file of `/proc` that is read, in bytes. A process can make some of its files
/// arbitrarily long. Even a program with thousands of libraries and threads needs only a tenth of
/// this limit.
const TEXT_BYTES_MAX: u64 = 4 << 20;

/// Resources that all processes of a process group take together.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct GroupUsage {
    /// Bytes of memory of all processes that are in use, swapped out, or used for page tables.
    /// Memory that processes share counts once for each of them.
    pub(crate) memory: u64,
    /// Number of processes, including ended processes until their parents have waited for them.
    pub(crate) processes: u32,
    /// Number of threads of all processes of the group.
    pub(crate) threads: u32,
    /// Processor time that each existing process has taken so far, by process id and start time. A
    /// reused process id has another start time.
    pub(crate) cpu: BTreeMap<(i32, u64), CpuTime>,
}

/// Processor time of one process and of its children.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CpuTime {
    pub(crate) own: Duration,
    /// Processor time of ended children that the process has waited for.
    pub(crate) children: Duration,
}

/// Disk space and number of the files that a plugin keeps.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct DiskUsage {
    /// Bytes on disk, including removed files that are still open.
    pub(crate) bytes: u64,
    /// Number of files and folders on disk, counted up to [`FILES_MAX`].
    pub(crate) files: u64,
    /// Number of descriptors in messages that are not received yet. The size of the files behind
    /// them cannot be measured.
    pub(crate) in_flight: u64,
    /// The first file or folder that cannot be read, with the reason, for a person. If there is
    /// one, the count is incomplete. `None` if everything can be read.
    pub(crate) hides: Option<String>,
}

impl DiskUsage {
    /// Records that a file or folder cannot be read. Only the first one is kept.
    fn hide(&mut self, what: impl FnOnce() -> String, error: &io::Error) {
        self.hides.get_or_insert_with(|| format!("{} cannot be read: {error}", what()));
    }
}

/// Measures the resources of the processes in a process group. With `counts_buffers`, memory in the
/// buffers of their sockets and pipes is included.
pub(crate) fn usage(group: i32, counts_buffers: bool) -> GroupUsage {
    let mut usage = GroupUsage::default();
    for (process, stat) in processes_of(group) {
        usage.processes += 1;
        usage.threads += stat.threads;
        usage.cpu.insert((process, stat.began), stat.spent);
        let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
        usage.memory += memory(&status);
    }
    if counts_buffers {
        usage.memory += buffers::memory(usage.cpu.keys().map(|(process, _)| *process));
    }
    usage
}

/// Whether a process or a thread belongs to a process group; `None` if there is no such process.
pub(crate) fn is_of_group(process: i32, group: i32) -> Option<bool> {
    // `rustix::process::getpgid` does not support processes without a group, such as process 1.
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    Some(of_group(&stat, group).is_some())
}

/// Returns the number of processes in a process group.
pub(crate) fn processes(group: i32) -> u32 {
    u32::try_from(processes_of(group).count()).unwrap_or(u32::MAX)
}

impl GroupUsage {
    /// Returns the processor time that the group has spent since `before`: the time of the
    /// processes that exist now, and of ended processes if their parents have waited for them.
    pub(crate) fn spent_since(&self, before: &GroupUsage) -> Duration {
        let all = |usage: &GroupUsage| -> Duration {
            usage.cpu.values().map(|spent| spent.own + spent.children).sum()
        };
        // When a parent waits for a child, the child's time is added to the parent's, so that the
        // sum does not shrink. The time of a child without a waiting parent is lost; then at least
        // the time of the other processes is counted.
        let together = all(self).saturating_sub(all(before));
        let each = self.cpu.iter().map(|(process, spent)| {
            let known = before.cpu.get(process).copied().unwrap_or_default();
            spent.own.saturating_sub(known.own)
        });
        together.max(each.sum())
    }
}

struct ProcessStat {
    threads: u32,
    began: u64,
    spent: CpuTime,
}

fn processes_of(group: i32) -> impl Iterator<Item = (i32, ProcessStat)> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(move |entry| {
        let process = entry.file_name().to_str()?.parse::<i32>().ok()?;
        let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
        Some((process, of_group(&stat, group)?))
    })
}

/// Parses the line of `/proc/PID/stat` of one process; returns `None` if the process belongs to
/// another group.
fn of_group(stat: &str, group: i32) -> Option<ProcessStat> {
    // The name of the program is in parentheses, and may itself contain parentheses.
    let (_, rest) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = rest.split_whitespace().collect();
    // Fields are counted from the state, which is the third field in proc(5).
    let number = |index: usize| fields.get(index)?.parse::<u64>().ok();
    if fields.get(2)?.parse::<i32>().ok()? != group {
        return None;
    }
    let per_second = rustix::param::clock_ticks_per_second().max(1) as f64;
    let time = |ticks: u64| Duration::from_secs_f64(ticks as f64 / per_second);
    Some(ProcessStat {
        threads: number(17)?.try_into().unwrap_or(u32::MAX),
        began: number(19)?,
        spent: CpuTime {
            own: time(number(11)? + number(12)?),
            children: time(number(13)? + number(14)?),
        },
    })
}

/// Returns the bytes of memory in the text of `/proc/PID/status`; 0 for a process that has ended.
fn memory(status: &str) -> u64 {
    let field = |name: &str| -> u64 {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let number = line.and_then(|line| line.trim().strip_suffix("kB"));
        number.and_then(|number| number.trim().parse::<u64>().ok()).unwrap_or(0) << 10
    };
    field("VmRSS:") + field("VmSwap:") + field("VmPTE:")
}

/// Reads a file of `/proc`.
///
/// # Errors
///
/// Returns an error if the file cannot be read, or is longer than [`TEXT_BYTES_MAX`].
pub(crate) fn read_text(path: &Path) -> io::Result<String> {
    let mut text = Vec::new();
    let length = File::open(path)?.take(TEXT_BYTES_MAX + 1).read_to_end(&mut text)?;
    if length as u64 > TEXT_BYTES_MAX {
        let mebibytes = TEXT_BYTES_MAX >> 20;
        return Err(io::Error::other(format!("it is longer than {mebibytes} MiB")));
    }
    // Paths of files may contain any bytes.
    Ok(String::from_utf8_lossy(&text).into_owned())
}

/// Measures the disk space of a plugin's files: those in its data folder `home`, and removed files
/// that the processes of `group` still have open or mapped. `file_max` is the maximum size of one
/// file, in bytes.
pub(crate) fn measure_disk(home: &Path, group: i32, file_max: u64) -> DiskUsage {
    let mut kept = DiskUsage::default();
    let mut folders = vec![home.to_owned()];
    while let Some(folder) = folders.pop() {
        if let Err(error) = count_folder(&folder, &mut kept, &mut folders)
            && error.kind() != io::ErrorKind::NotFound
        {
            kept.hide(|| format!("its folder {}", shortened(&folder)), &error);
        }
        if kept.files >= FILES_MAX {
            return kept;
        }
    }
    removed(home, group, file_max, &mut kept);
    match buffers::in_flight(processes_of(group).map(|(process, _)| process)) {
        Ok(count) => kept.in_flight = count,
        Err((process, error)) if !has_ended(process) => {
            kept.hide(|| format!("the list of open files of its process {process}"), &error);
        }
        // The process has ended in the meantime; the next measurement counts again.
        Err(_) => (),
    }
    kept
}

/// Adds the files in one folder to the count `kept`, and the subfolders to `folders`.
fn count_folder(folder: &Path, kept: &mut DiskUsage, folders: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let metadata = match entry.metadata() {
            // The file was removed in the meantime.
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            metadata => metadata?,
        };
        kept.files += 1;
        kept.bytes += metadata.blocks() * BLOCK;
        if kept.files >= FILES_MAX {
            return Ok(());
        }
        if metadata.is_dir() {
            folders.push(entry.path());
        }
    }
    Ok(())
}

/// Shortens a path for a message, because a plugin can make the paths in its data folder
/// arbitrarily long.
fn shortened(path: &Path) -> String {
    let shown = path.display().to_string();
    match shown.char_indices().nth(200) {
        Some((end, _)) => format!("{}…", &shown[..end]),
        None => shown,
    }
}

/// Adds removed files that processes of the group still have open or mapped to the count `kept`.
fn removed(home: &Path, group: i32, file_max: u64, kept: &mut DiskUsage) {
    let is_removed = |path: &Path| {
        path.starts_with(home) && path.as_os_str().as_encoded_bytes().ends_with(b" (deleted)")
    };
    let mut known = BTreeSet::new();
    for (process, _) in processes_of(group) {
        if let Err(error) = count_open(process, &is_removed, &mut known, kept)
            && !has_ended(process)
        {
            kept.hide(|| format!("the list of open files of its process {process}"), &error);
        }
    }
    for (process, _) in processes_of(group) {
        let maps = match read_text(Path::new(&format!("/proc/{process}/maps"))) {
            Ok(maps) => maps,
            Err(_) if has_ended(process) => continue,
            Err(error) => {
                kept.hide(|| format!("the list of mapped files of its process {process}"), &error);
                continue;
            }
        };
        for line in maps.lines() {
            // The size of a removed file that is only mapped cannot be read, so the maximum size is
            // counted.
            let mut fields = line.split_whitespace();
            let inode = fields.nth(4).and_then(|inode| inode.parse().ok());
            let path = fields.collect::<Vec<_>>().join(" ");
            if let Some(inode) = inode.filter(|_| is_removed(Path::new(&path)))
                && known.insert(inode)
            {
                kept.bytes += file_max;
            }
        }
    }
}

/// Counts the removed files that one process has open, except those in `known`.
fn count_open(
    process: i32,
    is_removed: &impl Fn(&Path) -> bool,
    known: &mut BTreeSet<u64>,
    kept: &mut DiskUsage,
) -> io::Result<()> {
    for entry in fs::read_dir(format!("/proc/{process}/fd"))? {
        let path = entry?.path();
        let open = fs::read_link(&path).and_then(|link| match is_removed(&link) {
            true => fs::metadata(&path).map(Some),
            false => Ok(None),
        });
        match open {
            Ok(Some(metadata)) if known.insert(metadata.ino()) => {
                kept.bytes += metadata.blocks() * BLOCK;
            }
            Ok(_) => (),
            // The file was closed in the meantime.
            Err(error) if error.kind() == io::ErrorKind::NotFound => (),
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Whether a process has ended and holds no files. The check is needed because the kernel returns
/// the same error for an ended process as for a process that forbids inspection.
fn has_ended(process: i32) -> bool {
    fs::read_to_string(format!("/proc/{process}/stat")).map_or(true, |stat| is_ended(&stat))
}

/// Whether a line of `/proc/PID/stat` belongs to a process that has ended completely. After the end
/// of its first thread, a process still holds files while other threads run.
fn is_ended(stat: &str) -> bool {
    let Some((_, rest)) = stat.rsplit_once(')') else { return false };
    let fields: Vec<&str> = rest.split_whitespace().collect();
    let has_ended = matches!(fields.first(), Some(&("Z" | "X")));
    let threads = fields.get(17).and_then(|threads| threads.parse::<u64>().ok());
    has_ended && threads.is_some_and(|threads| threads <= 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stat_line_is_parsed_for_any_process_name() {
        let line = "42 (a) b) S 1 7 7 0 -1 0 0 0 0 0 150 50 100 300 20 0 3 0 9 8192 3 184467";
        let stat = of_group(line, 7).expect("it is of the group");
        let expected = CpuTime { own: Duration::from_secs(2), children: Duration::from_secs(4) };
        assert_eq!((stat.spent, stat.threads, stat.began), (expected, 3, 9));
        assert!(of_group(line, 8).is_none());
        assert!(of_group(&line.replace(" S ", " Z "), 7).is_some(), "its number is taken");
        assert!(of_group("nonsense", 7).is_none());
        assert!(!is_ended(line), "it lives");
        assert!(!is_ended(&line.replace(" S ", " Z ")), "two of its threads live");
        assert!(is_ended(&line.replace(" S ", " Z ").replace(" 3 0 9 ", " 1 0 9 ")));
        let status = "Name:\tx\nVmRSS:\t    2048 kB\nVmPTE:\t  4 kB\nVmSwap:\t 1024 kB\n";
        assert_eq!(memory(status), (3 << 20) + (4 << 10));
    }

    #[test]
    fn time_is_neither_lost_with_a_child_nor_counted_twice() {
        let usage = |processes: &[(i32, u64, u64)]| GroupUsage {
            cpu: processes
                .iter()
                .map(|(process, own, children)| {
                    let (own, children) =
                        (Duration::from_secs(*own), Duration::from_secs(*children));
                    ((*process, 0), CpuTime { own, children })
                })
                .collect(),
            ..GroupUsage::default()
        };
        let spent = |before: &[_], after: &[_]| usage(after).spent_since(&usage(before)).as_secs();
        assert_eq!(spent(&[(1, 5, 0), (2, 3, 0)], &[(1, 6, 4)]), 2, "waited for: 1 s more of each");
        assert_eq!(spent(&[(1, 5, 0), (2, 3, 0)], &[(1, 6, 0), (3, 2, 0)]), 3, "nobody waited");
        assert_eq!(spent(&[], &[(1, 1, 0)]), 1);
        assert_eq!(spent(&[(1, 1, 0)], &[]), 0);
    }

    #[test]
    fn a_real_process_group_is_measured_with_its_files() {
        use std::io::{Read as _, Write as _};
        use std::os::unix::process::CommandExt as _;
        use std::process::{Command, Stdio};
        let home = tempfile::tempdir().expect("a folder");
        let mut child = Command::new("sh");
        // The file is removed while it is still open. Afterwards the script answers over its pipe.
        let script = "exec 3> gone; head -c 65536 /dev/zero >&3; rm gone; head -c 4096 /dev/zero > here; exec cat";
        let child = child.args(["-c", script]).current_dir(home.path());
        let child = child.stdin(Stdio::piped()).stdout(Stdio::piped()).process_group(0);
        let mut child = child.spawn().expect("it is everywhere");
        // The answer shows that the program is loaded. A process that has only just started may use
        // no memory yet.
        child.stdin.as_mut().expect("piped").write_all(b"!").expect("it listens");
        child.stdout.as_mut().expect("piped").read_exact(&mut [0]).expect("it answers");
        let group = i32::try_from(child.id()).expect("a number of a process");
        let (used, kept) = (usage(group, true), measure_disk(home.path(), group, 1 << 20));
        let others = processes(group);
        child.kill().expect("our own child");
        child.wait().expect("our own child");
        assert_eq!((used.processes, used.threads, others), (1, 1, 1));
        assert!(used.memory > 0);
        assert!(kept.bytes >= 65_536 + 4_096, "{kept:?}");
        assert_eq!((kept.files, kept.hides), (1, None));
    }
    #[test]
    fn a_folder_that_cannot_be_read_is_reported() {
        use rustix::fs::{Mode, OFlags, mkdirat, openat};
        let home = tempfile::tempdir().expect("a folder");
        assert_eq!(measure_disk(home.path(), i32::MAX, 1).hides, None);
        // Nested folders, until the path is longer than the kernel accepts. Permissions would not
        // stop root.
        let name = "x".repeat(250);
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let mut folder = rustix::fs::open(home.path(), flags, Mode::empty()).expect("a folder");
        for _ in 0..20 {
            mkdirat(&folder, &name, Mode::RWXU).expect("a folder");
            folder = openat(&folder, &name, flags, Mode::empty()).expect("a folder");
        }
        let kept = measure_disk(home.path(), i32::MAX, 1);
        let hides = kept.hides.expect("not all of it can be read");
        assert!(hides.contains("cannot be read: ") && hides.len() < 500, "{hides}");
        let gone = super::measure_disk(&home.path().join("gone"), i32::MAX, 1);
        assert_eq!(gone, DiskUsage::default(), "nothing is kept in what is not there");
    }

    #[test]
    fn a_text_that_is_too_long_is_an_error() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("text");
        let file = File::create(&path).expect("a file");
        file.set_len(TEXT_BYTES_MAX).expect("a length");
        assert_eq!(read_text(&path).expect("short enough").len() as u64, TEXT_BYTES_MAX);
        file.set_len(TEXT_BYTES_MAX + 1).expect("a length");
        assert!(read_text(&path).expect_err("too long").to_string().contains("4 MiB"));
        assert_eq!(read_text(&path.join("no")).ok(), None);
        fs::write(&path, b"/home/\xff (deleted)").expect("a file");
        assert!(read_text(&path).expect("any bytes").ends_with(" (deleted)"));
    }
}
