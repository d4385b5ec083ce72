//! The external engines: their names, their programs, and how to install them.

use std::fmt;

/// A planner that runs as a process of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExternalEngine {
    /// Fast Downward. It supports all of ADL, axioms and action costs, but no other numbers.
    FastDownward,
    /// Metric-FF. It supports all of ADL and linear arithmetic, but no axioms.
    MetricFf,
}

impl ExternalEngine {
    /// Returns the name of the environment variable with the path of the engine's program.
    pub fn variable(self) -> &'static str {
        match self {
            ExternalEngine::FastDownward => "ALTHING_FAST_DOWNWARD",
            ExternalEngine::MetricFf => "ALTHING_METRIC_FF",
        }
    }

    /// Returns the file names under which the engine's program is searched for on `PATH`.
    pub(crate) fn programs(self) -> &'static [&'static str] {
        match self {
            ExternalEngine::FastDownward => &["fast-downward.py", "fast-downward"],
            ExternalEngine::MetricFf => &["metric-ff", "ff"],
        }
    }

    /// Returns advice for installing the engine.
    pub(crate) fn how_to_get(self) -> &'static str {
        match self {
            ExternalEngine::FastDownward => {
                "`pip install up-fast-downward` is enough; or put `fast-downward.py` on PATH, or \
                 name it in ALTHING_FAST_DOWNWARD"
            }
            ExternalEngine::MetricFf => {
                "build version 2.1 from its author's page and put `metric-ff` or `ff` on PATH, or \
                 name it in ALTHING_METRIC_FF"
            }
        }
    }
}

impl fmt::Display for ExternalEngine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ExternalEngine::FastDownward => "Fast Downward",
            ExternalEngine::MetricFf => "Metric-FF",
        })
    }
}
