//! Records of goals by the clock in the Journals: `due/CONVERSATION`.
//!
//! A record says for which occurrence the goal was asked for last, so that a new leader does not ask
//! for it again. Of two records the later version applies, but an occurrence that either of them says
//! was asked for counts as asked for. The end of a goal by the clock is final; a goal of the file
//! begins anew if its entry in the file has changed.

use std::collections::{BTreeSet, VecDeque};

use acl::content::{Achieve, GoalTimes, HISTORY_ENTRIES_MAX, HistoryEntry, Record, Report};
use acl::content::{Version, value};
use acl::{AgentId, ConversationId};
use agent::replication::{self, ReplicationOutcome};
use agent::{Context, Participation};
use goal_schedule::{LATE_MAX, Schedule, SeenOccurrences};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::PlanRequester;
use crate::due_goal::{DUE, DueGoal, TIMES_LEARNED, merged, occurrence_id, timestamp};
use crate::failover::acceptance;

/// Maximum number of goals by the clock whose ends are known, not counting goals that stand in the
/// ecosystem file; of more, the oldest is dropped.
const ENDED_MAX: usize = 128;

/// Record of a goal by the clock, in the form in which it is replicated to the Journals.
#[derive(Debug, Serialize, Deserialize)]
struct DueRecord {
    initiator: AgentId,
    asked: Achieve,
    /// The number by which people name the goal; 0 in the records of earlier versions.
    #[serde(default)]
    number: u32,
    times: GoalTimes,
    /// The latest occurrence for which the goal was asked for, in milliseconds since 1970-01-01 UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    asked_ms: Option<i64>,
    /// The latest time up to which occurrences are settled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    settled_ms: Option<i64>,
    /// The occurrence whose goal is pursued.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pursued_ms: Option<i64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    took_ms: Vec<u64>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    is_of_file: bool,
    #[serde(default)]
    happened: Vec<HistoryEntry>,
    /// The final report; `None` if the goal has not ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    ended: Option<Report>,
}

/// Goals by the clock that have ended, oldest first.
#[derive(Debug, Default)]
pub(crate) struct EndedDueGoals {
    ends: VecDeque<EndedDueGoal>,
    /// Goals that stand in the ecosystem file. Their ends are never dropped, because such a goal would
    /// be asked for again as if it were new. The file bounds their number.
    in_file: BTreeSet<ConversationId>,
}

#[derive(Debug)]
struct EndedDueGoal {
    id: ConversationId,
    version: Version,
    body: Value,
    report: Report,
}

// === impl EndedDueGoals ===

impl EndedDueGoals {
    /// Returns an empty list. The ends of the goals `in_file` are never dropped from it.
    pub(crate) fn new(in_file: BTreeSet<ConversationId>) -> EndedDueGoals {
        EndedDueGoals { ends: VecDeque::new(), in_file }
    }

    /// Forgets all ends, because another replica has them.
    pub(crate) fn clear(&mut self) {
        self.ends.clear();
    }

    /// Returns how a goal by the clock has ended; `None` if no end is known.
    pub(crate) fn report_of(&self, id: &ConversationId) -> Option<Report> {
        self.find(id).map(|ended| ended.report.clone())
    }

    /// Whether a goal with the same request and the same times has ended under this name.
    pub(crate) fn has_same(&self, id: &ConversationId, asked: &Achieve, words: &str) -> bool {
        let record = self.find(id).and_then(|ended| DueRecord::deserialize(&ended.body).ok());
        record.is_some_and(|record| record.asked == *asked && record.times.words == words)
    }

    /// Returns all records, oldest first.
    pub(crate) fn records(&self) -> Vec<Record> {
        let record = |ended: &EndedDueGoal| Record {
            key: format!("{DUE}{}", ended.id),
            version: ended.version,
            body: ended.body.clone(),
        };
        self.ends.iter().map(record).collect()
    }

    pub(crate) fn forget(&mut self, id: &ConversationId) {
        self.ends.retain(|ended| ended.id != *id);
    }

    fn find(&self, id: &ConversationId) -> Option<&EndedDueGoal> {
        self.ends.iter().find(|ended| ended.id == *id)
    }

    /// Adds an end. Returns the goals that were dropped to make room.
    fn add(&mut self, ended: EndedDueGoal) -> Vec<ConversationId> {
        self.forget(&ended.id);
        self.ends.push_back(ended);
        let others = self.ends.iter().filter(|ended| !self.in_file.contains(&ended.id));
        let surplus = others.clone().count().saturating_sub(ENDED_MAX);
        let dropped: Vec<_> = others.take(surplus).map(|oldest| oldest.id.clone()).collect();
        self.ends.retain(|ended| !dropped.contains(&ended.id));
        dropped
    }
}

impl PlanRequester {
    // === replication ===

    /// Sends the record of a new goal by the clock to the Journals, and confirms it to the initiator
    /// when they have it.
    pub(crate) fn replicate_new_due(
        &mut self,
        id: &ConversationId,
        participation: Participation,
        ctx: &mut Context<Self>,
    ) {
        if self.journal_client.journals().is_empty() {
            let how = "accepted, and kept nowhere: it is lost when this machine restarts, as the \
                       ecosystem has no Journal";
            return self.confirm_schedule(&participation, how, ctx);
        }
        let Some(record) = self.due_record(id) else { return };
        let number = self.clock.goals.get(id).map_or(0, |due| due.number);
        let kept =
            move |requester: &mut Self, kept: ReplicationOutcome, ctx: &mut Context<Self>| {
                let listed = requester.journal_client.journals().len();
                requester.confirm_schedule(&participation, &acceptance(number, &kept, listed), ctx);
            };
        replication::replicate(self, &[record], ctx, kept);
    }

    /// Sends the present record of a goal by the clock to the Journals.
    pub(crate) fn replicate_due(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if let Some(record) = self.due_record(id) {
            replication::replicate_detached(self, &[record], ctx);
        }
    }

    /// Sends the records of all goals by the clock, and of their ends, to the Journals again.
    pub(crate) fn replicate_all_due(&mut self, ctx: &mut Context<Self>) {
        let ids: Vec<_> = self.clock.goals.keys().cloned().collect();
        ids.iter().for_each(|id| self.replicate_due(id, ctx));
        let ended = self.clock.ended.records();
        if !ended.is_empty() && !self.journal_client.journals().is_empty() {
            replication::replicate_detached(self, &ended, ctx);
        }
    }

    /// Remembers that a goal by the clock has ended, and records it in the Journals. Calls `then` when
    /// enough of them have answered, or the time for an answer has passed.
    pub(crate) fn replicate_ended_due(
        &mut self,
        id: &ConversationId,
        due: DueGoal,
        report: Report,
        ctx: &mut Context<Self>,
        then: impl FnOnce(&mut Context<Self>) + Send + 'static,
    ) {
        let record = DueRecord { ended: Some(report.clone()), pursued_ms: None, ..record_of(&due) };
        let record = self.journal_client.write(format!("{DUE}{id}"), value(&record));
        let (version, body) = (record.version, record.body.clone());
        let dropped = self.clock.ended.add(EndedDueGoal { id: id.clone(), version, body, report });
        let mut records = vec![record];
        for oldest in dropped {
            records.push(self.journal_client.write(format!("{DUE}{oldest}"), Value::Null));
        }
        if self.journal_client.journals().is_empty() {
            return then(ctx);
        }
        replication::replicate(self, &records, ctx, move |_, _, ctx| then(ctx));
    }

    fn due_record(&mut self, id: &ConversationId) -> Option<Record> {
        if self.journal_client.journals().is_empty() {
            return None;
        }
        let due = self.clock.goals.get_mut(id)?;
        let record = self.journal_client.write(format!("{DUE}{id}"), value(&record_of(due)));
        due.version = record.version;
        Some(record)
    }

    /// Gives up the goals by the clock, and returns their records for the next leader.
    pub(crate) fn resign_clock(&mut self, ctx: &mut Context<Self>) -> Vec<Record> {
        let mut records = self.clock.ended.records();
        for (id, due) in self.clock.take_all() {
            let key = format!("{DUE}{id}");
            records.push(self.journal_client.write(key, value(&record_of(&due))));
            due.exchange.into_iter().for_each(|exchange| ctx.close(&exchange));
        }
        self.clock.ended.clear();
        records
    }

    // === resuming ===

    /// Merges the record of a goal by the clock with what this replica knows.
    pub(crate) fn restore_due(&mut self, record: Record, ctx: &mut Context<Self>) {
        let Record { key, version, body } = record;
        let Some(id) = key.strip_prefix(DUE).map(ConversationId::new) else { return };
        let read = match DueRecord::deserialize(&body) {
            Ok(read) => read,
            Err(_) if body.is_null() => return,
            Err(error) => {
                return tracing::warn!(key, %error, "the record of a goal by the clock cannot be read");
            }
        };
        let here = self.clock.goals.get(&id).map(|due| due.version);
        if let Some(report) = read.ended.clone() {
            let is_older = here.is_some_and(|here| here > version);
            if read.is_of_file && is_older {
                return;
            }
            if let Some(due) = self.clock.goals.remove(&id)
                && let Some(pursued) = due.pursued_conversation(&id)
                && self.goals.contains_key(&pursued)
            {
                self.cancel(&pursued, ctx);
                self.replicate_cancellation(&pursued, ctx, |_| ());
            }
            self.clock.ended.add(EndedDueGoal { id, version, body, report });
            return;
        }
        if let Some(ended) = self.clock.ended.find(&id) {
            if read.is_of_file && ended.version < version {
                self.clock.ended.forget(&id);
            } else {
                // The end was unknown to the replica that wrote this record.
                let (body, report) = (ended.body.clone(), ended.report.clone());
                let again = self.journal_client.write(key, body.clone());
                let version = again.version;
                self.clock.ended.add(EndedDueGoal { id, version, body, report });
                return replication::replicate_detached(self, &[again], ctx);
            }
        }
        let seen =
            SeenOccurrences { asked: instant(read.asked_ms), settled: instant(read.settled_ms) };
        if let Some(due) = self.clock.goals.get_mut(&id)
            && due.version >= version
        {
            due.seen = merged(due.seen, seen);
            return self.cancel_second(&id, instant(read.pursued_ms), ctx);
        }
        self.resume_due(&id, read, (seen, version));
    }

    /// Cancels the goal that another leader has asked for at the time `theirs`, if this replica pursues
    /// the goal of another time: one of them is enough.
    fn cancel_second(
        &mut self,
        id: &ConversationId,
        theirs: Option<Timestamp>,
        ctx: &mut Context<Self>,
    ) {
        let ours = self.clock.goals.get(id).and_then(|due| due.pursued);
        let second = theirs.filter(|theirs| ours.is_some_and(|ours| ours != *theirs));
        let second = second.map(|theirs| occurrence_id(id, theirs));
        if let Some(second) = second.filter(|second| self.goals.contains_key(second)) {
            self.cancel(&second, ctx);
            self.replicate_cancellation(&second, ctx, |_| ());
        }
    }

    fn resume_due(
        &mut self,
        id: &ConversationId,
        read: DueRecord,
        (seen, version): (SeenOccurrences, Version),
    ) {
        let DueRecord {
            initiator,
            asked,
            number,
            times,
            pursued_ms,
            took_ms,
            is_of_file,
            happened,
            ..
        } = read;
        let zone = self.clock.zone(&times).unwrap_or_else(|problem| {
            tracing::error!(conversation = %id, problem, "a goal by the clock takes this machine's");
            TimeZone::system()
        });
        let schedule = match Schedule::read(&times, zone) {
            Ok(schedule) => schedule,
            Err(error) => {
                return tracing::warn!(conversation = %id, %error, "a recorded time cannot be read");
            }
        };
        tracing::info!(conversation = %id, goal = asked.goal, times = times.words, "resumes a goal by the clock");
        let mut due = DueGoal::new(initiator, asked, times, schedule);
        let surplus = happened.len().saturating_sub(HISTORY_ENTRIES_MAX);
        (due.seen, due.version, due.is_of_file) = (seen, version, is_of_file);
        (due.pursued, due.history, due.took_ms) = (instant(pursued_ms), happened, took_ms);
        due.history.drain(..surplus);
        due.took_ms.truncate(TIMES_LEARNED);
        if let Some(former) = self.clock.goals.remove(id) {
            due.seen = merged(due.seen, former.seen);
            if former.pursued == due.pursued {
                due.exchange = former.exchange;
            }
        }
        due.number = self.number_for(number);
        self.clock.goals.insert(id.clone(), due);
    }

    /// Asks again for the goals of occurrences that an earlier leader has asked for, so that their
    /// reports come to this replica. A goal that is known goes on, or its end is repeated.
    pub(crate) fn resume_occurrences(&mut self, ctx: &mut Context<Self>) {
        let now = timestamp(ctx.wall_clock());
        let open = self.clock.goals.iter().filter(|(_, due)| due.exchange.is_none());
        let open: Vec<_> = open.filter_map(|(id, due)| Some((id.clone(), due.pursued?))).collect();
        for (id, time) in open {
            let Some(due) = self.clock.goals.get_mut(&id) else { continue };
            let occurrence = due.schedule.occurrence(time);
            let conversation = occurrence_id(&id, time);
            let is_known = self.goals.contains_key(&conversation)
                || self.ended.outcome_of(&conversation).is_some();
            let is_open = match occurrence.ends {
                Some(ends) => now < ends,
                None => now.duration_since(time) <= LATE_MAX || due.is_always(),
            };
            if is_known || is_open {
                self.ask_for(&id, occurrence, ctx);
            } else {
                let spoken = due.schedule.clock_text(time, now);
                due.add_history(now, format!("{spoken}: no Journal knows what has become of it"));
                due.rest(now);
                self.replicate_due(&id, ctx);
            }
        }
    }
}

fn record_of(due: &DueGoal) -> DueRecord {
    DueRecord {
        initiator: due.initiator.clone(),
        asked: due.asked.clone(),
        number: due.number,
        times: due.times.clone(),
        asked_ms: due.seen.asked.map(Timestamp::as_millisecond),
        settled_ms: due.seen.settled.map(Timestamp::as_millisecond),
        pursued_ms: due.pursued.map(Timestamp::as_millisecond),
        took_ms: due.took_ms.clone(),
        is_of_file: due.is_of_file,
        happened: due.history.clone(),
        ended: None,
    }
}

fn instant(ms: Option<i64>) -> Option<Timestamp> {
    Timestamp::from_millisecond(ms?).ok()
}

#[cfg(test)]
mod tests {
    use acl::content::Outcome;

    use super::*;

    fn ended(id: &str) -> EndedDueGoal {
        EndedDueGoal {
            id: ConversationId::new(id),
            version: Version::default(),
            body: Value::Null,
            report: Report::new(Outcome::Cancelled, "cancelled as asked"),
        }
    }

    #[test]
    fn the_end_of_a_goal_of_the_file_is_never_dropped() {
        let of_file = ConversationId::of_file_goal("morning");
        let mut ends = EndedDueGoals::new([of_file.clone()].into());
        assert!(ends.add(ended(of_file.as_str())).is_empty());
        let dropped: Vec<_> =
            (0..ENDED_MAX + 2).flat_map(|n| ends.add(ended(&format!("c{n}")))).collect();
        assert_eq!(dropped, [ConversationId::new("c0"), ConversationId::new("c1")]);
        assert!(ends.report_of(&of_file).is_some());
        assert_eq!(ends.records().len(), ENDED_MAX + 1);
    }
}
