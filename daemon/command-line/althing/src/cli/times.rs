//! The options of `althing goal` that say when a goal is asked for, and until when it is pursued.

use clap::Args;
use goal_schedule::TimeOptions;

/// Times of a goal, on the command line and at the prompt. The times are those of the ecosystem's time
/// zone.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "By the clock")]
pub(crate) struct TimeArgs {
    /// Ask for the goal at this time: 08:00, 2026-12-01T08:00
    #[arg(long, value_name = "TIME", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) at: Option<String>,
    /// Ask for it again and again: "day 08:00", "mon,fri 08:00", "month 1 08:00", hour, 15min, or
    /// "RRULE:..." of RFC 5545
    #[arg(long, value_name = "WHEN", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) every: Option<String>,
    /// On these days only: workdays, weekend, mon,wed,fri
    #[arg(long, value_name = "DAYS", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) on: Option<String>,
    /// Keep it in these hours of the day only: 08:00-18:00; with --every: ask for it then only
    #[arg(long, value_name = "HOURS", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) between: Option<String>,
    /// Tell if it is not reached by then: 09:00, or 30min after it was asked for
    #[arg(long, value_name = "TIME", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) by: Option<String>,
    /// Give it up after this time: 2h
    #[arg(long = "for", value_name = "DURATION", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) lasts: Option<String>,
    /// Give it up then, and do not ask for it again: 18:00, 2026-12-24
    #[arg(long, value_name = "TIME", conflicts_with_all = ["cancel", "dry_run"])]
    pub(crate) until: Option<String>,
}

impl TimeArgs {
    /// Returns the options as they were written.
    pub(crate) fn options(&self) -> TimeOptions {
        let TimeArgs { at, every, on, between, by, lasts, until } = self.clone();
        TimeOptions { at, by, every, on, between, until, lasts }
    }
}
