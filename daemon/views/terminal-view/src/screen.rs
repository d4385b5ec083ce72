//! The screen: the page that is shown, what was opened before it, and what lies over it. Keys and
//! the mouse change it, and it draws itself.

mod acting;
mod drawing;
mod mouse;
mod typing;

#[cfg(test)]
pub(crate) use drawing::DrawnData;

use live_view::{LiveView, Moment};
use ratatui::layout::Rect;

use crate::dialog::Dialog;
use crate::input::{RecordingSpan, ScreenOptions, ViewAct, ViewInput};
use crate::keys::{self, KeyCommand, KeyPress};
use crate::page::{PageAt, PageName};
use crate::page_data::PageData;
use crate::pages::{self, PageContext};
use crate::reading::Reading;
use crate::sheet::Sheet;
use crate::text_field::TextField;
use crate::visit::PageVisit;

/// Most pages to which Esc goes back.
const TRAIL_MAX: usize = 32;

/// Cells by which the arrows to the left and right move a page.
const SHIFT_STEP: usize = 8;

/// Cells of a page that is moved to the left: all columns of a table have room.
const WIDE: usize = 400;

/// Parts of a recording that one key press passes.
const SEEK_PARTS: u64 = 20;

/// The pages of a view in a terminal. It draws into a frame, and turns keys into acts; it has no
/// terminal of its own.
pub struct ViewScreen {
    options: ScreenOptions,
    /// Whether goals and facts are shown in PDDL although there are words.
    shows_pddl: bool,
    recording: Option<RecordingSpan>,
    /// The pages that were opened; the last one is shown.
    trail: Vec<PageVisit>,
    overlay: Overlay,
    note: Option<ScreenNote>,
    /// The output of the command that ended last.
    output: Option<Reading>,
    /// The command that was run last, if no key was pressed since.
    awaited: Option<String>,
    /// The page as it was drawn last.
    sheet: Sheet,
    /// Whether another page, or another part of it, is to be drawn than was.
    is_changed: bool,
    areas: ScreenAreas,
    /// Whether the selected row is marked; not in a picture, where it has no use.
    marks_selection: bool,
}

/// What lies over the page.
enum Overlay {
    None,
    /// A filter is typed; the filter before is kept for Esc.
    Filter {
        field: TextField,
        before: String,
    },
    /// A page or a thing is typed; Tab goes through the completions of what was typed.
    Command {
        field: TextField,
        typed: Option<String>,
        turn: usize,
    },
    Dialog(Dialog),
    /// The dry run of a goal; Enter asks for the goal.
    Plan {
        reading: Reading,
        dialog: Dialog,
    },
    Reading(Reading),
}

/// A sentence above the keys, until the next key.
struct ScreenNote {
    text: String,
    is_bad: bool,
}

/// Where things were drawn last.
#[derive(Default)]
struct ScreenAreas {
    body: Rect,
    tabs: Vec<(Rect, PageName)>,
    slider: Rect,
}

impl ViewScreen {
    /// Opens the overview.
    pub fn new(options: ScreenOptions) -> Self {
        Self {
            options,
            shows_pddl: false,
            recording: options.recording,
            trail: vec![PageVisit::new(PageAt::default(), false)],
            overlay: Overlay::None,
            note: None,
            output: None,
            awaited: None,
            sheet: Sheet::default(),
            is_changed: true,
            // As large as any terminal was, until the first page is drawn.
            areas: ScreenAreas { body: Rect::new(0, 0, 80, 20), ..ScreenAreas::default() },
            marks_selection: true,
        }
    }

    /// Draws no row as selected.
    pub(crate) fn without_selection(mut self) -> Self {
        self.marks_selection = false;
        self
    }

    /// Opens a page; Esc goes back to the one before.
    pub fn open(&mut self, at: PageAt) {
        if self.visit().at == at {
            return;
        }
        if self.trail.len() >= TRAIL_MAX {
            self.trail.remove(0);
        }
        let follows = at.page == PageName::Activity;
        self.trail.push(PageVisit::new(at, follows));
        self.is_changed = true;
    }

    /// Returns the page that is shown.
    pub fn page(&self) -> &PageAt {
        &self.visit().at
    }

    /// Sets the times of the recording, which may grow, and whether it is played.
    pub fn set_recording(&mut self, recording: Option<RecordingSpan>) {
        self.recording = recording;
    }

    /// Shows the output of a command that was run. If the person does something else by now, or the
    /// pages show what came of the command, only a sentence says that it has ended.
    pub fn show_output(&mut self, title: &str, text: &str, succeeded: bool) {
        if self.show_plan(title, text, succeeded) {
            return;
        }
        let output = Reading::output(title, text, succeeded);
        let is_shown_by_pages = |command: &str| succeeded && matches!(command, "goal" | "act");
        let is_awaited = self.awaited.take().is_some_and(|command| !is_shown_by_pages(&command));
        if is_awaited && matches!(self.overlay, Overlay::None) {
            self.overlay = Overlay::Reading(output.clone());
            self.note = None;
        } else {
            let last = text.lines().rev().map(str::trim).find(|line| !line.is_empty());
            let ended = format!("{}: {} (o shows all)", output.title, last.unwrap_or("ended"));
            self.say(&ended, !succeeded);
        }
        self.output = Some(output);
    }

    /// Shows a sentence until the next key.
    pub fn say(&mut self, text: &str, is_bad: bool) {
        self.note = Some(ScreenNote { text: text.to_owned(), is_bad });
    }

    /// Takes an input; returns what the screen cannot do itself.
    pub fn handle(&mut self, input: ViewInput, view: &LiveView, now: Moment) -> Option<ViewAct> {
        if self.is_changed {
            self.refresh(view, now);
        }
        match input {
            ViewInput::Resize => None,
            ViewInput::Paste(text) => {
                if let Some(field) = self.field() {
                    field.insert(&text);
                }
                self.after_typing();
                None
            }
            ViewInput::Mouse(mouse) => self.mouse(mouse, view, now),
            ViewInput::Key(key) => {
                (self.note, self.awaited) = (None, None);
                let act = self.press(key, view, now);
                if let Some(ViewAct::Run { arguments, .. }) = &act {
                    self.awaited = arguments.first().cloned();
                }
                act
            }
        }
    }

    fn press(&mut self, key: KeyPress, view: &LiveView, now: Moment) -> Option<ViewAct> {
        if key == KeyPress::Control('c') {
            return Some(ViewAct::Quit);
        }
        match &mut self.overlay {
            Overlay::None => {
                let page = self.visit().at.page;
                match keys::command(key, page, self.recording.is_some()) {
                    Some(command) => self.execute(command, view, now),
                    None => {
                        self.say_unknown(key);
                        None
                    }
                }
            }
            Overlay::Reading(reading) => {
                // The keys of pages, of stops and of help count here as elsewhere.
                let is_help = reading.is_help;
                let page = self.visit().at.page;
                let command = keys::command(key, page, self.recording.is_some());
                let leaves = match command {
                    Some(KeyCommand::GoTo(_) | KeyCommand::Stop | KeyCommand::Release) => true,
                    Some(KeyCommand::Help) => !is_help,
                    _ => false,
                };
                if let Some(command) = command.filter(|_| leaves) {
                    self.overlay = Overlay::None;
                    return self.execute(command, view, now);
                }
                let Overlay::Reading(reading) = &mut self.overlay else { return None };
                let height = usize::from(self.areas.body.height);
                if !reading.press(key, usize::from(self.areas.body.width), height) {
                    self.overlay = Overlay::None;
                }
                None
            }
            Overlay::Filter { .. } => {
                self.type_filter(key);
                None
            }
            Overlay::Command { .. } => self.type_command(key, view, now),
            Overlay::Dialog(_) => self.type_answer(key, view, now),
            Overlay::Plan { .. } => self.press_at_plan(key, view, now),
        }
    }

    /// Says of a key that has no meaning here why that is so.
    fn say_unknown(&mut self, key: KeyPress) {
        let label = keys::label(key);
        let is_recording = self.recording.is_some();
        let elsewhere = keys::KEYS.iter().find(|binding| binding.keys.contains(&key));
        let text = match elsewhere.map(|binding| binding.scope) {
            Some(keys::KeyScope::Recording) => format!("`{label}` is a key of recordings"),
            Some(_) if is_recording => format!("`{label}` does nothing in a recording"),
            Some(_) => format!("`{label}` does nothing on this page"),
            None => format!("`{label}` does nothing; `?` shows the keys"),
        };
        self.say(&text, false);
    }

    /// Does what a key means.
    fn execute(&mut self, command: KeyCommand, view: &LiveView, now: Moment) -> Option<ViewAct> {
        let height = usize::from(self.areas.body.height).max(1);
        let screen = isize::try_from(height.saturating_sub(1).max(1)).unwrap_or(isize::MAX);
        match command {
            KeyCommand::Up => self.step(-1),
            KeyCommand::Down => self.step(1),
            KeyCommand::PageUp => self.step(-screen),
            KeyCommand::PageDown => self.step(screen),
            KeyCommand::Top => self.with_visit(PageVisit::top),
            KeyCommand::Bottom => {
                let follows = self.visit().at.page == PageName::Activity;
                self.with_visit(|visit, sheet| visit.bottom(sheet, follows));
            }
            KeyCommand::Left => self.shift(|shift| shift.saturating_sub(SHIFT_STEP)),
            KeyCommand::Right => self.shift(|shift| (shift + SHIFT_STEP).min(WIDE)),
            KeyCommand::Open => self.open_selected(),
            KeyCommand::Back => self.back(),
            KeyCommand::NextPage => self.turn(1),
            KeyCommand::PreviousPage => self.turn(-1),
            KeyCommand::GoTo(page) => self.go_to(page),
            KeyCommand::Filter => {
                let before = self.visit().filter.clone();
                self.overlay = Overlay::Filter { field: TextField::with(&before), before };
            }
            KeyCommand::Command => {
                let field = TextField::default();
                self.overlay = Overlay::Command { field, typed: None, turn: 0 };
            }
            KeyCommand::Help => {
                let page = self.visit().at.page;
                self.overlay = Overlay::Reading(Reading::help(page, self.recording.is_some()));
            }
            KeyCommand::Words => self.toggle_words(),
            KeyCommand::Quit => return Some(ViewAct::Quit),
            KeyCommand::Pause => return Some(ViewAct::TogglePlaying),
            KeyCommand::StepBack => return Some(ViewAct::Step { is_forward: false }),
            KeyCommand::StepForward => return Some(ViewAct::Step { is_forward: true }),
            KeyCommand::SeekBack => return self.seek(now, false),
            KeyCommand::SeekForward => return self.seek(now, true),
            KeyCommand::Copy => return self.copy(),
            KeyCommand::Why => return self.ask_why(),
            KeyCommand::Ask => self.overlay = Overlay::Dialog(Dialog::goal()),
            KeyCommand::Act => self.overlay = Overlay::Dialog(Dialog::action()),
            KeyCommand::Stop => self.overlay = Overlay::Dialog(Dialog::stop()),
            KeyCommand::Output => match self.output.clone() {
                Some(output) => self.overlay = Overlay::Reading(output),
                None => self.say("no command has ended yet", false),
            },
            KeyCommand::Release => self.overlay = Overlay::Dialog(Dialog::release()),
            KeyCommand::Cancel => self.ask_cancel(view, now),
            KeyCommand::Answer => self.answer(view, now),
            KeyCommand::Admit => self.admit(),
        }
        None
    }

    /// Shows goals and facts in PDDL, or in words again.
    fn toggle_words(&mut self) {
        if self.options.words.is_none() {
            return self.say("there are no words: PDDL was asked for (`--pddl`)", false);
        }
        self.shows_pddl = !self.shows_pddl;
        self.is_changed = true;
        let how = if self.shows_pddl { "in PDDL" } else { "in words" };
        self.say(&format!("goals and facts are shown {how}"), false);
    }

    /// Returns a text with its goals and facts as they are shown.
    fn said(&self, text: &str) -> String {
        let words = self.options.words.filter(|_| !self.shows_pddl);
        words.map_or_else(|| text.to_owned(), |words| words(text))
    }

    fn step(&mut self, rows: isize) {
        let height = usize::from(self.areas.body.height).max(1);
        self.with_visit(|visit, sheet| visit.step(sheet, rows, height));
    }

    fn shift(&mut self, change: impl Fn(usize) -> usize) {
        if let Some(visit) = self.trail.last_mut() {
            visit.shift = change(visit.shift);
        }
        self.is_changed = true;
    }

    fn open_selected(&mut self) {
        let Some(link) = self.visit().link(&self.sheet).cloned() else { return };
        match (link.opens, &link.about) {
            (Some(at), _) => self.open(at),
            (None, crate::sheet::RowSubject::Question(_)) if self.recording.is_none() => {
                self.answer_selected();
            }
            (None, _) => self.say("there is no page about this row", false),
        }
    }

    /// Ends the filter, or goes back to the page before.
    fn back(&mut self) {
        let Some(visit) = self.trail.last_mut() else { return };
        self.is_changed = true;
        if !visit.filter.is_empty() || visit.shift > 0 {
            visit.filter.clear();
            visit.shift = 0;
        } else if self.trail.len() > 1 {
            self.trail.pop();
        } else {
            self.go_to(PageName::Overview);
        }
    }

    /// Opens a page by its tab: what was opened before is forgotten, but for the overview.
    fn go_to(&mut self, page: PageName) {
        if self.visit().at == PageAt::of(page) {
            return;
        }
        self.trail.truncate(1);
        self.trail[0] = PageVisit::new(PageAt::default(), false);
        self.open(PageAt::of(page));
        self.is_changed = true;
    }

    /// Opens the tab that is `steps` away from the one of this page.
    fn turn(&mut self, steps: isize) {
        let tabs: Vec<_> = drawing::tabs().collect();
        let page = self.visit().at.page;
        let here = tabs.iter().position(|tab| *tab == page);
        let count = isize::try_from(tabs.len()).unwrap_or(1).max(1);
        let here = here.and_then(|here| isize::try_from(here).ok()).unwrap_or(-1);
        let there = usize::try_from((here + steps).rem_euclid(count)).unwrap_or(0);
        if let Some(page) = tabs.get(there) {
            self.go_to(*page);
        }
    }

    /// Makes the page anew.
    fn refresh(&mut self, view: &LiveView, now: Moment) {
        let data = PageData::of(view, &self.visit().at, now);
        self.settle(&data, now);
    }

    /// Makes the page anew of this data, and finds what was selected in it.
    fn settle(&mut self, data: &PageData, now: Moment) {
        let Some(visit) = self.trail.last_mut() else { return };
        let body = self.areas.body;
        let columns = if visit.shift > 0 { WIDE } else { usize::from(body.width) };
        let context = PageContext {
            columns,
            rows: usize::from(body.height),
            now,
            utc_offset: self.options.utc_offset_seconds,
            is_recording: self.recording.is_some(),
            filter: visit.filter.clone(),
            words: self.options.words.filter(|_| !self.shows_pddl),
        };
        self.sheet = pages::sheet(data, &context);
        visit.settle(&self.sheet, usize::from(body.height));
        self.is_changed = false;
    }

    fn visit(&self) -> &PageVisit {
        self.trail.last().expect("invariant: the trail has a page")
    }

    fn with_visit(&mut self, change: impl FnOnce(&mut PageVisit, &Sheet)) {
        if let Some(visit) = self.trail.last_mut() {
            change(visit, &self.sheet);
            visit.settle(&self.sheet, usize::from(self.areas.body.height));
        }
    }
}
