//! `althing completions`: prints scripts that let a shell complete the command line.

use std::process::ExitCode;

use clap::CommandFactory as _;
use clap_complete::{Shell, generate};
use terminal::{exit, output};

use crate::cli::{Cli, CompletionsArgs, ShellArg};

/// Prints the completion script for the shell that the user names.
pub(super) fn run(args: &CompletionsArgs) -> ExitCode {
    let shell = match args.shell {
        ShellArg::Bash => Shell::Bash,
        ShellArg::Zsh => Shell::Zsh,
        ShellArg::Fish => Shell::Fish,
    };
    let mut script = Vec::new();
    generate(shell, &mut Cli::command(), "althing", &mut script);
    output::print_raw(&String::from_utf8_lossy(&script), exit::DONE)
}
