//! The daemons: whether each answers, who leads, certificates, mailboxes.

use live_view::{DaemonRow, MailboxSums};

use super::{PageContext, count, duration_cell};
use crate::sheet::{RowLink, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::time_words;
use crate::tone::Tone;

/// Days before its end from which on a certificate is pointed out.
const CERTIFICATE_DAYS: u64 = 30;

pub(super) fn sheet(daemons: &[DaemonRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if daemons.is_empty() && context.is_recording {
        sheet.nothing("Daemons were not recorded.");
    } else if daemons.is_empty() {
        sheet.nothing("No daemon is known: none was reached yet.");
    }
    let mut table = Table::new(vec![
        TableColumn::new("DAEMON", 0, 12, 24),
        TableColumn::new("STATE", 1, if context.columns < 40 { 10 } else { 20 }, 22),
        TableColumn::right("TRIP", 2, 6, 8),
        TableColumn::right("USUAL", 5, 6, 8),
        TableColumn::right("AGENTS", 3, 6, 6),
        TableColumn::new("CERTIFICATE", 4, 11, 14),
        TableColumn::new("LEADS", 6, 16, 40),
        TableColumn::new("STANDS BY", 7, 16, 40),
        TableColumn::right("UP", 8, 6, 10),
        TableColumn::right("MEMORY", 9, 6, 8),
        TableColumn::right("FILES", 10, 5, 12),
        TableColumn::new("VERSION", 11, 7, 12),
    ]);
    for daemon in daemons {
        let names = |agents: &[acl::AgentId]| {
            agents.iter().map(|agent| agent.as_str()).collect::<Vec<_>>().join(" ")
        };
        let micros = |micros: Option<u64>| micros.map(time_words::micros).unwrap_or_default();
        let cells = vec![
            TableCell::of(daemon.daemon.as_str(), Tone::Name),
            TableCell::Line(state(daemon, context)),
            TableCell::of(&micros(daemon.round_trip_micros), Tone::Plain),
            TableCell::of(&micros(daemon.usual_round_trip_micros), Tone::Dim),
            TableCell::of(&daemon.agents.to_string(), Tone::Plain),
            certificate(daemon.certificate_days_left),
            TableCell::of(&names(&daemon.leads), Tone::Plain),
            TableCell::of(&names(&daemon.stands_by), Tone::Dim),
            duration_cell(daemon.uptime_ms, Tone::Dim),
            TableCell::of(&daemon.memory_bytes.map(mebibytes).unwrap_or_default(), Tone::Dim),
            files(daemon),
            TableCell::of(daemon.version.as_deref().unwrap_or_default(), Tone::Dim),
        ];
        let name = daemon.daemon.to_string();
        table.row(cells, RowLink { key: name.clone(), copies: name, ..RowLink::default() });
    }
    table.draw(&mut sheet);
    for daemon in daemons {
        more(&mut sheet, daemon);
    }
    sheet
}

fn state(daemon: &DaemonRow, context: &PageContext) -> StyledLine {
    match (daemon.is_reached, daemon.seen_at) {
        (Some(true), _) => StyledLine::of("✓ answers", Tone::Good),
        (Some(false), Some(seen)) => {
            StyledLine::of(&format!("✗ silent {}", context.ago(seen)), Tone::Bad)
        }
        (Some(false), None) => StyledLine::of("✗ silent", Tone::Bad),
        (None, _) => StyledLine::of("? unasked", Tone::Dim),
    }
}

fn certificate(days: Option<u64>) -> TableCell {
    match days {
        None => TableCell::of("", Tone::Dim),
        Some(0) => TableCell::of("✗ ends, or has", Tone::Bad),
        Some(days) if days < CERTIFICATE_DAYS => {
            TableCell::of(&format!("! {days} d left"), Tone::Warn)
        }
        Some(days) => TableCell::of(&format!("{days} d left"), Tone::Plain),
    }
}

fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes >> 20)
}

/// Returns the open files of a daemon, pointed out if few more may be opened.
fn files(daemon: &DaemonRow) -> TableCell {
    match (daemon.open_files, daemon.open_files_max) {
        (None, _) => TableCell::of("", Tone::Dim),
        (Some(open), Some(max)) if open > max / 10 * 9 => {
            TableCell::of(&format!("! {open}/{max}"), Tone::Warn)
        }
        (Some(open), _) => TableCell::of(&open.to_string(), Tone::Dim),
    }
}

/// Says the problems of a daemon, and how full its mailboxes are.
fn more(sheet: &mut Sheet, daemon: &DaemonRow) {
    let mailboxes = daemon.mailboxes.as_ref();
    if daemon.problems.is_empty() && mailboxes.is_none() {
        return;
    }
    sheet.heading(daemon.daemon.as_str());
    for problem in &daemon.problems {
        sheet.text(&StyledLine::of("! ", Tone::Warn).and(problem, Tone::Plain), 2);
    }
    if let Some(mailboxes) = mailboxes {
        sheet.text(&StyledLine::of(&mail(mailboxes), Tone::Dim), 2);
    }
}

fn mail(mailboxes: &MailboxSums) -> String {
    let mut parts = vec![
        format!("{} received", count(mailboxes.received, "message")),
        format!("{} wait now", mailboxes.waiting),
        format!("at most {} waited for one agent", mailboxes.waiting_max),
    ];
    let mut some = |number: u64, what: &str| {
        if number > 0 {
            parts.push(format!("{number} {what}"));
        }
    };
    some(mailboxes.overflowed, "did not fit");
    some(mailboxes.unknown_receiver, "for agents that are not here");
    some(mailboxes.unreadable, "unreadable");
    some(mailboxes.not_sent, "not sent");
    some(mailboxes.not_persisted, "records not stored");
    for (rule, number) in &mailboxes.rejected {
        some(*number, &format!("rejected ({rule})"));
    }
    parts.join(", ")
}
