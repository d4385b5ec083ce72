//! The `config` of a history agent: how long and how much it keeps.

use std::time::Duration;

use serde::Deserialize;

use crate::store::HistoryLimits;

/// Least age up to which events are kept; a shorter one is a mistake.
const KEEP_MIN: Duration = Duration::from_secs(60);

/// Least size of the files: each of sixteen files needs room.
const BYTES_MIN: u64 = 16 << 20;

/// The `config` table of the agent's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct HistoryConfig {
    /// Greatest age of an event.
    #[serde(default = "keep_by_default")]
    keep: String,
    /// Greatest size of all files together.
    #[serde(default = "max_size_by_default")]
    max_size: String,
}

fn keep_by_default() -> String {
    "30days".to_owned()
}

fn max_size_by_default() -> String {
    "1GiB".to_owned()
}

// === impl HistoryConfig ===

impl HistoryConfig {
    /// Returns the limits.
    ///
    /// # Errors
    ///
    /// Returns a text for a person, which says what is wrong and what would be right.
    pub(crate) fn limits(&self) -> Result<HistoryLimits, String> {
        let keep = humantime::parse_duration(&self.keep).ok();
        let keep = keep.filter(|keep| *keep >= KEEP_MIN).ok_or_else(|| {
            let keep = &self.keep;
            format!(
                "keep = \"{keep}\": write a time of at least 1min, such as \"30days\" or \"12h\""
            )
        })?;
        let bytes_max = bytes_of(&self.max_size).filter(|bytes| *bytes >= BYTES_MIN);
        let bytes_max = bytes_max.ok_or_else(|| {
            let size = &self.max_size;
            format!(
                "max-size = \"{size}\": write a size of at least 16MiB, such as \"1GiB\" or \
                 \"500MiB\""
            )
        })?;
        let keep_ms = u64::try_from(keep.as_millis()).unwrap_or(u64::MAX);
        Ok(HistoryLimits { keep_ms, bytes_max })
    }
}

/// Parses a size such as `"64MiB"` into bytes; returns `None` if the text is not a whole number
/// with a unit.
fn bytes_of(text: &str) -> Option<u64> {
    let units = [("GiB", 30), ("MiB", 20), ("KiB", 10)];
    let (number, shift) =
        units.into_iter().find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, shift)))?;
    number.trim().parse::<u64>().ok()?.checked_mul(1 << shift)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn limits(config: serde_json::Value) -> Result<HistoryLimits, String> {
        let config: HistoryConfig =
            serde_json::from_value(config).map_err(|error| error.to_string())?;
        config.limits()
    }

    #[test]
    fn limits_have_units() {
        let days = 24 * 60 * 60 * 1_000;
        let default = HistoryLimits { keep_ms: 30 * days, bytes_max: 1 << 30 };
        assert_eq!(limits(json!({})), Ok(default));
        let some = HistoryLimits { keep_ms: 2 * days, bytes_max: 64 << 20 };
        assert_eq!(limits(json!({"keep": "2days", "max-size": "64MiB"})), Ok(some));
    }

    #[test]
    fn impossible_limits_are_refused_with_what_would_be_right() {
        for (config, reason) in [
            (json!({"keep": "soon"}), "keep = \"soon\": write a time"),
            (json!({"keep": "5s"}), "at least 1min"),
            (json!({"max-size": "5"}), "max-size = \"5\": write a size"),
            (json!({"max-size": "1MiB"}), "at least 16MiB"),
            (json!({"max-size": "99999999999999GiB"}), "such as \"1GiB\""),
            (json!({"max_size": "1GiB"}), "unknown field `max_size`"),
        ] {
            let problem = limits(config).expect_err("refused");
            assert!(problem.contains(reason), "{problem}");
        }
    }
}
