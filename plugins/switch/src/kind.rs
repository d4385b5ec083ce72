//! The kinds of switches, and the PDDL names of their action models. The names are those that the MQTT
//! gateway uses for its lamps, relays and locks, so that one ecosystem can have both.

use actuator::OnOffPredicates;
use pddl::Domain;
use serde::Deserialize;

/// The kind of a switched device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SwitchKind {
    Lamp,
    Relay,
    Lock,
}

impl SwitchKind {
    /// Returns the predicates that say that the device is on: one of the device itself, and one of its
    /// room.
    pub(crate) fn words(self) -> OnOffPredicates<'static> {
        let words = |agent, state, own, all| OnOffPredicates { agent, state, own, all };
        match self {
            SwitchKind::Lamp => words("lamp", "lit", "lamp-on", false),
            SwitchKind::Relay => words("relay", "powered", "relay-on", false),
            SwitchKind::Lock => words("door-lock", "locked", "bolted", true),
        }
    }

    /// Returns the names of the actions that switch the device on and off.
    pub(crate) fn actions(self) -> (&'static str, &'static str) {
        match self {
            SwitchKind::Lamp => ("turn-on-lamp", "turn-off-lamp"),
            SwitchKind::Relay => ("turn-on-relay", "turn-off-relay"),
            SwitchKind::Lock => ("lock-door", "unlock-door"),
        }
    }

    /// Returns the state of the device as a text for people.
    pub(crate) fn state_text(self, is_on: bool) -> &'static str {
        match (self, is_on) {
            (SwitchKind::Lock, true) => "locked",
            (SwitchKind::Lock, false) => "unlocked",
            (SwitchKind::Lamp | SwitchKind::Relay, true) => "on",
            (SwitchKind::Lamp | SwitchKind::Relay, false) => "off",
        }
    }
}

/// Returns the action model of a switch, with the types and predicates that the shared ontology lacks. The
/// model has actions only if `offers` is `true`.
pub(crate) fn model(
    id: &str,
    room: &str,
    kind: SwitchKind,
    ontology: &Domain,
    offers: bool,
) -> String {
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

    /// The MQTT gateway's table of device classes, to compare the names with.
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
        for (kind, class) in
            [(SwitchKind::Lamp, "light"), (SwitchKind::Relay, "switch"), (SwitchKind::Lock, "lock")]
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
