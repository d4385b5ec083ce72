//! Command line parsing that all programs share.

use std::ffi::OsString;
use std::process::ExitCode;
use std::time::Duration;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, CommandFactory, Parser};

use crate::{exit, visible};

/// Arguments that select the form in which results are printed.
#[derive(Clone, Debug, Args)]
pub struct PrintArgs {
    /// Print JSON, for programs
    #[arg(long)]
    pub json: bool,
}

/// Parses the command line.
///
/// # Errors
///
/// Returns the exit code if the command line is wrong or asks for help; the message is printed
/// before.
pub fn parse<P: Parser>(words: impl IntoIterator<Item = OsString>) -> Result<P, ExitCode> {
    let words: Vec<OsString> = words.into_iter().collect();
    P::try_parse_from(&words).map_err(|err| {
        let asked_for = matches!(err.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
        // The error message repeats the words, so control characters in them are made visible.
        let shown = words.iter().map(|word| visible::line(&word.to_string_lossy()).into_owned());
        let err = P::try_parse_from(shown).err().unwrap_or(err);
        match unknown_command::<P>(&err, &words) {
            Some(problem) => crate::output::print_note(&problem),
            // A failure is ignored, because it could not be reported.
            None => drop(err.print()),
        }
        exit::with(if asked_for { exit::DONE } else { exit::USAGE })
    })
}

/// Returns the message for a command that does not exist; `None` for any other error.
fn unknown_command<P: CommandFactory>(err: &clap::Error, words: &[OsString]) -> Option<String> {
    if err.kind() != ErrorKind::InvalidSubcommand {
        return None;
    }
    let Some(ContextValue::String(said)) = err.get(ContextKind::InvalidSubcommand) else {
        return None;
    };
    // The commands of a command, such as those of `althing cert`, are explained by clap.
    let is_option = |word: &str| word.starts_with('-');
    let first =
        words.iter().skip(1).map(|word| visible::line(&word.to_string_lossy()).into_owned());
    if first.into_iter().find(|word| !is_option(word)).as_ref() != Some(said) {
        return None;
    }
    let command = P::command();
    let names: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
    let program = command.get_name();
    let help = match pddl::nearest(said, names.iter().copied()) {
        Some(near) => format!("did you mean `{program} {near}`?"),
        None => format!("`{program} help` lists the commands"),
    };
    Some(format!("error: there is no command `{program} {said}`; {help}"))
}

/// Parses a positive number of seconds, which may have a fraction.
///
/// # Errors
///
/// Returns a hint for the user if `text` is not a number, is not above 0, or is too large for a
/// [`Duration`].
pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 =
        text.parse().map_err(|_| "a number of seconds, such as 30 or 0.5".to_owned())?;
    match Duration::try_from_secs_f64(seconds) {
        Ok(limit) if !limit.is_zero() => Ok(limit),
        _ => Err("more than 0 seconds, such as 30 or 0.5".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_limit_is_positive() {
        assert!(seconds("0.5").is_ok());
        for bad in ["0", "-1", "nan", "inf", "1e300", "soon"] {
            assert!(seconds(bad).is_err(), "{bad}");
        }
    }
}
