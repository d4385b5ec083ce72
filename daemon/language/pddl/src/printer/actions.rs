//! Printing of actions, axioms and durative actions.

use std::fmt;

use super::conditions::{assign, comparison, condition, effect, expression, quantified};
use super::layout::PrintLayout;
use super::terms::{PrintedEntryKind, atom, parameters, signature, typed_list, write};
use crate::tree::{
    ActionSchema, Derived, DurationConstraint, DurativeAction, Effect, Name, TimeSpecifier,
    TimedCondition, TimedEffect, Typed,
};

pub(super) fn action(action: &ActionSchema) -> PrintLayout<'_> {
    let agents = (action.agent.as_ref(), &action.partners[..]);
    let mut parts = head(":action", &action.name, agents, &action.parameters);
    if !action.precondition.is_always() {
        parts.push(labeled(":precondition", condition(&action.precondition)));
    }
    if action.effect != Effect::nothing() {
        parts.push(labeled(":effect", effect(&action.effect)));
    }
    if !action.observe.is_empty() {
        let observed = action.observe.iter().map(atom);
        parts.push(labeled(":observe", PrintLayout::headed("and", observed)));
    }
    PrintLayout::list(2, parts)
}

/// Lays out the head of an action: `KEYWORD NAME [:agent VARIABLE - TYPE | :agent (VARIABLES)] :parameters
/// (VARIABLES)`.
fn head<'t>(
    keyword: &'static str,
    name: &'t Name,
    (agent, partners): (Option<&'t Typed>, &'t [Typed]),
    list: &'t [Typed],
) -> Vec<PrintLayout<'t>> {
    let mut parts = vec![PrintLayout::word(keyword), PrintLayout::name(name)];
    if let Some(agent) = agent {
        let agents =
            typed_list(std::iter::once(agent).chain(partners), PrintedEntryKind::Variables);
        let mut words = vec![PrintLayout::word(":agent")];
        match partners {
            [] => words.extend(agents),
            _ => words.push(PrintLayout::list(0, agents)),
        }
        parts.push(PrintLayout::group(words));
    }
    parts.push(labeled(":parameters", parameters(list)));
    parts
}

fn labeled<'t>(label: &'static str, value: PrintLayout<'t>) -> PrintLayout<'t> {
    PrintLayout::group(vec![PrintLayout::word(label), value])
}

pub(super) fn derived(derived: &Derived) -> PrintLayout<'_> {
    let head = signature(&derived.predicate, &derived.parameters);
    PrintLayout::list(2, vec![PrintLayout::word(":derived"), head, condition(&derived.condition)])
}

pub(super) fn durative_action(action: &DurativeAction) -> PrintLayout<'_> {
    let keyword = ":durative-action";
    let mut parts = head(keyword, &action.name, (action.agent.as_ref(), &[]), &action.parameters);
    parts.push(labeled(":duration", one_or_and(&action.duration, duration)));
    parts.push(labeled(":condition", one_or_and(&action.conditions, timed_condition)));
    parts.push(labeled(":effect", timed_effect(&action.effects)));
    PrintLayout::list(2, parts)
}

/// Lays out no item as `()`, a single item as itself, and several items as `(and X X+)`.
fn one_or_and<'t, T>(items: &'t [T], layout: impl Fn(&'t T) -> PrintLayout<'t>) -> PrintLayout<'t> {
    match items {
        [] => PrintLayout::list(0, Vec::new()),
        [only] => layout(only),
        several => PrintLayout::headed("and", several.iter().map(layout)),
    }
}

fn duration(constraint: &DurationConstraint) -> PrintLayout<'_> {
    let sides = [PrintLayout::word("?duration"), expression(&constraint.value)];
    let untimed = PrintLayout::headed(comparison(constraint.comparison), sides);
    match constraint.when {
        Some(when) => timed(when, untimed),
        None => untimed,
    }
}

/// Lays out a timed condition or effect: `(at start X) | (at end X) | (over all X)`.
fn timed<'t>(when: TimeSpecifier, inner: PrintLayout<'t>) -> PrintLayout<'t> {
    let (preposition, time) = match when {
        TimeSpecifier::Start => ("at", "start"),
        TimeSpecifier::End => ("at", "end"),
        TimeSpecifier::OverAll => ("over", "all"),
    };
    PrintLayout::list(2, vec![PrintLayout::word(preposition), PrintLayout::word(time), inner])
}

fn timed_condition(timed_condition: &TimedCondition) -> PrintLayout<'_> {
    let inner = timed(timed_condition.when, condition(&timed_condition.condition));
    match &timed_condition.forall[..] {
        [] => inner,
        variables => quantified("forall", variables, inner),
    }
}

fn timed_effect(timed_effect: &TimedEffect) -> PrintLayout<'_> {
    match timed_effect {
        TimedEffect::And(parts) => PrintLayout::headed("and", parts.iter().map(self::timed_effect)),
        TimedEffect::At(when, inner) => timed(*when, effect(inner)),
        TimedEffect::Forall(variables, inner) => {
            quantified("forall", variables, self::timed_effect(inner))
        }
        TimedEffect::When(conditions, inner) => {
            let conditions = one_or_and(conditions, timed_condition);
            PrintLayout::headed("when", [conditions, self::timed_effect(inner)])
        }
        TimedEffect::Continuous(inner) => assign(inner),
    }
}

impl fmt::Display for ActionSchema {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&action(self), f)
    }
}

impl fmt::Display for Derived {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&derived(self), f)
    }
}

impl fmt::Display for DurativeAction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&durative_action(self), f)
    }
}

impl fmt::Display for TimedCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&timed_condition(self), f)
    }
}

impl fmt::Display for TimedEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&timed_effect(self), f)
    }
}

impl fmt::Display for DurationConstraint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write(&duration(self), f)
    }
}
