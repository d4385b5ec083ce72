//! The queue between what happens (in the ecosystem, at the keyboard) and the screen. The queue has
//! a bound: a screen that draws slowly, or not at all, costs no memory and delays nothing else.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use crate::observing::{EventQueue, EventSink, TimedEvent};

/// Maximum number of inputs of the user that wait for the screen; more are dropped. A person types
/// fewer in a minute.
const INPUTS_MAX: usize = 1_000;

/// How long the screen may leave what happens in the queue until nobody seems to read the terminal.
/// Over the slowest links a page is drawn in less.
const UNREAD_FOR: Duration = Duration::from_secs(10);

/// Input of the user, or something that concerns the screen only.
#[derive(Debug)]
pub(super) enum ScreenInput {
    /// An event of the terminal: a key, the mouse, a new size.
    Terminal(ratatui::crossterm::event::Event),
    /// The terminal has gone away.
    Gone,
    /// A command that was started from the screen has printed this.
    Output(CommandOutput),
}

/// The output of a command that was started from the screen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct CommandOutput {
    /// The command, as a user would type it.
    pub(super) title: String,
    pub(super) text: String,
    pub(super) succeeded: bool,
}

/// The queue.
pub(super) struct ViewInbox {
    waiting: Mutex<InboxContents>,
    changed: Condvar,
    /// Time at which the screen last asked for what waits.
    taken_at: Mutex<Instant>,
    taken: Notify,
}

/// Everything that waited in the queue.
#[derive(Default)]
pub(super) struct InboxContents {
    pub(super) observed: EventQueue,
    pub(super) inputs: VecDeque<ScreenInput>,
}

impl EventSink for ViewInbox {
    fn push(&self, event: TimedEvent) {
        self.lock().observed.push(event);
        self.changed.notify_one();
    }

    fn is_unread(&self) -> bool {
        self.untaken_for() >= UNREAD_FOR
    }
}

impl Default for ViewInbox {
    fn default() -> ViewInbox {
        ViewInbox {
            waiting: Mutex::default(),
            changed: Condvar::new(),
            taken_at: Mutex::new(Instant::now()),
            taken: Notify::new(),
        }
    }
}

impl ViewInbox {
    /// Queues an input of the user.
    pub(super) fn push_input(&self, input: ScreenInput) {
        let mut waiting = self.lock();
        if waiting.inputs.len() < INPUTS_MAX {
            waiting.inputs.push_back(input);
        }
        self.changed.notify_one();
    }

    /// Waits until something is queued, or until `deadline`, and empties the queue.
    pub(super) fn take_all(&self, deadline: Instant) -> InboxContents {
        *self.taken_at.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        self.taken.notify_waiters();
        let mut waiting = self.lock();
        while waiting.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let woken = self.changed.wait_timeout(waiting, left);
            waiting = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
        std::mem::take(&mut *waiting)
    }

    /// Returns how long the screen has not asked for what waits: it is drawing, to a terminal that
    /// reads slowly or not at all.
    fn untaken_for(&self) -> Duration {
        self.taken_at.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
    }

    /// Waits until the screen asks for what waits.
    pub(super) async fn taken(&self) {
        self.taken.notified().await;
    }

    fn lock(&self) -> MutexGuard<'_, InboxContents> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl InboxContents {
    /// Whether nothing is queued.
    pub(super) fn is_empty(&self) -> bool {
        self.observed.is_empty() && self.inputs.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use live_view::{Moment, ViewEvent};

    use super::*;

    #[test]
    fn each_loss_is_told_once() {
        let inbox = ViewInbox::default();
        for _ in 0..20_000 {
            inbox.push(TimedEvent::of_event(Moment(1), ViewEvent::Reached(true), 8));
        }
        assert!(inbox.take_all(Instant::now()).observed.lost > 0);
        assert!(inbox.take_all(Instant::now()).is_empty());
    }

    #[tokio::test]
    async fn a_screen_that_takes_nothing_is_noticed() {
        let inbox = std::sync::Arc::new(ViewInbox::default());
        std::thread::sleep(Duration::from_millis(2));
        assert!(inbox.untaken_for() >= Duration::from_millis(2));
        let other = std::sync::Arc::clone(&inbox);
        let taken = inbox.taken();
        let screen = std::thread::spawn(move || {
            while std::sync::Arc::strong_count(&other) > 1 {
                other.take_all(Instant::now());
            }
        });
        tokio::time::timeout(Duration::from_secs(60), taken).await.expect("it is told");
        drop(inbox);
        screen.join().expect("it ends");
    }

    #[test]
    fn a_wait_ends_with_an_input() {
        let inbox = std::sync::Arc::new(ViewInbox::default());
        let other = std::sync::Arc::clone(&inbox);
        let typist = std::thread::spawn(move || other.push_input(ScreenInput::Gone));
        let contents = inbox.take_all(Instant::now() + Duration::from_secs(60));
        typist.join().expect("it ends");
        assert!(matches!(contents.inputs.front(), Some(ScreenInput::Gone)));
    }
}
