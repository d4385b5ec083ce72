//! The actions that move an agent from one place to another, recognized by their effects: no name
//! of a domain is known here.

use std::collections::{BTreeMap, BTreeSet};

use pddl::{ActionSchema, Atom, Condition, Effect, Term};

use crate::text::GroundStep;

/// Maximum number of moving actions that are kept.
const MOVES_MAX: usize = 256;

/// A fact about the place of an agent: `(at AGENT PLACE)`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlacePredicate {
    pub(crate) predicate: String,
    /// Index of the agent among the arguments.
    pub(crate) mover: usize,
    /// Index of the place among the arguments.
    pub(crate) place: usize,
}

/// A fact that allows to go from one place to another: `(connected FROM TO)`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct WayPredicate {
    pub(crate) predicate: String,
    /// Whether the place to go to stands first.
    pub(crate) is_reversed: bool,
}

/// An action that moves an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
struct MoveSchema {
    /// Index of the agent among the arguments of a step.
    mover: usize,
    /// Index of the place to go to among the arguments of a step.
    to: usize,
}

/// All known actions that move an agent.
#[derive(Clone, Debug, Default)]
pub(crate) struct MoveSchemas {
    moves: BTreeMap<String, MoveSchema>,
    pub(crate) places: BTreeSet<PlacePredicate>,
    pub(crate) ways: BTreeSet<WayPredicate>,
}

impl MoveSchemas {
    pub(crate) fn is_empty(&self) -> bool {
        self.moves.is_empty()
    }

    /// Learns the moving actions among the actions of an agent or of a domain. `own_name` returns
    /// the name that the agents use for an action.
    pub(crate) fn learn(&mut self, actions: &[ActionSchema], own_name: impl Fn(&str) -> String) {
        for action in actions {
            let name = own_name(action.name.as_str());
            if self.moves.len() >= MOVES_MAX && !self.moves.contains_key(&name) {
                return;
            }
            let Some((schema, place, ways)) = movement(action, actions) else { continue };
            self.moves.insert(name, schema);
            self.places.insert(place);
            self.ways.extend(ways);
        }
    }

    /// Returns the agent that a step moves, and the place to which it does; `None` if the step
    /// moves no agent.
    pub(crate) fn movement<'s>(&self, step: &'s GroundStep) -> Option<(&'s str, &'s str)> {
        let schema = self.moves.get(&step.action)?;
        let argument = |index: usize| step.arguments.get(index).map(String::as_str);
        Some((argument(schema.mover)?, argument(schema.to)?))
    }

    /// Returns a step as a sentence.
    pub(crate) fn sentence(&self, step: &GroundStep) -> String {
        step.sentence(self.movement(step).map(|(_, place)| place))
    }
}

/// Returns how an action moves its agent: one fact about it ends, and the same fact with another
/// place begins; and there is a way between the two places that no action changes.
fn movement(
    action: &ActionSchema,
    actions: &[ActionSchema],
) -> Option<(MoveSchema, PlacePredicate, Vec<WayPredicate>)> {
    let deleted = action.effect.parts().filter_map(|part| match part {
        Effect::Delete(atom) => Some(atom),
        _ => None,
    });
    let pairs = deleted.flat_map(|before| action.effect.added().map(move |after| (before, after)));
    pairs.into_iter().find_map(|(before, after)| {
        let (index, from, to) = differing(before, after)?;
        let ways: Vec<_> = conjuncts(&action.precondition)
            .filter_map(|atom| way(atom, from, to))
            .filter(|way| !is_changed(&way.predicate, actions))
            .collect();
        if ways.is_empty() {
            return None;
        }
        let parameter = |name: &str| {
            action.all_parameters().position(|parameter| parameter.name.as_str() == name)
        };
        let others = before.arguments.iter().enumerate().filter(|(other, _)| *other != index);
        let mut movers = others.filter_map(|(other, term)| Some((other, variable(term)?)));
        let (mover_argument, mover) = movers.next()?;
        let schema = MoveSchema { mover: parameter(mover)?, to: parameter(to)? };
        let place = PlacePredicate {
            predicate: before.predicate.as_str().to_owned(),
            mover: mover_argument,
            place: index,
        };
        Some((schema, place, ways))
    })
}

/// Returns the index of the only argument in which two facts differ, with its variables.
fn differing<'a>(before: &'a Atom, after: &'a Atom) -> Option<(usize, &'a str, &'a str)> {
    if before.predicate != after.predicate || before.arguments.len() != after.arguments.len() {
        return None;
    }
    let pairs = before.arguments.iter().zip(&after.arguments).enumerate();
    let mut differing = pairs.filter(|(_, (one, other))| one != other);
    let (index, (one, other)) = differing.next()?;
    match differing.next() {
        None => Some((index, variable(one)?, variable(other)?)),
        Some(_) => None,
    }
}

fn variable(term: &Term) -> Option<&str> {
    match term {
        Term::Variable(name) => Some(name.as_str()),
        Term::Object(_) => None,
    }
}

/// Iterates over the facts that a precondition requires to be true.
fn conjuncts(condition: &Condition) -> impl Iterator<Item = &Atom> {
    let mut open = vec![condition];
    std::iter::from_fn(move || {
        loop {
            match open.pop()? {
                Condition::And(parts) => open.extend(parts.iter().rev()),
                Condition::Atom(atom) => return Some(atom),
                _ => (),
            }
        }
    })
}

fn way(atom: &Atom, from: &str, to: &str) -> Option<WayPredicate> {
    let [first, second] = atom.arguments.as_slice() else { return None };
    let (first, second) = (variable(first)?, variable(second)?);
    let is_reversed = match (first, second) {
        (first, second) if first == from && second == to => false,
        (first, second) if first == to && second == from => true,
        _ => return None,
    };
    Some(WayPredicate { predicate: atom.predicate.as_str().to_owned(), is_reversed })
}

fn is_changed(predicate: &str, actions: &[ActionSchema]) -> bool {
    actions.iter().flat_map(|action| action.effect.parts()).any(|part| match part {
        Effect::Add(atom) | Effect::Delete(atom) => atom.predicate.as_str() == predicate,
        _ => false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn learned(actions: &str) -> MoveSchemas {
        let model = format!("(define (agent r) (:domain d) {actions})");
        let mut moves = MoveSchemas::default();
        let model = pddl::parse_action_model(&model).value.expect("a model");
        moves.learn(&model.actions, str::to_owned);
        moves
    }

    #[test]
    fn a_move_is_recognized_by_its_effects() {
        let moves = learned(
            "(:action drive :agent ?b - base :parameters (?from ?to - place)
                :precondition (and (in ?from ?b) (door ?to ?from) (not (locked ?from ?to)))
                :effect (and (not (in ?from ?b)) (in ?to ?b) (increase (total-cost) 1)))",
        );
        let step = GroundStep::parse("(drive r hall office)");
        assert_eq!(moves.movement(&step), Some(("r", "office")));
        assert_eq!(moves.sentence(&step), "r drives to office");
        let place = PlacePredicate { predicate: "in".to_owned(), mover: 1, place: 0 };
        assert!(moves.places.contains(&place));
        let way = WayPredicate { predicate: "door".to_owned(), is_reversed: true };
        assert_eq!(moves.ways.iter().collect::<Vec<_>>(), [&way]);
    }

    #[test]
    fn other_actions_are_no_moves() {
        let turn = "(:action turn :agent ?c - camera :parameters (?old ?new - preset)
            :precondition (looks-at ?c ?old)
            :effect (and (not (looks-at ?c ?old)) (looks-at ?c ?new)))";
        assert!(learned(turn).moves.is_empty(), "there is no way between presets");
        let swap = "(:action swap :agent ?c - c :parameters (?a ?b - o)
            :precondition (and (on ?c ?a) (free ?a ?b))
            :effect (and (not (on ?c ?a)) (on ?c ?b) (not (free ?a ?b))))";
        assert!(learned(swap).moves.is_empty(), "the way changes");
    }
}
