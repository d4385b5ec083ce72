//! One goal by the clock: its times, and what has come of them.

use std::time::SystemTime;

use acl::content::{
    Achieve, DueStatus, GoalPhase, GoalStatus, GoalTimes, HISTORY_ENTRIES_MAX, HistoryEntry,
    Reason, Version,
};
use acl::{AgentId, ConversationId, ReplyToken};
use goal_schedule::{Due, DueOccurrence, Schedule, SeenOccurrences};
use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};

/// Beginning of the keys of the records of goals by the clock.
pub(crate) const DUE: &str = "due/";

/// How long a goal of the file that is always asked for rests after it has ended by a failure, such
/// as a name that no agent has declared yet.
const ALWAYS_RESTS: SignedDuration = SignedDuration::from_secs(60);

/// How long an occurrence rests that was refused for the time being, such as because too many goals
/// are pursued: short beside the time for which it may be late, and long enough that 256 goals that
/// ask again are no load.
const REFUSED_RESTS: SignedDuration = SignedDuration::from_secs(5);

/// Step in which times are kept in records.
const CLOCK_GRAIN: SignedDuration = SignedDuration::from_millis(1);

/// Number of times that are kept of how long an occurrence took: enough for a median that one odd
/// day does not move.
pub(crate) const TIMES_LEARNED: usize = 9;

/// A goal that is asked for by the clock.
pub(crate) struct DueGoal {
    /// The agent that asked for it; the Plan Requester itself for a goal of the file.
    pub(crate) initiator: AgentId,
    pub(crate) asked: Achieve,
    /// The number by which people name the goal; 0 until it has one.
    pub(crate) number: u32,
    pub(crate) times: GoalTimes,
    pub(crate) schedule: Schedule,
    pub(crate) seen: SeenOccurrences,
    /// The occurrence whose goal was asked for and has not ended; `None` if there is none.
    pub(crate) pursued: Option<Timestamp>,
    /// The exchange in which this replica asked itself for that goal; `None` if it has not asked.
    pub(crate) exchange: Option<ReplyToken>,
    /// Whether the goal stands in the ecosystem file.
    pub(crate) is_of_file: bool,
    /// How long the last occurrences took until they were reached, in milliseconds, oldest first.
    pub(crate) took_ms: Vec<u64>,
    /// Time before which the goal is not asked for again: a goal that is always asked for after an
    /// end, and any goal after it was refused for the time being.
    rests_until: Option<Timestamp>,
    /// The occurrence that was refused last, for the time being, and was not accepted since; `None` if
    /// there is none. The history tells the first of several refusals only.
    refused: Option<Timestamp>,
    /// Version of the last record that was sent to the Journals.
    pub(crate) version: Version,
    pub(crate) history: Vec<HistoryEntry>,
}

/// Times at which the Plan Requester looks at a pursued goal, in milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct GoalLimits {
    /// Time by which the goal should be reached; `None` if there is no deadline, or if it was told
    /// that the goal is late.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) by_ms: Option<i64>,
    /// That time as text for a person.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) by_text: String,
    /// Time that the goal usually takes, in milliseconds; `None` if it is not known, or if it was told
    /// that the goal will be late.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) usual_ms: Option<i64>,
    /// Time at which the goal is given up; `None` if it is not given up by the clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) ends_ms: Option<i64>,
}

// === impl DueGoal ===

impl DueGoal {
    pub(crate) fn new(
        initiator: AgentId,
        asked: Achieve,
        times: GoalTimes,
        schedule: Schedule,
    ) -> DueGoal {
        DueGoal {
            initiator,
            asked,
            number: 0,
            times,
            schedule,
            seen: SeenOccurrences::default(),
            pursued: None,
            exchange: None,
            is_of_file: false,
            took_ms: Vec::new(),
            rests_until: None,
            refused: None,
            version: Version::default(),
            history: Vec::new(),
        }
    }

    /// Whether the goal is to be pursued at all times.
    pub(crate) fn is_always(&self) -> bool {
        self.schedule.is_at_once()
    }

    /// Returns what is due at the time `now`.
    pub(crate) fn due(&self, now: Timestamp) -> Due {
        let found = self.due_without_rest(now);
        // A clock that was set back must not prolong a rest.
        let rest = self
            .rests_until
            .filter(|until| now < *until && until.duration_since(now) <= ALWAYS_RESTS);
        match rest.filter(|_| found.now.is_some()) {
            Some(until) => {
                let next = found.next.map_or(until, |next| next.min(until));
                Due { now: None, next: Some(next), ..found }
            }
            None => found,
        }
    }

    fn due_without_rest(&self, now: Timestamp) -> Due {
        if !self.is_always() {
            return self.schedule.due(self.seen, now);
        }
        let occurrence = self.schedule.occurrence(now);
        let is_over = occurrence.ends.is_some_and(|ends| ends <= now);
        if is_over || self.pursued.is_some() {
            return Due::default();
        }
        Due { now: Some(occurrence), ..Due::default() }
    }

    /// Whether the goal will not be asked for any more and is not pursued.
    pub(crate) fn is_over(&self, now: Timestamp) -> bool {
        let due = self.due(now);
        self.pursued.is_none() && due.now.is_none() && due.next.is_none()
    }

    /// Notes that the goal of the present occurrence has ended.
    pub(crate) fn rest(&mut self, now: Timestamp) {
        self.pursued = None;
        self.exchange = None;
        self.refused = None;
        // The rule of a goal with times says when it comes again.
        let rests = self.is_always().then(|| now.checked_add(ALWAYS_RESTS).ok());
        self.rests_until = rests.flatten();
    }

    /// Notes how long the present occurrence took, which has just been reached.
    pub(crate) fn learn(&mut self, now: Timestamp) {
        let took = self.pursued.map(|due| now.duration_since(due).as_millis());
        let took = took.and_then(|took| u64::try_from(took).ok());
        if self.took_ms.len() >= TIMES_LEARNED {
            self.took_ms.remove(0);
        }
        self.took_ms.extend(took);
    }

    /// Returns the median time that an occurrence took; `None` if none was reached yet.
    fn usual_ms(&self) -> Option<i64> {
        let mut sorted = self.took_ms.clone();
        sorted.sort_unstable();
        sorted.get(sorted.len() / 2).and_then(|ms| i64::try_from(*ms).ok())
    }

    /// Takes back that the goal was asked for at the time `due`, because it was refused at the time
    /// `now` for the time being. The goal is asked for again after a rest, as long as it is not too
    /// late. Returns `true` if the refusal is the first one of this occurrence.
    pub(crate) fn take_back(&mut self, due: Timestamp, now: Timestamp) -> bool {
        let is_first = !self.is_refused(due);
        self.pursued = None;
        self.exchange = None;
        self.seen.asked = due.checked_sub(CLOCK_GRAIN).ok();
        self.rests_until = now.checked_add(REFUSED_RESTS).ok();
        self.refused = Some(due);
        is_first
    }

    /// Whether the goal of the occurrence `due` was refused before for the time being. All occurrences
    /// of a goal that is always asked for are one.
    pub(crate) fn is_refused(&self, due: Timestamp) -> bool {
        self.refused.is_some_and(|refused| refused == due || self.is_always())
    }

    /// Notes that the goal of the occurrence `due` was accepted. Returns `true` if it was refused
    /// before.
    pub(crate) fn accepted(&mut self, due: Timestamp) -> bool {
        let was_refused = self.is_refused(due);
        self.refused = None;
        was_refused
    }

    /// Returns the conversation of the goal that is pursued now; `None` if there is none.
    pub(crate) fn pursued_conversation(&self, id: &ConversationId) -> Option<ConversationId> {
        self.pursued.map(|due| occurrence_id(id, due))
    }

    /// Returns the limits of the goal that is asked for at the occurrence.
    pub(crate) fn limits(&self, occurrence: DueOccurrence) -> GoalLimits {
        let limits = GoalLimits::of(&self.schedule, occurrence);
        let usual_ms = limits.by_ms.and(self.usual_ms());
        GoalLimits { usual_ms, ..limits }
    }

    /// Adds an entry to the history, at the time `at`. Drops the oldest entry if it is full.
    pub(crate) fn add_history(&mut self, at: Timestamp, text: String) {
        if self.history.len() >= HISTORY_ENTRIES_MAX {
            self.history.remove(0);
        }
        let at_ms = u64::try_from(at.as_millisecond()).unwrap_or_default();
        self.history.push(HistoryEntry { at_ms, outcome: None, text });
    }

    /// Returns the state of the goal for users.
    pub(crate) fn status(&self, id: &ConversationId, now: Timestamp) -> GoalStatus {
        let due = self.due(now);
        let next = due.now.map(|occurrence| occurrence.due).or(due.next);
        let next_text = next.map(|next| self.schedule.clock_text(next, now));
        let pursued = self.pursued_conversation(id);
        let waits_because = match (&pursued, &next_text) {
            (Some(pursued), _) => format!("it is pursued as {pursued}"),
            (None, Some(next)) => format!("for {next}"),
            (None, None) => "it is not asked for again".to_owned(),
        };
        GoalStatus {
            conversation: id.clone(),
            number: self.number,
            goal: self.asked.goal.clone(),
            keep: self.asked.keep,
            priority: self.asked.priority,
            phase: GoalPhase::WaitingForChange,
            waits_because,
            rounds: 0,
            history: self.history.clone(),
            due: Some(Box::new(DueStatus {
                words: self.times.words.clone(),
                next_ms: next.and_then(|next| u64::try_from(next.as_millisecond()).ok()),
                next: next_text,
                pursued,
                by_ms: None,
                ends_ms: None,
            })),
        }
    }
}

// === impl GoalLimits ===

impl GoalLimits {
    /// Returns the limits of an occurrence.
    pub(crate) fn of(schedule: &Schedule, occurrence: DueOccurrence) -> GoalLimits {
        let by_text = occurrence.by.map(|by| schedule.clock_text(by, occurrence.due));
        GoalLimits {
            by_ms: occurrence.by.map(Timestamp::as_millisecond),
            by_text: by_text.unwrap_or_default(),
            usual_ms: None,
            ends_ms: occurrence.ends.map(Timestamp::as_millisecond),
        }
    }

    /// Whether there is nothing to look at.
    pub(crate) fn is_empty(&self) -> bool {
        self.by_ms.is_none() && self.ends_ms.is_none()
    }

    /// Returns the latest time at which the goal must be under way in order not to be late; `None` if
    /// it is not known.
    pub(crate) fn start_ms(&self) -> Option<i64> {
        Some(self.by_ms?.saturating_sub(self.usual_ms?))
    }

    /// Returns the next time at which the goal must be looked at; `None` if there is none.
    pub(crate) fn next(&self) -> Option<Timestamp> {
        let all = [self.by_ms, self.start_ms(), self.ends_ms];
        let first = all.into_iter().flatten().min()?;
        Timestamp::from_millisecond(first).ok()
    }

    /// Returns the limits for users; `None` if there are none.
    pub(crate) fn status(&self) -> Option<Box<DueStatus>> {
        let positive = |ms: Option<i64>| ms.and_then(|ms| u64::try_from(ms).ok());
        let (by_ms, ends_ms) = (positive(self.by_ms), positive(self.ends_ms));
        let status = DueStatus { by_ms, ends_ms, ..DueStatus::default() };
        (!self.is_empty()).then(|| Box::new(status))
    }
}

/// Returns the conversation of the goal that is asked for at the time `due`. It is the same on every
/// replica, so that a goal that two of them ask for is one goal.
pub(crate) fn occurrence_id(id: &ConversationId, due: Timestamp) -> ConversationId {
    ConversationId::new(&format!("{id}@{}", due.strftime("%Y%m%dT%H%M%SZ")))
}

/// Returns the goal by the clock to which the goal of this conversation belongs; `None` if the
/// conversation is of another form.
pub(crate) fn parent_of(id: &ConversationId) -> Option<ConversationId> {
    id.as_str().rsplit_once('@').map(|(parent, _)| ConversationId::new(parent))
}

/// Returns the time of a clock as an instant. A clock beyond the calendar is at its beginning.
pub(crate) fn timestamp(clock: SystemTime) -> Timestamp {
    Timestamp::try_from(clock).unwrap_or(Timestamp::UNIX_EPOCH)
}

/// Whether a request that was refused for this reason may be accepted unchanged a little later.
pub(crate) fn is_passing(reason: Reason) -> bool {
    matches!(reason, Reason::Busy | Reason::MailboxFull | Reason::StandingBy)
}

/// Returns what is known of the occurrences of one goal from two replicas.
pub(crate) fn merged(one: SeenOccurrences, other: SeenOccurrences) -> SeenOccurrences {
    SeenOccurrences { asked: one.asked.max(other.asked), settled: one.settled.max(other.settled) }
}

#[cfg(test)]
mod tests {
    use acl::content::Keep;
    use jiff::tz::TimeZone;

    use super::*;

    fn at(text: &str) -> Timestamp {
        text.parse().expect("an instant")
    }

    fn due_goal(times: GoalTimes) -> DueGoal {
        let schedule = Schedule::read(&times, TimeZone::UTC).expect("times");
        let asked = Achieve::new("(lit hall)", Keep::Achieve, 0);
        DueGoal::new(AgentId::new("ann").expect("a name"), asked, times, schedule)
    }

    fn daily() -> DueGoal {
        due_goal(GoalTimes {
            start: Some("2026-11-28T08:00:00".to_owned()),
            rule: Some("FREQ=DAILY".to_owned()),
            ..GoalTimes::default()
        })
    }

    fn ask(due: &mut DueGoal, time: Timestamp) {
        (due.seen.asked, due.pursued) = (Some(time), Some(time));
    }

    #[test]
    fn a_refused_occurrence_rests_and_is_told_once() {
        let time = at("2026-11-28T08:00:00Z");
        for mut due in [daily(), due_goal(GoalTimes::default())] {
            let mut firsts = Vec::new();
            for round in 0..3 {
                let now = time + REFUSED_RESTS * round;
                let found = due.due(now).now.expect("it has rested");
                ask(&mut due, found.due);
                firsts.push(due.take_back(found.due, now));
                let resting = due.due(now);
                assert_eq!((resting.now, resting.next), (None, Some(now + REFUSED_RESTS)));
                assert!(!due.is_over(now));
            }
            assert_eq!(firsts, [true, false, false]);
            let now = time + REFUSED_RESTS * 3;
            let found = due.due(now).now.expect("it has rested");
            ask(&mut due, found.due);
            assert!(due.accepted(found.due));
            assert!(!due.accepted(found.due), "it was told");
        }
    }

    #[test]
    fn an_occurrence_that_ended_does_not_delay_the_next() {
        let mut due = due_goal(GoalTimes {
            start: Some("2026-11-28T08:00:00".to_owned()),
            rule: Some("FREQ=MINUTELY".to_owned()),
            ..GoalTimes::default()
        });
        ask(&mut due, at("2026-11-28T08:00:00Z"));
        due.rest(at("2026-11-28T08:00:30Z"));
        let next = due.due(at("2026-11-28T08:01:00Z")).now.map(|next| next.due);
        assert_eq!(next, Some(at("2026-11-28T08:01:00Z")));
    }

    #[test]
    fn a_clock_that_goes_back_does_not_prolong_a_rest() {
        let mut always = due_goal(GoalTimes::default());
        always.rest(at("2036-11-28T08:00:00Z"));
        assert!(always.due(at("2026-11-28T08:00:00Z")).now.is_some());
    }

    #[test]
    fn a_full_mailbox_is_a_reason_to_ask_again() {
        assert!([Reason::Busy, Reason::MailboxFull].into_iter().all(is_passing));
        assert!(!is_passing(Reason::BadContent));
    }
}
