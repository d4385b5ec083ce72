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
    /// What its heartbeats ever spoke of.
    spoken: BTreeSet<(Space, Name)>,
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

    /// The agent's heartbeats are complete for facts like this one from now on.
    pub(crate) fn own(&mut self, fact: &FactKey) {
        self.spoken.insert((fact.space(), fact.symbol().clone()));
    }

    /// Whether the agent's heartbeats are complete for facts like this one.
    pub(crate) fn owns(&self, fact: &FactKey) -> bool {
        let like = (fact.space(), fact.symbol().clone());
        self.spoken.contains(&like) || self.described.manifest.owned.contains(&like)
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
        let known = self.members.insert(agent.clone(), Member { arrival, looked, ..member });
        if let Some(looked) = known.and_then(|known| known.looked) {
            self.dues.remove(&(looked, agent.clone()));
        }
        self.dues.extend(looked.map(|looked| (looked, agent.clone())));
    }

    /// Lets a member go, and remembers which life it was.
    pub(crate) fn release(&mut self, agent: &AgentId) -> Option<Member> {
        let member = self.members.remove(agent)?;
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
