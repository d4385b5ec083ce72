//! Arguments of `althing robot`.

use std::path::PathBuf;

use clap::Args;

pub(crate) const HELP: &str = "\
Drive the robot to a place, by hand or with RViz, and run this there. It prints
a line for the table [agent.config.ros2.places] of the ecosystem file.

Example: althing robot turtlebot-1 office1 --ecosystem office.toml";

/// Arguments of `althing robot`.
#[derive(Debug, Args)]
pub(crate) struct RobotArgs {
    /// The robot: an agent of the ecosystem file with `driver = "ros2"`
    pub(crate) agent: String,
    /// The place where it stands
    pub(crate) place: String,
    /// The ecosystem file [default: the one in this folder]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<PathBuf>,
}
