//! The rows of daemons.

use std::collections::BTreeMap;

use acl::DaemonId;

use super::LiveView;
use crate::daemon_store::DaemonRecord;
use crate::moment::Moment;
use crate::rows::DaemonRow;
use crate::text::plural;

/// Days before the end of a certificate from which it is a problem.
pub(super) const CERTIFICATE_DAYS: u64 = 14;

/// Returns the number of agents that each process hosts.
pub(super) fn hosted(view: &LiveView) -> BTreeMap<&DaemonId, u64> {
    let mut hosted: BTreeMap<&DaemonId, u64> = BTreeMap::new();
    for daemon in view.agents.iter().flat_map(|(_, record)| record.replicas.keys()) {
        *hosted.entry(daemon).or_default() += 1;
    }
    hosted
}

/// Returns the longest time for which a daemon has been running, in milliseconds; 0 if none has
/// reported it.
pub(super) fn longest_uptime(view: &LiveView) -> u64 {
    let reports = view.daemons.iter().filter_map(|(_, record)| record.status.as_ref());
    reports.map(|(_, report)| u64::from(report.uptime)).max().unwrap_or(0)
}

/// Whether a daemon has left: it has answered before, and hosts no agents any more.
pub(super) fn is_gone(record: &DaemonRecord, hosted: Option<u64>) -> bool {
    record.is_reached.is_some() && hosted.is_none()
}

/// Returns all daemons, sorted by name.
pub(super) fn rows(view: &LiveView, now: Moment) -> Vec<DaemonRow> {
    let hosted = hosted(view);
    let row = |(daemon, record): (&DaemonId, &DaemonRecord)| {
        let report = record.status.as_ref().map(|(at, report)| (*at, report));
        let agents = hosted.get(daemon).copied();
        let is_gone = is_gone(record, agents);
        DaemonRow {
            daemon: daemon.clone(),
            is_reached: record.is_reached.map(|is_reached| is_reached && !is_gone),
            seen_at: record.seen_at,
            round_trip_micros: record.round_trip(),
            usual_round_trip_micros: record.usual_round_trip(),
            agents: agents.unwrap_or(0),
            leads: report.map(|(_, report)| report.leads.clone()).unwrap_or_default(),
            stands_by: report.map(|(_, report)| report.stands_by.clone()).unwrap_or_default(),
            uptime_ms: report
                .map(|(at, report)| u64::from(report.uptime).saturating_add(now.since(at))),
            version: report.map(|(_, report)| report.version.clone()),
            certificate_days_left: report.and_then(|(_, report)| report.certificate_days_left),
            memory_bytes: report.and_then(|(_, report)| report.memory_bytes),
            open_files: report.and_then(|(_, report)| report.open_files),
            open_files_max: report.and_then(|(_, report)| report.open_files_max),
            mailboxes: record.mailboxes.clone(),
            problems: problems(record, is_gone, view.has_directory && agents.is_none()),
        }
    };
    view.daemons.iter().map(row).collect()
}

/// Returns the problems of a daemon, each as one sentence.
fn problems(record: &DaemonRecord, is_gone: bool, is_absent: bool) -> Vec<String> {
    let mut problems = Vec::new();
    if is_absent && record.is_expected && record.is_reached.is_none() {
        problems.push("the ecosystem file names it, and it is not here".to_owned());
    }
    if is_gone {
        problems.push("it is gone".to_owned());
    } else if record.is_reached == Some(false) {
        problems.push("it does not answer".to_owned());
    }
    let days = record.status.as_ref().and_then(|(_, report)| report.certificate_days_left);
    problems.extend(days.and_then(certificate_problem));
    problems.extend(message_problems(record));
    problems
}

pub(super) fn certificate_problem(days: u64) -> Option<String> {
    match days {
        0 => Some("its certificate ends today, or has ended".to_owned()),
        days if days <= CERTIFICATE_DAYS => {
            Some(format!("its certificate ends in {}", plural(days, "day")))
        }
        _ => None,
    }
}

/// Returns the problems with messages that a daemon has counted while it was observed.
pub(super) fn message_problems(record: &DaemonRecord) -> Vec<String> {
    let grown = &record.grown;
    let rejected = grown.rejected.values().fold(0u64, |sum, count| sum.saturating_add(*count));
    let counts = [
        (grown.overflowed, "did not fit into mailboxes"),
        (grown.unreadable, "could not be read"),
        (grown.not_sent, "could not be sent"),
        (rejected, "were rejected"),
    ];
    let messages = counts.into_iter().filter(|(count, _)| *count > 0);
    let mut problems: Vec<_> =
        messages.map(|(count, what)| format!("{} {what}", plural(count, "message"))).collect();
    // Records that were not stored stay a danger until the daemon is restarted.
    let lost = record.mailboxes.as_ref().map_or(0, |totals| totals.not_persisted);
    if lost > 0 {
        problems.push(format!("{} could not be stored", plural(lost, "record")));
    }
    problems
}
