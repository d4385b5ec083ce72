//! From a task to the engine's dialect of it: a smaller language, other names, the same plans.
//!
//! Each pass takes something out of the trees that an engine cannot read:
//!
//! 1. `refuse`: what no pass can take out, by name and place;
//! 2. `agents`: who acts becomes a first parameter, and privacy is gone (MA-PDDL);
//! 3. `costs` (Fast Downward): numbers, but for one whole, positive cost for each action;
//!    `numbers` (Metric-FF): what it reads of arithmetic, one change a fluent;
//! 4. `types`: `either`, several supertypes;
//! 5. `names`: every name becomes `a-move`, `o-office1`, … and can be taken back;
//! 6. `caps` (Metric-FF): the sizes it was compiled for.
//!
//! Names that passes invent hold a `'`, which no author's name can, until `names` takes it out.

mod agents;
mod caps;
mod costs;
mod names;
mod numbers;
mod refuse;
mod types;
mod walk;

use pddl::{Domain, Name, Problem};
use planner::Unsupported;

pub(crate) use names::Names;

/// What an engine reads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dialect {
    /// What it wants to be told that the task needs. Engines refuse flags they do not know, and
    /// none of them wants fewer than it knows.
    requirements: &'static [&'static str],
    /// Whether it knows numbers, besides costs.
    has_numbers: bool,
    /// Whether it knows derived predicates.
    has_axioms: bool,
    /// Whether there are sizes that it cannot exceed.
    has_caps: bool,
}

/// A task in an engine's dialect.
#[derive(Debug)]
pub(crate) struct Lowered {
    pub(crate) domain: String,
    pub(crate) problem: String,
    /// The way back.
    pub(crate) names: Names,
    pub(crate) has_metric: bool,
    /// Whether costs compare as they did: they were not rounded.
    pub(crate) costs_exact: bool,
}

impl Dialect {
    pub(crate) const FAST_DOWNWARD: Dialect = Dialect {
        requirements: &[":adl", ":derived-predicates", ":action-costs"],
        has_numbers: false,
        has_axioms: true,
        has_caps: false,
    };
    pub(crate) const METRIC_FF: Dialect = Dialect {
        requirements: &[":adl", ":fluents"],
        has_numbers: true,
        has_axioms: false,
        has_caps: true,
    };
}

/// Says a task in a dialect, or says what of it cannot be said there.
///
/// The texts must have passed `check`.
pub(crate) fn lower(
    domain: &Domain,
    problem: &Problem,
    dialect: Dialect,
) -> Result<Lowered, Unsupported> {
    refuse::refuse(domain, problem, dialect)?;
    let (mut domain, mut problem) = (domain.clone(), problem.clone());
    agents::lower(&mut domain, &mut problem);
    let costs_exact = if dialect.has_numbers {
        numbers::lower(&mut domain, &mut problem)?;
        true
    } else {
        costs::lower(&mut domain, &mut problem)?
    };
    types::lower(&mut domain, &mut problem);
    let names = names::lower(&mut domain, &mut problem);
    if dialect.has_caps {
        caps::refuse(&domain, &problem)?;
    }
    domain.requirements = dialect.requirements.iter().map(|flag| Name::new(flag)).collect();
    Ok(Lowered {
        domain: domain.to_string(),
        problem: with_init(&problem),
        names,
        has_metric: problem.metric.is_some(),
        costs_exact,
    })
}

/// The text; with an empty `:init`, which the printer leaves out and engines insist on.
fn with_init(problem: &Problem) -> String {
    let text = problem.to_string();
    if problem.init.is_empty() { text.replacen("(:goal", "(:init)\n  (:goal", 1) } else { text }
}

#[cfg(test)]
mod tests;
