//! Programs of other people, that measure or switch: run with arguments, and heard to a bound.
//!
//! - No shell: the program and its arguments are what somebody wrote, letter by letter.
//! - It is killed with all that it started when its time is over, or when nobody waits for it any
//!   more. Who ends well leaves nobody behind either.
//! - What it prints beyond a bound is not read.

use std::io;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt as _};
use tokio::process::Command;

/// So much of what a program prints is read.
const OUTPUT_BYTES_MAX: usize = 64 << 10;

/// So much of a program's last complaint is told.
const TOLD_CHARS: usize = 160;

/// A program and its arguments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    program: String,
    arguments: Vec<String>,
}

/// Why a program did not end well. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// It could not be begun, or not be listened to.
    #[error("{what} `{program}`: {source}")]
    System {
        /// What could not be done.
        what: &'static str,
        /// The program.
        program: String,
        /// What the system says.
        source: io::Error,
    },
    /// Its time was over.
    #[error("hear from `{program}` within {within:?}: it was ended")]
    TimedOut {
        /// The program.
        program: String,
        /// How long it had.
        within: Duration,
    },
    /// It printed more than anybody reads.
    #[error("read more than {} KiB, which `{program}` prints", OUTPUT_BYTES_MAX >> 10)]
    TooMuch {
        /// The program.
        program: String,
    },
    /// It says itself that it failed.
    #[error("run `{program}`: {status}{}", complaint.as_ref().map(|said| format!(": {said}")).unwrap_or_default())]
    Failed {
        /// The program.
        program: String,
        /// How it ended.
        status: ExitStatus,
        /// The last line of what it said of that.
        complaint: Option<String>,
    },
}

impl Program {
    /// The program at the head of a list, with the arguments that follow; `None` if there is none.
    pub fn of(list: impl IntoIterator<Item = String>) -> Option<Program> {
        let mut list = list.into_iter();
        let program = list.next().filter(|program| !program.is_empty())?;
        Some(Program { program, arguments: list.collect() })
    }

    /// The program, without its arguments.
    pub fn name(&self) -> &str {
        &self.program
    }

    /// Runs it; what it prints, if it ends well and in time. Whoever drops this ends it.
    ///
    /// # Errors
    ///
    /// If it cannot be begun, does not end in time, prints too much, or says that it failed.
    pub async fn run(&self, time_out: Duration) -> Result<String, ProgramError> {
        let running = tokio::time::timeout(time_out, self.printed());
        running.await.unwrap_or_else(|_| {
            Err(ProgramError::TimedOut { program: self.program.clone(), within: time_out })
        })
    }

    async fn printed(&self) -> Result<String, ProgramError> {
        let program = || self.program.clone();
        let failed = |what: &'static str| {
            move |source| ProgramError::System { what, program: program(), source }
        };
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).stdin(Stdio::null()).stdout(Stdio::piped());
        command.stderr(Stdio::piped()).kill_on_drop(true).process_group(0);
        let mut child = command.spawn().map_err(failed("run"))?;
        let _group = child.id().map(Group);
        let (text, complaint) = tokio::join!(read(child.stdout.take()), read(child.stderr.take()));
        let text = text.map_err(failed("read what is printed by"))?;
        if text.len() >= OUTPUT_BYTES_MAX {
            return Err(ProgramError::TooMuch { program: program() });
        }
        let status = child.wait().await.map_err(failed("wait for"))?;
        if !status.success() {
            let complaint = last_line(&complaint.unwrap_or_default());
            return Err(ProgramError::Failed { program: program(), status, complaint });
        }
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}

/// What comes through a pipe until it ends, or to the bound. Then it is closed.
async fn read(pipe: Option<impl AsyncRead + Unpin>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if let Some(pipe) = pipe {
        pipe.take(OUTPUT_BYTES_MAX as u64).read_to_end(&mut bytes).await?;
    }
    Ok(bytes)
}

/// The last line that says anything: above it programs tell how they came there.
fn last_line(complaint: &[u8]) -> Option<String> {
    let complaint = String::from_utf8_lossy(complaint);
    let line = complaint.lines().map(str::trim).rfind(|line| !line.is_empty())?;
    let mut told: String = line.chars().take(TOLD_CHARS).collect();
    if told.len() < line.len() {
        told.push('…');
    }
    Some(told)
}

/// The processes of a program that is running; ended when it is dropped.
struct Group(u32);

impl Drop for Group {
    fn drop(&mut self) {
        if let Some(group) = i32::try_from(self.0).ok().and_then(rustix::process::Pid::from_raw) {
            // Nobody is left where all have ended.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(20);

    fn program(list: &[&str]) -> Program {
        Program::of(list.iter().map(|&word| word.to_owned())).expect("a program")
    }

    fn script(text: &str) -> Program {
        program(&["/bin/sh", "-c", text])
    }

    async fn problem(program: Program, time_out: Duration) -> String {
        program.run(time_out).await.expect_err("it fails").to_string()
    }

    #[tokio::test]
    async fn what_is_written_is_run_letter_by_letter() {
        let printed = program(&["printf", "%s|", "$HOME; *", ""]).run(PATIENCE).await;
        assert_eq!(printed.ok().as_deref(), Some("$HOME; *||"));
        assert_eq!(Program::of([]), None);
        assert_eq!(Program::of([String::new(), "x".to_owned()]), None);
    }

    #[tokio::test]
    async fn who_fails_gives_a_reason() {
        let long = format!("echo {} >&2; exit 1", "x".repeat(500));
        for (script, expected) in [
            ("exit 3", "run `/bin/sh`: exit status: 3"),
            (
                "echo at line 4 >&2; echo no bulb >&2; echo >&2; exit 1",
                "run `/bin/sh`: exit status: 1: no bulb",
            ),
            ("kill -9 $$", "run `/bin/sh`: signal: 9 (SIGKILL)"),
            (&long, &format!("run `/bin/sh`: exit status: 1: {}…", "x".repeat(TOLD_CHARS))),
        ] {
            assert_eq!(problem(self::script(script), PATIENCE).await, expected, "{script}");
        }
        let nobody = problem(program(&["/no/such/program"]), PATIENCE).await;
        assert!(nobody.starts_with("run `/no/such/program`: No such file"), "{nobody}");
    }

    #[tokio::test]
    async fn who_floods_is_read_to_a_bound() {
        let said = "read more than 64 KiB, which `yes` prints";
        assert_eq!(problem(program(&["yes", "12"]), PATIENCE).await, said);
        // Whom nobody listens to any more cannot go on complaining.
        let complains = problem(script("yes it is broken >&2; exit 5"), PATIENCE).await;
        assert!(complains.starts_with("run `/bin/sh`: exit status: 5: i"), "{complains}");
    }

    /// Whether a process of this id lives, and is no corpse.
    fn lives(pid: &str) -> bool {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
    }

    async fn all_end(pids: &str) {
        let ended = async {
            while pids.lines().any(lives) {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(PATIENCE, ended).await.expect("all are ended");
    }

    #[tokio::test]
    async fn who_hangs_is_ended_with_all_it_has_started() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("pids");
        let text = format!("sleep 600 & echo $! > {0}; echo $$ >> {0}; wait", file.display());
        let said = problem(script(&text), Duration::from_millis(500)).await;
        assert_eq!(said, "hear from `/bin/sh` within 500ms: it was ended");
        let pids = std::fs::read_to_string(&file).expect("it has begun");
        assert_eq!(pids.lines().count(), 2);
        all_end(&pids).await;
    }

    #[tokio::test]
    async fn who_ends_well_leaves_nobody_behind() {
        let text = "sleep 600 > /dev/null 2>&1 & echo $!";
        let pids = script(text).run(PATIENCE).await.expect("it ends well");
        all_end(&pids).await;
    }
}
