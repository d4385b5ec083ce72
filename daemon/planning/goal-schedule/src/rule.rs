//! Recurrence rules (RFC 5545, section 3.3.10) on a calendar without time zones.
//!
//! The crate `rrule` reads and counts them. This module bounds what it is given: rules come from
//! other machines too, and none may keep a Plan Requester busy.

use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp};
use rrule::RRuleSet;

/// Longest rule in bytes; a longer one is a mistake.
const RULE_BYTES_MAX: usize = 300;

/// Greatest interval, and greatest count of a rule.
const INTERVAL_MAX: i64 = 1_000;
const COUNT_MAX: i64 = 10_000;

/// Greatest number of times in one day that BYHOUR, BYMINUTE and BYSECOND may select: every quarter of
/// an hour. More often is a rule of hours or minutes.
const TIMES_OF_DAY_MAX: usize = 96;

/// How often a rule comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum RuleFrequency {
    Minutely,
    Hourly,
    Daily,
    Weekly,
    Monthly,
    Yearly,
}

/// A recurrence rule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RecurrenceRule {
    /// The rule without UNTIL.
    text: String,
    frequency: RuleFrequency,
    interval: i64,
    is_counted: bool,
    /// Last time at which the rule may come, and whether it is in UTC.
    until: Option<(DateTime, bool)>,
    has_hours: bool,
}

impl RecurrenceRule {
    /// Reads a rule; `RRULE:` may stand before it.
    ///
    /// # Errors
    ///
    /// Returns a sentence for a person if the text is no rule, or one that is not taken here.
    pub(crate) fn read(text: &str) -> Result<RecurrenceRule, String> {
        let text = text.trim();
        if text.len() > RULE_BYTES_MAX || !text.is_ascii() {
            return Err(format!("a rule is ASCII, and has at most {RULE_BYTES_MAX} bytes"));
        }
        let upper = text.to_ascii_uppercase();
        let parts = upper.strip_prefix("RRULE:").unwrap_or(&upper);
        let mut found = PartsOfRule::default();
        for part in parts.split(';') {
            found.add(part)?;
        }
        let rule = found.finish()?;
        // The checks of the RFC that are not made here.
        let start = DateTime::constant(2026, 1, 1, 0, 0, 0, 0);
        rule.set(start).map_err(|error| format!("`{text}` is no rule of RFC 5545: {error}"))?;
        Ok(rule)
    }

    /// Whether the rule comes every hour or more often, at whatever hours.
    pub(crate) fn is_quick(&self) -> bool {
        self.frequency <= RuleFrequency::Hourly && !self.has_hours
    }

    /// Whether BYDAY can be added to the rule in order to leave days out.
    pub(crate) fn takes_days(&self) -> bool {
        self.frequency <= RuleFrequency::Daily && !self.text.contains("BYDAY=")
    }

    /// Returns the times of the rule from the time `from` on, in order; none is before `start`.
    pub(crate) fn times_from(
        &self,
        start: DateTime,
        from: DateTime,
        zone: &TimeZone,
    ) -> impl Iterator<Item = DateTime> + use<> {
        let until = self.until.map(|(until, is_utc)| match is_utc {
            true => TimeZone::UTC.to_timestamp(until).map_or(until, |at| zone.to_datetime(at)),
            false => until,
        });
        let set = self.set(self.advanced(start, from)).ok();
        let times = set.into_iter().flat_map(|set| (&set.limit()).into_iter());
        let times = times.filter_map(|time| {
            let time = Timestamp::from_second(time.timestamp()).ok()?;
            Some(TimeZone::UTC.to_datetime(time))
        });
        times
            .skip_while(move |time| *time < from)
            .take_while(move |time| until.is_none_or(|until| *time <= until))
    }

    /// Returns the latest time up to `from` from which the rule counts as it does from `start`.
    fn advanced(&self, start: DateTime, from: DateTime) -> DateTime {
        let seconds = match self.frequency {
            RuleFrequency::Minutely => 60,
            RuleFrequency::Hourly => 3_600,
            RuleFrequency::Daily => 86_400,
            RuleFrequency::Weekly => 7 * 86_400,
            // These come so seldom that they are counted from the start.
            RuleFrequency::Monthly | RuleFrequency::Yearly => return start,
        };
        if self.is_counted || from <= start {
            return start;
        }
        let unit = seconds * self.interval;
        let units = start.duration_until(from).as_secs() / unit;
        start.checked_add(SignedDuration::from_secs(units * unit)).unwrap_or(start)
    }

    fn set(&self, start: DateTime) -> Result<RRuleSet, rrule::RRuleError> {
        let start = start.strftime("%Y%m%dT%H%M%S");
        format!("DTSTART:{start}Z\nRRULE:{}", self.text).parse()
    }
}

/// The parts of a rule that have been read.
#[derive(Default)]
struct PartsOfRule {
    names: Vec<String>,
    text: Vec<String>,
    frequency: Option<RuleFrequency>,
    interval: Option<i64>,
    until: Option<(DateTime, bool)>,
    /// Product of the numbers of hours, minutes and seconds.
    times_of_day: usize,
}

impl PartsOfRule {
    fn add(&mut self, part: &str) -> Result<(), String> {
        let Some((name, value)) = part.split_once('=').filter(|(_, value)| !value.is_empty())
        else {
            return Err(format!("`{part}` is no part of a rule; write FREQ=DAILY;BYHOUR=8"));
        };
        if self.names.iter().any(|known| known == name) {
            return Err(format!("`{name}` stands in the rule twice"));
        }
        let count = value.split(',').count();
        match name {
            "FREQ" => self.frequency = Some(frequency(value)?),
            "INTERVAL" => self.interval = Some(bounded(name, value, INTERVAL_MAX)?),
            "COUNT" => drop(bounded(name, value, COUNT_MAX)?),
            "UNTIL" => self.until = Some(until(value)?),
            "BYHOUR" | "BYMINUTE" | "BYSECOND" => {
                self.times_of_day = self.times_of_day.max(1).saturating_mul(count);
            }
            "BYDAY" | "BYMONTHDAY" | "BYYEARDAY" | "BYWEEKNO" | "BYMONTH" | "BYSETPOS" | "WKST" => {
            }
            _ => return Err(format!("`{name}` is no part of a rule of RFC 5545")),
        }
        self.names.push(name.to_owned());
        if name != "UNTIL" {
            self.text.push(part.to_owned());
        }
        Ok(())
    }

    fn finish(self) -> Result<RecurrenceRule, String> {
        let has = |name: &str| self.names.iter().any(|known| known == name);
        let Some(frequency) = self.frequency else {
            return Err("a rule needs FREQ, such as FREQ=DAILY;BYHOUR=8;BYMINUTE=0".to_owned());
        };
        if self.times_of_day > TIMES_OF_DAY_MAX {
            return Err(format!(
                "the rule selects {} times of a day, and {TIMES_OF_DAY_MAX} are the most; write \
                 FREQ=HOURLY or FREQ=MINUTELY",
                self.times_of_day
            ));
        }
        let seldom = ["BYMONTH", "BYMONTHDAY", "BYYEARDAY", "BYWEEKNO", "BYSETPOS"];
        if frequency <= RuleFrequency::Hourly
            && let Some(name) = seldom.iter().find(|name| has(name))
        {
            return Err(format!("{name} is taken with FREQ=DAILY and less often only; use BYHOUR"));
        }
        Ok(RecurrenceRule {
            frequency,
            interval: self.interval.unwrap_or(1),
            is_counted: has("COUNT"),
            until: self.until,
            has_hours: has("BYHOUR"),
            text: self.text.join(";"),
        })
    }
}

fn frequency(value: &str) -> Result<RuleFrequency, String> {
    Ok(match value {
        "MINUTELY" => RuleFrequency::Minutely,
        "HOURLY" => RuleFrequency::Hourly,
        "DAILY" => RuleFrequency::Daily,
        "WEEKLY" => RuleFrequency::Weekly,
        "MONTHLY" => RuleFrequency::Monthly,
        "YEARLY" => RuleFrequency::Yearly,
        "SECONDLY" => return Err("a goal is asked for once a minute at most".to_owned()),
        _ => {
            return Err(format!(
                "FREQ={value} is none of MINUTELY, HOURLY, DAILY, WEEKLY, MONTHLY, YEARLY"
            ));
        }
    })
}

fn bounded(name: &str, value: &str, max: i64) -> Result<i64, String> {
    let number = value.parse().ok().filter(|number| (1..=max).contains(number));
    number.ok_or_else(|| format!("{name} is a whole number from 1 to {max}, not `{value}`"))
}

/// Reads the value of UNTIL: a date, which counts to its end, or a date with a time, in UTC if `Z`
/// follows.
fn until(value: &str) -> Result<(DateTime, bool), String> {
    let wrong = || format!("UNTIL={value} is no time; write UNTIL=20261224T180000");
    let is_utc = value.ends_with('Z');
    let digits = value.trim_end_matches('Z').replace('T', "");
    if !digits.bytes().all(|b| b.is_ascii_digit()) || !matches!(digits.len(), 8 | 14) {
        return Err(wrong());
    }
    let number = |range: std::ops::Range<usize>| digits.get(range)?.parse::<i16>().ok();
    let small = |range: std::ops::Range<usize>| number(range).and_then(|n| i8::try_from(n).ok());
    let time = match digits.len() {
        8 => Some((23, 59, 59)),
        _ => small(8..10).zip(small(10..12)).zip(small(12..14)).map(|((h, m), s)| (h, m, s)),
    };
    let date = number(0..4).zip(small(4..6)).zip(small(6..8));
    let made = date.zip(time).and_then(|(((year, month), day), (hour, minute, second))| {
        DateTime::new(year, month, day, hour, minute, second, 0).ok()
    });
    made.map(|time| (time, is_utc)).ok_or_else(wrong)
}
