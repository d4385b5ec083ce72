//! The task that writes the recording of a scenario while the scenario is played.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use acl::EcosystemId;
use terminal::{exit, output};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use crate::commands::watch::record::{self, ReceivedMessage, Recorder, RecordingQueue};

/// Maximum size of the file, in bytes. A scenario takes about one MiB.
const BYTES_MAX: u64 = 256 << 20;

/// A task that writes a recording.
pub(super) struct RecorderTask {
    file: PathBuf,
    ended: oneshot::Sender<()>,
    task: JoinHandle<io::Result<Recorder>>,
}

impl RecorderTask {
    /// Creates the file, and starts to write. Returns the queue of the messages to write, or the
    /// exit code if the file cannot be created.
    pub(super) fn start(
        file: &Path,
        ecosystem: &EcosystemId,
    ) -> Result<(RecorderTask, RecordingQueue), ExitCode> {
        let recorder = Recorder::create(file, ecosystem, BYTES_MAX).map_err(|error| {
            output::print_note(&record::not_written(file, &error));
            exit::with(exit::OUTPUT)
        })?;
        let (queue, received) = recorder.queue();
        let (ended, end) = oneshot::channel();
        let task = tokio::spawn(write_all(recorder, received, end));
        Ok((RecorderTask { file: file.to_owned(), ended, task }, queue))
    }

    /// Writes the messages that are still queued, and tells the user what was recorded. Returns
    /// `code`, or the exit code for a file that could not be written.
    pub(super) async fn finish(self, code: ExitCode) -> ExitCode {
        // The task has ended already if the file could not be written.
        let _ = self.ended.send(());
        let error = match self.task.await {
            Ok(Ok(recorder)) => {
                recorder.tell(&self.file);
                return code;
            }
            Ok(Err(error)) => error,
            Err(panicked) => io::Error::other(panicked),
        };
        output::print_note(&record::not_written(&self.file, &error));
        exit::with(exit::OUTPUT)
    }
}

/// Writes messages until the scenario has ended, and all messages that are queued by then.
async fn write_all(
    mut recorder: Recorder,
    mut received: mpsc::Receiver<ReceivedMessage>,
    mut end: oneshot::Receiver<()>,
) -> io::Result<Recorder> {
    loop {
        let next = tokio::select! {
            next = received.recv() => next,
            _ = &mut end => break,
        };
        let Some(next) = next else { return Ok(recorder) };
        if !recorder.take(next, None)? {
            return Ok(recorder);
        }
    }
    while let Ok(next) = received.try_recv() {
        if !recorder.take(next, None)? {
            break;
        }
    }
    Ok(recorder)
}
