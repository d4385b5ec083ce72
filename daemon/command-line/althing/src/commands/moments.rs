//! Times as people read them: the time of the day in the local time zone, with the day if it is
//! another one, and the age beside it.

use std::time::Duration;

use jiff::{Timestamp, ToSpan as _, Zoned};

/// Columns of a time that [`clock`] returns.
pub(super) const CLOCK_COLUMNS: usize = 10;

/// Returns the time `unix_ms` in the time zone of `now`: `08:00:12` today, `Thu 08:00` within the
/// last six days, and otherwise the date.
pub(super) fn clock(unix_ms: u64, now: &Zoned) -> String {
    let Some(at) = zoned(unix_ms, now) else { return "?".to_owned() };
    let is_this_week = now.checked_sub(6.days()).is_ok_and(|week| at.date() >= week.date());
    let format = match at.date() == now.date() {
        true => "%H:%M:%S",
        false if is_this_week && at.date() < now.date() => "%a %H:%M",
        false => "%Y-%m-%d",
    };
    at.strftime(format).to_string()
}

/// Returns how long ago the time `unix_ms` was; `now` if it is less than a second, or if the clock of
/// another machine is ahead.
pub(super) fn age(unix_ms: u64, now: &Zoned) -> String {
    let now_ms = u64::try_from(now.timestamp().as_millisecond()).unwrap_or_default();
    age_of(Duration::from_millis(now_ms.saturating_sub(unix_ms)))
}

/// Returns an age in the largest unit that suits it, and `now` below a second.
pub(super) fn age_of(age: Duration) -> String {
    match age.as_secs() {
        0 => "now".to_owned(),
        seconds if seconds >= 2 * 86_400 => format!("{} days", seconds / 86_400),
        _ => super::brief(age),
    }
}

/// Returns the milliseconds since 1970 at which something happened that is `age_ms` old at `now`.
pub(super) fn before(age_ms: u64, now: &Zoned) -> u64 {
    let now_ms = u64::try_from(now.timestamp().as_millisecond()).unwrap_or_default();
    now_ms.saturating_sub(age_ms)
}

fn zoned(unix_ms: u64, now: &Zoned) -> Option<Zoned> {
    let timestamp = Timestamp::from_millisecond(i64::try_from(unix_ms).ok()?).ok()?;
    Some(timestamp.to_zoned(now.time_zone().clone()))
}

#[cfg(test)]
mod tests {
    use jiff::tz::{TimeZone, offset};

    use super::*;

    #[test]
    fn a_time_has_the_day_if_it_is_another_one() {
        let at = |text: &str| text.parse::<Timestamp>().expect("a time");
        // A Thursday.
        let now = at("2026-11-26T01:30:00Z").to_zoned(TimeZone::fixed(offset(2)));
        let shown = |text: &str| clock(at(text).as_millisecond() as u64, &now);
        assert_eq!(shown("2026-11-26T01:02:03Z"), "03:02:03");
        assert_eq!(shown("2026-11-25T22:00:00Z"), "00:00:00");
        assert_eq!(shown("2026-11-25T21:59:59Z"), "Wed 23:59");
        assert_eq!(shown("2026-11-20T08:00:00Z"), "Fri 10:00");
        assert_eq!(shown("2026-11-19T08:00:00Z"), "2026-11-19");
        assert_eq!(clock(u64::MAX, &now), "?");
        let longest = ["2026-11-26T01:02:03Z", "2026-11-19T08:00:00Z"].map(shown);
        assert!(longest.iter().all(|text| text.len() <= CLOCK_COLUMNS));
    }

    #[test]
    fn an_age_has_one_unit() {
        let now = Timestamp::from_millisecond(10_000_000).expect("a time").to_zoned(TimeZone::UTC);
        assert_eq!(age(9_999_500, &now), "now");
        assert_eq!(age(9_990_000, &now), "10 s");
        assert_eq!(age(10_000_500, &now), "now");
        assert_eq!(age_of(Duration::from_secs(3 * 86_400)), "3 days");
        assert_eq!(before(500, &now), 9_999_500);
    }
}
