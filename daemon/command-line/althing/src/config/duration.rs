//! Durations as users write them: `500ms`, `1.5s`, `2min`, `1h`. The grammar is that of the durations
//! in the `config` of agents, which also knows `2 seconds` and `1h 30min`; the short forms are
//! documented.

use std::time::Duration;

use serde::{Deserialize, Deserializer};

/// The longest duration that a file may set: one day. No agent waits longer for an answer, and sums
/// of a few such durations never overflow.
const MAX: Duration = Duration::from_secs(24 * 60 * 60);

/// Parses a duration greater than zero and not greater than [`MAX`]. The error text describes the
/// allowed durations.
pub(super) fn parse(text: &str) -> Result<Duration, String> {
    let duration = humantime::parse_duration(text).map_err(|_| {
        "write a number and ms, s, min or h, such as \"500ms\" or \"2s\"".to_owned()
    })?;
    if duration.is_zero() || duration > MAX {
        return Err("write more than 0 and at most 24h".to_owned());
    }
    Ok(duration)
}

/// Deserialises a duration from its text; a function for `serde`'s attribute `deserialize_with`.
pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Duration, D::Error> {
    parse(&String::deserialize(from)?).map_err(serde::de::Error::custom)
}

/// Does the same as [`deserialize`] for a duration that may be missing.
pub(super) fn deserialize_some<'de, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<Duration>, D::Error> {
    deserialize(from).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, expected: Option<u64>) {
        assert_eq!(parse(text).ok(), expected.map(Duration::from_millis), "{text}");
    }

    #[test]
    fn durations_have_units() {
        check("500ms", Some(500));
        check("1.5s", Some(1_500));
        check("1 s", Some(1_000));
        check("2min", Some(120_000));
        check("24h", Some(86_400_000));
        check("2m", Some(120_000));
        check("2 seconds", Some(2_000));
        check("1h 30min", Some(5_400_000));
    }

    #[test]
    fn an_impossible_duration_is_refused() {
        for text in ["", "5", "s", "0s", "-1s", "1.2.3s", "25h", "1e9s", "5 fortnights", "1S"] {
            check(text, None);
        }
    }
}
