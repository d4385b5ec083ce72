//! Times and durations in few words.

use live_view::Moment;

const SECOND: u64 = 1_000;
const MINUTE: u64 = 60 * SECOND;
const HOUR: u64 = 60 * MINUTE;
const DAY: u64 = 24 * HOUR;

/// Returns a duration in milliseconds in at most two units.
pub(crate) fn duration(milliseconds: u64) -> String {
    let two = |large: u64, small: u64, names: [&str; 2]| {
        let (whole, rest) = (milliseconds / large, milliseconds % large / small);
        if rest == 0 || whole > 9 {
            format!("{whole} {}", names[0])
        } else {
            format!("{whole} {} {rest} {}", names[0], names[1])
        }
    };
    match milliseconds {
        0..SECOND => format!("{milliseconds} ms"),
        SECOND..10_000 if milliseconds % SECOND < 100 => format!("{} s", milliseconds / SECOND),
        SECOND..10_000 => format!("{}.{} s", milliseconds / SECOND, milliseconds % SECOND / 100),
        10_000..MINUTE => format!("{} s", milliseconds / SECOND),
        MINUTE..HOUR => two(MINUTE, SECOND, ["min", "s"]),
        HOUR..DAY => two(HOUR, MINUTE, ["h", "min"]),
        _ => two(DAY, HOUR, ["d", "h"]),
    }
}

/// Returns microseconds in one unit.
pub(crate) fn micros(micros: u64) -> String {
    match micros {
        0..1_000 => format!("{micros} µs"),
        1_000..10_000 => format!("{}.{} ms", micros / 1_000, micros % 1_000 / 100),
        _ => duration(micros / 1_000),
    }
}

/// Returns the time of day of a moment, by a clock that is ahead of UTC by `offset` seconds.
pub(crate) fn clock(moment: Moment, offset: i32) -> String {
    let seconds = i128::from(moment.0 / SECOND) + i128::from(offset);
    let of_day = seconds.rem_euclid(86_400);
    format!("{:02}:{:02}:{:02}", of_day / 3_600, of_day / 60 % 60, of_day % 60)
}

/// Returns the time of day of a moment with its milliseconds.
pub(crate) fn exact_clock(moment: Moment, offset: i32) -> String {
    format!("{}.{:03}", clock(moment, offset), moment.0 % SECOND)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_two_units_at_most() {
        let check = |milliseconds: u64, expected: &str| {
            assert_eq!(duration(milliseconds), expected);
        };
        check(0, "0 ms");
        check(999, "999 ms");
        check(1_250, "1.2 s");
        check(3_099, "3 s");
        check(59_999, "59 s");
        check(61_000, "1 min 1 s");
        check(10 * MINUTE + 1_000, "10 min");
        check(3 * HOUR + 5 * MINUTE, "3 h 5 min");
        check(2 * DAY, "2 d");
        check(u64::MAX, "213503982334 d");
        assert_eq!(micros(740), "740 µs");
        assert_eq!(micros(2_340), "2.3 ms");
    }

    #[test]
    fn the_clock_goes_by_the_zone() {
        let noon = Moment(12 * HOUR + 5_123);
        assert_eq!(clock(noon, 0), "12:00:05");
        assert_eq!(clock(noon, -46_800), "23:00:05");
        assert_eq!(exact_clock(noon, 3_600), "13:00:05.123");
        assert_eq!(clock(Moment(u64::MAX), i32::MAX).len(), 8);
    }
}
