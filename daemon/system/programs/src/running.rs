//! Programs that stay: started once, spoken to over a socket, and ended with this process.
//!
//! The program runs in a process group of its own. A second process, the *watch*, is a shell that
//! reads from a pipe whose write end only this process holds. When this process ends in any way,
//! the kernel closes the pipe, and the watch kills the group and removes the folder of the program.
//! A parent death signal would reach the program, but not its children. The watch does not cover a
//! program that leaves its process group.

use std::collections::VecDeque;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream as Blocking;
use std::path::Path;
use std::process::Stdio;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt as _};
use tokio::net::UnixStream;
use tokio::process::{Child, ChildStdin, ChildStdout, Command};

use crate::{Program, ProgramError, ProgramGroup, START, last_line};

/// Shell script that gives the program the socket as its file descriptors 3 and 4, and nothing as
/// its input. A descriptor other than the input cannot be passed on without a shell or unsafe code.
const HAND_OVER: &str = "exec \"$@\" 3<&0 4>&0 </dev/null";

/// Shell script of the watch. It waits until its input is closed, which this process does when the
/// program is no longer needed, and the kernel when this process ends. Then it kills the group `$1`
/// and removes the folder `$2`, if there is one. A process that was just killed may have written a
/// file meanwhile, so the removal is repeated once.
const CLEANUP: &str = "trap '' HUP INT TERM
read -r word
kill -KILL \"-$1\"
[ -z \"$2\" ] || rm -rf \"$2\" || rm -rf \"$2\"";

/// Number of bytes of standard error that are kept, the last ones.
const COMPLAINT_BYTES_MAX: usize = 4 << 10;

/// Time for the last words of a program that has ended. Its children may keep the pipe open.
const LAST_WORDS: Duration = Duration::from_millis(100);

/// Time limit of the watch for killing the program and removing its folder, on a slow disk.
const CLEANING_UP: Duration = Duration::from_secs(5);

/// The surroundings of a program that stays.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProgramStart<'s> {
    /// Environment variables of the program, in addition to those of this process.
    pub environment: &'s [(String, String)],
    /// Folder that belongs to this run of the program, and that is removed if this process dies.
    pub scratch: Option<&'s Path>,
    /// Whether the program's standard output is read, with [`RunningProgram::take_output`].
    pub has_output: bool,
}

/// A program that stays. Dropping this value kills the program and its children.
#[derive(Debug)]
pub struct RunningProgram {
    program: String,
    child: Child,
    group: Option<ProgramGroup>,
    watch: Option<(Child, ChildStdin)>,
    words: ProgramWords,
    reading: tokio::task::JoinHandle<()>,
}

/// The last bytes that a program has written to its standard error.
#[derive(Clone, Debug, Default)]
pub struct ProgramWords(Arc<Mutex<VecDeque<u8>>>);

impl ProgramWords {
    /// Returns the last line so far that is not empty, shortened if it is long; `None` if there is
    /// none.
    pub fn last(&self) -> Option<String> {
        last_line(self.bytes().make_contiguous())
    }

    /// Returns the last line so far that contains `part`, shortened if it is long; `None` if there is
    /// none.
    pub fn last_with(&self, part: &str) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes().make_contiguous()).into_owned();
        let line = text.lines().rfind(|line| line.contains(part))?;
        last_line(line.as_bytes())
    }

    fn bytes(&self) -> MutexGuard<'_, VecDeque<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Program {
    /// Starts the program, and returns it with this end of a socket. The program has the other end
    /// as its file descriptors 3 and 4.
    ///
    /// # Errors
    ///
    /// Returns an error if the system cannot start a process. A program that does not exist ends at
    /// once; see [`RunningProgram::ended`].
    pub fn start(
        &self,
        start: ProgramStart<'_>,
    ) -> Result<(RunningProgram, UnixStream), ProgramError> {
        let failed =
            |source| ProgramError::System { what: START, program: self.program.clone(), source };
        let (ours, theirs) = Blocking::pair().map_err(failed)?;
        ours.set_nonblocking(true).map_err(failed)?;
        let ours = UnixStream::from_std(ours).map_err(failed)?;
        let mut command = Command::new("sh");
        command.args(["-c", HAND_OVER, "start", &self.program]).args(&self.arguments);
        command.envs(start.environment.iter().map(|(name, value)| (name, value)));
        let output = if start.has_output { Stdio::piped() } else { Stdio::null() };
        command.stdin(OwnedFd::from(theirs)).stdout(output).stderr(Stdio::piped());
        let mut child = command.kill_on_drop(true).process_group(0).spawn().map_err(failed)?;
        // The command holds the child's end of the socket, which must not stay open here.
        drop(command);
        let group = child.id().map(ProgramGroup);
        let words = ProgramWords::default();
        let reading = tokio::spawn(keep_last(child.stderr.take(), words.clone()));
        let program = self.program.clone();
        let mut running = RunningProgram { program, child, group, watch: None, words, reading };
        running.watch = Some(running.watch(start.scratch).map_err(failed)?);
        Ok((running, ours))
    }
}

impl RunningProgram {
    fn watch(&self, scratch: Option<&Path>) -> std::io::Result<(Child, ChildStdin)> {
        let group = self.group.as_ref().map_or(String::new(), |group| group.0.to_string());
        let mut command = Command::new("sh");
        command.args(["-c", CLEANUP, "watch", &group]).arg(scratch.unwrap_or(Path::new("")));
        command.current_dir("/").stdin(Stdio::piped());
        command.stdout(Stdio::null()).stderr(Stdio::null());
        // Signals to the group of this process, such as that of Ctrl-C, do not reach the watch.
        let mut watch = command.process_group(0).spawn()?;
        let word = watch.stdin.take();
        let word = word.ok_or_else(|| std::io::Error::other("the watch has no input"))?;
        Ok((watch, word))
    }

    /// Returns the program's standard output; `None` if it is not read, or was returned before.
    pub fn take_output(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Returns a handle to what the program writes to its standard error.
    pub fn words(&self) -> ProgramWords {
        self.words.clone()
    }

    /// Waits until the program has ended by itself, and returns how. Nothing is lost if the future
    /// is dropped.
    pub async fn ended(&mut self) -> ProgramError {
        let program = self.program.clone();
        match self.child.wait().await {
            Err(source) => ProgramError::System { what: "wait for", program, source },
            Ok(status) => {
                // The number of the group may be reused once its leader is reaped and no process is
                // left in it; until then, its children are to be killed.
                let _ = tokio::time::timeout(LAST_WORDS, &mut self.reading).await;
                let complaint = self.words.last();
                ProgramError::Failed { program, status, complaint }
            }
        }
    }

    /// Kills the program and its children, removes its folder, and waits until this is done.
    pub async fn end(mut self) {
        // The watch does it. The number of the group cannot be reused meanwhile, because the
        // program is not reaped before.
        if let Some((mut watch, word)) = self.watch.take() {
            drop(word);
            let _ = tokio::time::timeout(CLEANING_UP, watch.wait()).await;
        }
        drop(self.group.take());
        let _ = self.child.wait().await;
    }
}

/// Reads a pipe to its end, and keeps the last bytes.
async fn keep_last(pipe: Option<impl AsyncRead + Unpin>, words: ProgramWords) {
    let Some(mut pipe) = pipe else { return };
    let mut bytes = [0; COMPLAINT_BYTES_MAX];
    while let Ok(count @ 1..) = pipe.read(&mut bytes).await {
        let mut kept = words.bytes();
        kept.extend(bytes.get(..count).unwrap_or_default());
        let surplus = kept.len().saturating_sub(COMPLAINT_BYTES_MAX);
        kept.drain(..surplus);
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncWriteExt as _;

    use super::*;
    use crate::tests::{PATIENCE, all_end, script};

    async fn answer(link: &mut UnixStream) -> String {
        let mut bytes = [0; 64];
        let count = tokio::time::timeout(PATIENCE, link.read(&mut bytes)).await.expect("in time");
        String::from_utf8_lossy(bytes.get(..count.expect("read")).unwrap_or_default()).into_owned()
    }

    #[tokio::test]
    async fn a_program_is_spoken_to_and_ended_with_its_children() {
        let text = "read -r word <&3; sleep 600 & echo \"$word $NAME $$ $!\" >&4; wait";
        let environment = [("NAME".to_owned(), "lamp".to_owned())];
        let start = ProgramStart { environment: &environment, ..ProgramStart::default() };
        let (running, mut link) = script(text).start(start).expect("started");
        link.write_all(b"hello\n").await.expect("written");
        let said = answer(&mut link).await;
        let pids = said.trim().strip_prefix("hello lamp ").expect("the word and the variable");
        let pids = pids.replace(' ', "\n");
        running.end().await;
        all_end(&pids).await;
    }

    #[tokio::test]
    async fn a_program_that_is_dropped_leaves_nothing() {
        let (running, mut link) = script("sleep 600 & echo $! >&4; wait")
            .start(ProgramStart::default())
            .expect("started");
        let pid = answer(&mut link).await;
        drop(running);
        all_end(&pid).await;
    }

    #[tokio::test]
    async fn the_watch_cleans_up_if_this_process_dies() {
        let folder = tempfile::tempdir().expect("a folder");
        let scratch = folder.path().join("profile");
        std::fs::create_dir(&scratch).expect("a folder");
        let start = ProgramStart { scratch: Some(&scratch), ..ProgramStart::default() };
        let text = "sleep 600 & echo $! >&4; wait";
        let (mut running, mut link) = script(text).start(start).expect("started");
        let pid = answer(&mut link).await;
        // The pipe closes without a line, as it does when this process is killed.
        let (mut watch, word) = running.watch.take().expect("a watch");
        drop(word);
        tokio::time::timeout(PATIENCE, watch.wait()).await.expect("in time").expect("it ends");
        all_end(&pid).await;
        assert!(!scratch.exists());
    }

    #[tokio::test]
    async fn the_end_of_a_program_has_a_reason() {
        for (text, expected) in [
            ("echo no display >&2; exit 3", "run `/bin/sh`: exit status: 3: no display"),
            ("kill -9 $$", "run `/bin/sh`: signal: 9 (SIGKILL)"),
        ] {
            let start = ProgramStart::default();
            let (mut running, _link) = script(text).start(start).expect("started");
            let ended = tokio::time::timeout(PATIENCE, running.ended()).await.expect("in time");
            assert_eq!(ended.to_string(), expected);
        }
    }

    #[tokio::test]
    async fn the_output_and_the_last_words_of_a_program_are_read() {
        let start = ProgramStart { has_output: true, ..ProgramStart::default() };
        let text = "echo one; echo two >&2; echo done >&4; read -r word <&3";
        let (mut running, mut link) = script(text).start(start).expect("started");
        let mut output = running.take_output().expect("its output");
        assert!(running.take_output().is_none());
        assert_eq!(answer(&mut link).await, "done\n");
        let mut bytes = [0; 4];
        let read = output.read_exact(&mut bytes);
        tokio::time::timeout(PATIENCE, read).await.expect("in time").expect("read");
        assert_eq!(&bytes, b"one\n");
        let heard = async {
            while running.words().last().as_deref() != Some("two") {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(PATIENCE, heard).await.expect("the last words");
        assert_eq!(running.words().last_with("wo").as_deref(), Some("two"));
        assert_eq!(running.words().last_with("one"), None, "it is on another stream");
        running.end().await;
    }
}
