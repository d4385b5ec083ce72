//! What is switched, and the words of its action model: those of the lamps, relays and locks that a
//! gateway to MQTT brings, so that both can be in one ecosystem.

use pddl::Domain;
use serde::Deserialize;

/// What is switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Kind {
    Lamp,
    Relay,
    Lock,
}

/// The words of a kind.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Words {
    /// The type of an agent that is one.
    pub(crate) agent: &'static str,
    /// The predicate of its room that is true when it is on.
    pub(crate) state: &'static str,
    /// The predicate of itself that is true then.
    pub(crate) own: &'static str,
    /// Whether all of a room have to be on for it to be true of the room; else one is enough.
    pub(crate) all: bool,
    /// The actions that switch it on and off.
    pub(crate) on: &'static str,
    pub(crate) off: &'static str,
}

impl Kind {
    pub(crate) fn words(self) -> Words {
        let words = |agent, (state, all), own, (on, off)| Words { agent, state, own, all, on, off };
        match self {
            Kind::Lamp => {
                words("lamp", ("lit", false), "lamp-on", ("turn-on-lamp", "turn-off-lamp"))
            }
            Kind::Relay => {
                words("relay", ("powered", false), "relay-on", ("turn-on-relay", "turn-off-relay"))
            }
            Kind::Lock => {
                words("door-lock", ("locked", true), "bolted", ("lock-door", "unlock-door"))
            }
        }
    }

    /// How it is, for people.
    pub(crate) fn told(self, is_on: bool) -> &'static str {
        match (self, is_on) {
            (Kind::Lock, true) => "locked",
            (Kind::Lock, false) => "unlocked",
            (Kind::Lamp | Kind::Relay, true) => "on",
            (Kind::Lamp | Kind::Relay, false) => "off",
        }
    }

    /// What it is about itself that is switched, in PDDL. An ontology that has the predicate of the room
    /// without an axiom means by it whatever it is told: then it is that.
    pub(crate) fn term(self, id: &str, room: &str, ontology: &Domain) -> String {
        let Words { state, own, .. } = self.words();
        match is_told(ontology, state) {
            true => format!("({state} {room})"),
            false => format!("({own} {id})"),
        }
    }
}

/// Whether an ontology has a predicate that no axiom derives.
fn is_told(ontology: &Domain, predicate: &str) -> bool {
    ontology.predicates.iter().any(|known| known.name == predicate)
        && !ontology.derived.iter().any(|axiom| axiom.predicate == predicate)
}

/// The action model of a switch, with the words that the shared ontology lacks; `offers` says whether
/// it can do anything now.
pub(crate) fn model(id: &str, room: &str, kind: Kind, ontology: &Domain, offers: bool) -> String {
    let Words { agent, state, own, all, on, off } = kind.words();
    let action = |name: &str, effect: &str| {
        format!(
            "(:action {name} :agent ?d - {agent} :parameters (?r - room)
               :precondition (installed ?d ?r)
               :effect (and {effect} (increase (total-cost) 1)))"
        )
    };
    let term = kind.term("?d", "?r", ontology);
    let actions = match offers {
        true => action(on, &term) + &action(off, &format!("(not {term})")),
        false => String::new(),
    };
    let has_type = ontology.types.iter().any(|known| known.name == agent);
    let types = if has_type { String::new() } else { format!("(:types {agent} - object)") };
    let has_state = ontology.predicates.iter().any(|known| known.name == state);
    let state = match has_state {
        true => String::new(),
        false => derived(state, own, agent, all),
    };
    let own = match is_told(ontology, kind.words().state) {
        true => String::new(),
        false => format!("({own} ?d - {agent})"),
    };
    let (predicate, axiom) = state.split_once('\n').unwrap_or(("", ""));
    format!(
        "(define (agent {id}) (:domain {}) {types}
           (:predicates {predicate} {own} (installed ?d - object ?r - room))
           {axiom}
           (:objects {id} - {agent}) (:init (installed {id} {room})) {actions})",
        ontology.name
    )
}

/// The declaration of a predicate of a room and, on a line of its own, the axiom that derives it from
/// the things in it.
fn derived(state: &str, own: &str, agent: &str, all: bool) -> String {
    let one = match all {
        false => format!("(exists (?d - {agent}) (and (installed ?d ?r) ({own} ?d)))"),
        true => format!(
            "(and (exists (?d - {agent}) (installed ?d ?r))
                  (forall (?d - {agent}) (imply (installed ?d ?r) ({own} ?d))))"
        ),
    };
    let axiom = one.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("({state} ?r - room)\n(:derived ({state} ?r - room) {axiom})")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    /// The gateway's table, which says it for devices that come by themselves.
    const CLASSES: &str = include_str!("../../mqtt/src/classes.toml");

    #[derive(Deserialize)]
    struct Class {
        agent: String,
        state: Option<String>,
        on: Option<String>,
        off: Option<String>,
    }

    #[test]
    fn the_words_are_those_of_the_gateway_to_mqtt() {
        let classes: BTreeMap<String, Class> = toml::from_str(CLASSES).expect("its table");
        for (kind, class) in [(Kind::Lamp, "light"), (Kind::Relay, "switch"), (Kind::Lock, "lock")]
        {
            let Class { agent, state, on, off } = &classes[class];
            let Words { agent: a, state: s, on: o, off: f, .. } = kind.words();
            assert_eq!(agent, a);
            let theirs = [state, on, off].map(|word| word.as_deref());
            assert_eq!(theirs, [Some(s), Some(o), Some(f)], "{class}");
        }
    }
}
