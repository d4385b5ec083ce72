//! PDDL for things in a room that are on or off: the state of the thing itself, and the state of
//! the room that follows from it. A room may have several things of one kind.

use pddl::Domain;

/// PDDL names for one kind of thing that is on or off, such as lamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnOffPredicates<'w> {
    /// The PDDL type of the agents that are things of this kind.
    pub agent: &'w str,
    /// The predicate about a room that follows from the things in the room.
    pub state: &'w str,
    /// The predicate about the thing itself, true if the thing is on.
    pub own: &'w str,
    /// Whether `state` holds for a room only if all things of this kind in it are on; otherwise one
    /// thing that is on is enough.
    pub all: bool,
}

/// PDDL names for one kind of thing that actions switch on and off. Drivers and gateways share
/// these names, so that one ecosystem can have both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OnOffNames {
    /// The predicates.
    pub predicates: OnOffPredicates<'static>,
    /// The action that switches the thing on.
    pub on: &'static str,
    /// The action that switches the thing off.
    pub off: &'static str,
}

// === impl OnOffNames ===

impl OnOffNames {
    /// The names for lamps.
    pub const LAMP: OnOffNames = OnOffNames {
        predicates: OnOffPredicates { agent: "lamp", state: "lit", own: "lamp-on", all: false },
        on: "turn-on-lamp",
        off: "turn-off-lamp",
    };

    /// The names for relays.
    pub const RELAY: OnOffNames = OnOffNames {
        predicates: OnOffPredicates {
            agent: "relay",
            state: "powered",
            own: "relay-on",
            all: false,
        },
        on: "turn-on-relay",
        off: "turn-off-relay",
    };

    /// The names for door locks. A room is locked if all of its locks are.
    pub const DOOR_LOCK: OnOffNames = OnOffNames {
        predicates: OnOffPredicates {
            agent: "door-lock",
            state: "locked",
            own: "bolted",
            all: true,
        },
        on: "lock-door",
        off: "unlock-door",
    };
}

// === impl OnOffPredicates ===

impl OnOffPredicates<'_> {
    /// Returns the atom that is true if the thing `id` is on. If the ontology declares the
    /// predicate of the room without an axiom, the atom is about the room instead: things then have
    /// no state of their own.
    pub fn term(&self, id: &str, room: &str, ontology: &Domain) -> String {
        let OnOffPredicates { state, own, .. } = self;
        match is_told(ontology, state) {
            true => format!("({state} {room})"),
            false => format!("({own} {id})"),
        }
    }

    /// Returns the declarations of those predicates that an action model must declare because the
    /// ontology does not.
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

    /// Returns the axiom that derives the state of a room; empty if the ontology declares the
    /// predicate of the room.
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

/// Whether an ontology declares a predicate and has no axiom that derives it.
fn is_told(ontology: &Domain, predicate: &str) -> bool {
    ontology.predicates.iter().any(|known| known.name == predicate)
        && !is_derived(ontology, predicate)
}
