//! `althing view`: shows a running ecosystem, or a recording, in pages: on the whole screen of a
//! terminal, or one page once, as text, as JSON or as a picture.
//!
//! - [`view_feed`] observes a running ecosystem (with [`crate::observing`]), [`playback`] plays a recording; both feed a
//!   [`LiveView`], which makes what is to be seen.
//! - `terminal_view` draws it; [`screen_loop`] lets it draw, and does what the user asks for.
//! - [`full_screen`] takes the terminal, and gives it back whatever happens.

mod command_runs;
pub(crate) mod full_screen;
mod note_collector;
mod page_output;
mod playback;
mod screen_loop;
mod snapshot;
mod terminal_input;
mod view_feed;
mod view_inbox;

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use live_view::{LiveView, ViewLimits};
use terminal::{exit, output};
use terminal_view::{PageAt, RecordingSpan, ScreenOptions, TextInWords, ViewScreen};
use tokio::runtime::Handle;
use tokio::sync::oneshot;

use crate::cli::view::ViewArgs;
use crate::commands::client::{self, ClientTarget};
use crate::commands::watch::record::Recording;
use crate::interruption;
use crate::speech;

use command_runs::CommandRuns;
use full_screen::FullScreen;
use note_collector::NoteCollector;
use page_output::PageForm;
use playback::Playback;
use screen_loop::{ScreenEnd, ScreenLoop, Shown};
use view_feed::FeedSource;
use view_inbox::ViewInbox;

/// Exit code if the thread of the screen has panicked: that of any program of Rust that has.
const PANICKED: u8 = 101;

/// Runs `althing view`.
pub(super) fn run(args: &ViewArgs) -> ExitCode {
    let page = PageAt { page: args.page, name: args.name.clone() };
    match (&args.recording, PageForm::asked(args)) {
        (Some(file), form) => run_recording(args, file, page, form),
        (None, Some(form)) => snapshot::run(&args.reach, &page, &form),
        (None, None) => run_live(args, page),
    }
}

/// Shows a recording.
fn run_recording(args: &ViewArgs, file: &Path, page: PageAt, form: Option<PageForm>) -> ExitCode {
    let recording = match Recording::read(file) {
        Ok(recording) => recording,
        Err(error) => return super::wrong(&format!("failed to {error}"), args.print.json),
    };
    let mut playback = Playback::new(recording, ViewLimits::default());
    let offset = |at: std::time::Duration| u64::try_from(at.as_millis()).unwrap_or(u64::MAX);
    let at = args.at.map(|at| playback.start().plus(offset(at)));
    let end = playback.end();
    if at.is_some_and(|at| at > end) {
        let seconds = end.since(playback.start()) as f64 / 1_000.0;
        let note = format!("note: the recording ends after {seconds:.1} s; its end is shown");
        output::print_note(&note);
    }
    playback.seek(at.unwrap_or(end));
    if let Some(form) = form {
        return form.print(playback.view(), &page, playback.now(), Some(playback.span()));
    }
    let screen = new_screen(page, Some(playback.span()));
    let shown = Shown::Recorded(Box::new(playback));
    super::in_runtime(show(screen, shown, None, Arc::default()))
}

/// Shows a running ecosystem, or waits on the screen until it runs.
fn run_live(args: &ViewArgs, page: PageAt) -> ExitCode {
    let (name, ecosystem) = match ClientTarget::choose(&args.reach) {
        Ok(chosen) => chosen,
        Err(problem) => return client::unavailable(&problem, false),
    };
    let screen = new_screen(page, None);
    let view = LiveView::new(name.clone(), ViewLimits::default());
    let source = FeedSource { name, ecosystem, reach: args.reach.clone() };
    super::in_runtime(async move {
        let inbox = Arc::<ViewInbox>::default();
        let runs = CommandRuns::new(Handle::current(), Arc::clone(&inbox), &source.reach);
        let shown = Shown::Live(Box::new(view));
        let feed = tokio::spawn(view_feed::observe(source, Arc::clone(&inbox)));
        let code = show(screen, shown, Some(runs), inbox).await;
        feed.abort();
        code
    })
}

/// Makes a screen that shows a page.
fn new_screen(page: PageAt, recording: Option<RecordingSpan>) -> ViewScreen {
    let options = screen_options(output::stdout_is_colored(), recording);
    let mut screen = ViewScreen::new(options);
    screen.open(page);
    screen
}

fn screen_options(color: bool, recording: Option<RecordingSpan>) -> ScreenOptions {
    let words: TextInWords = speech::text;
    let words = speech::is_in_words().then_some(words);
    ScreenOptions { color, utc_offset_seconds: utc_offset_seconds(), recording, words }
}

/// Returns by how many seconds the clock of the user is ahead of UTC now.
fn utc_offset_seconds() -> i32 {
    jiff::Zoned::now().offset().seconds()
}

/// Shows the screen until the user quits, or a signal ends the program.
async fn show(
    screen: ViewScreen,
    shown: Shown,
    runs: Option<CommandRuns>,
    inbox: Arc<ViewInbox>,
) -> ExitCode {
    // The handlers are installed first: a signal must not end the program with the screen shown.
    let interrupted = interruption::interrupted_or_hung_up();
    let notes = NoteCollector::start();
    let full = match FullScreen::show() {
        Ok(full) => full,
        Err(error) => {
            notes.finish();
            let reason = match output::stdout_is_terminal() {
                true => error.to_string(),
                false => "the output is no terminal".to_owned(),
            };
            output::print_note(&format!(
                "error: failed to show a screen: {reason}; `--once` prints a page as text"
            ));
            return exit::with(exit::UNAVAILABLE);
        }
    };
    terminal_input::read_in_background(&inbox);
    let screen_loop = ScreenLoop { screen, full, shown, inbox, runs };
    let (tell, ended) = oneshot::channel();
    let thread = std::thread::Builder::new().name("screen".to_owned());
    // The sender is dropped without a word if the thread panics. There is no receiver if a signal
    // has come.
    let started = thread.spawn(move || {
        let _ = tell.send(screen_loop.run());
    });
    let code = match started {
        Ok(_) => tokio::select! {
            ended = ended => exit_code(ended.ok()),
            signal = interrupted => exit::by_signal(signal),
        },
        Err(_) => exit::with(exit::UNAVAILABLE),
    };
    full_screen::leave();
    notes.finish();
    code
}

/// Returns the exit code for the end of the screen; `None` if its thread has panicked.
fn exit_code(ended: Option<ScreenEnd>) -> ExitCode {
    match ended {
        Some(ScreenEnd::Quit) => exit::with(exit::DONE),
        Some(ScreenEnd::Gone) => exit::with(exit::OUTPUT),
        None => exit::with(PANICKED),
    }
}

#[cfg(test)]
mod tests;
