//! Goals that have ended, and are not forgotten yet: nobody begins them again from an older copy,
//! and their askers hear how they ended, also those who were cut off when they did.

use std::collections::VecDeque;

use acl::ConversationId;
use acl::content::{Record, Report, Version};
use agent::{Engagement, Resident};

use crate::resuming::conversation_of;

/// Goals that have ended and are remembered.
const KNOWN_MAX: usize = 128;

/// Ends that are told once more: to Journals that come, and to who takes over; either may have missed
/// the first time.
const OWN_MAX: usize = 32;

/// Ends that are told once more to askers that come back, or ask again: those of all goals that are
/// pursued at a time.
const TOLD_MAX: usize = crate::GOALS_MAX;

/// What is remembered of goals that have ended.
#[derive(Debug, Default)]
pub(crate) struct Ended {
    known: VecDeque<(ConversationId, Version, Report)>,
    /// The records of those that this Plan Requester ended itself.
    own: VecDeque<Record>,
    told: VecDeque<(Engagement, Report)>,
    /// What askers are to hear and could not be told yet: too much is under way.
    untold: VecDeque<(Engagement, Report)>,
}

impl Ended {
    /// Whether a goal is known to have ended, by a record as late as this.
    pub(crate) fn has(&self, id: &ConversationId, version: Version) -> bool {
        self.known.iter().any(|(other, at, _)| other == id && *at >= version)
    }

    /// How a goal is known to have ended, by whatever record.
    pub(crate) fn how(&self, id: &ConversationId) -> Option<&Report> {
        self.known.iter().find(|(other, ..)| other == id).map(|(_, _, report)| report)
    }

    /// Notes an end; yields the goals that are forgotten for it.
    pub(crate) fn note(
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

    /// Keeps the record of an end, to say it once more.
    pub(crate) fn keep(&mut self, record: Record) {
        self.own.retain(|other| other.key != record.key);
        if self.own.len() >= OWN_MAX {
            self.own.pop_front();
        }
        self.own.push_back(record);
    }

    /// The record of an end.
    pub(crate) fn record(&self, id: &ConversationId) -> Option<Record> {
        let is_it = |record: &&Record| conversation_of(&record.key).as_ref() == Some(id);
        self.own.iter().find(is_it).cloned()
    }

    /// The records of the last ends.
    pub(crate) fn records(&self) -> Vec<Record> {
        self.own.iter().cloned().collect()
    }

    /// An asker was told how its goal ended; whether it has heard it is not known.
    pub(crate) fn told(&mut self, engagement: Engagement, report: Report) {
        self.told.retain(|(other, _)| other.exchange != engagement.exchange);
        if self.told.len() >= TOLD_MAX {
            self.told.pop_front();
        }
        self.told.push_back((engagement, report));
    }

    /// An asker could not be told how its goal ended. A goal that could not be told its end is one
    /// less that is accepted, so these have a bound.
    pub(crate) fn not_told(&mut self, engagement: Engagement, report: Report) {
        self.untold.push_back((engagement, report));
    }

    /// Forgets all but the ends that could not be told: nobody else knows that they are to be.
    pub(crate) fn forget_but_untold(&mut self) {
        *self = Ended { untold: std::mem::take(&mut self.untold), ..Ended::default() };
    }

    /// The oldest end that could not be told.
    pub(crate) fn take_untold(&mut self) -> Option<(Engagement, Report)> {
        self.untold.pop_front()
    }

    /// How many ends could not be told yet.
    pub(crate) fn untold_count(&self) -> usize {
        self.untold.len()
    }

    /// How the goal ended that is asked for once more, by who has not heard it.
    pub(crate) fn of(&self, engagement: &Engagement) -> Option<&Report> {
        let is_it = |other: &Engagement| {
            other.conversation == engagement.conversation && other.initiator == engagement.initiator
        };
        self.told.iter().find(|(other, _)| is_it(other)).map(|(_, report)| report)
    }

    /// What an asker that has come, or come back, may not have heard.
    pub(crate) fn of_asker(&self, asker: &Resident) -> Vec<(Engagement, Report)> {
        let is_its = |engagement: &Engagement| {
            engagement.initiator == asker.agent
                && engagement.life.is_none_or(|life| life == asker.incarnation)
        };
        self.told.iter().filter(|(engagement, _)| is_its(engagement)).cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use acl::content::Outcome;
    use serde_json::Value;

    use super::*;

    #[test]
    fn what_is_remembered_has_a_bound_and_the_later_end_counts() {
        let mut ended = Ended::default();
        let id = |n: usize| ConversationId::new(&format!("c{n}"));
        let version = |term| Version { term, count: 0 };
        let report = || Report::new(Outcome::Done, "it holds");
        let forgotten: Vec<_> =
            (0..KNOWN_MAX + 2).flat_map(|n| ended.note(id(n), version(5), report())).collect();
        assert_eq!(forgotten, [id(0), id(1)]);
        assert!(ended.has(&id(2), version(5)) && !ended.has(&id(2), version(6)));
        assert!(!ended.has(&id(0), version(5)));
        for n in 0..OWN_MAX + 3 {
            let (key, version) = (format!("goal/{n}"), version(5));
            ended.keep(Record { key, version, body: Value::Null });
        }
        assert_eq!(ended.records().len(), OWN_MAX);
        assert_eq!(ended.records()[0].key, "goal/3");
    }
}
