//! Remembers which reports of a goal a command has printed. After a disconnection the command
//! prints the lines of the goal's history that it missed, each line once.

use std::collections::VecDeque;

use acl::content::{HISTORY_ENTRIES_MAX, HistoryEntry, Outcome, Report};

type ReportLine = (Outcome, String);

/// Lines that a command has printed about one goal, up to the maximum length of a goal's history.
#[derive(Debug, Default)]
pub(super) struct PrintedReports {
    lines: VecDeque<ReportLine>,
    /// Lines that were printed from the goal's history. The same lines may still arrive as
    /// messages.
    from_history: Vec<ReportLine>,
}

impl PrintedReports {
    /// Remembers a report that arrived. Returns `true` if the report is to be printed.
    pub(super) fn note(&mut self, report: &Report) -> bool {
        let line = (report.outcome, report.detail.clone());
        if let Some(index) = self.from_history.iter().position(|other| *other == line) {
            self.from_history.remove(index);
            return false;
        }
        // Messages arrive in order, so no line from the history can still arrive after this one.
        self.from_history.clear();
        self.push(line);
        true
    }

    /// Returns the lines of a goal's history that have not been printed, and remembers them as
    /// printed. The final report is never among the returned lines, because the Plan Requester
    /// sends it as a message until it is acknowledged.
    pub(super) fn missed(&mut self, history: Vec<HistoryEntry>) -> Vec<Report> {
        let mut printed: Vec<_> = self.lines.iter().cloned().collect();
        let mut missed = Vec::new();
        for HistoryEntry { outcome, text, .. } in history {
            let Some(outcome) = outcome.filter(|outcome| !outcome.is_final()) else { continue };
            let line = (outcome, text);
            if let Some(index) = printed.iter().position(|other| *other == line) {
                printed.remove(index);
                continue;
            }
            missed.push(Report::new(outcome, line.1.clone()));
            self.from_history.push(line.clone());
            self.push(line);
        }
        missed
    }

    fn push(&mut self, line: ReportLine) {
        if self.lines.len() == HISTORY_ENTRIES_MAX {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn progress(text: &str) -> Report {
        Report::new(Outcome::Progress, text)
    }

    fn history(lines: &[&str]) -> Vec<HistoryEntry> {
        let entry = |text: &&str| HistoryEntry {
            at_ms: 0,
            outcome: Some(Outcome::Progress),
            text: (*text).to_owned(),
        };
        lines.iter().map(entry).collect()
    }

    fn texts(reports: &[Report]) -> Vec<&str> {
        reports.iter().map(|report| report.detail.as_str()).collect()
    }

    #[test]
    fn only_unprinted_reports_are_missed() {
        let mut told = PrintedReports::default();
        assert!(told.note(&progress("a plan")) && told.note(&progress("arrived")));
        let all = history(&["a plan", "arrived", "measured", "arrived"]);
        assert_eq!(texts(&told.missed(all.clone())), ["measured", "arrived"]);
        assert!(told.missed(all).is_empty(), "they are told now");
    }

    #[test]
    fn a_late_message_does_not_repeat_a_line_of_the_history() {
        let mut told = PrintedReports::default();
        told.missed(history(&["arrived", "measured"]));
        assert!(!told.note(&progress("measured")));
        assert!(told.note(&progress("back")));
        assert!(told.note(&progress("arrived")), "it arrives once more");
    }

    #[test]
    fn the_final_report_comes_only_as_a_message() {
        let mut told = PrintedReports::default();
        let end = Report::new(Outcome::Done, "the goal holds");
        let (outcome, text) = (Some(end.outcome), end.detail.clone());
        assert!(told.missed(vec![HistoryEntry { at_ms: 0, outcome, text }]).is_empty());
        assert!(told.note(&end));
    }

    #[test]
    fn lines_without_an_outcome_are_not_missed() {
        let mut told = PrintedReports::default();
        let text = "asked for".to_owned();
        assert!(told.missed(vec![HistoryEntry { at_ms: 0, outcome: None, text }]).is_empty());
    }
}
