//! Running of external programs, such as those that measure or switch, with limits of time and
//! output.
//!
//! - No shell is used: the program and its arguments are taken literally.
//! - A program and all processes that it has started are killed when the time limit is over, or
//!   when the caller drops the future. Processes that the program leaves behind when it ends are
//!   killed too.
//! - Output of a program beyond 64 KiB is not read.
//! - [`RunningProgram`] is a program that stays, and that this process speaks to.

mod running;

pub use running::{ProgramStart, ProgramWords, RunningProgram};

use std::io;
use std::path::Path;
use std::pin::pin;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt as _};
use tokio::process::Command;

/// Maximum length of a program's output, in bytes; a program that prints more is an error.
const OUTPUT_BYTES_MAX: usize = 64 << 10;

/// Maximum length of a line of a program's standard error in an error message, in characters; the
/// rest is cut off.
const ERROR_CHARS_MAX: usize = 160;

/// Name of the operation, in an error message, if a program could not be started.
const START: &str = "run";

/// A program and the arguments that it is run with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    program: String,
    arguments: Vec<String>,
}

/// Reason why running a program failed. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// The program could not be started, or its output could not be read.
    #[error("{what} `{program}`: {source}")]
    System {
        /// Operation on the program that failed.
        what: &'static str,
        /// Name of the program.
        program: String,
        /// Error of the system.
        source: io::Error,
    },
    /// The program did not end in time, and was killed.
    #[error("wait for `{program}`: it did not end within {within:?} and was killed")]
    TimedOut {
        /// Name of the program that was killed.
        program: String,
        /// Time within which the program had to end.
        within: Duration,
    },
    /// The program printed more than 64 KiB.
    #[error("read the output of `{program}`: it prints more than {} KiB", OUTPUT_BYTES_MAX >> 10)]
    TooMuch {
        /// Name of the program that printed too much.
        program: String,
    },
    /// The program ended with an exit code other than 0, or by a signal.
    #[error("run `{program}`: {status}{}", complaint.as_ref().map(|said| format!(": {said}")).unwrap_or_default())]
    Failed {
        /// Name of the program that failed.
        program: String,
        /// Exit code of the program, or the signal that ended it.
        status: ExitStatus,
        /// Last line of the program's standard error, if there is one.
        complaint: Option<String>,
    },
}

impl ProgramError {
    /// Whether the program was started and did not end by itself. How far it came is then unknown.
    pub fn is_cut_short(&self) -> bool {
        match self {
            ProgramError::System { what, .. } => *what != START,
            ProgramError::TimedOut { .. } | ProgramError::TooMuch { .. } => true,
            // A program that a signal has ended has no exit code.
            ProgramError::Failed { status, .. } => status.code().is_none(),
        }
    }
}

/// Whether there is a program of this name: a file of this path if it has a `/`, otherwise a file in
/// a folder of `PATH`.
pub fn is_installed(name: &str) -> bool {
    if name.contains('/') {
        return Path::new(name).is_file();
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| folder.join(name).is_file())
}

impl Program {
    /// Takes the first element of `list` as the program, and the others as its arguments. Returns
    /// `None` if the list or its first element is empty.
    pub fn of(list: impl IntoIterator<Item = String>) -> Option<Program> {
        let mut list = list.into_iter();
        let program = list.next().filter(|program| !program.is_empty())?;
        Some(Program { program, arguments: list.collect() })
    }

    /// Returns the name of the program, without the arguments.
    pub fn name(&self) -> &str {
        &self.program
    }

    /// Runs the program and returns its standard output. Dropping the future kills the program.
    ///
    /// # Errors
    ///
    /// Returns an error if the program cannot be started, does not end in time, prints too much, or
    /// fails.
    pub async fn run(&self, time_out: Duration) -> Result<String, ProgramError> {
        let running = tokio::time::timeout(time_out, self.run_to_end());
        running.await.unwrap_or_else(|_| {
            Err(ProgramError::TimedOut { program: self.program.clone(), within: time_out })
        })
    }

    async fn run_to_end(&self) -> Result<String, ProgramError> {
        let program = || self.program.clone();
        let failed = |what: &'static str| {
            move |source| ProgramError::System { what, program: program(), source }
        };
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).stdin(Stdio::null()).stdout(Stdio::piped());
        command.stderr(Stdio::piped()).kill_on_drop(true).process_group(0);
        let mut child = command.spawn().map_err(failed(START))?;
        let mut group = child.id().map(ProgramGroup);
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let mut printed = pin!(async { tokio::join!(read(stdout), read(stderr)) });
        let (status, (text, complaint)) = tokio::select! {
            status = child.wait() => {
                // Processes that the program leaves behind keep its pipes open.
                drop(group.take());
                (status, printed.await)
            }
            printed = &mut printed => {
                if printed.0.as_ref().is_ok_and(|text| text.len() > OUTPUT_BYTES_MAX) {
                    return Err(ProgramError::TooMuch { program: program() });
                }
                (child.wait().await, printed)
            }
        };
        let text = text.map_err(failed("read the output of"))?;
        if text.len() > OUTPUT_BYTES_MAX {
            return Err(ProgramError::TooMuch { program: program() });
        }
        let status = status.map_err(failed("wait for"))?;
        if !status.success() {
            let complaint = last_line(&complaint.unwrap_or_default());
            return Err(ProgramError::Failed { program: program(), status, complaint });
        }
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}

/// Reads the output of a program from a pipe, up to one byte beyond the limit; then closes the
/// pipe. Without a pipe, returns no bytes.
async fn read(pipe: Option<impl AsyncRead + Unpin>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if let Some(pipe) = pipe {
        pipe.take(OUTPUT_BYTES_MAX as u64 + 1).read_to_end(&mut bytes).await?;
    }
    Ok(bytes)
}

/// Returns the last line that is not empty, shortened if it is long: this line usually states the
/// error, and the lines above it state the context. Returns `None` if there is no such line.
fn last_line(complaint: &[u8]) -> Option<String> {
    let complaint = String::from_utf8_lossy(complaint);
    let line = complaint.lines().map(str::trim).rfind(|line| !line.is_empty())?;
    let mut told: String = line.chars().take(ERROR_CHARS_MAX).collect();
    if told.len() < line.len() {
        told.push('…');
    }
    Some(told)
}

/// Process group of a running program; the group is killed when this value is dropped.
#[derive(Debug)]
struct ProgramGroup(u32);

impl Drop for ProgramGroup {
    fn drop(&mut self) {
        if let Some(group) = i32::try_from(self.0).ok().and_then(rustix::process::Pid::from_raw) {
            // The call fails if all processes have ended.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

    fn program(list: &[&str]) -> Program {
        Program::of(list.iter().map(|&word| word.to_owned())).expect("a program")
    }

    pub(crate) fn script(text: &str) -> Program {
        program(&["/bin/sh", "-c", text])
    }

    async fn problem(program: Program, time_out: Duration) -> String {
        program.run(time_out).await.expect_err("it fails").to_string()
    }

    #[tokio::test]
    async fn arguments_are_taken_literally() {
        let printed = program(&["printf", "%s|", "$HOME; *", ""]).run(PATIENCE).await;
        assert_eq!(printed.ok().as_deref(), Some("$HOME; *||"));
        assert!(is_installed("sh") && is_installed("/bin/sh"));
        assert!(!is_installed("no-such-program") && !is_installed("/bin"));
        assert_eq!(Program::of([]), None);
        assert_eq!(Program::of([String::new(), "x".to_owned()]), None);
    }

    #[tokio::test]
    async fn a_failure_has_a_reason() {
        let long = format!("echo {} >&2; exit 1", "x".repeat(500));
        for (script, expected) in [
            ("exit 3", "run `/bin/sh`: exit status: 3"),
            (
                "echo at line 4 >&2; echo no bulb >&2; echo >&2; exit 1",
                "run `/bin/sh`: exit status: 1: no bulb",
            ),
            ("kill -9 $$", "run `/bin/sh`: signal: 9 (SIGKILL)"),
            (&long, &format!("run `/bin/sh`: exit status: 1: {}…", "x".repeat(ERROR_CHARS_MAX))),
        ] {
            assert_eq!(problem(self::script(script), PATIENCE).await, expected, "{script}");
        }
        let nobody = problem(program(&["/no/such/program"]), PATIENCE).await;
        assert!(nobody.starts_with("run `/no/such/program`: No such file"), "{nobody}");
    }

    #[tokio::test]
    async fn output_beyond_the_limit_is_not_read() {
        let said = "read the output of `yes`: it prints more than 64 KiB";
        assert_eq!(problem(program(&["yes", "12"]), PATIENCE).await, said);
        // A program that writes to a closed pipe is ended by the system.
        let complains = problem(script("yes it is broken >&2; exit 5"), PATIENCE).await;
        assert!(complains.starts_with("run `/bin/sh`: exit status: 5: i"), "{complains}");
    }

    #[tokio::test]
    async fn the_longest_output_is_read_whole() {
        let prints = |bytes: usize| script(&format!("head -c {bytes} /dev/zero"));
        let text = prints(OUTPUT_BYTES_MAX).run(PATIENCE).await.expect("it is short enough");
        assert_eq!(text.len(), OUTPUT_BYTES_MAX);
        let said = problem(prints(OUTPUT_BYTES_MAX + 1), PATIENCE).await;
        assert_eq!(said, "read the output of `/bin/sh`: it prints more than 64 KiB");
    }

    /// Whether a process with this id exists and is no zombie.
    fn lives(pid: &str) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
    }

    pub(crate) async fn all_end(pids: &str) {
        let ended = async {
            while pids.lines().any(lives) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(PATIENCE, ended).await.expect("all are ended");
    }

    #[tokio::test]
    async fn a_program_that_hangs_is_killed_with_its_children() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("pids");
        let text = format!("sleep 600 & echo $! > {0}; echo $$ >> {0}; wait", file.display());
        let said = problem(script(&text), Duration::from_millis(500)).await;
        assert_eq!(said, "wait for `/bin/sh`: it did not end within 500ms and was killed");
        let pids = std::fs::read_to_string(&file).expect("it has begun");
        assert_eq!(pids.lines().count(), 2);
        all_end(&pids).await;
    }

    #[tokio::test]
    async fn a_child_that_keeps_the_pipes_delays_nothing() {
        let text = "sleep 600 & echo $!";
        let pids = script(text).run(PATIENCE).await.expect("it ends well");
        all_end(&pids).await;
        let text = "sleep 600 & echo no bulb >&2; exit 4";
        let said = problem(script(text), PATIENCE).await;
        assert_eq!(said, "run `/bin/sh`: exit status: 4: no bulb");
    }

    #[tokio::test]
    async fn the_children_of_a_successful_program_are_killed() {
        let text = "sleep 600 > /dev/null 2>&1 & echo $!";
        let pids = script(text).run(PATIENCE).await.expect("it ends well");
        all_end(&pids).await;
    }
}
