//! The arguments of `althing plugin`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use plugin_host::Right;
use terminal::arguments::PrintArgs;

use super::{AskArgs, ReachArgs};

pub(super) const HELP: &str = "\
A plugin is a folder with a plugin.toml and a program in any language. When it
is put into the folder of plugins of a running daemon, its agents join at once.
A program that crashes is started again, and given up if it keeps crashing; one
that exceeds its limits is stopped. docs/plugins.md says how to write one.

A plugin has the least rights. If its manifest asks for more, a person allows
them when the plugin is added, or a script with `--allow`. A package that was
copied by hand is not started until they are allowed.

Examples: althing plugin check ./thermometer      starts it once
          althing plugin add ./thermometer
          althing plugin allow thermometer        if it was copied by hand
          althing plugin list
          althing plugin logs thermometer
          althing plugin enable thermometer       after it was given up";

/// Arguments of `althing plugin`.
#[derive(Debug, Args)]
pub(crate) struct PluginArgs {
    /// The command to run.
    #[command(subcommand)]
    pub(crate) command: PluginCommand,
}

/// Subcommands of `althing plugin`.
#[derive(Debug, Subcommand)]
pub(crate) enum PluginCommand {
    /// Show the plugins of a running ecosystem, the state of each, and its reason
    List(AskArgs),
    /// Check a package before it is added: find mistakes, and try to start it
    Check(PluginCheckArgs),
    /// Add a package to this machine's folder of plugins, or replace another version
    Add(PluginAddArgs),
    /// Allow the rights that a plugin asks for
    Allow(PluginAllowArgs),
    /// Remove a plugin
    Remove(PluginNameArgs),
    /// Start a plugin that was disabled or given up
    Enable(PluginNameArgs),
    /// Stop a plugin until it is enabled
    Disable(PluginNameArgs),
    /// Show what a plugin has printed
    Logs(PluginLogsArgs),
}

/// Arguments of `althing plugin check`.
#[derive(Debug, Args)]
pub(crate) struct PluginCheckArgs {
    /// Folders with a plugin.toml
    #[arg(required = true, value_name = "FOLDER")]
    pub(crate) packages: Vec<PathBuf>,
    /// Check the files only, and do not start the program
    #[arg(long)]
    pub(crate) files_only: bool,
    /// The ecosystem that gives the plugin its domain and map [default: ./althing.toml, or this
    /// user's]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    #[command(flatten)]
    pub(crate) rights: PluginRightsArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing plugin add`.
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

/// Arguments of `althing plugin allow`.
#[derive(Debug, Args)]
pub(crate) struct PluginAllowArgs {
    /// The plugin
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) rights: PluginRightsArgs,
    #[command(flatten)]
    pub(crate) place: PluginPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Argument that grants a plugin rights beyond the default ones.
#[derive(Debug, Args)]
pub(crate) struct PluginRightsArgs {
    /// Allow this right without asking: network, devices=PATH, read=PATH, memory=SIZE, cpu=SHARE,
    /// files=N, processes=N, disk=SIZE
    #[arg(long, value_name = "RIGHT", value_delimiter = ',')]
    pub(crate) allow: Vec<Right>,
}

/// Arguments of `althing plugin remove`, `enable` and `disable`.
#[derive(Debug, Args)]
pub(crate) struct PluginNameArgs {
    /// The plugin
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) place: PluginPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing plugin logs`.
#[derive(Debug, Args)]
pub(crate) struct PluginLogsArgs {
    /// The plugin
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// How many of the last lines
    #[arg(long, short = 'n', value_name = "N", default_value_t = 40)]
    pub(crate) lines: usize,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that name the folder of this machine's plugins.
#[derive(Debug, Args)]
pub(crate) struct PluginPlaceArgs {
    /// The ecosystem; its file names the folder of plugins [default: ./althing.toml, or this user's
    /// folder]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// The folder of plugins
    #[arg(long, value_name = "FOLDER", conflicts_with = "ecosystem")]
    pub(crate) folder: Option<PathBuf>,
}
