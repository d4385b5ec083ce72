//! The kinds of switches, and their action models. All drivers and gateways use the same PDDL names
//! for lamps, relays and locks (`actuator::OnOffNames`).

use actuator::OnOffNames;
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
    /// Returns the PDDL names for devices of this kind.
    pub(crate) fn names(self) -> OnOffNames {
        match self {
            SwitchKind::Lamp => OnOffNames::LAMP,
            SwitchKind::Relay => OnOffNames::RELAY,
            SwitchKind::Lock => OnOffNames::DOOR_LOCK,
        }
    }

    /// Returns the state of the device, as text for people.
    pub(crate) fn state_text(self, is_on: bool) -> &'static str {
        match (self, is_on) {
            (SwitchKind::Lock, true) => "locked",
            (SwitchKind::Lock, false) => "unlocked",
            (SwitchKind::Lamp | SwitchKind::Relay, true) => "on",
            (SwitchKind::Lamp | SwitchKind::Relay, false) => "off",
        }
    }
}

/// Returns the action model of a switch, with the types and predicates that the shared ontology
/// lacks. The model has actions only if `offers` is `true`.
pub(crate) fn model(
    id: &str,
    room: &str,
    kind: SwitchKind,
    ontology: &Domain,
    offers: bool,
) -> String {
    let OnOffNames { predicates: words, on, off } = kind.names();
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
