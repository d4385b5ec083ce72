//! Keys that do something to the ecosystem, the clipboard or the recording.

use live_view::{LiveView, Moment};

use super::{Overlay, SEEK_PARTS, ViewScreen};
use crate::dialog::{self, Dialog};
use crate::input::ViewAct;
use crate::page::{PageAt, PageName};
use crate::sheet::{AskedQuestion, RowLink, RowSubject};

impl ViewScreen {
    pub(super) fn copy(&mut self) -> Option<ViewAct> {
        match self.selected().map(|link| link.copies.clone()) {
            Some(text) if !text.is_empty() => {
                self.say(&format!("copied: {text}"), false);
                Some(ViewAct::Copy(text))
            }
            _ => {
                self.say("there is no selected row to copy", false);
                None
            }
        }
    }

    /// Asks why the selected thing is so.
    pub(super) fn ask_why(&mut self) -> Option<ViewAct> {
        let text = match self.selected().map(|link| link.about.clone()) {
            Some(
                RowSubject::Goal(text) | RowSubject::Agent(text) | RowSubject::Statement(text),
            ) => text,
            _ => self.page().name.clone().unwrap_or_default(),
        };
        match dialog::word(&text) {
            Ok(word) => {
                let arguments = vec!["why".to_owned(), word.to_owned()];
                Some(ViewAct::Run { arguments, input: None })
            }
            Err(_) => {
                self.say("select a goal, a step, an agent or a fact first", false);
                None
            }
        }
    }

    /// Asks before the goal is cancelled that is selected, or that the page is about.
    pub(super) fn ask_cancel(&mut self, view: &LiveView, now: Moment) {
        let selected = match self.selected().map(|link| &link.about) {
            Some(RowSubject::Goal(conversation)) => Some(conversation.clone()),
            _ => None,
        };
        let goals = view.goals(now);
        let named = selected.or_else(|| match self.page().page {
            PageName::Goal => self.sheet_goal(),
            _ => None,
        });
        let goal = goals.iter().find(|goal| Some(goal.conversation.as_str()) == named.as_deref());
        match goal {
            None => self.say("select a goal first", false),
            Some(goal) if goal.stage.has_ended() => self.say("this goal has ended", false),
            Some(goal) => {
                let dialog = Dialog::cancel(goal.conversation.as_str(), &self.said(&goal.goal));
                self.overlay = Overlay::Dialog(dialog);
            }
        }
    }

    /// Returns the goal that the page of one goal is about.
    fn sheet_goal(&self) -> Option<String> {
        let goals = self.sheet.lines.iter().filter_map(|line| line.link.as_ref());
        let mut goals = goals.filter_map(|link| match &link.about {
            RowSubject::Goal(conversation) => Some(conversation.clone()),
            _ => None,
        });
        goals.next()
    }

    /// Answers the selected question, the only one, or goes to the page of questions.
    pub(super) fn answer(&mut self, view: &LiveView, now: Moment) {
        if self.selected_question().is_some() {
            self.answer_selected();
            return;
        }
        let questions = view.questions(now);
        match questions.as_slice() {
            [] => self.say("nobody is asked anything now", false),
            [only] => self.show_dialog(Dialog::answer(&crate::pages::asked(only))),
            _ => self.open(PageAt::of(PageName::Questions)),
        }
    }

    pub(super) fn answer_selected(&mut self) {
        if let Some(question) = self.selected_question() {
            self.show_dialog(Dialog::answer(&question));
        }
    }

    pub(super) fn admit(&mut self) {
        match self.selected_question() {
            Some(question) => self.show_dialog(Dialog::admit(&question)),
            None => self.say("nobody is asked anything now", false),
        }
    }

    fn show_dialog(&mut self, dialog: Result<Dialog, &'static str>) {
        match dialog {
            Ok(dialog) => self.overlay = Overlay::Dialog(dialog),
            Err(problem) => self.say(problem, true),
        }
    }

    fn selected_question(&self) -> Option<AskedQuestion> {
        match self.selected().map(|link| &link.about) {
            Some(RowSubject::Question(question)) => Some(question.clone()),
            _ => None,
        }
    }

    pub(super) fn selected(&self) -> Option<&RowLink> {
        self.visit().link(&self.sheet)
    }

    /// Goes through the recording by a part of it.
    pub(super) fn seek(&mut self, now: Moment, is_forward: bool) -> Option<ViewAct> {
        let span = self.recording?;
        let part = (span.end.since(span.start) / SEEK_PARTS).max(1);
        let to = if is_forward { now.plus(part) } else { now.minus(part) };
        Some(ViewAct::Seek(to.clamp(span.start, span.end.max(span.start))))
    }

    /// Goes to the moment of the recording at a cell of the slider.
    pub(super) fn seek_to(&mut self, column: u16) -> Option<ViewAct> {
        let (span, area) = (self.recording?, self.areas.slider);
        let last = u64::from(area.width.saturating_sub(1).max(1));
        let cell = u64::from(column.saturating_sub(area.x)).min(last);
        let long = span.end.since(span.start);
        Some(ViewAct::Seek(span.start.plus(long / last * cell + long % last * cell / last)))
    }
}
