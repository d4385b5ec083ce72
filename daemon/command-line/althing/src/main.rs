//! `althing`: one program per machine. This file lists the parts of the program.
//!
//! 1. [`cli`] parses the command line.
//! 2. [`commands`] has one function per command.
//! 3. [`terminal::exit`] names the exit codes.
//!
//! The other parts are [`prompt`] (the interactive prompt), [`hosting`] (one daemon and its
//! agents), [`plugins`] (the table of built-in plugins), [`scenario`] (the paper's demonstrations),
//! [`config`] (reading the ecosystem file), [`review`] (checks beyond the form of that file),
//! [`interfacing`] (interfaces to other ecosystems), [`ecosystem_view`] (queries to an ecosystem), [`speech`] (goals in words),
//! [`observing`] (what is shown of it), [`asking`] (what people ask of it), `web` (the page for browsers), [`logging`], [`service_manager`]
//! (notifications to systemd), and [`interruption`] (signals and closed pipes). The crate
//! [`terminal`] reads files and displays mistakes and results; `althing plan` is in
//! [`althing_plan`].

mod asking;
mod cli;
mod commands;
mod config;
mod ecosystem_view;
mod hosting;
mod interfacing;
mod interruption;
mod logging;
mod observing;
mod plugins;
mod prompt;
mod review;
mod scenario;
mod service_manager;
mod speech;
#[cfg(feature = "web")]
mod web;

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    if let Some(exit) = hosting::become_plugin() {
        return exit;
    }
    if std::env::args_os().len() <= 1 {
        return commands::print_first_screen();
    }
    let cli = match cli::parse() {
        Ok(cli) => cli,
        Err(exit) => return exit,
    };
    logging::start(cli.verbose);
    speech::choose(cli.language, cli.pddl);
    install_panic_hook();
    commands::run(cli.command)
}

/// Installs a panic hook that escapes control characters. A panic message may contain text from
/// outside, and a terminal would execute the control characters in it. If a screen is shown, the
/// hook leaves it first, so that the message can be read and the terminal can be used.
fn install_panic_hook() {
    std::panic::set_hook(Box::new(|panic| {
        commands::leave_screen();
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("unnamed").to_owned();
        terminal::output::print_note(&format!("thread '{name}' panicked: {panic}"));
        let trace = std::backtrace::Backtrace::capture();
        if trace.status() == std::backtrace::BacktraceStatus::Captured {
            terminal::output::print_note(&trace.to_string());
        }
        hosting::note_panic(&name);
    }));
}
