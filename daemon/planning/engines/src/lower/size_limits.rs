//! Size limits that are compiled into Metric-FF 2.1. For a larger task, Metric-FF prints “increase
//! MAX_PREDICATES” and ends, or crashes. Such a task is therefore refused before Metric-FF is
//! started.
//!
//! Only Metric-FF itself can check its limits on the ground task (150,000 facts, 500 steps).

use pddl::{Domain, Name, Problem, Span};
use planner::{InputText, Unsupported};

use super::refuse::unsupported;

const CONSTANTS_MAX: usize = 2_000;
const PREDICATES_MAX: usize = 50;
const FUNCTIONS_MAX: usize = 50;
const TYPES_MAX: usize = 50;
const ARITY_MAX: usize = 5;
const PARAMETERS_MAX: usize = 15;

/// Returns an error if the task is larger than Metric-FF supports.
pub(super) fn refuse(domain: &Domain, problem: &Problem) -> Result<(), Unsupported> {
    let spans = |names: Vec<&Name>| names.into_iter().map(Name::span).collect::<Vec<_>>();
    let predicates = spans(domain.predicates.iter().map(|it| &it.name).collect());
    refuse_too_many("predicates", &predicates, PREDICATES_MAX)?;
    let functions = spans(domain.functions.iter().map(|it| &it.name).collect());
    refuse_too_many("functions", &functions, FUNCTIONS_MAX)?;
    refuse_too_many("types", &spans(domain.types.iter().map(|it| &it.name).collect()), TYPES_MAX)?;
    let objects = domain.constants.len() + problem.objects.len();
    if objects > CONSTANTS_MAX {
        let last = problem.objects.last().map(|it| it.object.name.span());
        let (span, text) = match last {
            Some(span) => (span, InputText::Problem),
            None => (domain.constants[CONSTANTS_MAX].name.span(), InputText::Domain),
        };
        return Err(unsupported(format!("more than {CONSTANTS_MAX} objects"), span, text));
    }
    let arities = domain.predicates.iter().map(|it| (&it.name, it.parameters.len()));
    let arities = arities.chain(domain.functions.iter().map(|it| (&it.name, it.parameters.len())));
    refuse_too_wide(arities, ARITY_MAX)?;
    refuse_too_wide(domain.actions.iter().map(|it| (&it.name, it.parameters.len())), PARAMETERS_MAX)
}

fn refuse_too_many(what: &str, spans: &[Span], most: usize) -> Result<(), Unsupported> {
    match spans.get(most) {
        None => Ok(()),
        Some(span) => {
            Err(unsupported(format!("more than {most} {what}"), *span, InputText::Domain))
        }
    }
}

fn refuse_too_wide<'t>(
    signatures: impl Iterator<Item = (&'t Name, usize)>,
    most: usize,
) -> Result<(), Unsupported> {
    for (name, parameters) in signatures {
        if parameters > most {
            let feature = format!("more than {most} parameters in one signature");
            return Err(unsupported(feature, name.span(), InputText::Domain));
        }
    }
    Ok(())
}
