//! Sequence diagrams: one lane per agent, one line per message.

use crate::styled_line::StyledLine;
use crate::tone::Tone;

/// Cells of the time before the lanes.
const TIME: usize = 9;

/// Fewest cells of a lane, and most.
const LANE_MIN: usize = 8;
const LANE_MAX: usize = 24;

/// Fewest cells of the words after the lanes.
const WORDS_MIN: usize = 20;

/// The lanes of a sequence diagram.
pub(crate) struct SequenceLanes {
    names: Vec<String>,
    /// Cells from one lane to the next.
    pitch: usize,
    columns: usize,
}

impl SequenceLanes {
    /// Gives each agent a lane; `None` if there is no room for them.
    pub(crate) fn new(names: &[&str], columns: usize) -> Option<Self> {
        let room = columns.checked_sub(TIME + WORDS_MIN)?;
        let pitch = room.checked_div(names.len())?.min(LANE_MAX);
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        (pitch >= LANE_MIN).then_some(Self { names, pitch, columns })
    }

    /// Returns the line with the names of the lanes.
    pub(crate) fn heading(&self) -> StyledLine {
        let mut line = StyledLine::of(&" ".repeat(TIME), Tone::Plain);
        for name in &self.names {
            let name = StyledLine::of(name, Tone::Heading).fit(self.pitch - 1);
            line.append(name);
            line.push(" ", Tone::Plain);
        }
        line.fit(self.columns)
    }

    /// Returns the line of a message. A message to nobody in particular goes to all lanes.
    pub(crate) fn message(
        &self,
        time: &str,
        from: &str,
        to: &[&str],
        words: &str,
        tone: Tone,
    ) -> StyledLine {
        let lane = |name: &str| self.names.iter().position(|lane| lane == name);
        let start = lane(from);
        let mut ends: Vec<usize> = to.iter().filter_map(|to| lane(to)).collect();
        if to.is_empty() {
            ends = (0..self.names.len()).filter(|end| Some(*end) != start).collect();
        }
        let cells = self.cells(start, &ends);
        let mut line = StyledLine::of(time, Tone::Dim).fit(TIME);
        let is_arrow = |cell: char| !matches!(cell, ' ' | '│');
        for run in cells.chunk_by(|one, other| is_arrow(*one) == is_arrow(*other)) {
            let arrow = run.first().is_some_and(|cell| is_arrow(*cell));
            let tone = if arrow { tone } else { Tone::Dim };
            line.push(&run.iter().collect::<String>(), tone);
        }
        line.and(words, tone).fit(self.columns)
    }

    /// Returns the cells of the lanes, with the arrow from one lane to others.
    fn cells(&self, start: Option<usize>, ends: &[usize]) -> Vec<char> {
        let at = |lane: usize| lane * self.pitch;
        let mut cells = vec![' '; self.names.len() * self.pitch];
        let mut set = |cell: usize, sign: char| {
            if let Some(cell) = cells.get_mut(cell) {
                *cell = sign;
            }
        };
        (0..self.names.len()).for_each(|lane| set(at(lane), '│'));
        let Some(start) = start else { return cells };
        let first = ends.iter().copied().chain([start]).min().unwrap_or(start);
        let last = ends.iter().copied().chain([start]).max().unwrap_or(start);
        (at(first)..=at(last)).for_each(|cell| set(cell, '─'));
        for end in ends {
            match end.cmp(&start) {
                std::cmp::Ordering::Less => set(at(*end), '◀'),
                std::cmp::Ordering::Greater => set(at(*end), '▶'),
                std::cmp::Ordering::Equal => set(at(*end) + 1, '↺'),
            }
        }
        set(at(start), '●');
        cells
    }
}

/// Returns the cells that a diagram of these lanes needs at least.
#[cfg(test)]
fn needed(lanes: usize) -> usize {
    TIME + WORDS_MIN + lanes * LANE_MIN
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text;

    fn drawn(to: &[&str], from: &str) -> String {
        let lanes = SequenceLanes::new(&["alice", "requester", "robot"], 60).expect("room");
        let line = lanes.message("11:00:00", from, to, "request", Tone::Plain);
        assert_eq!(text::width(&line.text()), 60);
        line.text().trim_end().to_owned()
    }

    #[test]
    fn a_message_is_an_arrow_between_lanes() {
        let lanes = SequenceLanes::new(&["alice", "requester", "robot"], 60).expect("room");
        assert_eq!(lanes.heading().text().trim_end(), "         alice     requester robot");
        assert_eq!(
            drawn(&["requester"], "alice"),
            "11:00:00 ●─────────▶         │         request"
        );
        assert_eq!(drawn(&["alice"], "robot"), "11:00:00 ◀───────────────────●         request");
        assert_eq!(drawn(&[], "requester"), "11:00:00 ◀─────────●─────────▶         request");
        assert_eq!(drawn(&["robot"], "robot"), "11:00:00 │         │         ●↺        request");
        assert_eq!(
            drawn(&["unknown"], "stranger"),
            "11:00:00 │         │         │         request"
        );
    }

    #[test]
    fn lanes_without_room_are_no_diagram() {
        assert!(SequenceLanes::new(&["a", "b"], needed(2)).is_some());
        assert!(SequenceLanes::new(&["a", "b"], needed(2) - 1).is_none());
        assert!(SequenceLanes::new(&[], 80).is_none());
        assert!(SequenceLanes::new(&["a"], 0).is_none());
    }
}
