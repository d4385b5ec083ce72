//! Tables: columns that give way to each other when a terminal is narrow, and the bars of a Gantt
//! chart, which take what is left.

use crate::sheet::{RowLink, Sheet};
use crate::styled_line::StyledLine;
use crate::text;
use crate::time_bar::TimeBar;
use crate::tone::Tone;

/// A column.
#[derive(Clone, Debug)]
pub(crate) struct TableColumn {
    title: String,
    /// Columns with greater ranks are left out first; rank 0 never is.
    rank: u8,
    min: usize,
    max: usize,
    is_right: bool,
    is_bar: bool,
}

impl TableColumn {
    /// Makes a column that takes `min` cells at least, and `max` at most if it is given room.
    pub(crate) fn new(title: &str, rank: u8, min: usize, max: usize) -> Self {
        let title = text::clean(title);
        Self { title, rank, min, max, is_right: false, is_bar: false }
    }

    /// Makes a column of numbers.
    pub(crate) fn right(title: &str, rank: u8, min: usize, max: usize) -> Self {
        Self { is_right: true, ..Self::new(title, rank, min, max) }
    }

    /// Makes the column of bars, which takes all that the others leave.
    pub(crate) fn bar(title: &str, rank: u8, min: usize) -> Self {
        Self { is_bar: true, ..Self::new(title, rank, min, usize::MAX) }
    }
}

/// A cell of a table.
#[derive(Clone, Debug)]
pub(crate) enum TableCell {
    /// Text.
    Line(StyledLine),
    /// A bar of a Gantt chart.
    Bar(TimeBar),
}

impl TableCell {
    /// Makes a cell of one text.
    pub(crate) fn of(text: &str, tone: Tone) -> Self {
        Self::Line(StyledLine::of(text, tone))
    }

    fn width(&self) -> usize {
        match self {
            Self::Line(line) => line.width(),
            Self::Bar(_) => 0,
        }
    }
}

/// A table.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    columns: Vec<TableColumn>,
    rows: Vec<(Vec<TableCell>, RowLink)>,
}

impl Table {
    /// Makes a table without rows.
    pub(crate) fn new(columns: Vec<TableColumn>) -> Self {
        Self { columns, rows: Vec::new() }
    }

    /// Appends a row. The first cell names the row's subject.
    pub(crate) fn row(&mut self, cells: Vec<TableCell>, link: RowLink) {
        self.rows.push((cells, link));
    }

    /// Draws the table into a sheet: a heading that stays, and the rows that the filter takes.
    pub(crate) fn draw(self, sheet: &mut Sheet) {
        let widths = self.widths(sheet.columns());
        let titles = self.columns.iter().map(|column| {
            TableCell::of(&column.title, if column.is_bar { Tone::Dim } else { Tone::Heading })
        });
        let gap = gap(sheet.columns());
        let heading = self.joined(&titles.collect::<Vec<_>>(), &widths, gap);
        let mut is_begun = false;
        for (cells, link) in &self.rows {
            let spoken = self.spoken(cells);
            if !sheet.takes(&spoken, link) {
                continue;
            }
            if !is_begun {
                sheet.sticky(heading.clone());
                is_begun = true;
            }
            sheet.row_taken(self.joined(cells, &widths, gap), spoken, link.clone());
        }
    }

    /// Returns the sentence of a row: its subject, then what the columns say.
    fn spoken(&self, cells: &[TableCell]) -> String {
        let mut spoken = String::new();
        for (index, (column, cell)) in self.columns.iter().zip(cells).enumerate() {
            let said = match cell {
                TableCell::Line(line) => line.spoken(),
                TableCell::Bar(bar) => bar.spoken().to_owned(),
            };
            let said = said.trim();
            if said.is_empty() {
                continue;
            }
            match (spoken.is_empty(), column.is_bar || column.title.is_empty()) {
                (true, _) => (),
                (false, true) => spoken.push_str("; "),
                (false, false) => {
                    spoken.push_str("; ");
                    spoken.push_str(&column.title.to_lowercase());
                    spoken.push(' ');
                }
            }
            spoken.push_str(said);
            if index == 0 && self.columns.len() > 1 {
                spoken.push(':');
            }
        }
        spoken.replacen(":;", ":", 1)
    }

    /// Returns the cells of each column in a terminal of `total` cells; 0 leaves the column out.
    fn widths(&self, total: usize) -> Vec<usize> {
        let gap = gap(total);
        let natural: Vec<_> = (0..self.columns.len()).map(|index| self.natural(index)).collect();
        // Half a number or half a time says nothing.
        let least = |index: usize| match &self.columns[index] {
            column if column.is_right => natural[index],
            column => natural[index].min(column.min),
        };
        let mut kept: Vec<usize> =
            (0..self.columns.len()).filter(|index| natural[*index] > 0).collect();
        let needed = |kept: &[usize]| {
            kept.iter().map(|index| least(*index) + gap).sum::<usize>().saturating_sub(gap)
        };
        while needed(&kept) > total {
            let rank = |index: &usize| (self.columns[*index].rank, *index);
            let Some(last) = kept.iter().copied().max_by_key(rank) else { break };
            if self.columns[last].rank == 0 {
                break;
            }
            kept.retain(|index| *index != last);
        }
        let mut widths = vec![0; self.columns.len()];
        kept.iter().for_each(|index| widths[*index] = least(*index).min(total));
        let mut left = total.saturating_sub(needed(&kept));
        // Bars come last, whatever their rank: they are of use at any width above their least.
        kept.sort_by_key(|index| (self.columns[*index].is_bar, self.columns[*index].rank, *index));
        for index in kept {
            let more = natural[index].saturating_sub(widths[index]).min(left);
            widths[index] += more;
            left -= more;
        }
        widths
    }

    /// Returns the cells that a column takes if it is given room; 0 if none of its cells says
    /// anything.
    fn natural(&self, index: usize) -> usize {
        let column = &self.columns[index];
        if column.is_bar {
            return column.max;
        }
        let cells = self.rows.iter().filter_map(|(cells, _)| cells.get(index));
        match cells.map(TableCell::width).max().unwrap_or(0) {
            0 => 0,
            widest => widest.max(text::width(&column.title)).min(column.max),
        }
    }

    /// Joins cells to a line.
    fn joined(&self, cells: &[TableCell], widths: &[usize], gap: usize) -> StyledLine {
        let gap = " ".repeat(gap);
        let mut joined = StyledLine::default();
        let shown = widths.iter().enumerate().filter(|(_, width)| **width > 0);
        for (position, (index, width)) in shown.enumerate() {
            if position > 0 {
                joined.push(&gap, Tone::Plain);
            }
            let is_right = self.columns.get(index).is_some_and(|column| column.is_right);
            match cells.get(index) {
                Some(TableCell::Bar(bar)) => joined.append(bar.line(*width)),
                Some(TableCell::Line(line)) if is_right => {
                    let missing = width.saturating_sub(line.width());
                    let mut padded = StyledLine::of(&" ".repeat(missing), Tone::Plain);
                    padded.append(line.clone());
                    joined.append(padded.fit(*width));
                }
                Some(TableCell::Line(line)) => joined.append(line.clone().fit(*width)),
                None => joined.append(StyledLine::default().fit(*width)),
            }
        }
        joined
    }
}

/// Returns the cells between columns.
fn gap(total: usize) -> usize {
    if total < 60 { 1 } else { 2 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(vec![
            TableColumn::new("AGENT", 0, 8, 20),
            TableColumn::new("DOING", 1, 10, 40),
            TableColumn::right("WAITING", 3, 7, 7),
            TableColumn::new("DAEMON", 2, 6, 12),
        ]);
        for (name, doing) in [("turtlebot-1", "moves to office1"), ("thermometer", "")] {
            let cells =
                [name, doing, "3", "office-pi"].map(|text| TableCell::of(text, Tone::Plain));
            table.row(cells.to_vec(), RowLink { key: name.to_owned(), ..RowLink::default() });
        }
        table
    }

    fn drawn(columns: usize) -> Vec<String> {
        let mut sheet = Sheet::new(columns, "");
        table().draw(&mut sheet);
        sheet.lines.iter().map(|line| line.line.text().trim_end().to_owned()).collect()
    }

    #[test]
    fn columns_give_way_by_their_rank() {
        assert_eq!(
            drawn(80),
            [
                "AGENT        DOING             WAITING  DAEMON",
                "turtlebot-1  moves to office1        3  office-pi",
                "thermometer                          3  office-pi",
            ]
        );
        assert_eq!(
            drawn(30),
            [
                "AGENT       DOING       DAEMON",
                "turtlebot-1 moves to o… offic…",
                "thermometer             offic…",
            ]
        );
        assert_eq!(drawn(20)[1], "turtlebo… moves to …");
        assert_eq!(drawn(5), ["AGENT", "turt…", "ther…"]);
    }

    #[test]
    fn a_row_is_said_in_one_sentence() {
        let mut sheet = Sheet::new(80, "");
        table().draw(&mut sheet);
        assert_eq!(
            sheet.sentences(),
            [
                "turtlebot-1: doing moves to office1; waiting 3; daemon office-pi",
                "thermometer: waiting 3; daemon office-pi"
            ]
        );
    }

    #[test]
    fn no_line_is_wider_than_the_terminal() {
        for columns in 1..100 {
            for line in drawn(columns) {
                assert!(text::width(&line) <= columns, "{columns}: {line}");
            }
        }
    }
}
