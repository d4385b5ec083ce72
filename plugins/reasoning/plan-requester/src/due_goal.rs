//! One goal by the clock: its times, and what has come of them.

use std::time::SystemTime;

use acl::content::{
    Achieve, DueStatus, GoalPhase, GoalStatus, GoalTimes, HISTORY_ENTRIES_MAX, HistoryEntry,
    Version,
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
    /// Time before which a goal that is always asked for is not asked for again.
    rests_until: Option<Timestamp>,
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
        if !self.is_always() {
            return self.schedule.due(self.seen, now);
        }
        let occurrence = self.schedule.occurrence(now);
        let is_over = occurrence.ends.is_some_and(|ends| ends <= now);
        if is_over || self.pursued.is_some() {
            return Due::default();
        }
        match self.rests_until.filter(|until| now < *until) {
            Some(until) => Due { next: Some(until), ..Due::default() },
            None => Due { now: Some(occurrence), ..Due::default() },
        }
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
        self.rests_until = now.checked_add(ALWAYS_RESTS).ok();
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

    /// Takes back that the goal was asked for at the time `due`, so that it is asked for again as long
    /// as it is not too late.
    pub(crate) fn take_back(&mut self, due: Timestamp) {
        self.pursued = None;
        self.exchange = None;
        self.seen.asked = due.checked_sub(CLOCK_GRAIN).ok();
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

/// Returns what is known of the occurrences of one goal from two replicas.
pub(crate) fn merged(one: SeenOccurrences, other: SeenOccurrences) -> SeenOccurrences {
    SeenOccurrences { asked: one.asked.max(other.asked), settled: one.settled.max(other.settled) }
}
