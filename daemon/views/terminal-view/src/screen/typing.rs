//! Lines that are typed: the filter, the name of a page or thing, and the answers to dialogs.

use live_view::{LiveView, Moment};

use super::{Overlay, ViewScreen};
use crate::dialog::DialogKind;
use crate::input::ViewAct;
use crate::keys::{self, KeyCommand, KeyPress, NamedKey};
use crate::page::{PageAt, PageName};
use crate::reading::Reading;
use crate::text_field::TextField;

/// Most completions that are gone through.
const COMPLETIONS_MAX: usize = 200;

impl ViewScreen {
    /// Returns the line that is being typed.
    pub(super) fn field(&mut self) -> Option<&mut TextField> {
        match &mut self.overlay {
            Overlay::Filter { field, .. } | Overlay::Command { field, .. } => Some(field),
            Overlay::Dialog(dialog) => dialog.field.as_mut(),
            Overlay::None | Overlay::Reading(_) | Overlay::Plan { .. } => None,
        }
    }

    /// Applies the filter that is being typed.
    pub(super) fn after_typing(&mut self) {
        match &mut self.overlay {
            Overlay::Filter { field, .. } => {
                let typed = field.text();
                self.set_filter(typed);
            }
            Overlay::Command { typed, .. } => *typed = None,
            _ => (),
        }
    }

    fn set_filter(&mut self, filter: String) {
        if let Some(visit) = self.trail.last_mut() {
            visit.filter = filter;
            self.is_changed = true;
        }
    }

    pub(super) fn type_filter(&mut self, key: KeyPress) {
        let Overlay::Filter { field, before } = &mut self.overlay else { return };
        match key {
            KeyPress::Named(NamedKey::Enter) => self.overlay = Overlay::None,
            KeyPress::Named(NamedKey::Escape) => {
                let before = std::mem::take(before);
                self.overlay = Overlay::None;
                self.set_filter(before);
            }
            KeyPress::Named(NamedKey::Backspace) if field.is_empty() => {
                self.overlay = Overlay::None;
            }
            KeyPress::Named(NamedKey::Up) => self.step(-1),
            KeyPress::Named(NamedKey::Down) => self.step(1),
            key => {
                field.press(key);
                self.after_typing();
            }
        }
    }

    pub(super) fn type_command(
        &mut self,
        key: KeyPress,
        view: &LiveView,
        now: Moment,
    ) -> Option<ViewAct> {
        let Overlay::Command { field, typed, turn } = &mut self.overlay else { return None };
        match key {
            KeyPress::Named(NamedKey::Enter) => {
                let line = field.text();
                self.overlay = Overlay::None;
                return self.go(&line, view, now);
            }
            KeyPress::Named(NamedKey::Escape) => self.overlay = Overlay::None,
            KeyPress::Named(NamedKey::Backspace) if field.is_empty() => {
                self.overlay = Overlay::None;
            }
            KeyPress::Named(NamedKey::Tab | NamedKey::BackTab) => {
                let begun = typed.get_or_insert_with(|| field.text()).clone();
                let completions = completions(&begun, view, now);
                if let Some(completion) = completions.get(*turn % completions.len().max(1)) {
                    field.set(completion);
                    let back = completions.len() - 1;
                    let is_back = key == KeyPress::Named(NamedKey::BackTab);
                    *turn = (*turn + if is_back { back } else { 1 }) % completions.len();
                }
            }
            key => {
                field.press(key);
                (*typed, *turn) = (None, 0);
            }
        }
        None
    }

    /// Goes to the page or thing that was typed after `:`.
    fn go(&mut self, line: &str, view: &LiveView, now: Moment) -> Option<ViewAct> {
        let line = line.trim();
        let (word, name) = line.split_once(' ').unwrap_or((line, ""));
        let name = Some(name.trim().to_owned()).filter(|name| !name.is_empty());
        match (word, word.parse::<PageName>()) {
            ("", _) => (),
            ("q" | "quit" | "exit", _) => return Some(ViewAct::Quit),
            (_, Ok(page)) if name.is_none() => self.go_to(page),
            (_, Ok(page)) if page.takes_name() => self.open(PageAt { page, name }),
            (_, Ok(page)) => {
                self.go_to(page);
                self.set_filter(name.unwrap_or_default());
            }
            // The name of an agent is enough.
            (_, Err(_)) if view.agents(now).iter().any(|row| row.agent.as_str() == line) => {
                self.open(PageAt::named(PageName::Agent, line));
            }
            (_, Err(unknown)) => self.say(&unknown.to_string(), true),
        }
        None
    }

    pub(super) fn type_answer(
        &mut self,
        key: KeyPress,
        view: &LiveView,
        now: Moment,
    ) -> Option<ViewAct> {
        let Overlay::Dialog(dialog) = &mut self.overlay else { return None };
        match key {
            KeyPress::Named(NamedKey::Escape) => self.overlay = Overlay::None,
            KeyPress::Named(NamedKey::Enter) => {
                let is_last = dialog.is_last();
                match dialog.press_enter() {
                    Ok(act) if is_last => return Some(self.leave_dialog(act)),
                    Ok(act) => {
                        self.say("it is planned for; Enter asks for it at once, Esc leaves", false);
                        return Some(act);
                    }
                    Err(problem) => self.say(problem, true),
                }
            }
            KeyPress::Named(NamedKey::Tab) if dialog.toggle() => (),
            KeyPress::Named(NamedKey::Tab) if dialog.kind == DialogKind::Stop => {
                if let Some(field) = &mut dialog.field {
                    complete_last(field, &stoppable(view, now));
                }
            }
            // Where nothing is typed, `y` and `n` are answers as everywhere.
            KeyPress::Character('y') if dialog.field.is_none() => {
                return self.type_answer(KeyPress::Named(NamedKey::Enter), view, now);
            }
            KeyPress::Character('n' | 'q') if dialog.field.is_none() => {
                self.overlay = Overlay::None;
            }
            key => {
                if let Some(field) = &mut dialog.field {
                    field.press(key);
                }
            }
        }
        None
    }
}

impl ViewScreen {
    /// Ends a dialog whose command runs now.
    fn leave_dialog(&mut self, act: ViewAct) -> ViewAct {
        self.overlay = Overlay::None;
        if let ViewAct::Run { arguments, .. } = &act {
            let command = arguments.first().map(String::as_str).unwrap_or_default();
            self.say(&format!("`althing {command}` runs"), false);
        }
        act
    }

    /// Shows the output of a dry run over the dialog that asked for it; returns whether it did.
    pub(super) fn show_plan(&mut self, title: &str, text: &str, succeeded: bool) -> bool {
        let (Overlay::Dialog(dialog) | Overlay::Plan { dialog, .. }) = &self.overlay else {
            return false;
        };
        if !dialog.has_tried(title) {
            return false;
        }
        let (dialog, reading) = (dialog.clone(), Reading::plan(text, succeeded));
        self.overlay = Overlay::Plan { reading, dialog };
        (self.note, self.awaited) = (None, None);
        true
    }

    /// Takes a key while a dry run is shown: Enter asks for the goal, Esc goes back to what was
    /// typed.
    pub(super) fn press_at_plan(
        &mut self,
        key: KeyPress,
        view: &LiveView,
        now: Moment,
    ) -> Option<ViewAct> {
        let Overlay::Plan { reading, dialog } = &mut self.overlay else { return None };
        if key == KeyPress::Named(NamedKey::Enter) {
            return match dialog.act() {
                Ok(act) => Some(self.leave_dialog(act)),
                Err(problem) => {
                    self.say(problem, true);
                    None
                }
            };
        }
        // Stops count here as elsewhere.
        let page = self.trail.last().map(|visit| visit.at.page).unwrap_or_default();
        let command = keys::command(key, page, self.recording.is_some());
        if let Some(command @ (KeyCommand::Stop | KeyCommand::Release)) = command {
            self.overlay = Overlay::None;
            return self.execute(command, view, now);
        }
        let (columns, height) = (self.areas.body.width, self.areas.body.height);
        if !reading.press(key, usize::from(columns), usize::from(height)) {
            dialog.forget_dry_run();
            self.overlay = Overlay::Dialog(dialog.clone());
        }
        None
    }
}

/// Returns what a line after `:` may become: pages, and the things of a page that takes a name.
pub(super) fn completions(begun: &str, view: &LiveView, now: Moment) -> Vec<String> {
    let begun = begun.trim_start();
    let found: Vec<String> = match begun.split_once(' ') {
        None => {
            // Of the names of tabs only those that are begun: each page is listed once.
            let shorts = PageName::all().map(PageName::short_name);
            let shorts = shorts.filter(|short| !begun.is_empty() && !is_page(short));
            let names = PageName::all().map(PageName::name).chain(shorts);
            names.map(str::to_owned).collect()
        }
        Some((page, _)) => {
            let names: Vec<String> = match page.parse() {
                Ok(PageName::Agent) => {
                    view.agents(now).iter().map(|row| row.agent.to_string()).collect()
                }
                Ok(PageName::Goal) => {
                    view.goals(now).iter().map(|row| row.conversation.to_string()).collect()
                }
                Ok(PageName::Conversation) => {
                    view.conversations().iter().map(|row| row.conversation.to_string()).collect()
                }
                _ => Vec::new(),
            };
            names.into_iter().map(|name| format!("{page} {name}")).collect()
        }
    };
    found.into_iter().filter(|found| found.starts_with(begun)).take(COMPLETIONS_MAX).collect()
}

fn is_page(name: &str) -> bool {
    PageName::all().any(|page| page.name() == name)
}

/// Returns the names that a stop may have.
fn stoppable(view: &LiveView, now: Moment) -> Vec<String> {
    let agents = view.agents(now).into_iter().map(|row| row.agent.to_string());
    agents.chain(view.floor(now).rooms.into_iter().map(|room| room.name)).collect()
}

/// Completes the last word of a line: to the name after it, if the word is a name.
fn complete_last(field: &mut TextField, names: &[String]) {
    let typed = field.text();
    let start = typed.rfind(' ').map_or(0, |space| space + 1);
    let (before, word) = typed.split_at(start);
    let same = names.iter().position(|name| name == word);
    let next = match same {
        Some(here) => names.get(here + 1).or(names.first()),
        None => names.iter().find(|name| name.starts_with(word)),
    };
    if let Some(next) = next {
        field.set(&format!("{before}{next}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_word_is_completed() {
        let names = ["robot-1", "robot-2", "office1"].map(str::to_owned);
        let mut field = TextField::with("office1 ro");
        complete_last(&mut field, &names);
        assert_eq!(field.text(), "office1 robot-1");
        complete_last(&mut field, &names);
        assert_eq!(field.text(), "office1 robot-2");
        let mut unknown = TextField::with("x");
        complete_last(&mut unknown, &names);
        assert_eq!(unknown.text(), "x");
    }
}
