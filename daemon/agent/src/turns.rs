//! Whose turn it is to compute on a machine: agents of one daemon share its cores, and a hundred
//! that plan at once would leave none to those who listen.
//!
//! A thread that has computed takes what waits next: what many agents compute for a moment each, as
//! when all are called for proposals, wakes as many threads as there are turns, and not one for each.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

/// A computation, whoever waits for it.
type Computation = Box<dyn FnOnce() + Send>;

/// The computations of one machine. Its length is bounded by the agents there, each of which has one
/// under way per exchange that it takes part in.
pub(crate) struct Turns {
    at_once_max: usize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// In the order in which they were wanted.
    waiting: VecDeque<Computation>,
    /// Threads that compute.
    threads: usize,
}

impl Turns {
    pub(crate) fn new(at_once_max: usize) -> Turns {
        Turns { at_once_max, state: Mutex::default() }
    }

    /// Computes on a thread that may be busy for long, when its turn has come. One that nobody waits
    /// for any more by then is left out.
    ///
    /// `None` if it panicked, or the daemon is ending.
    pub(crate) async fn compute<T: Send + 'static>(
        self: Arc<Self>,
        compute: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let (tell, outcome) = oneshot::channel();
        let computation = move || {
            if !tell.is_closed() {
                // Who has stopped waiting meanwhile is not told.
                let _ = tell.send(compute());
            }
        };
        self.want(Box::new(computation));
        outcome.await.ok()
    }

    fn want(self: Arc<Self>, computation: Computation) {
        let mut state = self.state();
        state.waiting.push_back(computation);
        if state.threads < self.at_once_max {
            state.threads += 1;
            drop(state);
            let turn = Turn(self);
            tokio::task::spawn_blocking(move || turn.compute_all());
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One thread's turn. It ends when nothing waits, or with the runtime, which may drop it unused.
struct Turn(Arc<Turns>);

impl Turn {
    fn compute_all(self) {
        while let Some(computation) = self.next() {
            // Its panic is on stderr, with its place; whoever waits learns that it was lost.
            let _ = catch_unwind(AssertUnwindSafe(computation));
        }
        // Counted out already, with the look that found nothing.
        std::mem::forget(self);
    }

    /// What waits longest; where nothing does, the turn is over in the same moment, so that nothing
    /// can come between and wait for a thread that has stopped looking.
    fn next(&self) -> Option<Computation> {
        let mut state = self.0.state();
        let next = state.waiting.pop_front();
        if next.is_none() {
            state.threads -= 1;
        }
        next
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.0.state().threads -= 1;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    use super::*;

    #[tokio::test]
    async fn everything_is_computed_and_no_more_at_once_than_there_are_turns() {
        let turns = Arc::new(Turns::new(2));
        let (now, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let mut computed = tokio::task::JoinSet::new();
        for number in 0..200 {
            let (now, most) = (Arc::clone(&now), Arc::clone(&most));
            computed.spawn(Arc::clone(&turns).compute(move || {
                most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                std::thread::yield_now();
                now.fetch_sub(1, Ordering::SeqCst);
                number
            }));
        }
        let mut numbers: Vec<_> = computed.join_all().await.into_iter().flatten().collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..200).collect::<Vec<_>>());
        assert!((1..=2).contains(&most.load(Ordering::SeqCst)));
        assert_eq!(Arc::clone(&turns).compute(|| 1).await, Some(1), "and again afterwards");
    }

    #[tokio::test]
    async fn one_that_panics_stops_no_other() {
        let turns = Arc::new(Turns::new(1));
        let lost = Arc::clone(&turns).compute(|| -> u8 { panic!("for the test") });
        let next = Arc::clone(&turns).compute(|| 2);
        assert_eq!(tokio::join!(lost, next), (None, Some(2)));
        assert_eq!(turns.compute(|| 3).await, Some(3));
    }

    #[tokio::test]
    async fn what_nobody_waits_for_is_left_out() {
        let turns = Arc::new(Turns::new(1));
        let (begin, begun) = mpsc::channel::<()>();
        let first = tokio::spawn(Arc::clone(&turns).compute(move || begun.recv().is_ok()));
        let touched = Arc::new(AtomicUsize::new(0));
        let touch = Arc::clone(&touched);
        let second =
            tokio::spawn(Arc::clone(&turns).compute(move || touch.fetch_add(1, Ordering::SeqCst)));
        while turns.state().waiting.is_empty() {
            tokio::task::yield_now().await;
        }
        second.abort();
        assert!(second.await.is_err_and(|error| error.is_cancelled()));
        begin.send(()).expect("it waits");
        assert_eq!(first.await.expect("it ends"), Some(true));
        assert_eq!(turns.compute(|| 1).await, Some(1), "behind the one that was left out");
        assert_eq!(touched.load(Ordering::SeqCst), 0);
    }
}
