//! `althing watch --record`: records the messages of an ecosystem, each as one line of JSON, for
//! `althing replay` and for later inspection.
//!
//! A recording is a text of lines. The first line is a [`Header`], each other line is a message
//! ([`Recorded`]), without the answers of people. Messages are written as they arrive. If writing
//! stops at any point, all lines that are complete by then can be read.

use std::fs::{File, OpenOptions, Permissions};
use std::io::{self, BufRead as _, BufReader, BufWriter, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};

use acl::{EcosystemId, Message};
use bytes::Bytes;
use live_view::redact;
use serde::{Deserialize, Serialize};
use terminal::{exit, output};
use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

use super::WAITING_MAX;
use crate::commands::brief;
use crate::commands::client::{self, ClientTarget};
use crate::interruption;

/// The version of the format of recordings.
const VERSION: u32 = 1;

/// Maximum length of a line of a recording, in bytes; a longer line is counted as unread. A message
/// has at most 4 MiB, and becomes a little longer as JSON within JSON.
const LINE_BYTES_MAX: usize = 16 << 20;

/// The first line of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Header {
    /// The version of the recording's format.
    pub(crate) recording: u32,
    /// The name of the recorded ecosystem.
    pub(crate) ecosystem: EcosystemId,
    /// Time at which the recording began, in milliseconds since the Unix epoch; `None` in a
    /// recording of an older program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) began_ms: Option<u64>,
}

/// One message of a recording, with the time of its receipt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Recorded {
    /// Time at which the message was received, in milliseconds since the recording began.
    pub(crate) at_ms: u64,
    /// The key expression to which the message was sent.
    pub(crate) key: String,
    /// The message, without the answers of people.
    pub(crate) message: Message,
}

/// A recording that was read from a file.
#[derive(Clone, Debug)]
pub(crate) struct Recording {
    pub(crate) header: Header,
    pub(crate) messages: Vec<Recorded>,
    /// Number of lines that could not be read as messages, such as the last line of a recording
    /// that was cut off.
    pub(crate) unread: usize,
}

/// The reason why a recording cannot be read. The message completes the sentence “failed to …”.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RecordingError {
    /// The file cannot be read.
    #[error("read `{}`: {}", path.display(), terminal::report::reason(source))]
    Io {
        /// Path of the file that cannot be read.
        path: PathBuf,
        /// The error that the operating system reports.
        #[source]
        source: io::Error,
    },
    /// The file is not a recording.
    #[error("read `{}`: its first line is not that of a recording; `althing watch --record` makes one", path.display())]
    NoRecording {
        /// Path of the file that is not a recording.
        path: PathBuf,
    },
    /// The recording has a version that this program cannot read.
    #[error("read `{}`: it is of version {version}, and only {VERSION} is known here", path.display())]
    Version {
        /// Path of the recording.
        path: PathBuf,
        /// The version that the recording has.
        version: u32,
    },
}

/// A message as it was received.
pub(crate) struct ReceivedMessage {
    at: Instant,
    /// The key expression to which the message was sent.
    key: String,
    payload: Bytes,
}

/// Writes a recording until the file has reached its maximum size.
pub(crate) struct Recorder {
    file: BufWriter<File>,
    began: Instant,
    left: u64,
    written: u64,
    /// Number of received messages that could not be decoded.
    unread: u64,
    /// Number of messages that were dropped because they arrived faster than they could be written.
    missed: Arc<AtomicU64>,
}

/// Records messages until Ctrl-C, or until the file has reached its maximum size.
pub(super) fn run(
    target: &ClientTarget,
    conversation: Option<String>,
    file: &Path,
    megabytes: u64,
) -> ExitCode {
    let opened = Recorder::create(file, &target.name, megabytes << 20);
    let mut recorder = match opened {
        Ok(recorder) => recorder,
        Err(error) => {
            output::print_note(&not_written(file, &error));
            return exit::with(exit::OUTPUT);
        }
    };
    crate::commands::in_runtime(async move {
        let ended = tokio::select! {
            ended = record(target, conversation, &mut recorder) => ended,
            _ = interruption::interrupted() => Ok(()),
        };
        recorder.tell(file);
        match ended {
            Ok(()) => exit::with(exit::DONE),
            Err(RecordFailure::Unreachable(problem)) => client::unavailable(&problem, false),
            Err(RecordFailure::Write(error)) => {
                output::print_note(&not_written(file, &error));
                exit::with(exit::OUTPUT)
            }
        }
    })
}

/// Returns the text for the user about a recording that could not be written.
pub(crate) fn not_written(file: &Path, error: &io::Error) -> String {
    let why = terminal::report::reason_of_writing(error);
    format!("error: failed to write `{}`: {why}", file.display())
}

enum RecordFailure {
    Unreachable(String),
    Write(io::Error),
}

async fn record(
    target: &ClientTarget,
    conversation: Option<String>,
    recorder: &mut Recorder,
) -> Result<(), RecordFailure> {
    let config = target.config().map_err(RecordFailure::Unreachable)?;
    let (queue, mut heard) = recorder.queue();
    let tap = substrate_zenoh::tap(config, move |key, message| queue.push(key, message.payload));
    let _tap = tap.await.map_err(|error| RecordFailure::Unreachable(error.to_string()))?;
    recorder.began = Instant::now();
    output::print_note(&format!("recording `{}`; Ctrl-C ends it", target.name));
    while let Some(received) = heard.recv().await {
        if !recorder.take(received, conversation.as_deref()).map_err(RecordFailure::Write)? {
            output::print_note("the recording is as large as it may be (--record-max)");
            return Ok(());
        }
    }
    Ok(())
}

/// Creates a file that only its owner can read, whatever the umask is: it will contain what people
/// write. If the file exists, it is emptied, and other users lose access to it.
fn private_file(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    let file = options.write(true).create(true).truncate(true).mode(0o600).open(path)?;
    let about = file.metadata()?;
    if about.is_file() && about.mode() & 0o177 != 0 {
        file.set_permissions(Permissions::from_mode(0o600))?;
    }
    Ok(file)
}

/// The sending end of the queue of messages that are to be recorded.
#[derive(Clone)]
pub(crate) struct RecordingQueue {
    waiting: mpsc::Sender<ReceivedMessage>,
    missed: Arc<AtomicU64>,
}

impl RecordingQueue {
    /// Queues a received message until it is written, and never waits. If the queue is full, the
    /// message is not recorded, but counted.
    pub(crate) fn push(&self, key: &str, payload: Bytes) {
        let received = ReceivedMessage { at: Instant::now(), key: key.to_owned(), payload };
        if let Err(TrySendError::Full(_)) = self.waiting.try_send(received) {
            self.missed.fetch_add(1, Ordering::Relaxed);
        }
    }
}

// === impl Recorder ===

impl Recorder {
    /// Creates the file of a recording, for its owner only. If the file exists, it is replaced.
    pub(crate) fn create(
        path: &Path,
        ecosystem: &EcosystemId,
        bytes_max: u64,
    ) -> io::Result<Recorder> {
        let file = BufWriter::new(private_file(path)?);
        let (began, left) = (Instant::now(), bytes_max);
        let (unread, missed) = (0, Arc::default());
        let mut recorder = Recorder { file, began, left, written: 0, unread, missed };
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let began_ms = u64::try_from(now.as_millis()).ok();
        let header = Header { recording: VERSION, ecosystem: ecosystem.clone(), began_ms };
        recorder.line(&header)?;
        Ok(recorder)
    }

    /// Creates the queue of messages that this recorder is to write.
    pub(crate) fn queue(&self) -> (RecordingQueue, mpsc::Receiver<ReceivedMessage>) {
        let (waiting, received) = mpsc::channel(WAITING_MAX);
        (RecordingQueue { waiting, missed: Arc::clone(&self.missed) }, received)
    }

    /// Writes a received message to the recording, unless it belongs to another conversation than
    /// the one that is asked for. Returns `false` if the message would exceed the maximum size of
    /// the file.
    pub(crate) fn take(
        &mut self,
        received: ReceivedMessage,
        conversation: Option<&str>,
    ) -> io::Result<bool> {
        let ReceivedMessage { at, key, payload } = received;
        let Ok(message) = acl::decode(&payload) else {
            self.unread += 1;
            return Ok(true);
        };
        if conversation.is_some_and(|asked| asked != message.conversation_id.as_str()) {
            return Ok(true);
        }
        self.write(at, key, &message)
    }

    fn write(&mut self, at: Instant, key: String, message: &Message) -> io::Result<bool> {
        let at = at.saturating_duration_since(self.began);
        let at_ms = u64::try_from(at.as_millis()).unwrap_or(u64::MAX);
        let is_written = self.line(&Recorded { at_ms, key, message: redact(message) })?;
        self.written += u64::from(is_written);
        Ok(is_written)
    }

    fn line(&mut self, line: &impl Serialize) -> io::Result<bool> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        let Some(left) = self.left.checked_sub(text.len() as u64) else { return Ok(false) };
        self.left = left;
        self.file.write_all(&text)?;
        self.file.flush()?;
        Ok(true)
    }

    /// Tells the user how many messages were written, and which are missing.
    pub(crate) fn tell(&self, file: &Path) {
        let time = brief(self.began.elapsed());
        let (written, left_out) = (self.written, self.left_out());
        output::print_note(&format!(
            "{written} messages in {time}, in {}{left_out}",
            file.display()
        ));
    }

    /// Describes for the user which messages the recording lacks.
    fn left_out(&self) -> String {
        let missed = self.missed.load(Ordering::Relaxed);
        let counts = [(self.unread, "could not be read"), (missed, "came too fast to be written")];
        let left_out = counts.into_iter().filter(|(count, _)| *count > 0);
        left_out.map(|(count, why)| format!("; {count} {why}")).collect()
    }
}

// === impl Recording ===

impl Recording {
    /// Reads a recording.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read or is not a recording.
    pub(crate) fn read(path: &Path) -> Result<Recording, RecordingError> {
        let failed = |source| RecordingError::Io { path: path.to_owned(), source };
        let mut lines = BufReader::new(File::open(path).map_err(failed)?).lines();
        let first = lines.next().transpose().map_err(failed)?.unwrap_or_default();
        let header = serde_json::from_str::<Header>(&first);
        let header = header.map_err(|_| RecordingError::NoRecording { path: path.to_owned() })?;
        if header.recording != VERSION {
            let version = header.recording;
            return Err(RecordingError::Version { path: path.to_owned(), version });
        }
        let mut recording = Recording { header, messages: Vec::new(), unread: 0 };
        for line in lines {
            // A line that is not text was not written by a recorder.
            let read = line.ok().filter(|line| line.len() <= LINE_BYTES_MAX);
            match read.and_then(|line| serde_json::from_str::<Recorded>(&line).ok()) {
                Some(recorded) => recording.messages.push(recorded),
                None => recording.unread += 1,
            }
        }
        recording.messages.sort_by_key(|recorded| recorded.at_ms);
        Ok(recording)
    }

    /// Returns the time of the last message, which is how long the recording lasts.
    pub(crate) fn lasts(&self) -> Duration {
        Duration::from_millis(self.messages.last().map_or(0, |last| last.at_ms))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn message() -> Message {
        serde_json::from_value(json!({
            "version": 2, "id": "m1", "performative": "inform", "sender": "alice",
            "incarnation": 1, "conversation_id": "c1", "protocol": "query",
            "content": { "of": "answer", "text": "2718" },
        }))
        .expect("a message")
    }

    #[test]
    fn a_truncated_recording_is_read_up_to_its_last_whole_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("r.jsonl");
        let office = EcosystemId::new("office").expect("a name");
        let mut recorder = Recorder::create(&path, &office, 1 << 20).expect("created");
        for _ in 0..3 {
            assert!(recorder.write(Instant::now(), "k".to_owned(), &message()).expect("written"));
        }
        let text = std::fs::read_to_string(&path).expect("flushed line by line");
        assert!(!text.contains("2718"), "what people answer may be a secret: {text}");
        for (cut, messages, unread) in [(0, 3, 0), (5, 2, 1)] {
            std::fs::write(&path, &text[..text.len() - cut]).expect("written");
            let recording = Recording::read(&path).expect("a recording");
            assert_eq!((recording.messages.len(), recording.unread), (messages, unread));
            assert_eq!(recording.header.ecosystem, office);
        }
    }

    #[test]
    fn a_recording_is_bounded() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("r.jsonl");
        let office = EcosystemId::new("office").expect("a name");
        let mut recorder = Recorder::create(&path, &office, 1_000).expect("created");
        let mut write = || recorder.write(Instant::now(), "k".into(), &message()).expect("written");
        let written = (0..100).filter(|_| write());
        assert!((2..10).contains(&written.count()));
        assert!(std::fs::metadata(&path).expect("there").len() <= 1_000);
    }

    #[test]
    fn messages_beyond_the_queue_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let office = EcosystemId::new("office").expect("a name");
        let recorder = Recorder::create(&folder.path().join("r.jsonl"), &office, 1 << 20);
        let mut recorder = recorder.expect("created");
        assert_eq!(recorder.left_out(), "");
        let (queue, _received) = recorder.queue();
        for _ in 0..WAITING_MAX + 3 {
            queue.push("k", Bytes::new());
        }
        recorder.unread = 1;
        assert_eq!(recorder.left_out(), "; 1 could not be read; 3 came too fast to be written");
    }

    #[test]
    fn a_file_that_is_no_recording_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("r.jsonl");
        for (text, word) in [
            ("", "not that of a recording"),
            ("{}", "not that of a recording"),
            ("{\"recording\":7,\"ecosystem\":\"office\"}", "version 7"),
        ] {
            std::fs::write(&path, text).expect("written");
            let error = Recording::read(&path).expect_err(text).to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
        assert!(Recording::read(&folder.path().join("nowhere")).is_err());
    }
}
