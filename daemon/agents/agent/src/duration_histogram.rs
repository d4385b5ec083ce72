//! Histogram of durations: how many were at most as long as each of a few bounds.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Histogram of durations that several threads count in.
#[derive(Debug)]
pub(crate) struct DurationHistogram {
    /// Upper bounds of the buckets, ascending.
    bounds: &'static [Duration],
    /// Number of durations in each bucket; the last one has no bound.
    buckets: Vec<AtomicU64>,
    /// Sum of all durations, in microseconds.
    micros: AtomicU64,
}

/// The counts of a histogram at one moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DurationCounts {
    /// For each bound, ascending, the number of durations that were at most as long.
    pub at_most: Vec<(Duration, u64)>,
    /// Number of all durations.
    pub count: u64,
    /// Sum of all durations.
    pub sum: Duration,
}

impl DurationHistogram {
    /// Creates a histogram with these ascending bounds.
    pub(crate) fn new(bounds: &'static [Duration]) -> DurationHistogram {
        let buckets = (0..=bounds.len()).map(|_| AtomicU64::new(0)).collect();
        DurationHistogram { bounds, buckets, micros: AtomicU64::new(0) }
    }

    /// Counts a duration.
    pub(crate) fn count(&self, duration: Duration) {
        let bucket = self.bounds.partition_point(|bound| *bound < duration);
        if let Some(bucket) = self.buckets.get(bucket) {
            bucket.fetch_add(1, Ordering::Relaxed);
        }
        let micros = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX);
        self.micros.fetch_add(micros, Ordering::Relaxed);
    }

    /// Returns the present counts.
    pub(crate) fn counts(&self) -> DurationCounts {
        let sum = Duration::from_micros(self.micros.load(Ordering::Relaxed));
        let mut count = 0;
        let mut up_to = self.buckets.iter().map(|bucket| {
            count += bucket.load(Ordering::Relaxed);
            count
        });
        let at_most = self.bounds.iter().copied().zip(up_to.by_ref()).collect();
        let count = up_to.last().unwrap_or_default();
        DurationCounts { at_most, count, sum }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bound_counts_all_durations_up_to_it() {
        const BOUNDS: &[Duration] = &[Duration::from_millis(10), Duration::from_millis(100)];
        let histogram = DurationHistogram::new(BOUNDS);
        assert_eq!(histogram.counts().count, 0);
        for millis in [1, 10, 11, 100, 5_000] {
            histogram.count(Duration::from_millis(millis));
        }
        let DurationCounts { at_most, count, sum } = histogram.counts();
        assert_eq!(at_most, [(BOUNDS[0], 2), (BOUNDS[1], 4)]);
        assert_eq!((count, sum), (5, Duration::from_millis(5_122)));
    }
}
