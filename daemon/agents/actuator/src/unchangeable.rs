//! Finds conditions that no action of a domain can change, without grounding the domain.
//!
//! A building may have a goal about each of a hundred blinds, and each blind plans for itself. It
//! must not search for plans that move the others. The facts that are proved unreachable by the
//! planner are single facts; this module looks at comparisons and negations, too.

use std::collections::BTreeSet;

use pddl::{ActionSchema, Condition, Domain, Effect, InitElement, Name, Problem, Term};

/// A predicate or function, applied to terms.
type Applied<'c> = (&'c Name, &'c [Term]);

/// The actions of a domain, prepared for [`ChangeableSymbols::can_change`].
pub(crate) struct ChangeableSymbols<'d> {
    domain: &'d Domain,
    /// Predicates that an action changes or an axiom derives.
    changed: BTreeSet<&'d Name>,
    /// Facts of the problem with one argument: the predicate, and the argument.
    unary: BTreeSet<(&'d Name, &'d Name)>,
}

impl<'d> ChangeableSymbols<'d> {
    pub(crate) fn of(domain: &'d Domain, problem: &'d Problem) -> ChangeableSymbols<'d> {
        let effects = domain.actions.iter().flat_map(|action| action.effect.parts());
        let changed = effects.filter_map(|effect| match effect {
            Effect::Add(atom) | Effect::Delete(atom) => Some(&atom.predicate),
            _ => None,
        });
        let derived = domain.derived.iter().map(|axiom| &axiom.predicate);
        let unary = problem.init.iter().filter_map(|element| match element {
            InitElement::Atom(atom) => match atom.arguments.as_slice() {
                [Term::Object(object)] => Some((&atom.predicate, object)),
                _ => None,
            },
            _ => None,
        });
        ChangeableSymbols {
            domain,
            changed: changed.chain(derived).collect(),
            unary: unary.collect(),
        }
    }

    /// Whether an action may change a ground condition. Returns `true` if this is not certain: for
    /// conditions with quantifiers, and with predicates that axioms derive.
    pub(crate) fn can_change(&self, condition: &Condition) -> bool {
        let is_quantified =
            |part: &Condition| matches!(part, Condition::Exists(..) | Condition::Forall(..));
        let is_derived =
            |name: &Name| self.domain.derived.iter().any(|axiom| axiom.predicate == *name);
        if condition.parts().any(is_quantified) || condition.symbols().any(is_derived) {
            return true;
        }
        let atoms = condition.parts().filter_map(|part| match part {
            Condition::Atom(atom) => Some((&atom.predicate, atom.arguments.as_slice())),
            _ => None,
        });
        let fluents = condition.fluents();
        let fluents = fluents.map(|fluent| (&fluent.function, fluent.arguments.as_slice()));
        let uses: Vec<Applied<'_>> = atoms.chain(fluents).collect();
        self.domain.actions.iter().any(|action| self.touches(action, &uses))
    }

    /// Whether an action may change one of these facts and numbers.
    fn touches(&self, action: &ActionSchema, uses: &[Applied<'_>]) -> bool {
        let bound: BTreeSet<&Name> = { action.effect.parts() }
            .filter_map(|effect| match effect {
                Effect::Forall(variables, _) => Some(variables.iter().map(|one| &one.name)),
                _ => None,
            })
            .flatten()
            .collect();
        action.effect.parts().any(|effect| {
            let (name, terms): Applied<'_> = match effect {
                Effect::Add(atom) | Effect::Delete(atom) => (&atom.predicate, &atom.arguments),
                Effect::Assign(assign) => (&assign.fluent.function, &assign.fluent.arguments),
                _ => return false,
            };
            let fits = |(term, object): (&Term, &Term)| match term {
                Term::Object(_) => term == object,
                Term::Variable(variable) if bound.contains(variable) => true,
                Term::Variable(variable) => self.may_be(action, variable, object),
            };
            uses.iter().any(|(used, arguments)| {
                name == *used
                    && terms.len() == arguments.len()
                    && terms.iter().zip(*arguments).all(fits)
            })
        })
    }

    /// Whether a variable of an action may be an object, by those preconditions of the action that
    /// no action changes and that are about the variable alone: `(offers-open ?d)`.
    fn may_be(&self, action: &ActionSchema, variable: &Name, object: &Term) -> bool {
        let Term::Object(object) = object else { return true };
        let required: Vec<&Condition> = match &action.precondition {
            Condition::And(parts) => parts.iter().collect(),
            other => vec![other],
        };
        required.into_iter().all(|part| match part {
            Condition::Atom(atom)
                if atom.arguments.as_slice() == [Term::Variable(variable.clone())]
                    && !self.changed.contains(&atom.predicate) =>
            {
                self.unary.contains(&(&atom.predicate, object))
            }
            _ => true,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOMAIN: &str = "(define (domain d) (:types cover lamp)
        (:predicates (offers-move ?c - cover) (offers-all ?c - cover) (on ?l - lamp) (lit)
            (open ?c - cover))
        (:functions (position ?c - cover) (tilt ?c - cover))
        (:derived (lit) (exists (?l - lamp) (on ?l)))
        (:action move :parameters (?c - cover) :precondition (and (offers-move ?c))
            :effect (and (assign (position ?c) 50) (open ?c)))
        (:action all :parameters (?c - cover) :precondition (offers-all ?c)
            :effect (forall (?c - cover) (assign (tilt ?c) 0))))";

    #[track_caller]
    fn check(condition: &str, expected: bool) {
        let domain = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let problem = "(define (problem p) (:domain d) (:objects a b - cover)
            (:init (offers-move a) (offers-all a)) (:goal (and)))";
        let problem = pddl::parse_problem(problem).into_result().expect("a problem");
        let condition = pddl::parse_condition(condition).into_result().expect("a condition");
        assert_eq!(
            ChangeableSymbols::of(&domain, &problem).can_change(&condition),
            expected,
            "{condition}"
        );
    }

    #[test]
    fn only_what_an_action_may_change_is_changeable() {
        check("(<= (position a) 50)", true);
        check("(<= (position b) 50)", false);
        check("(<= (position b) (position a))", true);
        check("(not (open a))", true);
        check("(not (open b))", false);
        check("(and (not (open b)) (> (position b) 3))", false);
        // A quantified effect is about all covers.
        check("(= (tilt b) 0)", true);
        // What is not analysed may change.
        check("(not (lit))", true);
        check("(forall (?c - cover) (<= (position ?c) 50))", true);
    }
}
