//! The arguments of `althing joint`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use terminal::arguments::{PrintArgs, seconds};

/// Maximum number of plannings with the same daemons.
const RUNS_MAX: i64 = 100_000;

/// Arguments of `althing joint`.
#[derive(Debug, Args)]
pub(crate) struct JointArgs {
    /// A folder with the files domain-AGENT.pddl and problem-AGENT.pddl of each agent
    #[arg(value_name = "FOLDER")]
    pub(crate) folder: PathBuf,
    /// Write the plan of all agents to this file
    #[arg(long, value_name = "FILE")]
    pub(crate) plan: Option<PathBuf>,
    /// Give up after this time; the start of the daemons is not counted
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "30")]
    pub(crate) time_limit: Duration,
    /// Plan this many times with the same daemons, which keep their sharper projections, and show the times
    #[arg(long, value_name = "NUMBER", default_value_t = 1,
        value_parser = clap::value_parser!(u32).range(1..=RUNS_MAX))]
    pub(crate) runs: u32,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}
