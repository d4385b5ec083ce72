//! Arguments of `althing view`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use terminal::arguments::{PrintArgs, seconds};
use terminal_view::PageName;

use crate::cli::ReachArgs;

pub(crate) const HELP: &str = "\
Keys: `?` shows those of the page, `:` takes a command, `/` filters, `q` quits.
docs/view.md describes the pages. --once, --json and --picture show a page once,
as the ecosystem is then; of a recording, its end, or the second given by --at.
NAME is an agent, a conversation, or a goal: its number, or a part of it.

Examples: althing view
          althing view goals --once
          althing view agent turtlebot-1 --json
          althing scenario 1 --record s.jsonl; althing view --recording s.jsonl";

/// Arguments of `althing view`.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// The page to begin with
    #[arg(value_name = "PAGE", value_parser = page_parser(), default_value_t = PageName::Overview)]
    pub(crate) page: PageName,
    /// The goal, agent or conversation of the page [default: the newest, or the first]
    #[arg(value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// Print the page as lines of text, without a screen
    #[arg(long, conflicts_with_all = ["json", "picture"])]
    pub(crate) once: bool,
    /// Write the page to this file as a picture (SVG)
    #[arg(long, value_name = "FILE.svg", conflicts_with = "json")]
    pub(crate) picture: Option<PathBuf>,
    /// Show a recording of `althing watch --record` or `althing scenario --record`
    #[arg(long, value_name = "FILE", conflicts_with_all = ["ecosystem", "connect", "key"])]
    pub(crate) recording: Option<PathBuf>,
    /// The second of the recording to show, or to begin with
    #[arg(long, value_name = "S", value_parser = seconds, requires = "recording")]
    pub(crate) at: Option<Duration>,
    #[command(flatten)]
    pub(crate) reach: ReachArgs,
    #[command(flatten)]
    pub(crate) print: PrintArgs,
}

/// Returns the parser of the name of a page.
fn page_parser() -> impl TypedValueParser<Value = PageName> {
    let pages = PageName::all().map(|page| {
        let value = PossibleValue::new(page.name()).help(page.shows());
        if page.short_name() == page.name() { value } else { value.alias(page.short_name()) }
    });
    PossibleValuesParser::new(pages)
        .map(|name| name.parse().expect("invariant: all possible values are names of pages"))
}
