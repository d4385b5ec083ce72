//! A page as lines: what a terminal draws, what is said of it in sentences, and what each line is
//! about.

use crate::page::PageAt;
use crate::styled_line::StyledLine;
use crate::text;
use crate::tone::Tone;

/// Most rows that a page shows. A filter finds the others.
pub(crate) const ROWS_MAX: usize = 1_000;

/// Most lines of a page: many rows have several.
const LINES_MAX: usize = 3 * ROWS_MAX;

/// What a row is about, for the keys that act on it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum RowSubject {
    /// Nothing that can be acted on.
    #[default]
    Nothing,
    /// A goal, by its conversation.
    Goal(String),
    /// An agent.
    Agent(String),
    /// A fact, or a step of a plan, as PDDL.
    Statement(String),
    /// An open question.
    Question(AskedQuestion),
}

/// A question that can be answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AskedQuestion {
    /// Its identifier; `None` until the keyboard has said it.
    pub(crate) id: Option<String>,
    /// The agent that asks.
    pub(crate) from: String,
    /// The question.
    pub(crate) text: String,
    /// Whether the answer is typed hidden.
    pub(crate) is_secret: bool,
}

/// What can be done with a row.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct RowLink {
    /// Identifies the row on its page, so that it stays selected when others come and go.
    pub(crate) key: String,
    /// The page that Enter opens.
    pub(crate) opens: Option<PageAt>,
    /// The text that `y` copies.
    pub(crate) copies: String,
    /// What the row is about.
    pub(crate) about: RowSubject,
    /// Further words by which a filter finds the row: a goal or a fact in PDDL.
    pub(crate) pddl: String,
}

/// A line of a sheet.
#[derive(Clone, Debug, Default)]
pub(crate) struct SheetLine {
    /// The line as it is drawn.
    pub(crate) line: StyledLine,
    /// What can be done with it; `None` if it cannot be selected.
    pub(crate) link: Option<RowLink>,
    /// Whether it stays at the top while the lines below it are shown.
    pub(crate) is_sticky: bool,
    /// What is said of it; `None` for what only orders the page.
    pub(crate) spoken: Option<String>,
}

/// A page as lines.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sheet {
    /// The lines, top to bottom.
    pub(crate) lines: Vec<SheetLine>,
    /// Cells that a line may take.
    columns: usize,
    /// Only rows with these words are shown.
    filter: String,
    /// Rows that the filter has left out.
    pub(crate) hidden: usize,
}

impl Sheet {
    /// Makes an empty page.
    pub(crate) fn new(columns: usize, filter: &str) -> Self {
        Self { columns: columns.max(1), filter: filter.to_owned(), ..Self::default() }
    }

    /// Returns the cells that a line may take.
    pub(crate) fn columns(&self) -> usize {
        self.columns
    }

    /// Appends a line, wrapped; what is said of it is its text.
    pub(crate) fn text(&mut self, line: &StyledLine, indent: usize) {
        let mut spoken = Some(line.text().trim().to_owned()).filter(|said| !said.is_empty());
        for line in line.wrap(self.columns, indent) {
            self.lines.push(SheetLine { line, spoken: spoken.take(), ..SheetLine::default() });
        }
    }

    /// Puts a line before all others.
    pub(crate) fn first(&mut self, line: StyledLine) {
        let spoken = Some(line.text());
        let line = line.fit(self.columns);
        self.lines.insert(0, SheetLine { line, spoken, ..SheetLine::default() });
    }

    /// Appends an empty line, unless the page is empty or its last line is.
    pub(crate) fn gap(&mut self) {
        if self.lines.last().is_some_and(|last| last.line.width() > 0) {
            self.lines.push(SheetLine::default());
        }
    }

    /// Appends a heading after a gap.
    pub(crate) fn heading(&mut self, text: &str) {
        self.gap();
        self.text(&StyledLine::of(text, Tone::Heading), 0);
    }

    /// Appends the sentence that says why there is nothing here, and what to do.
    pub(crate) fn nothing(&mut self, because: &str) {
        self.text(&StyledLine::of(because, Tone::Dim), 0);
    }

    /// Appends a line that is drawn and not said.
    pub(crate) fn drawing(&mut self, line: StyledLine) {
        self.lines.push(SheetLine { line, ..SheetLine::default() });
    }

    /// Appends a line that stays at the top while what follows is shown.
    pub(crate) fn sticky(&mut self, line: StyledLine) {
        self.lines.push(SheetLine { line, is_sticky: true, ..SheetLine::default() });
    }

    /// Appends a row that can be selected, unless the filter leaves it out.
    pub(crate) fn row(&mut self, line: StyledLine, spoken: String, link: RowLink) {
        if self.takes(&spoken, &link) {
            self.row_taken(line, spoken, link);
        }
    }

    /// Appends a row that the filter has taken.
    pub(crate) fn row_taken(&mut self, line: StyledLine, spoken: String, link: RowLink) {
        let (link, spoken) = (Some(link), Some(spoken));
        self.lines.push(SheetLine { line, link, spoken, is_sticky: false });
    }

    /// Appends a row that can be selected and is wrapped, unless the filter leaves it out.
    pub(crate) fn wrapped_row(&mut self, line: &StyledLine, indent: usize, link: RowLink) {
        self.said_row(line, indent, line.text().trim().to_owned(), link);
    }

    /// Appends a row that can be selected and is wrapped, and of which this is said, unless the
    /// filter leaves it out.
    pub(crate) fn said_row(
        &mut self,
        line: &StyledLine,
        indent: usize,
        spoken: String,
        link: RowLink,
    ) {
        if !self.takes(&spoken, &link) {
            return;
        }
        let mut first = Some((link, spoken));
        for line in line.wrap(self.columns, indent) {
            let (link, spoken) = first.take().unzip();
            self.lines.push(SheetLine { line, link, spoken, is_sticky: false });
        }
    }

    /// Whether a row is shown, by what is said of it and by its PDDL; counts those that are not.
    pub(crate) fn takes(&mut self, spoken: &str, link: &RowLink) -> bool {
        let matches = self.filter.is_empty()
            || text::matches(&format!("{spoken} {}", link.pddl), &self.filter);
        let takes = self.lines.len() < LINES_MAX && matches;
        self.hidden += usize::from(!takes);
        takes
    }

    /// Returns the positions of the lines that can be selected.
    pub(crate) fn selectable(&self) -> Vec<usize> {
        let is_row =
            |(position, line): (usize, &SheetLine)| line.link.is_some().then_some(position);
        self.lines.iter().enumerate().filter_map(is_row).collect()
    }

    /// Returns the line that stays at the top while the lines from `first` on are shown.
    pub(crate) fn sticky_above(&self, first: usize) -> Option<&SheetLine> {
        let above = self.lines.get(..first)?.iter().rev();
        above.take_while(|line| line.line.width() > 0).find(|line| line.is_sticky)
    }

    /// Returns the sentences of the page.
    pub(crate) fn sentences(&self) -> Vec<String> {
        let mut sentences: Vec<String> = Vec::new();
        for line in &self.lines {
            match &line.spoken {
                Some(spoken) => sentences.push(text::without_sign(spoken).to_owned()),
                None if line.line.width() == 0 => sentences.push(String::new()),
                None => (),
            }
        }
        sentences.dedup_by(|next, before| next.is_empty() && before.is_empty());
        sentences
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(sheet: &mut Sheet, words: &str) {
        let link = RowLink { key: words.to_owned(), ..RowLink::default() };
        sheet.row(StyledLine::of(words, Tone::Plain), words.to_owned(), link);
    }

    #[test]
    fn the_filter_leaves_rows_out_and_counts_them() {
        let mut sheet = Sheet::new(20, "bot");
        sheet.heading("Agents");
        ["turtlebot-1", "thermometer", "turtlebot-2"].iter().for_each(|name| row(&mut sheet, name));
        assert_eq!((sheet.selectable(), sheet.hidden), (vec![1, 2], 1));
    }

    #[test]
    fn a_heading_stays_at_the_top_until_the_next_gap() {
        let mut sheet = Sheet::new(20, "");
        sheet.sticky(StyledLine::of("NAME", Tone::Heading));
        row(&mut sheet, "a");
        row(&mut sheet, "b");
        sheet.gap();
        row(&mut sheet, "c");
        assert_eq!(sheet.sticky_above(2).map(|line| line.line.text()), Some("NAME".to_owned()));
        assert!(sheet.sticky_above(5).is_none());
        assert!(sheet.sticky_above(0).is_none());
    }

    #[test]
    fn sentences_leave_out_what_only_orders_the_page() {
        let mut sheet = Sheet::new(10, "");
        sheet.text(&StyledLine::of("all is well in this house", Tone::Good), 0);
        sheet.drawing(StyledLine::of("╭────╮", Tone::Plain));
        sheet.gap();
        sheet.gap();
        row(&mut sheet, "a");
        let said = ["all is well in this house", "", "a"];
        assert_eq!(sheet.sentences(), said);
    }
}
