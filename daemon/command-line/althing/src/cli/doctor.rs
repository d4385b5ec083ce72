//! The arguments of `althing doctor`.

use clap::Args;
use terminal::arguments::PrintArgs;

use crate::cli::ReachArgs;

pub(crate) const HELP: &str = "\
Checks this machine, then the ecosystem file, then the running ecosystem, as far
as there are any. `mend` is the command that mends a problem, `look` one that
shows more of it. docs/doctor.md lists all checks.

Exit codes: 0 no problem (notes are none), 1 at least one

Examples: althing doctor
          althing doctor office.toml --daemon office-pi
          althing doctor --json";

/// Arguments of `althing doctor`.
#[derive(Clone, Debug, Args)]
pub(crate) struct DoctorArgs {
    /// The ecosystem: its file, or its name [default: ./althing.toml, then the only one that runs
    /// here]
    #[arg(value_name = "ECOSYSTEM.toml", conflicts_with = "ecosystem")]
    pub(crate) file: Option<String>,
    /// The daemon of the file that this machine runs [default: the host name]
    #[arg(long, value_name = "NAME")]
    pub(crate) daemon: Option<String>,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}
