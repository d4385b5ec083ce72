//! The file of what waits: quiet hours and a receiver that is away outlast a restart of the daemon.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use agent::{Context, WorkHandle, replace_file};

use crate::notice_queue::WaitingNotice;
use crate::{ChannelState, NotifierAgent};

/// Maximum length of the file, in bytes: all channels with full queues.
const FILE_BYTES_MAX: u64 = 32 << 20;

/// The queues of all channels, by name.
pub(crate) type QueuesByChannel = BTreeMap<String, Vec<WaitingNotice>>;

/// What is on disk of the queues.
pub(crate) struct SavedQueues {
    file: Option<PathBuf>,
    /// The running read or write.
    pub(crate) work: Option<WorkHandle>,
    queues: QueuesByChannel,
    /// Whether the last write failed, which was logged.
    has_failed: bool,
}

// === impl SavedQueues ===

impl SavedQueues {
    pub(crate) fn new(file: Option<PathBuf>) -> SavedQueues {
        SavedQueues { file, work: None, queues: BTreeMap::new(), has_failed: false }
    }

    pub(crate) fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Begins to write what has changed. Returns whether nothing has, and nothing is under way.
    pub(crate) fn is_written(
        &mut self,
        channels: &mut [ChannelState],
        ctx: &mut Context<NotifierAgent>,
    ) -> bool {
        if self.work.is_some() {
            return false;
        }
        let Some(file) = self.file.clone() else { return true };
        let mut has_changed = false;
        for state in channels {
            if let Some(waiting) = state.queue.take_changed() {
                has_changed = true;
                self.queues.insert(state.channel.name.clone(), waiting);
            }
        }
        // A disk that has failed is tried again: it may have been full for a moment.
        if !has_changed && !self.has_failed {
            return true;
        }
        let text = serde_json::to_vec(&self.queues).unwrap_or_default();
        let write = ctx.run_blocking(move || replace_file(&file, &text));
        self.work = Some(ctx.run(write, |notifier: &mut NotifierAgent, written, _| {
            notifier.saved.work = None;
            let failure = match written {
                Ok(Ok(())) => None,
                Ok(Err(error)) => Some(error.to_string()),
                Err(error) => Some(error.to_string()),
            };
            if let Some(error) = failure.as_ref().filter(|_| !notifier.saved.has_failed) {
                tracing::warn!(error, "notices that wait do not outlast a restart");
            }
            notifier.saved.has_failed = failure.is_some();
        }));
        false
    }
}

/// Reads the file. What cannot be read is lost, which is logged.
pub(crate) fn read(file: &Path) -> QueuesByChannel {
    let text = match std::fs::metadata(file) {
        Err(_) => return BTreeMap::new(),
        Ok(about) if about.len() > FILE_BYTES_MAX => Err("it is too long".to_owned()),
        Ok(_) => std::fs::read(file).map_err(|error| error.to_string()),
    };
    let parsed =
        text.and_then(|text| serde_json::from_slice(&text).map_err(|error| error.to_string()));
    parsed.unwrap_or_else(|error| {
        let file = file.display();
        tracing::warn!("notices that waited are lost: failed to read {file}: {error}");
        BTreeMap::new()
    })
}
