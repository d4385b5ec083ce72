//! What requests change beside facts: the metric, and which actions can be planned with. And how
//! what they changed reaches the maintainers of the actuators, who hear heartbeats only.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::content::{ActionOf, Requested, RequestedFact, RequestedSince};
use acl::{AgentId, Deadline};
use pddl::{Condition, InitElement, Metric, Name, Number, Problem};

use super::Maintainer;
use crate::belief::{Claim, Source};
use crate::change::{Change, text_of};
use crate::declined::Declined;
use crate::fact::{FactKey, Owner, Space, Statement, Value};
use crate::inputs::{Known, Requests, RequestsSince};
use crate::limits;
use crate::moment::Moment;
use crate::untold::Untold;

/// Of what is known for a while, a later end by less than this is no news: a message takes time.
const SAME_END_MS: u64 = 1_000;

type Of = (Name, Option<AgentId>);

// === impl Maintainer ===

impl Maintainer {
    /// Takes an action off by request, of one agent or of all: it keeps its schema, and nobody
    /// concerned is planned with. `action` is the name outside.
    ///
    /// # Errors
    ///
    /// If nobody concerned offers it, or too much is withheld already.
    pub fn withhold(
        &mut self,
        action: Name,
        agent: Option<AgentId>,
        now: Moment,
    ) -> Result<Change, Declined> {
        self.change_actions(&[(action, agent)], &[], now)
    }

    /// Gives back what [`withhold`](Maintainer::withhold) took, said in the same way.
    ///
    /// # Errors
    ///
    /// If it is not withheld.
    pub fn give_back(
        &mut self,
        action: Name,
        agent: Option<AgentId>,
        now: Moment,
    ) -> Result<Change, Declined> {
        self.change_actions(&[], &[(action, agent)], now)
    }

    /// Takes actions off and gives others back, all of them or none.
    ///
    /// # Errors
    ///
    /// If one of them nobody concerned offers, or is not withheld; or if too much is withheld.
    pub fn change_actions(
        &mut self,
        withhold: &[Of],
        give_back: &[Of],
        now: Moment,
    ) -> Result<Change, Declined> {
        let unknown = |(action, agent): &Of, is_given_back| Declined::UnknownAction {
            action: action.to_string(),
            agent: agent.clone(),
            is_given_back,
        };
        if let Some(of) = withhold.iter().find(|of| !self.is_offered(of)) {
            return Err(unknown(of, false));
        }
        if let Some(of) = give_back.iter().find(|of| !self.withheld.contains(*of)) {
            return Err(unknown(of, true));
        }
        let mut withheld = self.withheld.clone();
        give_back.iter().for_each(|of| {
            withheld.remove(of);
        });
        withheld.extend(withhold.iter().cloned());
        self.set_withheld(withheld)?;
        Ok(self.conclude(now))
    }

    fn is_offered(&self, (action, agent): &Of) -> bool {
        let composite = self.composed();
        { composite.offers.iter() }
            .filter(|(offerer, _)| agent.as_ref().is_none_or(|agent| agent == *offerer))
            .any(|(_, offered)| offered.iter().any(|offered| offered.outside == *action))
    }

    fn set_withheld(&mut self, withheld: BTreeSet<Of>) -> Result<(), Declined> {
        let limit = limits::WITHHELD_MAX;
        if withheld.len() > limit {
            return Err(Declined::TooMany { what: "actions withheld", limit });
        }
        self.is_changed |= self.withheld != withheld;
        self.withheld = withheld;
        Ok(())
    }

    /// Changes by request what plans are measured by; `None` is the map's metric again, or the
    /// total cost. Plans of another epoch may cost other than they said.
    ///
    /// # Errors
    ///
    /// If it means nothing in the composite domain.
    pub fn measure(&mut self, metric: Option<Metric>, now: Moment) -> Result<Change, Declined> {
        if let Some(metric) = &metric {
            let composite = self.composed();
            let problem = Problem {
                objects: Arc::clone(&composite.objects),
                goal: Condition::always(),
                metric: Some(metric.clone()),
                ..self.frame()
            };
            let mistakes = pddl::check_problem(&composite.domain, &problem);
            if let Some(mistake) = mistakes.into_iter().find(pddl::Diagnostic::is_error) {
                return Err(Declined::Meaningless { detail: mistake.to_string() });
            }
        }
        self.is_changed |= self.metric != metric;
        self.metric = metric;
        Ok(self.conclude(now))
    }

    /// Everything that requests changed and that no heartbeat says, for those who hear heartbeats
    /// only.
    pub fn requested(&self, now: Moment) -> Requested {
        let mut facts = Vec::new();
        for (fact, claims) in self.beliefs.claims() {
            for (owner, claim) in claims {
                if let Owner::Agent(agent) = owner {
                    facts.extend(self.told_of(agent, fact, claim, now));
                }
            }
        }
        let is_gone =
            |fact: &&(FactKey, Value)| self.beliefs.claim_of(&fact.0, &Owner::Map).is_none();
        let gone = self.shared.manifest.init.iter().filter(is_gone);
        let gone: Vec<InitElement> = gone.map(|(fact, value)| fact.element(*value)).collect();
        let of =
            |(action, agent): &Of| ActionOf { action: action.to_string(), agent: agent.clone() };
        Requested {
            facts,
            retracted: text_of(&gone),
            metric: self.metric.as_ref().map(ToString::to_string),
            withheld: self.withheld.iter().map(of).collect(),
        }
    }

    /// What of that is other than when this was asked last. `None` if there is more than facts to
    /// tell: when it is asked first, or where facts of the map are back or very many are other. What
    /// plans are measured by and what is withheld is not in it.
    pub fn requested_since(&mut self, now: Moment) -> Option<RequestedSince> {
        let Untold::These(untold) = self.beliefs.take_untold() else { return None };
        let is_back = |(fact, owner): &(FactKey, Owner)| {
            *owner == Owner::Map && self.beliefs.claim_of(fact, owner).is_some()
        };
        if untold.iter().any(is_back) {
            return None;
        }
        Some(self.words(&untold, now))
    }

    /// What is said now of these.
    fn words(&self, of: &BTreeSet<(FactKey, Owner)>, now: Moment) -> RequestedSince {
        let mut since = RequestedSince::default();
        let (mut told, mut gone) = (Vec::new(), Vec::new());
        for (fact, owner) in of {
            let claim = self.beliefs.stamped_claim_of(fact, owner);
            match (owner, claim) {
                (Owner::Map, Some(_)) => (),
                (Owner::Map, None) => gone.push(fact.element(any_value(fact))),
                // Nobody was told: its heartbeats say it.
                (Owner::Agent(agent), _) if self.says(agent, fact) => (),
                (Owner::Agent(agent), claim) => {
                    let word = claim.and_then(|(stamp, claim)| {
                        Some((stamp, self.told_of(agent, fact, claim, now)?))
                    });
                    match word {
                        Some(word) => told.push(word),
                        None => since.withdrawn.push(RequestedFact {
                            fact: fact.element(any_value(fact)).to_string(),
                            owner: agent.clone(),
                            known_for: None,
                        }),
                    }
                }
            }
        }
        // As they were said: of two numbers the later is believed.
        told.sort_by_key(|(stamp, _)| *stamp);
        since.facts = told.into_iter().map(|(_, told)| told).collect();
        since.retracted = text_of(&gone);
        since
    }

    // === of several that act apart, one goes on ===

    /// Another central maintainer acts where this one does not reach, or may: from now on it is noted
    /// what requests change here.
    pub fn part(&mut self) {
        self.beliefs.part();
    }

    /// All that could act elsewhere are here, and nobody has anything to tell.
    pub fn reunite(&mut self) {
        self.beliefs.reunite();
    }

    /// They meet again, and this one stands down: what requests changed here meanwhile, for the one
    /// that goes on. What it tells is right from now on.
    pub fn stand_down(&mut self, now: Moment) -> RequestedSince {
        let changed = match self.beliefs.reunite() {
            None => RequestedSince::default(),
            Some(Untold::These(changed)) => self.words(&changed, now),
            // Too much is other: all of it, but for what was withdrawn.
            Some(Untold::Any) => {
                let Requested { facts, retracted, .. } = self.requested(now);
                RequestedSince { facts, retracted, withdrawn: Vec::new() }
            }
        };
        self.beliefs.disown();
        changed
    }

    /// They meet again, and this one goes on: takes what requests changed at the other. Of what was
    /// changed at both, the word that was given here stands.
    ///
    /// # Errors
    ///
    /// If it is too much; what came before that is taken.
    pub fn reconcile(&mut self, changed: &RequestsSince, now: Moment) -> Result<Change, Declined> {
        let RequestsSince { facts, withdrawn, retracted } = changed;
        for fact in retracted {
            if let Statement::Is(key, _) = Statement::of(fact)
                && !self.beliefs.has_changed_apart(&key, &Owner::Map)
            {
                self.beliefs.withdraw(&key, &Owner::Map);
            }
        }
        for (agent, fact) in withdrawn {
            let Statement::Is(key, _) = Statement::of(fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            let known = self.beliefs.claim_of(&key, &owner);
            if known.is_some_and(|known| known.source.is_requested())
                && !self.beliefs.has_changed_apart(&key, &owner)
            {
                self.beliefs.withdraw(&key, &owner);
            }
        }
        for (agent, known) in facts {
            let Statement::Is(key, value) = Statement::of(&known.fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            if self.says(agent, &key) || self.beliefs.has_changed_apart(&key, &owner) {
                continue;
            }
            self.beliefs.has_room(&owner, 1)?;
            let claim = Claim::new(value, Source::Request, now).until(known.until);
            self.beliefs.claim(key, &owner, claim);
        }
        Ok(self.conclude(now))
    }

    /// A claim as it is told, if nobody learns of it from its owner's model or heartbeats.
    fn told_of(
        &self,
        owner: &AgentId,
        fact: &FactKey,
        claim: &Claim,
        now: Moment,
    ) -> Option<RequestedFact> {
        let is_said = !claim.source.is_requested() || self.says(owner, fact);
        if is_said || claim.until.is_some_and(|until| until <= now) {
            return None;
        }
        Some(RequestedFact {
            fact: fact.element(claim.value).to_string(),
            owner: owner.clone(),
            known_for: claim.until.map(|until| Deadline(until.since(now))),
        })
    }

    /// Whether an agent that is here says itself whether a fact is so.
    fn says(&self, agent: &AgentId, fact: &FactKey) -> bool {
        self.roster.get(agent).is_some_and(|member| member.owns(fact))
    }

    /// Whether it believes what another tells of requests: who does not need not read it.
    pub fn follows(&self) -> bool {
        self.follows
    }

    /// Believes what the central maintainer tells of requests: all of it, and nothing that it told
    /// before. The word of owners who are heard here themselves goes before it. The central
    /// maintainer that acts knows better than any other.
    ///
    /// # Errors
    ///
    /// If it is too much.
    pub fn follow(&mut self, requests: &Requests, now: Moment) -> Result<Change, Declined> {
        if !self.follows {
            return Ok(self.conclude(now));
        }
        self.adopt(requests, now)
    }

    /// Believes what the central maintainer tells of requests since it told last: the same, but that
    /// the rest of what it told before stays.
    ///
    /// # Errors
    ///
    /// If it is too much.
    pub fn follow_since(
        &mut self,
        requests: &RequestsSince,
        now: Moment,
    ) -> Result<Change, Declined> {
        if !self.follows {
            return Ok(self.conclude(now));
        }
        let RequestsSince { facts, withdrawn, retracted } = requests;
        self.retract_from_map(retracted);
        for (agent, fact) in withdrawn {
            let Statement::Is(key, _) = Statement::of(fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            let known = self.beliefs.claim_of(&key, &owner);
            if known.is_some_and(|known| known.source == Source::Told) {
                self.beliefs.withdraw(&key, &owner);
            }
        }
        for (agent, known) in facts {
            // That it is news is said with it.
            self.believe_told(agent, known, |_, _| true, now)?;
        }
        Ok(self.conclude(now))
    }

    /// Whether this central maintainer stands by, and follows what the one that acts tells of
    /// requests. When it acts itself, what it was told is its own to tell.
    pub fn stands_by(&mut self, stands_by: bool) {
        self.follows = stands_by;
        if !stands_by {
            self.beliefs.own_told();
        }
    }

    /// Believes again, as its own to tell, what requests had changed when it was kept.
    ///
    /// # Errors
    ///
    /// If it is too much.
    pub fn recall(&mut self, requests: &Requests, now: Moment) -> Result<Change, Declined> {
        let change = self.adopt(requests, now)?;
        self.beliefs.own_told();
        Ok(change)
    }

    fn adopt(&mut self, requests: &Requests, now: Moment) -> Result<Change, Declined> {
        let Requests { facts, retracted, metric, withheld } = requests;
        self.set_withheld(withheld.iter().cloned().collect())?;
        self.is_changed |= self.metric != *metric;
        self.metric.clone_from(metric);
        self.retract_from_map(retracted);
        let mut told: Vec<(FactKey, Owner)> = Vec::with_capacity(facts.len());
        for (agent, known) in facts {
            told.extend(self.believe_told(agent, known, is_other, now)?);
        }
        told.sort_unstable();
        self.beliefs.withdraw_told(&told);
        Ok(self.conclude(now))
    }

    fn retract_from_map(&mut self, facts: &[InitElement]) {
        for fact in facts {
            if let Statement::Is(key, _) = Statement::of(fact) {
                self.beliefs.withdraw(&key, &Owner::Map);
            }
        }
    }

    /// Believes a fact that is told, unless its owner is heard here itself.
    fn believe_told(
        &mut self,
        agent: &AgentId,
        known: &Known,
        is_news: fn(&Claim, &Claim) -> bool,
        now: Moment,
    ) -> Result<Option<(FactKey, Owner)>, Declined> {
        let Statement::Is(key, value) = Statement::of(&known.fact) else { return Ok(None) };
        let owner = Owner::Agent(agent.clone());
        let claim = Claim::new(value, Source::Told, now).until(known.until);
        let is_heard = self.says(agent, &key);
        let is_taken = match self.beliefs.claim_of(&key, &owner) {
            Some(known) => known.source == Source::Told && is_news(known, &claim),
            None => true,
        };
        if is_taken && !is_heard {
            self.beliefs.has_room(&owner, 1)?;
            self.wake_answering(&key);
            self.beliefs.claim(key.clone(), &owner, claim);
        }
        Ok(Some((key, owner)))
    }
}

/// Whether it is told otherwise than it was. Saying again what is known would make it newer than
/// another's word.
fn is_other(known: &Claim, told: &Claim) -> bool {
    let is_same_end = match (known.until, told.until) {
        (Some(known), Some(told)) => known.0.abs_diff(told.0) < SAME_END_MS,
        (known, told) => known == told,
    };
    !is_same_end || known.value != told.value
}

/// A value that a fact may have, where only the term counts.
fn any_value(fact: &FactKey) -> Value {
    match fact.space() {
        Space::Predicate => Value::True,
        Space::Function => Value::Number(Number(0.0)),
    }
}
