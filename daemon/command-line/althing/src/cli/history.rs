//! Arguments of `althing history` and `althing why`.

use acl::content::HistoryKind;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use jiff::civil::{DateTime, Time};
use jiff::{Timestamp, ToSpan as _, Zoned};
use terminal::arguments::PrintArgs;

use crate::cli::ReachArgs;

/// Largest number of events that one command prints. They are all in memory at once.
const EVENTS_MAX: u32 = 100_000;

pub(crate) const HISTORY_HELP: &str = "\
An agent with `plugin = \"history\"` keeps what happens (docs/history.md). WHAT is
an agent, a place, a fact, an action, a goal or its name; a time is 2h, 30min,
7days, 09:30, 2026-11-27 or \"2026-11-27 09:30\". Answers of people are not kept.
Exit codes: 0 there are events, 1 there are none, 69 no history answers

  althing history office1 --since 2h
  althing history thermometer-office2 --last     when it last worked
  althing history \"(temperature office1)\" --values --since 1day
  althing history --kind step --kind refusal --csv > steps.csv";

pub(crate) const WHY_HELP: &str = "\
Prints the newest event of the subject, what caused it, what caused that, up to
a person, a sensor, a clock, or an agent that left or joined.
Exit codes: 0 a cause is known, 1 nothing is known of it, 69 no history answers

  althing why \"(known-temperature office1)\"
  althing why \"(move turtlebot-1 corridor office1)\"     a step
  althing why turtlebot-1                  what the robot did last, and why
  althing why 3                            goal 3 of `althing goals`
  althing why temperatures --effects     a goal of the file, and what it led to
  althing why '#8123'                      an event of `althing history --json`";

/// Arguments of `althing history`.
#[derive(Debug, Args)]
pub(crate) struct HistoryArgs {
    /// What the events are about; everything if left out
    #[arg(value_name = "WHAT")]
    pub(crate) what: Vec<String>,
    /// Only events of this kind; may be repeated
    #[arg(long, value_name = "KIND", value_parser = kinds())]
    pub(crate) kind: Vec<HistoryKind>,
    /// Only events since this time, or this long ago
    #[arg(long, value_name = "TIME", value_parser = moment)]
    pub(crate) since: Option<Timestamp>,
    /// Only events until this time, or this long ago
    #[arg(long, value_name = "TIME", value_parser = moment)]
    pub(crate) until: Option<Timestamp>,
    /// Show when WHAT last held, was done, or was present
    #[arg(long, requires = "what", conflicts_with_all = ["kind", "since", "until"])]
    pub(crate) last: bool,
    /// Show the values of the fact WHAT over time, as a chart and a table
    #[arg(long, requires = "what", conflicts_with_all = ["kind", "last"])]
    pub(crate) values: bool,
    /// How many events are shown at most, the newest [default: 40; with --last 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(EVENTS_MAX)))]
    pub(crate) limit: Option<u32>,
    /// Print comma-separated values, with all events unless --limit is given
    #[arg(long, conflicts_with = "json")]
    pub(crate) csv: bool,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing why`.
#[derive(Debug, Args)]
pub(crate) struct WhyArgs {
    /// A fact, a step, a goal or its number in `althing goals`, an agent, or # and the number of an
    /// event
    #[arg(value_name = "FACT|STEP|GOAL|AGENT", required = true)]
    pub(crate) what: Vec<String>,
    /// Show what it led to instead
    #[arg(long)]
    pub(crate) effects: bool,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

// === impl HistoryArgs ===

impl HistoryArgs {
    /// Returns how many events are shown at most.
    pub(crate) fn limit(&self) -> u32 {
        let by_default = match self {
            HistoryArgs { last: true, .. } => 1,
            HistoryArgs { csv: true, .. } => EVENTS_MAX,
            HistoryArgs { values: true, .. } => 1_000,
            _ => 40,
        };
        self.limit.unwrap_or(by_default)
    }
}

fn kinds() -> impl clap::builder::TypedValueParser<Value = HistoryKind> {
    let names = HistoryKind::ALL.map(HistoryKind::as_str);
    PossibleValuesParser::new(names).try_map(|name| name.parse::<HistoryKind>())
}

/// Parses a time as a user writes it.
fn moment(text: &str) -> Result<Timestamp, String> {
    moment_at(text, &Zoned::now())
}

/// Parses a time: a duration before `now`, a time of the day of `now`, a date, or both.
fn moment_at(text: &str, now: &Zoned) -> Result<Timestamp, String> {
    let text = text.trim();
    let spelled = text.strip_suffix(" ago").unwrap_or(text);
    let ago = humantime::parse_duration(spelled).ok();
    let ago = ago.and_then(|ago| i64::try_from(ago.as_millis()).ok());
    let moment = if let Some(ago) = ago {
        // The longest span of jiff is shorter than the longest number of milliseconds.
        now.timestamp().checked_sub(ago.min(i64::from(u32::MAX) * 1_000).milliseconds()).ok()
    } else if let Ok(moment) = text.parse::<Timestamp>() {
        Some(moment)
    } else {
        let civil = text.parse::<DateTime>().ok();
        let civil = civil.or_else(|| Some(now.date().to_datetime(text.parse::<Time>().ok()?)));
        civil.and_then(|civil| Some(civil.to_zoned(now.time_zone().clone()).ok()?.timestamp()))
    };
    moment.ok_or_else(|| {
        "write how long ago (2h, 30min, 7days), a time of today (09:30), a date (2026-11-27), or \
         both (\"2026-11-27 09:30\")"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use jiff::tz::{TimeZone, offset};

    use super::*;

    #[test]
    fn times_are_read_as_people_write_them() {
        let now = "2026-11-28T10:00:00Z".parse::<Timestamp>().expect("a time");
        let now = now.to_zoned(TimeZone::fixed(offset(2)));
        for (text, expected) in [
            ("2h", "2026-11-28T08:00:00Z"),
            ("30min ago", "2026-11-28T09:30:00Z"),
            ("7days", "2026-11-21T10:00:00Z"),
            ("09:30", "2026-11-28T07:30:00Z"),
            ("2026-11-27", "2026-11-26T22:00:00Z"),
            ("2026-11-27 09:30", "2026-11-27T07:30:00Z"),
            ("2026-11-27T09:30:15Z", "2026-11-27T09:30:15Z"),
        ] {
            let read = moment_at(text, &now).expect(text);
            assert_eq!(read.to_string(), expected, "{text}");
        }
        for text in ["", "yesterday", "25:00", "-2h", "2", "99999999999999999years"] {
            assert!(moment_at(text, &now).is_err(), "{text}");
        }
        assert!(moment_at("5000years", &now).is_ok(), "as long ago as possible");
    }
}
