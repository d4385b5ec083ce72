//! Rights of people, and roles: sets of rights with a name.

use std::collections::BTreeSet;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::person_name::PersonName;

/// A right of a person. Each right stands by itself: none contains another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PersonRight {
    /// To see the building: goals, agents, facts, and what happened.
    Look,
    /// To ask for goals and actions, to cancel them, and to answer questions of devices.
    Ask,
    /// To change the known facts.
    Change,
    /// To admit a discovered agent, or to reject it.
    Admit,
    /// To release a stop. Every person who is signed in may stop.
    Stop,
    /// To see what happened to private facts, where the daemon may.
    Secrets,
}

/// A named set of rights, for the command line. A file lists the rights, and not the role.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PersonRole {
    /// A person of the house: looks, asks, admits devices, releases stops.
    Caretaker,
    /// A guest at a screen: looks and asks.
    Visitor,
    /// A person responsible for the system: everything except what is private.
    Operator,
}

/// A person, with the rights that the file gives.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Person {
    /// The name of the person.
    pub name: PersonName,
    /// The rights of the person.
    pub rights: BTreeSet<PersonRight>,
    /// The agent on which the screen is, if this is no person, but the screen of an agent: it may
    /// look at this agent, answer its questions and stop it, and has no rights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screen: Option<String>,
}

// === impl PersonRight ===

impl PersonRight {
    /// All rights, in their order.
    pub const ALL: [PersonRight; 6] = [
        PersonRight::Look,
        PersonRight::Ask,
        PersonRight::Change,
        PersonRight::Admit,
        PersonRight::Stop,
        PersonRight::Secrets,
    ];

    /// Returns the word for the right, in files and on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            PersonRight::Look => "look",
            PersonRight::Ask => "ask",
            PersonRight::Change => "change",
            PersonRight::Admit => "admit",
            PersonRight::Stop => "stop",
            PersonRight::Secrets => "secrets",
        }
    }

    /// Returns the right for which `word` stands; `None` if there is none.
    pub fn parse(word: &str) -> Option<PersonRight> {
        PersonRight::ALL.into_iter().find(|right| right.as_str() == word)
    }
}

impl fmt::Display for PersonRight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

// === impl PersonRole ===

impl PersonRole {
    /// All roles, in their order.
    pub const ALL: [PersonRole; 3] =
        [PersonRole::Caretaker, PersonRole::Visitor, PersonRole::Operator];

    /// Returns the name of the role.
    pub fn as_str(self) -> &'static str {
        match self {
            PersonRole::Caretaker => "caretaker",
            PersonRole::Visitor => "visitor",
            PersonRole::Operator => "operator",
        }
    }

    /// Returns the rights of the role.
    pub fn rights(self) -> BTreeSet<PersonRight> {
        let rights: &[PersonRight] = match self {
            PersonRole::Visitor => &[PersonRight::Look, PersonRight::Ask],
            PersonRole::Caretaker => {
                &[PersonRight::Look, PersonRight::Ask, PersonRight::Admit, PersonRight::Stop]
            }
            PersonRole::Operator => &[
                PersonRight::Look,
                PersonRight::Ask,
                PersonRight::Change,
                PersonRight::Admit,
                PersonRight::Stop,
            ],
        };
        rights.iter().copied().collect()
    }
}

// === impl Person ===

impl Person {
    /// Whether the person has a right.
    pub fn may(&self, right: PersonRight) -> bool {
        self.screen.is_none() && self.rights.contains(&right)
    }

    /// Whether this is the screen of `agent`.
    pub fn is_screen_of(&self, agent: &str) -> bool {
        self.screen.as_deref() == Some(agent)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_rights_are_those_of_json() {
        for right in PersonRight::ALL {
            assert_eq!(PersonRight::parse(right.as_str()), Some(right));
            let json = serde_json::to_string(&right).expect("a word");
            assert_eq!(json, format!("\"{right}\""));
        }
        assert_eq!(PersonRight::parse("Look"), None);
        assert!(PersonRight::ALL.is_sorted());
    }

    #[test]
    fn no_role_sees_what_is_private() {
        for role in PersonRole::ALL {
            assert!(!role.rights().contains(&PersonRight::Secrets), "{role:?}");
            assert!(role.rights().contains(&PersonRight::Look), "{role:?}");
        }
    }
}
