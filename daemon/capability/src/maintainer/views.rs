//! What the Domain Maintainer shows: snapshots to plan in, and the state with its provenance.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::content::Methods;
use acl::{AgentId, Incarnation};
use pddl::knowledge::Knowledge;
use pddl::{
    Condition, Direction, Expression, FluentTerm, InitElement, Metric, Name, Number, Problem, Span,
};

use super::{Maintainer, Scope};
use crate::belief::{Claim, Source};
use crate::compose::Shared;
use crate::composite::{Composite, TOTAL_COST};
use crate::conflict::Conflict;
use crate::fact::{FactKey, Owner, Statement, Value};
use crate::moment::Moment;
use crate::roster::Member;
use crate::snapshot::Snapshot;

/// A fact that somebody claims, and whether it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Provenance {
    /// The fact; of a number, with the value believed, or the first claimed if none is.
    pub fact: InitElement,
    /// Why it does not hold although it is claimed, for a person; `None` if it holds.
    pub left_out: Option<String>,
    /// Whose word it is; never empty.
    pub claims: Vec<ClaimedBy>,
}

/// One owner's word.
#[derive(Clone, Debug, PartialEq)]
pub struct ClaimedBy {
    /// The owner.
    pub owner: Owner,
    /// What it says: of a number, with its own value.
    pub said: InitElement,
    /// Which life of the owner said it; 0 for the map and by request.
    pub incarnation: Incarnation,
    /// The heartbeat that said it last; 0 if none did.
    pub sequence: u64,
    /// How it came about.
    pub source: Source,
    /// How long ago it was said last.
    pub age: Duration,
    /// How long it will be known, if not until further notice.
    pub left: Option<Duration>,
}

/// An agent that is here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AgentView {
    /// Its name.
    pub agent: AgentId,
    /// Which life of it.
    pub incarnation: Incarnation,
    /// Digest of its model and methods.
    pub digest: String,
    /// Whether its token is lost.
    pub is_masked: bool,
    /// Whether its heartbeats stopped.
    pub is_silent: bool,
    /// How long ago it was heard last.
    pub age: Duration,
    /// The actions it can be planned with, under its own names for them.
    pub actions: Vec<Name>,
}

/// What was composed when somebody looked last, so that looking again costs less: it stays as it is
/// while nobody's model changes. Of one maintainer and its copies.
#[derive(Clone, Debug, Default)]
pub struct Sight(Option<Seen>);

#[derive(Clone, Debug)]
struct Seen {
    shared: Arc<Shared>,
    models: u64,
    whole: BTreeSet<AgentId>,
    composite: Arc<Composite>,
}

// === impl Maintainer ===

impl Maintainer {
    /// The domain and the problem as known at `now`, to plan in.
    pub fn snapshot(&self, now: Moment) -> Snapshot {
        match self.scope {
            Scope::Everything => {
                let believed = self.beliefs.holding(&self.composite, now);
                self.shown(&self.composite, &|_| true, believed)
            }
            Scope::Public => self.snapshot_for(&BTreeSet::new(), now),
        }
    }

    /// One owner's word. What a heartbeat said was said again by all that were not read since, because
    /// they said nothing else.
    fn claimed_by(&self, fact: &FactKey, claim: (&Owner, &Claim), now: Moment) -> ClaimedBy {
        let claimed = ClaimedBy::new(fact, claim, now);
        let Owner::Agent(agent) = &claimed.owner else { return claimed };
        let said_again = |member: &&Member| {
            claimed.source == Source::Heartbeat
                && (member.incarnation, member.read) == (claimed.incarnation, claimed.sequence)
        };
        match self.roster.get(agent).filter(said_again) {
            Some(Member { sequence, heard, .. }) => {
                ClaimedBy { sequence: *sequence, age: now.since(*heard), ..claimed }
            }
            None => claimed,
        }
    }

    /// The composite as it is now.
    pub(super) fn composed(&self) -> Arc<Composite> {
        match self.scope {
            Scope::Everything => Arc::clone(&self.composite),
            Scope::Public => Arc::new(self.compose(|_| false, &mut self.memory.clone()).0),
        }
    }

    /// The same as an actuator sees it that acts for the agents of `whole`: itself, and those it
    /// carries. Their models are known whole; of the others, what is public, and no action.
    ///
    /// Made when asked for: one maintainer serves all actuators that hear the same.
    pub fn snapshot_for(&self, whole: &BTreeSet<AgentId>, now: Moment) -> Snapshot {
        self.snapshot_again(&mut Sight::default(), whole, now)
    }

    /// The same, composed only if it is another domain than was seen last.
    pub fn snapshot_again(
        &self,
        sight: &mut Sight,
        whole: &BTreeSet<AgentId>,
        now: Moment,
    ) -> Snapshot {
        let is_whole = |agent: &AgentId| whole.contains(agent);
        let is_same = |seen: &&Seen| {
            let Seen { shared, models, whole: of, composite: _ } = seen;
            Arc::ptr_eq(shared, &self.shared) && *models == self.models && of == whole
        };
        let composite = match sight.0.as_ref().filter(is_same) {
            Some(seen) => Arc::clone(&seen.composite),
            None => Arc::new(self.compose(is_whole, &mut self.memory.clone()).0),
        };
        let (shared, models) = (Arc::clone(&self.shared), self.models);
        let (whole, seen) = (whole.clone(), Arc::clone(&composite));
        sight.0 = Some(Seen { shared, models, whole, composite: seen });
        self.shown(&composite, &is_whole, self.beliefs.judged(&composite, now))
    }

    /// What is `believed`, in the domain of `composite`, with the methods of those it trusts.
    fn shown(
        &self,
        composite: &Arc<Composite>,
        trusts: &dyn Fn(&AgentId) -> bool,
        believed: impl Iterator<Item = InitElement>,
    ) -> Snapshot {
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
        let former = self.remembered.but_for(living);
        let composite = Arc::clone(composite);
        Snapshot::new(self.epoch, self.revision, composite, problem, methods, former)
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

    /// What is believed, who can act, and a plan that costs nothing yet.
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
            .chain(
                believed.flat_map(|element| {
                    in_words(&composite.knowledge, element).into_iter().flatten()
                }),
            )
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
                direction: Direction::Minimize,
                expression: Expression::Fluent(total_cost()),
                span: Span::default(),
            })
        };
        self.metric.clone().or_else(|| self.shared.map.metric.clone()).or_else(cheapest)
    }

    /// Every fact that somebody claims and that may be known here, in a fixed order.
    pub fn provenance(&self, now: Moment) -> Vec<Provenance> {
        let composite = self.composed();
        { self.beliefs.claims() }
            .filter_map(|(fact, claims)| {
                let seen = claims.into_iter().filter(|(owner, claim)| {
                    composite.secrets.sees(owner, fact)
                        && claim.until.is_none_or(|until| until > now)
                });
                let claims: Vec<(&Owner, &Claim)> = seen.collect();
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

    /// Why a fact does not hold here although it is claimed, for a person; `None` if it can hold.
    pub fn misfit(&self, fact: &InitElement) -> Option<String> {
        match Statement::of(fact) {
            Statement::Is(key, value) => self.composed().misfit(&key, value),
            Statement::Not(key) => self.composed().misfit(&key, Value::True),
            Statement::Unusable => {
                Some("a fact has objects only, and speaks of no other time".to_owned())
            }
        }
    }

    /// What others than `speaker` say that contradicts a fact: another number, or that what it
    /// calls false is true.
    pub fn contradicting(&self, fact: &InitElement, speaker: &Owner) -> Vec<(Owner, InitElement)> {
        let (key, value) = match Statement::of(fact) {
            Statement::Is(key, value @ Value::Number(_)) => (key, Some(value)),
            Statement::Not(key) => (key, None),
            Statement::Is(..) | Statement::Unusable => return Vec::new(),
        };
        { self.beliefs.claims_of(&key) }
            .filter(|(owner, claim)| {
                *owner != speaker && claim.value != Value::Unknown && Some(claim.value) != value
            })
            .map(|(owner, claim)| (owner.clone(), key.element(claim.value)))
            .collect()
    }

    /// The agents that are here, in the order of their names.
    pub fn agents(&self, now: Moment) -> Vec<AgentView> {
        let composite = self.composed();
        { self.roster.iter() }
            .map(|(agent, member)| AgentView {
                agent: agent.clone(),
                incarnation: member.incarnation,
                digest: member.described.digest.to_string(),
                is_masked: member.is_masked,
                is_silent: member.is_silent,
                age: now.since(member.heard),
                actions: { composite.offers.get(agent).into_iter().flatten() }
                    .map(|offered| offered.outside.clone())
                    .filter(|action| member.is_present() && !self.is_withheld(action, agent))
                    .collect(),
            })
            .collect()
    }

    /// An agent and those it carries, also on each other: an agent is carried by another if its model says
    /// of the two, in whatever words, something that its own actions do not change, such as
    /// `(mounted-on ir-1 turtlebot-1)`.
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

    /// Whether the agent's capabilities count for new plans: it told its model, its token is
    /// here, and its heartbeats come.
    pub fn is_present(&self, agent: &AgentId) -> bool {
        self.roster.get(agent).is_some_and(Member::is_present)
    }

    /// Which life of an agent is here, present or not.
    pub fn incarnation(&self, agent: &AgentId) -> Option<Incarnation> {
        self.roster.get(agent).map(|member| member.incarnation)
    }

    /// Whether an agent's token is lost.
    pub fn is_masked(&self, agent: &AgentId) -> bool {
        self.roster.get(agent).is_some_and(|member| member.is_masked)
    }

    /// Everything that is left out of the composite, in a fixed order.
    pub fn conflicts(&self) -> Vec<Conflict> {
        match self.scope {
            Scope::Everything => self.conflicts.clone(),
            Scope::Public => self.compose(|_| false, &mut self.memory.clone()).1,
        }
    }

    /// Counts changes of the set of capabilities.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Counts changes of anything.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

/// A fact as a planner reads it: that it is unknown, or has a value, is a fact of its own.
fn in_words(knowledge: &Knowledge, element: InitElement) -> [Option<InitElement>; 2] {
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

// === impl ClaimedBy ===

impl ClaimedBy {
    fn new(fact: &FactKey, (owner, claim): (&Owner, &Claim), now: Moment) -> ClaimedBy {
        ClaimedBy {
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
