//! Whether a search for a cheaper plan than a known one will end within its work.
//!
//! The thresholds were set with the first three tasks of each folder of the competitions, and
//! [`WAY_MAX`] with the next three. Of 330 proofs for the first nine tasks of each folder, 3 are given up
//! (1 of 54 for the last three, with which nothing was set), and 186 of 267 searches without a proof end
//! early.

/// A search goes on until it has spent this share of its work without getting nearer to the goal, by
/// the heuristic. With a nearly exact heuristic it gets nearer all the time, and the lower bound need
/// not rise.
const STALLED_SHARE: f64 = 0.1;

/// When a search has spent a share of its work, its lower bound must have risen by [`RISE_PER_WORK`]
/// times the same share of its way, but by no more than [`RISE_MAX`] of it. The work per unit grows with
/// each unit, so a search that will end in time has come much further.
const RISE_PER_WORK: f64 = 1.2;

/// See [`RISE_PER_WORK`].
const RISE_MAX: f64 = 0.35;

/// The way of a lower bound ends at the bound, or at this multiple of its first value: a cheapest plan
/// seldom costs more, and the known plan may be much dearer.
const WAY_MAX: f64 = 2.0;

/// A search goes on if its lower bound is within this number of average steps of the bound.
const STEPS_LEFT_MIN: f64 = 4.0;

/// The outlook of one search with a bound and with limited work.
pub(crate) struct SearchOutlook {
    bound: u64,
    /// Average weight of a step of the known plan.
    mean_step: f64,
    work_max: u64,
    /// The lower bound at the first expansion; `None` before it.
    first_lower_bound: Option<u64>,
    /// The least estimate of an expanded state.
    nearest: u64,
    /// The work that was spent when `nearest` was found.
    nearest_at: u64,
}

impl SearchOutlook {
    /// Creates the outlook of a search for a plan with less weight than `bound`, which is the weight of
    /// a known plan of `steps` steps.
    pub(crate) fn new(bound: u64, steps: usize, work_max: u64) -> SearchOutlook {
        let mean_step = bound as f64 / steps.max(1) as f64;
        let (nearest, nearest_at) = (u64::MAX, 0);
        SearchOutlook { bound, mean_step, work_max, first_lower_bound: None, nearest, nearest_at }
    }

    /// Records the expansion of a state with the estimate `h`, at the lower bound `f`, after `work`.
    pub(crate) fn note_expansion(&mut self, f: u64, h: u64, work: u64) {
        self.first_lower_bound.get_or_insert(f);
        if h < self.nearest {
            (self.nearest, self.nearest_at) = (h, work);
        }
    }

    /// Whether the rest of the work will not suffice, as far as can be seen from the lower bound `f`
    /// after `work`.
    pub(crate) fn is_hopeless(&self, f: u64, work: u64) -> bool {
        let Some(first) = self.first_lower_bound else { return false };
        let share = |work: u64| work as f64 / self.work_max as f64;
        let left = self.bound.saturating_sub(f) as f64;
        let (first, bound) = (first as f64, self.bound as f64);
        let way = bound.min(WAY_MAX * first) - first;
        share(work - self.nearest_at) >= STALLED_SHARE
            && left >= STEPS_LEFT_MIN * self.mean_step
            && f as f64 - first < (RISE_PER_WORK * share(work)).min(RISE_MAX) * way
    }
}
