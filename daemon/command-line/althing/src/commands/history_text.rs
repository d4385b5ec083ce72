//! How events of the history are shown to people: lines with a time, under the day that they are of.

use std::fmt::Write as _;

use acl::content::{HistoryEvent, HistoryPage, HistoryRoot};
use jiff::civil::Date;
use jiff::{Timestamp, Zoned};
use serde_json::{Value, json};
use terminal::{output, visible};

use crate::asking::history_reader::HistoryAnswer;
use crate::speech;

/// Columns before the text of an event: its time and two spaces.
pub(super) const TIME_COLUMNS: usize = 10;

/// Lines of events, each under the day that it is of. No day is written before the first event of
/// today.
pub(super) struct EventLines {
    now: Zoned,
    day: Date,
    text: String,
}

// === impl EventLines ===

impl EventLines {
    pub(super) fn new(now: Zoned) -> EventLines {
        EventLines { day: now.date(), now, text: String::new() }
    }

    /// Adds a line about an event at the time `at_ms`, and the day, if it is another one. Text that
    /// is too long for the terminal is continued below `indent` columns.
    pub(super) fn add(&mut self, at_ms: u64, text: &str, indent: usize) {
        let at = zoned(at_ms, &self.now);
        let day = at.as_ref().map_or(self.day, Zoned::date);
        if day != self.day {
            self.day = day;
            let _ = writeln!(self.text, "{}", day.strftime("%A, %Y-%m-%d"));
        }
        let time = at.map_or_else(|| "?".to_owned(), |at| at.strftime("%H:%M:%S").to_string());
        let line = format!("{time:<8}  {text}");
        let _ = writeln!(self.text, "{}", output::folded(&line, TIME_COLUMNS + indent));
    }

    /// Adds a line without a time.
    pub(super) fn remark(&mut self, text: &str) {
        let line = format!("{:TIME_COLUMNS$}{text}", "");
        let _ = writeln!(self.text, "{}", output::folded(&line, TIME_COLUMNS));
    }

    pub(super) fn into_text(self) -> String {
        self.text
    }
}

/// Returns the time `unix_ms` in the time zone of `now`; `None` if there is no such time.
fn zoned(unix_ms: u64, now: &Zoned) -> Option<Zoned> {
    let timestamp = Timestamp::from_millisecond(i64::try_from(unix_ms).ok()?).ok()?;
    Some(timestamp.to_zoned(now.time_zone().clone()))
}

/// Formats a time with its date, if it is not of the day of `now`.
pub(super) fn moment(unix_ms: u64, now: &Zoned) -> String {
    let Some(at) = zoned(unix_ms, now) else { return "?".to_owned() };
    let format = if at.date() == now.date() { "%H:%M:%S" } else { "%Y-%m-%d %H:%M:%S" };
    at.strftime(format).to_string()
}

/// Returns the sentence of an event, as a part of a line.
pub(super) fn sentence(event: &HistoryEvent) -> String {
    let private = if event.private { " (private)" } else { "" };
    format!("{}{private}", visible::line(&speech::sentence(&event.text)))
}

/// Returns who or what the root of a chain is, in words for a person.
pub(super) fn root_text(root: HistoryRoot, event: &HistoryEvent) -> String {
    let agent = event.agent.as_ref().map(|agent| format!(" (`{agent}`)")).unwrap_or_default();
    match root {
        HistoryRoot::Person => format!("a person wanted it{agent}"),
        HistoryRoot::Sensor => format!("a device reported it by itself{agent}"),
        HistoryRoot::Clock => format!("its time had come{agent}"),
        HistoryRoot::Death => format!("the agent left by itself, or is silent{agent}"),
        HistoryRoot::Arrival => format!("the agent joined{agent}"),
        HistoryRoot::Other => "the cause is of a kind that a newer version knows".to_owned(),
    }
}

/// Prints what a user has to know about the history besides its events.
pub(super) fn print_notices(answer: &HistoryAnswer) {
    let HistoryAnswer { from, page, differences } = answer;
    for notice in page.notices.iter().chain(differences) {
        output::print_note(&format!("note: {}", visible::line(notice)));
    }
    if page.lost > 0 {
        let messages = if page.lost == 1 { "message" } else { "messages" };
        output::print_note(&format!("note: `{from}` has missed {} {messages}", page.lost));
    }
    if page.withheld > 0 {
        output::print_note(&withheld_note(page.withheld));
    }
}

/// Returns that events are withheld, and who may read them.
fn withheld_note(withheld: u64) -> String {
    let events = match withheld {
        1 => "1 event about private facts is".to_owned(),
        count => format!("{count} events about private facts are"),
    };
    format!(
        "note: {events} withheld; to be read, the ecosystem has to be secured, and `private` in \
         [rights] has to name the reader (docs/security.md)"
    )
}

/// Returns an answer for programs.
pub(super) fn json(answer: &HistoryAnswer) -> Value {
    let HistoryAnswer { from, page, differences } = answer;
    let HistoryPage { events, sealed: _, withheld, next, oldest_ms, lost, notices, near } = page;
    json!({
        "from": from, "events": events, "withheld": withheld, "more": next.is_some(),
        "oldest_ms": oldest_ms, "lost": lost, "notices": notices, "near": near,
        "differences": differences,
    })
}

#[cfg(test)]
mod tests {
    use jiff::tz::TimeZone;

    use super::*;

    #[test]
    fn what_is_withheld_is_counted_in_words() {
        assert!(withheld_note(1).starts_with("note: 1 event about private facts is withheld; "));
        assert!(withheld_note(6).starts_with("note: 6 events about private facts are withheld; "));
    }

    #[test]
    fn days_are_written_where_they_change() {
        let at = |text: &str| text.parse::<Timestamp>().expect("a time");
        let ms = |text: &str| u64::try_from(at(text).as_millisecond()).expect("after 1970");
        let now = at("2026-11-28T10:00:00Z").to_zoned(TimeZone::UTC);
        let mut lines = EventLines::new(now.clone());
        lines.add(ms("2026-11-27T23:59:59Z"), "the hall is dark", 0);
        lines.add(ms("2026-11-28T00:00:01Z"), "the hall is lit", 0);
        lines.add(u64::MAX, "no such time", 0);
        lines.remark("a remark");
        assert_eq!(
            lines.into_text(),
            "Friday, 2026-11-27\n23:59:59  the hall is dark\nSaturday, 2026-11-28\n\
             00:00:01  the hall is lit\n?         no such time\n          a remark\n"
        );
        assert_eq!(moment(ms("2026-11-28T09:00:00Z"), &now), "09:00:00");
        assert_eq!(moment(ms("2026-11-27T09:00:00Z"), &now), "2026-11-27 09:00:00");
    }
}
