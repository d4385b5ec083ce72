//! What the Domain Maintainer believes, and whom.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::{AgentId, Incarnation};
use pddl::{Atom, InitElement};

use super::Maintainer;
use crate::belief::{Claim, Source};
use crate::change::Change;
use crate::declined::Declined;
use crate::fact::{FactKey, Owner, Statement, Value};
use crate::inputs::{Beat, Effects, Known, Repeated, silent_from};
use crate::limits;
use crate::moment::Moment;
use crate::roster::Member;

// === impl Maintainer ===

impl Maintainer {
    /// Believes a heartbeat. It is complete for what its agent owns (what it knows from the
    /// start and can change, and whatever its heartbeats ever spoke of): of that, what it does
    /// not say is false, and what it says is `(unknown FACT)` is unknown. For facts that the agent
    /// answers for, its word overrides what requests and the effects of others made believed.
    ///
    /// A new life of an agent with the model of the former one needs no new model.
    ///
    /// # Errors
    ///
    /// If it is late, of a former life or overtaken by a newer heartbeat; if the agent, or this
    /// life of it, has not told its model; or if it says too much.
    pub fn believe_heartbeat(&mut self, beat: Beat, now: Moment) -> Result<Change, Declined> {
        let Beat { agent, incarnation, sequence, digest, facts, due } = beat;
        self.roster.check(&agent, incarnation)?;
        if facts.len() > limits::FACTS_PER_OWNER_MAX {
            let limit = limits::FACTS_PER_OWNER_MAX;
            return Err(Declined::TooMany { what: "facts of one owner", limit });
        }
        self.revive(&agent, incarnation, &digest, now);
        let current = self.roster.living(&agent, incarnation)?.sequence;
        if sequence <= current {
            return Err(Declined::OldSequence { agent, reported: sequence, current });
        }
        self.roster.hear(&agent, sequence, due, now)?;
        let mut said = BTreeSet::new();
        let mut denied = Vec::new();
        let mut claims = Vec::new();
        for known in &facts {
            let (key, value) = match Statement::of(&known.fact) {
                Statement::Is(key, value) => (key, Some(value)),
                Statement::Not(key) => (key, None),
                Statement::Unusable => continue,
            };
            self.roster.own(&agent, &key);
            if value.is_none() {
                denied.push(key.clone());
            }
            let is_known = known.until.is_none_or(|until| until > now);
            if let Some(value) = value.filter(|_| is_known) {
                said.insert(key.clone());
                claims.push((key, Claim::new(value, Source::Heartbeat, now).until(known.until)));
            }
        }
        let owner = Owner::Agent(agent.clone());
        let member = self.roster.living(&agent, incarnation)?;
        member.read = sequence;
        self.beliefs.withdraw_facts(&owner, |fact| !said.contains(fact) && member.owns(fact));
        let lasts = facts.iter().all(|known| known.until.is_none());
        for (key, claim) in claims {
            self.beliefs.claim(key, &owner, Claim { incarnation, sequence, ..claim });
        }
        // The map's word is the last that goes: it is not said again.
        denied.iter().for_each(|key| self.beliefs.withdraw(key, &Owner::Map));
        self.override_others(&agent, &owner);
        if lasts {
            self.beliefs.calm(owner);
        }
        Ok(self.conclude(now))
    }

    /// Believes a heartbeat that says what the last one said, which needs not be read then: of a
    /// thousand agents nearly all say every second what they said before. `None` if it has to be read
    /// all the same: the last one heard here was another, or something has happened to what it said.
    pub fn believe_repeated(&mut self, repeated: &Repeated<'_>, now: Moment) -> Option<Change> {
        let Repeated { agent, incarnation, digest, before, sequence, period } = *repeated;
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
        self.roster.hear(agent, sequence, Some(silent_from(period, now)), now).ok()?;
        Some(self.conclude(now))
    }

    /// Believes no other about what an agent answers for and does not say itself: what requests and
    /// the effects of others' actions made believed ends with the word of who knows.
    fn override_others(&mut self, agent: &AgentId, owner: &Owner) {
        let Some(member) = self.roster.get(agent) else { return };
        let mut over = Vec::new();
        for (space, symbol) in member.symbols() {
            for (fact, other) in self.beliefs.requested_of(*space, symbol) {
                let is_so = || {
                    let own = self.beliefs.claim_of(fact, owner);
                    own.is_some_and(|own| own.value == Value::True)
                };
                if other != owner && member.answers(fact) && !is_so() {
                    over.push((fact.clone(), other.clone()));
                }
            }
        }
        over.iter().for_each(|(fact, other)| self.beliefs.withdraw(fact, other));
    }

    /// A fact was requested, or follows from another's action: who answers for it is to be heard whole.
    pub(super) fn wake_answering(&mut self, fact: &FactKey) {
        for agent in self.roster.answering(fact) {
            self.beliefs.wake(&Owner::Agent(agent.clone()));
        }
    }

    /// Begins a new life of an agent that has the model of its former one.
    fn revive(&mut self, agent: &AgentId, incarnation: Incarnation, digest: &str, now: Moment) {
        let former = self.roster.get(agent).filter(|member| {
            member.incarnation < incarnation && *member.described.digest == *digest
        });
        if let Some(member) = former.cloned() {
            self.seat(agent, Member::new(incarnation, member.described, now), now);
        }
    }

    /// Believes the effects of an action that `agent` confirmed, until the agent's own word
    /// overrides them. What they make false is false whoever claimed it, until that owner's
    /// word.
    ///
    /// # Errors
    ///
    /// If the confirmation is of a former life, or the agent is not here.
    pub fn confirm(
        &mut self,
        agent: &AgentId,
        incarnation: Option<Incarnation>,
        effects: &Effects,
        now: Moment,
    ) -> Result<Change, Declined> {
        let unknown = || Declined::UnknownAgent { agent: agent.clone() };
        let current = self.roster.get(agent).map(|member| member.incarnation);
        let incarnation = incarnation.or(current).ok_or_else(unknown)?;
        let sequence = self.roster.living(agent, incarnation)?.sequence;
        let claim = Claim::new(Value::True, Source::Effect, now);
        let claim = Claim { incarnation, sequence, ..claim };
        self.take_effect(&Owner::Agent(agent.clone()), effects, &claim)?;
        Ok(self.conclude(now))
    }

    /// Changes the state by request, on the word of `owner`, who need not have a model.
    ///
    /// # Errors
    ///
    /// If an agent that is here answers for one of the facts and says otherwise; if plans would cost
    /// less than nothing by it; or if the owner, or all owners, would claim too much.
    pub fn set(
        &mut self,
        owner: &Owner,
        effects: &Effects,
        now: Moment,
    ) -> Result<Change, Declined> {
        self.may_be_set(owner, effects)?;
        self.take_effect(owner, effects, &Claim::new(Value::True, Source::Request, now))?;
        Ok(self.conclude(now))
    }

    fn may_be_set(&self, owner: &Owner, effects: &Effects) -> Result<(), Declined> {
        let retracted = effects.retract.iter().map(|fact| (fact, true));
        let believed = effects.believe.iter().map(|fact| (fact, false));
        for (fact, is_retracted) in retracted.chain(believed) {
            let (key, value) = match Statement::of(fact) {
                Statement::Is(key, _) if is_retracted => (key, None),
                Statement::Is(key, value) => (key, Some(value)),
                Statement::Not(key) => (key, None),
                Statement::Unusable => continue,
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

    /// Who is here, answers for a fact and says otherwise.
    fn contradicted(
        &self,
        speaker: &Owner,
        fact: &InitElement,
        key: &FactKey,
        value: Option<Value>,
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
        let agrees = |(_, said): &(Owner, Option<Value>)| *said == value;
        // One owner is enough to confirm a fact; to deny it, all owners must agree.
        if value.is_some() && said.iter().any(agrees) {
            return None;
        }
        let (owner, said) = said.into_iter().find(|said| !agrees(said))?;
        let about = said.map(|said| key.element(said)).or_else(|| self.about(key, &owner));
        let (fact, says) = (fact.to_string(), about.map(|about| about.to_string()));
        Some(Declined::Owned { fact, owner: owner.to_string(), says })
    }

    /// What an owner says instead of a fact: of the same symbol and the same first object.
    fn about(&self, key: &FactKey, owner: &Owner) -> Option<InitElement> {
        let is_alike = |(other, _): &(&FactKey, &Claim)| {
            other.is_of(key.space(), key.symbol())
                && key.arguments().len() > 1
                && other.arguments().first() == key.arguments().first()
        };
        let alike = self.beliefs.claims_by(owner).find(is_alike);
        alike.map(|(other, claim)| other.element(claim.value))
    }

    /// Believes what `owner` observed: its own word, until it says otherwise, its heartbeats do or
    /// the time is over. What it saw not to be so is believed of nobody, until an owner says it
    /// again.
    ///
    /// # Errors
    ///
    /// If the owner, or all owners, would claim too much.
    pub fn observe(
        &mut self,
        agent: &AgentId,
        observed: &[Known],
        now: Moment,
    ) -> Result<Change, Declined> {
        let owner = Owner::Agent(agent.clone());
        self.beliefs.has_room(&owner, observed.len())?;
        let incarnation = self.roster.get(agent).map(|member| member.incarnation);
        let incarnation = incarnation.unwrap_or_default();
        let statement = |known: &Known| (Statement::of(&known.fact), known.until);
        let (mut seen, mut unseen) = (Vec::new(), Vec::new());
        for (statement, until) in observed.iter().map(statement) {
            match statement {
                Statement::Is(key, value) => seen.push((key, value, until)),
                Statement::Not(key) => unseen.push(key),
                Statement::Unusable => (),
            }
        }
        unseen.iter().for_each(|key| self.beliefs.withdraw_all(key));
        for (key, value, until) in seen {
            self.wake_answering(&key);
            let claim = Claim::new(value, Source::Observation, now).until(until);
            self.beliefs.claim(key, &owner, Claim { incarnation, ..claim });
        }
        Ok(self.conclude(now))
    }

    /// Believes nobody about `facts` any longer, until an owner says them again.
    pub fn retract(&mut self, facts: &[InitElement], now: Moment) -> Change {
        for fact in facts {
            self.disbelieve(fact);
        }
        self.conclude(now)
    }

    fn take_effect(
        &mut self,
        owner: &Owner,
        effects: &Effects,
        claim: &Claim,
    ) -> Result<(), Declined> {
        let Effects { believe, retract } = effects;
        if !believe.is_empty() {
            self.beliefs.has_room(owner, believe.len())?;
        }
        // What follows by axioms is nobody's word, and of what planning added to the domain only that
        // something is known now says anything.
        let composite = Arc::clone(&self.composite);
        // That something derived is unknown is what an agent that left has left behind.
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
        let statements: Vec<Statement> = facts.map(Statement::of).collect();
        // As in PDDL, what is both made false and made true is true.
        for statement in &statements {
            if let Statement::Not(key) = statement {
                self.beliefs.withdraw_all(key);
            }
        }
        for statement in statements {
            if let Statement::Is(key, value) = statement {
                self.wake_answering(&key);
                self.beliefs.claim(key, owner, Claim { value, ..claim.clone() });
            }
        }
        Ok(())
    }

    fn disbelieve(&mut self, fact: &InitElement) {
        if let InitElement::Atom(atom) = fact
            && let Some(symbol) = self.composite.knowledge.unknown_by(&atom.predicate).cloned()
        {
            return self.learn(&Atom { predicate: symbol, ..atom.clone() });
        }
        match Statement::of(fact) {
            Statement::Is(key, _) | Statement::Not(key) => self.beliefs.withdraw_all(&key),
            Statement::Unusable => (),
        }
    }

    /// An action has made a fact known: nobody is believed any more to whom it is unknown.
    fn learn(&mut self, fact: &Atom) {
        let Statement::Is(key, _) = Statement::of(&InitElement::Unknown(fact.clone())) else {
            return;
        };
        let unknown = { self.beliefs.claims_of(&key) }
            .filter(|(_, claim)| claim.value == Value::Unknown)
            .map(|(owner, _)| owner.clone());
        for owner in unknown.collect::<Vec<_>>() {
            self.beliefs.withdraw(&key, &owner);
        }
    }

    /// Believes what a model says is true, as far as the agent's heartbeats leave it room.
    pub(super) fn believe_model(&mut self, owner: &Owner, member: &Member, now: Moment) {
        let claim = Claim::new(Value::True, Source::Model, now);
        let claim = Claim { incarnation: member.incarnation, ..claim };
        let spoken = |fact: &FactKey| member.sequence > 0 && member.owns(fact);
        for (fact, value) in member.described.manifest.init.iter().filter(|(fact, _)| !spoken(fact))
        {
            if self.beliefs.claim_of(fact, owner).is_none() {
                self.beliefs.claim(fact.clone(), owner, Claim { value: *value, ..claim.clone() });
            }
        }
    }

    pub(super) fn believe_map(&mut self) {
        let start = Moment::default();
        for (fact, value) in &self.shared.manifest.init {
            let claim = Claim::new(*value, Source::Model, start);
            self.beliefs.claim(fact.clone(), &Owner::Map, claim);
        }
        // The state a maintainer begins with is no change.
        self.beliefs.settle(&self.composite, start);
        self.beliefs.take_moved();
    }
}
