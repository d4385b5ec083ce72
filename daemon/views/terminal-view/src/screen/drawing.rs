//! Draws the screen: a line with the verdict, the tabs, the page, a slider for a recording, and the
//! keys. What does not fit into a small terminal is left out, the page last.

use live_view::{HealthLevel, LiveView, Moment, Overview};
use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};

use super::typing::completions;
use super::{Overlay, ScreenAreas, ViewScreen};
use crate::dialog::{Dialog, DialogKind};
use crate::keys::{self, KeyCommand};
use crate::page::{PAGES, PageName};
use crate::page_data::PageData;
use crate::reading::Reading;
use crate::styled_line::{LineLook, StyledLine};
use crate::text;
use crate::time_words;
use crate::tone::Tone;

/// Heights from which on a terminal has room for the keys, the slider and the tabs.
const KEYS_FROM: u16 = 4;
const SLIDER_FROM: u16 = 6;
const TABS_FROM: u16 = 10;

/// Most lines that say all of a row that is cut.
const REMARK_LINES: usize = 4;

/// Returns the pages of the tabs, in their order.
pub(super) fn tabs() -> impl Iterator<Item = PageName> {
    PAGES.iter().filter(|facts| facts.digit.is_some()).map(|facts| facts.page)
}

/// Returns the beginning of a text, without a part of a word.
fn whole_words(words: &str, columns: usize) -> String {
    let words = text::clean(words);
    if text::width(&words) <= columns {
        return words;
    }
    let cut = text::cut(&words, columns);
    match cut.rfind(' ') {
        Some(at) => format!("{} …", &cut[..at]),
        None => cut,
    }
}

/// Everything that one drawing of the screen takes from a view.
pub(crate) struct DrawnData {
    /// Whether all is well.
    pub(crate) overview: Overview,
    /// What the page shows.
    pub(crate) data: PageData,
    /// What a line that is typed may become.
    pub(crate) hint: String,
}

impl ViewScreen {
    /// Draws the screen as it is at `now`.
    pub fn draw(&mut self, frame: &mut Frame<'_>, view: &LiveView, now: Moment) {
        let data = PageData::of(view, &self.visit().at, now);
        let hint = match &self.overlay {
            Overlay::Command { field, .. } => completions(&field.text(), view, now).join("  "),
            _ => String::new(),
        };
        self.draw_data(frame, &DrawnData { overview: view.overview(now), data, hint }, now);
    }

    /// Draws the screen with this data.
    pub(crate) fn draw_data(&mut self, frame: &mut Frame<'_>, drawn: &DrawnData, now: Moment) {
        let area = frame.area();
        if area.is_empty() {
            return;
        }
        let is_recording = self.recording.is_some();
        let mut top = area.y;
        let mut bottom = area.bottom();
        let buffer = frame.buffer_mut();
        self.draw_header(buffer, row(area, top), &drawn.overview, now);
        top += 1;
        self.areas = ScreenAreas::default();
        if area.height >= TABS_FROM {
            self.draw_tabs(buffer, row(area, top));
            top += 1;
        }
        let keys = (area.height >= KEYS_FROM).then(|| {
            bottom -= 1;
            row(area, bottom)
        });
        if is_recording && area.height >= SLIDER_FROM {
            bottom -= 1;
            self.draw_slider(buffer, row(area, bottom), now);
        }
        self.areas.body = Rect { y: top, height: bottom.saturating_sub(top), ..area };
        self.settle(&drawn.data, now);
        match &self.overlay {
            Overlay::Reading(reading) | Overlay::Plan { reading, .. } => {
                self.draw_reading(buffer, reading);
            }
            _ => {
                self.draw_page(buffer);
                if self.marks_selection {
                    self.draw_remark(buffer);
                }
            }
        }
        // A terminal of one to three lines shows what is typed instead of the page.
        let foot = keys.unwrap_or_else(|| row(area, area.bottom() - 1));
        let cursor = match &self.overlay {
            Overlay::Dialog(dialog) => self.draw_dialog(buffer, area, foot, dialog),
            Overlay::Filter { field, .. } => {
                self.draw_typed(buffer, foot, "/", &field.shown(typed_columns(foot, 1)), "")
            }
            Overlay::Command { field, .. } => {
                let shown = field.shown(typed_columns(foot, 1));
                self.draw_typed(buffer, foot, ":", &shown, &drawn.hint)
            }
            Overlay::None | Overlay::Reading(_) | Overlay::Plan { .. } => {
                let has_stops = drawn.overview.counts.stops > 0;
                keys.into_iter().for_each(|keys| self.draw_keys(buffer, keys, has_stops));
                None
            }
        };
        if let Some(cursor) = cursor {
            frame.set_cursor_position(cursor);
        }
    }

    fn look(&self) -> LineLook {
        LineLook { color: self.options.color, selected: false }
    }

    /// Draws the ecosystem, whether all is well, and the time.
    fn draw_header(&self, buffer: &mut Buffer, area: Rect, overview: &Overview, now: Moment) {
        let columns = usize::from(area.width);
        let time = time_words::clock(now, self.options.utc_offset_seconds);
        let (sign, tone) = verdict(overview.verdict);
        let unreached = overview.not_reached_since.map(|since| {
            format!(
                "NOT REACHED since {}",
                time_words::clock(since, self.options.utc_offset_seconds)
            )
        });
        let summary = match (overview.summary.as_str(), overview.verdict) {
            _ if unreached.is_some() => unreached.as_deref().unwrap_or_default(),
            ("", HealthLevel::Well) => "all is well",
            ("", _) => "not all is well",
            (summary, _) => summary,
        };
        let mut line = StyledLine::of(overview.ecosystem.as_str(), Tone::Heading);
        line.push("  ", Tone::Plain);
        line.push(&format!("{sign} {summary}"), tone);
        // The verdict matters more than the name and the time.
        if line.width() > columns {
            line = StyledLine::of(&format!("{sign} {summary}"), tone);
        }
        let room = columns.saturating_sub(time.len() + 1);
        if columns > 30 {
            line = line.fit(room).and(" ", Tone::Plain).and(&time, Tone::Dim);
        }
        line.fit(columns).draw(buffer, (area.x, area.y), area.width, self.look());
    }

    fn draw_tabs(&mut self, buffer: &mut Buffer, area: Rect) {
        let here = self.visit().at.page;
        let label = |page: PageName, narrow: u8| {
            let facts = page.facts();
            let digit = facts.digit.unwrap_or(' ');
            match narrow {
                0 => format!("{digit} {}", facts.name),
                1 => format!("{digit} {}", facts.short),
                _ if page == here => format!("{digit} {}", facts.short),
                _ => digit.to_string(),
            }
        };
        let total = |narrow: u8| {
            tabs().map(|page| text::width(&label(page, narrow)) + 1).sum::<usize>() - 1
        };
        let columns = usize::from(area.width);
        let narrow = (0..2).find(|narrow| total(*narrow) <= columns).unwrap_or(2);
        // A page without a tab is marked at the tab of the pages that lead to it.
        let marked = match here {
            PageName::Agent => PageName::Agents,
            PageName::Conversation => PageName::Conversations,
            page => page,
        };
        let mut column = area.x;
        for page in tabs() {
            let label = label(page, narrow);
            let room = area.right().saturating_sub(column);
            let width = u16::try_from(text::width(&label)).unwrap_or(u16::MAX).min(room);
            let tone = if page == marked { Tone::Heading } else { Tone::Dim };
            let look = LineLook { selected: page == marked, ..self.look() };
            StyledLine::of(&label, tone).draw(buffer, (column, area.y), width, look);
            self.areas.tabs.push((Rect { x: column, width, ..area }, page));
            column = column.saturating_add(width).saturating_add(1).min(area.right());
        }
    }

    fn draw_page(&self, buffer: &mut Buffer) {
        let body = self.areas.body;
        let visit = self.visit();
        let selected = visit.selected_line(&self.sheet);
        let sticky = self.sheet.sticky_above(visit.scroll).filter(|_| body.height > 1);
        for offset in 0..body.height {
            let position = visit.scroll + usize::from(offset);
            let found = match sticky {
                Some(sticky) if offset == 0 => Some(sticky),
                _ => self.sheet.lines.get(position),
            };
            let Some(found) = found else { break };
            let line = found.line.clone().skip(visit.shift);
            let is_selected = Some(position) == selected && (offset > 0 || sticky.is_none());
            let is_marked = is_selected && self.marks_selection;
            let look = LineLook { selected: is_marked, ..self.look() };
            line.draw(buffer, (body.x, body.y + offset), body.width, look);
        }
    }

    /// Says all of the selected row, where a part of it had no room, in lines that are empty.
    fn draw_remark(&self, buffer: &mut Buffer) {
        let (body, visit) = (self.areas.body, self.visit());
        let selected = visit.selected_line(&self.sheet).and_then(|at| self.sheet.lines.get(at));
        let Some(row) = selected.filter(|row| row.line.is_cut() && visit.shift == 0) else {
            return;
        };
        let said = StyledLine::of(row.spoken.as_deref().unwrap_or_default(), Tone::Dim);
        let lines = said.wrap(usize::from(body.width), 2);
        let used = self.sheet.lines.len().saturating_sub(visit.scroll);
        let free = usize::from(body.height).saturating_sub(used + 1);
        if lines.len() <= free.min(REMARK_LINES) {
            let height = u16::try_from(lines.len()).unwrap_or(0);
            for (y, line) in (body.bottom() - height..).zip(&lines) {
                line.draw(buffer, (body.x, y), body.width, self.look());
            }
        }
    }

    fn draw_reading(&self, buffer: &mut Buffer, reading: &Reading) {
        let body = self.areas.body;
        let lines = reading.wrapped(usize::from(body.width));
        let first = reading.first(lines.len(), usize::from(body.height));
        for (offset, line) in (0..body.height).zip(lines.iter().skip(first)) {
            line.draw(buffer, (body.x, body.y + offset), body.width, self.look());
        }
    }

    /// Draws where in a recording the view is.
    fn draw_slider(&mut self, buffer: &mut Buffer, area: Rect, now: Moment) {
        let Some(span) = self.recording else { return };
        let offset = self.options.utc_offset_seconds;
        let sign = if span.is_playing { "▶" } else { "‖" };
        let mut left = format!("{sign} {} ", time_words::exact_clock(now, offset));
        let mut right = format!(" {}", time_words::clock(span.end, offset));
        if usize::from(area.width) < left.len() + right.len() + 10 {
            (left, right) = (format!("{sign} "), String::new());
        }
        let width = |text: &str| u16::try_from(text::width(text)).unwrap_or(0);
        let long = area.width.saturating_sub(width(&left) + width(&right));
        let (passed, whole) = (now.since(span.start), span.end.since(span.start).max(1));
        let last = u64::from(long.saturating_sub(1));
        let cell = (u128::from(passed.min(whole)) * u128::from(last) / u128::from(whole)) as u64;
        let cell = usize::try_from(cell).unwrap_or(0);
        let line = StyledLine::of(&left, Tone::Heading)
            .and(&"━".repeat(cell), Tone::Busy)
            .and("●", Tone::Heading)
            .and(&"─".repeat(usize::from(long).saturating_sub(cell + 1)), Tone::Dim)
            .and(&right, Tone::Dim);
        line.draw(buffer, (area.x, area.y), area.width, self.look());
        self.areas.slider = Rect { x: area.x + width(&left), width: long, ..area };
    }

    /// Draws the keys of this page, or the sentence that was said last.
    fn draw_keys(&self, buffer: &mut Buffer, area: Rect, has_stops: bool) {
        let columns = usize::from(area.width);
        let at = (area.x, area.y);
        if let Some(note) = &self.note {
            let tone = if note.is_bad { Tone::Bad } else { Tone::Warn };
            let said = whole_words(&note.text, columns);
            StyledLine::of(&said, tone).fit(columns).draw(buffer, at, area.width, self.look());
            return;
        }
        if let Overlay::Reading(reading) | Overlay::Plan { reading, .. } = &self.overlay {
            let is_plan = matches!(self.overlay, Overlay::Plan { .. });
            let keys = reading_keys(is_plan);
            let title = whole_words(&reading.title, columns.saturating_sub(keys.width() + 2));
            let mut line = StyledLine::of(&title, reading.tone).and("  ", Tone::Plain);
            line.append(keys);
            line.fit(columns).draw(buffer, at, area.width, self.look());
            return;
        }
        let page = self.visit().at.page;
        let mut line = StyledLine::default();
        for binding in keys::bindings(page, self.recording.is_some()) {
            let is_release = binding.command == KeyCommand::Release;
            let short = match binding.short {
                "" => continue,
                _ if is_release && !has_stops => continue,
                short => short,
            };
            let Some(key) = binding.keys.first() else { continue };
            let mut next = line.clone();
            if next.width() > 0 {
                next.push("  ", Tone::Plain);
            }
            next.push(&keys::label(*key), Tone::Key);
            next.push(&format!(" {short}"), Tone::Dim);
            if next.width() > columns {
                break;
            }
            line = next;
        }
        line.draw(buffer, at, area.width, self.look());
    }

    /// Draws a line that is typed; returns the cell of the cursor.
    fn draw_typed(
        &self,
        buffer: &mut Buffer,
        area: Rect,
        sign: &str,
        shown: &(String, usize),
        hint: &str,
    ) -> Option<Position> {
        let line = StyledLine::of(sign, Tone::Key).and(&shown.0, Tone::Plain);
        let line = line.and("  ", Tone::Plain).and(hint, Tone::Dim);
        let line = line.fit(usize::from(area.width));
        line.draw(buffer, (area.x, area.y), area.width, self.look());
        let column = u16::try_from(text::width(sign) + shown.1).ok()?;
        let last = area.right().saturating_sub(1);
        Some(Position { x: area.x.saturating_add(column).min(last), y: area.y })
    }

    /// Draws a dialog over the end of the page; returns the cell of the cursor.
    fn draw_dialog(
        &self,
        buffer: &mut Buffer,
        area: Rect,
        foot: Rect,
        dialog: &Dialog,
    ) -> Option<Position> {
        let columns = usize::from(area.width);
        let rule = StyledLine::of(&"─".repeat(columns), Tone::Dim);
        let mut lines = StyledLine::of(&dialog.asks, Tone::Heading).wrap(columns, 0);
        if let DialogKind::Goal { is_kept } = dialog.kind {
            let sign = if is_kept { "[x]" } else { "[ ]" };
            let line = StyledLine::of(sign, Tone::Key);
            lines.push(line.and(" keep it from now on (Tab)", Tone::Plain).fit(columns));
        }
        let mut keys = StyledLine::of("Enter", Tone::Key)
            .and(&format!(" {}  ", dialog.enter_does()), Tone::Dim);
        keys = keys.and("Esc", Tone::Key).and(" leaves", Tone::Dim);
        if let Some(note) = &self.note {
            let tone = if note.is_bad { Tone::Bad } else { Tone::Warn };
            keys = StyledLine::of(&note.text, tone);
        }
        let typed = usize::from(dialog.field.is_some());
        // The line that is typed is seen in every terminal, the question before the keys.
        let room = usize::from(foot.y - area.y);
        lines.truncate(room.saturating_sub(typed));
        if area.height >= TABS_FROM && lines.len() + typed < room {
            lines.insert(0, rule);
        }
        let mut y = foot.y.saturating_sub(u16::try_from(lines.len() + typed).unwrap_or(0));
        for line in &lines {
            let line = line.clone().fit(columns);
            line.draw(buffer, (area.x, y), area.width, self.look());
            y += 1;
        }
        if area.height >= KEYS_FROM || typed == 0 {
            keys.fit(columns).draw(buffer, (foot.x, foot.y), foot.width, self.look());
        }
        let field = dialog.field.as_ref()?;
        let y = if area.height >= KEYS_FROM { y } else { foot.y };
        let place = Rect { y, ..foot };
        self.draw_typed(buffer, place, "› ", &field.shown(typed_columns(place, 2)), "")
    }
}

/// Returns the keys of a text that is read, and, under a dry run, the one that asks for its goal.
fn reading_keys(is_plan: bool) -> StyledLine {
    let mut line = StyledLine::default();
    if is_plan {
        line = line.and("Enter", Tone::Key).and(" asks for it  ", Tone::Dim);
    }
    let line = line.and("↑ ↓", Tone::Key).and(" scroll  ", Tone::Dim);
    line.and("Esc", Tone::Key).and(" back", Tone::Dim)
}

/// Returns the line at `y` of an area.
fn row(area: Rect, y: u16) -> Rect {
    Rect { y, height: 1, ..area }
}

/// Returns the cells that a typed line may take after its sign.
fn typed_columns(area: Rect, sign: u16) -> usize {
    usize::from(area.width.saturating_sub(sign))
}

/// Returns the sign and tone of a verdict.
pub(super) fn verdict(level: HealthLevel) -> (&'static str, Tone) {
    match level {
        HealthLevel::Well => ("✓", Tone::Good),
        HealthLevel::Attention => ("!", Tone::Warn),
        HealthLevel::Bad => ("✗", Tone::Bad),
    }
}
