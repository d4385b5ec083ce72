//! Verification of confirmed steps. If the next heartbeat of an agent contradicts the change that
//! the agent confirmed, the change was not made.
//!
//! A device updates its heartbeat before it confirms a change, so the last heartbeat usually agrees
//! with the change already. The Plan Executor waits for the next heartbeat only if the last one
//! contradicts the change.

use std::collections::BTreeMap;

use acl::content::{ChangeState, Heartbeat};
use acl::{AgentId, Incarnation};
use pddl::{Atom, InitElement};

/// The last heartbeat of every agent that is present, by agent.
#[derive(Debug, Default)]
pub struct LastHeartbeats(BTreeMap<AgentId, LastHeartbeat>);

#[derive(Debug)]
struct LastHeartbeat {
    received_as: (Incarnation, u64),
    facts: String,
}

/// A confirmed change that contradicts the last heartbeat of its agent.
#[derive(Clone, Debug)]
pub(crate) struct UnverifiedEffect {
    /// The ground action that the agent confirmed, under the agent's own name for it.
    pub(crate) action: String,
    change: ChangeState,
    /// Incarnation and sequence number of the heartbeat that contradicts the change. Only a later
    /// heartbeat can verify or refute the change.
    contradicted_by: (Incarnation, u64),
}

// === impl LastHeartbeats ===

impl LastHeartbeats {
    /// Stores a heartbeat, unless a newer one is stored.
    pub fn store_heartbeat(&mut self, agent: &AgentId, incarnation: Incarnation, beat: &Heartbeat) {
        let at = (incarnation, beat.sequence);
        if self.0.get(agent).is_some_and(|word| word.received_as >= at) {
            return;
        }
        let known = beat.known_for.keys().map(String::as_str);
        let facts = std::iter::once(beat.facts.as_str()).chain(known).collect::<Vec<_>>().join(" ");
        self.0.insert(agent.clone(), LastHeartbeat { received_as: at, facts });
    }

    /// Removes the heartbeat of an agent that has left.
    pub fn remove_agent(&mut self, agent: &AgentId) {
        self.0.remove(agent);
    }

    /// Compares a change that `agent` confirmed with the last heartbeat of that agent. Returns the
    /// change as unverified if the heartbeat contradicts it; otherwise `None`.
    pub(crate) fn check_effect(
        &self,
        agent: &AgentId,
        action: String,
        change: &ChangeState,
    ) -> Option<UnverifiedEffect> {
        let word = self.0.get(agent)?;
        contradiction(&word.facts, change)?;
        Some(UnverifiedEffect { action, change: change.clone(), contradicted_by: word.received_as })
    }

    /// Checks an unverified change (`doubt`) against a later heartbeat of `agent` than the
    /// contradicting one. Returns `None` if no later heartbeat has arrived, `Some(None)` if the
    /// later heartbeat does not contradict the change, and otherwise a fact in it that does.
    pub(crate) fn check_again(
        &self,
        agent: &AgentId,
        doubt: &UnverifiedEffect,
    ) -> Option<Option<String>> {
        let word = self.0.get(agent).filter(|word| word.received_as > doubt.contradicted_by)?;
        Some(contradiction(&word.facts, &doubt.change))
    }
}

/// Returns a fact in the heartbeat text `said` that contradicts a change; `None` if no fact does. A
/// fact contradicts the change if the change made it false, or made true a fact with the same
/// predicate and first argument but another value. For example, `(at robot here)` contradicts the
/// change to `(at robot there)`.
fn contradiction(said: &str, change: &ChangeState) -> Option<String> {
    let (said, believed, retracted) = (atoms(said), atoms(&change.believe), atoms(&change.retract));
    let about = |atom: &Atom| (atom.predicate.clone(), atom.arguments.first().cloned());
    let denies = |fact: &&Atom| {
        let is_other = |made: &Atom| !said.contains(made) && about(made) == about(fact);
        retracted.contains(fact) || believed.iter().any(is_other)
    };
    said.iter().find(denies).map(ToString::to_string)
}

fn atoms(text: &str) -> Vec<Atom> {
    let elements = pddl::parse_init_elements(text).value.unwrap_or_default();
    let atom = |element| match element {
        InitElement::Atom(atom) => Some(atom),
        _ => None,
    };
    elements.into_iter().filter_map(atom).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(said: &str, believe: &str, retract: &str, expected: Option<&str>) {
        let (believe, retract) = (believe.to_owned(), retract.to_owned());
        let change = ChangeState { believe, retract, owner: None };
        assert_eq!(contradiction(said, &change).as_deref(), expected, "{said}");
    }

    #[test]
    fn a_retracted_fact_and_another_value_contradict_the_change() {
        let (here, there) = ("(at r here)", "(at r there)");
        check(here, there, here, Some(here));
        check(here, there, "", Some(here));
        check("(open door) (at s here)", there, "(open door)", Some("(open door)"));
    }

    #[test]
    fn an_equal_or_unrelated_fact_does_not_contradict_the_change() {
        let there = "(at r there)";
        check(there, there, "(at r here)", None);
        check("(at s here) (speed r)", there, "(at r here)", None);
        check("(at r there) (at r hall)", there, "", None);
        check("", there, "(at r here)", None);
    }
}
