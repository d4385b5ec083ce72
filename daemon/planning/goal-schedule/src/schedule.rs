//! The times of a goal, ready to be computed with: which occurrence is due, which were missed, and
//! which is next.

use acl::content::GoalTimes;
use jiff::civil::{DateTime, Time};
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp};

use crate::error::ScheduleError;
use crate::mark::{self, TimeMark};
use crate::rule::RecurrenceRule;

/// How late a goal is still asked for: a quarter of an hour is short enough that the goal still has
/// its sense, and long enough for a machine that restarts, or for another one that takes over.
pub const LATE_MAX: SignedDuration = SignedDuration::from_mins(15);

/// How far a clock may be ahead of the present time when it asks for a goal, so that the goal is not
/// asked for again. A clock that goes back further was wrong before, and everything begins anew.
pub const CLOCK_ERROR_MAX: SignedDuration = SignedDuration::from_hours(31 * 24);

/// How many times of a rule are looked at for one answer: more than a rule has in two days. If none
/// of them fits, no later one will.
const LOOKED_AT_MAX: usize = 4_000;

/// How many missed occurrences are counted; more are told as “at least”.
const MISSED_MAX: usize = 100;

/// How far a time on the calendar and its instant can be apart from what the clock of the zone says:
/// a zone has once left out a whole day. A rule of hours or minutes only meets summer time.
const ZONE_SHIFT_MAX: SignedDuration = SignedDuration::from_hours(26);
const SUMMER_TIME_MAX: SignedDuration = SignedDuration::from_hours(3);

/// The times of a goal.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    zone: TimeZone,
    start: Option<DateTime>,
    rule: Option<RecurrenceRule>,
    hours: Option<(Time, Time)>,
    ends: Option<TimeMark>,
    by: Option<TimeMark>,
    until: Option<Timestamp>,
}

/// One time at which a goal is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DueOccurrence {
    /// The time.
    pub due: Timestamp,
    /// Time at which the goal is given up; `None` if it is not given up by the clock.
    pub ends: Option<Timestamp>,
    /// Time by which the goal should be reached; `None` if there is no deadline.
    pub by: Option<Timestamp>,
}

/// What is known of earlier occurrences.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SeenOccurrences {
    /// The latest occurrence for which the goal was asked for.
    pub asked: Option<Timestamp>,
    /// The latest time up to which occurrences are settled: each was asked for, or is missed.
    pub settled: Option<Timestamp>,
}

/// Occurrences that were missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MissedTimes {
    /// Number of occurrences; at least this number if it is the most that are counted.
    pub count: usize,
    /// The last one.
    pub last: Timestamp,
}

/// What is due at some time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Due {
    /// The occurrence for which the goal is to be asked for now; `None` if there is none.
    pub now: Option<DueOccurrence>,
    /// Occurrences that came and are too old to be asked for; `None` if there are none.
    pub missed: Option<MissedTimes>,
    /// The next time at which the goal is to be asked for; `None` if it never is again.
    pub next: Option<Timestamp>,
}

// === impl Schedule ===

impl Schedule {
    /// Reads the times of a goal. `zone` is the time zone that they name, or, if they name none, that
    /// of the reader.
    ///
    /// # Errors
    ///
    /// Returns the mistake if a time cannot be read.
    pub fn read(times: &GoalTimes, zone: TimeZone) -> Result<Schedule, ScheduleError> {
        let moment = |option, text: &Option<String>| match text {
            None => Ok(None),
            Some(text) => mark::date_time(text).map(Some).ok_or_else(|| {
                let message = format!("`{text}` is no time; write 2026-12-01T08:00");
                ScheduleError::new(option, message)
            }),
        };
        let span = |option, text: &Option<String>| match text {
            None => Ok(None),
            Some(text) => TimeMark::read(text)
                .map(Some)
                .map_err(|message| ScheduleError::new(option, message)),
        };
        let start = moment("at", &times.start)?;
        let rule = times.rule.as_deref().map(RecurrenceRule::read).transpose();
        let rule = rule.map_err(|message| ScheduleError::new("every", message))?;
        if rule.is_some() && start.is_none() {
            return Err(ScheduleError::new("every", "a recurrence needs the time of its start"));
        }
        let hours = times.hours.as_deref().map(|text| mark::hours(text).ok_or(text)).transpose();
        let hours = hours.map_err(|text| {
            let message = format!("`{text}` are no hours of the day; write 08:00-18:00");
            ScheduleError::new("between", message)
        })?;
        let (ends, by) = (span("for", &times.ends)?, span("by", &times.by)?);
        let until = moment("until", &times.until)?.and_then(|time| mark::instant(time, &zone));
        Ok(Schedule { zone, start, rule, hours, ends, by, until })
    }

    /// Whether the goal is asked for at once, and not at a time of its own.
    pub fn is_at_once(&self) -> bool {
        self.start.is_none()
    }

    /// Returns the occurrence at the time `due`.
    pub fn occurrence(&self, due: Timestamp) -> DueOccurrence {
        let wall = self.wall_time(due);
        let ends = self.ends.and_then(|ends| ends.from(due, wall, &self.zone));
        let ends = ends.into_iter().chain(self.until).min();
        DueOccurrence { due, ends, by: self.by.and_then(|by| by.deadline(due, wall, &self.zone)) }
    }

    /// Returns the time on the calendar that leads to the instant `due`: what clocks show then, unless
    /// the schedule has a time that summer time leaves out, and that has moved on to `due`.
    fn wall_time(&self, due: Timestamp) -> DateTime {
        let shown = self.zone.to_datetime(due);
        let Some(start) = self.start else { return shown };
        let before = due.checked_sub(ZONE_SHIFT_MAX).unwrap_or(due);
        let has_moved_on = self.zone.to_offset(due) > self.zone.to_offset(before);
        if !has_moved_on {
            return shown;
        }
        let leads_there = |time: &DateTime| mark::instant(*time, &self.zone) == Some(due);
        let Some(rule) = &self.rule else {
            return if leads_there(&start) { start } else { shown };
        };
        let from = shown.checked_sub(ZONE_SHIFT_MAX).unwrap_or(start).max(start);
        let times = rule.times_from(start, from, &self.zone).take(LOOKED_AT_MAX);
        let all = times.take_while(|time| *time <= shown).filter(leads_there);
        // A rule may have both the time that is left out and the time to which it moves.
        all.last().unwrap_or(shown)
    }

    /// Whether the hours of an occurrence end after it begins: summer time can leave out the hour in
    /// which they lie.
    fn has_time(&self, due: Timestamp) -> bool {
        match self.ends {
            Some(ends @ TimeMark::Clock(_)) => {
                let ends = ends.from(due, self.wall_time(due), &self.zone);
                ends.is_none_or(|ends| ends > due)
            }
            _ => true,
        }
    }

    /// Returns the first time at which the goal is asked for after the time `after`; `None` if there
    /// is none.
    pub fn next_after(&self, after: Timestamp) -> Option<Timestamp> {
        self.times_after(after, 1, Timestamp::MAX).first().copied()
    }

    /// Whether the rule has a time at all, whatever the present time is.
    pub(crate) fn ever_comes(&self) -> bool {
        let unbounded = Schedule { until: None, ..self.clone() };
        self.start.is_none() || unbounded.next_after(Timestamp::MIN).is_some()
    }

    /// Returns what is due at the time `now`, if `seen` is known of earlier occurrences.
    ///
    /// Of several occurrences that have come, the goal is asked for once, for the latest: if it is at
    /// most [`LATE_MAX`] late, or if the time in which the goal is to be pursued has not ended. The
    /// others are missed. An occurrence for which the goal was asked for never comes again, unless the
    /// clock has gone back by more than [`CLOCK_ERROR_MAX`].
    pub fn due(&self, seen: SeenOccurrences, now: Timestamp) -> Due {
        let horizon = now.checked_add(CLOCK_ERROR_MAX).unwrap_or(Timestamp::MAX);
        let asked = seen.asked.filter(|asked| *asked <= horizon);
        let settled = seen.settled.filter(|settled| *settled <= now);
        let after = asked.into_iter().chain(settled).max().unwrap_or(Timestamp::MIN);
        let mut come = self.times_after(after, MISSED_MAX + 1, now);
        let count = come.len();
        if count > MISSED_MAX {
            // So many were missed that only the latest ones are of interest.
            let from = now.checked_sub(ZONE_SHIFT_MAX).unwrap_or(after).max(after);
            come.extend(self.times_after(from, LOOKED_AT_MAX, now));
        }
        let last = come.iter().max().map(|last| self.occurrence(*last));
        let chosen = last.filter(|last| {
            let is_open = last.ends.is_none_or(|ends| now < ends);
            let is_fresh = now.duration_since(last.due) <= LATE_MAX;
            is_open && (is_fresh || last.ends.is_some())
        });
        let missed = come.iter().filter(|time| chosen.is_none_or(|chosen| **time != chosen.due));
        let missed = missed.max().map(|last| MissedTimes {
            count: count.min(MISSED_MAX).saturating_sub(usize::from(chosen.is_some())).max(1),
            last: *last,
        });
        Due { now: chosen, missed, next: self.next_after(now.max(after)) }
    }

    /// Returns the first `count` times after the time `after` and up to the time `end`, in order.
    fn times_after(&self, after: Timestamp, count: usize, end: Timestamp) -> Vec<Timestamp> {
        let Some(start) = self.start else { return Vec::new() };
        let mut found = Vec::new();
        let is_wanted = |time: &Timestamp| {
            *time > after
                && *time <= end
                && self.until.is_none_or(|until| *time < until)
                && self.has_time(*time)
        };
        let Some(rule) = &self.rule else {
            found.extend(mark::instant(start, &self.zone).filter(is_wanted));
            return found;
        };
        let shift = if rule.is_quick() { SUMMER_TIME_MAX } else { ZONE_SHIFT_MAX };
        let from = self.zone.to_datetime(after).checked_sub(shift).unwrap_or(start).max(start);
        let last = if rule.is_quick() { end.checked_add(shift).unwrap_or(end) } else { end };
        let mut enough_at = None;
        for time in rule.times_from(start, from, &self.zone).take(LOOKED_AT_MAX) {
            // Behind a time that comes twice there may be an earlier instant.
            if enough_at.is_some_and(|end| time > end) {
                break;
            }
            let [first, second] = mark::all_instants(time, &self.zone);
            if first
                .is_some_and(|first| first > last || self.until.is_some_and(|until| first >= until))
            {
                break;
            }
            if !self.hours.is_none_or(|hours| is_within(time.time(), hours)) {
                continue;
            }
            let second = second.filter(|_| rule.is_quick());
            found.extend(first.into_iter().chain(second).filter(is_wanted));
            if found.len() >= count && enough_at.is_none() {
                let end = if rule.is_quick() { time.checked_add(shift).ok() } else { None };
                enough_at = Some(end.unwrap_or(time));
            }
        }
        found.sort_unstable();
        found.dedup();
        found.truncate(count);
        found
    }

    /// Formats the instant `at` for a person, as clocks of the schedule's time zone show it:
    /// `Thursday 08:00`, with the date if it is more than six days from `now`.
    pub fn clock_text(&self, at: Timestamp, now: Timestamp) -> String {
        let (at, now) = (self.zone.to_datetime(at), self.zone.to_datetime(now));
        let days = now.date().until(at.date()).map_or(i32::MAX, |span| span.get_days());
        let time = if at.second() == 0 { "%H:%M" } else { "%H:%M:%S" };
        match days {
            0 => format!("today {}", at.strftime(time)),
            1..7 => at.strftime(&format!("%A {time}")).to_string(),
            _ => at.strftime(&format!("%A %Y-%m-%d {time}")).to_string(),
        }
    }
}

/// Whether a time of the day is within hours that may contain midnight.
fn is_within(time: Time, (from, to): (Time, Time)) -> bool {
    match from < to {
        true => from <= time && time < to,
        false => from <= time || time < to,
    }
}
