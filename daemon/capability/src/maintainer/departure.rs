//! What an agent leaves behind that nobody knows any more.
//!
//! An agent that goes takes its objects and its facts along. A fact that it answered for and that is
//! about things which stay, such as whether a room is lit, is neither true nor false from then on: it
//! is unknown, until the agent returns, another answers for it, or somebody says how it is.

use std::collections::BTreeSet;

use acl::AgentId;
use pddl::{Atom, Derived, Name, Term};

use super::Maintainer;
use crate::belief::{Claim, Source};
use crate::fact::{FactKey, Owner, Space, Value};
use crate::limits;
use crate::moment::Moment;
use crate::roster::Member;

impl Maintainer {
    /// What becomes unknown when an agent goes; to be asked while it is still here.
    pub(super) fn left_behind(&self, agent: &AgentId) -> Vec<FactKey> {
        let Some(member) = self.roster.get(agent) else { return Vec::new() };
        let owner = Owner::Agent(agent.clone());
        let findings = self.findings();
        let answered = member
            .answered()
            .filter(|fact| fact.space() == Space::Predicate && !findings.contains(fact.symbol()));
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

    /// From now on these are unknown.
    pub(super) fn leave_unknown(&mut self, agent: &AgentId, left: Vec<FactKey>, now: Moment) {
        if left.is_empty() {
            return;
        }
        let owner = Owner::Agent(agent.clone());
        for fact in left {
            if self.beliefs.has_room(&owner, 1).is_err() {
                return;
            }
            self.beliefs.claim(fact, &owner, Claim::new(Value::Unknown, Source::Departure, now));
        }
        self.departed.retain(|other| other != agent);
        self.departed.push_back(agent.clone());
        if self.departed.len() > limits::DEPARTED_MAX
            && let Some(oldest) = self.departed.pop_front()
        {
            self.forget_departed(&oldest);
        }
    }

    /// What an agent left behind is forgotten.
    pub(super) fn forget_departed(&mut self, agent: &AgentId) {
        let is_left = |_: &FactKey, claim: &Claim| claim.source == Source::Departure;
        self.beliefs.withdraw_where(&Owner::Agent(agent.clone()), is_left);
    }

    /// The predicates that say that something was found out: only actions that observe make them true.
    /// Without who has found it out they are false.
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

/// Whether an axiom derives from facts that this agent answers for.
fn rests_on(axiom: &Derived, member: &Member) -> bool {
    axiom.condition.atoms().any(|atom| member.speaks_of(Space::Predicate, &atom.predicate))
}

/// The facts that an axiom may derive from this one, where it determines them.
fn heads(axiom: &Derived, fact: &FactKey) -> Vec<FactKey> {
    let same = axiom.condition.atoms().filter(|atom| fact.is_of(Space::Predicate, &atom.predicate));
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
