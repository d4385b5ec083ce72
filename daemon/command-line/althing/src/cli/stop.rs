//! Arguments of `althing stop`.

use clap::Args;
use terminal::arguments::PrintArgs;

use crate::cli::ReachArgs;

pub(crate) const HELP: &str = "\
Every actuator ends what it does and begins nothing more, also after a restart,
until this stop is released. A place stops what is there, and what names it.
An actuator that cannot be reached learns of the stop when it can be.
Exit codes: 0 all have stopped, 1 some have not (the table says which)

  althing stop                              everything
  althing stop office1 turtlebot-1          a room and a robot
  althing stop --list
  althing stop --release                    all that are in force now";

/// Arguments of `althing stop`.
#[derive(Debug, Args)]
pub(crate) struct StopArgs {
    /// Agents and places to stop; everything if none is named. With --release: the stops to end
    #[arg(conflicts_with = "list")]
    pub(crate) names: Vec<String>,
    /// End these stops; without names, all stops that are in force now
    #[arg(long)]
    pub(crate) release: bool,
    /// List the stops in force
    #[arg(long, conflicts_with = "release")]
    pub(crate) list: bool,
    /// The reason, shown in every refusal
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["release", "list"])]
    pub(crate) because: Option<String>,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}
