//! The clock of a camera. WS-Security accepts a login only if its time is close to that of the
//! camera, and the clocks of cameras are often wrong by hours or years.

use time::{Date, Month, OffsetDateTime, PrimitiveDateTime, Time};

use crate::xml::Element;

/// Returns how far a camera's clock is ahead of this machine's, in seconds, from its answer to
/// `GetSystemDateAndTime`. Returns `None` if the answer has no valid UTC time.
pub(crate) fn offset(answer: &Element, now: OffsetDateTime) -> Option<i64> {
    let utc = answer.find("UTCDateTime")?;
    let number = |path: &[&str]| utc.text_at(path)?.parse::<i32>().ok();
    let part = |path: &[&str]| number(path)?.try_into().ok();
    let month = Month::try_from(part(&["Date", "Month"])?).ok()?;
    let date = Date::from_calendar_date(number(&["Date", "Year"])?, month, part(&["Date", "Day"])?);
    let second = part(&["Time", "Second"]).unwrap_or(0_u8).min(59);
    let time = Time::from_hms(part(&["Time", "Hour"])?, part(&["Time", "Minute"])?, second);
    let theirs = PrimitiveDateTime::new(date.ok()?, time.ok()?).assume_utc();
    Some((theirs - now).whole_seconds())
}

/// Returns the time that the camera's clock shows, as WS-Security writes it.
pub(crate) fn created(now: OffsetDateTime, offset: i64) -> String {
    let time = now.checked_add(time::Duration::seconds(offset)).unwrap_or(now);
    let (date, time) = (time.date(), time.time());
    format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z",
        date.year(),
        u8::from(date.month()),
        date.day(),
        time.hour(),
        time.minute(),
        time.second()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(year: &str, second: &str) -> Element {
        let text = format!(
            "<R><SystemDateAndTime><UTCDateTime><Time><Hour>13</Hour><Minute>5</Minute>\
             <Second>{second}</Second></Time><Date><Year>{year}</Year><Month>2</Month>\
             <Day>28</Day></Date></UTCDateTime></SystemDateAndTime></R>"
        );
        Element::parse(text.as_bytes()).expect("XML")
    }

    #[test]
    fn a_clock_that_is_a_year_behind_is_met() {
        let now = OffsetDateTime::from_unix_timestamp(1_772_283_900).expect("a time");
        let offset = offset(&answer("2025", "7"), now).expect("an offset");
        assert_eq!(created(now, offset), "2025-02-28T13:05:07Z");
    }

    #[test]
    fn an_impossible_time_is_no_offset() {
        let now = OffsetDateTime::UNIX_EPOCH;
        for year in ["", "x", "99999999", "-99999"] {
            assert_eq!(offset(&answer(year, "1"), now), None, "{year}");
        }
        assert_eq!(offset(&Element::default(), now), None);
        assert_eq!(created(now, i64::MAX), "1970-01-01T00:00:00Z");
        assert!(offset(&answer("1970", "60"), now).is_some(), "a leap second");
    }
}
