//! `althing`: one program per machine. This file lists the parts of the program.
//!
//! 1. [`cli`] parses the command line.
//! 2. [`commands`] has one function per command.
//! 3. [`terminal::exit`] names the exit codes.
//!
//! The other parts are [`prompt`] (the interactive prompt), [`hosting`] (one daemon and its
//! agents), [`plugins`] (the table of built-in plugins), [`scenario`] (the paper's demonstrations),
//! [`config`] (reading the ecosystem file), [`review`] (checks beyond the form of that file),
//! [`interfacing`] (interfaces to other ecosystems), [`logging`], [`service_manager`]
//! (notifications to systemd), and [`interruption`] (signals and closed pipes). The crate
//! [`terminal`] reads files and displays mistakes and results; `althing plan` is in
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
    install_panic_hook();
    commands::run(cli.command)
}

/// Installs a panic hook that escapes control characters. A panic message may contain text from
/// outside, and a terminal would execute the control characters in it.
fn install_panic_hook() {
    std::panic::set_hook(Box::new(|panic| {
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
