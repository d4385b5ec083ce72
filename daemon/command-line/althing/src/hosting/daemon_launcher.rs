//! Starts daemons of an ecosystem as processes of their own, which end with this process.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use acl::DaemonId;
use agent::Mode;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};

use super::{READY, socket_in};
use crate::config;

/// How long a process may take until it is ready. On an idle machine a process takes less than 0.2
/// s.
const READY_WITHIN: Duration = Duration::from_secs(30);

/// Starts `althing up` for some daemons. They share a folder for their sockets and their state.
pub(crate) struct DaemonLauncher {
    path: PathBuf,
    folder: PathBuf,
    mode: Mode,
    /// Whether what the daemons write to stderr goes to files in the folder.
    logs_to_files: bool,
}

impl DaemonLauncher {
    /// Creates a launcher of this program.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the program's own file is not found.
    pub(crate) fn new(folder: &Path, mode: Mode) -> Result<DaemonLauncher, String> {
        let path = std::env::current_exe()
            .map_err(|error| format!("failed to find this program to start it again: {error}"))?;
        Ok(DaemonLauncher { path, folder: folder.to_owned(), mode, logs_to_files: false })
    }

    /// Sends what the daemons write to stderr to files in the folder. If a daemon does not start, the
    /// error has what it has written.
    pub(crate) fn logging_to_files(self) -> DaemonLauncher {
        DaemonLauncher { logs_to_files: true, ..self }
    }

    fn log(&self, daemon: &str) -> PathBuf {
        self.folder.join(format!("{daemon}.log"))
    }

    /// Starts one `althing up` per daemon, each with its ecosystem file, and waits until all are
    /// ready. Returns the name of each daemon with its process.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if a daemon does not start or is not ready in time.
    pub(crate) async fn spawn_all(
        &self,
        daemons: impl IntoIterator<Item = (&DaemonId, &Path)>,
    ) -> Result<Vec<(String, Child)>, String> {
        let mut processes = Vec::new();
        for (daemon, file) in daemons {
            processes.push((daemon.to_string(), self.spawn(daemon, file)?));
        }
        for (daemon, child) in &mut processes {
            let ready = tokio::time::timeout(READY_WITHIN, until_ready(child)).await;
            ready
                .map_err(|_| format!("daemon `{daemon}` was not ready within {READY_WITHIN:?}"))?
                .map_err(|problem| {
                    let log = std::fs::read_to_string(self.log(daemon)).unwrap_or_default();
                    format!("daemon `{daemon}` {problem}\n{}", log.trim())
                })?;
        }
        Ok(processes)
    }

    fn spawn(&self, daemon: &DaemonId, file: &Path) -> Result<Child, String> {
        let mode = match self.mode {
            Mode::Centralized => "centralized",
            Mode::Decentralized => "decentralized",
        };
        let mut command = Command::new(&self.path);
        for setting in config::variables().keys() {
            command.env_remove(setting);
        }
        if self.logs_to_files {
            let log = std::fs::File::create(self.log(daemon.as_str()));
            let log = log.map_err(|error| format!("failed to make a log: {error}"))?;
            command.stderr(log);
        }
        command
            .arg("up")
            .arg(file)
            .args(["--daemon", daemon.as_str(), "--mode", mode, "--until-stdin-ends"])
            .env("ALTHING_RUNTIME_DIR", &self.folder)
            .env("ALTHING_STATE_DIR", self.folder.join("state"))
            // The pipe stays open as long as this process runs. When this process ends in any way,
            // the pipe closes and the daemons end too.
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .map_err(|error| format!("failed to start daemon `{daemon}`: {error}"))
    }
}

/// Ends daemons that [`DaemonLauncher::spawn_all`] has started.
pub(crate) async fn end_daemons(processes: &mut Vec<(String, Child)>) {
    for (_, mut child) in processes.drain(..) {
        // These are child processes, ended by their handles; some may have been killed before.
        let _ = child.start_kill();
        let _ = child.wait().await;
    }
}

/// Returns the Zenoh endpoint that is the socket of a daemon.
///
/// # Errors
///
/// Returns an error, as text for a person, if the path of the socket is too long.
pub(crate) fn socket_endpoint(folder: &Path, daemon: &str) -> Result<String, String> {
    let path = socket_in(folder, daemon).map_err(|error| format!("failed to {error}"))?;
    Ok(format!("unixsock-stream/{}", path.display()))
}

/// Reads the output of a daemon until it reports that it is ready. A task then reads and discards
/// the later output, so that the daemon never blocks on writing it.
async fn until_ready(child: &mut Child) -> Result<(), String> {
    let stdout = child.stdout.take().ok_or("has no output")?;
    let mut lines = BufReader::new(stdout).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        if line.contains(READY) {
            tokio::spawn(async move { while let Ok(Some(_)) = lines.next_line().await {} });
            return Ok(());
        }
    }
    let status = child.wait().await.map_err(|error| error.to_string())?;
    Err(format!("ended with {status} before it was ready"))
}
