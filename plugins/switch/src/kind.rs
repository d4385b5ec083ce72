//! What is switched, and the words of its action model: those of the lamps, relays and locks that a
//! gateway to MQTT brings, so that both can be in one ecosystem.

use actuator::OnOff;
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

impl Kind {
    /// What it says of itself, and what follows for its room.
    pub(crate) fn words(self) -> OnOff<'static> {
        let words = |agent, state, own, all| OnOff { agent, state, own, all };
        match self {
            Kind::Lamp => words("lamp", "lit", "lamp-on", false),
            Kind::Relay => words("relay", "powered", "relay-on", false),
            Kind::Lock => words("door-lock", "locked", "bolted", true),
        }
    }

    /// The actions that switch it on and off.
    pub(crate) fn actions(self) -> (&'static str, &'static str) {
        match self {
            Kind::Lamp => ("turn-on-lamp", "turn-off-lamp"),
            Kind::Relay => ("turn-on-relay", "turn-off-relay"),
            Kind::Lock => ("lock-door", "unlock-door"),
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
}

/// The action model of a switch, with the words that the shared ontology lacks; `offers` says whether
/// it can do anything now.
pub(crate) fn model(id: &str, room: &str, kind: Kind, ontology: &Domain, offers: bool) -> String {
    let (words, (on, off)) = (kind.words(), kind.actions());
    let agent = words.agent;
    let action = |name: &str, effect: &str| {
        format!(
            "(:action {name} :agent ?d - {agent} :parameters (?r - room)
               :precondition (installed ?d ?r)
               :effect (and {effect} (increase (total-cost) 1)))"
        )
    };
    let term = words.term("?d", "?r", ontology);
    let actions = match offers {
        true => action(on, &term) + &action(off, &format!("(not {term})")),
        false => String::new(),
    };
    let has_type = ontology.types.iter().any(|known| known.name == agent);
    let types = if has_type { String::new() } else { format!("(:types {agent} - object)") };
    format!(
        "(define (agent {id}) (:domain {}) {types}
           (:predicates {} (installed ?d - object ?r - room))
           {}
           (:objects {id} - {agent}) (:init (installed {id} {room})) {actions})",
        ontology.name,
        words.predicates(ontology),
        words.axiom(ontology)
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
        own: Option<String>,
        #[serde(default)]
        all: bool,
        on: Option<String>,
        off: Option<String>,
    }

    #[test]
    fn the_words_are_those_of_the_gateway_to_mqtt() {
        let classes: BTreeMap<String, Class> = toml::from_str(CLASSES).expect("its table");
        for (kind, class) in [(Kind::Lamp, "light"), (Kind::Relay, "switch"), (Kind::Lock, "lock")]
        {
            let Class { agent, state, own, all, on, off } = &classes[class];
            let (words, (turn_on, turn_off)) = (kind.words(), kind.actions());
            assert_eq!((agent.as_str(), *all), (words.agent, words.all), "{class}");
            let theirs = [state, own, on, off].map(|word| word.as_deref());
            let ours = [words.state, words.own, turn_on, turn_off].map(Some);
            assert_eq!(theirs, ours, "{class}");
        }
    }
}
