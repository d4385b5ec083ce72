//! One page, printed once: as lines of text, as JSON, or as a picture in a file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use live_view::{LiveView, Moment};
use serde_json::json;
use terminal::{exit, output};
use terminal_view::{PageAt, PageData, PageName, PictureOptions, RecordingSpan};

use crate::cli::view::ViewArgs;

/// Size of a picture in columns and rows: that of a small terminal.
const PICTURE_COLUMNS: u16 = 80;
const PICTURE_ROWS: u16 = 24;

/// The form in which a page is printed once.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum PageForm {
    /// Lines of text, without frames: for people, scripts and screen readers.
    Text,
    /// JSON, for programs.
    Json,
    /// A picture in this file.
    Picture(PathBuf),
}

impl PageForm {
    /// Returns the form that the user asks for; `None` if the user wants the screen.
    pub(super) fn asked(args: &ViewArgs) -> Option<PageForm> {
        match &args.picture {
            Some(file) => Some(PageForm::Picture(file.clone())),
            None if args.print.json => Some(PageForm::Json),
            None => args.once.then_some(PageForm::Text),
        }
    }

    /// Prints a page of a view, or of a recording.
    pub(super) fn print(
        &self,
        view: &LiveView,
        page: &PageAt,
        now: Moment,
        recording: Option<RecordingSpan>,
    ) -> ExitCode {
        let data = PageData::of(view, page, now);
        if let (true, Some(name)) = (data.is_missing(), &page.name) {
            let problem = unknown(view, page.page, name, now);
            return crate::commands::wrong(&problem, *self == PageForm::Json);
        }
        match self {
            PageForm::Json => output::print_json(&json!(data), exit::DONE),
            PageForm::Text => {
                // A terminal breaks long lines itself, and a script wants none broken.
                let options = super::screen_options(false, recording);
                output::print(terminal_view::page_text(&data, 0, options, now), exit::DONE)
            }
            PageForm::Picture(file) => {
                let options = PictureOptions {
                    columns: PICTURE_COLUMNS,
                    rows: PICTURE_ROWS,
                    screen: super::screen_options(true, recording),
                };
                write(file, &terminal_view::picture(view, page, now, options))
            }
        }
    }
}

fn write(file: &Path, picture: &str) -> ExitCode {
    match std::fs::write(file, picture) {
        Ok(()) => exit::with(exit::DONE),
        Err(error) => {
            let why = terminal::report::reason_of_writing(&error);
            output::print_note(&format!("error: failed to write `{}`: {why}", file.display()));
            exit::with(exit::OUTPUT)
        }
    }
}

/// Says that a page is about something that is not known.
fn unknown(view: &LiveView, page: PageName, name: &str, now: Moment) -> String {
    let known: Vec<String> = match page {
        PageName::Agent => view.agents(now).iter().map(|row| row.agent.to_string()).collect(),
        PageName::Goal => view.goals(now).into_iter().map(|row| row.goal).collect(),
        _ => view.conversations().iter().map(|row| row.conversation.to_string()).collect(),
    };
    let near = pddl::nearest(name, known.iter().map(String::as_str));
    let near = near.map(|near| format!("; did you mean `{near}`?")).unwrap_or_default();
    format!("no {page} `{name}` is known{near}")
}

#[cfg(test)]
mod tests {
    use acl::EcosystemId;
    use live_view::ViewLimits;

    use super::*;

    #[test]
    fn every_page_of_an_empty_ecosystem_has_data() {
        let office = EcosystemId::new("office").expect("a name");
        let view = LiveView::new(office, ViewLimits::default());
        for page in PageName::all() {
            let data = json!(PageData::of(&view, &PageAt::of(page), Moment(1)));
            assert_eq!(data["page"], page.name(), "{data}");
            let problem = unknown(&view, page, "nothing", Moment(1));
            assert_eq!(problem, format!("no {page} `nothing` is known"));
        }
    }
}
