//! Figures of this process: memory, processor time, threads, open files.

use std::fs;
use std::time::Duration;

use crate::{Kernel, kibibytes};

/// Number of clock ticks in a second in the files of `/proc`: `USER_HZ`, which is part of Linux's
/// interface to programs.
const TICKS_PER_SECOND: u64 = 100;

/// Number of fields of `/proc/self/stat` before the fourteenth, the processor time of the process,
/// without the first two: the process identifier, and the name in parentheses.
const FIELDS_BEFORE_TIME: usize = 11;

/// Number of fields between the processor time, which has two fields, and the start of the process.
const FIELDS_BEFORE_START: usize = 6;

/// Figures of this process; each is `None` if Linux does not report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessFigures {
    /// Memory that the process uses, in bytes (its resident set).
    pub memory_resident: Option<u64>,
    /// Address space of the process, in bytes.
    pub memory_virtual: Option<u64>,
    /// Number of threads.
    pub threads: Option<u64>,
    /// Processor time that all threads have used, in user and system mode.
    pub cpu: Option<Duration>,
    /// Time at which the process started, since the Unix epoch.
    pub started: Option<Duration>,
    /// Number of open files, connections included.
    pub open_files: Option<u64>,
    /// Maximum number of open files.
    pub open_files_max: Option<u64>,
}

/// Returns the figures of this process.
pub fn process_figures() -> ProcessFigures {
    Kernel::default().process_figures()
}

impl Kernel {
    /// Returns the figures of this process, like the function [`process_figures`].
    pub fn process_figures(&self) -> ProcessFigures {
        let status = self.own("status");
        let (cpu, since_boot) = times(&self.own("stat")).unzip();
        let booted = self.booted();
        ProcessFigures {
            memory_resident: kibibytes(&status, "VmRSS:"),
            memory_virtual: kibibytes(&status, "VmSize:"),
            threads: number(&status, "Threads:"),
            cpu,
            started: booted.zip(since_boot).map(|(booted, since)| booted + since),
            open_files: self.open_files(),
            open_files_max: number(&self.own("limits"), "Max open files"),
        }
    }

    /// Returns the text of a file about this process; empty if it cannot be read.
    fn own(&self, name: &str) -> String {
        fs::read_to_string(self.proc.join("self").join(name)).unwrap_or_default()
    }

    /// Returns the time at which the machine was started, since the Unix epoch.
    fn booted(&self) -> Option<Duration> {
        let text = fs::read_to_string(self.proc.join("stat")).ok()?;
        number(&text, "btime ").map(Duration::from_secs)
    }

    fn open_files(&self) -> Option<u64> {
        let listed = fs::read_dir(self.proc.join("self/fd")).ok()?.count();
        // The folder itself is open while it is listed.
        u64::try_from(listed.saturating_sub(1)).ok()
    }
}

/// Returns the processor time of the process, and the time from the start of the machine to that of
/// the process, according to the text of `/proc/self/stat`.
fn times(stat: &str) -> Option<(Duration, Duration)> {
    // The name of the program may contain spaces and parentheses; the fields follow the last one.
    let (_, fields) = stat.rsplit_once(')')?;
    let mut fields = fields.split_whitespace().skip(FIELDS_BEFORE_TIME);
    let mut ticks = || fields.next()?.parse::<u64>().ok();
    let used = ticks()?.checked_add(ticks()?)?;
    let started = fields.nth(FIELDS_BEFORE_START)?.parse().ok()?;
    Some((of_ticks(used), of_ticks(started)))
}

fn of_ticks(ticks: u64) -> Duration {
    Duration::from_millis(ticks.saturating_mul(1_000 / TICKS_PER_SECOND))
}

/// Returns the first number after `key` in the line that begins with it; `None` if there is none,
/// or the line says `unlimited`.
fn number(text: &str, key: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(key))?;
    rest.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAT: &str = "77 (al thing) (x)) S 1 77 77 0 -1 4194560 9 0 0 0 250 50 0 0 20 0 12 0 400 \
                        9999 5 18446744073709551615\n";

    #[test]
    fn the_figures_are_those_that_the_kernel_reports() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        };
        write("self/stat", STAT);
        write("self/status", "Name:\tx\nVmSize:\t    2048 kB\nVmRSS:\t 1024 kB\nThreads:\t12\n");
        write("self/limits", "Limit Soft Hard Units\nMax open files   1024   4096   files\n");
        write("stat", "cpu 1 2 3\nbtime 1000\n");
        for file in ["0", "1", "2", "3"] {
            write(&format!("self/fd/{file}"), "");
        }
        let figures = Kernel::at(folder.path(), folder.path()).process_figures();
        let expected = ProcessFigures {
            memory_resident: Some(1 << 20),
            memory_virtual: Some(2 << 20),
            threads: Some(12),
            cpu: Some(Duration::from_secs(3)),
            started: Some(Duration::from_secs(1_004)),
            open_files: Some(3),
            open_files_max: Some(1_024),
        };
        assert_eq!(figures, expected);
    }

    #[test]
    fn malformed_or_missing_files_give_no_figures() {
        let folder = tempfile::tempdir().expect("a folder");
        let kernel = Kernel::at(folder.path(), folder.path());
        assert_eq!(kernel.process_figures(), ProcessFigures::default());
        for stat in ["", "77 (x", "77 (x) S 1 2", "77 (x) S 1 2 3 4 5 6 7 8 9 10 x y z"] {
            assert_eq!(times(stat), None, "{stat}");
        }
    }

    /// Other tests of this process open and close files meanwhile, so the number has a lower bound
    /// only.
    #[test]
    #[cfg(target_os = "linux")]
    fn this_process_has_open_files_and_has_begun() {
        let held: Vec<_> =
            (0..100).map(|_| fs::File::open("/proc/self/stat").expect("it is there")).collect();
        let figures = process_figures();
        assert!(figures.open_files >= Some(held.len() as u64), "{figures:?}");
        let is_allowed = |max: u64| figures.open_files <= Some(max);
        assert!(figures.open_files_max.is_none_or(is_allowed), "{figures:?}");
        let now = std::time::SystemTime::now();
        let now = now.duration_since(std::time::UNIX_EPOCH).expect("later");
        let age = now.checked_sub(figures.started.expect("told")).expect("it has begun");
        assert!(age < Duration::from_secs(3_600), "{age:?}");
        assert!(figures.threads.expect("told") > 0);
    }
}
