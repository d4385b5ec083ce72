//! Quiet hours: the hours of each day in which a channel waits, by the clock on the wall.

use jiff::civil::Time;
use jiff::tz::TimeZone;
use jiff::{Timestamp, ToSpan as _};

/// Maximum number of changes of the clock that are looked at for the end of quiet hours: a place
/// has two a year, and quiet hours last less than a day.
const CLOCK_CHANGES_MAX: usize = 4;

/// Hours of each day. The beginning belongs to them, the end does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct QuietHours {
    from: Time,
    until: Time,
}

// === impl QuietHours ===

impl QuietHours {
    /// Parses hours such as `22:00-07:00`.
    ///
    /// # Errors
    ///
    /// Returns a text for a person, which says what is wrong and what would be right.
    pub(crate) fn parse(text: &str) -> Result<QuietHours, String> {
        let wrong = |why: &str| {
            format!("`quiet = \"{text}\"`: {why}; write two times of day, such as \"22:00-07:00\"")
        };
        let (from, until) = text.split_once('-').ok_or_else(|| wrong("there is no `-` in it"))?;
        let time = |text: &str| {
            let text = text.trim();
            let parsed = text.parse::<Time>();
            parsed.ok().filter(|_| text.len() == "22:00".len())
        };
        let (from, until) =
            time(from).zip(time(until)).ok_or_else(|| wrong("a time of day is wrong"))?;
        if from == until {
            return Err(wrong("it begins when it ends"));
        }
        Ok(QuietHours { from, until })
    }

    /// Whether it is quiet at `now`.
    pub(crate) fn is_quiet(&self, now: Timestamp, zone: &TimeZone) -> bool {
        let time = zone.to_datetime(now).time();
        match self.from < self.until {
            true => self.from <= time && time < self.until,
            false => self.from <= time || time < self.until,
        }
    }

    /// Returns the first time from `now` on at which it is not quiet. The hours may end early or
    /// late, and twice in a night, where the clock is changed.
    pub(crate) fn end(&self, now: Timestamp, zone: &TimeZone) -> Timestamp {
        if !self.is_quiet(now, zone) {
            return now;
        }
        let day = zone.to_datetime(now).date();
        let days = (0..=2).filter_map(|days| day.checked_add(days.days()).ok());
        let ends = days.flat_map(|day| {
            let end = zone.to_ambiguous_timestamp(day.to_datetime(self.until));
            [end.earlier(), end.later()]
        });
        let changes = zone.following(now).take(CLOCK_CHANGES_MAX);
        let changes = changes.map(|change| change.timestamp());
        let later = ends.flatten().chain(changes).filter(|at| *at > now);
        // The fallback is for the last days that a clock can show.
        later.filter(|at| !self.is_quiet(*at, zone)).min().unwrap_or(Timestamp::MAX)
    }
}

#[cfg(test)]
mod tests {
    use jiff::SignedDuration;
    use proptest::prelude::*;

    use super::*;

    fn berlin() -> TimeZone {
        TimeZone::posix("CET-1CEST,M3.5.0,M10.5.0/3").expect("a zone")
    }

    fn at(text: &str) -> Timestamp {
        text.parse().expect("a time")
    }

    #[test]
    fn a_night_passes_midnight() {
        let quiet = QuietHours::parse("22:00-07:00").expect("hours");
        for (now, is_quiet, end) in [
            ("2026-11-28T20:59:59Z", false, "2026-11-28T20:59:59Z"),
            ("2026-11-28T21:00:00Z", true, "2026-11-29T06:00:00Z"),
            ("2026-11-29T05:59:59Z", true, "2026-11-29T06:00:00Z"),
            ("2026-11-29T06:00:00Z", false, "2026-11-29T06:00:00Z"),
        ] {
            assert_eq!(quiet.is_quiet(at(now), &berlin()), is_quiet, "{now}");
            assert_eq!(quiet.end(at(now), &berlin()), at(end), "{now}");
        }
    }

    /// The clock goes from 02:00 to 03:00, and 02:30 does not exist.
    #[test]
    fn hours_end_with_the_gap_in_which_their_end_is() {
        let quiet = QuietHours::parse("22:00-02:30").expect("hours");
        let change = at("2027-03-28T01:00:00Z");
        assert_eq!(quiet.end(at("2027-03-27T23:00:00Z"), &berlin()), change);
        assert!(quiet.is_quiet(change - 1.second(), &berlin()));
        assert!(!quiet.is_quiet(change, &berlin()));
    }

    /// The clock goes from 03:00 back to 02:00, and 02:30 comes twice: so does the end.
    #[test]
    fn hours_whose_end_comes_twice_end_twice() {
        let quiet = QuietHours::parse("22:00-02:30").expect("hours");
        assert_eq!(quiet.end(at("2026-10-24T23:00:00Z"), &berlin()), at("2026-10-25T00:30:00Z"));
        let again = at("2026-10-25T01:00:00Z");
        assert!(!quiet.is_quiet(again - 1.second(), &berlin()));
        assert!(quiet.is_quiet(again, &berlin()));
        assert_eq!(quiet.end(again, &berlin()), at("2026-10-25T01:30:00Z"));
    }

    #[test]
    fn wrong_hours_are_refused_with_what_would_be_right() {
        for wrong in ["", "22:00", "22-7", "22:00-25:00", "07:00-07:00", "a-b", "22:00:01-07:00"] {
            let why = QuietHours::parse(wrong).expect_err(wrong);
            assert!(why.contains("\"22:00-07:00\""), "{why}");
        }
    }

    fn minutes() -> impl Strategy<Value = (u32, u32)> {
        (0..1_440_u32, 0..1_440_u32).prop_filter("they differ", |(from, until)| from != until)
    }

    proptest! {
        /// Around both changes of the clock, the end is the first minute that is not quiet.
        #[test]
        fn the_end_is_the_first_time_that_is_not_quiet(
            (from, until) in minutes(),
            is_spring in any::<bool>(),
            minute in 0..4_320_i64,
        ) {
            let clock = |minute: u32| format!("{:02}:{:02}", minute / 60, minute % 60);
            let quiet = QuietHours::parse(&format!("{}-{}", clock(from), clock(until)));
            let quiet = quiet.expect("hours");
            let start = if is_spring { "2027-03-27T00:00:00Z" } else { "2026-10-24T00:00:00Z" };
            let mut now = at(start) + SignedDuration::from_mins(minute);
            let end = quiet.end(now, &berlin());
            prop_assert!(!quiet.is_quiet(end, &berlin()));
            while now < end {
                prop_assert!(quiet.is_quiet(now, &berlin()), "{now} is before {end}");
                now += SignedDuration::from_mins(1);
            }
        }
    }
}
