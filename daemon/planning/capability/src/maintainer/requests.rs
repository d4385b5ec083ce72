//! Requests that change the metric of plans or the actions that planning may use. This module also
//! announces all requested changes to the maintainers of actuators, which otherwise receive only
//! heartbeats, and merges the changes of two central maintainers after a partition.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::content::{ActionOf, Requested, RequestedFact, RequestedSince};
use acl::{AgentId, Millis};
use pddl::{Condition, InitElement, Metric, Name, Number, Problem};

use super::Maintainer;
use crate::belief::FactClaim;
use crate::change::{DomainChange, text_of};
use crate::declined::Declined;
use crate::fact::{ClaimSource, FactKey, FactStatement, FactSymbolKind, FactValue, Owner};
use crate::inputs::{KnownFact, RequestedChanges, RequestedChangesSince};
use crate::limits;
use crate::pending_changes::PendingChanges;
use crate::timestamp::Timestamp;

/// Smallest difference between two expiry times of a fact that counts as a change, in milliseconds.
/// A smaller difference is ignored, because it arises from the time that messages take.
const SAME_END_MS: u64 = 1_000;

type ActionOfAgent = (Name, Option<AgentId>);

// === impl Maintainer ===

impl Maintainer {
    /// Withholds an action from planning by request: for one agent, or for all agents if `agent` is
    /// `None`. The action schema stays in the domain, but no plan uses it with these agents.
    /// `action` is the agents' own name for the action.
    ///
    /// # Errors
    ///
    /// Returns an error if none of the agents offers the action, or if too many actions are
    /// withheld.
    pub fn disable_action(
        &mut self,
        action: Name,
        agent: Option<AgentId>,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        self.change_actions(&[(action, agent)], &[], now)
    }

    /// Gives back an action that [`disable_action`](Maintainer::disable_action) withheld. The
    /// arguments must be the same as in that call.
    ///
    /// # Errors
    ///
    /// Returns an error if the action is not withheld.
    pub fn enable_action(
        &mut self,
        action: Name,
        agent: Option<AgentId>,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        self.change_actions(&[], &[(action, agent)], now)
    }

    /// Withholds some actions and gives others back. Either all of these changes take effect, or
    /// none.
    ///
    /// # Errors
    ///
    /// Returns an error if none of the agents offers an action to withhold, if an action to give
    /// back is not withheld, or if too many actions would be withheld.
    pub fn change_actions(
        &mut self,
        withhold: &[ActionOfAgent],
        give_back: &[ActionOfAgent],
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let unknown = |(action, agent): &ActionOfAgent, is_given_back| Declined::UnknownAction {
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
        Ok(self.take_change(now))
    }

    fn is_offered(&self, (action, agent): &ActionOfAgent) -> bool {
        let composite = self.composed();
        { composite.offers.iter() }
            .filter(|(offerer, _)| agent.as_ref().is_none_or(|agent| agent == *offerer))
            .any(|(_, offered)| offered.iter().any(|offered| offered.outside == *action))
    }

    fn set_withheld(&mut self, withheld: BTreeSet<ActionOfAgent>) -> Result<(), Declined> {
        let limit = limits::WITHHELD_MAX;
        if withheld.len() > limit {
            return Err(Declined::TooMany { what: "actions withheld", limit });
        }
        self.is_changed |= self.withheld != withheld;
        self.withheld = withheld;
        Ok(())
    }

    /// Sets the metric of plans by request. `None` restores the metric of the map, or the total
    /// cost if the map has none. A different metric begins a new epoch, because the costs of
    /// earlier plans may no longer be right.
    ///
    /// # Errors
    ///
    /// Returns an error if the metric does not fit the composite domain.
    pub fn set_metric(
        &mut self,
        metric: Option<Metric>,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
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
        Ok(self.take_change(now))
    }

    /// Returns all changes by requests that no heartbeat reports. They must be sent to agents that
    /// otherwise receive only heartbeats.
    pub fn requested(&self, now: Timestamp) -> Requested {
        let mut facts = Vec::new();
        for (fact, claims) in self.beliefs.claims() {
            for (owner, claim) in claims {
                if let Owner::Agent(agent) = owner {
                    facts.extend(self.announced_claim(agent, fact, claim, now));
                }
            }
        }
        let is_gone =
            |fact: &&(FactKey, FactValue)| self.beliefs.claim_of(&fact.0, &Owner::Map).is_none();
        let gone = self.shared.manifest.init.iter().filter(is_gone);
        let gone: Vec<InitElement> = gone.map(|(fact, value)| fact.element(*value)).collect();
        let of = |(action, agent): &ActionOfAgent| ActionOf {
            action: action.to_string(),
            agent: agent.clone(),
        };
        Requested {
            facts,
            retracted: text_of(&gone),
            metric: self.metric.as_ref().map(ToString::to_string),
            withheld: self.withheld.iter().map(of).collect(),
        }
    }

    /// Returns the changes by requests since the last call, without the metric and the withheld
    /// actions. Returns `None` if all of [`requested`](Maintainer::requested) must be sent instead:
    /// at the first call, if facts of the map hold again, or if very many facts have changed.
    pub fn requested_since(&mut self, now: Timestamp) -> Option<RequestedSince> {
        let PendingChanges::These(untold) = self.beliefs.take_untold() else { return None };
        let is_back = |(fact, owner): &(FactKey, Owner)| {
            *owner == Owner::Map && self.beliefs.claim_of(fact, owner).is_some()
        };
        if untold.iter().any(is_back) {
            return None;
        }
        Some(self.announced_claims(&untold, now))
    }

    /// Returns the current claims about the facts in `of` by the owners in `of`, as the content of
    /// a message to other maintainers.
    fn announced_claims(&self, of: &BTreeSet<(FactKey, Owner)>, now: Timestamp) -> RequestedSince {
        let mut since = RequestedSince::default();
        let (mut told, mut gone) = (Vec::new(), Vec::new());
        for (fact, owner) in of {
            let claim = self.beliefs.stamped_claim_of(fact, owner);
            match (owner, claim) {
                (Owner::Map, Some(_)) => (),
                (Owner::Map, None) => gone.push(fact.element(any_value(fact))),
                // The heartbeats of the owner report these facts, so they are not announced.
                (Owner::Agent(agent), _) if self.is_reported_by(agent, fact) => (),
                (Owner::Agent(agent), claim) => {
                    let word = claim.and_then(|(stamp, claim)| {
                        Some((stamp, self.announced_claim(agent, fact, claim, now)?))
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
        // The order is that of the claims, because the later of two numbers is believed.
        told.sort_by_key(|(stamp, _)| *stamp);
        since.facts = told.into_iter().map(|(_, told)| told).collect();
        since.retracted = text_of(&gone);
        since
    }

    // === partition and heal of several leaders ===

    /// Marks the start of a possible partition, in which another leader may be active. From now on,
    /// the maintainer records the claims that requests change, so that they can be merged when the
    /// partition heals.
    pub fn begin_partition_log(&mut self) {
        self.beliefs.begin_partition_log();
    }

    /// Ends the recording of a possible partition without a merge: every replica that could have
    /// been the other leader is connected again, and has no changes to merge.
    pub fn drop_partition_log(&mut self) {
        self.beliefs.take_partition_log();
    }

    /// Makes this maintainer a standby after a partition has healed. Returns the changes by
    /// requests since [`begin_partition_log`](Maintainer::begin_partition_log), for a merge by the
    /// surviving leader. From now on, this maintainer adopts the changes that the leader sends.
    pub fn stand_down(&mut self, now: Timestamp) -> RequestedSince {
        let changed = match self.beliefs.take_partition_log() {
            None => RequestedSince::default(),
            Some(PendingChanges::These(changed)) => self.announced_claims(&changed, now),
            // Too many claims have changed: all current claims are returned, but no withdrawn ones.
            Some(PendingChanges::All) => {
                let Requested { facts, retracted, .. } = self.requested(now);
                RequestedSince { facts, retracted, withdrawn: Vec::new() }
            }
        };
        self.beliefs.demote_requests();
        changed
    }

    /// Merges the changes that requests made at the other leader during a partition. This
    /// maintainer is the surviving leader: of claims that were changed at both, it keeps its own.
    ///
    /// # Errors
    ///
    /// Returns an error if a limit is exceeded. The changes before the failing one take effect.
    pub fn merge_partition_log(
        &mut self,
        changed: &RequestedChangesSince,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let RequestedChangesSince { facts, withdrawn, retracted } = changed;
        for fact in retracted {
            if let FactStatement::Is(key, _) = FactStatement::of(fact)
                && !self.beliefs.has_changed_apart(&key, &Owner::Map)
            {
                self.beliefs.withdraw(&key, &Owner::Map);
            }
        }
        for (agent, fact) in withdrawn {
            let FactStatement::Is(key, _) = FactStatement::of(fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            let known = self.beliefs.claim_of(&key, &owner);
            if known.is_some_and(|known| known.source.is_requested())
                && !self.beliefs.has_changed_apart(&key, &owner)
            {
                self.beliefs.withdraw(&key, &owner);
            }
        }
        for (agent, known) in facts {
            let FactStatement::Is(key, value) = FactStatement::of(&known.fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            if self.is_reported_by(agent, &key) || self.beliefs.has_changed_apart(&key, &owner) {
                continue;
            }
            self.beliefs.has_room(&owner, 1)?;
            let claim = FactClaim::new(value, ClaimSource::Request, now).until(known.until);
            self.beliefs.claim(key, &owner, claim);
        }
        Ok(self.take_change(now))
    }

    /// Returns a claim as the content of a message to other maintainers. Returns `None` if the
    /// owner's model or heartbeats report the fact, or if the claim has expired.
    pub(super) fn announced_claim(
        &self,
        owner: &AgentId,
        fact: &FactKey,
        claim: &FactClaim,
        now: Timestamp,
    ) -> Option<RequestedFact> {
        let is_said = !claim.source.is_requested() || self.is_reported_by(owner, fact);
        if is_said || claim.until.is_some_and(|until| until <= now) {
            return None;
        }
        Some(RequestedFact {
            fact: fact.element(claim.value).to_string(),
            owner: owner.clone(),
            known_for: claim.until.map(|until| Millis(until.since(now))),
        })
    }

    /// Whether `agent` is known and its heartbeats report whether `fact` holds.
    fn is_reported_by(&self, agent: &AgentId, fact: &FactKey) -> bool {
        self.roster.get(agent).is_some_and(|member| member.owns(fact))
    }

    /// Whether this maintainer adopts the changes by requests that the central maintainer sends. If
    /// not, the caller need not parse messages with these changes.
    pub fn is_follower(&self) -> bool {
        self.follows
    }

    /// Adopts all changes by requests that the central maintainer has sent, in place of those that
    /// it sent before. A fact does not change if its owner reports it to this maintainer in
    /// heartbeats. Has no effect on a maintainer that does not follow the central one.
    ///
    /// # Errors
    ///
    /// Returns an error if a limit is exceeded.
    pub fn apply_leader_requests(
        &mut self,
        requests: &RequestedChanges,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        if !self.follows {
            return Ok(self.take_change(now));
        }
        self.adopt(requests, now)
    }

    /// Adopts the changes by requests that the central maintainer has made since it last sent
    /// changes. Changes that it sent earlier stay.
    ///
    /// # Errors
    ///
    /// Returns an error if a limit is exceeded.
    pub fn follow_since(
        &mut self,
        requests: &RequestedChangesSince,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        if !self.follows {
            return Ok(self.take_change(now));
        }
        let RequestedChangesSince { facts, withdrawn, retracted } = requests;
        self.retract_from_map(retracted);
        for (agent, fact) in withdrawn {
            let FactStatement::Is(key, _) = FactStatement::of(fact) else { continue };
            let owner = Owner::Agent(agent.clone());
            let known = self.beliefs.claim_of(&key, &owner);
            if known.is_some_and(|known| known.source == ClaimSource::Announced) {
                self.beliefs.withdraw(&key, &owner);
            }
        }
        for (agent, known) in facts {
            // The announcement lists changed facts only, so each of them is new.
            self.claim_announced(agent, known, |_, _| true, now)?;
        }
        Ok(self.take_change(now))
    }

    /// Sets whether this central maintainer is a standby, which adopts the changes that the leader
    /// sends. When it becomes the leader, the adopted changes count as its own requested changes.
    pub fn set_standby(&mut self, stands_by: bool) {
        self.follows = stands_by;
        if !stands_by {
            self.beliefs.adopt_announced();
        }
    }

    /// Restores the changes by requests that the Journals kept. They count as requested from this
    /// maintainer.
    ///
    /// # Errors
    ///
    /// Returns an error if a limit is exceeded.
    pub fn restore_requests(
        &mut self,
        requests: &RequestedChanges,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let change = self.adopt(requests, now)?;
        self.beliefs.adopt_announced();
        Ok(change)
    }

    /// Restores the changes by requests that the Journals kept, at a maintainer that has led before
    /// the Journals could be read. What was requested from this maintainer since
    /// [`begin_partition_log`](Maintainer::begin_partition_log) is younger and stays in force. The
    /// metric and the withheld actions become those of `requests`.
    ///
    /// # Errors
    ///
    /// Returns an error if a limit is exceeded. The changes before the failing one take effect.
    pub fn restore_earlier_requests(
        &mut self,
        requests: &RequestedChanges,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        let younger = self.beliefs.claims_made_apart();
        let is_in_force = |agent: &AgentId, fact: &InitElement| match FactStatement::of(fact) {
            FactStatement::Is(key, _) => {
                !self.beliefs.is_withdrawn_apart(&key, &Owner::Agent(agent.clone()))
            }
            _ => false,
        };
        let facts = requests.facts.iter();
        let facts = facts.filter(|(agent, known)| is_in_force(agent, &known.fact)).cloned();
        let earlier = RequestedChanges { facts: facts.collect(), ..requests.clone() };
        let restored = self.adopt_claims(&earlier, now);
        self.beliefs.adopt_announced();
        // Of two numbers, the one that was claimed later is believed.
        for (fact, owner, claim) in younger {
            self.beliefs.claim(fact, &owner, claim);
        }
        let change = self.take_change(now);
        restored.map(|()| change)
    }

    fn adopt(
        &mut self,
        requests: &RequestedChanges,
        now: Timestamp,
    ) -> Result<DomainChange, Declined> {
        self.adopt_claims(requests, now)?;
        Ok(self.take_change(now))
    }

    fn adopt_claims(
        &mut self,
        requests: &RequestedChanges,
        now: Timestamp,
    ) -> Result<(), Declined> {
        let RequestedChanges { facts, retracted, metric, withheld } = requests;
        self.set_withheld(withheld.iter().cloned().collect())?;
        self.is_changed |= self.metric != *metric;
        self.metric.clone_from(metric);
        self.retract_from_map(retracted);
        let mut told: Vec<(FactKey, Owner)> = Vec::with_capacity(facts.len());
        for (agent, known) in facts {
            told.extend(self.claim_announced(agent, known, is_other, now)?);
        }
        told.sort_unstable();
        self.beliefs.withdraw_announced(&told);
        Ok(())
    }

    fn retract_from_map(&mut self, facts: &[InitElement]) {
        for fact in facts {
            if let FactStatement::Is(key, _) = FactStatement::of(fact) {
                self.beliefs.withdraw(&key, &Owner::Map);
            }
        }
    }

    /// Claims a fact that the central maintainer sent, unless this maintainer receives the
    /// heartbeats of the fact's owner. Returns the fact and its owner; `None` if the sent element
    /// is a denial or cannot be believed.
    fn claim_announced(
        &mut self,
        agent: &AgentId,
        known: &KnownFact,
        is_news: fn(&FactClaim, &FactClaim) -> bool,
        now: Timestamp,
    ) -> Result<Option<(FactKey, Owner)>, Declined> {
        let FactStatement::Is(key, value) = FactStatement::of(&known.fact) else { return Ok(None) };
        let owner = Owner::Agent(agent.clone());
        let claim = FactClaim::new(value, ClaimSource::Announced, now).until(known.until);
        let is_heard = self.is_reported_by(agent, &key);
        let is_taken = match self.beliefs.claim_of(&key, &owner) {
            Some(known) => known.source == ClaimSource::Announced && is_news(known, &claim),
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

/// Whether the claim `told`, which the central maintainer sent, differs from the claim `known`.
/// Equal claims must be skipped, because a repeated claim would become newer than those of other
/// owners.
fn is_other(known: &FactClaim, told: &FactClaim) -> bool {
    let is_same_end = match (known.until, told.until) {
        (Some(known), Some(told)) => known.0.abs_diff(told.0) < SAME_END_MS,
        (known, told) => known == told,
    };
    !is_same_end || known.value != told.value
}

/// Returns an arbitrary value for a fact, used where the value does not matter.
fn any_value(fact: &FactKey) -> FactValue {
    match fact.space() {
        FactSymbolKind::Predicate => FactValue::True,
        FactSymbolKind::Function => FactValue::Number(Number(0.0)),
    }
}
