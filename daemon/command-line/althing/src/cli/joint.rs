//! The arguments of `althing joint`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use terminal::arguments::{PrintArgs, seconds};

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
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}
