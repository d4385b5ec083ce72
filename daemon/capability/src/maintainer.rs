//! The Domain Maintainer: what it is told, and what follows from it.
//!
//! - Is told of models, heartbeats, lost tokens, confirmed actions and requests, by whoever
//!   reads messages: a plugin, or an actuator for itself.
//! - Answers each with a [`Change`] to be announced, or with why it was [`Declined`].
//! - Leaves to others: what a message is, which clock runs, when a lost agent is removed.

mod departure;
mod facts;
mod requests;
mod views;

pub use views::{AgentView, ClaimedBy, Provenance, Sight};

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use acl::{AgentId, Incarnation};
use pddl::{ActionModel, Domain, Metric, Name, Problem};

use crate::belief::{Beliefs, Claim, Source};
use crate::change::Change;
use crate::compose::{Memory, Party, Shared, compose, join};
use crate::composite::Composite;
use crate::conflict::Conflict;
use crate::declined::Declined;
use crate::fact::{FactKey, Owner};
use crate::inputs::Announcement;
use crate::manifest::Manifest;
use crate::moment::Moment;
use crate::remembered::Remembered;
use crate::roster::{Member, Roster};

/// How much a maintainer shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All models: the maintainer of the whole ecosystem.
    Everything,
    /// The ontology, the map, public facts and objects; nobody's actions, and nothing private.
    /// What actuators share, each of whom sees more [with its own
    /// eyes](Maintainer::snapshot_for).
    ///
    /// Composed whenever somebody looks, and not before: a thousand models that come at once cost no
    /// more than to read them. What changes is therefore told of agents only, and what counts
    /// changes may count some that nobody can see.
    Public,
}

/// What has come and is not composed yet.
#[derive(Clone, Debug, Default)]
struct Uncomposed {
    /// Who was not here before.
    joined: Vec<AgentId>,
    /// Whether models are others than they were, or have gone.
    others: bool,
}

/// What came of a model that was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Admission {
    /// What changed; empty for a model that is known already.
    pub change: Change,
    /// What this model made impossible to compose as written, in whichever model it stands;
    /// to be told to the agents each names.
    pub conflicts: Vec<Conflict>,
}

/// The state machine.
///
/// Two maintainers that were told the same in another order agree, except on which of two
/// agents that contradict each other is believed: the one that came first to each.
#[derive(Clone, Debug)]
pub struct Maintainer {
    shared: Arc<Shared>,
    scope: Scope,
    /// Whether it believes what another tells of requests.
    follows: bool,
    roster: Roster,
    remembered: Remembered,
    memory: Memory,
    /// Counts changes of what agents describe of themselves: all that composing depends on.
    models: u64,
    /// Of a public scope, what was composed of nobody's model.
    composite: Arc<Composite>,
    conflicts: Vec<Conflict>,
    beliefs: Beliefs,
    /// Agents that left something unknown behind, the oldest first.
    departed: VecDeque<AgentId>,
    /// Actions taken off by request: of one agent, or of all.
    withheld: BTreeSet<(Name, Option<AgentId>)>,
    metric: Option<Metric>,
    /// Whose capabilities the last change told to be there.
    announced: BTreeSet<AgentId>,
    /// Whether the set of capabilities changed since the last change was told.
    is_changed: bool,
    uncomposed: Uncomposed,
    /// What could not be composed when the first of them came.
    known_conflicts: Option<BTreeSet<Conflict>>,
    epoch: u64,
    revision: u64,
}

// === impl Maintainer ===

impl Maintainer {
    /// Knows the shared ontology and the map, and no agent.
    ///
    /// Both are taken as they are: check them first.
    pub fn new(
        ontology: impl Into<Arc<Domain>>,
        map: impl Into<Arc<Problem>>,
        scope: Scope,
    ) -> Maintainer {
        let (ontology, map) = (ontology.into(), map.into());
        let shared = Arc::new(Shared::new(ontology, map));
        let mut memory = Memory::default();
        let everything = scope == Scope::Everything;
        let (composite, conflicts) = compose(&shared, &[], everything, &mut memory);
        let mut remembered = Remembered::default();
        let name = &shared.ontology.name;
        // What it describes is the model of nobody: someone may come and offer it.
        remembered.note(&ActionModel::of(name.clone(), name.clone()), &shared.manifest);
        let mut maintainer = Maintainer {
            shared,
            scope,
            follows: !everything,
            roster: Roster::default(),
            remembered,
            memory,
            models: 0,
            composite: Arc::new(composite),
            conflicts,
            beliefs: Beliefs::new(everything),
            departed: VecDeque::new(),
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

    /// Takes a model: new, changed, or of a new life of the agent; and composes.
    ///
    /// # Errors
    ///
    /// If it speaks of another agent or another ontology, comes from a former life, or is too
    /// large. Nothing of it is taken then. Single parts that cannot be used are no error: they
    /// are left out and named among the conflicts.
    pub fn admit(&mut self, announced: Announcement, now: Moment) -> Result<Admission, Declined> {
        self.take(announced, now)?;
        Ok(self.compose_taken(now))
    }

    /// Takes a model as [`admit`](Maintainer::admit) does, and leaves it to be composed with others
    /// that come soon. Until then nothing changes that anyone can see.
    ///
    /// # Errors
    ///
    /// As of `admit`.
    pub fn take(&mut self, announced: Announcement, now: Moment) -> Result<(), Declined> {
        let Announcement { agent, incarnation, described } = announced;
        self.roster.check(&agent, incarnation)?;
        self.roster.has_room(&agent)?;
        let described = described?;
        self.speaks_for_itself(&agent, &described.frame)?;
        let known = self.roster.get(&agent).filter(|member| member.incarnation == incarnation);
        if known.is_some_and(|member| member.described.digest == described.digest) {
            return Ok(());
        }
        if self.scope == Scope::Everything {
            self.remembered.note(&described.frame, &described.manifest);
        }
        let former = self.manifest_of(&agent);
        let member = match known.cloned() {
            Some(known) => {
                self.is_changed |= known.described.methods != described.methods;
                known.with(described)
            }
            None => Member::new(incarnation, described, now),
        };
        self.seat(&agent, member, now);
        self.remodel(&agent, former.as_deref());
        Ok(())
    }

    /// Whether models have been [taken](Maintainer::take) that are not composed yet.
    pub fn is_stale(&self) -> bool {
        self.uncomposed.others || !self.uncomposed.joined.is_empty()
    }

    /// Composes what was taken: once, however much it is.
    pub fn compose_taken(&mut self, now: Moment) -> Admission {
        if self.is_stale() {
            self.recompose();
        }
        let known = self.known_conflicts.take();
        let is_new = |conflict: &&Conflict| known.as_ref().is_some_and(|k| !k.contains(*conflict));
        let conflicts = self.conflicts.iter().filter(is_new).cloned().collect();
        Admission { change: self.conclude(now), conflicts }
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

    /// What an agent announced, if it is this: for another maintainer that hears the same.
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

    /// Whether the model that goes with `digest` has to be asked for.
    pub fn needs_model(&self, agent: &AgentId, digest: &str) -> bool {
        self.roster.get(agent).is_none_or(|member| *member.described.digest != *digest)
    }

    /// The agent's token is lost: its capabilities leave for new plans at once, its objects and
    /// its facts stay. A token of a former life changes nothing.
    pub fn mask(&mut self, agent: &AgentId, incarnation: Incarnation, now: Moment) -> Change {
        self.set_masked(agent, incarnation, true, now)
    }

    /// The agent's token is back.
    pub fn unmask(&mut self, agent: &AgentId, incarnation: Incarnation, now: Moment) -> Change {
        self.set_masked(agent, incarnation, false, now)
    }

    fn set_masked(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        is_masked: bool,
        now: Moment,
    ) -> Change {
        self.roster.mask(agent, incarnation, is_masked);
        self.conclude(now)
    }

    /// The agent is gone: its actions, its objects and its facts leave. What it answered for and is about
    /// others is unknown from now on. A former life of an agent that is here again cannot be removed.
    pub fn remove(&mut self, agent: &AgentId, incarnation: Incarnation, now: Moment) -> Change {
        if self.roster.check(agent, incarnation).is_err() {
            return self.conclude(now);
        }
        // What actuators share follows what is told of it.
        let left = match self.scope {
            Scope::Everything => self.left_behind(agent),
            Scope::Public => Vec::new(),
        };
        let is_over = |_: &FactKey, claim: &Claim| claim.source != Source::Departure;
        self.beliefs.withdraw_where(&Owner::Agent(agent.clone()), is_over);
        if let Some(former) = self.roster.release(agent) {
            self.leave_unknown(agent, left, now);
            self.remodel(agent, Some(&former.described.manifest));
        }
        if self.is_stale() {
            self.recompose();
        }
        self.conclude(now)
    }

    /// Time passes: what is known no longer is believed no longer, and agents whose heartbeats
    /// stopped are masked.
    pub fn expire(&mut self, now: Moment) -> Change {
        self.beliefs.expire(now);
        self.roster.fall_silent(now);
        self.conclude(now)
    }

    /// When [`expire`](Maintainer::expire) has something to do, if nothing else happens.
    pub fn next_expiry(&self) -> Option<Moment> {
        self.beliefs.next_expiry().into_iter().chain(self.roster.next_silence()).min()
    }

    /// Takes a member in, and what its model says is true. What its heartbeats said, this life
    /// long, is truer.
    fn seat(&mut self, agent: &AgentId, member: Member, now: Moment) {
        let owner = Owner::Agent(agent.clone());
        let same_life =
            self.roster.get(agent).is_some_and(|known| known.incarnation == member.incarnation);
        self.beliefs.withdraw_where(&owner, |_, claim| !same_life || claim.source == Source::Model);
        self.believe_model(&owner, &member, now);
        self.roster.seat(agent, member);
    }

    fn manifest_of(&self, agent: &AgentId) -> Option<Arc<Manifest>> {
        self.roster.get(agent).map(|member| Arc::clone(&member.described.manifest))
    }

    /// Takes account of what an agent describes of itself now, in place of what it described before.
    fn remodel(&mut self, agent: &AgentId, former: Option<&Manifest>) {
        self.models += 1;
        let everything = self.scope == Scope::Everything;
        let now = self.manifest_of(agent);
        let parties = || self.roster.parties(|_| everything);
        self.memory.keep_standing(former, now.as_deref(), everything, parties);
        match self.scope {
            Scope::Everything => {
                match former {
                    None => self.uncomposed.joined.push(agent.clone()),
                    Some(_) => self.uncomposed.others = true,
                }
                let known = || self.conflicts.iter().cloned().collect();
                self.known_conflicts.get_or_insert_with(known);
            }
            // Nobody sees it yet.
            Scope::Public => self.is_changed = true,
        }
    }

    /// More facts may be unknown: the domain has words for it from now on.
    fn reword(&mut self) {
        self.memory.unknowable.clone_from(self.beliefs.unknowable());
        match self.scope {
            Scope::Everything => {
                let waits = self.is_stale();
                self.uncomposed.others = true;
                // With what waits to be composed, if there is something.
                if !waits {
                    self.recompose();
                }
            }
            Scope::Public => self.models += 1,
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

    /// Adds those who joined to what was composed; `false` if not all of them only add something.
    fn add(&mut self, joined: &[AgentId]) -> bool {
        // Who joins may mend what was left out.
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

    /// One domain of all models, of which those that `trusts` names are known whole.
    fn compose(
        &self,
        trusts: impl Fn(&AgentId) -> bool,
        memory: &mut Memory,
    ) -> (Composite, Vec<Conflict>) {
        let parties: Vec<Party<'_>> = self.roster.parties(trusts).collect();
        compose(&self.shared, &parties, self.scope == Scope::Everything, memory)
    }

    /// Tells what is other than at the end of the call before.
    fn conclude(&mut self, now: Moment) -> Change {
        if self.beliefs.take_newly_unknowable() {
            self.reword();
        }
        if self.is_stale() {
            // All of it is told when it is composed.
            let (epoch, revision) = (self.epoch, self.revision);
            return Change { epoch, revision, ..Change::default() };
        }
        let (mut joined, mut left) = (Vec::new(), Vec::new());
        for (agent, is_present) in self.roster.take_stirred() {
            if is_present && self.announced.insert(agent.clone()) {
                joined.push(agent);
            } else if !is_present && self.announced.remove(&agent) {
                left.push(agent);
            }
        }
        let (believed, retracted) = match self.scope {
            Scope::Everything => self.beliefs.settle(&self.composite, now),
            Scope::Public => Default::default(),
        };
        let is_changed = std::mem::take(&mut self.is_changed);
        let epoch_changed = is_changed || !joined.is_empty() || !left.is_empty();
        self.epoch += u64::from(epoch_changed);
        let (epoch, revision) = (self.epoch, self.revision);
        let mut change =
            Change { epoch, revision, epoch_changed, joined, left, believed, retracted };
        if !change.is_empty() || self.beliefs.take_moved() {
            self.revision += 1;
            change.revision = self.revision;
        }
        change
    }
}
