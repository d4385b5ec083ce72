//! The log of requests: each with its person, its address, its daemon, and how it ended.
//!
//! The log is two files of JSON lines with a bound. A thread writes them, so that a slow or full disk
//! delays no request; then lines are lost, and their number is written when there is room again.

use std::collections::VecDeque;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::net::IpAddr;
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError, atomic};
use std::thread;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use crate::error::AccountsError;
use crate::person_name::PersonName;

/// Name of the file with the newest requests, in the state folder of a daemon.
const NEWEST: &str = "requests.jsonl";

/// Name of the file with the requests before those.
const OLDER: &str = "requests.1.jsonl";

/// Length from which a file is replaced by a new one, in bytes: twenty thousand requests. There are
/// two files.
const FILE_BYTES_MAX: u64 = 4 << 20;

/// Maximum length of a text in the log, in bytes. A goal of a person is shorter; a longer text is cut.
const TEXT_BYTES_MAX: usize = 2_000;

/// Maximum number of requests that wait for the disk. People ask for some in a second at most.
const WAITING_MAX: usize = 1_024;

/// Maximum number of requests that are kept in memory for pages.
const RECENT_MAX: usize = 1_000;

/// How long the end of a daemon waits for the disk.
const FLUSH_WAIT_MAX: Duration = Duration::from_secs(2);

/// Permissions of the files: they say what people do.
const FILE_MODE: u32 = 0o600;

/// A request of a person or a program, and how it ended. It contains no secret: the text of an answer
/// is never logged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoggedRequest {
    /// Time of the request; in JSON, milliseconds since 1970.
    #[serde(with = "millis")]
    pub at: SystemTime,
    /// Person that asked; `None` if it is not known, such as after a wrong password.
    pub person: Option<PersonName>,
    /// Address from which the request came.
    pub from: IpAddr,
    /// Name of the daemon through which it came.
    pub through: String,
    /// Description of the request.
    pub what: String,
    /// Description of the end: done, or refused and why.
    pub outcome: String,
}

/// The log of requests of one daemon. Recording never waits.
#[derive(Debug)]
pub struct RequestLog {
    recent: Mutex<VecDeque<LoggedRequest>>,
    /// `None` only while the log is dropped.
    lines: Option<SyncSender<String>>,
    lost: Arc<atomic::AtomicU64>,
    /// Closed when the writer has ended.
    ended: Mutex<Receiver<()>>,
}

/// Writes lines to the files.
struct LogWriter {
    folder: PathBuf,
    /// `None` before the first line, and after a failure.
    open: Option<(File, u64)>,
    lost: Arc<atomic::AtomicU64>,
    is_failing: bool,
}

/// Times as milliseconds since 1970.
mod millis {
    use std::time::{Duration, SystemTime, UNIX_EPOCH};

    use serde::{Deserialize as _, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(at: &SystemTime, to: S) -> Result<S::Ok, S::Error> {
        let millis = at.duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
        to.serialize_u64(u64::try_from(millis).unwrap_or(u64::MAX))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(of: D) -> Result<SystemTime, D::Error> {
        let since = Duration::from_millis(u64::deserialize(of)?);
        UNIX_EPOCH.checked_add(since).ok_or_else(|| serde::de::Error::custom("no time of a clock"))
    }
}

/// Returns a text of at most [`TEXT_BYTES_MAX`] bytes.
fn cut(mut text: String) -> String {
    if text.len() > TEXT_BYTES_MAX {
        text.truncate(text.floor_char_boundary(TEXT_BYTES_MAX));
        text.push('…');
    }
    text
}

/// Returns a request as one line. Control characters, and characters that reorder or hide text, are
/// escaped: a terminal that prints the file must not obey them.
fn line(request: &LoggedRequest) -> String {
    // Numbers, names and texts always have a form in JSON.
    let json = serde_json::to_string(request).unwrap_or_default();
    let mut line = String::with_capacity(json.len() + 1);
    for c in json.chars() {
        if is_misleading(c) {
            let mut units = [0; 2];
            line.extend(c.encode_utf16(&mut units).iter().map(|unit| format!("\\u{unit:04x}")));
        } else {
            line.push(c);
        }
    }
    line.push('\n');
    line
}

/// Whether a character is executed by a terminal, is invisible, or changes the order of a text.
fn is_misleading(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}'
            | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e0fff}')
}

/// Returns the requests in a file, oldest first. Lines that are not requests, such as one that a
/// crash has cut, are left out.
fn read_file(path: &Path) -> Result<Vec<LoggedRequest>, AccountsError> {
    let failed = |source| AccountsError::Io { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    match File::open(path) {
        // A file that another program has made longer is read from its end.
        Ok(mut file) => {
            let length = file.metadata().map_err(failed)?.len();
            let from = length.saturating_sub(2 * FILE_BYTES_MAX);
            file.seek(SeekFrom::Start(from)).map_err(failed)?;
            file.take(2 * FILE_BYTES_MAX).read_to_end(&mut bytes).map_err(failed)?;
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(failed(error)),
    }
    let lines = bytes.split(|byte| *byte == b'\n');
    Ok(lines.filter_map(|line| serde_json::from_slice(line).ok()).collect())
}

// === impl RequestLog ===

impl RequestLog {
    /// Opens the log in a folder, which must exist.
    ///
    /// # Errors
    ///
    /// Returns an error if the present log cannot be read, or if the system gives no thread.
    pub fn open(folder: &Path) -> Result<RequestLog, AccountsError> {
        let mut recent = VecDeque::from(RequestLog::read(folder)?);
        recent.drain(..recent.len().saturating_sub(RECENT_MAX));
        let (lines, waiting) = mpsc::sync_channel::<String>(WAITING_MAX);
        let (end, ended) = mpsc::channel();
        let lost = Arc::new(atomic::AtomicU64::new(0));
        let mut writer = LogWriter {
            folder: folder.to_owned(),
            open: None,
            lost: Arc::clone(&lost),
            is_failing: false,
        };
        let work = move || {
            let _end: mpsc::Sender<()> = end;
            while let Ok(line) = waiting.recv() {
                writer.write(&line);
            }
        };
        let started = thread::Builder::new().name("requests".to_owned()).spawn(work);
        started.map_err(|source| AccountsError::Io { path: folder.to_owned(), source })?;
        let (recent, ended) = (Mutex::new(recent), Mutex::new(ended));
        Ok(RequestLog { recent, lines: Some(lines), lost, ended })
    }

    /// Returns all requests in the log of a folder, oldest first.
    ///
    /// # Errors
    ///
    /// Returns an error if a file of the log exists and cannot be read.
    pub fn read(folder: &Path) -> Result<Vec<LoggedRequest>, AccountsError> {
        let mut all = read_file(&folder.join(OLDER))?;
        all.extend(read_file(&folder.join(NEWEST))?);
        Ok(all)
    }

    /// Records a request. Texts that are too long are cut.
    pub fn record(&self, request: LoggedRequest) {
        let LoggedRequest { at, person, from, through, what, outcome } = request;
        let (through, what, outcome) = (cut(through), cut(what), cut(outcome));
        let request = LoggedRequest { at, person, from, through, what, outcome };
        let line = line(&request);
        {
            let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
            if recent.len() >= RECENT_MAX {
                recent.pop_front();
            }
            recent.push_back(request);
        }
        match self.lines.as_ref().map(|lines| lines.try_send(line)) {
            None | Some(Ok(())) => (),
            Some(Err(TrySendError::Full(_) | TrySendError::Disconnected(_))) => {
                self.lost.fetch_add(1, atomic::Ordering::Relaxed);
            }
        }
    }

    /// Returns the newest requests, at most `count` of them, oldest first.
    pub fn recent(&self, count: usize) -> Vec<LoggedRequest> {
        let recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        recent.iter().skip(recent.len().saturating_sub(count)).cloned().collect()
    }
}

impl Drop for RequestLog {
    /// Waits until the lines are written, but not for a disk that hangs.
    fn drop(&mut self) {
        self.lines = None;
        let ended = self.ended.get_mut().unwrap_or_else(PoisonError::into_inner);
        // The error says that the writer has ended, or that the time is over.
        let _ = ended.recv_timeout(FLUSH_WAIT_MAX);
    }
}

// === impl LogWriter ===

impl LogWriter {
    fn write(&mut self, line: &str) {
        let lost = self.lost.swap(0, atomic::Ordering::Relaxed);
        match self.append(line, lost) {
            Ok(()) if self.is_failing => {
                self.is_failing = false;
                tracing::info!(folder = %self.folder.display(), "requests of people are logged again");
            }
            Ok(()) => (),
            Err(error) => {
                self.open = None;
                self.lost.fetch_add(lost + 1, atomic::Ordering::Relaxed);
                // Said once: a full disk must not fill another log.
                if !std::mem::replace(&mut self.is_failing, true) {
                    tracing::error!(
                        folder = %self.folder.display(), %error,
                        "failed to log requests of people; they are carried out all the same"
                    );
                }
            }
        }
    }

    fn append(&mut self, line: &str, lost: u64) -> io::Result<()> {
        let path = self.folder.join(NEWEST);
        let length = line.len() as u64;
        let is_full = |open: &(File, u64)| open.1 > 0 && open.1 + length > FILE_BYTES_MAX;
        if self.open.is_none() {
            self.open = Some(open_log(&path)?);
        }
        if self.open.as_ref().is_some_and(is_full) {
            self.open = None;
            fs::rename(&path, self.folder.join(OLDER))?;
            self.open = Some(open_log(&path)?);
        }
        let Some((file, written)) = &mut self.open else { return Ok(()) };
        let mut text = String::new();
        if lost > 0 {
            // A line that is no request: readers leave it out, and people see it in the file.
            text = format!("{{\"lost\":{lost}}}\n");
        }
        text.push_str(line);
        file.write_all(text.as_bytes())?;
        *written += text.len() as u64;
        Ok(())
    }
}

/// Opens a file of the log to append to it; returns it with its length. Ends a line that a crash has
/// cut.
fn open_log(path: &Path) -> io::Result<(File, u64)> {
    let mut options = OpenOptions::new();
    let mut file = options.read(true).append(true).create(true).mode(FILE_MODE).open(path)?;
    file.set_permissions(Permissions::from_mode(FILE_MODE))?;
    let length = file.metadata()?.len();
    if length > 0 {
        let mut last = [0];
        file.seek(SeekFrom::End(-1))?;
        file.read_exact(&mut last)?;
        if last != *b"\n" {
            file.write_all(b"\n")?;
            return Ok((file, length + 1));
        }
    }
    Ok((file, length))
}
