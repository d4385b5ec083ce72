//! Command line arguments for planning, and their parsing.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use terminal::arguments::{PrintArgs, seconds};

const HELP: &str = "\
The plan goes to stdout in the format of the planning competitions, a summary
to stderr.

Exit codes: 0 plan found, 10 proven unsolvable before search, 11 proven
unsolvable, 12 search ended without plan or proof, 22 out of memory, 23 out of
time, 32 an engine broke down, 33 bad input, 34 unsupported feature, 69 the
engine is not installed, 74 the plan could not be written. With --optimal, a
plan that is not proven to be the cheapest: 1 out of memory, 2 out of time,
4 its costs allow no proof

Other engines are programs of their own. Fast Downward is found on PATH or,
after `pip install up-fast-downward`, in a Python on PATH; Metric-FF on PATH.
The variables ALTHING_FAST_DOWNWARD and ALTHING_METRIC_FF name another program.
The memory limit applies to each of their processes.";

/// Returns the help text that is printed below the options. `name` is the command that the examples
/// in this text use.
pub fn help(name: &str) -> String {
    format!(
        "{HELP}\n\n\
         Examples: {name} domain.pddl problem.pddl --plan plan.txt --time-limit 10\n          \
         {name} domain.pddl problem.pddl --engine fast-downward"
    )
}

/// Arguments of planning: a domain, a problem, and options.
#[derive(Clone, Debug, Args)]
pub struct PlanArgs {
    /// The PDDL domain, or a folder with `domain-AGENT.pddl` and `problem-AGENT.pddl` of
    /// each agent
    #[arg(value_name = "DOMAIN", required_unless_present = "list")]
    pub domain: Option<PathBuf>,
    /// The PDDL problem
    #[arg(value_name = "PROBLEM")]
    pub problem: Option<PathBuf>,
    /// Write the plan to this file instead of stdout; with --anytime, each better one
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
    /// Stop after this many seconds, reading included
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub time_limit: Option<Duration>,
    /// Stop before the planner's tables take more than this [default: 2048, or half of
    /// what is available]
    #[arg(long, value_name = "MIB", value_parser = mebibytes)]
    pub memory_limit: Option<u32>,
    /// The number of search threads, 1 or 2; the same number finds the same plan
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = clap::value_parser!(u16).range(1..)
    )]
    pub threads: u16,
    /// The planner
    #[arg(long, value_enum, default_value_t = EngineChoice::Embedded)]
    pub engine: EngineChoice,
    /// The search configuration for the first plan; --list shows all
    #[arg(long, value_name = "NAME", default_value = planner::CONFIGURATIONS[0].name, value_parser = search())]
    pub search: String,
    /// List the heuristics and search configurations, with their guarantees
    #[arg(long)]
    pub list: bool,
    /// After the first plan, search for cheaper ones until a limit
    #[arg(long)]
    pub anytime: bool,
    /// Search until a plan is proven to be the cheapest, or until a limit
    #[arg(long)]
    pub optimal: bool,
    /// The form in which the outcome is printed.
    #[command(flatten)]
    pub print: PrintArgs,
}

/// Parses a limit on memory, in MiB.
fn mebibytes(text: &str) -> Result<u32, String> {
    let limit = text.parse().ok().filter(|limit| *limit > 0);
    limit.ok_or_else(|| "a whole number of MiB, 1 or more, such as 512".to_owned())
}

/// Returns a parser that accepts the names of the planner's search configurations.
fn search() -> clap::builder::PossibleValuesParser {
    planner::CONFIGURATIONS.iter().map(|one| one.name).collect::<Vec<_>>().into()
}

/// The planner that `--engine` selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EngineChoice {
    /// Althing's own
    Embedded,
    /// Fast Downward, as a program of its own
    FastDownward,
    /// Metric-FF, as a program of its own
    MetricFf,
}

// === impl EngineChoice ===

impl EngineChoice {
    /// Returns the name of the planner, as the user writes it after `--engine`.
    pub fn name(self) -> &'static str {
        match self {
            EngineChoice::Embedded => "embedded",
            EngineChoice::FastDownward => "fast-downward",
            EngineChoice::MetricFf => "metric-ff",
        }
    }
}
