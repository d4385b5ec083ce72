//! Durations in the `config` of agents.

use std::ops::RangeInclusive;
use std::time::Duration;

/// The longest period of validity that a `config` may set. Sums of it with any point in time do not
/// overflow.
const VALIDITY_MAX: Duration = Duration::from_hours(24 * 366);

/// The shortest period of validity: a value that is never valid would be measured for nothing.
const VALIDITY_MIN: Duration = Duration::from_millis(1);

/// Reads a duration of a `config`, such as `"30s"`. `key` is the name of its key.
///
/// # Errors
///
/// Returns a text for people if `text` is not a duration, or if it lies outside of `allowed`.
pub fn config_duration(
    key: &str,
    text: &str,
    allowed: RangeInclusive<Duration>,
) -> Result<Duration, String> {
    let read = humantime::parse_duration(text);
    let duration = read.map_err(|error| format!("{key} `{text}`: {error}"))?;
    if allowed.contains(&duration) {
        return Ok(duration);
    }
    let [least, greatest] =
        [allowed.start(), allowed.end()].map(|limit| humantime::format_duration(*limit));
    Err(format!("{key} `{text}`: write a time between {least} and {greatest}"))
}

/// Reads how long a measured value is valid.
///
/// # Errors
///
/// Returns a text for people if `text` is not a duration, if it is zero, or if it is longer than a
/// year.
pub fn config_validity(key: &str, text: &str) -> Result<Duration, String> {
    config_duration(key, text, VALIDITY_MIN..=VALIDITY_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: Result<u64, &str>) {
        let minute = Duration::from_millis(10)..=Duration::from_mins(1);
        let read = config_duration("every", text, minute);
        assert_eq!(read, expected.map(Duration::from_millis).map_err(str::to_owned));
    }

    #[test]
    fn durations_have_units_and_bounds() {
        check("10ms", Ok(10));
        check("1min", Ok(60_000));
        check("0s", Err("every `0s`: write a time between 10ms and 1m"));
        check("61s", Err("every `61s`: write a time between 10ms and 1m"));
        check("1", Err("every `1`: time unit needed, for example 1sec or 1ms"));
        check("soon", Err("every `soon`: expected number at 0"));
    }

    #[test]
    fn a_validity_of_zero_is_refused() {
        assert_eq!(config_validity("valid-for", "1s"), Ok(Duration::from_secs(1)));
        assert!(config_validity("valid-for", "0s").is_err());
        assert!(config_validity("valid-for", "500000000000years").is_err());
    }
}
