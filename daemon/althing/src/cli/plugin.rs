//! The arguments of `althing plugin`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use plugin_host::Right;
use terminal::arguments::PrintArgs;

use super::{AskArgs, ReachArgs};

pub(super) const HELP: &str = "\
A plugin is a folder with a plugin.toml and a program in any language. Put into
the folder of plugins while the daemon runs, its agents take part at once; what
crashes is started again, and given up in the end; what takes too much is
stopped. docs/plugins.md says how to write one.

A plugin has the least rights; what its manifest asks for beyond them a person
allows when it is added, or a script by `--allow`. A package that was copied by
hand waits for it.

Examples: althing plugin check ./thermometer      starts it once
          althing plugin add ./thermometer
          althing plugin allow thermometer        where it was copied by hand
          althing plugin list
          althing plugin logs thermometer
          althing plugin enable thermometer       begins anew what was given up";

/// `althing plugin`
#[derive(Debug, Args)]
pub(crate) struct PluginArgs {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: PluginCommand,
}

/// What can be done with plugins.
#[derive(Debug, Subcommand)]
pub(crate) enum PluginCommand {
    /// Show the plugins of a running ecosystem, how they are, and why
    List(AskArgs),
    /// Show what is wrong with a package before it is added, and try whether it starts
    Check(PluginCheckArgs),
    /// Put a package into this machine's folder of plugins, or a newer one in its place
    Add(PluginAddArgs),
    /// Allow a plugin what it asks for beyond the least
    Allow(PluginAllowArgs),
    /// Take a plugin away
    Remove(PluginNameArgs),
    /// Take a plugin into use again; begins anew what was given up
    Enable(PluginNameArgs),
    /// Take a plugin out of use
    Disable(PluginNameArgs),
    /// Show what a plugin has printed
    Logs(PluginLogsArgs),
}

/// `althing plugin check`
#[derive(Debug, Args)]
pub(crate) struct PluginCheckArgs {
    /// Folders with a plugin.toml
    #[arg(required = true, value_name = "FOLDER")]
    pub(crate) packages: Vec<PathBuf>,
    /// Look at the files only, and start nothing
    #[arg(long)]
    pub(crate) files_only: bool,
    /// The ecosystem whose words and map it is told [default: ./althing.toml, or this user's]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    #[command(flatten)]
    pub(crate) rights: PluginRightsArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// `althing plugin add`
#[derive(Debug, Args)]
pub(crate) struct PluginAddArgs {
    /// A folder with a plugin.toml
    #[arg(value_name = "FOLDER")]
    pub(crate) package: PathBuf,
    #[command(flatten)]
    pub(crate) rights: PluginRightsArgs,
    #[command(flatten)]
    pub(crate) place: PluginPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// `althing plugin allow`
#[derive(Debug, Args)]
pub(crate) struct PluginAllowArgs {
    /// Which
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) rights: PluginRightsArgs,
    #[command(flatten)]
    pub(crate) place: PluginPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// What a plugin is allowed beyond the least.
#[derive(Debug, Args)]
pub(crate) struct PluginRightsArgs {
    /// Allow this, and ask nobody: network, devices=PATH, read=PATH, memory=SIZE, cpu=SHARE, files=N,
    /// processes=N, disk=SIZE
    #[arg(long, value_name = "RIGHT", value_delimiter = ',')]
    pub(crate) allow: Vec<Right>,
}

/// `althing plugin remove`, `enable` and `disable`
#[derive(Debug, Args)]
pub(crate) struct PluginNameArgs {
    /// Which
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) place: PluginPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// `althing plugin logs`
#[derive(Debug, Args)]
pub(crate) struct PluginLogsArgs {
    /// Which
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// How many lines, the last ones
    #[arg(long, short = 'n', value_name = "N", default_value_t = 40)]
    pub(crate) lines: usize,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Where a machine's plugins are.
#[derive(Debug, Args)]
pub(crate) struct PluginPlaceArgs {
    /// The ecosystem whose file says where [default: ./althing.toml, or this user's folder]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// The folder itself
    #[arg(long, value_name = "FOLDER", conflicts_with = "ecosystem")]
    pub(crate) folder: Option<PathBuf>,
}
