//! Goals by the clock: reads times as people write them ([`read_options`]), and computes when they
//! come ([`Schedule`]).
//!
//! Nothing here reads a clock. The present time and the time zone are parameters, so the same input
//! has the same result on every machine. Who asks for a goal when its time has come, and who
//! remembers that, is left to the Plan Requester.
//!
//! Recurrences are those of RFC 5545. The crate `rrule` counts them on a calendar without time zones;
//! `jiff` turns each time on that calendar into an instant. A time that summer time leaves out moves
//! on by the hour that is left out, and a time that comes twice counts once, the first time. A rule
//! that comes every hour or more often goes on through the hour that comes twice.

mod error;
mod mark;
mod rule;
mod schedule;
mod words;

#[cfg(test)]
mod tests;

pub use self::error::ScheduleError;
pub use self::schedule::{
    CLOCK_ERROR_MAX, Due, DueOccurrence, LATE_MAX, MissedTimes, Schedule, SeenOccurrences,
};
pub use self::words::{Asking, Author, TimeOptions, read_options, spoken};
