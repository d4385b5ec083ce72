//! The task that computes the topics which pages read, whenever the ecosystem has changed.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use live_view::{Moment, ViewRevision};
use tokio::time::{MissedTickBehavior, interval, sleep_until};

use crate::host::PageHost;
use crate::row_set::RowSet;
use crate::topic_name::TopicName;
use crate::topic_rows::{KnownToPages, TopicData};
use crate::topic_store::TopicStore;

/// Smallest interval between two computations of a topic: an eye sees no less, and with it a change
/// is on the page within a tenth of a second.
const COMPUTED_EVERY: Duration = Duration::from_millis(50);

/// Smallest interval between two looks whether a topic has changed: facts may change a thousand times a
/// second.
const LOOKED_AT_EVERY: Duration = Duration::from_millis(20);

/// Interval at which all topics are computed although nothing was observed: silence makes agents
/// silent and facts stale.
const AGED_EVERY: Duration = Duration::from_secs(1);

/// Longest interval at which a topic is computed although nothing was observed, however long that
/// takes.
const AGED_AT_LEAST_EVERY: Duration = Duration::from_secs(5);

/// Share of one core that computing one topic takes at most: one of so many parts. The topics of a
/// hundred devices take less of it, those of a thousand are computed some times a second.
const CORE_SHARE: u32 = 200;

/// The same for computing a topic although nothing has changed but the time.
const AGED_SHARE: u32 = 400;

/// Bytes per second that one topic sends to each page at most, over some time: more than the rows
/// of a thousand agents.
const BYTES_PER_SECOND: u64 = 1 << 20;

/// Maximum number of topics whose times are remembered.
const TOOK_MAX: usize = 1_000;

/// Milliseconds of a second.
const MILLIS: u64 = 1_000;

/// The next moments at which topics may be computed.
#[derive(Default)]
struct TopicTimes {
    next: BTreeMap<TopicName, Instant>,
    /// The next moments at which they may be computed although nothing was observed.
    aged: BTreeMap<TopicName, Instant>,
}

/// A topic that was computed: how long to wait until it may be computed again, and until it may be
/// although nothing has changed but the time.
struct SpentTime {
    topic: TopicName,
    wait: Duration,
    aged: Option<Duration>,
}

impl TopicTimes {
    fn is_due(&self, topic: &TopicName, now: Instant) -> bool {
        self.next.get(topic).is_none_or(|next| *next <= now)
    }

    /// Whether a topic may be computed although nothing was observed.
    fn is_aged(&self, topic: &TopicName, now: Instant) -> bool {
        self.aged.get(topic).is_none_or(|next| *next <= now)
    }

    /// Returns the moment at which the first of these topics is due; `None` if there are none.
    fn next_of(&self, topics: &PendingTopics) -> Option<Instant> {
        let next = |topic| self.next.get(topic).copied().unwrap_or_else(Instant::now);
        topics.keys().map(next).min()
    }

    fn note(&mut self, spent: Vec<SpentTime>) {
        let now = Instant::now();
        self.next.retain(|_, next| *next > now);
        self.aged.retain(|_, next| *next > now);
        for SpentTime { topic, wait, aged } in spent {
            if let Some(aged) = aged {
                self.aged.insert(topic.clone(), now + aged);
            }
            self.next.insert(topic, now + wait);
        }
    }
}

/// The topics that may have changed since they were computed, each with whether it is computed
/// although nothing was observed.
type PendingTopics = BTreeMap<TopicName, bool>;

/// The state that computing keeps from one time to the next.
#[derive(Default)]
struct TopicWork {
    rows: RowSet,
    /// A second, and the number of observed messages that is shown in it.
    messages: (u64, u64),
    /// Number of the newest activity that was computed.
    activity: u64,
    /// The time that each topic took last.
    took: BTreeMap<TopicName, Duration>,
    /// The revision of the view of which each topic was computed last.
    revisions: BTreeMap<TopicName, ViewRevision>,
}

/// Computes topics until the host ends. The host is asked on a thread that may block.
pub(crate) async fn compute(host: Arc<dyn PageHost>, store: Arc<TopicStore>) {
    let mut changes = host.changes();
    let mut aged = interval(AGED_EVERY);
    aged.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut times, mut work) = (TopicTimes::default(), TopicWork::default());
    let (mut pending, mut looked_at) = (PendingTopics::new(), Instant::now());
    loop {
        let next = times.next_of(&pending);
        tokio::select! {
            changed = changes.changed() => match changed {
                Ok(()) => {
                    // Many changes that follow each other are looked at together.
                    sleep_until((looked_at + LOOKED_AT_EVERY).into()).await;
                    changes.mark_unchanged();
                    looked_at = Instant::now();
                    let read = store.read_topics();
                    pending.retain(|topic, _| read.contains(topic));
                    for topic in read {
                        pending.entry(topic).or_default();
                    }
                }
                Err(_) => return,
            },
            _ = aged.tick() => {
                let now = Instant::now();
                let aged = |topic: TopicName| { let is = times.is_aged(&topic, now); (topic, is) };
                pending = store.read_topics().into_iter().map(aged).collect();
            }
            () = store.wanted.notified() => {
                for topic in store.fresh_topics() {
                    pending.entry(topic).or_default();
                }
            }
            () = sleep_until(next.unwrap_or_else(Instant::now).into()), if next.is_some() => (),
        }
        let now = Instant::now();
        let due: Vec<_> = pending.extract_if(.., |topic, _| times.is_due(topic, now)).collect();
        if due.is_empty() {
            continue;
        }
        let (host, store) = (Arc::clone(&host), Arc::clone(&store));
        let computed = tokio::task::spawn_blocking(move || {
            let spent = work.compute(&*host, &store, due);
            (work, spent)
        });
        let spent;
        (work, spent) = computed.await.unwrap_or_else(|error| {
            tracing::error!(%error, "what pages show could not be computed");
            Default::default()
        });
        times.note(spent);
    }
}

impl TopicWork {
    /// Computes those of the topics that may have changed, and those that are computed although
    /// nothing was observed. Returns how long to wait until each may be computed again.
    fn compute(
        &mut self,
        host: &dyn PageHost,
        store: &TopicStore,
        due: Vec<(TopicName, bool)>,
    ) -> Vec<SpentTime> {
        let now = host.now();
        let mut spent = Vec::with_capacity(due.len());
        for (topic, is_aged) in due {
            let began = Instant::now();
            let Some(mut data) = self.data(host, store, (&topic, is_aged), now) else {
                spent.push(SpentTime { topic, wait: COMPUTED_EVERY, aged: None });
                continue;
            };
            if let TopicData::Overview(overview) = &mut data {
                overview.counts.messages = self.messages(now, overview.counts.messages);
            }
            if let TopicData::Activity { newest, .. } = &data {
                self.activity = *newest;
            }
            data.write(now, &mut self.rows);
            let changed = u64::try_from(store.update(&topic, &self.rows)).unwrap_or(u64::MAX);
            let sent = Duration::from_millis(changed.saturating_mul(MILLIS) / BYTES_PER_SECOND);
            let took = began.elapsed();
            let usual = self.usual(&topic, took);
            let wait = (usual * CORE_SHARE).max(sent).max(COMPUTED_EVERY);
            let aged = is_aged.then(|| (took * AGED_SHARE).min(AGED_AT_LEAST_EVERY));
            spent.push(SpentTime { topic, wait, aged });
        }
        spent
    }

    /// Copies what a topic is about; `None` if it is as it was when it was computed last.
    fn data(
        &mut self,
        host: &dyn PageHost,
        store: &TopicStore,
        (topic, is_aged): (&TopicName, bool),
        now: Moment,
    ) -> Option<TopicData> {
        let before = self.revisions.get(topic).copied().filter(|_| store.is_current(topic));
        let activity = if store.is_computed(topic) { self.activity } else { 0 };
        let known = KnownToPages { activity, since: before, has_aged: is_aged };
        let mut copied = None;
        host.read(&mut |view| {
            let is_needed =
                is_aged || before.is_none_or(|before| TopicData::may_differ(topic, view, before));
            if is_needed {
                let data = TopicData::of(topic, view, now, &known);
                copied = Some((data, view.revision()));
            }
        });
        let (data, revision) = copied?;
        if self.revisions.len() >= TOOK_MAX {
            self.revisions.clear();
        }
        self.revisions.insert(topic.clone(), revision);
        Some(data)
    }

    /// Returns the time that computing a topic takes: the smaller of the last two, because on a busy
    /// machine this thread stands still now and then.
    fn usual(&mut self, topic: &TopicName, took: Duration) -> Duration {
        if self.took.len() >= TOOK_MAX {
            self.took.clear();
        }
        let before = self.took.insert(topic.clone(), took);
        before.map_or(took, |before| before.min(took))
    }

    /// Returns the number of messages that is shown: a new one each second, because every message
    /// changes it.
    fn messages(&mut self, now: Moment, count: u64) -> u64 {
        let second = now.0 / MILLIS;
        if self.messages.0 != second {
            self.messages = (second, count);
        }
        self.messages.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_slow_computation_delays_nothing() {
        let (mut work, quick, slow) =
            (TopicWork::default(), Duration::from_micros(100), Duration::from_millis(20));
        let mut usual = |took| work.usual(&TopicName::Goals, took);
        assert_eq!([quick, slow, quick].map(&mut usual), [quick; 3]);
        assert_eq!([slow, slow].map(&mut usual), [quick, slow], "it has become slow");
    }

    #[test]
    fn the_number_of_messages_changes_once_a_second() {
        let mut work = TopicWork::default();
        let shown = [(1_000, 5), (1_999, 9), (2_000, 11)]
            .map(|(now, count)| work.messages(Moment(now), count));
        assert_eq!(shown, [5, 5, 11]);
    }
}
