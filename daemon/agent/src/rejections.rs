//! What came and was not believed: counted by kind, and said so that nobody can fill a log with it.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use substrate::{Breach, Rejected};

/// How often one kind of breach in one name is said.
const SAID_EVERY: Duration = Duration::from_secs(10);

/// Names in whose name breaches were said lately. Who knows more than so many is let say anew.
const NAMES_MAX: usize = 256;

/// Counts and says.
#[derive(Debug, Default)]
pub(crate) struct Rejections {
    counts: Mutex<BTreeMap<Breach, u64>>,
    said: Mutex<HashMap<(Breach, String), Said>>,
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
        let from = claimed.unwrap_or("nobody known");
        if let Some(unsaid) = self.is_to_say(breach, from, Instant::now()) {
            tracing::warn!(
                from,
                key,
                unsaid,
                kind = breach.as_str(),
                "rejected: the message {detail}"
            );
        }
    }

    /// How many of each kind there were.
    pub(crate) fn counts(&self) -> BTreeMap<String, u64> {
        let counts = lock(&self.counts);
        counts.iter().map(|(breach, count)| (breach.as_str().to_owned(), *count)).collect()
    }

    /// Whether one is to be said now; with how many that were not.
    fn is_to_say(&self, breach: Breach, from: &str, now: Instant) -> Option<u64> {
        let mut said = lock(&self.said);
        let whose = (breach, from.to_owned());
        if let Some(last) = said.get_mut(&whose) {
            if now.saturating_duration_since(last.at) < SAID_EVERY {
                last.unsaid += 1;
                return None;
            }
            let unsaid = last.unsaid;
            *last = Said { at: now, unsaid: 0 };
            return Some(unsaid);
        }
        if said.len() >= NAMES_MAX {
            said.clear();
        }
        said.insert(whose, Said { at: now, unsaid: 0 });
        Some(0)
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
            rejections.is_to_say(Breach::Forged, from, began + Duration::from_secs(after))
        };
        assert_eq!(say("pi", 0), Some(0));
        assert_eq!([say("pi", 1), say("pi", 9)], [None, None]);
        assert_eq!(say("other", 9), Some(0));
        assert_eq!(say("pi", 10), Some(2));
        for name in 0..1_000 {
            say(&format!("x{name}"), 11);
        }
        assert!(lock(&rejections.said).len() <= NAMES_MAX);

        let rejected = Rejected { breach: Breach::Forged, detail: "x", claimed: None, key: "k" };
        (0..3).for_each(|_| rejections.note(&rejected));
        assert_eq!(rejections.counts(), [("forged".to_owned(), 3)].into());
    }
}
