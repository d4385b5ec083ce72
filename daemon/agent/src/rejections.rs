//! What came and was not believed: counted by kind, and said so that nobody can fill a log with it.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use acl::Message;
use substrate::{Breach, Rejected};

/// How often one kind of breach in one name is said.
const SAID_EVERY: Duration = Duration::from_secs(10);

/// Lines of one kind within that time, in whatever names: whoever takes a new name each time is counted,
/// and fills no log.
const LINES_MAX: u32 = 16;

/// Counts and says.
#[derive(Debug, Default)]
pub(crate) struct Rejections {
    counts: Mutex<BTreeMap<Breach, u64>>,
    said: Mutex<BTreeMap<&'static str, Kind>>,
}

/// What was said lately of one kind.
#[derive(Debug)]
struct Kind {
    /// Since when lines are counted.
    since: Instant,
    lines: u32,
    /// How many in other names were not said.
    unsaid: u64,
    /// In which names it was said. As each has cost a line, they are few.
    names: HashMap<String, Said>,
}

#[derive(Debug)]
struct Said {
    at: Instant,
    /// How many were not said since.
    unsaid: u64,
}

impl Rejections {
    /// Counts one, and says it unless the same was said lately.
    pub(crate) fn note(&self, rejected: &Rejected<'_>) {
        let Rejected { breach, detail, claimed, key } = *rejected;
        *lock(&self.counts).entry(breach).or_default() += 1;
        let from = claimed.unwrap_or("unknown");
        if let Some(unsaid) = self.is_to_say(breach.as_str(), from, Instant::now()) {
            tracing::warn!(
                from,
                key,
                unsaid,
                kind = breach.as_str(),
                "rejected: the message {detail}"
            );
        }
    }

    /// What an agent says of itself is not taken.
    pub(crate) fn not_taken(&self, message: &Message, why: &str) {
        let detail = format!("describes its sender in a way that is not accepted: {why}");
        let (breach, claimed) = (Breach::NotUnderstood, Some(message.sender.as_str()));
        let key = message.id.as_str();
        self.note(&Rejected { breach, detail: &detail, claimed, key });
    }

    /// How many of each kind there were.
    pub(crate) fn counts(&self) -> BTreeMap<String, u64> {
        let counts = lock(&self.counts);
        counts.iter().map(|(breach, count)| (breach.as_str().to_owned(), *count)).collect()
    }

    /// Whether something of a kind is to be said now; with how many that were not.
    pub(crate) fn is_to_say(&self, kind: &'static str, from: &str, now: Instant) -> Option<u64> {
        let mut said = lock(&self.said);
        let empty = || Kind { since: now, lines: 0, unsaid: 0, names: HashMap::new() };
        said.entry(kind).or_insert_with(empty).is_to_say(from, now)
    }
}

impl Kind {
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
            // With the first line of a time, those are forgotten who have been quiet for as long.
            let over = self.names.extract_if(|_, last| is_over(last.at));
            self.unsaid += over.map(|(_, last)| last.unsaid).sum::<u64>();
        }
        self.names.insert(from.to_owned(), Said { at: now, unsaid: 0 });
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
    fn the_same_is_said_once_in_a_while_and_always_counted() {
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

        let rejected = Rejected { breach: Breach::Forged, detail: "x", claimed: None, key: "k" };
        (0..3).for_each(|_| rejections.note(&rejected));
        assert_eq!(rejections.counts(), [("forged".to_owned(), 3)].into());
    }
}
