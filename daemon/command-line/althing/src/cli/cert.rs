//! The arguments of `althing cert`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use terminal::arguments::PrintArgs;

pub(super) const HELP: &str = "\
A [security] table in the ecosystem file secures the ecosystem: links between
machines are mutual TLS, and the sender's daemon signs every message. The
authority's key stays on the machine where it was made; a daemon needs three
files of the folder: authority.pem, NAME.pem and NAME.key.

`daemon`, `show` and `revoke` use ./althing.toml unless --ecosystem names
another file.

Examples: althing cert authority althing.toml
          althing cert daemon office-pi --host 192.168.1.7
          althing cert page office-pi --host 192.168.1.7
          althing cert show
          althing cert revoke office-pi";

/// Arguments of `althing cert`.
#[derive(Debug, Args)]
pub(crate) struct CertArgs {
    /// The command to run.
    #[command(subcommand)]
    pub(crate) command: CertCommand,
}

/// Subcommands of `althing cert`.
#[derive(Debug, Subcommand)]
pub(crate) enum CertCommand {
    /// Make the authority of an ecosystem, which signs the certificates of its daemons
    Authority(CertAuthorityArgs),
    /// Make keys and certificates for daemons, and for people's machines without one
    Daemon(CertDaemonArgs),
    /// Make certificates for pages that browsers open, and the authority that phones trust for them
    Page(CertPageArgs),
    /// Show the certificates, and how long each is valid
    Show(CertShowArgs),
    /// Revoke all certificates of a daemon; running daemons learn of it within seconds
    Revoke(CertRevokeArgs),
}

/// Arguments of `althing cert authority`.
#[derive(Debug, Args)]
pub(crate) struct CertAuthorityArgs {
    /// The ecosystem: its file, or its name [default: ./althing.toml]
    #[arg(value_name = "ECOSYSTEM|FILE")]
    pub(crate) ecosystem: Option<String>,
    /// How long the authority is valid
    #[arg(long, value_name = "DAYS", default_value_t = credentials::AUTHORITY_DAYS, value_parser = days())]
    pub(crate) days: u32,
    /// The folder of the keys [default: the one that the ecosystem file names, or keys/NAME in the
    /// configuration folder]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) folder: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing cert daemon`.
#[derive(Debug, Args)]
pub(crate) struct CertDaemonArgs {
    /// Daemons, by their names in the ecosystem's file
    #[arg(required = true, value_name = "NAME")]
    pub(crate) names: Vec<String>,
    /// An address of the machine besides NAME and NAME.local: a host name or an IP address;
    /// repeatable
    #[arg(long = "host", value_name = "HOST")]
    pub(crate) hosts: Vec<String>,
    /// How long the certificates are valid
    #[arg(long, value_name = "DAYS", default_value_t = credentials::DAEMON_DAYS, value_parser = days())]
    pub(crate) days: u32,
    #[command(flatten)]
    pub(crate) place: CertPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing cert page`.
#[derive(Debug, Args)]
pub(crate) struct CertPageArgs {
    /// Daemons that serve a page, by their names in the ecosystem's file
    #[arg(required = true, value_name = "NAME")]
    pub(crate) names: Vec<String>,
    /// An address at which browsers reach the page besides NAME and NAME.local: a host name or an IP
    /// address; repeatable
    #[arg(long = "host", value_name = "HOST")]
    pub(crate) hosts: Vec<String>,
    /// How long the certificates are valid
    #[arg(long, value_name = "DAYS", default_value_t = credentials::PAGE_DAYS, value_parser = days())]
    pub(crate) days: u32,
    #[command(flatten)]
    pub(crate) place: CertPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing cert show`.
#[derive(Debug, Args)]
pub(crate) struct CertShowArgs {
    #[command(flatten)]
    pub(crate) place: CertPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments of `althing cert revoke`.
#[derive(Debug, Args)]
pub(crate) struct CertRevokeArgs {
    /// The daemon to revoke
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    #[command(flatten)]
    pub(crate) place: CertPlaceArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Arguments that name the folder of certificates.
#[derive(Debug, Args)]
pub(crate) struct CertPlaceArgs {
    /// The ecosystem: its file, or its name [default: ./althing.toml]
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) ecosystem: Option<String>,
    /// The folder of the keys [default: the one that the ecosystem file names, or keys/NAME in the
    /// configuration folder]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) folder: Option<PathBuf>,
}

/// Parses a number of days, at most a hundred years: certificates cannot hold later dates.
fn days() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=36_500)
}
