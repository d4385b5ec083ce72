//! Checks of plans: actions and objects must be known, and types must match.

use foldhash::HashMap;

use super::{Checker, count};
use crate::diagnostic::Diagnostic;
use crate::tree::{Domain, Name, Plan, PlanStep, Typed};

/// An action that a step of a plan can use.
struct Callable<'t> {
    name: &'t Name,
    parameters: Vec<&'t Typed>,
}

impl<'t> Checker<'_, 't> {
    pub(super) fn plan(&mut self, domain: &'t Domain, plan: &'t Plan) {
        let callable = callables(domain);
        let mut index = HashMap::default();
        for callable in &callable {
            index.entry(callable.name.as_str()).or_insert(callable);
        }
        for step in &plan.steps {
            match index.get(step.action.as_str()) {
                Some(callable) => self.step(step, callable),
                None => self.unknown_action(&step.action, &callable),
            }
        }
    }

    fn unknown_action(&mut self, name: &'t Name, callable: &[Callable<'t>]) {
        let near = self.nearest(name.as_str(), callable.iter().map(|it| it.name.as_str()));
        let message = format!("unknown action `{name}`");
        self.report(Diagnostic::error(name.span(), message).with_suggestion(near));
    }

    fn step(&mut self, step: &'t PlanStep, callable: &Callable<'t>) {
        let (wanted, found) = (callable.parameters.len(), step.arguments.len());
        if wanted != found {
            let wanted = count(wanted, "argument");
            let message = format!("`{}` takes {wanted}, found {found}", step.action);
            return self
                .report(Diagnostic::error(step.span, message).with_rule(callable.to_string()));
        }
        for (argument, parameter) in step.arguments.iter().zip(&callable.parameters) {
            let Some(actual) = self.object(argument) else { continue };
            let wanted = &parameter.ty;
            let known = self.are_types_known(wanted) && self.are_types_known(actual);
            let is_also = || self.symbols.is_also(argument, wanted);
            if known && !self.symbols.types.accepts(wanted, actual) && !is_also() {
                let message = format!(
                    "`{argument}` is of type `{actual}`, `{}` wants `{wanted}`",
                    step.action
                );
                let wrong = Diagnostic::error(argument.span(), message);
                self.report(wrong.with_rule(callable.to_string()));
            }
        }
    }
}

fn callables(domain: &Domain) -> Vec<Callable<'_>> {
    let actions = domain.actions.iter().map(|action| Callable {
        name: &action.name,
        parameters: action.all_parameters().collect(),
    });
    let durative = domain.durative_actions.iter().map(|action| Callable {
        name: &action.name,
        parameters: action.all_parameters().collect(),
    });
    actions.chain(durative).collect()
}

/// Writes the action as `(ACTION VARIABLE - TYPE …)`.
impl std::fmt::Display for Callable<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "({}", self.name)?;
        for parameter in &self.parameters {
            write!(f, " ?{} - {}", parameter.name, parameter.ty)?;
        }
        f.write_str(")")
    }
}
