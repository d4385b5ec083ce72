//! The words of something in a room that is on or off: what it says of itself, and what follows for the
//! room, which may have several of its kind.

use pddl::Domain;

/// The words of one kind of thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnOff<'w> {
    /// The type of an agent that is one.
    pub agent: &'w str,
    /// The predicate of a room.
    pub state: &'w str,
    /// The predicate of the thing itself that is true when it is on.
    pub own: &'w str,
    /// Whether all in a room have to be on for it to be true of the room; else one is enough.
    pub all: bool,
}

// === impl OnOff ===

impl OnOff<'_> {
    /// What is on or off, in PDDL: the thing `id`. An ontology that has the predicate of the room without
    /// an axiom means by it whatever it is told: then it is the room.
    pub fn term(&self, id: &str, room: &str, ontology: &Domain) -> String {
        let OnOff { state, own, .. } = self;
        match is_told(ontology, state) {
            true => format!("({state} {room})"),
            false => format!("({own} {id})"),
        }
    }

    /// The predicates that an action model has to declare because the ontology does not.
    pub fn predicates(&self, ontology: &Domain) -> String {
        let OnOff { agent, state, own, .. } = self;
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

    /// The axiom that derives what is so of a room, where the ontology does not know the predicate.
    pub fn axiom(&self, ontology: &Domain) -> String {
        let OnOff { agent, state, own, all } = self;
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
