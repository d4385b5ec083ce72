//! Asks a person for a new password, or makes one.

use std::io::{self, BufRead as _, IsTerminal as _, Read as _};

use accounts::{PASSWORD_BYTES_MAX, PersonName, check_new_password, generate_password};

use super::PeopleFailure;
use crate::cli::people::NewPasswordArgs;

/// A new password.
pub(super) struct ChosenPassword {
    pub(super) text: String,
    /// Whether this program has made it, and so must show it.
    pub(super) is_generated: bool,
}

/// Returns a new password: made, typed twice at a terminal without being shown, or the first line of
/// standard input.
pub(super) fn choose(
    name: &PersonName,
    args: &NewPasswordArgs,
) -> Result<ChosenPassword, PeopleFailure> {
    if args.generate {
        return Ok(ChosenPassword { text: generate_password()?, is_generated: true });
    }
    let is_asked = io::stdin().is_terminal();
    let text = match is_asked {
        true => ask(&format!("new password of {name} (not shown): "))?,
        false => first_line()?,
    };
    check_new_password(name.as_str(), &text)?;
    if is_asked && ask("the same once more: ")? != text {
        let problem = "the two passwords differ; nothing is changed";
        return Err(PeopleFailure::Wrong(problem.to_owned()));
    }
    Ok(ChosenPassword { text, is_generated: false })
}

fn ask(prompt: &str) -> Result<String, PeopleFailure> {
    rpassword::prompt_password(prompt).map_err(failed)
}

fn failed(error: io::Error) -> PeopleFailure {
    PeopleFailure::Wrong(format!("the password could not be read: {error}"))
}

fn first_line() -> Result<String, PeopleFailure> {
    let mut line = Vec::new();
    // One byte more than a password may have, and the end of the line.
    let longest = PASSWORD_BYTES_MAX as u64 + 3;
    let read = io::stdin().lock().take(longest).read_until(b'\n', &mut line);
    if read.map_err(failed)? == 0 {
        let problem = "standard input ended before there was a password; --generate makes one";
        return Err(PeopleFailure::Wrong(problem.to_owned()));
    }
    let line = String::from_utf8(line);
    let line = line.map_err(|_| PeopleFailure::Wrong("the password is not UTF-8".to_owned()))?;
    Ok(line.trim_end_matches(['\r', '\n']).to_owned())
}
