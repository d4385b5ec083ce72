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
    /// The actions that switch it on and off.
    pub(crate) on: &'static str,
    pub(crate) off: &'static str,
}

impl Kind {
    pub(crate) fn words(self) -> Words {
        let words = |agent, state, on, off| Words { agent, state, on, off };
        match self {
            Kind::Lamp => words("lamp", "lit", "turn-on-lamp", "turn-off-lamp"),
            Kind::Relay => words("relay", "powered", "turn-on-relay", "turn-off-relay"),
            Kind::Lock => words("door-lock", "locked", "lock-door", "unlock-door"),
        }
    }
}

/// The action model of a switch, with the words that the shared ontology lacks; `offers` says whether
/// it can do anything now.
pub(crate) fn model(id: &str, room: &str, kind: Kind, ontology: &Domain, offers: bool) -> String {
    let Words { agent, state, on, off } = kind.words();
    let action = |name: &str, effect: &str| {
        format!(
            "(:action {name} :agent ?d - {agent} :parameters (?r - room)
               :precondition (installed ?d ?r)
               :effect (and {effect} (increase (total-cost) 1)))"
        )
    };
    let actions = match offers {
        true => action(on, &format!("({state} ?r)")) + &action(off, &format!("(not ({state} ?r))")),
        false => String::new(),
    };
    let has_type = ontology.types.iter().any(|known| known.name == agent);
    let types = if has_type { String::new() } else { format!("(:types {agent} - object)") };
    let has_state = ontology.predicates.iter().any(|known| known.name == state);
    let state = if has_state { String::new() } else { format!("({state} ?r - room)") };
    format!(
        "(define (agent {id}) (:domain {}) {types}
           (:predicates {state} (:private (installed ?d - object ?r - room)))
           (:objects {id} - {agent}) (:init (installed {id} {room})) {actions})",
        ontology.name
    )
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
            let Words { agent: a, state: s, on: o, off: f } = kind.words();
            assert_eq!(agent, a);
            let theirs = [state, on, off].map(|word| word.as_deref());
            assert_eq!(theirs, [Some(s), Some(o), Some(f)], "{class}");
        }
    }
}
