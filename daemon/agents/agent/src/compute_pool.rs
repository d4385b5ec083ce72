//! Bounded pool for computations. The agents of one daemon share the cores of its machine, and a
//! hundred agents that plan at once would leave no core for receiving messages.
//!
//! A thread that holds a permit runs the queued computations, the oldest first. If many agents
//! compute for a moment each, as after a call for proposals, only as many threads wake as there are
//! permits.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

/// Divisor that yields the memory for all computations of a daemon together: a quarter of the
/// memory of the machine, or of the daemon's control group. The rest is for stored data, for
/// messages, and for other processes.
const MEMORY_PART: u64 = 4;

/// Maximum memory of one computation, in bytes: a hundred times as much as the plans of an office
/// need. No computation of a building benefits from more memory.
const COMPUTATION_BYTES_MAX: u64 = 1 << 30;

/// Assumed memory of the machine, in bytes, if the kernel does not report it.
const MEMORY_UNKNOWN_BYTES: u64 = 1 << 30;

/// Returns the maximum memory of one computation, in bytes, given that as many computations run at
/// once as there are permits.
pub fn computation_bytes_max() -> usize {
    static BYTES_MAX: OnceLock<usize> = OnceLock::new();
    *BYTES_MAX.get_or_init(|| {
        let total = ::machine::memory_total().unwrap_or(MEMORY_UNKNOWN_BYTES);
        share(total, turns_at_once())
    })
}

fn share(total: u64, at_once: usize) -> usize {
    let share = total / MEMORY_PART / (at_once.max(1) as u64);
    usize::try_from(share.min(COMPUTATION_BYTES_MAX)).unwrap_or(usize::MAX)
}

/// Returns how many computations run at once on this machine: one per core, and at least two.
pub(crate) fn turns_at_once() -> usize {
    std::thread::available_parallelism().map_or(2, |cores| cores.get().max(2))
}

/// A queued computation. The closure sends its result to the caller.
type Computation = Box<dyn FnOnce() + Send>;

/// Bounded pool for the computations of one machine.
///
/// The queue needs no bound of its own: each agent has one computation under way per exchange that
/// it takes part in, and both are bounded.
pub(crate) struct ComputePool {
    turns: Arc<Semaphore>,
    /// Computations that wait, in the order of arrival.
    waiting: Mutex<VecDeque<Computation>>,
}

impl ComputePool {
    pub(crate) fn new(at_once_max: usize) -> ComputePool {
        let turns = Arc::new(Semaphore::new(at_once_max));
        ComputePool { turns, waiting: Mutex::default() }
    }

    /// Runs a computation once a permit is free, on a thread of the runtime that may be busy for
    /// long. Skips the computation if the caller has dropped the future by then.
    ///
    /// Returns `None` if the computation panicked, or if the daemon is ending.
    pub(crate) async fn compute<T: Send + 'static>(
        self: Arc<Self>,
        compute: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let (tell, outcome) = oneshot::channel();
        let computation = move || {
            if !tell.is_closed() {
                // Sending fails if the caller has dropped the future meanwhile.
                let _ = tell.send(compute());
            }
        };
        self.waiting().push_back(Box::new(computation));
        if let Ok(turn) = Arc::clone(&self.turns).try_acquire_owned() {
            tokio::task::spawn_blocking(move || self.take(turn));
        }
        outcome.await.ok()
    }

    /// Runs queued computations on this thread until the queue is empty; then releases the permit.
    fn take(&self, turn: OwnedSemaphorePermit) {
        let mut turn = Some(turn);
        while turn.is_some() {
            while let Some(computation) = self.next() {
                // A panic is on stderr, with its place. The caller gets `None`.
                let _ = catch_unwind(AssertUnwindSafe(computation));
            }
            drop(turn.take());
            // Computations that arrived in the meantime found no free permit.
            if !self.waiting().is_empty() {
                turn = Arc::clone(&self.turns).try_acquire_owned().ok();
            }
        }
    }

    fn next(&self) -> Option<Computation> {
        self.waiting().pop_front()
    }

    fn waiting(&self) -> MutexGuard<'_, VecDeque<Computation>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;
    use std::time::Duration;

    use tokio::task::JoinSet;
    use tokio::time::Instant;

    use super::*;

    #[tokio::test(flavor = "multi_thread", worker_threads = 4)]
    async fn all_computations_run_within_the_number_of_permits() {
        let turns = Arc::new(ComputePool::new(2));
        let (now, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let mut computed = JoinSet::new();
        for number in 0..2_000 {
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
        assert_eq!(numbers, (0..2_000).collect::<Vec<_>>());
        assert!((1..=2).contains(&most.load(Ordering::SeqCst)));
    }

    #[tokio::test]
    async fn a_panic_does_not_stop_other_computations() {
        let turns = Arc::new(ComputePool::new(1));
        let lost = Arc::clone(&turns).compute(|| -> u8 { panic!("for the test") });
        let next = Arc::clone(&turns).compute(|| 2);
        assert_eq!(tokio::join!(lost, next), (None, Some(2)));
        assert_eq!(turns.compute(|| 3).await, Some(3));
    }

    #[tokio::test]
    async fn an_abandoned_computation_is_skipped() {
        let turns = Arc::new(ComputePool::new(1));
        let (begin, begun) = mpsc::channel::<()>();
        let first = tokio::spawn(Arc::clone(&turns).compute(move || begun.recv().is_ok()));
        let touched = Arc::new(AtomicUsize::new(0));
        let touch = Arc::clone(&touched);
        let second =
            tokio::spawn(Arc::clone(&turns).compute(move || touch.fetch_add(1, Ordering::SeqCst)));
        // Both are queued: the first holds the permit, or will get it before the second.
        tokio::task::yield_now().await;
        second.abort();
        assert!(second.await.is_err_and(|error| error.is_cancelled()));
        begin.send(()).expect("it waits");
        assert_eq!(first.await.expect("it ends"), Some(true));
        assert_eq!(turns.compute(|| 1).await, Some(1), "behind the one that was left out");
        assert_eq!(touched.load(Ordering::SeqCst), 0);
    }

    /// Otherwise simulated days would pass while an agent plans.
    #[tokio::test(start_paused = true)]
    async fn a_paused_clock_does_not_advance_during_a_computation() {
        let (turns, began) = (Arc::new(ComputePool::new(1)), Instant::now());
        let ticking = tokio::spawn(async move {
            loop {
                tokio::time::sleep(Duration::from_secs(1)).await;
            }
        });
        // Real time, as a search takes it.
        let computed = turns.compute(|| std::thread::sleep(Duration::from_millis(20))).await;
        assert_eq!((computed, began.elapsed()), (Some(()), Duration::ZERO));
        ticking.abort();
    }

    #[test]
    fn a_computation_has_its_share_of_the_machine() {
        const GIB: u64 = 1 << 30;
        assert_eq!(share(GIB, 4), 64 << 20);
        assert_eq!(share(4 * GIB, 2), 512 << 20);
        assert_eq!(share(256 * GIB, 2), 1 << 30);
        assert!(computation_bytes_max() > 0);
    }
}
