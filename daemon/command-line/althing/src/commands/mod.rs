//! The commands of the command line. Each command is a function that takes the parsed arguments and
//! returns an exit code.
//!
//! Commands print their results. No command reads the command line or the environment by itself.

// One module per command.
pub(crate) mod act;
mod add;
pub(crate) mod agents;
pub(crate) mod answer;
mod backup;
mod cert;
mod check;
mod completions;
mod connection_watch;
mod daemon_sockets;
mod doctor;
pub(crate) mod domain;
mod first_screen;
pub(crate) mod goal;
pub(crate) mod goals;
mod history;
mod init;
mod keyboard;
pub(crate) mod mailbox;
mod mode;
mod people;
mod plugin;
mod printed_reports;
mod replay;
mod restore;
mod robot;
mod scenario;
mod send;
mod sensors;
pub(crate) mod set;
mod side_link;
pub(crate) mod state;
pub(crate) mod stop;
mod up;
mod validate;
mod view;
pub(crate) mod watch;
mod why;

// Modules that several commands share.
mod checked_text;
pub(crate) mod client;
mod consent;
pub(crate) mod event_output;
mod event_table;
mod history_text;
mod join_slots;
mod joint;
mod leaders;
mod moments;
mod user_request;
mod value_chart;

use std::future::Future;
use std::process::ExitCode;
use std::time::Duration;

use terminal::{exit, output};

use crate::cli::CliCommand;
use crate::plugins;

pub(crate) use first_screen::print as print_first_screen;
pub(crate) use view::full_screen::leave as leave_screen;

/// Runs a command of the command line, and returns its exit code.
pub(crate) fn run(command: CliCommand) -> ExitCode {
    match command {
        CliCommand::Plan(args) => althing_plan::run(&args),
        CliCommand::Plugin(args) => plugin::run(&args),
        CliCommand::Validate(args) => validate::run(&args),
        CliCommand::Check(args) => check::run(&args, &plugins::known()),
        CliCommand::Init(args) => init::run(&args),
        CliCommand::Add(args) => add::run(&args.command),
        CliCommand::Up(args) => up::run(&args),
        CliCommand::Scenario(args) => scenario::run(&args),
        CliCommand::Joint(args) => joint::run(&args),
        CliCommand::Keyboard(args) => keyboard::run(&args),
        CliCommand::Goal(args) => goal::run(&args),
        CliCommand::Act(args) => act::run(&args),
        CliCommand::Set(args) => set::run(&args),
        CliCommand::Mode(args) => mode::run(&args),
        CliCommand::Answer(args) => answer::run(&args),
        CliCommand::Stop(args) => stop::run(&args),
        CliCommand::Agents(args) => agents::run(&args),
        CliCommand::Domain(args) => domain::run(&args),
        CliCommand::State(args) => state::run(&args),
        CliCommand::Goals(args) => goals::run(&args),
        CliCommand::View(args) => view::run(&args),
        CliCommand::History(args) => history::run(&args),
        CliCommand::Why(args) => why::run(&args),
        CliCommand::Watch(args) => watch::run(&args),
        CliCommand::Replay(args) => replay::run(&args),
        CliCommand::Mailbox(args) => mailbox::run(&args),
        CliCommand::Doctor(args) => doctor::run(&args),
        CliCommand::Cert(args) => cert::run(&args),
        CliCommand::People(args) => people::run(&args),
        CliCommand::Sensors(args) => sensors::run(&args),
        CliCommand::Robot(args) => robot::run(&args),
        CliCommand::Send(args) => send::run(&args),
        CliCommand::Completions(args) => completions::run(&args),
        CliCommand::Backup(args) => backup::run(&args),
        CliCommand::Restore(args) => restore::run(&args),
    }
}

/// Reports a mistake in what the user wrote, and returns the exit code for it.
fn wrong(problem: &str, json: bool) -> ExitCode {
    if json {
        let value = serde_json::json!({ "status": "bad-input", "problem": problem });
        return output::print_json(&value, exit::BAD_INPUT);
    }
    output::print_note(&format!("error: {problem}"));
    exit::with(exit::BAD_INPUT)
}

/// Formats a duration in the largest unit that suits it.
pub(crate) fn brief(duration: Duration) -> String {
    match duration.as_secs() {
        0 => format!("{} ms", duration.as_millis()),
        seconds @ 1..=119 => format!("{seconds} s"),
        seconds @ 120..=7_199 => format!("{} min", seconds / 60),
        seconds => format!("{} h", seconds / 3_600),
    }
}

/// Returns a number of bytes in the unit that suits it, such as `1.5 GiB`.
pub(crate) fn byte_count(bytes: u64) -> String {
    let units = [("GiB", 30), ("MiB", 20), ("KiB", 10)];
    let unit = units.into_iter().find(|(_, shift)| bytes >> shift > 0);
    match unit {
        Some((unit, shift)) => {
            // One decimal is enough, and a float is exact enough for it.
            let count = bytes as f64 / f64::from(1_u32 << shift);
            format!("{count:.1} {unit}")
        }
        None => format!("{bytes} bytes"),
    }
}

/// How long background work may take to stop. A cancelled search takes a moment until it checks its
/// flag.
const SHUTDOWN_GRACE: Duration = Duration::from_millis(200);

/// Runs a future to its end, on a Tokio runtime with two threads. Two threads suit a small board:
/// one for the agents, one for a planner.
///
/// Zenoh does not work on Tokio's single-threaded scheduler.
fn in_runtime(work: impl Future<Output = ExitCode>) -> ExitCode {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    match runtime {
        Ok(runtime) => {
            let code = runtime.block_on(work);
            runtime.shutdown_timeout(SHUTDOWN_GRACE);
            code
        }
        Err(error) => {
            output::print_note(&format!("error: failed to start: {error}"));
            exit::with(exit::UNAVAILABLE)
        }
    }
}
