//! The agents that are here: which life, which model, and whether their capabilities count.

use std::collections::{BTreeMap, BTreeSet};

use acl::{AgentId, Incarnation};
use pddl::Name;

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
    /// The newest heartbeat of this incarnation.
    pub(crate) sequence: u64,
    pub(crate) heard: Moment,
    /// What its heartbeats ever spoke of.
    spoken: BTreeSet<(Space, Name)>,
}

/// All of them, and who was here before.
#[derive(Clone, Debug, Default)]
pub(crate) struct Roster {
    members: BTreeMap<AgentId, Member>,
    former: BTreeMap<AgentId, Incarnation>,
    arrivals: u64,
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
            sequence: 0,
            heard: now,
            spoken: BTreeSet::new(),
        }
    }

    /// The same life with another model.
    pub(crate) fn with(self, described: Described) -> Member {
        Member { described, ..self }
    }

    /// A heartbeat came.
    pub(crate) fn hear(&mut self, sequence: u64, due: Option<Moment>, now: Moment) {
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

    /// Those whose capabilities count for new plans.
    pub(crate) fn present(&self) -> impl Iterator<Item = &AgentId> {
        self.members.iter().filter(|(_, member)| member.is_present()).map(|(agent, _)| agent)
    }

    /// Marks those whose next heartbeat is overdue.
    pub(crate) fn fall_silent(&mut self, now: Moment) {
        for member in self.members.values_mut() {
            if member.due.is_some_and(|due| due <= now) {
                member.due = None;
                member.is_silent = true;
            }
        }
    }

    /// When the next of them is overdue.
    pub(crate) fn next_silence(&self) -> Option<Moment> {
        self.members.values().filter_map(|member| member.due).min()
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
        self.members.insert(agent.clone(), Member { arrival, ..member });
    }

    /// Lets a member go, and remembers which life it was.
    pub(crate) fn release(&mut self, agent: &AgentId) -> Option<Member> {
        let member = self.members.remove(agent)?;
        self.former.insert(agent.clone(), member.incarnation);
        if self.former.len() > limits::FORMER_MAX {
            let oldest = self.former.iter().min_by_key(|(_, incarnation)| **incarnation);
            let oldest = oldest.map(|(agent, _)| agent.clone());
            oldest.and_then(|agent| self.former.remove(&agent));
        }
        Some(member)
    }
}
