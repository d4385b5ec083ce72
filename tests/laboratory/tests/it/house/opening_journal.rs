//! A Journal that is still opening its file: it takes records, and cannot be read before it is open.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use acl::Performative;
use acl::content::{Outcome, Record, Report, Request, StoreRecords};
use agent::{Agent, Callbacks, Context, Participation, Resource};
use tokio::sync::mpsc;

/// A Journal with one record, which it shows when it is open.
pub(crate) struct OpeningJournal {
    is_open: Arc<AtomicBool>,
    kept: Record,
    stored: mpsc::UnboundedSender<Record>,
}

/// The other end of an [`OpeningJournal`].
pub(crate) struct JournalFile {
    is_open: Arc<AtomicBool>,
    /// Records that the Journal was asked to keep.
    stored: mpsc::UnboundedReceiver<Record>,
}

// === impl OpeningJournal ===

impl OpeningJournal {
    pub(crate) fn new(kept: Record) -> (OpeningJournal, JournalFile) {
        let (stored, records) = mpsc::unbounded_channel();
        let is_open = Arc::new(AtomicBool::new(false));
        let file = JournalFile { is_open: Arc::clone(&is_open), stored: records };
        (OpeningJournal { is_open, kept, stored }, file)
    }
}

impl JournalFile {
    pub(crate) fn open(&self) {
        self.is_open.store(true, Ordering::Relaxed);
    }

    /// Returns all records that the Journal was asked to keep since the last call.
    pub(crate) fn take_stored(&mut self) -> Vec<Record> {
        std::iter::from_fn(|| self.stored.try_recv().ok()).collect()
    }
}

impl Agent for OpeningJournal {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |journal: &mut OpeningJournal, message, ctx| {
            if let Ok(Request::StoreRecords(StoreRecords { records })) =
                message.content_as::<Request>()
            {
                let stored = |record| journal.stored.send(record).expect("the test listens");
                records.into_iter().for_each(stored);
            }
            let report = Report::new(Outcome::Done, "kept");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let is_readable = resource == Resource::Journal && self.is_open.load(Ordering::Relaxed);
        is_readable.then(|| serde_json::to_string(&[&self.kept]).expect("JSON"))
    }
}
