//! Single times as people write them: a time of the day, a duration, a date with a time.

use jiff::civil::{Date, DateTime, Time};
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp, ToSpan as _};

/// Longest duration that can be written: ten years. Longer ones are mistakes.
const DURATION_MAX: SignedDuration = SignedDuration::from_hours(24 * 366 * 10);

/// A time that is counted from another one, at which a goal was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TimeMark {
    /// This long after it.
    After(SignedDuration),
    /// The next time at which clocks show this time of the day.
    Clock(Time),
    /// A time of its own.
    At(DateTime),
}

impl TimeMark {
    /// Reads a mark.
    ///
    /// # Errors
    ///
    /// Returns a sentence for a person if the text is no mark.
    pub(crate) fn read(text: &str) -> Result<TimeMark, String> {
        let text = text.trim();
        if let Some(time) = time_of_day(text) {
            return Ok(TimeMark::Clock(time));
        }
        if let Some(time) = date_time(text) {
            return Ok(TimeMark::At(time));
        }
        duration(text).map(TimeMark::After).map_err(|_| {
            format!("`{text}` is no time; write 18:00, 2026-12-01T18:00, or a duration such as 2h")
        })
    }

    /// Returns the instant of the mark, counted from the instant `due` and the time `wall` on the
    /// calendar that leads to it. The two differ if summer time leaves `wall` out. Returns `None` at
    /// the end of the calendar.
    pub(crate) fn from(self, due: Timestamp, wall: DateTime, zone: &TimeZone) -> Option<Timestamp> {
        match self {
            TimeMark::After(duration) => due.checked_add(duration).ok(),
            TimeMark::At(time) => instant(time, zone),
            TimeMark::Clock(time) => instant(next_clock(time, wall)?, zone),
        }
    }

    /// Returns the instant of a deadline, counted like [`TimeMark::from`]. A deadline that summer time
    /// puts before `due` keeps its distance from the start instead: a goal that begins at 03:30 instead
    /// of 02:30 is not late at 03:15.
    pub(crate) fn deadline(
        self,
        due: Timestamp,
        wall: DateTime,
        zone: &TimeZone,
    ) -> Option<Timestamp> {
        let deadline = self.from(due, wall, zone)?;
        match self {
            TimeMark::Clock(time) if deadline <= due => {
                due.checked_add(wall.duration_until(next_clock(time, wall)?)).ok()
            }
            _ => Some(deadline),
        }
    }
}

/// Returns the next time after `wall` with this time of the day.
fn next_clock(time: Time, wall: DateTime) -> Option<DateTime> {
    let date = match time > wall.time() {
        true => wall.date(),
        false => wall.date().tomorrow().ok()?,
    };
    Some(date.to_datetime(time))
}

/// Returns the instant at which clocks show `time`. A time that is left out moves on; of a time that
/// comes twice, the first counts.
pub(crate) fn instant(time: DateTime, zone: &TimeZone) -> Option<Timestamp> {
    zone.to_ambiguous_timestamp(time).compatible().ok()
}

/// Returns both instants at which clocks show `time`, if it comes twice; otherwise one.
pub(crate) fn all_instants(time: DateTime, zone: &TimeZone) -> [Option<Timestamp>; 2] {
    let ambiguous = zone.to_ambiguous_timestamp(time);
    let is_twice = matches!(ambiguous.offset(), jiff::tz::AmbiguousOffset::Fold { .. });
    let later = if is_twice { ambiguous.later().ok() } else { None };
    [instant(time, zone), later]
}

/// Reads a time of the day: `08:00` or `08:00:30`; `24:00` is not one.
pub(crate) fn time_of_day(text: &str) -> Option<Time> {
    let mut parts = text.split(':');
    let number = |part: Option<&str>| {
        part.filter(|part| matches!(part.len(), 1 | 2) && part.bytes().all(|b| b.is_ascii_digit()))
            .and_then(|part| part.parse::<i8>().ok())
    };
    let (hour, minute) = (number(parts.next())?, number(parts.next())?);
    let second = match parts.next() {
        Some(second) => number(Some(second))?,
        None => 0,
    };
    match parts.next() {
        Some(_) => None,
        None => Time::new(hour, minute, second, 0).ok(),
    }
}

/// Reads a date with a time: `2026-12-01T08:00` or `2026-12-01 08:00:30`.
pub(crate) fn date_time(text: &str) -> Option<DateTime> {
    let (day, time) = text.split_once(['T', ' '])?;
    Some(date(day)?.to_datetime(time_of_day(time.trim())?))
}

/// Reads a date: `2026-12-01`.
pub(crate) fn date(text: &str) -> Option<Date> {
    let is_date = text.len() == 10 && text.bytes().all(|b| b.is_ascii_digit() || b == b'-');
    text.parse::<Date>().ok().filter(|date| is_date && (2000..9000).contains(&date.year()))
}

/// Reads a duration: `90s`, `15min`, `1h30min`, `2d`, `1w`.
///
/// # Errors
///
/// Returns a sentence for a person if the text is no duration, or if it is too long.
pub(crate) fn duration(text: &str) -> Result<SignedDuration, String> {
    let wrong = || format!("`{text}` is no duration; write 90s, 15min, 2h, 1h30min or 2d");
    let mut rest = text.trim();
    let mut total = SignedDuration::ZERO;
    if rest.is_empty() {
        return Err(wrong());
    }
    while !rest.is_empty() {
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        let (number, after) = rest.split_at(digits);
        let letters = after.bytes().take_while(u8::is_ascii_alphabetic).count();
        let (unit, after) = after.split_at(letters);
        let seconds = match unit {
            "s" | "sec" => 1,
            "min" => 60,
            "h" => 3_600,
            "d" | "day" | "days" => 86_400,
            "w" | "week" | "weeks" => 7 * 86_400,
            _ => return Err(wrong()),
        };
        let number: i64 = number.parse().map_err(|_| wrong())?;
        let part = number.checked_mul(seconds).map(SignedDuration::from_secs);
        let sum = part.and_then(|part| total.checked_add(part));
        total = sum.filter(|sum| *sum <= DURATION_MAX).ok_or_else(|| {
            format!("`{text}` is too long: ten years are the longest that can be written")
        })?;
        rest = after.trim_start();
    }
    match total.is_zero() {
        true => Err(wrong()),
        false => Ok(total),
    }
}

/// Reads hours of the day: `08:00-18:00`. The end may be smaller than the start: then the hours
/// contain midnight.
pub(crate) fn hours(text: &str) -> Option<(Time, Time)> {
    let (from, to) = text.split_once(['-', '–'])?;
    let to = match to.trim() {
        "24:00" => Time::midnight(),
        to => time_of_day(to)?,
    };
    Some((time_of_day(from.trim())?, to))
}

/// Returns `time` without its fraction of a second.
pub(crate) fn whole_seconds(time: DateTime) -> DateTime {
    time.with().subsec_nanosecond(0).build().unwrap_or(time)
}

/// Returns the next full minute; `time` itself if it is one.
pub(crate) fn next_minute(time: DateTime) -> DateTime {
    let down = time.with().second(0).subsec_nanosecond(0).build().unwrap_or(time);
    match down == time {
        true => time,
        false => down.checked_add(1.minute()).unwrap_or(time),
    }
}
