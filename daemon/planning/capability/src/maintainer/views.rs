//! Outputs of the Domain Maintainer: snapshots for planning, and the believed state with the claims
//! about each fact.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use pddl::knowledge::Knowledge;
use pddl::{
    Condition, Expression, FluentTerm, InitElement, Metric, MetricDirection, Name, Number, Problem,
    Span, TOTAL_COST,
};

use super::{Maintainer, MaintainerScope};
use crate::belief::FactClaim;
use crate::compose::SharedModel;
use crate::composite::Composite;
use crate::conflict::{Conflict, ModelPartKind};
use crate::fact::{ClaimSource, FactKey, FactStatement, FactValue, Owner};
use crate::known_agents::Member;
use crate::snapshot::DomainSnapshot;
use crate::timestamp::Timestamp;

/// A claimed fact, whether it holds, and all claims about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Provenance {
    /// The claimed fact. A fact about a function has the believed value, or the first claimed value
    /// if none is believed.
    pub fact: InitElement,
    /// Reason, as text for a person, why the fact does not hold although it is claimed; `None` if
    /// the fact holds.
    pub left_out: Option<String>,
    /// All claims about the fact; never empty.
    pub claims: Vec<OwnerClaim>,
}

/// The claim of one owner about a fact.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnerClaim {
    /// The owner that makes the claim.
    pub owner: Owner,
    /// The claimed fact. A fact about a function has the value that this owner claims.
    pub said: InitElement,
    /// Incarnation of the owner when it made the claim; 0 for the map and for requests.
    pub incarnation: Incarnation,
    /// Number of the owner's latest heartbeat that contains the claim; 0 if no heartbeat has made
    /// it.
    pub sequence: u64,
    /// The source of the claim.
    pub source: ClaimSource,
    /// Time since the owner last made or repeated the claim.
    pub age: Duration,
    /// Time until the claim expires; `None` if it does not expire.
    pub left: Option<Duration>,
}

/// State of a known agent, for display.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AgentView {
    /// Name of the agent.
    pub agent: AgentId,
    /// Current incarnation of the agent.
    pub incarnation: Incarnation,
    /// Digest of the agent's model and methods.
    pub digest: String,
    /// Whether the agent's liveliness token is lost.
    pub is_masked: bool,
    /// Whether the agent's heartbeats have stopped.
    pub is_silent: bool,
    /// Time since the last heartbeat of the agent was received.
    pub age: Duration,
    /// Actions of the agent that planning may use, under the agent's own names.
    pub actions: Vec<Name>,
}

/// Cache of the composite of the last snapshot. The composite is reused until a model changes. A
/// cache must be used with one maintainer and its clones only.
#[derive(Clone, Debug, Default)]
pub struct CompositionCache(Option<CachedComposition>);

#[derive(Clone, Debug)]
struct CachedComposition {
    shared: Arc<SharedModel>,
    models: u64,
    whole: BTreeSet<AgentId>,
    composite: Arc<Composite>,
}

// === impl Maintainer ===

impl Maintainer {
    /// Returns a snapshot for planning: the domain and the problem at `now`.
    pub fn snapshot(&self, now: Timestamp) -> DomainSnapshot {
        match self.scope {
            MaintainerScope::Everything => {
                let believed = self.beliefs.holding(&self.composite, now);
                self.shown(&self.composite, &|_| true, believed)
            }
            MaintainerScope::Public => self.snapshot_for(&BTreeSet::new(), now),
        }
    }

    /// Returns the details of a claim. The age of a claim by a heartbeat counts from the last
    /// received heartbeat, including equal heartbeats that were not parsed.
    fn claimed_by(
        &self,
        fact: &FactKey,
        claim: (&Owner, &FactClaim),
        now: Timestamp,
    ) -> OwnerClaim {
        let claimed = OwnerClaim::new(fact, claim, now);
        let Owner::Agent(agent) = &claimed.owner else { return claimed };
        let said_again = |member: &&Member| {
            claimed.source == ClaimSource::Heartbeat
                && (member.incarnation, member.read) == (claimed.incarnation, claimed.sequence)
        };
        match self.roster.get(agent).filter(said_again) {
            Some(Member { sequence, heard_at: heard, .. }) => {
                OwnerClaim { sequence: *sequence, age: now.since(*heard), ..claimed }
            }
            None => claimed,
        }
    }

    /// Returns the current composite. With public scope, this call composes it.
    pub(super) fn composed(&self) -> Arc<Composite> {
        match self.scope {
            MaintainerScope::Everything => Arc::clone(&self.composite),
            MaintainerScope::Public => {
                Arc::new(self.compose(|_| false, &mut self.memory.clone()).0)
            }
        }
    }

    /// Returns the snapshot of an actuator that acts for the agents in `whole`: itself and the
    /// agents that it carries. The snapshot contains the whole models of these agents. Of all other
    /// agents, it contains only the public parts, without actions.
    ///
    /// Each call composes anew, because one maintainer serves all actuators that receive the same
    /// messages.
    pub fn snapshot_for(&self, whole: &BTreeSet<AgentId>, now: Timestamp) -> DomainSnapshot {
        self.snapshot_again(&mut CompositionCache::default(), whole, now)
    }

    /// Returns the same as [`snapshot_for`](Maintainer::snapshot_for), but composes only if the
    /// models have changed since the composition in the cache `sight`.
    pub fn snapshot_again(
        &self,
        sight: &mut CompositionCache,
        whole: &BTreeSet<AgentId>,
        now: Timestamp,
    ) -> DomainSnapshot {
        let is_whole = |agent: &AgentId| whole.contains(agent);
        let is_same = |seen: &&CachedComposition| {
            let CachedComposition { shared, models, whole: of, composite: _ } = seen;
            Arc::ptr_eq(shared, &self.shared) && *models == self.models && of == whole
        };
        let composite = match sight.0.as_ref().filter(is_same) {
            Some(seen) => Arc::clone(&seen.composite),
            None => Arc::new(self.compose(is_whole, &mut self.memory.clone()).0),
        };
        let (shared, models) = (Arc::clone(&self.shared), self.models);
        let (whole, seen) = (whole.clone(), Arc::clone(&composite));
        sight.0 = Some(CachedComposition { shared, models, whole, composite: seen });
        self.shown(&composite, &is_whole, self.beliefs.judged(&composite, now))
    }

    /// Returns a snapshot with the domain of `composite` and the facts `believed`. It includes the
    /// methods of the agents for which `trusts` returns `true`.
    fn shown(
        &self,
        composite: &Arc<Composite>,
        trusts: &dyn Fn(&AgentId) -> bool,
        believed: impl Iterator<Item = InitElement>,
    ) -> DomainSnapshot {
        let trusted: Vec<_> = self.roster.iter().filter(|(agent, _)| trusts(agent)).collect();
        let methods = { trusted.iter() }
            .map(|(agent, member)| ((*agent).clone(), Methods::clone(&member.described.methods)))
            .collect();
        let problem = Problem {
            objects: Arc::clone(&composite.objects),
            init: self.init(composite, believed),
            goal: Condition::always(),
            metric: self.metric(composite),
            ..self.frame()
        };
        let living = trusted.iter().map(|(_, member)| &*member.described.manifest);
        let former = self.remembered.not_offered_by(living);
        let composite = Arc::clone(composite);
        DomainSnapshot::new(self.epoch, self.revision, composite, problem, methods, former)
    }

    pub(super) fn frame(&self) -> Problem {
        let map = &self.shared.map;
        Problem {
            name: map.name.clone(),
            domain: self.shared.ontology.name.clone(),
            requirements: map.requirements.clone(),
            objects: Arc::default(),
            init: Vec::new(),
            goal: Condition::always(),
            metric: None,
        }
    }

    /// Returns the initial state of a problem: total cost 0, the believed facts, and the guards.
    fn init(
        &self,
        composite: &Composite,
        believed: impl Iterator<Item = InitElement>,
    ) -> Vec<InitElement> {
        let counts = |element: &InitElement| match element {
            InitElement::Assign(fluent, _) => fluent.function == TOTAL_COST,
            _ => false,
        };
        let free = counts_cost(composite).then(|| InitElement::Assign(total_cost(), Number(0.0)));
        let believed = believed.filter(|element| !counts(element));
        { free.into_iter() }
            .chain(believed.flat_map(|element| {
                planner_facts(&composite.knowledge, element).into_iter().flatten()
            }))
            .chain(self.guards(composite))
            .collect()
    }

    fn guards(&self, composite: &Composite) -> impl Iterator<Item = InitElement> {
        let present = self.roster.iter().filter(|(_, member)| member.is_present());
        present.flat_map(|(agent, _)| {
            let offered = composite.offers.get(agent).into_iter().flatten();
            let available = offered.filter(|offered| !self.is_withheld(&offered.outside, agent));
            available.map(|offered| InitElement::Atom(offered.guard_fact(agent)))
        })
    }

    fn is_withheld(&self, action: &Name, agent: &AgentId) -> bool {
        [None, Some(agent.clone())]
            .into_iter()
            .any(|agent| self.withheld.contains(&(action.clone(), agent)))
    }

    fn metric(&self, composite: &Composite) -> Option<Metric> {
        let cheapest = || {
            counts_cost(composite).then(|| Metric {
                direction: MetricDirection::Minimize,
                expression: Expression::Fluent(total_cost()),
                span: Span::default(),
            })
        };
        self.metric.clone().or_else(|| self.shared.map.metric.clone()).or_else(cheapest)
    }

    /// Returns every claimed fact that is visible in this maintainer's scope, in a fixed order.
    pub fn provenance(&self, now: Timestamp) -> Vec<Provenance> {
        let composite = self.composed();
        { self.beliefs.claims() }
            .filter_map(|(fact, claims)| {
                let seen = claims.into_iter().filter(|(owner, claim)| {
                    composite.secrets.sees(owner, fact)
                        && claim.until.is_none_or(|until| until > now)
                });
                let claims: Vec<(&Owner, &FactClaim)> = seen.collect();
                let (_, first) = claims.first()?;
                let value = self.beliefs.value_of(fact, &composite, now).unwrap_or(first.value);
                Some(Provenance {
                    fact: fact.element(value),
                    left_out: composite.misfit(fact, value),
                    claims: { claims.into_iter() }
                        .map(|claim| self.claimed_by(fact, claim, now))
                        .collect(),
                })
            })
            .collect()
    }

    /// Returns the reason, as text for a person, why a fact cannot hold in the composite even if it
    /// is claimed; `None` if it can hold.
    pub fn misfit(&self, fact: &InitElement) -> Option<String> {
        match FactStatement::of(fact) {
            FactStatement::Is(key, value) => self.composed().misfit(&key, value),
            FactStatement::Not(key) => self.composed().misfit(&key, FactValue::True),
            FactStatement::Unusable => Some("a fact names objects only, and no time".to_owned()),
        }
    }

    /// Returns the claims of owners other than `speaker` that contradict `fact`, each as the owner
    /// and the claimed fact. If `fact` gives a function a number, these are claims of another
    /// number. If `fact` is a denial, these are claims of the denied fact.
    pub fn contradicting(&self, fact: &InitElement, speaker: &Owner) -> Vec<(Owner, InitElement)> {
        let (key, value) = match FactStatement::of(fact) {
            FactStatement::Is(key, value @ FactValue::Number(_)) => (key, Some(value)),
            FactStatement::Not(key) => (key, None),
            FactStatement::Is(..) | FactStatement::Unusable => return Vec::new(),
        };
        { self.beliefs.claims_of(&key) }
            .filter(|(owner, claim)| {
                *owner != speaker && claim.value != FactValue::Unknown && Some(claim.value) != value
            })
            .map(|(owner, claim)| (owner.clone(), key.element(claim.value)))
            .collect()
    }

    /// Returns the state of each known agent, sorted by name.
    pub fn agents(&self, now: Timestamp) -> Vec<AgentView> {
        let composite = self.composed();
        { self.roster.iter() }
            .map(|(agent, member)| AgentView {
                agent: agent.clone(),
                incarnation: member.incarnation,
                digest: member.described.digest.to_string(),
                is_masked: member.is_masked,
                is_silent: member.is_silent,
                age: now.since(member.heard_at),
                actions: { composite.offers.get(agent).into_iter().flatten() }
                    .map(|offered| offered.outside.clone())
                    .filter(|action| member.is_present() && !self.is_withheld(action, agent))
                    .collect(),
            })
            .collect()
    }

    /// Returns an agent and the agents that it carries, directly or through other agents. An agent
    /// is carried if its model contains a fact about itself and the carrier that its own actions do
    /// not change, with any predicate, as in `(mounted-on ir-1 turtlebot-1)`.
    pub fn with_carried(&self, agent: &AgentId) -> BTreeSet<AgentId> {
        let mut carried = BTreeSet::from([agent.clone()]);
        let mut added = vec![agent.clone()];
        while let Some(base) = added.pop() {
            for (other, member) in self.roster.iter() {
                if member.is_carried_by(other, &base) && carried.insert(other.clone()) {
                    added.push(other.clone());
                }
            }
        }
        carried
    }

    /// Whether the map or the model of an agent declares an object, and not as private.
    pub fn declares_object(&self, name: &Name) -> bool {
        let models = self.roster.iter().map(|(_, member)| &*member.described.manifest);
        std::iter::once(&self.shared.manifest).chain(models).any(|summary| {
            let declared = summary.declarations.iter();
            let mut objects =
                declared.filter(|it| it.subject.kind == ModelPartKind::Object && !it.private);
            objects.any(|it| it.subject.name == *name)
        })
    }

    /// Whether new plans may use the agent's capabilities: the agent has announced its model, has
    /// its liveliness token, and sends heartbeats.
    pub fn is_present(&self, agent: &AgentId) -> bool {
        self.roster.get(agent).is_some_and(Member::is_present)
    }

    /// Returns the current incarnation of an agent, even if the agent is not present; `None` if it
    /// has not announced a model.
    pub fn incarnation(&self, agent: &AgentId) -> Option<Incarnation> {
        self.roster.get(agent).map(|member| member.incarnation)
    }

    /// Whether the agent's liveliness token is lost.
    pub fn is_masked(&self, agent: &AgentId) -> bool {
        self.roster.get(agent).is_some_and(|member| member.is_masked)
    }

    /// Returns all parts of models that are left out of the composite, in a fixed order.
    pub fn conflicts(&self) -> Vec<Conflict> {
        match self.scope {
            MaintainerScope::Everything => self.conflicts.clone(),
            MaintainerScope::Public => self.compose(|_| false, &mut self.memory.clone()).1,
        }
    }

    /// Returns the epoch: the number of changes of the set of capabilities so far.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Returns the revision: the number of changes of any kind so far.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

/// Converts a fact to facts for a planner. “Unknown” and “has a value” become separate facts, with
/// auxiliary predicates.
fn planner_facts(knowledge: &Knowledge, element: InitElement) -> [Option<InitElement>; 2] {
    match element {
        InitElement::Unknown(atom) => [knowledge.unknown(&atom).map(InitElement::Atom), None],
        InitElement::Assign(fluent, value) => {
            let defined = knowledge.defined(&fluent).map(InitElement::Atom);
            [Some(InitElement::Assign(fluent, value)), defined]
        }
        other => [Some(other), None],
    }
}

fn counts_cost(composite: &Composite) -> bool {
    let cost = composite.vocabulary.functions.get(TOTAL_COST);
    cost.is_some_and(|signature| signature.parameters.is_empty())
}

fn total_cost() -> FluentTerm {
    FluentTerm { function: Name::new(TOTAL_COST), arguments: Vec::new(), span: Span::default() }
}

// === impl OwnerClaim ===

impl OwnerClaim {
    fn new(fact: &FactKey, (owner, claim): (&Owner, &FactClaim), now: Timestamp) -> OwnerClaim {
        OwnerClaim {
            owner: owner.clone(),
            said: fact.element(claim.value),
            incarnation: claim.incarnation,
            sequence: claim.sequence,
            source: claim.source,
            age: now.since(claim.said),
            left: claim.until.map(|until| until.since(now)),
        }
    }
}
