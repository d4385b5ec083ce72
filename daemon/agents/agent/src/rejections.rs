//! Rejected messages: counted by kind of violation, and logged at a bounded rate, so that no sender
//! can fill the log.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use acl::Message;
use substrate::{Rejected, ViolationKind};

/// Shortest time between two log lines about one kind of violation by senders of one name.
const SAID_EVERY: Duration = Duration::from_secs(10);

/// Maximum number of log lines about one kind of violation within `SAID_EVERY`, under all names
/// together. The messages of a sender that takes a new name each time are counted, but cannot fill
/// the log.
const LINES_MAX: u32 = 16;

/// Counters and log of rejected messages.
#[derive(Debug, Default)]
pub(crate) struct Rejections {
    counts: Mutex<BTreeMap<ViolationKind, u64>>,
    said: Mutex<BTreeMap<&'static str, KindLog>>,
}

/// Recent log lines about one kind of violation.
#[derive(Debug)]
struct KindLog {
    /// Start of the period in which lines are counted.
    since: Instant,
    lines: u32,
    /// Number of rejections that were not logged, without those that an entry in `names` counts.
    unsaid: u64,
    /// Last log line for each name. There are few names, because a name is added only with a log
    /// line.
    names: HashMap<String, LoggedLine>,
}

#[derive(Debug)]
struct LoggedLine {
    at: Instant,
    /// Number of rejections under one name that were not logged, since the last log line about it.
    unsaid: u64,
}

impl Rejections {
    /// Counts a rejection, and logs it unless a similar one was logged lately.
    pub(crate) fn note(&self, rejected: &Rejected<'_>) {
        let Rejected { violation, detail, claimed, key } = *rejected;
        *lock(&self.counts).entry(violation).or_default() += 1;
        let from = claimed.unwrap_or("unknown");
        if let Some(unsaid) = self.is_to_say(violation.as_str(), from, Instant::now()) {
            tracing::warn!(
                from,
                key,
                unsaid,
                kind = violation.as_str(),
                "rejected: the message {detail}"
            );
        }
    }

    /// Counts and logs that an announcement or heartbeat was not accepted, for the reason `why`.
    pub(crate) fn not_taken(&self, message: &Message, why: &str) {
        let detail = format!("describes its sender in a way that is not accepted: {why}");
        let (violation, claimed) = (ViolationKind::NotUnderstood, Some(message.sender.as_str()));
        let key = message.id.as_str();
        self.note(&Rejected { violation, detail: &detail, claimed, key });
    }

    /// Returns the number of rejected messages for each kind of violation.
    pub(crate) fn counts(&self) -> BTreeMap<String, u64> {
        let counts = lock(&self.counts);
        counts.iter().map(|(violation, count)| (violation.as_str().to_owned(), *count)).collect()
    }

    /// Returns the number of rejected messages for every kind of violation, also those that have not
    /// occurred.
    pub(crate) fn all_counts(&self) -> Vec<(ViolationKind, u64)> {
        let counts = lock(&self.counts);
        let count = |kind| (kind, counts.get(&kind).copied().unwrap_or_default());
        ViolationKind::ALL.into_iter().map(count).collect()
    }

    /// Returns `None` if this rejection is not to be logged now. Otherwise returns the number of
    /// earlier rejections that were not logged, for the log line.
    pub(crate) fn is_to_say(&self, kind: &'static str, from: &str, now: Instant) -> Option<u64> {
        let mut said = lock(&self.said);
        let empty = || KindLog { since: now, lines: 0, unsaid: 0, names: HashMap::new() };
        said.entry(kind).or_insert_with(empty).is_to_say(from, now)
    }
}

impl KindLog {
    fn is_to_say(&mut self, from: &str, now: Instant) -> Option<u64> {
        let is_over = |since: Instant| now.saturating_duration_since(since) >= SAID_EVERY;
        if let Some(last) = self.names.get_mut(from).filter(|last| !is_over(last.at)) {
            last.unsaid += 1;
            return None;
        }
        if is_over(self.since) {
            (self.since, self.lines) = (now, 0);
        }
        if self.lines >= LINES_MAX {
            self.unsaid += 1;
            return None;
        }
        self.lines += 1;
        let own = self.names.remove(from).map_or(0, |last| last.unsaid);
        if self.lines == 1 {
            // The first line of a period removes the names that have had no line within
            // `SAID_EVERY`.
            let over = self.names.extract_if(|_, last| is_over(last.at));
            self.unsaid += over.map(|(_, last)| last.unsaid).sum::<u64>();
        }
        self.names.insert(from.to_owned(), LoggedLine { at: now, unsaid: 0 });
        Some(own + std::mem::take(&mut self.unsaid))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejections_are_logged_at_a_bounded_rate_and_all_counted() {
        let rejections = Rejections::default();
        let began = Instant::now();
        let say = |from: &str, after| {
            rejections.is_to_say("forged", from, began + Duration::from_secs(after))
        };
        assert_eq!(say("pi", 0), Some(0));
        assert_eq!([say("pi", 1), say("pi", 9)], [None, None]);
        assert_eq!(say("other", 9), Some(0));
        assert_eq!(say("pi", 10), Some(2));
        for time in 2..5 {
            let lines: Vec<_> = (0..1_000)
                .filter_map(|name| say(&format!("x{name}{time}"), time * 10 + 1))
                .collect();
            assert!(lines.len() <= LINES_MAX as usize, "new names add no lines");
        }
        assert_eq!(say("pi", 51), Some(1_000 - u64::from(LINES_MAX)), "and all are counted");
        assert!(lock(&rejections.said)["forged"].names.len() <= 2 * LINES_MAX as usize);

        let rejected =
            Rejected { violation: ViolationKind::Forged, detail: "x", claimed: None, key: "k" };
        (0..3).for_each(|_| rejections.note(&rejected));
        assert_eq!(rejections.counts(), [("forged".to_owned(), 3)].into());
        let all = rejections.all_counts();
        assert_eq!(all.len(), ViolationKind::ALL.len());
        assert_eq!(all.iter().filter(|(_, count)| *count > 0).count(), 1);
    }
}
