//! Rejects tasks with features that no pass can remove, before an engine is started. The error has
//! the name and the place of the feature.

use pddl::{Condition, Domain, Expression, Problem, Span};
use planner::{InputText, Unsupported};

use super::{Dialect, task_parts};

/// Returns the error that `feature` is not supported. The feature is used at `span` in `text`,
/// which is the domain or the problem.
pub(super) fn unsupported(feature: impl Into<String>, span: Span, text: InputText) -> Unsupported {
    Unsupported { feature: feature.into(), span, text }
}

/// Returns an error if the task uses time, which neither engine supports, or a feature that the
/// dialect of the engine lacks.
pub(super) fn refuse(
    domain: &Domain,
    problem: &Problem,
    dialect: Dialect,
) -> Result<(), Unsupported> {
    planner::refuse_nonclassical(domain, problem)?;
    if let Some(metric) = &problem.metric {
        let time = metric.expression.parts().find_map(|part| match part {
            Expression::TotalTime(span)
            | Expression::Duration(span)
            | Expression::ContinuousTime(span) => Some(*span),
            _ => None,
        });
        if let Some(span) = time {
            return Err(unsupported("`total-time` in a metric", span, InputText::Problem));
        }
    }
    if let Some(axiom) = domain.derived.first()
        && !dialect.has_axioms
    {
        return Err(unsupported("derived predicates", axiom.span, InputText::Domain));
    }
    if dialect.has_numbers { Ok(()) } else { refuse_comparisons(domain, problem) }
}

fn refuse_comparisons(domain: &Domain, problem: &Problem) -> Result<(), Unsupported> {
    let mut first = None;
    task_parts::all_conditions(domain, problem, &mut |condition, text| {
        if let (Condition::Compare(compare), None) = (condition, &first) {
            first = Some(unsupported("a numeric condition", compare.span, text));
        }
    });
    first.map_or(Ok(()), Err)
}
