//! Durations as users write them: `500ms`, `1.5s`, `2min`, `1h`.

use std::time::Duration;

use serde::{Deserialize, Deserializer};

/// The longest duration that a file may set: one day. No agent waits longer for an answer, and sums
/// of a few such durations never overflow.
const MAX: Duration = Duration::from_secs(24 * 60 * 60);

const UNITS: &[(&str, f64)] = &[("ms", 0.001), ("s", 1.0), ("min", 60.0), ("h", 3_600.0)];

/// Parses a duration greater than zero and not greater than [`MAX`]. The error text describes the
/// allowed durations.
pub(super) fn parse(text: &str) -> Result<Duration, String> {
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let seconds_per_unit = UNITS.iter().find(|(name, _)| *name == unit.trim());
    let (Ok(number), Some((_, seconds))) = (number.parse::<f64>(), seconds_per_unit) else {
        return Err("write a number and ms, s, min or h, such as \"500ms\" or \"2s\"".to_owned());
    };
    match Duration::try_from_secs_f64(number * seconds) {
        Ok(duration) if !duration.is_zero() && duration <= MAX => Ok(duration),
        _ => Err("write more than 0 and at most 24h".to_owned()),
    }
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
    }

    #[test]
    fn an_impossible_duration_is_refused() {
        for text in ["", "5", "s", "0s", "-1s", "1.2.3s", "25h", "1e9s", "5 fortnights", "1S"] {
            check(text, None);
        }
    }
}
