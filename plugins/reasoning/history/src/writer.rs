//! Writes events in batches on a thread that may block, and answers questions there.

use std::sync::Arc;
use std::time::Duration;

use agent::{Context, Participation};

use crate::answers::{Answered, PageNotes};
use crate::event::RecordedEvent;
use crate::past::PastHistory;
use crate::query;
use crate::recorder::EventRecorder;
use crate::store::{HistoryStore, HistoryStoreError, OpenedHistory, SEGMENT_EVENTS};
use crate::{HistoryAgent, wall_ms};

/// Maximum number of events that wait for a disk that does not take them. Older ones are lost and
/// counted.
const PENDING_MAX: usize = 50_000;

/// Interval between attempts to open the files, or to write to a disk that has failed. It may be
/// full, or an earlier process may still have the files open.
const RETRY_INTERVAL: Duration = Duration::from_secs(5);

/// State of the files.
pub(crate) enum HistoryDisk {
    /// The files are being opened.
    Opening,
    Open(Arc<HistoryStore>),
    /// The files cannot be used, for the reason in this text.
    Unusable(String),
}

/// Events that are not on disk yet.
#[derive(Default)]
pub(crate) struct PendingEvents {
    events: Vec<RecordedEvent>,
    /// Number of messages and events that were lost since the history began.
    lost: u64,
    lost_written: u64,
    /// Number of facts that the recorder has dropped and that are in `lost`.
    dropped: u64,
    /// Reason why the last write failed; `None` if it did not.
    failure: Option<String>,
    /// Damaged files that were moved aside.
    notices: Vec<String>,
}

// === impl HistoryDisk ===

impl HistoryDisk {
    pub(crate) fn is_open(&self) -> bool {
        matches!(self, HistoryDisk::Open(_))
    }
}

// === impl PendingEvents ===

impl PendingEvents {
    pub(crate) fn is_empty(&self) -> bool {
        self.events.is_empty() && self.lost == self.lost_written
    }

    pub(crate) fn has_failed(&self) -> bool {
        self.failure.is_some()
    }

    pub(crate) fn add_lost(&mut self, lost: u64) {
        self.lost += lost;
    }

    /// Takes the events of the recorder.
    pub(crate) fn take(&mut self, recorder: &mut EventRecorder) {
        let dropped = recorder.dropped();
        self.lost += dropped.saturating_sub(std::mem::replace(&mut self.dropped, dropped));
        self.events.append(&mut recorder.take_events());
        self.bound();
    }

    /// Takes events back that could not be written.
    fn give_back(&mut self, mut events: Vec<RecordedEvent>) {
        events.append(&mut self.events);
        self.events = events;
        self.bound();
    }

    /// Gives all events numbers greater than `newest`, and returns by how much they have grown. A
    /// day begins with a segment of its own, so the numbers grow by whole segments.
    fn renumber(&mut self, newest: u64) -> u64 {
        let Some(first) = self.events.first().map(|event| event.number) else { return 0 };
        let shift = newest.saturating_sub(first).next_multiple_of(SEGMENT_EVENTS) + SEGMENT_EVENTS;
        for event in &mut self.events {
            event.number += shift;
            event.cause =
                event.cause.map(|cause| if cause < first { cause } else { cause + shift });
        }
        shift
    }

    fn bound(&mut self) {
        let surplus = self.events.len().saturating_sub(PENDING_MAX);
        if surplus > 0 {
            self.events.drain(..surplus);
            self.lost += surplus as u64;
        }
    }

    fn notes(&self) -> PageNotes {
        let failure = self.failure.as_ref();
        let failure = failure.map(|why| format!("what happens now is not kept: failed to {why}"));
        let notices = self.notices.iter().cloned().chain(failure).collect();
        PageNotes { lost: self.lost, notices }
    }
}

impl HistoryAgent {
    /// Opens the files, or creates them.
    pub(crate) fn open(&mut self, ctx: &mut Context<Self>) {
        let (folder, limits) = (self.folder.clone(), self.limits);
        let opening = ctx.run_blocking(move || {
            let folder = folder.ok_or(HistoryStoreError::Nowhere)?;
            let (store, opened) = HistoryStore::open(&folder, limits)?;
            let past = PastHistory::read(&store)?;
            Ok((store, opened, past))
        });
        self.work = Some(ctx.run(opening, |history: &mut Self, opened, ctx| {
            history.work = None;
            let lost = |error: agent::WorkError| Err(HistoryStoreError::Lost(error.to_string()));
            history.opened(opened.unwrap_or_else(lost), ctx);
        }));
    }

    fn opened(
        &mut self,
        opened: Result<(HistoryStore, OpenedHistory, PastHistory), HistoryStoreError>,
        ctx: &mut Context<Self>,
    ) {
        match opened {
            Ok((store, opened, past)) => {
                tracing::info!(agent = %ctx.id(), newest = opened.newest, "the history is open");
                self.disk = HistoryDisk::Open(Arc::new(store));
                self.pending.lost += opened.lost;
                self.pending.lost_written = opened.lost;
                self.pending.notices = opened.notices;
                self.begin(opened.newest, past, ctx);
                self.write(ctx);
            }
            Err(error) => {
                tracing::error!(agent = %ctx.id(), %error, "the history keeps nothing");
                ctx.failure_counters().count_not_persisted();
                if error.is_transient() {
                    ctx.after(RETRY_INTERVAL, |history: &mut Self, ctx| history.open(ctx));
                }
                self.disk = HistoryDisk::Unusable(error.to_string());
                for (asker, _) in std::mem::take(&mut self.questions) {
                    let detail = format!("failed to {error}");
                    ctx.refuse(&asker, acl::content::Reason::Incapable, detail);
                }
            }
        }
    }

    /// Writes all events and answers all questions, unless the disk is busy with the last ones.
    pub(crate) fn write(&mut self, ctx: &mut Context<Self>) {
        let HistoryDisk::Open(store) = &self.disk else { return };
        self.pending.take(&mut self.recorder);
        if self.work.is_some() || (self.pending.is_empty() && self.questions.is_empty()) {
            return;
        }
        // A disk that has failed is tried again later, and still answers.
        let is_paused = self.pending.has_failed() && self.is_retry_scheduled;
        let events = match is_paused {
            true => Vec::new(),
            false => std::mem::take(&mut self.pending.events),
        };
        let questions = std::mem::take(&mut self.questions);
        let (store, lost, now_ms) = (Arc::clone(store), self.pending.lost, wall_ms(ctx));
        let working = ctx.run_blocking(move || {
            let written = match is_paused {
                true => Ok(()),
                false => store.append(&events, lost, now_ms),
            };
            let answer = |(asker, read): (Participation, Box<acl::content::ReadHistory>)| {
                let answer = query::answer(&store, &read);
                Answered { asker, read, answer }
            };
            (written, events, questions.into_iter().map(answer).collect::<Vec<_>>())
        });
        self.work = Some(ctx.run(working, move |history: &mut Self, outcome, ctx| {
            history.work = None;
            match outcome {
                Ok((written, events, answers)) => {
                    if let HistoryDisk::Open(store) = &history.disk {
                        history.pending.notices.extend(store.take_notices());
                    }
                    if !is_paused {
                        history.written(written, events, lost, ctx);
                    }
                    let notes = history.pending.notes();
                    answers.into_iter().for_each(|answered| answered.send(&notes, ctx));
                }
                Err(error) => {
                    tracing::error!(agent = %ctx.id(), %error, "a write was lost");
                    history.pending.failure =
                        Some(HistoryStoreError::Lost(error.to_string()).to_string());
                }
            }
            if !history.questions.is_empty() {
                history.write(ctx);
            }
        }));
    }

    fn written(
        &mut self,
        written: Result<(), HistoryStoreError>,
        events: Vec<RecordedEvent>,
        lost: u64,
        ctx: &mut Context<Self>,
    ) {
        match written {
            Ok(()) => {
                if self.pending.failure.take().is_some() {
                    tracing::info!(agent = %ctx.id(), "the history is kept again");
                }
                self.pending.lost_written = lost;
            }
            Err(HistoryStoreError::Outnumbered { newest }) => {
                self.pending.give_back(events);
                self.pending.take(&mut self.recorder);
                let shift = self.pending.renumber(newest);
                self.recorder.skip_numbers(shift);
                self.write(ctx);
            }
            Err(error) => {
                ctx.failure_counters().count_not_persisted();
                if self.pending.failure.replace(error.to_string()).is_none() {
                    tracing::error!(agent = %ctx.id(), %error, "the history is not kept for now");
                }
                self.pending.give_back(events);
                self.is_retry_scheduled = true;
                ctx.after(RETRY_INTERVAL, |history: &mut Self, ctx| {
                    history.is_retry_scheduled = false;
                    history.write(ctx);
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::test_event;

    #[test]
    fn events_get_greater_numbers_and_keep_their_causes() {
        let mut pending = PendingEvents::default();
        let mut of = |number, cause| {
            let event = RecordedEvent { cause, ..test_event(number) };
            pending.events.push(event);
        };
        of(70, Some(5));
        of(71, Some(70));
        let shift = pending.renumber(1_000_000);
        let numbers: Vec<_> = pending.events.iter().map(|it| (it.number, it.cause)).collect();
        assert_eq!(numbers, [(70 + shift, Some(5)), (71 + shift, Some(70 + shift))]);
        assert!(numbers[0].0 > 1_000_000 && shift % SEGMENT_EVENTS == 0);
        assert_eq!(PendingEvents::default().renumber(9), 0);
    }
}
