//! One function per command: from arguments to an exit code.
//!
//! Each prints what it has to say; none reads the command line or the environment itself.

mod plan;

mod validate;

mod check;

use std::process::ExitCode;

use crate::cli::Command;
use crate::{exit, output};

/// The plugins of this house, until they are linked in and say so themselves.
const KNOWN_PLUGINS: &[crate::config::KnownPlugin] = &[
    ("domain-maintainer", &[]),
    ("ir-temperature-sensor", &["simulated"]),
    ("keyboard", &[]),
    ("plan-executor", &[]),
    ("plan-requester", &[]),
    ("planning-agent", &[]),
    ("temperature-sensor", &["simulated"]),
    ("turtlebot", &["simulated"]),
];

/// Does what was asked.
pub(crate) fn run(command: Command) -> ExitCode {
    match command {
        Command::Plan(args) => plan::run(&args),
        Command::Validate(args) => validate::run(&args),
        Command::Check(args) => check::run(&args, KNOWN_PLUGINS),
        Command::Up(_) => not_built_yet("up"),
        Command::Scenario(_) => not_built_yet("scenario"),
        Command::Goal(_) => not_built_yet("goal"),
        Command::Agents(_) => not_built_yet("agents"),
        Command::Domain(_) => not_built_yet("domain"),
        Command::State(_) => not_built_yet("state"),
        Command::Watch(_) => not_built_yet("watch"),
    }
}

/// A command of the contract that this version does not have.
fn not_built_yet(command: &str) -> ExitCode {
    output::note(&format!("error: `althing {command}` is not built yet"));
    exit::with(exit::UNAVAILABLE)
}
