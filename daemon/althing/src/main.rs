//! `althing`: one binary per machine. This file is the table of contents of the process.
//!
//! 1. [`cli`] reads the command line, 2. [`commands`] has one function per command, 3. [`exit`]
//!    names what the process ends with.
//!
//! Around them: [`config`] (what the ecosystem file means), [`report`] and [`render`] (how mistakes
//! are gathered and shown), [`output`] (the two streams), [`logging`].

mod cli;
mod commands;
mod config;
mod exit;
mod logging;
mod output;
mod render;
mod report;

use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match cli::parse() {
        Ok(cli) => cli,
        Err(exit) => return exit,
    };
    logging::start(cli.verbose);
    commands::run(cli.command)
}
