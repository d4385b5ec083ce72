//! One function per command: from arguments to an exit code.
//!
//! Each prints what it has to say; none reads the command line or the environment itself.

mod plan;

mod validate;

mod check;

mod up;

mod scenario;

mod client;

mod goal;

mod agents;

mod domain;

mod state;

mod watch;

use std::future::Future;
use std::process::ExitCode;

use tokio::signal::unix::{SignalKind, signal};

use crate::cli::Command;
use crate::{exit, output, plugins};

/// What `althing up` says when its agents are here; whoever started it waits for the line.
pub(crate) const READY: &str = "is ready";

/// Does what was asked.
pub(crate) fn run(command: Command) -> ExitCode {
    match command {
        Command::Plan(args) => plan::run(&args),
        Command::Validate(args) => validate::run(&args),
        Command::Check(args) => check::run(&args, &plugins::known()),
        Command::Up(args) => up::run(&args),
        Command::Scenario(args) => scenario::run(&args),
        Command::Goal(args) => goal::run(&args),
        Command::Agents(args) => agents::run(&args),
        Command::Domain(args) => domain::run(&args),
        Command::State(args) => state::run(&args),
        Command::Watch(args) => watch::run(&args),
    }
}

/// A command of the contract that this version does not have.
fn not_built_yet(command: &str) -> ExitCode {
    output::note(&format!("error: `althing {command}` is not built yet"));
    exit::with(exit::UNAVAILABLE)
}

/// Waits until the process is told to stop: SIGINT or SIGTERM, which it yields. Where signals
/// cannot be listened to, they end the process as they always do.
async fn interrupted() -> SignalKind {
    let (interrupt, terminate) = (SignalKind::interrupt(), SignalKind::terminate());
    let (Ok(mut interrupts), Ok(mut terminations)) = (signal(interrupt), signal(terminate)) else {
        return std::future::pending().await;
    };
    tokio::select! {
        _ = interrupts.recv() => interrupt,
        _ = terminations.recv() => terminate,
    }
}

/// Runs what waits. Two threads: one for the agents of a small board, one for a planner.
///
/// Zenoh cannot live on Tokio's single-threaded scheduler.
fn in_runtime(work: impl Future<Output = ExitCode>) -> ExitCode {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
    match runtime {
        Ok(runtime) => {
            let code = runtime.block_on(work);
            // A search that was cancelled may still be looking at its flag.
            runtime.shutdown_timeout(std::time::Duration::from_millis(200));
            code
        }
        Err(error) => {
            output::note(&format!("error: failed to start: {error}"));
            exit::with(exit::UNAVAILABLE)
        }
    }
}
