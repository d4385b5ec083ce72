//! The process of a plugin: how it begins, how it ends, and that nothing is left of it.
//!
//! Its standard input is a socket. Before it becomes the program, the process says over it how it is
//! confined, and hands over the calls that this daemon is to answer (`mediator`); afterwards nothing is
//! read from it.
//!
//! It runs in a process group of its own, which it cannot leave. A *watch*, a shell that reads from a
//! pipe whose other end this process alone holds, kills the group when this process ends, however it
//! ends. The program itself is also killed with the thread that has started it, so that none begins
//! unwatched.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream as Blocking;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use seccomp_notify::Listener;
use tokio::io::{AsyncWriteExt as _, Interest};
use tokio::net::UnixStream;
use tokio::process::{Child, ChildStdin, Command};
use tokio::task::JoinHandle;

use crate::confinement::{Confinement, Entered, Means};
use crate::log::Log;
use crate::mediator::Mediator;

/// How long a plugin has to end by itself once it is asked to.
const STOPPING: Duration = Duration::from_secs(2);

/// How long what was printed last may take to be read, once a process has ended.
const LAST_WORDS: Duration = Duration::from_millis(50);

/// How long a process may take to confine itself, on a small and busy board.
const ENTERING: Duration = Duration::from_secs(20);

/// How often a process is started to try out how plugins can be confined.
const PROBES_MAX: u32 = 3;

/// Longest word of a process about its confinement.
const ENTERED_BYTES_MAX: usize = 4 << 10;

/// Waits for the word that all is well, or for the end of whoever was to say it.
const WATCH: &str = "trap '' HUP INT TERM\nread -r word && exit\nkill -KILL \"-$1\"";

/// What this daemon's own program is asked, to become a plugin's: see [`crate::LAUNCH`].
#[derive(Clone, Debug)]
pub struct Launcher(pub PathBuf);

/// What to run, and within what.
pub(crate) struct Launch<'l> {
    pub(crate) launcher: &'l Launcher,
    pub(crate) program: &'l Path,
    pub(crate) arguments: &'l [String],
    /// Variables beside those that every plugin has.
    pub(crate) environment: &'l [(&'static str, OsString)],
    pub(crate) folder: &'l Path,
    /// A folder of its own.
    pub(crate) data: &'l Path,
    pub(crate) confinement: &'l Confinement,
    /// Processes that it may be.
    pub(crate) processes: u32,
    pub(crate) log: &'l Log,
}

/// A plugin's process; dropped, it is killed with all that it has started.
pub(crate) struct Process {
    child: Child,
    group: Group,
    stdin: Option<UnixStream>,
    /// What takes down what it prints.
    words: Vec<JoinHandle<()>>,
    watch: Option<(Child, ChildStdin)>,
}

/// The number of a process group, killed when it is dropped.
struct Group(Option<Pid>);

impl Launcher {
    /// Asks a process of this program what the kernel has to confine plugins with. On a machine that is
    /// too busy to answer it is asked again: without an answer nothing is enforced.
    pub(crate) async fn means(&self, folder: &Path) -> Means {
        let mut why = String::new();
        for _ in 0..PROBES_MAX {
            match self.probe(folder).await {
                Ok(means) => return means,
                Err(error) => why = error,
            }
            tracing::warn!("failed to find out how plugins can be confined: {why}");
        }
        Means::none(&why)
    }

    async fn probe(&self, folder: &Path) -> Result<Means, String> {
        let mut command = Command::new(&self.0);
        command.arg(crate::LAUNCH).arg(crate::PROBE).arg(folder).kill_on_drop(true);
        command.stdin(Stdio::null()).stderr(Stdio::null());
        let said = match tokio::time::timeout(ENTERING, command.output()).await {
            Ok(Ok(output)) => output.stdout,
            Ok(Err(error)) => return Err(format!("it cannot be tried out: {error}")),
            Err(_) => return Err(format!("it is not tried out within {ENTERING:?}")),
        };
        serde_json::from_slice(&said)
            .map_err(|_| "a process that tries it out ends before it can say".to_owned())
    }
}

impl Process {
    /// Starts a process, and waits until it has confined itself or has ended.
    pub(crate) async fn begin(launch: &Launch<'_>) -> io::Result<Process> {
        let confinement = serde_json::to_string(launch.confinement)?;
        let (ours, theirs) = Blocking::pair()?;
        ours.set_nonblocking(true)?;
        let mut command = Command::new(&launch.launcher.0);
        command.arg(crate::LAUNCH).arg(confinement).arg(launch.program).args(launch.arguments);
        command.current_dir(launch.folder).process_group(0).kill_on_drop(true).env_clear();
        let kept = ["LANG", "LC_ALL", "TZ", "ALTHING_LOG"];
        let kept = kept.iter().filter_map(|name| Some((name, std::env::var_os(name)?)));
        command.envs(kept).env("HOME", launch.data).env("TMPDIR", launch.data);
        command.env("PYTHONDONTWRITEBYTECODE", "1").env("PYTHONUNBUFFERED", "1");
        command.envs(launch.environment.iter().map(|(name, value)| (name, value)));
        command.stdin(OwnedFd::from(theirs)).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn()?;
        // It holds the other end of the socket, and must not.
        drop(command);
        let pid = child.id().and_then(|id| Pid::from_raw(i32::try_from(id).ok()?));
        let group = Group(pid);
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let words = [launch.log.follow(stdout), launch.log.follow(stderr)];
        let words = words.into_iter().flatten().collect();
        let stdin = UnixStream::from_std(ours)?;
        let mut process = Process { child, group, stdin: Some(stdin), words, watch: None };
        process.watch = Some(process.watch()?);
        process.entered(launch).await?;
        Ok(process)
    }

    /// Hears how it is confined, and begins to answer its calls. One that cannot confine itself says why
    /// on its standard error, and ends.
    async fn entered(&self, launch: &Launch<'_>) -> io::Result<()> {
        let (Some(stdin), Some(group)) = (&self.stdin, self.group.0) else { return Ok(()) };
        let heard = tokio::time::timeout(ENTERING, hear(stdin)).await;
        let (said, listener) =
            heard.map_err(|_| io::Error::other("it was not confined in time"))??;
        let Some(said) = said else { return Ok(()) };
        let entered: Entered = serde_json::from_slice(&said)?;
        tracing::debug!(?entered, plugin = %launch.folder.display(), "is confined");
        let plan = launch.confinement.plan;
        if plan.is_mediated && listener.is_none() {
            return Err(io::Error::other(
                "it has not passed on the seccomp listener by which the daemon answers its system calls",
            ));
        }
        if let Some(listener) = listener {
            let mediator = Mediator {
                group,
                sockets: launch.confinement.sockets.clone(),
                network: plan.network,
                processes: launch.processes,
            };
            mediator.start(listener)?;
        }
        // Whatever it writes there from now on is heard by nobody.
        rustix::net::shutdown(stdin.as_fd(), rustix::net::Shutdown::Read)?;
        Ok(())
    }

    fn watch(&self) -> io::Result<(Child, ChildStdin)> {
        let mut command = Command::new("sh");
        command.args(["-c", WATCH, "watch", &self.id().to_string()]).current_dir("/");
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        // What is sent to our group, as Ctrl-C is, is not for the watch.
        let mut watch = command.process_group(0).spawn()?;
        let word = watch.stdin.take().ok_or_else(|| io::Error::other("a pipe was asked for"))?;
        Ok((watch, word))
    }

    /// Its process group, which is the number of the process too.
    pub(crate) fn id(&self) -> i32 {
        self.group.0.map_or(0, |pid| pid.as_raw_nonzero().get())
    }

    /// Says something on its standard input, which stays open.
    pub(crate) async fn say(&mut self, line: &str) -> io::Result<()> {
        match &mut self.stdin {
            Some(stdin) => {
                stdin.write_all(line.as_bytes()).await?;
                stdin.write_all(b"\n").await?;
                stdin.flush().await
            }
            None => Ok(()),
        }
    }

    /// Waits until it has ended by itself.
    pub(crate) async fn ended(&mut self) -> io::Result<ExitStatus> {
        // Its standard input is not the child's any more, and so stays open.
        let status = self.child.wait().await;
        // What it has started may hold its pipes, and goes on.
        let words = async {
            while let Some(words) = self.words.pop() {
                let _ = words.await;
            }
        };
        let _ = tokio::time::timeout(LAST_WORDS, words).await;
        status
    }

    /// Asks it to end, waits a while, and ends it and all that it has started.
    pub(crate) async fn stop(mut self) {
        self.stdin = None;
        if let Some(group) = self.group.0 {
            let _ = kill_process_group(group, Signal::TERM);
        }
        let _ = tokio::time::timeout(STOPPING, self.child.wait()).await;
        self.end().await;
    }

    /// Ends it and all that it has started, at once.
    pub(crate) async fn end(mut self) {
        self.group.kill();
        let _ = self.child.wait().await;
        self.group.0 = None;
        if let Some((mut watch, mut word)) = self.watch.take() {
            // All is well: the group is gone, and its number may soon be another's.
            let _ = word.write_all(b"well\n").await;
            drop(word);
            let _ = watch.wait().await;
        }
    }
}

impl Group {
    fn kill(&self) {
        if let Some(pid) = self.0 {
            // Where nobody is left, there is nothing to be done.
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        self.kill();
    }
}

/// What a process says before it becomes a program; nothing if it has ended.
async fn hear(stdin: &UnixStream) -> io::Result<(Option<Vec<u8>>, Option<Listener>)> {
    let mut buffer = vec![0; ENTERED_BYTES_MAX];
    let (length, listener) = stdin
        .async_io(Interest::READABLE, || seccomp_notify::receive(stdin.as_fd(), &mut buffer))
        .await?;
    buffer.truncate(length);
    Ok(((length > 0).then_some(buffer), listener))
}

/// How a process has ended, for a person.
pub(crate) fn ending(status: io::Result<ExitStatus>) -> String {
    match status {
        Ok(status) => match (status.code(), status.signal()) {
            (Some(code), _) => format!("it ended by itself with exit code {code}"),
            (None, Some(signal)) => format!("it was ended by signal {signal}"),
            (None, None) => format!("it ended: {status}"),
        },
        Err(error) => format!("it cannot be waited for: {error}"),
    }
}
