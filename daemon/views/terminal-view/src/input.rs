//! What comes in from a terminal, what the screen asks its command to do, and how it is set up.

use std::fmt;

use live_view::Moment;

use crate::keys::KeyPress;

/// Something that a person did at the terminal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewInput {
    /// A key was pressed.
    Key(KeyPress),
    /// The mouse was used.
    Mouse(MouseInput),
    /// A text was pasted.
    Paste(String),
    /// The terminal has another size now.
    Resize,
}

/// A use of the mouse, at a cell of the terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MouseInput {
    /// What the mouse did.
    pub deed: MouseDeed,
    /// The cell's column, from 0.
    pub column: u16,
    /// The cell's row, from 0.
    pub row: u16,
}

/// What a mouse did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MouseDeed {
    /// The left button was pressed.
    Press,
    /// The wheel was turned away from the person.
    WheelUp,
    /// The wheel was turned to the person.
    WheelDown,
}

/// Something that the screen cannot do itself.
#[derive(Clone, PartialEq, Eq)]
pub enum ViewAct {
    /// End the view.
    Quit,
    /// Run an `althing` command, without leaving the view, and show its output
    /// ([`crate::ViewScreen::show_output`]).
    Run {
        /// Its arguments, beginning with the command. None begins with `-` that a person or an
        /// agent has written.
        arguments: Vec<String>,
        /// Its standard input, one line. It may be secret.
        input: Option<String>,
    },
    /// Put a text into the clipboard.
    Copy(String),
    /// Show this moment of the recording.
    Seek(Moment),
    /// Show the next message of the recording, or the one before.
    Step {
        /// Whether it is the next.
        is_forward: bool,
    },
    /// Play the recording, or halt it.
    TogglePlaying,
}

impl fmt::Debug for ViewAct {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Quit => f.write_str("Quit"),
            // The input may be the answer to a secret question.
            Self::Run { arguments, .. } => f.debug_tuple("Run").field(arguments).finish(),
            Self::Copy(text) => f.debug_tuple("Copy").field(text).finish(),
            Self::Seek(moment) => f.debug_tuple("Seek").field(moment).finish(),
            Self::Step { is_forward } => f.debug_tuple("Step").field(is_forward).finish(),
            Self::TogglePlaying => f.write_str("TogglePlaying"),
        }
    }
}

/// A function that returns a text in which goals and facts are said in words.
pub type TextInWords = fn(&str) -> String;

/// How a screen is set up.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScreenOptions {
    /// Whether the terminal has colors, and the person wants them.
    pub color: bool,
    /// Seconds by which the clock of the person is ahead of UTC.
    pub utc_offset_seconds: i32,
    /// The recording that is shown; `None` for a running ecosystem.
    pub recording: Option<RecordingSpan>,
    /// The words of goals and facts; `None` if they are shown in PDDL.
    pub words: Option<TextInWords>,
}

/// The times of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordingSpan {
    /// Its first message.
    pub start: Moment,
    /// Its last message.
    pub end: Moment,
    /// Whether it is played now.
    pub is_playing: bool,
}
