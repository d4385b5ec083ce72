//! Applies the effects of actions to the facts of an agent.

use std::collections::BTreeMap;

use pddl::{Assign, Assignment, Atom, Effect, Expression, FluentTerm, InitElement, Name, Term};

use crate::device::MethodCall;

/// Facts of the agent, by the text of the fact. The value of a function is listed by the text of
/// the function.
#[derive(Clone, Debug, Default)]
pub struct AgentFacts(BTreeMap<String, InitElement>);

impl AgentFacts {
    /// Creates the facts of an agent from those of its model, or of its file.
    pub fn new(facts: Vec<InitElement>) -> AgentFacts {
        let mut known = AgentFacts::default();
        facts.into_iter().for_each(|fact| known.add(fact));
        known
    }

    /// Returns all facts, in the order of their texts.
    pub fn facts(&self) -> impl Iterator<Item = InitElement> {
        self.0.values().cloned()
    }

    fn add(&mut self, fact: InitElement) {
        let key = match &fact {
            InitElement::Assign(fluent, _) => format!("= {fluent}"),
            // An atom is true, false or unknown; the latest of these replaces the others.
            InitElement::Not(atom) | InitElement::Unknown(atom) => atom.to_string(),
            other => other.to_string(),
        };
        self.0.insert(key, fact);
    }

    /// Returns `true` or `false` for a fact; `None` if it is unknown. A fact that is not listed is
    /// false.
    fn value_of(&self, atom: &Atom) -> Option<bool> {
        match self.0.get(&atom.to_string()) {
            Some(InitElement::Unknown(_)) => None,
            listed => Some(matches!(listed, Some(InitElement::Atom(_)))),
        }
    }

    /// Returns the facts after `call` has succeeded, and those of them that the action or its result
    /// (`told`) has made known.
    pub fn after_success(
        &self,
        effect: Option<&Effect>,
        call: &MethodCall,
        told: &[InitElement],
    ) -> (AgentFacts, Vec<InitElement>) {
        let mut after = self.clone();
        let mut observed =
            effect.map(|effect| after.apply(effect, &call.arguments)).unwrap_or_default();
        told.iter().for_each(|fact| after.add(fact.clone()));
        observed.extend(told.iter().cloned());
        (after, observed)
    }

    /// Returns the facts after `call` has not succeeded. If it is unknown how much of it was done, so
    /// are the facts that the effect changes.
    pub fn after_failure(
        &self,
        effect: Option<&Effect>,
        call: &MethodCall,
        is_end_unknown: bool,
    ) -> AgentFacts {
        let mut after = self.clone();
        if let Some(effect) = effect.filter(|_| is_end_unknown) {
            after.apply_uncertain(effect, &call.arguments);
        }
        after
    }

    /// Applies an action's effect, and returns the added facts.
    fn apply(&mut self, effect: &Effect, arguments: &BTreeMap<String, String>) -> Vec<InitElement> {
        let mut added = Vec::new();
        match effect {
            Effect::And(effects) => {
                // In PDDL, a fact that is both deleted and added is true afterwards.
                let is_delete = |effect: &&Effect| matches!(effect, Effect::Delete(_));
                let (first, then): (Vec<_>, Vec<_>) = effects.iter().partition(is_delete);
                for effect in first.into_iter().chain(then) {
                    added.extend(self.apply(effect, arguments));
                }
            }
            Effect::Add(atom) => {
                let fact = InitElement::Atom(ground(atom, arguments));
                self.add(fact.clone());
                added.push(fact);
            }
            Effect::Delete(atom) => {
                let fact = InitElement::Atom(ground(atom, arguments));
                self.0.remove(&fact.to_string());
            }
            Effect::Assign(assign) if !is_cost(assign) => {
                added.extend(self.assign(assign, arguments));
            }
            // `check_effect` refuses the remaining effects, except costs.
            Effect::Assign(_) | Effect::Forall(..) | Effect::When(..) => (),
        }
        added
    }

    /// Gives a function its new value, and returns it as a fact. If the value is that of a function
    /// without a value, the function has none afterwards.
    fn assign(
        &mut self,
        assign: &Assign,
        arguments: &BTreeMap<String, String>,
    ) -> Option<InitElement> {
        let fluent = ground_fluent(&assign.fluent, arguments);
        let value = match &assign.value {
            Expression::Number(number) => Some(*number),
            Expression::Fluent(other) => {
                let other = ground_fluent(other, arguments);
                match self.0.get(&format!("= {other}")) {
                    Some(InitElement::Assign(_, number)) => Some(*number),
                    _ => None,
                }
            }
            _ => None,
        };
        self.0.remove(&format!("= {fluent}"));
        let fact = InitElement::Assign(fluent, value?);
        self.add(fact.clone());
        Some(fact)
    }

    /// Applies an effect that may or may not have happened: each fact that the effect would change
    /// becomes unknown.
    fn apply_uncertain(&mut self, effect: &Effect, arguments: &BTreeMap<String, String>) {
        let mut after = self.clone();
        after.apply(effect, arguments);
        for atom in atoms(effect) {
            let atom = ground(atom, arguments);
            if self.value_of(&atom) != after.value_of(&atom) {
                self.add(InitElement::Unknown(atom));
            }
        }
        // A number that is unknown has no value.
        for fluent in assigned(effect) {
            self.0.remove(&format!("= {}", ground_fluent(fluent, arguments)));
        }
    }
}

/// Returns the functions that an effect gives a value, except the cost of a plan.
fn assigned(effect: &Effect) -> Vec<&FluentTerm> {
    match effect {
        Effect::And(effects) => effects.iter().flat_map(assigned).collect(),
        Effect::Assign(assign) if !is_cost(assign) => vec![&assign.fluent],
        _ => Vec::new(),
    }
}

fn is_cost(assign: &Assign) -> bool {
    assign.fluent.function == pddl::TOTAL_COST
}

/// Returns the atoms that an effect adds or deletes.
fn atoms(effect: &Effect) -> Vec<&Atom> {
    match effect {
        Effect::And(effects) => effects.iter().flat_map(atoms).collect(),
        Effect::Add(atom) | Effect::Delete(atom) => vec![atom],
        Effect::Assign(_) | Effect::Forall(..) | Effect::When(..) => Vec::new(),
    }
}

fn ground(atom: &Atom, arguments: &BTreeMap<String, String>) -> Atom {
    Atom { arguments: bound(&atom.arguments, arguments), ..atom.clone() }
}

fn ground_fluent(fluent: &FluentTerm, arguments: &BTreeMap<String, String>) -> FluentTerm {
    FluentTerm { arguments: bound(&fluent.arguments, arguments), ..fluent.clone() }
}

fn bound(terms: &[Term], arguments: &BTreeMap<String, String>) -> Vec<Term> {
    let bound = |term: &Term| match term {
        Term::Variable(name) => {
            let value = arguments.get(name.as_str()).map(|value| Name::new(value));
            value.map_or_else(|| term.clone(), Term::Object)
        }
        Term::Object(_) => term.clone(),
    };
    terms.iter().map(bound).collect()
}

/// Part of an effect that does not follow from the success of its action alone.
#[derive(Clone, Debug, PartialEq)]
pub enum UncertainEffect {
    /// The effect changes this number in a way that depends on its value before.
    Number(FluentTerm),
    /// The effect has `forall` or `when`.
    Conditional,
}

/// Checks that an effect depends only on the success of its action, and not on the state before it.
///
/// # Errors
///
/// Returns the first conditional or quantified part, or the first number that the effect changes.
pub fn check_effect(effect: &Effect) -> Result<(), UncertainEffect> {
    match effect {
        Effect::And(effects) => effects.iter().try_for_each(check_effect),
        Effect::Add(_) | Effect::Delete(_) => Ok(()),
        Effect::Assign(assign) if is_cost(assign) || is_determined(assign) => Ok(()),
        Effect::Assign(assign) => Err(UncertainEffect::Number(assign.fluent.clone())),
        Effect::Forall(..) | Effect::When(..) => Err(UncertainEffect::Conditional),
    }
}

/// Whether an effect gives a function a number, or the value of another function, such as the
/// number of a level.
fn is_determined(assign: &Assign) -> bool {
    assign.assignment == Assignment::Assign
        && match &assign.value {
            Expression::Number(_) => true,
            Expression::Fluent(other) => other.function != assign.fluent.function,
            _ => false,
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the facts after an action with this effect, which has the arguments `?d` = lamp-1 and
    /// `?l` = low: after its success, and after an end of which nothing is known.
    #[track_caller]
    fn check(facts: &str, effect: &str, [done, uncertain]: [&str; 2]) {
        let parsed = pddl::parse_init_elements(facts).into_result().expect("facts");
        let known = AgentFacts::new(parsed);
        let domain =
            format!("(define (domain d) (:action a :parameters (?d ?l) :effect {effect}))");
        let domain = pddl::parse_domain(&domain).value.expect("a domain");
        let effect = &domain.actions[0].effect;
        assert_eq!(check_effect(effect), Ok(()));
        let bound = [("d", "lamp-1"), ("l", "low")];
        let arguments = bound.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        let call = MethodCall { action: String::new(), method: String::new(), arguments };
        let text = |facts: &AgentFacts| {
            facts.facts().map(|fact| fact.to_string()).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(text(&known.after_success(Some(effect), &call, &[]).0), done);
        assert_eq!(text(&known.after_failure(Some(effect), &call, true)), uncertain);
    }

    #[test]
    fn a_number_becomes_that_of_a_level() {
        let effect = "(and (assign (brightness ?d) (amount ?l)) (increase (total-cost) 1))";
        let level = "(= (amount low) 20)";
        check(
            &format!("(= (brightness lamp-1) 80) {level}"),
            effect,
            ["(= (amount low) 20) (= (brightness lamp-1) 20)", level],
        );
        // The level has no number.
        check("(= (brightness lamp-1) 80)", effect, ["", ""]);
        check("", "(assign (brightness ?d) 0)", ["(= (brightness lamp-1) 0)", ""]);
    }

    #[test]
    fn a_number_that_depends_on_its_value_before_is_refused() {
        for effect in ["(increase (n) 1)", "(assign (n) (+ (n) 1))", "(assign (n) (n))"] {
            let domain = format!("(define (domain d) (:action a :effect {effect}))");
            let domain = pddl::parse_domain(&domain).value.expect("a domain");
            let refused = check_effect(&domain.actions[0].effect);
            assert!(matches!(refused, Err(UncertainEffect::Number(_))), "{effect}");
        }
    }
}
