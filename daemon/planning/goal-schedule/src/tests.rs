//! Tests of times: as people write them, over summer time and leap days, and with clocks that jump.

use acl::content::{GoalTimes, Keep};
use jiff::Timestamp;
use jiff::tz::TimeZone;

use crate::{Asking, Author, Schedule, ScheduleError, SeenOccurrences, TimeOptions, read_options};

/// Saturday, 2026-11-28 18:00 in Berlin.
const NOW: &str = "2026-11-28T17:00:00Z";

fn berlin() -> TimeZone {
    TimeZone::get("Europe/Berlin").expect("the machine has a table of time zones")
}

fn at(text: &str) -> Timestamp {
    text.parse().expect("an instant")
}

fn asking(keep: Keep) -> Asking {
    Asking { author: Author::Person, keep, zone: berlin(), now: at(NOW) }
}

fn options(given: &[(&str, &str)]) -> TimeOptions {
    let mut options = TimeOptions::default();
    for (name, text) in given {
        let field = match *name {
            "at" => &mut options.at,
            "by" => &mut options.by,
            "every" => &mut options.every,
            "on" => &mut options.on,
            "between" => &mut options.between,
            "until" => &mut options.until,
            _ => &mut options.lasts,
        };
        *field = Some((*text).to_owned());
    }
    options
}

fn read(given: &[(&str, &str)]) -> Result<GoalTimes, ScheduleError> {
    let is_window = given.iter().any(|(name, _)| *name == "between")
        && given.iter().all(|(name, _)| *name != "every");
    let keep = if is_window { Keep::Maintain } else { Keep::Achieve };
    read_options(&options(given), &asking(keep))
}

fn schedule(given: &[(&str, &str)]) -> Schedule {
    let times = read(given).unwrap_or_else(|error| panic!("{given:?}: {error}"));
    Schedule::read(&times, berlin()).expect("what was read once is read again")
}

/// Returns the first occurrences after `after`, in local time with the offset.
fn first(schedule: &Schedule, mut after: Timestamp, count: usize) -> Vec<String> {
    let mut found = Vec::new();
    while found.len() < count
        && let Some(next) = schedule.next_after(after)
    {
        assert!(next > after, "{next} is not after {after}");
        found.push(next.to_zoned(berlin()).strftime("%a %F %H:%M%z").to_string());
        after = next;
    }
    found
}

#[track_caller]
fn comes(given: &[(&str, &str)], expected: &[&str]) {
    assert_eq!(first(&schedule(given), at(NOW), expected.len()), expected, "{given:?}");
}

#[track_caller]
fn refused(given: &[(&str, &str)], option: &str, part: &str) {
    let error = read(given).expect_err("a mistake");
    assert_eq!(error.option, option, "{error}");
    assert!(error.message.contains(part), "{error}");
}

#[test]
fn times_are_read_as_people_write_them() {
    comes(&[("at", "19:00")], &["Sat 2026-11-28 19:00+0100"]);
    comes(&[("at", "08:00")], &["Sun 2026-11-29 08:00+0100"]);
    comes(&[("at", "2026-12-01T08:00")], &["Tue 2026-12-01 08:00+0100"]);
    comes(&[("every", "day 08:00")], &["Sun 2026-11-29 08:00+0100", "Mon 2026-11-30 08:00+0100"]);
    comes(
        &[("every", "day 08:00"), ("on", "workdays")],
        &["Mon 2026-11-30 08:00+0100", "Tue 2026-12-01 08:00+0100"],
    );
    comes(
        &[("every", "mon,fri 08:00")],
        &["Mon 2026-11-30 08:00+0100", "Fri 2026-12-04 08:00+0100", "Mon 2026-12-07 08:00+0100"],
    );
    comes(&[("every", "week wednesday 07:30")], &["Wed 2026-12-02 07:30+0100"]);
    comes(
        &[("every", "month 1 08:00")],
        &["Tue 2026-12-01 08:00+0100", "Fri 2027-01-01 08:00+0100"],
    );
    comes(
        &[("every", "month last 18:00")],
        &["Mon 2026-11-30 18:00+0100", "Thu 2026-12-31 18:00+0100"],
    );
    comes(&[("every", "hour")], &["Sat 2026-11-28 19:00+0100", "Sat 2026-11-28 20:00+0100"]);
    comes(&[("every", "15min")], &["Sat 2026-11-28 18:15+0100", "Sat 2026-11-28 18:30+0100"]);
    comes(&[("every", "6h")], &["Sun 2026-11-29 00:00+0100", "Sun 2026-11-29 06:00+0100"]);
    comes(
        &[("every", "RRULE:FREQ=WEEKLY;BYDAY=MO,FR;BYHOUR=8;BYMINUTE=0")],
        &["Mon 2026-11-30 08:00+0100", "Fri 2026-12-04 08:00+0100"],
    );
    comes(
        &[("every", "hour"), ("between", "08:00-10:00"), ("on", "mon")],
        &["Mon 2026-11-30 08:00+0100", "Mon 2026-11-30 09:00+0100", "Mon 2026-12-07 08:00+0100"],
    );
}

#[test]
fn what_cannot_be_meant_is_refused_with_the_cure() {
    refused(&[("at", "25:00")], "at", "write 08:00");
    refused(&[("at", "2026-11-28T08:00")], "at", "is past; it is Saturday 2026-11-28 18:00");
    refused(&[("at", "2026-12-01")], "at", "at what time?");
    refused(&[("at", "08:00"), ("every", "hour")], "at", "again and again");
    refused(&[("every", "day")], "every", "\"day 08:00\"");
    refused(&[("every", "fortnight")], "every", "is no recurrence");
    refused(&[("every", "year 30-02 08:00")], "every", "the month stands first, such as 02-30");
    refused(&[("every", "year 13-40 08:00")], "every", "the month stands first, such as 12-24");
    refused(&[("every", "90s")], "every", "whole number of minutes");
    refused(&[("every", "RRULE:FREQ=SECONDLY")], "every", "once a minute");
    refused(&[("every", "RRULE:BYHOUR=8")], "every", "FREQ");
    refused(&[("every", "FREQ=DAILY;BYHOUR=31")], "every", "RFC 5545");
    refused(&[("every", "FREQ=DAILY;EVIL=1")], "every", "EVIL");
    refused(&[("on", "workdays")], "on", "needs `every`");
    refused(&[("every", "mon 08:00"), ("on", "fri")], "on", "says the days already");
    refused(&[("every", "day 08:00"), ("on", "someday")], "on", "names no days");
    refused(&[("every", "day 08:00"), ("on", "weekdays")], "on", "did you mean workdays?");
    refused(&[("every", "8:00")], "every", "write \"day 8:00\"");
    refused(&[("between", "8-18")], "between", "08:00-18:00");
    refused(&[("for", "a while")], "for", "is no duration");
    refused(&[("until", "2026-11-27")], "until", "is past");
    let achieve = read_options(&options(&[("between", "08:00-18:00")]), &asking(Keep::Achieve));
    assert!(achieve.expect_err("a mistake").message.contains("--maintain"));
}

#[test]
fn recurrences_that_never_come_are_refused() {
    for every in ["RRULE:FREQ=YEARLY;BYMONTH=2;BYMONTHDAY=30;BYHOUR=8", "year 02-30 08:00"] {
        refused(&[("every", every)], "every", "never comes");
    }
    refused(&[("every", "day 20:00"), ("between", "08:00-18:00")], "every", "never comes");
    refused(&[("every", "day 08:00"), ("until", "19:00")], "until", "before its end");
}

#[test]
fn a_file_needs_the_date_of_a_single_time() {
    let file = Asking { author: Author::File, ..asking(Keep::Achieve) };
    let error = read_options(&options(&[("at", "08:00")]), &file).expect_err("no date");
    assert!(error.message.contains("every = \"day 08:00\""), "{error}");
    // A time that has passed is no mistake of a file, which stays as it is.
    read_options(&options(&[("at", "2020-01-01T08:00")]), &file).expect("it is readable");
}

#[test]
fn an_hour_that_does_not_exist_moves_on() {
    // Clocks go from 02:00 to 03:00 on 2027-03-28.
    let daily = schedule(&[("every", "day 02:30")]);
    let expected =
        ["Sat 2027-03-27 02:30+0100", "Sun 2027-03-28 03:30+0200", "Mon 2027-03-29 02:30+0200"];
    assert_eq!(first(&daily, at("2027-03-26T12:00:00Z"), 3), expected);
    let hourly = schedule(&[("every", "hour")]);
    let expected =
        ["Sun 2027-03-28 01:00+0100", "Sun 2027-03-28 03:00+0200", "Sun 2027-03-28 04:00+0200"];
    assert_eq!(first(&hourly, at("2027-03-27T23:30:00Z"), 3), expected);
}

#[test]
fn hours_that_end_in_the_hour_that_is_left_out_do_not_last_a_day() {
    // Clocks go from 02:00 to 03:00 on 2027-03-28.
    for between in ["02:15-03:15", "02:30-03:15"] {
        let times = schedule(&[("between", between)]);
        let next = times.next_after(at("2027-03-27T12:00:00Z")).expect("the next day");
        assert_eq!(next.to_zoned(berlin()).date().to_string(), "2027-03-29", "{between}");
        let ends = times.occurrence(next).ends.expect("an end");
        assert!(ends.duration_since(next) <= jiff::SignedDuration::from_hours(1), "{between}");
    }
    for (between, ends) in
        [("02:15-04:00", "2027-03-28T02:00:00Z"), ("02:15-02:45", "2027-03-28T01:45:00Z")]
    {
        let times = schedule(&[("between", between)]);
        let next = times.next_after(at("2027-03-27T12:00:00Z")).expect("the same day");
        let occurrence = times.occurrence(next);
        assert_eq!(occurrence.due, at("2027-03-28T01:15:00Z"), "{between}");
        assert_eq!(occurrence.ends, Some(at(ends)), "{between}");
    }
}

#[test]
fn a_deadline_moves_on_with_a_start_that_is_left_out() {
    let times = schedule(&[("every", "day 02:30"), ("by", "03:15")]);
    let occurrence = times.occurrence(at("2027-03-28T01:30:00Z"));
    assert_eq!(occurrence.by, Some(at("2027-03-28T02:15:00Z")), "45 minutes after 03:30");
    let times = schedule(&[("every", "day 02:30"), ("by", "05:00")]);
    let occurrence = times.occurrence(at("2027-03-28T01:30:00Z"));
    assert_eq!(occurrence.by, Some(at("2027-03-28T03:00:00Z")));
    // A start at the time to which the other one moves is a start of its own.
    let times = schedule(&[("every", "day 03:30"), ("by", "03:15")]);
    let occurrence = times.occurrence(at("2027-03-28T01:30:00Z"));
    assert_eq!(occurrence.by, Some(at("2027-03-29T01:15:00Z")));
    // Of a time that comes twice, the second has a deadline after it, too.
    let times = schedule(&[("every", "30min"), ("by", "02:45")]);
    let occurrence = times.occurrence(at("2027-10-31T01:30:00Z"));
    assert_eq!(occurrence.by, Some(at("2027-10-31T01:45:00Z")));
}

#[test]
fn an_hour_that_comes_twice_counts_once() {
    // Clocks go from 03:00 to 02:00 on 2027-10-31.
    let daily = schedule(&[("every", "day 02:30")]);
    let expected =
        ["Sat 2027-10-30 02:30+0200", "Sun 2027-10-31 02:30+0200", "Mon 2027-11-01 02:30+0100"];
    assert_eq!(first(&daily, at("2027-10-29T12:00:00Z"), 3), expected);
    // What comes every hour goes on through it.
    let hourly = schedule(&[("every", "30min")]);
    let expected = [
        "Sun 2027-10-31 02:00+0200",
        "Sun 2027-10-31 02:30+0200",
        "Sun 2027-10-31 02:00+0100",
        "Sun 2027-10-31 02:30+0100",
        "Sun 2027-10-31 03:00+0100",
    ];
    assert_eq!(first(&hourly, at("2027-10-30T23:59:00Z"), 5), expected);
}

#[test]
fn a_leap_day_comes_in_leap_years() {
    let leap = schedule(&[("every", "year 02-29 08:00")]);
    let expected = ["Tue 2028-02-29 08:00+0100", "Sun 2032-02-29 08:00+0100"];
    assert_eq!(first(&leap, at(NOW), 2), expected);
    comes(
        &[("every", "month 31 08:00")],
        &["Thu 2026-12-31 08:00+0100", "Sun 2027-01-31 08:00+0100", "Wed 2027-03-31 08:00+0200"],
    );
}

#[test]
fn hours_of_the_day_begin_and_end_by_the_clock() {
    let times = schedule(&[("between", "08:00-18:00"), ("on", "workdays")]);
    let next = times.next_after(at(NOW)).expect("Monday");
    let occurrence = times.occurrence(next);
    assert_eq!(occurrence.due, at("2026-11-30T07:00:00Z"));
    assert_eq!(occurrence.ends, Some(at("2026-11-30T17:00:00Z")));
    // Hours that have begun are kept from now on.
    let night = schedule(&[("between", "17:30-06:00")]);
    let due = night.due(SeenOccurrences::default(), at(NOW));
    let now = due.now.expect("it is within the hours");
    assert_eq!((now.due, now.ends), (at("2026-11-28T16:30:00Z"), Some(at("2026-11-29T05:00:00Z"))));
    assert_eq!(due.missed, None);
    // Summer time begins in the night: by the clock, it ends at 06:00.
    let night = night.occurrence(at("2027-03-27T16:30:00Z"));
    assert_eq!(night.ends, Some(at("2027-03-28T04:00:00Z")));
}

#[test]
fn deadlines_and_ends_are_counted_from_the_occurrence() {
    let times = schedule(&[("every", "day 08:00"), ("by", "09:00"), ("for", "2h")]);
    let occurrence = times.occurrence(at("2026-11-29T07:00:00Z"));
    assert_eq!(occurrence.by, Some(at("2026-11-29T08:00:00Z")));
    assert_eq!(occurrence.ends, Some(at("2026-11-29T09:00:00Z")));
    let times = schedule(&[("until", "20:00"), ("by", "30min")]);
    assert!(times.is_at_once());
    let occurrence = times.occurrence(at(NOW));
    assert_eq!(occurrence.by, Some(at("2026-11-28T17:30:00Z")));
    assert_eq!(occurrence.ends, Some(at("2026-11-28T19:00:00Z")));
}

fn asked(text: &str) -> SeenOccurrences {
    SeenOccurrences { asked: Some(at(text)), settled: None }
}

#[test]
fn a_machine_that_slept_asks_once_or_misses() {
    let daily = schedule(&[("every", "day 08:00")]);
    let seen = asked("2026-11-29T07:00:00Z");
    // Ten minutes late.
    let due = daily.due(seen, at("2026-11-30T07:10:00Z"));
    assert_eq!(due.now.map(|now| now.due), Some(at("2026-11-30T07:00:00Z")));
    assert_eq!((due.missed, due.next), (None, Some(at("2026-12-01T07:00:00Z"))));
    // Two days late, and ten minutes.
    let due = daily.due(seen, at("2026-12-02T07:10:00Z"));
    assert_eq!(due.now.map(|now| now.due), Some(at("2026-12-02T07:00:00Z")));
    let missed = due.missed.expect("two days were missed");
    assert_eq!((missed.count, missed.last), (2, at("2026-12-01T07:00:00Z")));
    // Too late for all of them.
    let due = daily.due(seen, at("2026-12-02T12:00:00Z"));
    assert_eq!(due.now, None);
    assert_eq!(due.missed.map(|missed| missed.count), Some(3));
    // A year of quarters of an hour is looked at in bounds.
    let often = schedule(&[("every", "15min")]);
    let due = often.due(seen, at("2027-11-29T07:01:00Z"));
    assert_eq!(due.now.map(|now| now.due), Some(at("2027-11-29T07:00:00Z")));
    assert_eq!(due.missed.map(|missed| missed.last), Some(at("2027-11-29T06:45:00Z")));
}

#[test]
fn a_clock_that_goes_back_repeats_nothing() {
    let hourly = schedule(&[("every", "hour")]);
    let seen = asked("2026-11-29T07:00:00Z");
    let due = hourly.due(seen, at("2026-11-28T20:00:30Z"));
    assert_eq!((due.now, due.missed), (None, None));
    assert_eq!(due.next, Some(at("2026-11-29T08:00:00Z")));
    // A clock that was wrong by years does not silence the goal for years.
    let wrong = asked("2036-11-29T07:00:00Z");
    let due = hourly.due(wrong, at("2026-11-29T07:00:30Z"));
    assert_eq!(due.next, Some(at("2026-11-29T08:00:00Z")));
    // What a clock that was ahead took for missed comes in its time.
    let ahead = SeenOccurrences { asked: None, settled: Some(at("2036-11-29T07:00:00Z")) };
    let due = hourly.due(ahead, at("2026-11-29T07:00:30Z"));
    assert_eq!(due.now.map(|now| now.due), Some(at("2026-11-29T07:00:00Z")));
}

#[test]
fn a_goal_that_is_pursued_for_a_while_is_asked_for_within_it() {
    let times = schedule(&[("every", "day 08:00"), ("for", "2h")]);
    let due = times.due(asked("2026-11-29T07:00:00Z"), at("2026-11-30T08:30:00Z"));
    assert_eq!(due.now.map(|now| now.due), Some(at("2026-11-30T07:00:00Z")));
    let due = times.due(asked("2026-11-29T07:00:00Z"), at("2026-11-30T09:00:00Z"));
    assert_eq!(due.now, None);
}

#[test]
fn times_are_told_to_people() {
    let times = schedule(&[("every", "day 08:00")]);
    let text = |time| times.clock_text(at(time), at(NOW));
    assert_eq!(text("2026-11-28T19:00:00Z"), "today 20:00");
    assert_eq!(text("2026-12-03T07:00:00Z"), "Thursday 08:00");
    assert_eq!(text("2026-12-24T07:00:30Z"), "Thursday 2026-12-24 08:00:30");
}

mod properties {
    use proptest::prelude::*;

    use super::*;

    fn any_rule() -> impl Strategy<Value = String> {
        let frequency = prop_oneof!["MINUTELY", "HOURLY", "DAILY", "WEEKLY", "MONTHLY", "YEARLY"];
        let part = prop_oneof![
            (1..1_100i32).prop_map(|n| format!("INTERVAL={n}")),
            (1..50i32).prop_map(|n| format!("COUNT={n}")),
            (0..25i32).prop_map(|n| format!("BYHOUR={n}")),
            (0..61i32).prop_map(|n| format!("BYMINUTE={n}")),
            (-32..33i32).prop_map(|n| format!("BYMONTHDAY={n}")),
            (0..14i32).prop_map(|n| format!("BYMONTH={n}")),
            (-54..54i32).prop_map(|n| format!("BYWEEKNO={n}")),
            (-367..367i32).prop_map(|n| format!("BYYEARDAY={n}")),
            (-5..6i32).prop_map(|n| format!("BYSETPOS={n}")),
            "BYDAY=(-?[0-5]?(MO|WE|SU))(,TU)?",
            "UNTIL=20(26|27|99)[0-1][0-9][0-3][0-9](T[0-2][0-9]0000Z?)?",
            "WKST=(MO|SU|XX)",
        ];
        (frequency, prop::collection::vec(part, 0..4))
            .prop_map(|(frequency, parts)| format!("FREQ={frequency};{}", parts.join(";")))
            .prop_map(|rule| rule.trim_end_matches(';').to_owned())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Whatever is asked for, nothing panics, and times come in order.
        #[test]
        fn any_rule_is_refused_or_comes_in_order(rule in any_rule()) {
            let asked = TimeOptions { every: Some(rule), ..TimeOptions::default() };
            if let Ok(times) = read_options(&asked, &asking(Keep::Achieve)) {
                let schedule = Schedule::read(&times, berlin()).expect("it was read");
                first(&schedule, at(NOW), 5);
            }
        }

        #[test]
        fn any_text_is_refused_or_read(text in "\\PC{0,40}") {
            for name in ["at", "by", "every", "on", "between", "until", "for"] {
                let _ = read(&[(name, &text)]);
                let _ = read(&[("every", "day 08:00"), (name, &text)]);
            }
        }

        /// An occurrence is asked for once, however the clock jumps in between.
        #[test]
        fn jumps_of_the_clock_repeat_nothing(jumps in prop::collection::vec(-90_000..90_000i64, 1..25)) {
            let schedule = schedule(&[("every", "30min")]);
            let (mut now, mut seen) = (at("2027-10-30T12:00:00Z"), SeenOccurrences::default());
            let mut all = std::collections::BTreeSet::new();
            for jump in jumps {
                now = now.checked_add(jiff::SignedDuration::from_secs(jump)).expect("in range");
                let due = schedule.due(seen, now);
                if let Some(missed) = due.missed {
                    seen.settled = Some(missed.last);
                }
                if let Some(occurrence) = due.now {
                    prop_assert!(all.insert(occurrence.due), "{} twice", occurrence.due);
                    seen.asked = Some(occurrence.due);
                }
            }
        }
    }
}
