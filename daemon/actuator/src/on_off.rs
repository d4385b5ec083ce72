//! PDDL for things in a room that are on or off: the state of the thing itself, and the state of the
//! room that follows from it. A room may have several things of a kind.

use pddl::Domain;

/// PDDL names for one kind of thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnOffPredicates<'w> {
    /// The type of the agents of this kind.
    pub agent: &'w str,
    /// The predicate about a room.
    pub state: &'w str,
    /// The predicate about the thing itself, true if the thing is on.
    pub own: &'w str,
    /// Whether the predicate holds for a room only if all things in it are on; otherwise one is enough.
    pub all: bool,
}

// === impl OnOffPredicates ===

impl OnOffPredicates<'_> {
    /// Returns the atom that is true if the thing `id` is on. If the ontology has the predicate of the
    /// room without an axiom, the room's own state is meant and the atom is about the room.
    pub fn term(&self, id: &str, room: &str, ontology: &Domain) -> String {
        let OnOffPredicates { state, own, .. } = self;
        match is_told(ontology, state) {
            true => format!("({state} {room})"),
            false => format!("({own} {id})"),
        }
    }

    /// Returns the predicates that an action model must declare because the ontology does not.
    pub fn predicates(&self, ontology: &Domain) -> String {
        let OnOffPredicates { agent, state, own, .. } = self;
        let declared = |name: &str| ontology.predicates.iter().any(|known| known.name == name);
        let mut predicates = String::new();
        if !declared(state) {
            predicates += &format!("({state} ?r - room) ");
        }
        if !is_told(ontology, state) && !declared(own) {
            predicates += &format!("({own} ?d - {agent}) ");
        }
        predicates
    }

    /// Returns the axiom that derives the state of a room; empty if the ontology has the predicate.
    pub fn axiom(&self, ontology: &Domain) -> String {
        let OnOffPredicates { agent, state, own, all } = self;
        if ontology.predicates.iter().any(|known| known.name == *state) {
            return String::new();
        }
        let body = match all {
            false => format!("(exists (?d - {agent}) (and (installed ?d ?r) ({own} ?d)))"),
            true => format!(
                "(and (exists (?d - {agent}) (installed ?d ?r)) \
                 (forall (?d - {agent}) (imply (installed ?d ?r) ({own} ?d))))"
            ),
        };
        format!("(:derived ({state} ?r - room) {body})")
    }
}

/// Whether axioms of an ontology derive a predicate.
pub fn is_derived(ontology: &Domain, predicate: &str) -> bool {
    ontology.derived.iter().any(|axiom| axiom.predicate == predicate)
}

/// Whether an ontology has a predicate that no axiom derives.
fn is_told(ontology: &Domain, predicate: &str) -> bool {
    ontology.predicates.iter().any(|known| known.name == predicate)
        && !is_derived(ontology, predicate)
}
