//! The Domain Maintainer: a state machine that takes inputs and returns what changed.
//!
//! - Inputs are models, heartbeats, lost and returned liveliness tokens, confirmed actions and
//!   requests. The caller, a plugin or an actuator, parses the messages.
//! - The output for each input is the [`DomainChange`] to announce, or the reason why the input was
//!   [`Declined`].
//! - The caller provides the clock and the form of messages, and decides when a lost agent is
//!   removed.

mod departure;
mod expected;
mod facts;
mod requests;
mod views;

pub use views::{AgentView, CompositionCache, OwnerClaim, Provenance};

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use acl::{AgentId, Incarnation};
use pddl::{ActionModel, Domain, Metric, Name, Problem};

use crate::belief::{Beliefs, FactClaim};
use crate::change::DomainChange;
use crate::compose::{CompositionMemory, Contribution, SharedModel, compose, join};
use crate::composite::Composite;
use crate::conflict::Conflict;
use crate::declined::Declined;
use crate::fact::{ClaimSource, FactKey, Owner};
use crate::former_actions::FormerActions;
use crate::inputs::{Announcement, SilenceLimit};
use crate::known_agents::{KnownAgents, Member};
use crate::model_summary::ModelSummary;
use crate::timestamp::Timestamp;

/// The part of each agent's model that a maintainer shows in its snapshots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaintainerScope {
    /// All parts of all models, for the maintainer of the whole ecosystem.
    Everything,
    /// The ontology, the map, and public facts and objects, but no actions and no private part, for
    /// the maintainer that actuators share. [Its own snapshot](Maintainer::snapshot_for) shows an
    /// actuator more.
    ///
    /// Models are composed only when a snapshot is requested, so that the arrival of a thousand
    /// models costs only their parsing. A [`DomainChange`] therefore lists agents only, and its
    /// epoch and revision may count invisible changes.
    Public,
}

/// Changes of models since the last composition.
#[derive(Clone, Debug, Default)]
struct Uncomposed {
    /// Agents that have joined.
    joined: Vec<AgentId>,
    /// Whether a model has changed or an agent has left, apart from the agents in `joined`.
    others: bool,
}

/// Result of adding a model and composing all models.
#[derive(Clone, Debug, PartialEq)]
pub struct AdmitResult {
    /// The change of the composite domain and state that the model caused; empty if this maintainer
    /// had the same model already.
    pub change: DomainChange,
    /// New conflicts because of the model: parts of it or of other models that can no longer be
    /// composed as written. Each conflict must be sent to the agents that it names.
    pub conflicts: Vec<Conflict>,
}

/// The state machine of a Domain Maintainer.
///
/// Two maintainers that receive the same inputs in different orders have the same state, with one
/// exception. If two agents contradict each other, each maintainer believes the agent that it
/// received first.
#[derive(Clone, Debug)]
pub struct Maintainer {
    shared: Arc<SharedModel>,
    scope: MaintainerScope,
    silence: SilenceLimit,
    /// Whether this maintainer adopts the changes by requests that the central maintainer sends.
    follows: bool,
    roster: KnownAgents,
    remembered: FormerActions,
    memory: CompositionMemory,
    /// Number of changes of models so far; the composite depends on the models.
    models: u64,
    /// The current composite. For [`MaintainerScope::Public`], it is composed of the ontology and
    /// the map alone.
    composite: Arc<Composite>,
    conflicts: Vec<Conflict>,
    beliefs: Beliefs,
    /// Departed agents with facts that are kept as unknown, in the order of their departure.
    departed: VecDeque<AgentId>,
    /// Facts that were marked as unknown because an agent of the ecosystem file had not joined.
    /// Each entry is the fact and this agent. A fact stays in the set after its mark has ended.
    expected: BTreeSet<(FactKey, Owner)>,
    /// Actions that requests withhold from planning. Each entry is the name of the action and the
    /// agent; `None` stands for all agents.
    withheld: BTreeSet<(Name, Option<AgentId>)>,
    metric: Option<Metric>,
    /// Agents with capabilities that were available at the end of the last call.
    announced: BTreeSet<AgentId>,
    /// Whether the set of capabilities has changed since the last [`DomainChange`] was returned.
    is_changed: bool,
    uncomposed: Uncomposed,
    /// The conflicts that existed before the first model that is not composed yet was added; `None`
    /// if all models are composed.
    known_conflicts: Option<BTreeSet<Conflict>>,
    epoch: u64,
    revision: u64,
}

// === impl Maintainer ===

impl Maintainer {
    /// Creates a maintainer with the shared ontology and the map, and without agents.
    ///
    /// The ontology and the map are not checked here: the caller must check them before.
    pub fn new(
        ontology: impl Into<Arc<Domain>>,
        map: impl Into<Arc<Problem>>,
        scope: MaintainerScope,
    ) -> Maintainer {
        let (ontology, map) = (ontology.into(), map.into());
        let shared = Arc::new(SharedModel::new(ontology, map));
        let mut memory = CompositionMemory::default();
        let everything = scope == MaintainerScope::Everything;
        let (composite, conflicts) = compose(&shared, &[], everything, &mut memory);
        let mut remembered = FormerActions::default();
        let name = &shared.ontology.name;
        // An action that only the ontology describes counts as offered in the past, because an
        // agent that offers it may join.
        remembered.record(&ActionModel::of(name.clone(), name.clone()), &shared.manifest);
        let mut maintainer = Maintainer {
            shared,
            scope,
            silence: SilenceLimit::default(),
            follows: !everything,
            roster: KnownAgents::default(),
            remembered,
            memory,
            models: 0,
            composite: Arc::new(composite),
            conflicts,
            beliefs: Beliefs::new(everything),
            departed: VecDeque::new(),
            expected: BTreeSet::new(),
            withheld: BTreeSet::new(),
            metric: None,
            announced: BTreeSet::new(),
            is_changed: false,
            uncomposed: Uncomposed::default(),
            known_conflicts: None,
            epoch: 0,
            revision: 0,
        };
        maintainer.believe_map();
        maintainer
    }

    /// Sets the time for which an agent may be silent before its capabilities count as unavailable.
    #[must_use]
    pub fn with_silence_limit(mut self, silence: SilenceLimit) -> Maintainer {
        self.silence = silence;
        self
    }

    /// Adds a model that is new, changed, or of a new incarnation of the agent, and then composes
    /// all models.
    ///
    /// # Errors
    ///
    /// Returns an error if the model describes another agent than the sender, names another
    /// ontology, comes from a former incarnation, or is too large. No part of the model then takes
    /// effect. A single unusable part is no error: it is left out and returned as a conflict.
    pub fn admit(
        &mut self,
        announced: Announcement,
        now: Timestamp,
    ) -> Result<AdmitResult, Declined> {
        self.add_model(announced, now)?;
        Ok(self.compose_added(now))
    }

    /// Adds a model as [`admit`](Maintainer::admit) does, but without composing. Several models
    /// that arrive together can then be composed in one step. Until then no change is visible.
    ///
    /// # Errors
    ///
    /// Returns an error in the same cases as [`admit`](Maintainer::admit).
    pub fn add_model(&mut self, announced: Announcement, now: Timestamp) -> Result<(), Declined> {
        let Announcement { agent, incarnation, described } = announced;
        self.roster.check(&agent, incarnation)?;
        self.roster.has_room(&agent)?;
        let described = described?;
        self.speaks_for_itself(&agent, &described.frame)?;
        let known = self.roster.get(&agent).filter(|member| member.incarnation == incarnation);
        if known.is_some_and(|member| member.described.digest == described.digest) {
            return Ok(());
        }
        if self.scope == MaintainerScope::Everything {
            self.remembered.record(&described.frame, &described.manifest);
        }
        let former = self.manifest_of(&agent);
        let member = match known.cloned() {
            Some(known) => {
                self.is_changed |= known.described.methods != described.methods;
                known.with(described)
            }
            None => Member::new(incarnation, described, now),
        };
        self.upsert_member(&agent, member, now);
        self.model_changed(&agent, former.as_deref());
        Ok(())
    }

    /// Whether there are models that were [added](Maintainer::add_model) and have not been composed
    /// yet.
    pub fn is_stale(&self) -> bool {
        self.uncomposed.others || !self.uncomposed.joined.is_empty()
    }

    /// Composes all models that were added since the last composition, in one step.
    pub fn compose_added(&mut self, now: Timestamp) -> AdmitResult {
        if self.is_stale() {
            self.recompose();
        }
        let known = self.known_conflicts.take();
        let is_new = |conflict: &&Conflict| known.as_ref().is_some_and(|k| !k.contains(*conflict));
        let conflicts = self.conflicts.iter().filter(is_new).cloned().collect();
        AdmitResult { change: self.take_change(now), conflicts }
    }

    fn speaks_for_itself(&self, agent: &AgentId, frame: &ActionModel) -> Result<(), Declined> {
        if frame.agent != agent.as_str() {
            let (sender, model) = (agent.clone(), frame.agent.to_string());
            return Err(Declined::OtherAgent { sender, model });
        }
        let shared = &self.shared.ontology.name;
        if frame.domain != *shared {
            let (named, shared) = (frame.domain.to_string(), shared.to_string());
            return Err(Declined::OtherOntology { named, shared });
        }
        Ok(())
    }

    /// Returns the announced model of an agent, if its incarnation and digest match; otherwise
    /// `None`. The model can be passed to another maintainer that receives the same messages, so
    /// that it is parsed only once.
    pub fn announcement(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        digest: &str,
    ) -> Option<Announcement> {
        let Member { incarnation: living, described, .. } = self.roster.get(agent)?;
        let is_this = *living == incarnation && *described.digest == *digest;
        let (agent, described) = (agent.clone(), Ok(described.clone()));
        is_this.then_some(Announcement { agent, incarnation, described })
    }

    /// Whether the model with this digest must be requested from the agent, because this maintainer
    /// does not have it.
    pub fn needs_model(&self, agent: &AgentId, digest: &str) -> bool {
        self.roster.get(agent).is_none_or(|member| *member.described.digest != *digest)
    }

    /// Handles the loss of an agent's liveliness token. New plans no longer use the agent's
    /// capabilities, but its objects and facts stay. The loss of a former incarnation's token
    /// changes nothing.
    pub fn mask(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        now: Timestamp,
    ) -> DomainChange {
        self.set_masked(agent, incarnation, true, now)
    }

    /// Handles the return of an agent's liveliness token.
    pub fn unmask(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        now: Timestamp,
    ) -> DomainChange {
        self.set_masked(agent, incarnation, false, now)
    }

    fn set_masked(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        is_masked: bool,
        now: Timestamp,
    ) -> DomainChange {
        self.roster.mask(agent, incarnation, is_masked);
        self.take_change(now)
    }

    /// Removes an agent with its actions, objects and facts. The facts about other objects that the
    /// agent was responsible for become unknown. If a newer incarnation of the agent is known,
    /// nothing changes.
    pub fn remove(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        now: Timestamp,
    ) -> DomainChange {
        if self.roster.check(agent, incarnation).is_err() {
            return self.take_change(now);
        }
        // The central maintainer announces unknown facts to the shared maintainers of actuators.
        let left = match self.scope {
            MaintainerScope::Everything => self.facts_to_become_unknown(agent),
            MaintainerScope::Public => Vec::new(),
        };
        let is_over = |_: &FactKey, claim: &FactClaim| claim.source != ClaimSource::Departure;
        self.beliefs.withdraw_where(&Owner::Agent(agent.clone()), is_over);
        if let Some(former) = self.roster.remove_member(agent) {
            self.leave_unknown(agent, left, now);
            self.model_changed(agent, Some(&former.described.manifest));
        }
        if self.is_stale() {
            self.recompose();
        }
        self.take_change(now)
    }

    /// Advances the time to `now`: removes expired claims, and marks the agents with overdue
    /// heartbeats as silent.
    pub fn expire(&mut self, now: Timestamp) -> DomainChange {
        self.beliefs.expire(now);
        self.roster.mark_silent(now);
        self.take_change(now)
    }

    /// Returns the next time at which [`expire`](Maintainer::expire) changes anything without
    /// another input; `None` if there is no such time.
    pub fn next_expiry(&self) -> Option<Timestamp> {
        self.beliefs.next_expiry().into_iter().chain(self.roster.next_silence()).min()
    }

    /// Adds or replaces an agent, and claims the facts of its model. Claims by heartbeats of the
    /// same incarnation take precedence over the claims of the model.
    fn upsert_member(&mut self, agent: &AgentId, member: Member, now: Timestamp) {
        let owner = Owner::Agent(agent.clone());
        let same_life =
            self.roster.get(agent).is_some_and(|known| known.incarnation == member.incarnation);
        self.beliefs
            .withdraw_where(&owner, |_, claim| !same_life || claim.source == ClaimSource::Model);
        self.believe_model(&owner, &member, now);
        self.roster.insert_member(agent, member);
    }

    fn manifest_of(&self, agent: &AgentId) -> Option<Arc<ModelSummary>> {
        self.roster.get(agent).map(|member| Arc::clone(&member.described.manifest))
    }

    /// Handles a change of an agent's model. `former` is the summary of the model before the
    /// change.
    fn model_changed(&mut self, agent: &AgentId, former: Option<&ModelSummary>) {
        self.models += 1;
        let everything = self.scope == MaintainerScope::Everything;
        let now = self.manifest_of(agent);
        let parties = || self.roster.parties(|_| everything);
        self.memory.keep_standing(former, now.as_deref(), everything, parties);
        match self.scope {
            MaintainerScope::Everything => {
                match former {
                    None => self.uncomposed.joined.push(agent.clone()),
                    Some(_) => self.uncomposed.others = true,
                }
                let known = || self.conflicts.iter().cloned().collect();
                self.known_conflicts.get_or_insert_with(known);
            }
            // Models are composed only when a snapshot is requested.
            MaintainerScope::Public => self.is_changed = true,
        }
    }

    /// Adds the predicates that may have unknown facts to the domain. Must be called when an
    /// unknown fact of a further predicate has been recorded.
    fn unknowable_changed(&mut self) {
        self.memory.unknowable.clone_from(self.beliefs.unknowable());
        match self.scope {
            MaintainerScope::Everything => {
                let waits = self.is_stale();
                self.uncomposed.others = true;
                // Models that are not composed yet are composed together with this change.
                if !waits {
                    self.recompose();
                }
            }
            MaintainerScope::Public => self.models += 1,
        }
    }

    fn recompose(&mut self) {
        let Uncomposed { joined, others } = std::mem::take(&mut self.uncomposed);
        if !others && self.add(&joined) {
            return;
        }
        let mut memory = std::mem::take(&mut self.memory);
        let (mut composite, conflicts) = self.compose(|_| true, &mut memory);
        self.memory = memory;
        self.conflicts = conflicts;
        composite.share_domain(&self.composite);
        self.is_changed |= !composite.is_as(&self.composite);
        self.beliefs.reconsider(&self.composite, &composite);
        self.composite = Arc::new(composite);
    }

    /// Adds the agents that joined to the existing composite. Returns `false` if this is not
    /// possible, because one of them changes more than its own objects and offers.
    fn add(&mut self, joined: &[AgentId]) -> bool {
        // A new agent may resolve a conflict.
        if !self.conflicts.is_empty() {
            return false;
        }
        let mut objects = BTreeSet::new();
        let is_whole = joined.iter().all(|agent| {
            let Some(party) = self.roster.party(agent) else { return false };
            let added = join(&self.shared, &mut self.composite, &party);
            self.is_changed |= added.is_some();
            added.map(|added| objects.extend(added)).is_some()
        });
        self.beliefs.reconsider_about(&objects);
        is_whole
    }

    /// Composes one domain of all models. If `trusts` returns `true` for an agent, its whole model
    /// is used, and otherwise only the public part. Returns the composite, and the parts that were
    /// left out of it as conflicts.
    fn compose(
        &self,
        trusts: impl Fn(&AgentId) -> bool,
        memory: &mut CompositionMemory,
    ) -> (Composite, Vec<Conflict>) {
        let parties: Vec<Contribution<'_>> = self.roster.parties(trusts).collect();
        compose(&self.shared, &parties, self.scope == MaintainerScope::Everything, memory)
    }

    /// Ends a call: returns the change of the domain and state since the end of the previous call.
    fn take_change(&mut self, now: Timestamp) -> DomainChange {
        if self.beliefs.take_newly_unknowable() {
            self.unknowable_changed();
        }
        if self.is_stale() {
            // The changes are returned after the next composition.
            let (epoch, revision) = (self.epoch, self.revision);
            return DomainChange { epoch, revision, ..DomainChange::default() };
        }
        let (mut joined, mut left) = (Vec::new(), Vec::new());
        for (agent, is_present) in self.roster.take_presence_changes() {
            if is_present && self.announced.insert(agent.clone()) {
                joined.push(agent);
            } else if !is_present && self.announced.remove(&agent) {
                left.push(agent);
            }
        }
        let (believed, retracted) = match self.scope {
            MaintainerScope::Everything => self.beliefs.recompute(&self.composite, now),
            MaintainerScope::Public => Default::default(),
        };
        let is_changed = std::mem::take(&mut self.is_changed);
        let epoch_changed = is_changed || !joined.is_empty() || !left.is_empty();
        self.epoch += u64::from(epoch_changed);
        let (epoch, revision) = (self.epoch, self.revision);
        let mut change =
            DomainChange { epoch, revision, epoch_changed, joined, left, believed, retracted };
        if !change.is_empty() || self.beliefs.take_moved() {
            self.revision += 1;
            change.revision = self.revision;
        }
        change
    }
}
