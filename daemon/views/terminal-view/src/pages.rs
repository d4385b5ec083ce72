//! The pages: each makes a sheet of lines out of the data of a view.

mod activity;
mod agents;
mod conversations;
mod floor;
mod goal;
mod goals;
mod overview;
mod questions;
mod topology;
mod world;

use live_view::{Moment, ViewSubject};

pub(crate) use questions::asked;

use crate::input::TextInWords;
use crate::page::{PageAt, PageName};
use crate::page_data::PageData;
use crate::sheet::{ROWS_MAX, RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::TableCell;
use crate::text;
use crate::time_words;
use crate::tone::Tone;

/// What a page is made for.
#[derive(Clone, Debug, Default)]
pub(crate) struct PageContext {
    /// Cells of a line.
    pub(crate) columns: usize,
    /// Lines that are seen at once.
    pub(crate) rows: usize,
    /// Now.
    pub(crate) now: Moment,
    /// Seconds by which the clock of the person is ahead of UTC.
    pub(crate) utc_offset: i32,
    /// Whether a recording is shown, in which nothing can be asked for.
    pub(crate) is_recording: bool,
    /// Only rows with these words are shown.
    pub(crate) filter: String,
    /// The words of goals and facts; `None` if they are shown in PDDL.
    pub(crate) words: Option<TextInWords>,
}

impl PageContext {
    fn sheet(&self) -> Sheet {
        Sheet::new(self.columns, &self.filter)
    }

    /// Returns a text with its goals and facts as they are shown: in words, or in PDDL.
    fn said(&self, text: &str) -> String {
        self.words.map_or_else(|| text.to_owned(), |words| words(text))
    }

    /// Returns the rows that a page shows of very many: the first, or the first with all words of
    /// the filter.
    fn bounded<'r, R>(&self, rows: &'r [R], words: impl Fn(&R) -> String) -> Vec<&'r R> {
        let is_short = rows.len() <= ROWS_MAX;
        let takes = |row: &&R| is_short || text::matches(&words(row), &self.filter);
        rows.iter().filter(takes).take(ROWS_MAX).collect()
    }

    /// Says how many rows are not looked at.
    fn say_left_out(&self, sheet: &mut Sheet, all: usize) {
        if all > ROWS_MAX {
            let left_out = all - ROWS_MAX;
            sheet.nothing(&format!("{left_out} of {all} rows are not shown; `/` finds them."));
        }
    }

    /// Returns the time of day of a moment.
    fn clock(&self, moment: Moment) -> String {
        time_words::clock(moment, self.utc_offset)
    }

    /// Returns the time since a moment.
    fn ago(&self, moment: Moment) -> String {
        time_words::duration(self.now.since(moment))
    }
}

/// Makes the sheet of a page.
pub(crate) fn sheet(data: &PageData, context: &PageContext) -> Sheet {
    let mut sheet = match data {
        PageData::Overview(data) => overview::sheet(data, context),
        PageData::Goals(goals) => goals::sheet(goals, context),
        PageData::Goal(Some(detail)) => goal::sheet(detail, context),
        PageData::Goal(None) if context.is_recording => {
            missing(context, "goal", "`2` shows the goals that were recorded so far.")
        }
        PageData::Goal(None) => missing(context, "goal", "`2` shows the goals, `g` asks for one."),
        PageData::Agents(agents) => agents::sheet(agents, context),
        PageData::Agent(Some(detail)) => agents::detail(detail, context),
        PageData::Agent(None) => missing(context, "agent", "`3` shows those that were seen."),
        PageData::World(facts) => world::sheet(facts, context),
        PageData::Floor(floor) => floor::sheet(floor, context),
        PageData::Questions(questions) => questions::sheet(questions, context),
        PageData::Activity(entries) => activity::sheet(entries, context),
        PageData::Conversations(rows) => conversations::sheet(rows, context),
        PageData::Conversation(Some(detail)) => conversations::detail(detail, context),
        PageData::Conversation(None) => {
            missing(context, "conversation", "`8` shows those that are kept.")
        }
        PageData::Topology(daemons) => topology::sheet(daemons, context),
    };
    if !context.filter.is_empty() {
        let shown = sheet.selectable().len();
        let rows = if shown == 1 { "row" } else { "rows" };
        let text = format!("{shown} {rows} with “{}”, {} without", context.filter, sheet.hidden);
        let line = StyledLine::of(&text, Tone::Warn).and("; Esc shows all", Tone::Dim);
        sheet.first(line);
    }
    sheet
}

/// Makes the page of a thing that is not there.
fn missing(context: &PageContext, what: &str, advice: &str) -> Sheet {
    let mut sheet = context.sheet();
    sheet.nothing(&format!("There is no {what} here: it is not known, or not kept any more."));
    sheet.nothing(advice);
    sheet
}

/// Returns the page about a thing.
fn page_of(subject: &ViewSubject) -> PageAt {
    match subject {
        ViewSubject::Goal(goal) => PageAt::named(PageName::Goal, goal.to_string()),
        ViewSubject::Agent(agent) => PageAt::named(PageName::Agent, agent.to_string()),
        ViewSubject::Daemon(_) => PageAt::of(PageName::Topology),
        ViewSubject::Questions => PageAt::of(PageName::Questions),
        ViewSubject::Conversation(conversation) => {
            PageAt::named(PageName::Conversation, conversation.to_string())
        }
    }
}

/// Returns the link of a row about a goal.
fn goal_link(conversation: &str) -> RowLink {
    RowLink {
        key: conversation.to_owned(),
        opens: Some(PageAt::named(PageName::Goal, conversation)),
        copies: conversation.to_owned(),
        about: RowSubject::Goal(conversation.to_owned()),
        ..RowLink::default()
    }
}

/// Returns the link of a row about an agent.
fn agent_link(agent: &str) -> RowLink {
    RowLink {
        key: agent.to_owned(),
        opens: Some(PageAt::named(PageName::Agent, agent)),
        copies: agent.to_owned(),
        about: RowSubject::Agent(agent.to_owned()),
        ..RowLink::default()
    }
}

/// Returns a cell with a duration in milliseconds, or an empty one.
fn duration_cell(milliseconds: Option<u64>, tone: Tone) -> TableCell {
    let text = milliseconds.map(time_words::duration).unwrap_or_default();
    TableCell::of(&text, tone)
}

/// Returns “1 goal”, “2 goals”.
fn count(number: u64, one: &str) -> String {
    if number == 1 { format!("1 {one}") } else { format!("{number} {one}s") }
}
