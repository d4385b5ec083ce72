//! The queue of spans for the collector: bounded, in batches, and with growing pauses while the
//! collector is away. No clock, no connection.

use std::collections::VecDeque;
use std::time::Duration;

use crate::span::TraceSpan;

/// Maximum number of spans that wait; further ones are dropped and counted. A building with a
/// thousand actions a minute fills it in minutes without a collector.
const WAITING_MAX: usize = 8_192;

/// Maximum number of spans in one request.
const BATCH_MAX: usize = 512;

/// The first pause after a failure; each further one is twice as long, up to the greatest.
const PAUSE_FIRST: Duration = Duration::from_secs(1);
const PAUSE_MAX: Duration = Duration::from_secs(60);

/// Spans that wait for the collector.
#[derive(Debug, Default)]
pub(crate) struct ExportQueue {
    waiting: VecDeque<TraceSpan>,
    /// Number of spans at the front that are in the request under way.
    sent: usize,
    dropped: u64,
    /// Pause after the last failure; `None` if the last request succeeded.
    pause: Option<Duration>,
}

impl ExportQueue {
    /// Adds spans. Those for which there is no room are dropped and counted.
    pub(crate) fn add(&mut self, spans: Vec<TraceSpan>) {
        for span in spans {
            match self.waiting.len() < WAITING_MAX {
                true => self.waiting.push_back(span),
                false => self.dropped += 1,
            }
        }
    }

    /// Returns the next batch; `None` if there is none, or if a request is under way.
    pub(crate) fn take(&mut self) -> Option<Vec<TraceSpan>> {
        if self.sent > 0 || self.waiting.is_empty() {
            return None;
        }
        self.sent = self.waiting.len().min(BATCH_MAX);
        Some(self.waiting.iter().take(self.sent).cloned().collect())
    }

    /// Notes that the collector has taken the batch.
    pub(crate) fn taken(&mut self) {
        self.waiting.drain(..self.sent);
        (self.sent, self.pause) = (0, None);
    }

    /// Notes that the collector will never take the batch.
    pub(crate) fn refused(&mut self) {
        self.dropped += self.sent as u64;
        self.taken();
    }

    /// Notes that the collector is away. Returns the time to wait before the next request.
    pub(crate) fn failed(&mut self, asked: Option<Duration>) -> Duration {
        self.sent = 0;
        let next = self.pause.map_or(PAUSE_FIRST, |pause| (pause * 2).min(PAUSE_MAX));
        self.pause = Some(next);
        asked.map_or(next, |asked| asked.max(next))
    }

    /// Whether no span waits.
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Whether enough spans wait for a whole batch.
    pub(crate) fn has_batch(&self) -> bool {
        self.waiting.len() >= BATCH_MAX
    }

    /// Whether the last request failed.
    pub(crate) fn is_failing(&self) -> bool {
        self.pause.is_some()
    }

    /// Returns the number of spans that were dropped since the last call.
    pub(crate) fn take_dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::{SpanId, SpanStatus, TraceId, UnixNanos};

    fn spans(count: usize) -> Vec<TraceSpan> {
        let trace = TraceId::of("lab", "c");
        let span = |number: usize| TraceSpan {
            trace,
            id: SpanId::of(trace, "action", &number.to_string()),
            parent: None,
            name: "action".to_owned(),
            start: UnixNanos(0),
            end: UnixNanos(0),
            attributes: Vec::new(),
            links: Vec::new(),
            status: SpanStatus::Unset,
        };
        (0..count).map(span).collect()
    }

    #[test]
    fn batches_are_sent_one_after_the_other_and_kept_until_they_are_taken() {
        let mut queue = ExportQueue::default();
        assert_eq!(queue.take(), None);
        let all = spans(BATCH_MAX + 1);
        queue.add(all.clone());
        assert!(queue.has_batch());
        assert_eq!(queue.take().expect("a batch"), all[..BATCH_MAX]);
        assert_eq!(queue.take(), None, "one is under way");
        assert_eq!(queue.failed(None), PAUSE_FIRST);
        assert_eq!(queue.take().expect("the same batch"), all[..BATCH_MAX]);
        queue.taken();
        assert_eq!(queue.take().expect("the rest"), all[BATCH_MAX..]);
        queue.taken();
        assert!(queue.is_empty());
    }

    #[test]
    fn pauses_grow_to_a_bound_and_a_longer_one_is_obeyed() {
        let mut queue = ExportQueue::default();
        let pauses: Vec<u64> = (0..8).map(|_| queue.failed(None).as_secs()).collect();
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 60, 60]);
        assert_eq!(queue.failed(Some(Duration::from_secs(120))).as_secs(), 120);
        queue.taken();
        assert!(!queue.is_failing());
        assert_eq!(queue.failed(None), PAUSE_FIRST);
    }

    #[test]
    fn what_has_no_room_and_what_is_refused_is_counted() {
        let mut queue = ExportQueue::default();
        queue.add(spans(WAITING_MAX + 3));
        assert_eq!(queue.take_dropped(), 3);
        assert_eq!(queue.take().map(|batch| batch.len()), Some(BATCH_MAX));
        queue.refused();
        assert_eq!(queue.take_dropped(), BATCH_MAX as u64);
        assert_eq!(queue.take_dropped(), 0);
    }
}
