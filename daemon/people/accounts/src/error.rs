//! Errors of the file of people, and the reasons why a sign-in is refused.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use pddl::Diagnostic;

/// Reason why people, passwords or the log of requests cannot be used. The message completes
/// “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AccountsError {
    /// A file or folder cannot be read or written.
    #[error("use {}: {source}", path.display())]
    Io {
        /// Path of the file or folder.
        path: PathBuf,
        /// Error that the system returned.
        #[source]
        source: io::Error,
    },
    /// Other users can change the file, and so could make themselves people with all rights.
    #[error(
        "trust {0}: others can write it (mode {mode:03o}); make it yours alone: chmod 600 {0}",
        path.display()
    )]
    Writable {
        /// Path of the file that others can write.
        path: PathBuf,
        /// Permissions of the file, as a Unix mode.
        mode: u32,
    },
    /// The file is longer than any file of people.
    #[error("read {}: it has more than {max} bytes; no file of people is so long", path.display())]
    TooLong {
        /// Path of the file.
        path: PathBuf,
        /// Maximum length of the file, in bytes.
        max: u64,
    },
    /// The file has mistakes.
    #[error("read {}: {}", path.display(), first(mistakes, text))]
    Mistakes {
        /// Path of the file.
        path: PathBuf,
        /// Text of the file, in which the mistakes have their places.
        text: String,
        /// Mistakes in the file; at least one of them is an error.
        mistakes: Vec<Diagnostic>,
    },
    /// Another process changes the file for longer than any change takes.
    #[error("change {}: another process has been changing it for {} s; try again",
        path.display(), waited.as_secs())]
    Locked {
        /// Path of the file.
        path: PathBuf,
        /// How long the file was waited for.
        waited: Duration,
    },
    /// A person of this name exists already.
    #[error("add `{0}`: there is a person of this name")]
    Exists(String),
    /// No person of this name exists.
    #[error("find `{name}`: there is no person of this name{}", others(known))]
    Unknown {
        /// Name that was looked for.
        name: String,
        /// Names of the people in the file.
        known: Vec<String>,
    },
    /// The name is that of a screen, which has neither a password nor rights.
    #[error(
        "change `{name}`: it is the screen of `{agent}`, which may look at this agent, answer its \
         questions and stop it, and has neither a password nor rights"
    )]
    Screen {
        /// Name of the screen.
        name: String,
        /// Agent on which the screen is.
        agent: String,
    },
    /// A token of this name exists already.
    #[error("add the token `{token}`: `{person}` has one of this name")]
    TokenExists {
        /// Person that has the token.
        person: String,
        /// Name of the token.
        token: String,
    },
    /// No token of this name exists.
    #[error("find the token `{token}`: `{person}` has none of this name{}", others(known))]
    TokenUnknown {
        /// Person with the tokens that were searched.
        person: String,
        /// Name that was looked for.
        token: String,
        /// Names of the tokens of the person.
        known: Vec<String>,
    },
    /// The file would have more people, or a person more tokens, than a daemon reads.
    #[error("add another: {what}, and {max} is the most")]
    TooMany {
        /// Description of what there are too many of.
        what: &'static str,
        /// Maximum number.
        max: usize,
    },
    /// A password is too short, too long, or too easily guessed.
    #[error("use this password: {0}")]
    Password(&'static str),
    /// The system gave no random bytes, or no memory for a hash.
    #[error("make a secret: {0}")]
    Secret(String),
}

fn first(mistakes: &[Diagnostic], text: &str) -> String {
    let error = mistakes.iter().find(|mistake| mistake.is_error()).or(mistakes.first());
    let more = mistakes.iter().filter(|mistake| mistake.is_error()).count().saturating_sub(1);
    let said = error.map(|mistake| mistake.located(text)).unwrap_or_default();
    match more {
        0 => said,
        more => format!("{said} (and {more} more; `althing check` shows all)"),
    }
}

fn others(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; there are {}", names.join(", ")),
    }
}

/// Reason why a person or a program is not let in. The message is for the person at the page, and is
/// the same whether or not the name exists.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignInRefusal {
    /// The name or the password is wrong, or the token.
    #[error("The name or the password is wrong.")]
    Wrong,
    /// There were too many wrong attempts.
    #[error("There were too many wrong attempts. Try again in {}.", spoken(*retry_after))]
    TooMany {
        /// How long to wait before the next attempt.
        retry_after: Duration,
    },
    /// The daemon cannot check the password now.
    #[error("Signing in is not possible now: {0}.")]
    Unavailable(String),
}

/// Returns a wait in words, rounded up, so that an attempt after it is not too early.
fn spoken(wait: Duration) -> String {
    let seconds = wait.as_millis().div_ceil(1_000).max(1);
    match seconds {
        1 => "a second".to_owned(),
        2..=119 => format!("{seconds} seconds"),
        _ => format!("{} minutes", seconds.div_ceil(60)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_is_rounded_up() {
        for (millis, expected) in
            [(0, "a second"), (900, "a second"), (1_001, "2 seconds"), (121_000, "3 minutes")]
        {
            assert_eq!(spoken(Duration::from_millis(millis)), expected);
        }
    }
}
