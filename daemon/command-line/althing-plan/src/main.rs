//! `althing-plan`: the command `althing plan` as a program without a daemon.
//!
//! A process that plans once spends most of its time on starting. Therefore this program has only a
//! tenth of the daemon's code, and uses the system's allocator. The daemon's allocator is faster in
//! a process that runs for weeks, but costs more than it saves here.

use std::process::ExitCode;

use althing_plan::arguments::{PlanArgs, help};
use clap::Parser;

// Links the unwinder statically. The shared `libgcc_s`, which is linked otherwise, queries the
// features of the processor whenever a process starts. On a virtual machine each such query is a
// trap, and all of them take a fifteenth of the time of planning for a building.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[expect(unsafe_code, reason = "declares nothing that could be called: it names a library")]
#[link(name = "gcc_eh", kind = "static", modifiers = "-bundle")]
unsafe extern "C" {}

/// Find a plan for a PDDL domain and problem.
#[derive(Debug, Parser)]
#[command(name = "althing-plan", version, max_term_width = 80, after_help = help("althing-plan"))]
struct CommandLine {
    #[command(flatten)]
    plan: PlanArgs,
}

fn main() -> ExitCode {
    match terminal::arguments::parse::<CommandLine>(std::env::args_os()) {
        Ok(CommandLine { plan }) => althing_plan::run(&plan),
        Err(exit) => exit,
    }
}
