//! Whose turn it is to compute on a machine: agents of one daemon share its cores, and a hundred
//! that plan at once would leave none to those who listen.
//!
//! A Tokio runtime of its own, of which nothing is used but its threads for blocking work: it has
//! as many as there are turns, and each goes on with what waits longest. What many agents compute
//! for a moment each, as when all are called for proposals, wakes no thread for each of them.

use tokio::runtime::{Builder, Runtime};
use tokio_util::task::AbortOnDropHandle;

/// The computations of one machine.
///
/// As many wait as agents want: each has one under way per exchange that it takes part in, and both
/// are bounded.
pub(crate) struct Turns(Option<Runtime>);

impl Turns {
    pub(crate) fn new(at_once_max: usize) -> Turns {
        let mut builder = Builder::new_current_thread();
        let runtime = builder.max_blocking_threads(at_once_max).thread_name("computing").build();
        Turns(Some(runtime.expect("invariant: without drivers nothing of it can fail")))
    }

    /// Computes on a thread that may be busy for long, when its turn has come. What nobody waits for
    /// any more by then is left out.
    pub(crate) fn compute<T: Send + 'static>(
        &self,
        compute: impl FnOnce() -> T + Send + 'static,
    ) -> AbortOnDropHandle<T> {
        let runtime = self.0.as_ref().expect("invariant: it is taken when this is dropped");
        AbortOnDropHandle::new(runtime.spawn_blocking(compute))
    }
}

impl Drop for Turns {
    /// Waits for nobody: the last handle may be dropped by an agent, which must not wait.
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::sync::mpsc;

    use super::*;

    #[tokio::test]
    async fn everything_is_computed_and_no_more_at_once_than_there_are_turns() {
        let turns = Turns::new(2);
        let (now, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let computed = (0..200).map(|number| {
            let (now, most) = (Arc::clone(&now), Arc::clone(&most));
            turns.compute(move || {
                most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                std::thread::yield_now();
                now.fetch_sub(1, Ordering::SeqCst);
                number
            })
        });
        for (number, computed) in computed.collect::<Vec<_>>().into_iter().enumerate() {
            assert_eq!(computed.await.expect("it ends"), number);
        }
        assert!((1..=2).contains(&most.load(Ordering::SeqCst)));
    }

    #[tokio::test]
    async fn one_that_panics_stops_no_other() {
        let turns = Turns::new(1);
        let lost = turns.compute(|| -> u8 { panic!("for the test") });
        let next = turns.compute(|| 2);
        assert!(lost.await.is_err_and(|error| error.is_panic()));
        assert_eq!(next.await.expect("it ends"), 2);
        assert_eq!(turns.compute(|| 3).await.expect("it ends"), 3);
    }

    #[tokio::test]
    async fn what_nobody_waits_for_is_left_out() {
        let turns = Turns::new(1);
        let (begin, begun) = mpsc::channel::<()>();
        let first = turns.compute(move || begun.recv().is_ok());
        let touched = Arc::new(AtomicUsize::new(0));
        let touch = Arc::clone(&touched);
        drop(turns.compute(move || touch.fetch_add(1, Ordering::SeqCst)));
        begin.send(()).expect("it waits");
        assert!(first.await.expect("it ends"));
        assert_eq!(turns.compute(|| 1).await.expect("it ends"), 1, "behind the one left out");
        assert_eq!(touched.load(Ordering::SeqCst), 0);
    }

    #[tokio::test]
    async fn who_drops_the_last_handle_does_not_wait() {
        let turns = Turns::new(1);
        let (end, ended) = mpsc::channel::<()>();
        let endless = turns.compute(move || ended.recv().is_ok());
        drop(turns);
        end.send(()).expect("it goes on");
        assert!(endless.await.expect("it ends"));
    }
}
