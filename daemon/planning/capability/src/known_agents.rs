//! The agents that a Domain Maintainer knows: their incarnations, their models, and whether new
//! plans may use their capabilities.

use std::collections::{BTreeMap, BTreeSet};

use acl::{AgentId, Incarnation};
use pddl::Name;

use crate::compose::Contribution;
use crate::declined::Declined;
use crate::fact::{FactKey, FactSymbolKind, FactValue};
use crate::limits;
use crate::parsed_model::ParsedModel;
use crate::timestamp::Timestamp;

/// A known agent: an agent that has announced its model.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    pub(crate) incarnation: Incarnation,
    /// Position of the agent in the order of arrival. A change of the model does not change the
    /// position.
    pub(crate) arrival: u64,
    pub(crate) described: ParsedModel,
    /// Whether the agent's liveliness token is lost.
    pub(crate) is_masked: bool,
    /// Whether the agent's heartbeats have stopped.
    pub(crate) is_silent: bool,
    /// Time at which the agent counts as silent unless a heartbeat arrives before; `None` if the
    /// agent never counts as silent.
    pub(crate) due: Option<Timestamp>,
    /// Time of the agent's entry in `KnownAgents::dues`, at or before `due`; `None` if the agent
    /// has no entry.
    looked: Option<Timestamp>,
    /// Number of the newest heartbeat of the agent's current incarnation.
    pub(crate) sequence: u64,
    pub(crate) heard_at: Timestamp,
    /// Number of the newest heartbeat that was parsed. The heartbeats after it had the same content
    /// and were not parsed.
    pub(crate) read: u64,
    /// Symbols of all facts that any heartbeat of the agent has contained. Each entry tells whether
    /// the symbol is a predicate or a function, and its name.
    reported_symbols: BTreeSet<(FactSymbolKind, Name)>,
    /// Facts that any heartbeat of the agent has contained and that mention no object of the agent.
    reported_facts: BTreeSet<FactKey>,
}

/// The known agents, and the last incarnations of agents that have left.
#[derive(Clone, Debug, Default)]
pub(crate) struct KnownAgents {
    members: BTreeMap<AgentId, Member>,
    former: BTreeMap<AgentId, Incarnation>,
    arrivals: u64,
    /// Times at which to check whether an agent is silent, each with the agent; at most one for
    /// each agent. With this index, a heartbeat never requires a scan of all agents, of which there
    /// may be a thousand. A heartbeat that is on time does not change the entry.
    dues: BTreeSet<(Timestamp, AgentId)>,
    /// Agents with capabilities that may have become available or unavailable since the last call
    /// of [`KnownAgents::take_presence_changes`].
    presence_changes: BTreeSet<AgentId>,
    /// For each object, the agents that declare it.
    bringers: BTreeMap<Name, BTreeSet<AgentId>>,
    /// For each fact, the agents that are responsible for it although it mentions no object that
    /// they declare.
    answering: BTreeMap<FactKey, BTreeSet<AgentId>>,
}

// === impl Member ===

impl Member {
    /// Creates a known agent in a new incarnation, with a liveliness token and without heartbeats.
    pub(crate) fn new(incarnation: Incarnation, described: ParsedModel, now: Timestamp) -> Member {
        Member {
            incarnation,
            arrival: 0,
            described,
            is_masked: false,
            is_silent: false,
            due: None,
            looked: None,
            sequence: 0,
            heard_at: now,
            read: 0,
            reported_symbols: BTreeSet::new(),
            reported_facts: BTreeSet::new(),
        }
    }

    /// Returns the agent in the same incarnation, with the given model in place of its own.
    pub(crate) fn with(self, described: ParsedModel) -> Member {
        Member { described, ..self }
    }

    /// Records that a heartbeat has arrived at `now`. The agent counts as silent if the next one
    /// has not arrived by `due`.
    fn record_heartbeat(&mut self, sequence: u64, due: Option<Timestamp>, now: Timestamp) {
        self.sequence = sequence;
        self.due = due;
        self.heard_at = now;
        self.is_silent = false;
    }

    /// Records that a heartbeat of the agent contains `fact`. From now on, a heartbeat of the agent
    /// lists all true facts with this symbol, and the agent is responsible for `fact`. Returns
    /// `true` if the fact is new in `reported_facts`.
    fn own(&mut self, fact: &FactKey) -> bool {
        let like = (fact.space(), fact.symbol().clone());
        if self.reported_symbols.len() < limits::DECLARATIONS_PER_AGENT_MAX {
            self.reported_symbols.insert(like);
        }
        let is_new = !self.reported_facts.contains(fact)
            && !self.names_its_own(fact)
            && self.reported_facts.len() < limits::FACTS_PER_OWNER_MAX;
        is_new && self.reported_facts.insert(fact.clone())
    }

    /// Whether a fact mentions an object that the agent declares.
    fn names_its_own(&self, fact: &FactKey) -> bool {
        let objects = &self.described.manifest.objects;
        fact.arguments().iter().any(|argument| objects.contains(argument))
    }

    /// Whether the agent is responsible for a fact, so that its claim overrides requests. The agent
    /// is responsible if its heartbeats have contained the fact. It is also responsible if the fact
    /// mentions an object of the agent and the symbol of the fact occurs in the agent's model or
    /// heartbeats.
    pub(crate) fn is_responsible_for(&self, fact: &FactKey) -> bool {
        let says = || {
            let like = (fact.space(), fact.symbol().clone());
            self.reported_symbols.contains(&like) || self.described.manifest.said.contains(&like)
        };
        self.reported_facts.contains(fact) || (self.names_its_own(fact) && says())
    }

    /// Whether a heartbeat of the agent lists all true facts with this symbol, so that a missing
    /// fact is false.
    pub(crate) fn reports_symbol(&self, space: FactSymbolKind, symbol: &Name) -> bool {
        let like = (space, symbol.clone());
        self.reported_symbols.contains(&like) || self.described.manifest.owned.contains(&like)
    }

    /// Returns the symbols of facts that the agent may be responsible for. Each entry tells whether
    /// the symbol is a predicate or a function, and its name.
    pub(crate) fn symbols(&self) -> impl Iterator<Item = &(FactSymbolKind, Name)> {
        self.reported_symbols.union(&self.described.manifest.said)
    }

    /// Returns the facts that the agent is responsible for although they mention none of its
    /// objects.
    pub(crate) fn reported_facts(&self) -> impl Iterator<Item = &FactKey> {
        self.reported_facts.iter()
    }

    /// Whether a heartbeat of the agent lists all true facts with the symbol of `fact`, so that a
    /// missing fact is false.
    pub(crate) fn owns(&self, fact: &FactKey) -> bool {
        self.reports_symbol(fact.space(), fact.symbol())
    }

    /// Whether this agent, named `own`, is carried by the agent `base`. This holds if its model
    /// contains a fact about the two that its own actions do not change. The fact names `own`, then
    /// `base`, and perhaps more, as in `(fixed-to arm-1 robot-1 front)`; or `base` and `own` alone,
    /// as in `(carries robot-1 arm-1)`.
    pub(crate) fn is_carried_by(&self, own: &AgentId, base: &AgentId) -> bool {
        let manifest = &self.described.manifest;
        let is_pair = |one: &Name, other: &Name| *one == own.as_str() && *other == base.as_str();
        let is_about = |arguments: &[Name]| match arguments {
            [first, second] => is_pair(first, second) || is_pair(second, first),
            [first, second, ..] => is_pair(first, second),
            _ => false,
        };
        manifest.init.iter().any(|(fact, value)| {
            *value != FactValue::Unknown
                && is_about(fact.arguments())
                && !manifest.owned.contains(&(fact.space(), fact.symbol().clone()))
        })
    }

    /// Whether new plans may use the agent's capabilities.
    pub(crate) fn is_present(&self) -> bool {
        !self.is_masked && !self.is_silent
    }
}

// === impl KnownAgents ===

impl KnownAgents {
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&AgentId, &Member)> {
        self.members.iter()
    }

    pub(crate) fn get(&self, agent: &AgentId) -> Option<&Member> {
        self.members.get(agent)
    }

    /// Returns the contributions of all known agents to a composition, sorted by name.
    pub(crate) fn parties(
        &self,
        trusts: impl Fn(&AgentId) -> bool,
    ) -> impl Iterator<Item = Contribution<'_>> {
        self.members.iter().map(move |(agent, member)| Contribution {
            agent,
            arrival: member.arrival,
            manifest: &member.described.manifest,
            trusted: trusts(agent),
        })
    }

    /// Returns the contribution of an agent, with its whole model, to a composition; `None` if the
    /// agent has not announced a model.
    pub(crate) fn party(&self, agent: &AgentId) -> Option<Contribution<'_>> {
        let (agent, member) = self.members.get_key_value(agent)?;
        let manifest = &*member.described.manifest;
        Some(Contribution { agent, arrival: member.arrival, manifest, trusted: true })
    }

    /// Returns the agents with capabilities that may have become available or unavailable since the
    /// last call. The flag with each agent is `true` if new plans may use its capabilities now.
    pub(crate) fn take_presence_changes(&mut self) -> Vec<(AgentId, bool)> {
        let stirred = std::mem::take(&mut self.presence_changes).into_iter();
        let is_present = |agent: &AgentId| self.members.get(agent).is_some_and(Member::is_present);
        stirred.map(|agent| (agent.clone(), is_present(&agent))).collect()
    }

    /// Records that a heartbeat of `agent` contains `fact`.
    pub(crate) fn own(&mut self, agent: &AgentId, fact: &FactKey) {
        let Some(member) = self.members.get_mut(agent) else { return };
        if member.own(fact) {
            self.answering.entry(fact.clone()).or_default().insert(agent.clone());
        }
    }

    /// Returns the known agents that are responsible for a fact.
    pub(crate) fn answering(&self, fact: &FactKey) -> BTreeSet<&AgentId> {
        let bringers = fact.arguments().iter().filter_map(|object| self.bringers.get(object));
        let named = bringers.flatten().filter(|agent| {
            self.members.get(*agent).is_some_and(|member| member.is_responsible_for(fact))
        });
        let others = self.answering.get(fact).into_iter().flatten();
        named.chain(others).collect()
    }

    /// Adds an agent to the indexes of agents by object and by fact.
    fn index(&mut self, agent: &AgentId, member: &Member) {
        for object in &member.described.manifest.objects {
            self.bringers.entry(object.clone()).or_default().insert(agent.clone());
        }
        for fact in &member.reported_facts {
            self.answering.entry(fact.clone()).or_default().insert(agent.clone());
        }
    }

    fn unindex(&mut self, agent: &AgentId, member: &Member) {
        for object in &member.described.manifest.objects {
            remove_from(&mut self.bringers, object, agent);
        }
        for fact in &member.reported_facts {
            remove_from(&mut self.answering, fact, agent);
        }
    }

    /// Records that a heartbeat of an agent has arrived. Returns an error if the agent has not
    /// announced its model.
    pub(crate) fn record_heartbeat(
        &mut self,
        agent: &AgentId,
        sequence: u64,
        due: Option<Timestamp>,
        now: Timestamp,
    ) -> Result<&mut Member, Declined> {
        let unknown = || Declined::UnknownAgent { agent: agent.clone() };
        let member = self.members.get_mut(agent).ok_or_else(unknown)?;
        if member.is_silent {
            self.presence_changes.insert(agent.clone());
        }
        member.record_heartbeat(sequence, due, now);
        if let Some(due) = due
            && member.looked.is_none_or(|looked| due < looked)
        {
            if let Some(looked) = member.looked.replace(due) {
                self.dues.remove(&(looked, agent.clone()));
            }
            self.dues.insert((due, agent.clone()));
        }
        Ok(member)
    }

    /// Marks the agents with an overdue heartbeat as silent.
    pub(crate) fn mark_silent(&mut self, now: Timestamp) {
        while self.dues.first().is_some_and(|(due, _)| *due <= now) {
            let Some((_, agent)) = self.dues.pop_first() else { return };
            let Some(member) = self.members.get_mut(&agent) else { continue };
            member.looked = None;
            match member.due {
                Some(due) if due > now => {
                    member.looked = Some(due);
                    self.dues.insert((due, agent));
                }
                Some(_) => {
                    (member.due, member.is_silent) = (None, true);
                    self.presence_changes.insert(agent);
                }
                None => (),
            }
        }
    }

    /// Returns the next time at which an agent may become silent; `None` if no agent can.
    pub(crate) fn next_silence(&self) -> Option<Timestamp> {
        self.dues.first().map(|(due, _)| *due)
    }

    /// Records that the liveliness token of an agent is lost or has returned.
    pub(crate) fn mask(&mut self, agent: &AgentId, reported: Incarnation, is_masked: bool) {
        if let Ok(member) = self.current(agent, reported)
            && std::mem::replace(&mut member.is_masked, is_masked) != is_masked
        {
            self.presence_changes.insert(agent.clone());
        }
    }

    /// Checks that a message is not from a former incarnation of the agent. Returns an error if it
    /// is.
    pub(crate) fn check(&self, agent: &AgentId, reported: Incarnation) -> Result<(), Declined> {
        let current = self.members.get(agent).map(|member| member.incarnation);
        match current.or_else(|| self.former.get(agent).copied()) {
            Some(current) if reported < current => {
                Err(Declined::FormerIncarnation { agent: agent.clone(), reported, current })
            }
            _ => Ok(()),
        }
    }

    /// Returns the data of an agent. Returns an error if the agent has not announced its model, or
    /// if `reported` is not its current incarnation.
    pub(crate) fn current(
        &mut self,
        agent: &AgentId,
        reported: Incarnation,
    ) -> Result<&mut Member, Declined> {
        self.check(agent, reported)?;
        self.members
            .get_mut(agent)
            .filter(|member| member.incarnation == reported)
            .ok_or_else(|| Declined::UnknownAgent { agent: agent.clone() })
    }

    /// Checks that `agent` may be added. Returns an error if there are too many agents.
    pub(crate) fn has_room(&self, agent: &AgentId) -> Result<(), Declined> {
        if self.members.len() < limits::AGENTS_MAX || self.members.contains_key(agent) {
            return Ok(());
        }
        Err(Declined::TooMany { what: "agents", limit: limits::AGENTS_MAX })
    }

    /// Adds an agent, or replaces the data of a known agent of the same name. A known agent keeps
    /// its position in the order of arrival.
    pub(crate) fn insert_member(&mut self, agent: &AgentId, member: Member) {
        let arrival = self.members.get(agent).map(|member| member.arrival).unwrap_or_else(|| {
            self.arrivals += 1;
            self.arrivals
        });
        self.former.remove(agent);
        self.presence_changes.insert(agent.clone());
        let looked = member.due;
        let member = Member { arrival, looked, ..member };
        let known = self.members.remove(agent);
        if let Some(known) = &known {
            self.unindex(agent, known);
        }
        self.index(agent, &member);
        self.members.insert(agent.clone(), member);
        if let Some(looked) = known.and_then(|known| known.looked) {
            self.dues.remove(&(looked, agent.clone()));
        }
        self.dues.extend(looked.map(|looked| (looked, agent.clone())));
    }

    /// Removes an agent, and records its incarnation as a former one. Returns the data of the
    /// agent; `None` if it has not announced a model.
    pub(crate) fn remove_member(&mut self, agent: &AgentId) -> Option<Member> {
        let member = self.members.remove(agent)?;
        self.unindex(agent, &member);
        self.presence_changes.insert(agent.clone());
        if let Some(looked) = member.looked {
            self.dues.remove(&(looked, agent.clone()));
        }
        self.former.insert(agent.clone(), member.incarnation);
        if self.former.len() > limits::FORMER_MAX {
            let oldest = self.former.iter().min_by_key(|(_, incarnation)| **incarnation);
            let oldest = oldest.map(|(agent, _)| agent.clone());
            oldest.and_then(|agent| self.former.remove(&agent));
        }
        Some(member)
    }
}

fn remove_from<K: Ord>(index: &mut BTreeMap<K, BTreeSet<AgentId>>, key: &K, agent: &AgentId) {
    if let Some(agents) = index.get_mut(key) {
        agents.remove(agent);
        if agents.is_empty() {
            index.remove(key);
        }
    }
}
