//! Runs an external program within limits, and cleans up after it.
//!
//! The program runs in a process group of its own. A second process, the *watch*, is a shell that
//! reads from a pipe; only the process of Althing holds the write end. When the process of Althing
//! ends in any way, the kernel closes the pipe, and the watch kills the whole group and removes the
//! folder. A parent death signal (`PR_SET_PDEATHSIG`) is not enough: it reaches the program, but
//! not its child processes. Fast Downward is a driver that starts a translator, then a search.
//!
//! The program starts only after the watch. A shell called the *gate* sets the program's limits and
//! waits for a line, which is sent when the watch runs. The watch does not cover two cases: a
//! program that leaves its process group, and a watch that is killed first.
//!
//! Memory is limited with `ulimit -v` (`RLIMIT_AS`), which every child inherits. The limit applies
//! to each process of the engine, not to their sum. Time is wall-clock time.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use planner::Cancel;
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

/// Command that runs a program, with the folder of the run and its limits.
pub(crate) struct EngineLaunch<'l> {
    /// Path of the program, and its arguments.
    pub(crate) command: &'l [OsString],
    /// Folder in which the program runs. Its standard output and standard error are written to
    /// files in this folder.
    pub(crate) folder: &'l Path,
    /// Time at which a running program is killed; `None` for no limit.
    pub(crate) deadline: Option<Instant>,
    /// Limit on the address space of each process of the program, in bytes; `None` for no limit. A
    /// process that needs more fails to allocate memory.
    pub(crate) memory_limit: Option<u64>,
}

/// Result of a program's run.
pub(crate) struct EngineRun {
    pub(crate) end: EngineEnd,
    /// Standard output of the program, up to [`OUTPUT_MAX`].
    pub(crate) stdout: String,
    /// Standard error of the program, up to [`OUTPUT_MAX`].
    pub(crate) stderr: String,
}

/// Reason why the run of a program ended.
#[derive(Clone, Copy, Debug)]
pub(crate) enum EngineEnd {
    /// The process exited on its own (not killed by a limit).
    Itself(ExitStatus),
    /// The process was killed because its time limit was reached.
    OutOfTime,
    /// The process was killed because the caller cancelled it.
    Cancelled,
}

/// Maximum number of bytes of a program's output that are read: enough for a plan of a hundred
/// thousand steps. The rest of the output is ignored.
const OUTPUT_MAX: u64 = 64 << 20;

/// Interval at which the caller's cancel flag is checked, too short for a person to notice the
/// delay.
const CANCEL_CHECK_INTERVAL: Duration = Duration::from_millis(20);

/// Shell script of the gate: waits for a line, sets the limits, executes the program. `$1` is the
/// memory limit in KiB, or empty.
const START_SCRIPT: &str = "read -r word || exit 125
ulimit -c 0
[ -z \"$1\" ] || ulimit -v \"$1\" || exit 125
shift
exec \"$@\" </dev/null";

/// Shell script of the watch. It waits for a line, which means that there is nothing to clean up,
/// or for the end of the process of Althing. After that end it kills the group `$1` and removes the
/// folder `$2`. If the removal fails, it is repeated once, because a process that was just killed
/// may have written a file meanwhile.
const CLEANUP_SCRIPT: &str = "trap '' HUP INT TERM
read -r word && exit
kill -KILL \"-$1\"
rm -rf \"$2\" || rm -rf \"$2\"";

/// Runs a program until it ends, reaches its deadline, or is cancelled.
pub(crate) fn run(launch: &EngineLaunch<'_>, cancel: &Cancel) -> io::Result<EngineRun> {
    let (stdout, stderr) = (launch.folder.join("stdout"), launch.folder.join("stderr"));
    let (child, gate) = spawn_waiting(launch, File::create(&stdout)?, File::create(&stderr)?)?;
    let mut group = EngineGroup { child, is_reaped: false };
    let watch = CleanupWatch::over(&group, launch.folder)?;
    open(gate);
    let end = await_end(&mut group, launch.deadline, cancel)?;
    watch.dismiss();
    Ok(EngineRun { end, stdout: read(&stdout)?, stderr: read(&stderr)? })
}

fn spawn_waiting(
    launch: &EngineLaunch<'_>,
    stdout: File,
    stderr: File,
) -> io::Result<(Child, Option<ChildStdin>)> {
    let kibibytes = launch.memory_limit.map(|bytes| (bytes / 1024).max(1).to_string());
    let mut child = Command::new("sh")
        .args(["-c", START_SCRIPT, "gate", kibibytes.as_deref().unwrap_or("")])
        .args(launch.command)
        .current_dir(launch.folder)
        .stdin(Stdio::piped())
        .stdout(stdout)
        .stderr(stderr)
        .process_group(0)
        .spawn()?;
    let gate = child.stdin.take();
    Ok((child, gate))
}

/// Opens the gate, which starts the program. A failed write means that the gate has ended; the
/// caller detects this next.
fn open(gate: Option<ChildStdin>) {
    let _ = gate.map(|mut gate| gate.write_all(b"start\n"));
}

fn await_end(
    group: &mut EngineGroup,
    deadline: Option<Instant>,
    cancel: &Cancel,
) -> io::Result<EngineEnd> {
    let ended = group.ended();
    let by_us = loop {
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        if cancel.is_set() {
            break Some(EngineEnd::Cancelled);
        }
        if left.is_some_and(|left| left.is_zero()) {
            break Some(EngineEnd::OutOfTime);
        }
        match ended.recv_timeout(left.unwrap_or(CANCEL_CHECK_INTERVAL).min(CANCEL_CHECK_INTERVAL)) {
            Err(mpsc::RecvTimeoutError::Timeout) => (),
            Ok(()) | Err(mpsc::RecvTimeoutError::Disconnected) => break None,
        }
    };
    let status = group.end()?;
    Ok(by_us.unwrap_or(EngineEnd::Itself(status)))
}

fn read(path: &Path) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(path)?.take(OUTPUT_MAX).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// The process group of a program: the program and all processes that it starts. Dropping this
/// value kills them.
struct EngineGroup {
    /// The leader of the group, which is the program itself. The number of the group cannot be
    /// reused until the leader is reaped.
    child: Child,
    is_reaped: bool,
}

// === impl EngineGroup ===

impl EngineGroup {
    fn pid(&self) -> Option<Pid> {
        Pid::from_raw(i32::try_from(self.child.id()).ok()?)
    }

    /// Returns a channel that receives a message when the group leader has ended. The leader is not
    /// reaped.
    fn ended(&self) -> mpsc::Receiver<()> {
        let (tell, ended) = mpsc::channel();
        let pid = self.pid();
        thread::spawn(move || {
            let unreaped = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT;
            while let Some(pid) = pid
                && waitid(WaitId::Pid(pid), unreaped).is_err_and(|err| err == Errno::INTR)
            {
            }
            let _ = tell.send(());
        });
        ended
    }

    /// Kills all remaining processes of the group, then reaps the group leader.
    fn end(&mut self) -> io::Result<ExitStatus> {
        if let Some(pid) = self.pid()
            && !self.is_reaped
        {
            // This call may fail if only the dead leader is left, which is harmless.
            let _ = kill_process_group(pid, Signal::KILL);
        }
        let status = self.child.wait()?;
        self.is_reaped = true;
        Ok(status)
    }
}

impl Drop for EngineGroup {
    fn drop(&mut self) {
        if !self.is_reaped {
            let _ = self.end();
        }
    }
}

/// The watch: a process that cleans up if the process of Althing ends before the run ends.
struct CleanupWatch {
    child: Child,
    word: Option<ChildStdin>,
}

// === impl CleanupWatch ===

impl CleanupWatch {
    fn over(group: &EngineGroup, folder: &Path) -> io::Result<CleanupWatch> {
        let mut child = Command::new("sh")
            .args(["-c", CLEANUP_SCRIPT, "watch", &group.child.id().to_string()])
            .arg(folder)
            .current_dir("/")
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            // Signals to the group of this process, for example by Ctrl-C, must not reach the
            // watch.
            .process_group(0)
            .spawn()?;
        let word = child.stdin.take();
        Ok(CleanupWatch { child, word })
    }

    /// Ends the watch without cleaning up. Must be called when the group has ended, because its
    /// number may soon be reused.
    fn dismiss(mut self) {
        let _ = self.word.take().map(|mut word| word.write_all(b"well\n"));
        let _ = self.child.wait();
    }
}

impl EngineRun {
    /// Returns the exit code of the program; `None` if it was killed or ended by a signal.
    pub(crate) fn code(&self) -> Option<i32> {
        match self.end {
            EngineEnd::Itself(status) => status.code(),
            EngineEnd::OutOfTime | EngineEnd::Cancelled => None,
        }
    }

    /// Returns the exit code or signal of the program as text for a person.
    pub(crate) fn status(&self) -> String {
        match self.end {
            EngineEnd::Itself(status) => match (status.code(), status.signal()) {
                (Some(code), _) => format!("exit code {code}"),
                (None, Some(signal)) => format!("signal {signal}"),
                (None, None) => status.to_string(),
            },
            EngineEnd::OutOfTime => "a time-out".to_owned(),
            EngineEnd::Cancelled => "a cancellation".to_owned(),
        }
    }

    /// Returns the last line of standard error that is not empty. If there is none, returns that of
    /// standard output.
    pub(crate) fn last_output_line(&self) -> String {
        let last = |text: &str| {
            text.lines().map(str::trim).rfind(|line| !line.is_empty()).map(str::to_owned)
        };
        last(&self.stderr).or_else(|| last(&self.stdout)).unwrap_or_default()
    }

    /// Whether the program's output has a message about lack of memory, in the words of
    /// interpreters, loaders and allocators.
    pub(crate) fn wants_memory(&self) -> bool {
        let complaints = [
            "MemoryError",
            "annot allocate memory",
            "failed to map segment",
            "bad_alloc",
            "NO MEMORY",
            "ut of memory",
        ];
        complaints.iter().any(|one| self.stderr.contains(one) || self.stdout.contains(one))
    }
}
