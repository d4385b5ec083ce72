//! The loop of the screen: takes what has happened from the inbox, lets the screen handle the input
//! of the user, and draws when something has changed.
//!
//! It runs on a thread of its own. If the terminal is slow, only this thread waits.

use std::sync::Arc;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use live_view::{LiveView, Moment, ViewEvent};
use terminal_view::{RecordingSpan, ViewAct, ViewScreen};

use super::command_runs::CommandRuns;
use super::full_screen::{self, FullScreen};
use super::playback::Playback;
use super::terminal_input;
use super::view_inbox::{InboxContents, ScreenInput, ViewInbox};
use crate::observing::{self, EventQueue};

/// Shortest time between two drawings: about twenty in a second, which the eye sees as movement,
/// and a slow link can carry.
const FRAME: Duration = Duration::from_millis(45);

/// Interval between two drawings if nothing happens: ages are shown in seconds.
const REDRAWN_AFTER: Duration = Duration::from_secs(1);

/// Bytes that may be sent to the terminal in a second without input of the user. A slow link, such
/// as ssh over a mobile phone, carries so much.
const BYTES_PER_SECOND: u64 = 20_000;

/// Maximum length of a text for the clipboard, in bytes. Terminals accept no more.
const COPIED_BYTES_MAX: usize = 70_000;

/// What is shown: a running ecosystem, or a recording.
pub(super) enum Shown {
    Live(Box<LiveView>),
    Recorded(Box<Playback>),
}

/// The state of the loop.
pub(super) struct ScreenLoop {
    pub(super) screen: ViewScreen,
    pub(super) full: FullScreen,
    pub(super) shown: Shown,
    pub(super) inbox: Arc<ViewInbox>,
    /// Runs commands; `None` for a recording, in which nothing can be asked for.
    pub(super) runs: Option<CommandRuns>,
}

/// The reason why a screen has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ScreenEnd {
    /// The user has quit.
    Quit,
    /// The terminal has gone away, or the screen was left by another thread.
    Gone,
}

impl Shown {
    fn view(&self) -> &LiveView {
        match self {
            Shown::Live(view) => view,
            Shown::Recorded(playback) => playback.view(),
        }
    }

    fn now(&self) -> Moment {
        match self {
            Shown::Live(_) => observing::now(),
            Shown::Recorded(playback) => playback.now(),
        }
    }

    /// Returns the times of the recording; `None` if a running ecosystem is shown.
    fn recording_span(&self) -> Option<RecordingSpan> {
        match self {
            Shown::Live(_) => None,
            Shown::Recorded(playback) => Some(playback.span()),
        }
    }

    /// Whether a recording plays.
    fn is_playing(&self) -> bool {
        matches!(self, Shown::Recorded(playback) if playback.is_playing())
    }

    /// Whether the screen changes by itself as time passes.
    fn is_moving(&self) -> bool {
        matches!(self, Shown::Live(_)) || self.is_playing()
    }
}

impl ScreenLoop {
    /// Runs until the user quits.
    pub(super) fn run(mut self) -> ScreenEnd {
        let Ok(mut pause) = self.draw() else { return ScreenEnd::Gone };
        let (mut drawn, mut is_changed) = (Instant::now(), false);
        loop {
            let is_playing = self.shown.is_playing();
            let wait = if is_changed || is_playing { pause } else { REDRAWN_AFTER };
            let contents = self.inbox.take_all(drawn + wait);
            let is_asked = !contents.inputs.is_empty();
            is_changed |= !contents.is_empty();
            if let Some(end) = self.take(contents) {
                return end;
            }
            let since = drawn.elapsed();
            let is_due = is_asked
                || since >= pause && (is_changed || is_playing)
                || since >= REDRAWN_AFTER && self.shown.is_moving();
            if !is_due {
                if since >= REDRAWN_AFTER {
                    if full_screen::is_gone() {
                        return ScreenEnd::Gone;
                    }
                    drawn = Instant::now();
                }
                continue;
            }
            if let Shown::Recorded(playback) = &mut self.shown {
                playback.advance(since);
            }
            match self.draw() {
                Ok(after) => pause = after,
                Err(_) => return ScreenEnd::Gone,
            }
            (drawn, is_changed) = (Instant::now(), false);
        }
    }

    /// Draws, and returns how long to wait until the next drawing: a page of which much changes is
    /// drawn less often.
    fn draw(&mut self) -> std::io::Result<Duration> {
        if full_screen::is_gone() {
            return Err(std::io::ErrorKind::NotConnected.into());
        }
        let before = full_screen::bytes_sent();
        self.screen.set_recording(self.shown.recording_span());
        let (view, now) = (self.shown.view(), self.shown.now());
        let screen = &mut self.screen;
        self.full.terminal.draw(|frame| screen.draw(frame, view, now))?;
        let sent = full_screen::bytes_sent().saturating_sub(before);
        let pause = Duration::from_millis(sent.saturating_mul(1_000) / BYTES_PER_SECOND);
        Ok(pause.clamp(FRAME, REDRAWN_AFTER))
    }

    /// Handles what waited in the inbox.
    fn take(&mut self, contents: InboxContents) -> Option<ScreenEnd> {
        let InboxContents { observed, inputs } = contents;
        let EventQueue { events, lost, .. } = observed;
        if let Shown::Live(view) = &mut self.shown {
            for event in events {
                view.observe(event.at, event.into_event());
            }
            if lost > 0 {
                view.observe(observing::now(), ViewEvent::Lost(lost));
            }
        }
        inputs.into_iter().find_map(|input| self.handle(input))
    }

    fn handle(&mut self, input: ScreenInput) -> Option<ScreenEnd> {
        let input = match input {
            ScreenInput::Gone => return Some(ScreenEnd::Gone),
            ScreenInput::Output(output) => {
                self.screen.show_output(&output.title, &output.text, output.succeeded);
                return None;
            }
            ScreenInput::Terminal(event) => terminal_input::convert(event)?,
        };
        let act = self.screen.handle(input, self.shown.view(), self.shown.now())?;
        self.act(act)
    }

    /// Does what the screen asks for. Returns `None` as long as the screen is to be shown.
    fn act(&mut self, act: ViewAct) -> Option<ScreenEnd> {
        match (act, &mut self.shown, &self.runs) {
            (ViewAct::Quit, ..) => return Some(ScreenEnd::Quit),
            (ViewAct::Copy(text), ..) => self.copy(&text),
            (ViewAct::Run { arguments, input }, _, Some(runs)) => runs.start(&arguments, input),
            (ViewAct::Seek(to), Shown::Recorded(playback), _) => playback.seek(to),
            (ViewAct::Step { is_forward }, Shown::Recorded(playback), _) => {
                playback.step(if is_forward { 1 } else { -1 });
            }
            (ViewAct::TogglePlaying, Shown::Recorded(playback), _) => playback.toggle(),
            // Nothing can be asked for in a recording, and what runs has no slider.
            (ViewAct::Run { .. } | ViewAct::Seek(_), ..)
            | (ViewAct::Step { .. } | ViewAct::TogglePlaying, ..) => (),
        }
        None
    }

    /// Puts a text into the clipboard of the terminal (OSC 52).
    fn copy(&mut self, text: &str) {
        if text.len() > COPIED_BYTES_MAX {
            return self.screen.say("the text is too long for a clipboard", true);
        }
        let sequence = format!("\x1b]52;c;{}\x07", STANDARD.encode(text));
        // If the terminal is gone, the next drawing notices it.
        let _ = full_screen::send_sequence(&sequence);
    }
}
