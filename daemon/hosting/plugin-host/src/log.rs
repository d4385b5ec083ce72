//! Output of a plugin, which is written to a log file of bounded size and to the daemon's log.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::io::{AsyncBufReadExt as _, AsyncRead, AsyncReadExt as _, BufReader};
use tokio::task::JoinHandle;

/// Size in bytes at which a log file is renamed and a new one is begun. The size is enough for one
/// day of a plugin with much output.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Length in bytes at which a line of output is cut.
const LINE_BYTES_MAX: u64 = 4 << 10;
/// Number of lines of output kept per second; further lines are counted and dropped.
const LINES_PER_SECOND_MAX: u32 = 200;
/// Number of last lines of output that are kept in memory, to be added to the reason why a process
/// ended.
const LAST_LINES: usize = 4;

/// Log of a plugin; clones write to the same file.
#[derive(Clone)]
pub(crate) struct PluginLog(Arc<Mutex<LogFile>>);

struct LogFile {
    name: String,
    path: PathBuf,
    file: Option<File>,
    bytes: u64,
    last: VecDeque<String>,
    second: std::time::Instant,
    in_second: u32,
    dropped: u32,
}

impl PluginLog {
    pub(crate) fn new(name: &str, path: PathBuf) -> PluginLog {
        PluginLog(Arc::new(Mutex::new(LogFile {
            name: name.to_owned(),
            path,
            file: None,
            bytes: 0,
            last: VecDeque::new(),
            second: std::time::Instant::now(),
            in_second: 0,
            dropped: 0,
        })))
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.lock().path.clone()
    }

    /// Returns the last line of output that is not blank; `None` if there is none in memory.
    pub(crate) fn last_line(&self) -> Option<String> {
        self.lock().last.iter().rev().find(|line| !line.trim().is_empty()).cloned()
    }

    /// Drops the last lines of output from memory, because they are those of the previous process.
    pub(crate) fn begin(&self) {
        self.lock().last.clear();
    }

    /// Writes the output from a process's pipe into the log until the pipe closes, in a task of its
    /// own. Returns `None` if there is no pipe.
    pub(crate) fn follow(
        &self,
        pipe: Option<impl AsyncRead + Unpin + Send + 'static>,
    ) -> Option<JoinHandle<()>> {
        Some(tokio::spawn(self.clone().record_lines(pipe?)))
    }

    async fn record_lines(self, pipe: impl AsyncRead + Unpin) {
        let mut pipe = BufReader::new(pipe);
        let mut line = Vec::new();
        loop {
            line.clear();
            match (&mut pipe).take(LINE_BYTES_MAX).read_until(b'\n', &mut line).await {
                Ok(0) | Err(_) => return,
                Ok(_) => self.lock().note(String::from_utf8_lossy(&line).trim_end()),
            }
        }
    }

    /// Writes a remark of the host, the daemon that runs the plugin, into the log.
    pub(crate) fn remark(&self, remark: &str) {
        self.lock().note(&format!("[althing] {remark}"));
    }

    fn lock(&self) -> MutexGuard<'_, LogFile> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogFile {
    fn note(&mut self, line: &str) {
        let now = std::time::Instant::now();
        if now.duration_since(self.second).as_secs() >= 1 {
            (self.second, self.in_second) = (now, 0);
            let dropped = std::mem::take(&mut self.dropped);
            if dropped > 0 {
                self.write(&format!("[althing] {dropped} lines left out: too many in one second"));
            }
        }
        self.in_second += 1;
        if self.in_second > LINES_PER_SECOND_MAX {
            self.dropped += 1;
            return;
        }
        // Control characters are replaced, because a terminal would obey them.
        let plain: String = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        tracing::info!(plugin = self.name, "{plain}");
        self.last.push_back(plain.clone());
        self.last.drain(..self.last.len().saturating_sub(LAST_LINES));
        self.write(&plain);
    }

    fn write(&mut self, line: &str) {
        if let Err(error) = self.try_write(line) {
            tracing::debug!(plugin = self.name, %error, "failed to write its output to its log");
        }
    }

    fn try_write(&mut self, line: &str) -> io::Result<()> {
        if self.file.is_none() {
            let file = open(&self.path)?;
            self.bytes = file.metadata()?.len();
            self.file = Some(file);
        }
        if self.bytes > FILE_BYTES_MAX {
            self.file = None;
            std::fs::rename(&self.path, before(&self.path))?;
            self.file = Some(open(&self.path)?);
            self.bytes = 0;
        }
        if let Some(file) = &mut self.file {
            self.bytes += line.len() as u64 + 1;
            writeln!(file, "{line}")?;
        }
        Ok(())
    }
}

/// Opens a log file. A new file can be read by this user alone.
fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new().create(true).append(true).mode(0o600).open(path)
}

/// Returns the path of the previous log file, which holds the lines before those in `path`.
pub(crate) fn before(path: &Path) -> PathBuf {
    path.with_extension("log.1")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_flood_of_output_is_bounded_and_the_last_line_is_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("lamp.log");
        let log = PluginLog::new("lamp", path.clone());
        let flood = "\u{1b}[2Jwarm\n".repeat(5_000);
        log.clone().record_lines(flood.as_bytes()).await;
        let text = std::fs::read_to_string(&path).expect("written");
        assert!(text.lines().count() <= 2 * LINES_PER_SECOND_MAX as usize, "{}", text.len());
        assert!(!text.contains('\u{1b}'), "a terminal would obey it");
        assert_eq!(log.last_line().as_deref(), Some(" [2Jwarm"));
        let long = "x".repeat(1 << 20);
        log.clone().record_lines(long.as_bytes()).await;
        let longest = std::fs::read_to_string(&path).expect("written");
        let longest = longest.lines().map(str::len).max().unwrap_or(0);
        assert!(longest as u64 <= LINE_BYTES_MAX, "{longest}");
    }

    #[test]
    fn logs_are_for_this_user_alone() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("lamp.log");
        let log = PluginLog::new("lamp", path.clone());
        log.lock().write(&"x".repeat(1 << 20));
        log.lock().write("more");
        for path in [before(&path), path] {
            let mode = std::fs::metadata(&path).expect("it is there").permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}", path.display());
        }
    }
}
