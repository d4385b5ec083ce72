//! `althing`: one binary per machine. This file is the table of contents of the process.
//!
//! 1. [`cli`] reads the command line, 2. [`commands`] has one function per command, 3.
//!    [`terminal::exit`] names what the process ends with.
//!
//! Around them: [`prompt`] (a person at a terminal), [`hosting`] (one daemon and its agents), [`plugins`] (the table of them), [`scenario`]
//! (the paper's demonstrations), [`config`] (what the ecosystem file means), [`review`] (what is wrong
//! with it beyond its shape), [`logging`],
//! [`service_manager`] (what systemd is told), [`interruption`] (what it, or Ctrl-C, tells us). How
//! files are read, and mistakes and results shown, is the crate [`terminal`]'s; `althing plan` is
//! [`althing_plan`].

mod cli;
mod commands;
mod config;
mod hosting;
mod interfacing;
mod interruption;
mod logging;
mod plugins;
mod prompt;
mod review;
mod scenario;
mod service_manager;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    if let Some(exit) = hosting::become_plugin() {
        return exit;
    }
    let cli = match cli::parse() {
        Ok(cli) => cli,
        Err(exit) => return exit,
    };
    logging::start(cli.verbose);
    tell_panics_safely();
    commands::run(cli.command)
}

/// A panic may hold what others said, and a terminal obeys what it is sent.
fn tell_panics_safely() {
    std::panic::set_hook(Box::new(|panic| {
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("unnamed").to_owned();
        terminal::output::note(&format!("thread '{name}' panicked: {panic}"));
        let trace = std::backtrace::Backtrace::capture();
        if trace.status() == std::backtrace::BacktraceStatus::Captured {
            terminal::output::note(&trace.to_string());
        }
    }));
}
