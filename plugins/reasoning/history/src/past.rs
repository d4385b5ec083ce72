//! What the history knew when it ended: the goals, so that what goes on after a start is chained to
//! them, and the time of the newest event.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use acl::content::{HistoryKind, HistoryRoot};

use crate::store::{HistoryStore, HistoryStoreError, ScanFilter};
use crate::words::kind_hash;

/// Maximum number of goals that are read.
const GOALS_MAX: usize = 2_048;

/// Maximum number of blocks that one search reads.
const BLOCKS_MAX: usize = 1_000;

/// What a history knew when it ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PastHistory {
    /// Time of the newest event; `None` if there is no event.
    pub(crate) newest_ms: Option<u64>,
    /// The newest goals, oldest first.
    pub(crate) goals: Vec<PastGoal>,
}

/// A goal of which the history has events.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PastGoal {
    pub(crate) conversation: Arc<str>,
    pub(crate) goal: Arc<str>,
    /// Number of the newest event of the goal.
    pub(crate) number: u64,
    /// Root of that event.
    pub(crate) root: HistoryRoot,
}

impl PastHistory {
    /// Reads what the files say.
    pub(crate) fn read(store: &HistoryStore) -> Result<PastHistory, HistoryStoreError> {
        store.read(|reader| {
            let mut past = PastHistory::default();
            reader.scan(&ScanFilter::default(), BLOCKS_MAX, |event| {
                past.newest_ms = Some(event.at_ms);
                ControlFlow::Break(())
            })?;
            let mut places = HashMap::new();
            let filter = ScanFilter::default().and(kind_hash(HistoryKind::Goal));
            reader.scan(&filter, BLOCKS_MAX, |event| {
                if event.kind != HistoryKind::Goal || event.conversation.is_empty() {
                    return ControlFlow::Continue(());
                }
                let conversation = Arc::clone(&event.conversation);
                let goals = &mut past.goals;
                let place = *places.entry(Arc::clone(&conversation)).or_insert(goals.len());
                match goals.get_mut(place) {
                    // A goal that was not known by its text at first.
                    Some(known) if known.goal == conversation => {
                        known.goal = Arc::clone(&event.subject);
                    }
                    Some(_) => (),
                    None => goals.push(PastGoal {
                        conversation,
                        goal: Arc::clone(&event.subject),
                        number: event.number,
                        root: event.root,
                    }),
                }
                match goals.len() >= GOALS_MAX {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            })?;
            past.goals.reverse();
            Ok(past)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{RecordedEvent, test_event};
    use crate::store::HistoryLimits;

    #[test]
    fn goals_are_read_with_their_newest_events() {
        let folder = tempfile::tempdir().expect("a folder");
        let limits = HistoryLimits { keep_ms: u64::MAX, bytes_max: 1 << 30 };
        let (store, _) = HistoryStore::open(folder.path(), limits).expect("opened");
        assert_eq!(PastHistory::read(&store).expect("read"), PastHistory::default());
        let goal = |number: u64, conversation: &str, subject: &str| RecordedEvent {
            kind: HistoryKind::Goal,
            conversation: conversation.into(),
            subject: subject.into(),
            root: HistoryRoot::Person,
            ..test_event(number)
        };
        let events = [
            goal(1, "ann.1", "(lit hall)"),
            goal(2, "ann.2", "(lit lab)"),
            goal(3, "ann.1", "ann.1"),
            goal(4, "", "(no conversation)"),
            test_event(5),
        ];
        store.append(&events, 0, 1_000_005).expect("written");
        let past = PastHistory::read(&store).expect("read");
        assert_eq!(past.newest_ms, Some(1_000_005));
        let read: Vec<_> =
            past.goals.iter().map(|it| (&*it.conversation, &*it.goal, it.number)).collect();
        assert_eq!(read, [("ann.2", "(lit lab)", 2), ("ann.1", "(lit hall)", 3)]);
    }
}
