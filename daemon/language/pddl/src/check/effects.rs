//! Checks of actions and their effects.

use super::Checker;
use crate::diagnostic::Diagnostic;
use crate::tree::{
    ActionSchema, Assign, Assignment, Atom, DurativeAction, Effect, TimedCondition, TimedEffect,
    Typed,
};

impl<'t> Checker<'_, 't> {
    pub(super) fn action(&mut self, action: &'t ActionSchema) {
        let agents = (action.agent.as_ref(), &action.partners[..]);
        self.with_parameters(agents, &action.parameters, |checker| {
            checker.condition(&action.precondition);
            checker.effect(&action.effect);
            action.observe.iter().for_each(|observed| checker.observed(observed));
        });
    }

    pub(super) fn durative_action(&mut self, action: &'t DurativeAction) {
        self.with_parameters((action.agent.as_ref(), &[]), &action.parameters, |checker| {
            for constraint in &action.duration {
                checker.expression(&constraint.value);
            }
            checker.timed_conditions(&action.conditions);
            checker.timed_effect(&action.effects);
        });
    }

    fn with_parameters(
        &mut self,
        (agent, partners): (Option<&'t Typed>, &'t [Typed]),
        parameters: &'t [Typed],
        body: impl FnOnce(&mut Self),
    ) {
        let agent = agent.map_or(&[][..], std::slice::from_ref);
        self.parameters(agent);
        self.parameters(partners);
        self.parameters(parameters);
        let is_first = |typed: &&Typed| agent.iter().any(|first| first.name == typed.name);
        if let Some(again) = partners.iter().find(is_first) {
            let message = format!("the agent `?{}` is declared twice", again.name);
            let twice = Diagnostic::error(again.name.span(), message);
            let first = agent.iter().map(|first| (first.name.span(), "the first is here"));
            self.report(first.fold(twice, |twice, (span, note)| twice.with_note(span, note)));
        }
        for agent in agent.iter().chain(partners) {
            if let Some(again) = parameters.iter().find(|typed| typed.name == agent.name) {
                let article = if partners.is_empty() { "the" } else { "an" };
                let message = format!("`?{}` is {article} agent and a parameter", agent.name);
                let twice = Diagnostic::error(again.name.span(), message);
                self.report(twice.with_note(agent.name.span(), "the agent is here"));
            }
        }
        self.with_scope(agent, |checker| {
            checker.with_scope(partners, |checker| checker.with_scope(parameters, body));
        });
    }

    fn timed_conditions(&mut self, conditions: &'t [TimedCondition]) {
        for timed in conditions {
            self.quantified(&timed.forall);
            self.with_scope(&timed.forall, |checker| checker.condition(&timed.condition));
        }
    }

    fn timed_effect(&mut self, effect: &'t TimedEffect) {
        match effect {
            TimedEffect::And(parts) => parts.iter().for_each(|part| self.timed_effect(part)),
            TimedEffect::At(_, effect) => self.effect(effect),
            TimedEffect::Forall(variables, inner) => {
                self.quantified(variables);
                self.with_scope(variables, |checker| checker.timed_effect(inner));
            }
            TimedEffect::When(conditions, inner) => {
                self.timed_conditions(conditions);
                self.timed_effect(inner);
            }
            TimedEffect::Continuous(assign) => self.assign(assign),
        }
    }

    fn effect(&mut self, effect: &'t Effect) {
        match effect {
            Effect::And(parts) => parts.iter().for_each(|part| self.effect(part)),
            Effect::Add(atom) | Effect::Delete(atom) => self.changed_atom(atom),
            Effect::Assign(assign) => self.assign(assign),
            Effect::Forall(variables, inner) => {
                self.quantified(variables);
                self.with_scope(variables, |checker| checker.effect(inner));
            }
            Effect::When(condition, inner) => {
                self.condition(condition);
                self.effect(inner);
            }
        }
    }

    fn changed_atom(&mut self, atom: &'t Atom) {
        self.atom(atom);
        if self.symbols.is_derived(&atom.predicate) {
            let message = format!("`{}` is derived, no action can change it", atom.predicate);
            let derived = Diagnostic::error(atom.predicate.span(), message);
            self.report(derived.with_help("change what it is derived from"));
        }
    }

    fn assign(&mut self, assign: &'t Assign) {
        self.fluent(&assign.fluent);
        self.expression(&assign.value);
        if assign.fluent.function == crate::tree::TOTAL_COST
            && assign.assignment != Assignment::Increase
        {
            let message = "`total-cost` is only ever increased";
            let unusual = Diagnostic::warning(assign.span, message);
            self.report(unusual.with_rule("(increase (total-cost) EXPRESSION)"));
        }
    }
}
