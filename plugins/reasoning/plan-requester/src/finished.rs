//! Cache of goals that have ended. The cache prevents a replica from resuming an ended goal from an
//! older record. It also has the outcomes for initiators that could not be reached when their goals
//! ended.

use std::collections::VecDeque;

use acl::ConversationId;
use acl::content::{Record, Report, Version};
use agent::{Participation, Resident};

use crate::failover::conversation_of;

/// Maximum number of ended goals in the cache; of more, the oldest is dropped.
const KNOWN_MAX: usize = 128;

/// Maximum number of final records that are sent again to Journals that join and to a new leader;
/// of more, the oldest is dropped. The Journals and the new leader may have missed the first
/// message.
const OWN_MAX: usize = 32;

/// Maximum number of outcomes that are sent again to initiators that return or repeat their
/// requests; of more, the oldest is dropped. The number equals the maximum number of goals that are
/// pursued at a time.
const TOLD_MAX: usize = crate::GOALS_MAX;

/// Cache of goals that have ended.
#[derive(Debug, Default)]
pub(crate) struct FinishedGoals {
    known: VecDeque<(ConversationId, Version, Report)>,
    /// Final records of the goals that this replica ended itself.
    own: VecDeque<Record>,
    sent: VecDeque<(Participation, Report)>,
    /// Outcomes that could not be sent yet, because too many messages are under way, each with the
    /// exchange that waits for the outcome.
    unsent: VecDeque<(Participation, Report)>,
}

impl FinishedGoals {
    /// Returns `true` if the cache has the end of a goal from a record of this version or a later
    /// one.
    pub(crate) fn has(&self, id: &ConversationId, version: Version) -> bool {
        self.known.iter().any(|(other, at, _)| other == id && *at >= version)
    }

    /// Returns the outcome of a goal; `None` if the cache has no end of this goal.
    pub(crate) fn outcome_of(&self, id: &ConversationId) -> Option<&Report> {
        self.known.iter().find(|(other, ..)| other == id).map(|(_, _, report)| report)
    }

    /// Adds the outcome of a goal. Returns the goals that were dropped from the cache to make room.
    pub(crate) fn add_outcome(
        &mut self,
        id: ConversationId,
        version: Version,
        report: Report,
    ) -> Vec<ConversationId> {
        self.known.retain(|(other, ..)| *other != id);
        self.known.push_back((id, version, report));
        let surplus = self.known.len().saturating_sub(KNOWN_MAX);
        self.known.drain(..surplus).map(|(oldest, ..)| oldest).collect()
    }

    /// Stores the final record of a goal, in order to send it again later.
    pub(crate) fn store_record(&mut self, record: Record) {
        self.own.retain(|other| other.key != record.key);
        if self.own.len() >= OWN_MAX {
            self.own.pop_front();
        }
        self.own.push_back(record);
    }

    /// Returns the final record of a goal; `None` if the cache has no record of the goal.
    pub(crate) fn record(&self, id: &ConversationId) -> Option<Record> {
        let is_it = |record: &&Record| conversation_of(&record.key).as_ref() == Some(id);
        self.own.iter().find(is_it).cloned()
    }

    /// Returns the final records of the goals that this replica ended last, oldest first.
    pub(crate) fn records(&self) -> Vec<Record> {
        self.own.iter().cloned().collect()
    }

    /// Stores an outcome that was sent to the initiator of a goal. Whether the message arrived is
    /// not known.
    pub(crate) fn store_sent(&mut self, participation: Participation, report: Report) {
        self.sent.retain(|(other, _)| other.exchange != participation.exchange);
        if self.sent.len() >= TOLD_MAX {
            self.sent.pop_front();
        }
        self.sent.push_back((participation, report));
    }

    /// Queues an outcome that could not be sent to its initiator. The queue is bounded, because
    /// each outcome in it counts towards the maximum number of goals that are accepted at a time.
    pub(crate) fn queue_unsent(&mut self, participation: Participation, report: Report) {
        self.unsent.push_back((participation, report));
    }

    /// Clears the cache except for the outcomes that could not be sent, because no other replica
    /// has these outcomes.
    pub(crate) fn clear_except_unsent(&mut self) {
        *self =
            FinishedGoals { unsent: std::mem::take(&mut self.unsent), ..FinishedGoals::default() };
    }

    /// Removes and returns the oldest outcome that could not be sent, with the exchange that waits
    /// for it; `None` if there is none.
    pub(crate) fn pop_unsent(&mut self) -> Option<(Participation, Report)> {
        self.unsent.pop_front()
    }

    /// Returns the number of outcomes that could not be sent yet.
    pub(crate) fn unsent_count(&self) -> usize {
        self.unsent.len()
    }

    /// Returns the outcome of the goal that is requested once more with `participation`; `None` if
    /// no outcome is known.
    pub(crate) fn of(&self, participation: &Participation) -> Option<&Report> {
        let is_it = |other: &Participation| {
            other.conversation == participation.conversation
                && other.initiator == participation.initiator
        };
        self.sent.iter().find(|(other, _)| is_it(other)).map(|(_, report)| report)
    }

    /// Returns the outcomes that `asker`, an agent that has just joined, may have missed, each with
    /// the exchange that waits for it.
    pub(crate) fn of_asker(&self, asker: &Resident) -> Vec<(Participation, Report)> {
        let is_its = |participation: &Participation| {
            participation.initiator == asker.agent
                && participation
                    .incarnation
                    .is_none_or(|incarnation| incarnation == asker.incarnation)
        };
        self.sent.iter().filter(|(participation, _)| is_its(participation)).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use acl::content::Outcome;
    use serde_json::Value;

    use super::*;

    #[test]
    fn the_cache_of_ended_goals_is_bounded() {
        let mut ended = FinishedGoals::default();
        let id = |n: usize| ConversationId::new(&format!("c{n}"));
        let version = |term| Version { term, count: 0 };
        let report = || Report::new(Outcome::Done, "it holds");
        let forgotten: Vec<_> = (0..KNOWN_MAX + 2)
            .flat_map(|n| ended.add_outcome(id(n), version(5), report()))
            .collect();
        assert_eq!(forgotten, [id(0), id(1)]);
        assert!(ended.has(&id(2), version(5)) && !ended.has(&id(2), version(6)));
        assert!(!ended.has(&id(0), version(5)));
        for n in 0..OWN_MAX + 3 {
            let (key, version) = (format!("goal/{n}"), version(5));
            ended.store_record(Record { key, version, body: Value::Null });
        }
        assert_eq!(ended.records().len(), OWN_MAX);
        assert_eq!(ended.records()[0].key, "goal/3");
    }
}
