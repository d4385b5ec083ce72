//! `althing-plan`: what `althing plan` does, in a program without a daemon.
//!
//! Of the time that a building's plan takes as a whole process, the start of the process is most;
//! this one has a tenth of the daemon's code, and the system's allocator: another one pays when a
//! daemon plans for weeks, and costs more than it saves where a process plans once.

use std::process::ExitCode;

use althing_plan::arguments::{PlanArgs, help};
use clap::Parser;

// The unwinder of the program's own. The shared `libgcc_s`, else linked, asks the processor what it
// can do whenever a process starts: on a virtual machine each such question is a trap, and all of them
// a fifteenth of what a building's plan takes.
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
