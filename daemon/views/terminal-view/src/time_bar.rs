//! Bars of a Gantt chart: when a step began, when it ended or should, and how late it is.

use crate::styled_line::StyledLine;
use crate::tone::Tone;

/// How a bar ends, or goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BarState {
    Done,
    Running,
    Next,
    Failed,
}

/// A bar: the times are shares of the axis, from 0 to 1.
#[derive(Clone, Debug)]
pub(crate) struct TimeBar {
    pub(crate) state: BarState,
    /// When it began, or should.
    pub(crate) from: f64,
    /// When it ended, or now; when it should end, if it has not begun.
    pub(crate) to: f64,
    /// When it should end, or should have ended; `None` if that is not known.
    pub(crate) usual_end: Option<f64>,
    /// Now; `None` if now is not on the axis.
    pub(crate) now: Option<f64>,
    /// What is said of the bar.
    pub(crate) spoken: String,
}

impl TimeBar {
    /// Makes a bar for a step of which no time is known.
    pub(crate) fn empty(now: Option<f64>) -> Self {
        let state = BarState::Next;
        Self { state, from: 2.0, to: 2.0, usual_end: None, now, spoken: String::new() }
    }

    /// Returns what is said of the bar.
    pub(crate) fn spoken(&self) -> &str {
        &self.spoken
    }

    /// Draws the bar over `columns` cells.
    pub(crate) fn line(&self, columns: usize) -> StyledLine {
        let cells: Vec<_> = (0..columns).map(|column| self.cell(column, columns)).collect();
        let mut line = StyledLine::default();
        for run in cells.chunk_by(|one, other| one == other) {
            if let Some((sign, tone)) = run.first() {
                line.push(&sign.to_string().repeat(run.len()), *tone);
            }
        }
        line
    }

    fn cell(&self, column: usize, columns: usize) -> (char, Tone) {
        let at = |share: f64| cell_of(share, columns);
        let from = at(self.from);
        // What takes any time takes a cell.
        let to = at(self.to).max(from);
        let is_within = self.from <= 1.0 && self.from <= self.to;
        if is_within && (from..=to).contains(&column) {
            let is_late = self.usual_end.is_some_and(|usual| column > at(usual).max(from));
            return match self.state {
                BarState::Failed if column == to => ('✗', Tone::Bad),
                BarState::Next => ('░', Tone::Dim),
                _ if is_late => ('▒', Tone::Warn),
                BarState::Running => ('▓', Tone::Busy),
                BarState::Done | BarState::Failed => ('█', Tone::Good),
            };
        }
        let still = self.usual_end.filter(|_| self.state == BarState::Running);
        if is_within && still.is_some_and(|end| (to..=at(end)).contains(&column)) {
            return ('░', Tone::Dim);
        }
        match self.now {
            Some(now) if at(now) == column => ('│', Tone::Dim),
            _ => (' ', Tone::Plain),
        }
    }
}

/// Returns the cell of a share of the axis.
fn cell_of(share: f64, columns: usize) -> usize {
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
    let last = columns.saturating_sub(1);
    let cell = (share * columns as f64) as usize;
    cell.min(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bar(state: BarState, from: f64, to: f64, usual_end: Option<f64>) -> String {
        let bar = TimeBar { state, from, to, usual_end, now: Some(0.55), spoken: String::new() };
        bar.line(20).text()
    }

    #[test]
    fn bars_show_done_now_next_and_late() {
        assert_eq!(bar(BarState::Done, 0.0, 0.2, Some(0.2)), "█████      │        ");
        assert_eq!(bar(BarState::Done, 0.0, 0.3, Some(0.1)), "███▒▒▒▒    │        ");
        assert_eq!(bar(BarState::Running, 0.3, 0.55, Some(0.8)), "      ▓▓▓▓▓▓░░░░░   ");
        assert_eq!(bar(BarState::Next, 0.8, 1.0, None), "           │    ░░░░");
        assert_eq!(bar(BarState::Failed, 0.1, 0.3, None), "  ████✗    │        ");
        assert_eq!(TimeBar::empty(Some(0.55)).line(20).text(), "           │        ");
    }

    #[test]
    fn times_outside_of_the_axis_are_no_problem() {
        for share in [f64::NAN, f64::INFINITY, -1.0, 0.0, 0.5, 7.0] {
            for columns in 0..10 {
                let bar = TimeBar {
                    state: BarState::Running,
                    from: share,
                    to: 1.0 - share,
                    usual_end: Some(share),
                    now: Some(share),
                    spoken: String::new(),
                };
                assert_eq!(bar.line(columns).width(), columns);
            }
        }
    }
}
