//! The protocols that control programs which show something: they tell a program what to show, and
//! ask it what it shows.
//!
//! - [`Browser`] speaks the DevTools protocol of Chromium, as it is spoken over a pipe: texts of
//!   JSON, each followed by a zero byte.
//! - [`Mpv`] speaks the JSON protocol of mpv: texts of JSON, one a line.
//! - Each owns one end of a socket. Other crates start and end the program at the other end, and
//!   decide what is shown.
//! - Every wait has a deadline, and a message of the program has a maximum length.

mod browser;
mod frames;
mod mpv;

pub use browser::{Browser, FilmState, PageState};
pub use mpv::{Mpv, MpvState};

use std::io;
use std::time::Duration;

/// Reason why a program did not carry out a command. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScreenLinkError {
    /// The program has declined a command, for instance because a page cannot be loaded. The
    /// program itself works.
    #[error("{what}: {why}")]
    Declined {
        /// Description of the command.
        what: String,
        /// Reason that the program gives.
        why: String,
    },
    /// The program did not answer in time.
    #[error("{what}: there was no answer within {within:?}")]
    TimedOut {
        /// Description of the command.
        what: String,
        /// Time within which the answer had to arrive.
        within: Duration,
    },
    /// The program has closed its end of the connection.
    #[error("go on: the program has closed its connection")]
    Closed,
    /// The connection failed.
    #[error("use the connection to the program: {0}")]
    Io(#[from] io::Error),
    /// The program has sent a message that is too long or not JSON.
    #[error("read a message of the program: {0}")]
    Malformed(String),
    /// The tab that shows the page has crashed.
    #[error("go on: the tab of the page has crashed")]
    Crashed,
}

impl ScreenLinkError {
    /// Whether the program itself still works, and only the command has failed.
    pub fn is_of_command(&self) -> bool {
        matches!(self, ScreenLinkError::Declined { .. })
    }

    fn declined(what: impl Into<String>, why: impl Into<String>) -> ScreenLinkError {
        ScreenLinkError::Declined { what: what.into(), why: shortened(&why.into()) }
    }
}

/// Maximum length of a program's text in an error, in characters; the rest is cut off.
const WORDS_CHARS_MAX: usize = 200;

/// Returns a program's text as one line of bounded length.
fn shortened(words: &str) -> String {
    let mut line: String = words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if let Some((end, _)) = line.char_indices().nth(WORDS_CHARS_MAX) {
        line.truncate(end);
        line.push('…');
    }
    line
}

/// Waits for `work` up to `within`. After that time, returns an error that names `what`.
async fn limited<T>(
    what: &str,
    within: Duration,
    work: impl Future<Output = Result<T, ScreenLinkError>>,
) -> Result<T, ScreenLinkError> {
    match tokio::time::timeout(within, work).await {
        Ok(done) => done,
        Err(_) => Err(ScreenLinkError::TimedOut { what: what.to_owned(), within }),
    }
}
