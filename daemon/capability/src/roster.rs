//! The agents that are here: which life, which model, and whether their capabilities count.

use std::collections::{BTreeMap, BTreeSet};

use acl::{AgentId, Incarnation};
use pddl::Name;

use crate::compose::Party;
use crate::declined::Declined;
use crate::described::Described;
use crate::fact::{FactKey, Space};
use crate::limits;
use crate::moment::Moment;

/// One agent that told its model.
#[derive(Clone, Debug)]
pub(crate) struct Member {
    pub(crate) incarnation: Incarnation,
    /// Counts arrivals; kept over a change of the model.
    pub(crate) arrival: u64,
    pub(crate) described: Described,
    /// Its liveliness token is lost.
    pub(crate) is_masked: bool,
    /// Its heartbeats stopped.
    pub(crate) is_silent: bool,
    /// When silence begins, if no heartbeat comes.
    pub(crate) due: Option<Moment>,
    /// When it is looked whether that is so: not after `due`.
    looked: Option<Moment>,
    /// The newest heartbeat of this incarnation.
    pub(crate) sequence: u64,
    pub(crate) heard: Moment,
    /// The newest that was read: those after it said the same.
    pub(crate) read: u64,
    /// The symbols that its heartbeats ever spoke of.
    spoken: BTreeSet<(Space, Name)>,
    /// The facts that its heartbeats ever spoke of and that name none of its objects.
    answered: BTreeSet<FactKey>,
}

/// All of them, and who was here before.
#[derive(Clone, Debug, Default)]
pub(crate) struct Roster {
    members: BTreeMap<AgentId, Member>,
    former: BTreeMap<AgentId, Incarnation>,
    arrivals: u64,
    /// When to look whether a member is silent, and at most one entry for each: with a thousand of
    /// them, nobody is to look through all at every heartbeat, and a heartbeat that comes in time
    /// does not touch the entry that is there.
    dues: BTreeSet<(Moment, AgentId)>,
    /// Whose presence may be another than when it was asked for last.
    stirred: BTreeSet<AgentId>,
    /// Who brings an object.
    bringers: BTreeMap<Name, BTreeSet<AgentId>>,
    /// Who answers for a fact that names none of its objects.
    answering: BTreeMap<FactKey, BTreeSet<AgentId>>,
}

// === impl Member ===

impl Member {
    /// A life that begins, with a token and without a heartbeat.
    pub(crate) fn new(incarnation: Incarnation, described: Described, now: Moment) -> Member {
        Member {
            incarnation,
            arrival: 0,
            described,
            is_masked: false,
            is_silent: false,
            due: None,
            looked: None,
            sequence: 0,
            heard: now,
            read: 0,
            spoken: BTreeSet::new(),
            answered: BTreeSet::new(),
        }
    }

    /// The same life with another model.
    pub(crate) fn with(self, described: Described) -> Member {
        Member { described, ..self }
    }

    /// A heartbeat came.
    fn hear(&mut self, sequence: u64, due: Option<Moment>, now: Moment) {
        self.sequence = sequence;
        self.due = due;
        self.heard = now;
        self.is_silent = false;
    }

    /// The agent's heartbeats are complete for facts like this one from now on, and it answers for this
    /// one; whether that is new and the fact names none of its objects.
    fn own(&mut self, fact: &FactKey) -> bool {
        let like = (fact.space(), fact.symbol().clone());
        if self.spoken.len() < limits::DECLARATIONS_PER_AGENT_MAX {
            self.spoken.insert(like);
        }
        let is_new = !self.answered.contains(fact)
            && !self.names_its_own(fact)
            && self.answered.len() < limits::FACTS_PER_OWNER_MAX;
        is_new && self.answered.insert(fact.clone())
    }

    /// Whether a fact names an object that the agent brings.
    fn names_its_own(&self, fact: &FactKey) -> bool {
        let objects = &self.described.manifest.objects;
        fact.arguments().iter().any(|argument| objects.contains(argument))
    }

    /// Whether the agent is the one who says whether a fact is so: its heartbeats spoke of it, or it is
    /// about an object of the agent's, and in words that its model or its heartbeats use.
    pub(crate) fn answers(&self, fact: &FactKey) -> bool {
        let says = || {
            let like = (fact.space(), fact.symbol().clone());
            self.spoken.contains(&like) || self.described.manifest.said.contains(&like)
        };
        self.answered.contains(fact) || (self.names_its_own(fact) && says())
    }

    /// Whether its heartbeats are complete for facts of this symbol.
    pub(crate) fn speaks_of(&self, space: Space, symbol: &Name) -> bool {
        let like = (space, symbol.clone());
        self.spoken.contains(&like) || self.described.manifest.owned.contains(&like)
    }

    /// The symbols for whose facts it may answer.
    pub(crate) fn symbols(&self) -> impl Iterator<Item = &(Space, Name)> {
        self.spoken.union(&self.described.manifest.said)
    }

    /// The facts that name none of its objects and for which it answers.
    pub(crate) fn answered(&self) -> impl Iterator<Item = &FactKey> {
        self.answered.iter()
    }

    /// Whether the agent's heartbeats are complete for facts like this one.
    pub(crate) fn owns(&self, fact: &FactKey) -> bool {
        self.speaks_of(fact.space(), fact.symbol())
    }

    /// Whether its model says that it is on another agent, for good.
    pub(crate) fn is_carried_by(&self, own: &AgentId, base: &AgentId) -> bool {
        let manifest = &self.described.manifest;
        manifest.init.iter().any(|(fact, _)| match fact.arguments() {
            [carried, on] => {
                *carried == own.as_str()
                    && *on == base.as_str()
                    && !manifest.owned.contains(&(fact.space(), fact.symbol().clone()))
            }
            _ => false,
        })
    }

    /// Whether its capabilities count for new plans.
    pub(crate) fn is_present(&self) -> bool {
        !self.is_masked && !self.is_silent
    }
}

// === impl Roster ===

impl Roster {
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&AgentId, &Member)> {
        self.members.iter()
    }

    pub(crate) fn get(&self, agent: &AgentId) -> Option<&Member> {
        self.members.get(agent)
    }

    /// All of them as they are composed, in the order of their names.
    pub(crate) fn parties(
        &self,
        trusts: impl Fn(&AgentId) -> bool,
    ) -> impl Iterator<Item = Party<'_>> {
        self.members.iter().map(move |(agent, member)| Party {
            agent,
            arrival: member.arrival,
            manifest: &member.described.manifest,
            trusted: trusts(agent),
        })
    }

    /// One of them, as it is composed where all models are known whole.
    pub(crate) fn party(&self, agent: &AgentId) -> Option<Party<'_>> {
        let (agent, member) = self.members.get_key_value(agent)?;
        let manifest = &*member.described.manifest;
        Some(Party { agent, arrival: member.arrival, manifest, trusted: true })
    }

    /// Whose presence may have changed since this was asked last, and whether their capabilities
    /// count for new plans now.
    pub(crate) fn take_stirred(&mut self) -> Vec<(AgentId, bool)> {
        let stirred = std::mem::take(&mut self.stirred).into_iter();
        let is_present = |agent: &AgentId| self.members.get(agent).is_some_and(Member::is_present);
        stirred.map(|agent| (agent.clone(), is_present(&agent))).collect()
    }

    /// A member's heartbeat speaks of a fact.
    pub(crate) fn own(&mut self, agent: &AgentId, fact: &FactKey) {
        let Some(member) = self.members.get_mut(agent) else { return };
        if member.own(fact) {
            self.answering.entry(fact.clone()).or_default().insert(agent.clone());
        }
    }

    /// The members who say whether a fact is so.
    pub(crate) fn answering(&self, fact: &FactKey) -> BTreeSet<&AgentId> {
        let bringers = fact.arguments().iter().filter_map(|object| self.bringers.get(object));
        let named = bringers
            .flatten()
            .filter(|agent| self.members.get(*agent).is_some_and(|member| member.answers(fact)));
        let others = self.answering.get(fact).into_iter().flatten();
        named.chain(others).collect()
    }

    /// A member is in the indexes by which it is found, or not any more.
    fn index(&mut self, agent: &AgentId, member: &Member) {
        for object in &member.described.manifest.objects {
            self.bringers.entry(object.clone()).or_default().insert(agent.clone());
        }
        for fact in &member.answered {
            self.answering.entry(fact.clone()).or_default().insert(agent.clone());
        }
    }

    fn unindex(&mut self, agent: &AgentId, member: &Member) {
        for object in &member.described.manifest.objects {
            remove_from(&mut self.bringers, object, agent);
        }
        for fact in &member.answered {
            remove_from(&mut self.answering, fact, agent);
        }
    }

    /// A member's heartbeat came.
    pub(crate) fn hear(
        &mut self,
        agent: &AgentId,
        sequence: u64,
        due: Option<Moment>,
        now: Moment,
    ) -> Result<&mut Member, Declined> {
        let unknown = || Declined::UnknownAgent { agent: agent.clone() };
        let member = self.members.get_mut(agent).ok_or_else(unknown)?;
        if member.is_silent {
            self.stirred.insert(agent.clone());
        }
        member.hear(sequence, due, now);
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

    /// Marks those whose next heartbeat is overdue.
    pub(crate) fn fall_silent(&mut self, now: Moment) {
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
                    self.stirred.insert(agent);
                }
                None => (),
            }
        }
    }

    /// When the next of them may be overdue.
    pub(crate) fn next_silence(&self) -> Option<Moment> {
        self.dues.first().map(|(due, _)| *due)
    }

    /// A member's token is lost, or back.
    pub(crate) fn mask(&mut self, agent: &AgentId, reported: Incarnation, is_masked: bool) {
        if let Ok(member) = self.living(agent, reported)
            && std::mem::replace(&mut member.is_masked, is_masked) != is_masked
        {
            self.stirred.insert(agent.clone());
        }
    }

    /// Whether a word of this life may be believed: it is not older than the newest known.
    pub(crate) fn check(&self, agent: &AgentId, reported: Incarnation) -> Result<(), Declined> {
        let current = self.members.get(agent).map(|member| member.incarnation);
        match current.or_else(|| self.former.get(agent).copied()) {
            Some(current) if reported < current => {
                Err(Declined::FormerIncarnation { agent: agent.clone(), reported, current })
            }
            _ => Ok(()),
        }
    }

    /// The member, if it is exactly this life of it that speaks.
    pub(crate) fn living(
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

    /// Whether there is a place for `agent`.
    pub(crate) fn has_room(&self, agent: &AgentId) -> Result<(), Declined> {
        if self.members.len() < limits::AGENTS_MAX || self.members.contains_key(agent) {
            return Ok(());
        }
        Err(Declined::TooMany { what: "agents", limit: limits::AGENTS_MAX })
    }

    /// Takes a member in, in place of what was known of it. Who is here already keeps its
    /// seniority.
    pub(crate) fn seat(&mut self, agent: &AgentId, member: Member) {
        let arrival = self.members.get(agent).map(|member| member.arrival).unwrap_or_else(|| {
            self.arrivals += 1;
            self.arrivals
        });
        self.former.remove(agent);
        self.stirred.insert(agent.clone());
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

    /// Lets a member go, and remembers which life it was.
    pub(crate) fn release(&mut self, agent: &AgentId) -> Option<Member> {
        let member = self.members.remove(agent)?;
        self.unindex(agent, &member);
        self.stirred.insert(agent.clone());
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
