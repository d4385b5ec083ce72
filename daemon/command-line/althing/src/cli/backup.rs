//! The arguments of `althing backup` and `althing restore`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use terminal::arguments::PrintArgs;

pub(super) const BACKUP_HELP: &str = "\
In the file are the ecosystem file and the files it names, the people, the keys,
the state of this machine's daemons (goals, plans, ledgers, stops, history) and
the packages of plugins. Daemons may run meanwhile. Whoever has the file has the
keys: only its owner can read it; keep it so. An older file of this name stays
whole until the new one is on disk.

Examples: sudo althing backup /srv/backups/office.tar.gz
          althing backup office.tar.gz --without history,pictures";

pub(super) const RESTORE_HELP: &str = "\
The file is read to its end before anything is changed. What is in the way is
kept beside it as NAME.before-TIME, with --replace; without it, nothing is
changed. Stop the daemon first: sudo systemctl stop althing

Examples: althing restore office.tar.gz --check
          sudo althing restore office.tar.gz --replace
          althing restore office.tar.gz --configuration ~/.config/althing";

/// What `althing backup` can leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(crate) enum LeftOutArg {
    /// What happened, for `althing history` and `why`
    History,
    /// Pictures and videos of cameras
    Pictures,
    /// The packages of plugins
    Plugins,
}

// === impl LeftOutArg ===

impl LeftOutArg {
    /// Returns the word for it on the command line.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            LeftOutArg::History => "history",
            LeftOutArg::Pictures => "pictures",
            LeftOutArg::Plugins => "plugins",
        }
    }
}

/// Arguments of `althing backup`.
#[derive(Debug, Args)]
pub(crate) struct BackupArgs {
    /// The file to write
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The ecosystem: its file, or its name in the configuration folders
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// What to leave out
    #[arg(long, value_enum, value_name = "WHAT,…", value_delimiter = ',')]
    pub(crate) without: Vec<LeftOutArg>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing restore`.
#[derive(Debug, Args)]
pub(crate) struct RestoreArgs {
    /// The file that `althing backup` has written
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Only read the file, and show what is in it
    #[arg(long, conflicts_with_all = ["replace", "configuration"])]
    pub(crate) check: bool,
    /// Replace what is there already, and keep it beside as NAME.before-TIME
    #[arg(long)]
    pub(crate) replace: bool,
    /// Put the ecosystem file, and the files that it names, below this folder [default: where
    /// they were]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) configuration: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}
