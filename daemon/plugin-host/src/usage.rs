//! What the processes of a plugin take of the machine, as the kernel says.

use std::fs;
use std::time::Duration;

/// Of all processes of a group together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Usage {
    /// Bytes of memory that are in use; what processes share counts for each.
    pub(crate) memory: u64,
    /// Time on a processor so far, of those that live.
    pub(crate) cpu: Duration,
    /// How many there are.
    pub(crate) processes: u32,
}

/// What the processes of a group take now.
pub(crate) fn usage(group: i32) -> Usage {
    let mut usage = Usage::default();
    let Ok(entries) = fs::read_dir("/proc") else { return usage };
    for entry in entries.flatten() {
        let name = entry.file_name();
        if !name.as_encoded_bytes().first().is_some_and(u8::is_ascii_digit) {
            continue;
        }
        let Ok(stat) = fs::read_to_string(entry.path().join("stat")) else { continue };
        if let Some(of) = of_group(&stat, group) {
            usage.memory += of.memory;
            usage.cpu += of.cpu;
            usage.processes += 1;
        }
    }
    usage
}

/// What one process takes by its line of `/proc/PID/stat`, if it is of this group and no corpse.
fn of_group(stat: &str, group: i32) -> Option<Usage> {
    // Its name stands in parentheses, and may have some of its own.
    let (_, rest) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = rest.split_whitespace().collect();
    // Counted from the state, which is the third of all: proc(5).
    let number = |index: usize| fields.get(index)?.parse::<u64>().ok();
    let is_of_it = fields.get(2)?.parse::<i32>().ok()? == group;
    if !is_of_it || matches!(*fields.first()?, "Z" | "X") {
        return None;
    }
    let ticks = number(11)? + number(12)?;
    let per_second = rustix::param::clock_ticks_per_second().max(1);
    Some(Usage {
        memory: number(21)? * rustix::param::page_size() as u64,
        cpu: Duration::from_secs_f64(ticks as f64 / per_second as f64),
        processes: 1,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_read_whatever_a_process_is_called() {
        let line = "42 (a) b) S 1 7 7 0 -1 0 0 0 0 0 150 50 0 0 20 0 1 0 9 8192 3 184467";
        let usage = of_group(line, 7).expect("it is of the group");
        assert_eq!((usage.cpu, usage.processes), (Duration::from_secs(2), 1));
        assert_eq!(usage.memory, 3 * rustix::param::page_size() as u64);
        assert_eq!(of_group(line, 8), None);
        assert_eq!(of_group(&line.replace(" S ", " Z "), 7), None);
        assert_eq!(of_group("nonsense", 7), None);
    }

    #[test]
    fn a_real_group_is_seen() {
        use std::io::{Read as _, Write as _};
        use std::os::unix::process::CommandExt as _;
        use std::process::{Command, Stdio};
        let mut child = Command::new("cat");
        let child = child.stdin(Stdio::piped()).stdout(Stdio::piped()).process_group(0);
        let mut child = child.spawn().expect("it is everywhere");
        // What has answered is loaded: a process that has only begun may hold nothing yet.
        child.stdin.as_mut().expect("piped").write_all(b"!").expect("it listens");
        child.stdout.as_mut().expect("piped").read_exact(&mut [0]).expect("it answers");
        let used = usage(i32::try_from(child.id()).expect("a number of a process"));
        child.kill().expect("our own child");
        child.wait().expect("our own child");
        assert_eq!(used.processes, 1);
        assert!(used.memory > 0);
    }
}
