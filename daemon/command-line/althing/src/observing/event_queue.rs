//! A queue of observed events with a bound: whatever shows them slowly, or not at all, costs no
//! memory and delays nothing else.

use std::collections::VecDeque;

use bytes::Bytes;
use live_view::{Moment, ViewEvent};

/// Maximum number of events that wait; more are dropped and counted.
pub(crate) const EVENTS_MAX: usize = 10_000;

/// Maximum size of all waiting events together, in bytes.
pub(crate) const EVENT_BYTES_MAX: usize = 64 << 20;

/// An event that waits, with the time at which it was observed.
pub(crate) struct TimedEvent {
    pub(crate) at: Moment,
    what: WaitingEvent,
    bytes: usize,
}

enum WaitingEvent {
    /// A message, not decoded yet: the thread of the transport must not wait.
    Payload(Bytes),
    Event(Box<ViewEvent>),
}

/// The queue.
#[derive(Default)]
pub(crate) struct EventQueue {
    pub(crate) events: VecDeque<TimedEvent>,
    /// Number of events that were dropped since the queue was last emptied.
    pub(crate) lost: u64,
    bytes: usize,
}

// === impl TimedEvent ===

impl TimedEvent {
    /// Wraps a message as it was received.
    pub(crate) fn of_payload(at: Moment, payload: Bytes) -> TimedEvent {
        let bytes = payload.len();
        TimedEvent { at, what: WaitingEvent::Payload(payload), bytes }
    }

    /// Wraps an event that takes about `bytes` of memory.
    pub(crate) fn of_event(at: Moment, event: ViewEvent, bytes: usize) -> TimedEvent {
        TimedEvent { at, what: WaitingEvent::Event(Box::new(event)), bytes }
    }

    /// Returns the event; a message is decoded.
    pub(crate) fn into_event(self) -> ViewEvent {
        match self.what {
            WaitingEvent::Event(event) => *event,
            WaitingEvent::Payload(payload) => match acl::decode(&payload) {
                Ok(message) => ViewEvent::Message(Box::new(message)),
                Err(_) => ViewEvent::Unreadable(1),
            },
        }
    }
}

// === impl EventQueue ===

impl EventQueue {
    /// Queues an event. If the queue is full, the event is dropped and counted.
    pub(crate) fn push(&mut self, event: TimedEvent) {
        let is_full = self.events.len() >= EVENTS_MAX
            || self.bytes.saturating_add(event.bytes) > EVENT_BYTES_MAX;
        if is_full {
            self.lost += 1;
        } else {
            self.bytes += event.bytes;
            self.events.push_back(event);
        }
    }

    /// Whether nothing is queued and nothing was dropped.
    pub(crate) fn is_empty(&self) -> bool {
        self.events.is_empty() && self.lost == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_beyond_the_bound_are_counted() {
        let mut queue = EventQueue::default();
        for _ in 0..EVENTS_MAX + 5 {
            queue.push(TimedEvent::of_event(Moment(1), ViewEvent::Reached(true), 8));
        }
        assert_eq!((queue.events.len(), queue.lost), (EVENTS_MAX, 5));
    }

    #[test]
    fn the_size_of_all_events_is_bounded() {
        let mut queue = EventQueue::default();
        let large = Bytes::from(vec![b' '; EVENT_BYTES_MAX / 2]);
        for _ in 0..5 {
            queue.push(TimedEvent::of_payload(Moment(1), large.clone()));
        }
        assert_eq!((queue.events.len(), queue.lost), (2, 3));
        let mut events = queue.events.into_iter().map(TimedEvent::into_event);
        assert!(events.all(|event| matches!(event, ViewEvent::Unreadable(1))));
    }
}
