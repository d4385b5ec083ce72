//! Translates a task to the engine's dialect: a smaller language with other names, in which the
//! task has the same plans.
//!
//! Each pass removes something that an engine cannot read:
//!
//! 1. `refuse`: refuses features that no pass can remove, with their name and place;
//! 2. `agents`: makes the acting agent the first parameter of an action, and removes privacy
//!    (MA-PDDL);
//! 3. `costs` (Fast Downward): removes numbers, except for one whole, non-negative cost of each
//!    action; `numbers` (Metric-FF): converts arithmetic to the form that Metric-FF supports, and
//!    merges the changes of one fluent;
//! 4. `types`: removes `either` and multiple supertypes;
//! 5. `names`: renames everything to `a-move`, `o-office1`, …, and keeps a table to translate plans
//!    back;
//! 6. `size_limits` (Metric-FF): checks the sizes that Metric-FF is compiled for.
//!
//! Names that passes introduce contain a `'`, which cannot occur in the names of a task. The pass
//! `names` removes this character.

mod agents;
mod costs;
mod names;
mod numbers;
mod refuse;
mod size_limits;
mod task_parts;
mod types;

use pddl::{Domain, Name, Problem};
use planner::Unsupported;

pub(crate) use names::EngineNames;

/// The dialect of PDDL that an engine reads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dialect {
    /// Requirements that are declared for every task. An engine rejects requirement flags that it
    /// does not support, but accepts flags that the task does not need.
    requirements: &'static [&'static str],
    /// Whether the engine supports numeric fluents, and not only action costs.
    has_numbers: bool,
    /// Whether the engine supports derived predicates.
    has_axioms: bool,
    /// Whether the engine has limits on the size of a task.
    has_caps: bool,
}

/// A task in an engine's dialect.
#[derive(Debug)]
pub(crate) struct Lowered {
    pub(crate) domain: String,
    pub(crate) problem: String,
    /// Names of the task in the dialect, which translate a plan back to the task's own names.
    pub(crate) names: EngineNames,
    pub(crate) has_metric: bool,
    /// Whether the costs of plans compare exactly as in the original task: no cost was rounded.
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

/// Translates a task to a dialect. Returns an error if a part of the task has no translation.
///
/// The domain and the problem must have passed `check`.
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
        size_limits::refuse(&domain, &problem)?;
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

/// Returns the text of a problem. The printer omits an empty `:init`, but engines require it, so it
/// is added here.
fn with_init(problem: &Problem) -> String {
    let text = problem.to_string();
    if problem.init.is_empty() { text.replacen("(:goal", "(:init)\n  (:goal", 1) } else { text }
}

#[cfg(test)]
mod tests;
