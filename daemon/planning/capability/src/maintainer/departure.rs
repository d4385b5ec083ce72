//! Facts that become unknown when an agent leaves.
//!
//! The objects and facts of an agent are removed with the agent. A fact that the agent was
//! responsible for may also be about objects that remain, for example whether a room is lit. Such a
//! fact then becomes unknown. It stays unknown until the agent returns, another agent becomes
//! responsible for it, or an observation or a request sets it.

use std::collections::BTreeSet;

use acl::AgentId;
use pddl::{Atom, Derived, Name, Term};

use super::Maintainer;
use crate::belief::FactClaim;
use crate::fact::{ClaimSource, FactKey, FactSymbolKind, FactValue, Owner};
use crate::known_agents::Member;
use crate::limits;
use crate::timestamp::Timestamp;

impl Maintainer {
    /// Returns the facts that become unknown when `agent` leaves. Must be called while the agent is
    /// still present.
    pub(super) fn facts_to_become_unknown(&self, agent: &AgentId) -> Vec<FactKey> {
        let Some(member) = self.roster.get(agent) else { return Vec::new() };
        let owner = Owner::Agent(agent.clone());
        let findings = self.findings();
        let answered = member.reported_facts().filter(|fact| {
            fact.space() == FactSymbolKind::Predicate && !findings.contains(fact.symbol())
        });
        let mut left: BTreeSet<FactKey> = answered.cloned().collect();
        let claimed: Vec<&FactKey> = self.beliefs.claims_by(&owner).map(|(fact, _)| fact).collect();
        for axiom in &self.composite.domain.derived {
            if !self.composite.knowledge.is_auxiliary(&axiom.predicate) && rests_on(axiom, member) {
                left.extend(claimed.iter().flat_map(|fact| heads(axiom, fact)));
            }
        }
        let objects = &self.composite.vocabulary.objects;
        let stays = |name: &Name| {
            objects.contains_key(name) && !member.described.manifest.objects.contains(name)
        };
        left.retain(|fact| fact.arguments().iter().all(stays));
        left.into_iter().collect()
    }

    /// Marks the facts `left` as unknown after `agent` has left.
    pub(super) fn leave_unknown(&mut self, agent: &AgentId, left: Vec<FactKey>, now: Timestamp) {
        if left.is_empty() {
            return;
        }
        let owner = Owner::Agent(agent.clone());
        for fact in left {
            if self.beliefs.has_room(&owner, 1).is_err() {
                return;
            }
            self.beliefs.claim(
                fact,
                &owner,
                FactClaim::new(FactValue::Unknown, ClaimSource::Departure, now),
            );
        }
        self.departed.retain(|other| other != agent);
        self.departed.push_back(agent.clone());
        if self.departed.len() > limits::DEPARTED_MAX
            && let Some(oldest) = self.departed.pop_front()
        {
            self.forget_departed(&oldest);
        }
    }

    /// Removes the marks of unknown facts that were made when `agent` left.
    pub(super) fn forget_departed(&mut self, agent: &AgentId) {
        let is_left = |_: &FactKey, claim: &FactClaim| claim.source == ClaimSource::Departure;
        self.beliefs.withdraw_where(&Owner::Agent(agent.clone()), is_left);
    }

    /// Returns the predicates that record a discovery: only observing actions make their facts
    /// true. If the agent with the discovery leaves, these facts become false, not unknown.
    fn findings(&self) -> BTreeSet<&Name> {
        let schemas = || self.composite.schemas.values().flatten().map(|stands| &*stands.tree);
        let (mut found, mut made) = (BTreeSet::new(), BTreeSet::new());
        for schema in schemas() {
            let into = if schema.observe.is_empty() { &mut made } else { &mut found };
            into.extend(schema.effect.added().map(|atom| &atom.predicate));
        }
        &found - &made
    }
}

/// Whether the condition of an axiom uses a predicate of which the agent's heartbeats list all true
/// facts.
fn rests_on(axiom: &Derived, member: &Member) -> bool {
    axiom
        .condition
        .atoms()
        .any(|atom| member.reports_symbol(FactSymbolKind::Predicate, &atom.predicate))
}

/// Returns the facts that an axiom may derive from `fact`, if `fact` determines all their
/// arguments.
pub(super) fn heads(axiom: &Derived, fact: &FactKey) -> Vec<FactKey> {
    let same = axiom
        .condition
        .atoms()
        .filter(|atom| fact.is_of(FactSymbolKind::Predicate, &atom.predicate));
    same.filter_map(|atom| head(axiom, atom, fact)).collect()
}

fn head(axiom: &Derived, atom: &Atom, fact: &FactKey) -> Option<FactKey> {
    let bound = |variable: &Name| {
        let mut pairs = atom.arguments.iter().zip(fact.arguments());
        pairs.find_map(|(term, object)| match term {
            Term::Variable(name) if name == variable => Some(Term::Object(object.clone())),
            _ => None,
        })
    };
    let arguments: Option<Vec<Term>> =
        axiom.parameters.iter().map(|parameter| bound(&parameter.name)).collect();
    FactKey::of_predicate(&axiom.predicate, &arguments?)
}
