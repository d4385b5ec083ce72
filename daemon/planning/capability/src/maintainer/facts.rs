//! Changes of facts: by heartbeats, confirmed actions, requests, observations and models.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::{AgentId, Incarnation};
use pddl::{Atom, InitElement};

use super::Maintainer;
use crate::belief::FactClaim;
use crate::change::DomainChange;
use crate::declined::Declined;
use crate::fact::{ClaimSource, FactKey, FactStatement, FactValue, Owner};
use crate::inputs::{Effects, KnownFact, ParsedHeartbeat, RepeatedHeartbeat};
use crate::known_agents::Member;
use crate::limits;
use crate::timestamp::Timestamp;

// === impl Maintainer ===

impl Maintainer {
    /// Applies a heartbeat, which lists all true facts that its agent owns. The agent owns the
    /// facts that its model states and its actions can change, and all facts with symbols that its
    /// heartbeats have ever contained. An owned fact that is missing is false; an owned fact that
    /// is reported as `(unknown FACT)` is unknown. For facts that the agent is responsible for, the
    /// heartbeat overrides requests and the effects of other agents' actions.
    ///
    /// A new incarnation of an agent need not announce its model again if the model is unchanged.
    ///
    /// # Errors
    ///
    /// Returns an error in three cases: the heartbeat is late, because it is of a former
    /// incarnation or a newer one has arrived; this incarnation of the agent has not announced its
    /// model; or there are too many facts.
    pub fn apply_heartbeat(
        &mut self,
        beat: ParsedHeartbeat,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let ParsedHeartbeat { agent, incarnation, sequence, digest, facts, period } = beat;
        self.roster.check(&agent, incarnation)?;
        if facts.len() > limits::FACTS_PER_OWNER_MAX {
            let limit = limits::FACTS_PER_OWNER_MAX;
            return Err(Declined::TooMany { what: "facts of one owner", limit });
        }
        self.revive(&agent, incarnation, &digest, now);
        let current = self.roster.current(&agent, incarnation)?.sequence;
        if sequence <= current {
            return Err(Declined::OldSequence { agent, reported: sequence, current });
        }
        let due = period.map(|period| now.after(self.silence.of_period(period)));
        self.roster.record_heartbeat(&agent, sequence, due, now)?;
        let mut said = BTreeSet::new();
        let mut denied = Vec::new();
        let mut claims = Vec::new();
        for known in &facts {
            let (key, value) = match FactStatement::of(&known.fact) {
                FactStatement::Is(key, value) => (key, Some(value)),
                FactStatement::Not(key) => (key, None),
                FactStatement::Unusable => continue,
            };
            self.roster.own(&agent, &key);
            if value.is_none() {
                denied.push(key.clone());
            }
            let is_known = known.until.is_none_or(|until| until > now);
            if let Some(value) = value.filter(|_| is_known) {
                said.insert(key.clone());
                claims.push((
                    key,
                    FactClaim::new(value, ClaimSource::Heartbeat, now).until(known.until),
                ));
            }
        }
        let owner = Owner::Agent(agent.clone());
        let member = self.roster.current(&agent, incarnation)?;
        member.read = sequence;
        self.beliefs.withdraw_facts(&owner, |fact| !said.contains(fact) && member.owns(fact));
        let lasts = facts.iter().all(|known| known.until.is_none());
        for (key, claim) in claims {
            self.beliefs.claim(key, &owner, FactClaim { incarnation, sequence, ..claim });
        }
        // The claim of the map must be withdrawn last, because the map never makes it again.
        denied.iter().for_each(|key| self.beliefs.withdraw(key, &Owner::Map));
        self.override_others(&agent, &owner);
        if lasts {
            self.beliefs.mark_unchanged(owner);
        }
        Ok(self.take_change(now))
    }

    /// Applies a heartbeat that equals the last one, without parsing it (fast path). Each second,
    /// nearly all of a thousand agents send such heartbeats. Returns `None` if the heartbeat must
    /// be parsed, because the last heartbeat received here was a different one or the agent's
    /// claims have changed since.
    pub fn believe_repeated(
        &mut self,
        repeated: &RepeatedHeartbeat<'_>,
        now: Timestamp,
    ) -> Option<DomainChange> {
        let RepeatedHeartbeat { agent, incarnation, digest, before, sequence, period } = *repeated;
        let is_it = |member: &&Member| {
            member.incarnation == incarnation
                && member.sequence == before
                && sequence > before
                && *member.described.digest == *digest
        };
        self.roster.get(agent).filter(is_it)?;
        if !self.beliefs.is_calm(&Owner::Agent(agent.clone())) {
            return None;
        }
        let due = now.after(self.silence.of_period(period));
        self.roster.record_heartbeat(agent, sequence, Some(due), now).ok()?;
        Some(self.take_change(now))
    }

    /// Withdraws claims about facts that `agent` is responsible for and does not report itself, if
    /// they come from requests or from effects of other agents' actions. If the claiming agent is
    /// also responsible for the fact, its claim stays until its next heartbeat: of two thermometers
    /// in a room, only one may have measured.
    fn override_others(&mut self, agent: &AgentId, owner: &Owner) {
        let Some(member) = self.roster.get(agent) else { return };
        let mut over = Vec::new();
        for (space, symbol) in member.symbols() {
            for (fact, other) in self.beliefs.requested_of(*space, symbol) {
                let is_so = || {
                    let own = self.beliefs.claim_of(fact, owner);
                    own.is_some_and(|own| own.value == FactValue::True)
                };
                let is_overridden = other != owner && member.is_responsible_for(fact) && !is_so();
                if is_overridden && !self.answers_for(other, fact) {
                    over.push((fact.clone(), other.clone()));
                }
            }
        }
        over.iter().for_each(|(fact, other)| self.beliefs.withdraw(fact, other));
    }

    /// Whether the owner of a claim is an agent that is responsible for the fact.
    fn answers_for(&self, owner: &Owner, fact: &FactKey) -> bool {
        let Owner::Agent(agent) = owner else { return false };
        self.roster.get(agent).is_some_and(|member| member.is_responsible_for(fact))
    }

    /// Ensures that the next heartbeats of all agents that are responsible for `fact` are parsed,
    /// because the fact was requested or follows from another agent's action.
    pub(super) fn wake_answering(&mut self, fact: &FactKey) {
        for agent in self.roster.answering(fact) {
            self.beliefs.wake(&Owner::Agent(agent.clone()));
        }
    }

    /// Starts a new incarnation of an agent, if the agent's model is unchanged.
    fn revive(&mut self, agent: &AgentId, incarnation: Incarnation, digest: &str, now: Timestamp) {
        let former = self.roster.get(agent).filter(|member| {
            member.incarnation < incarnation && *member.described.digest == *digest
        });
        if let Some(member) = former.cloned() {
            self.upsert_member(agent, Member::new(incarnation, member.described, now), now);
        }
    }

    /// Applies the effects of an action that `agent` confirmed. The effects hold until the agent's
    /// own heartbeats override them. All claims about facts that become false are withdrawn until
    /// their owners make them again.
    ///
    /// # Errors
    ///
    /// Returns an error if the confirmation is of a former incarnation, or if the agent has not
    /// announced its model.
    pub fn apply_effects(
        &mut self,
        agent: &AgentId,
        incarnation: Option<Incarnation>,
        effects: &Effects,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let unknown = || Declined::UnknownAgent { agent: agent.clone() };
        let current = self.roster.get(agent).map(|member| member.incarnation);
        let incarnation = incarnation.or(current).ok_or_else(unknown)?;
        let sequence = self.roster.current(agent, incarnation)?.sequence;
        let claim = FactClaim::new(FactValue::True, ClaimSource::Effect, now);
        let claim = FactClaim { incarnation, sequence, ..claim };
        self.take_effect(&Owner::Agent(agent.clone()), effects, &claim)?;
        Ok(self.take_change(now))
    }

    /// Changes the state by request. The requested facts become claims of `owner`, which may be an
    /// agent without a model.
    ///
    /// # Errors
    ///
    /// Returns an error if a present agent that is responsible for one of the facts contradicts the
    /// request, if the cost of plans would become negative, or if the owner or all owners together
    /// would exceed a limit.
    pub fn apply_request(
        &mut self,
        owner: &Owner,
        effects: &Effects,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        self.may_be_set(owner, effects)?;
        self.take_effect(
            owner,
            effects,
            &FactClaim::new(FactValue::True, ClaimSource::Request, now),
        )?;
        Ok(self.take_change(now))
    }

    fn may_be_set(&self, owner: &Owner, effects: &Effects) -> Result<(), Declined> {
        let retracted = effects.retract.iter().map(|fact| (fact, true));
        let believed = effects.believe.iter().map(|fact| (fact, false));
        for (fact, is_retracted) in retracted.chain(believed) {
            let (key, value) = match FactStatement::of(fact) {
                FactStatement::Is(key, _) if is_retracted => (key, None),
                FactStatement::Is(key, value) => (key, Some(value)),
                FactStatement::Not(key) => (key, None),
                FactStatement::Unusable => continue,
            };
            if let Some(declined) = self.contradicted(owner, fact, &key, value) {
                return Err(declined);
            }
            if value.is_some_and(|value| self.composed().is_negative_cost(&key, value)) {
                let function = key.symbol().to_string();
                return Err(Declined::NegativeCost { fact: fact.to_string(), function });
            }
        }
        Ok(())
    }

    /// Returns the reason to decline a requested change of a fact: a present agent is responsible
    /// for the fact and contradicts the request. Returns `None` if no agent does.
    fn contradicted(
        &self,
        speaker: &Owner,
        fact: &InitElement,
        key: &FactKey,
        value: Option<FactValue>,
    ) -> Option<Declined> {
        let here = { self.roster.answering(key).into_iter() }
            .filter(|agent| self.is_present(agent))
            .map(|agent| Owner::Agent(agent.clone()))
            .filter(|owner| owner != speaker);
        let said = |owner: Owner| {
            let said = self.beliefs.claim_of(key, &owner).map(|claim| claim.value);
            (owner, said)
        };
        let said: Vec<_> = here.map(said).collect();
        let agrees = |(_, said): &(Owner, Option<FactValue>)| *said == value;
        // One owner is enough to confirm a fact. All owners must agree to deny it.
        if value.is_some() && said.iter().any(agrees) {
            return None;
        }
        let (owner, said) = said.into_iter().find(|said| !agrees(said))?;
        let about = said.map(|said| key.element(said)).or_else(|| self.about(key, &owner));
        let (fact, says) = (fact.to_string(), about.map(|about| about.to_string()));
        Some(Declined::Owned { fact, owner: owner.to_string(), says })
    }

    /// Returns a fact that `owner` claims and that has the same symbol and the same first object as
    /// `key`; `None` if there is no such fact.
    fn about(&self, key: &FactKey, owner: &Owner) -> Option<InitElement> {
        let is_alike = |(other, _): &(&FactKey, &FactClaim)| {
            other.is_of(key.space(), key.symbol())
                && key.arguments().len() > 1
                && other.arguments().first() == key.arguments().first()
        };
        let alike = self.beliefs.claims_by(owner).find(is_alike);
        alike.map(|(other, claim)| other.element(claim.value))
    }

    /// Applies an observation of an agent. The observed facts become claims of the agent, until
    /// they expire or a later observation or heartbeat of the agent contradicts them. All claims
    /// about facts that the agent observed to be false are withdrawn until an owner makes them
    /// again.
    ///
    /// # Errors
    ///
    /// Returns an error if the owner, or all owners together, would exceed a limit.
    pub fn apply_observation(
        &mut self,
        agent: &AgentId,
        observed: &[KnownFact],
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let owner = Owner::Agent(agent.clone());
        self.beliefs.has_room(&owner, observed.len())?;
        let incarnation = self.roster.get(agent).map(|member| member.incarnation);
        let incarnation = incarnation.unwrap_or_default();
        let statement = |known: &KnownFact| (FactStatement::of(&known.fact), known.until);
        let (mut seen, mut unseen) = (Vec::new(), Vec::new());
        for (statement, until) in observed.iter().map(statement) {
            match statement {
                FactStatement::Is(key, value) => seen.push((key, value, until)),
                FactStatement::Not(key) => unseen.push(key),
                FactStatement::Unusable => (),
            }
        }
        unseen.iter().for_each(|key| self.beliefs.withdraw_all(key));
        for (key, value, until) in seen {
            self.wake_answering(&key);
            let claim = FactClaim::new(value, ClaimSource::Observation, now).until(until);
            self.beliefs.claim(key, &owner, FactClaim { incarnation, ..claim });
        }
        Ok(self.take_change(now))
    }

    /// Withdraws all claims about `facts` until an owner makes them again.
    pub fn retract(&mut self, facts: &[InitElement], now: Timestamp) -> DomainChange {
        for fact in facts {
            self.disbelieve(fact);
        }
        self.take_change(now)
    }

    fn take_effect(
        &mut self,
        owner: &Owner,
        effects: &Effects,
        claim: &FactClaim,
    ) -> Result<(), Declined> {
        let Effects { believe, retract } = effects;
        if !believe.is_empty() {
            self.beliefs.has_room(owner, believe.len())?;
        }
        // Derived facts cannot be claimed. Of the symbols that planning adds to the domain, only
        // those that mark a fact as known have a meaning here.
        let composite = Arc::clone(&self.composite);
        // An unknown derived fact can be retracted, because an agent that has left may have left it
        // behind.
        let is_left = |fact: &InitElement| matches!(fact, InitElement::Unknown(_));
        for fact in retract.iter().filter(|fact| is_left(fact) || !composite.derives(fact)) {
            self.disbelieve(fact);
        }
        let is_fact = |fact: &&InitElement| match fact {
            InitElement::Atom(atom) | InitElement::Unknown(atom) => {
                !composite.knowledge.is_auxiliary(&atom.predicate)
            }
            _ => true,
        };
        let facts = believe.iter().filter(|fact| !composite.derives(fact)).filter(is_fact);
        let statements: Vec<FactStatement> = facts.map(FactStatement::of).collect();
        // As in PDDL, a fact that is both deleted and added becomes true.
        for statement in &statements {
            if let FactStatement::Not(key) = statement {
                self.beliefs.withdraw_all(key);
            }
        }
        for statement in statements {
            if let FactStatement::Is(key, value) = statement {
                self.wake_answering(&key);
                self.beliefs.claim(key, owner, FactClaim { value, ..claim.clone() });
            }
        }
        Ok(())
    }

    fn disbelieve(&mut self, fact: &InitElement) {
        if let InitElement::Atom(atom) = fact
            && let Some(symbol) = self.composite.knowledge.unknown_by(&atom.predicate).cloned()
        {
            return self.withdraw_unknown(&Atom { predicate: symbol, ..atom.clone() });
        }
        match FactStatement::of(fact) {
            FactStatement::Is(key, _) | FactStatement::Not(key) => self.beliefs.withdraw_all(&key),
            FactStatement::Unusable => (),
        }
    }

    /// Withdraws all claims that `fact` is unknown, because an action has made the fact known.
    fn withdraw_unknown(&mut self, fact: &Atom) {
        let FactStatement::Is(key, _) = FactStatement::of(&InitElement::Unknown(fact.clone()))
        else {
            return;
        };
        let unknown = { self.beliefs.claims_of(&key) }
            .filter(|(_, claim)| claim.value == FactValue::Unknown)
            .map(|(owner, _)| owner.clone());
        for owner in unknown.collect::<Vec<_>>() {
            self.beliefs.withdraw(&key, &owner);
        }
    }

    /// Claims the facts of an agent's model, except those that the agent's heartbeats already
    /// cover.
    pub(super) fn believe_model(&mut self, owner: &Owner, member: &Member, now: Timestamp) {
        let claim = FactClaim::new(FactValue::True, ClaimSource::Model, now);
        let claim = FactClaim { incarnation: member.incarnation, ..claim };
        let spoken = |fact: &FactKey| member.sequence > 0 && member.owns(fact);
        for (fact, value) in member.described.manifest.init.iter().filter(|(fact, _)| !spoken(fact))
        {
            if self.beliefs.claim_of(fact, owner).is_none() {
                self.beliefs.claim(
                    fact.clone(),
                    owner,
                    FactClaim { value: *value, ..claim.clone() },
                );
            }
        }
    }

    pub(super) fn believe_map(&mut self) {
        let start = Timestamp::default();
        for (fact, value) in &self.shared.manifest.init {
            let claim = FactClaim::new(*value, ClaimSource::Model, start);
            self.beliefs.claim(fact.clone(), &Owner::Map, claim);
        }
        // The initial state of a maintainer does not count as a change.
        self.beliefs.recompute(&self.composite, start);
        self.beliefs.take_moved();
    }
}
