//! `althing-plan`: what `althing plan` does, in a program without a daemon.
//!
//! Of the time that a building's plan takes as a whole process, the start of the process is most;
//! this one has a tenth of the daemon's code, and the system's allocator: another one pays when a
//! daemon plans for weeks, and costs more than it saves where a process plans once.

use std::process::ExitCode;

use althing_plan::arguments::{PlanArgs, help};
use clap::Parser;

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
