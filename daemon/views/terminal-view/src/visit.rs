//! A page as a person looks at it: what is selected, filtered and scrolled to.

use crate::page::PageAt;
use crate::sheet::{RowLink, Sheet};

/// A page that a person has opened.
#[derive(Clone, Debug, Default)]
pub(crate) struct PageVisit {
    /// The page.
    pub(crate) at: PageAt,
    /// Only rows with these words are shown.
    pub(crate) filter: String,
    /// Cells that are left out on the left.
    pub(crate) shift: usize,
    /// First line that is shown.
    pub(crate) scroll: usize,
    /// Key of the selected row, and its number among the rows.
    selected: Option<String>,
    number: usize,
    /// Whether the last row is selected, whatever comes.
    pub(crate) follows: bool,
    /// Whether the person has scrolled away from the selected row.
    is_away: bool,
}

impl PageVisit {
    /// Opens a page at its first line; `follows` selects its last row.
    pub(crate) fn new(at: PageAt, follows: bool) -> Self {
        Self { at, follows, is_away: !follows, ..Self::default() }
    }

    /// Finds the selected row in a sheet that was made anew, and scrolls to it.
    pub(crate) fn settle(&mut self, sheet: &Sheet, height: usize) {
        let rows = sheet.selectable();
        let key = |position: &usize| sheet.lines[*position].link.as_ref().map(|link| &link.key);
        let found = rows.iter().position(|position| key(position) == self.selected.as_ref());
        self.number = match found {
            _ if self.follows => rows.len().saturating_sub(1),
            Some(number) => number,
            None => self.number.min(rows.len().saturating_sub(1)),
        };
        self.selected = rows.get(self.number).and_then(key).cloned();
        let last = sheet.lines.len().saturating_sub(height);
        if let Some(line) = rows.get(self.number).copied().filter(|_| !self.is_away) {
            // The text above the first row is seen when the first row is selected.
            let above = if self.number == 0 && line < height { 0 } else { line };
            self.scroll = self.scroll.min(above);
            self.scroll = self.scroll.max((line + 1).saturating_sub(height));
            if self.scroll == line && height > 1 && sheet.sticky_above(line).is_some() {
                self.scroll = line.saturating_sub(1);
            }
        }
        self.scroll = self.scroll.min(last);
    }

    /// Returns the line of the selected row.
    pub(crate) fn selected_line(&self, sheet: &Sheet) -> Option<usize> {
        sheet.selectable().get(self.number).copied()
    }

    /// Returns the selected row.
    pub(crate) fn link<'s>(&self, sheet: &'s Sheet) -> Option<&'s RowLink> {
        sheet.lines.get(self.selected_line(sheet)?)?.link.as_ref()
    }

    /// Moves the selection by so many rows; beyond the first and the last row, or if the page has
    /// none, the page scrolls.
    pub(crate) fn step(&mut self, sheet: &Sheet, rows: isize, height: usize) {
        let positions = sheet.selectable();
        let last = positions.len().saturating_sub(1);
        let end = sheet.lines.len().saturating_sub(height);
        let line = positions.get(self.number).copied().unwrap_or(self.scroll);
        let is_below = line >= self.scroll + height && rows > 0;
        let is_above = line < self.scroll && rows < 0;
        if self.is_away && (is_below || is_above) {
            // The selected row is not in sight: the page first scrolls to it.
            self.scroll = self.scroll.saturating_add_signed(rows).min(end);
            return;
        }
        let number = self.number.saturating_add_signed(rows).min(last);
        if number != self.number {
            self.choose(sheet, number);
            return;
        }
        self.follows = rows > 0 && self.follows;
        self.is_away = true;
        self.scroll = self.scroll.saturating_add_signed(rows).min(end);
    }

    /// Selects the row of this number.
    pub(crate) fn choose(&mut self, sheet: &Sheet, number: usize) {
        let positions = sheet.selectable();
        self.number = number.min(positions.len().saturating_sub(1));
        let link = positions.get(self.number).and_then(|line| sheet.lines[*line].link.as_ref());
        self.selected = link.map(|link| link.key.clone());
        self.is_away = false;
        self.follows = false;
    }

    /// Selects the first row, and shows the first line.
    pub(crate) fn top(&mut self, sheet: &Sheet) {
        self.choose(sheet, 0);
        self.scroll = 0;
    }

    /// Selects the last row and shows the last line; `follows` keeps it so when rows are added.
    pub(crate) fn bottom(&mut self, sheet: &Sheet, follows: bool) {
        self.choose(sheet, usize::MAX);
        self.scroll = sheet.lines.len();
        self.is_away = true;
        self.follows = follows;
        if follows {
            self.is_away = false;
        }
    }

    /// Selects the row at a line; returns whether it was selected before, or `None` if there is no
    /// row.
    pub(crate) fn click(&mut self, sheet: &Sheet, line: usize) -> Option<bool> {
        let number = sheet.selectable().iter().position(|row| *row == line)?;
        let was_selected = number == self.number;
        self.choose(sheet, number);
        Some(was_selected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::styled_line::StyledLine;
    use crate::tone::Tone;

    fn sheet(rows: &[&str]) -> Sheet {
        let mut sheet = Sheet::new(40, "");
        sheet.text(&StyledLine::of("All is well.", Tone::Good), 0);
        sheet.sticky(StyledLine::of("NAME", Tone::Heading));
        for row in rows {
            let link = RowLink { key: (*row).to_owned(), ..RowLink::default() };
            sheet.row(StyledLine::of(row, Tone::Plain), (*row).to_owned(), link);
        }
        sheet
    }

    fn selected(visit: &PageVisit, sheet: &Sheet) -> String {
        visit.link(sheet).map(|link| link.key.clone()).unwrap_or_default()
    }

    #[test]
    fn the_selected_row_stays_selected_when_others_come_and_go() {
        let mut visit = PageVisit::default();
        let first = sheet(&["b", "c", "d"]);
        visit.settle(&first, 10);
        visit.step(&first, 1, 10);
        assert_eq!(selected(&visit, &first), "c");
        let second = sheet(&["a", "b", "c", "d"]);
        visit.settle(&second, 10);
        assert_eq!(selected(&visit, &second), "c");
        let third = sheet(&["a"]);
        visit.settle(&third, 10);
        assert_eq!(selected(&visit, &third), "a");
        visit.settle(&sheet(&[]), 10);
        assert!(visit.link(&sheet(&[])).is_none());
    }

    #[test]
    fn the_selected_row_is_in_sight_below_the_heading() {
        let rows: Vec<_> = (0..30).map(|number| format!("r{number:02}")).collect();
        let sheet = sheet(&rows.iter().map(String::as_str).collect::<Vec<_>>());
        let mut visit = PageVisit::default();
        let sees = |visit: &PageVisit| {
            let line = visit.selected_line(&sheet).expect("a row");
            let hidden = usize::from(sheet.sticky_above(visit.scroll).is_some());
            (visit.scroll + hidden..visit.scroll + 5).contains(&line)
        };
        for _ in 0..40 {
            visit.settle(&sheet, 5);
            assert!(sees(&visit), "{visit:?}");
            visit.step(&sheet, 1, 5);
        }
        for _ in 0..40 {
            visit.settle(&sheet, 5);
            visit.step(&sheet, -1, 5);
        }
        visit.settle(&sheet, 5);
        assert_eq!((visit.scroll, selected(&visit, &sheet).as_str()), (0, "r00"));
    }

    #[test]
    fn a_page_is_read_from_its_first_line() {
        let mut sheet = Sheet::new(40, "");
        (0..5).for_each(|_| sheet.drawing(StyledLine::of("drawing", Tone::Plain)));
        ["a", "b"].iter().for_each(|row| {
            let link = RowLink { key: (*row).to_owned(), ..RowLink::default() };
            sheet.row(StyledLine::of(row, Tone::Plain), (*row).to_owned(), link);
        });
        let mut visit = PageVisit::new(PageAt::default(), false);
        visit.settle(&sheet, 4);
        assert_eq!((visit.scroll, selected(&visit, &sheet).as_str()), (0, "a"));
        for (scroll, key) in [(1, "a"), (2, "a"), (3, "b"), (3, "b")] {
            visit.step(&sheet, 1, 4);
            visit.settle(&sheet, 4);
            assert_eq!((visit.scroll, selected(&visit, &sheet).as_str()), (scroll, key));
        }
    }

    #[test]
    fn a_page_that_follows_shows_its_last_row() {
        let mut visit = PageVisit::new(PageAt::default(), true);
        visit.settle(&sheet(&["a", "b"]), 2);
        let longer = sheet(&["a", "b", "c"]);
        visit.settle(&longer, 2);
        assert_eq!(selected(&visit, &longer), "c");
        visit.step(&longer, -1, 2);
        let longest = sheet(&["a", "b", "c", "d"]);
        visit.settle(&longest, 2);
        assert_eq!(selected(&visit, &longest), "b");
    }
}
