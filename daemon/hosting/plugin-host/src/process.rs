//! The process of a plugin: starting the process, and ending it together with all its descendants.
//!
//! The standard input of the process is a socket. Before the process becomes the plugin's program,
//! it reports its confinement over that socket, and passes the seccomp listener for the system
//! calls that this daemon answers (`mediator`). Afterwards the daemon only writes to the socket.
//!
//! The process runs in a process group of its own, which it cannot leave. A *watch* kills the group
//! when the daemon ends, for whatever reason. The watch is a shell that reads from a pipe, and only
//! the daemon has the other end of the pipe open. The kernel also kills the process when the thread
//! that started it ends, so that no plugin starts without a watch.

use std::ffi::OsString;
use std::io;
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream as Blocking;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use seccomp_notify::NotifyListener;
use tokio::io::{AsyncWriteExt as _, Interest};
use tokio::net::UnixStream;
use tokio::process::{Child, ChildStdin, Command};
use tokio::task::JoinHandle;

use crate::confinement::{Confinement, ConfinementMeans, ConfinementReport};
use crate::log::PluginLog;
use crate::mediator::CallMediator;

/// Time that a plugin has to end by itself after the daemon has requested its end.
const STOPPING: Duration = Duration::from_secs(2);

/// Maximum time for reading the last output of a process after its end. Output that is not read by
/// then is lost.
const LAST_WORDS: Duration = Duration::from_millis(50);

/// Maximum time for a process to confine itself, on a small and busy board. After this time,
/// starting the process has failed.
const ENTERING: Duration = Duration::from_secs(20);

/// Maximum number of attempts to start the process that tries out the means of confinement. If all
/// attempts fail, plugins are not confined.
const PROBES_MAX: u32 = 3;

/// Maximum length of a process's report about its confinement, in bytes. A longer report is cut
/// off, and cannot be parsed.
const ENTERED_BYTES_MAX: usize = 4 << 10;

/// Shell script of the *watch*, the process that kills a plugin's process group when the daemon
/// ends. The script exits without killing if a line arrives on its standard input. The script kills
/// the group if the input is closed without a line.
const CLEANUP_SCRIPT: &str = "trap '' HUP INT TERM\nread -r word && exit\nkill -KILL \"-$1\"";

/// Path of this daemon's own program, which is started to become the program of a plugin; see
/// [`crate::LAUNCH`].
#[derive(Clone, Debug)]
pub struct Launcher(pub PathBuf);

/// Program to start, and the environment and limits of its process.
pub(crate) struct ProcessLaunch<'l> {
    pub(crate) launcher: &'l Launcher,
    pub(crate) program: &'l Path,
    pub(crate) arguments: &'l [String],
    /// Names and values of environment variables of the process, in addition to those that every
    /// plugin has.
    pub(crate) environment: &'l [(&'static str, OsString)],
    pub(crate) folder: &'l Path,
    /// Data folder of the plugin.
    pub(crate) data: &'l Path,
    pub(crate) confinement: &'l Confinement,
    /// Limit of the number of processes of the plugin.
    pub(crate) processes: u32,
    pub(crate) log: &'l PluginLog,
}

/// Running process of a plugin. When this value is dropped, the process and all its descendants are
/// killed.
pub(crate) struct PluginProcess {
    child: Child,
    group: KilledGroup,
    stdin: Option<UnixStream>,
    /// Tasks that read the standard output and standard error of the process into the plugin's log.
    words: Vec<JoinHandle<()>>,
    watch: Option<(Child, ChildStdin)>,
}

/// Process group of a plugin, which is killed on drop; `None` after the group has ended.
struct KilledGroup(Option<Pid>);

impl Launcher {
    /// Starts a process of the daemon's own program that tries out the means of confinement. If the
    /// machine is too busy to answer, the attempt is repeated, up to [`PROBES_MAX`] attempts in
    /// total. If all attempts fail, nothing can be enforced.
    pub(crate) async fn means(&self, folder: &Path) -> ConfinementMeans {
        let mut why = String::new();
        for _ in 0..PROBES_MAX {
            match self.probe(folder).await {
                Ok(means) => return means,
                Err(error) => why = error,
            }
            tracing::warn!("failed to find out how plugins can be confined: {why}");
        }
        ConfinementMeans::none(&why)
    }

    async fn probe(&self, folder: &Path) -> Result<ConfinementMeans, String> {
        let mut command = Command::new(&self.0);
        command.arg(crate::LAUNCH).arg(crate::PROBE).arg(folder).kill_on_drop(true);
        command.stdin(Stdio::null()).stderr(Stdio::null());
        let said = match tokio::time::timeout(ENTERING, command.output()).await {
            Ok(Ok(output)) => output.stdout,
            Ok(Err(error)) => return Err(format!("the test process cannot be started: {error}")),
            Err(_) => return Err(format!("the test process does not answer within {ENTERING:?}")),
        };
        serde_json::from_slice(&said)
            .map_err(|_| "the test process ended without an answer".to_owned())
    }
}

impl PluginProcess {
    /// Starts the process of a plugin, and waits until the process has confined itself or has
    /// ended.
    pub(crate) async fn begin(launch: &ProcessLaunch<'_>) -> io::Result<PluginProcess> {
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
        // The command holds the child's end of the socket, which the parent must not keep open.
        drop(command);
        let pid = child.id().and_then(|id| Pid::from_raw(i32::try_from(id).ok()?));
        let group = KilledGroup(pid);
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let words = [launch.log.follow(stdout), launch.log.follow(stderr)];
        let words = words.into_iter().flatten().collect();
        let stdin = UnixStream::from_std(ours)?;
        let mut process = PluginProcess { child, group, stdin: Some(stdin), words, watch: None };
        process.watch = Some(process.watch()?);
        process.entered(launch).await?;
        Ok(process)
    }

    /// Receives the report of the process about its confinement, and starts to answer the system
    /// calls of the process. A process that cannot confine itself writes the reason to its standard
    /// error and ends; this is not an error here.
    async fn entered(&self, launch: &ProcessLaunch<'_>) -> io::Result<()> {
        let (Some(stdin), Some(group)) = (&self.stdin, self.group.0) else { return Ok(()) };
        let heard = tokio::time::timeout(ENTERING, receive_report(stdin)).await;
        let (said, listener) =
            heard.map_err(|_| io::Error::other("it was not confined in time"))??;
        let Some(said) = said else { return Ok(()) };
        let entered: ConfinementReport = serde_json::from_slice(&said)?;
        tracing::debug!(?entered, plugin = %launch.folder.display(), "is confined");
        let plan = launch.confinement.plan;
        if plan.is_mediated && listener.is_none() {
            return Err(io::Error::other(
                "it has not passed on the seccomp listener by which the daemon answers its system calls",
            ));
        }
        if let Some(listener) = listener {
            let mediator = CallMediator {
                group,
                sockets: launch.confinement.sockets.clone(),
                network: plan.network,
                processes: launch.processes,
            };
            mediator.start(listener)?;
        }
        // Data that the process writes to the socket from now on is ignored.
        rustix::net::shutdown(stdin.as_fd(), rustix::net::Shutdown::Read)?;
        Ok(())
    }

    fn watch(&self) -> io::Result<(Child, ChildStdin)> {
        let mut command = Command::new("sh");
        command.args(["-c", CLEANUP_SCRIPT, "watch", &self.id().to_string()]).current_dir("/");
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        // The watch has a process group of its own: signals to the daemon's group, such as that of
        // Ctrl-C, do not reach the watch.
        let mut watch = command.process_group(0).spawn()?;
        let no_pipe = || io::Error::other("the watch has no standard input");
        let word = watch.stdin.take().ok_or_else(no_pipe)?;
        Ok((watch, word))
    }

    /// Returns the number of the process group, which is also the id of the plugin's first process.
    pub(crate) fn id(&self) -> i32 {
        self.group.0.map_or(0, |pid| pid.as_raw_nonzero().get())
    }

    /// Writes a line to the standard input of the process, and leaves the input open.
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

    /// Waits until the process has ended by itself.
    pub(crate) async fn ended(&mut self) -> io::Result<ExitStatus> {
        // `stdin` was not taken from the child, so waiting does not close it.
        let status = self.child.wait().await;
        // Descendants of the process may keep its pipes open, so the time for reading them is
        // bounded.
        let words = async {
            while let Some(words) = self.words.pop() {
                let _ = words.await;
            }
        };
        let _ = tokio::time::timeout(LAST_WORDS, words).await;
        status
    }

    /// Requests the end of the process with `SIGTERM`, waits up to [`STOPPING`], and then kills the
    /// process and all its descendants.
    pub(crate) async fn stop(mut self) {
        self.stdin = None;
        if let Some(group) = self.group.0 {
            let _ = kill_process_group(group, Signal::TERM);
        }
        let _ = tokio::time::timeout(STOPPING, self.child.wait()).await;
        self.end().await;
    }

    /// Kills the process and all its descendants at once.
    pub(crate) async fn end(mut self) {
        self.group.kill();
        let _ = self.child.wait().await;
        self.group.0 = None;
        if let Some((mut watch, mut word)) = self.watch.take() {
            // Makes the watch exit, because the group has ended, and the system may soon reuse its
            // number.
            let _ = word.write_all(b"well\n").await;
            drop(word);
            let _ = watch.wait().await;
        }
    }
}

impl KilledGroup {
    fn kill(&self) {
        if let Some(pid) = self.0 {
            // An error means that no process is left in the group.
            let _ = kill_process_group(pid, Signal::KILL);
        }
    }
}

impl Drop for KilledGroup {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Reads the report about the confinement that a process sends before it becomes the plugin's
/// program. The report is `None` if the process has ended; the listener is `None` if none was
/// passed.
async fn receive_report(
    stdin: &UnixStream,
) -> io::Result<(Option<Vec<u8>>, Option<NotifyListener>)> {
    let mut buffer = vec![0; ENTERED_BYTES_MAX];
    let (length, listener) = stdin
        .async_io(Interest::READABLE, || seccomp_notify::receive(stdin.as_fd(), &mut buffer))
        .await?;
    buffer.truncate(length);
    Ok(((length > 0).then_some(buffer), listener))
}

/// Describes how a process ended, for a person.
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
