//! Agents that are away for long, and that are back: what leaves together is told together.

use std::collections::{BTreeMap, BTreeSet};

use acl::{AgentId, DaemonId, Incarnation};
use agent::Presence;

use crate::notice::{Notice, NoticeKind, NoticeTime};

/// Maximum number of agents that are remembered.
const AGENTS_MAX: usize = 20_000;

/// Time for which an agent that is back is watched before it is told, in milliseconds: the agents
/// of one daemon come back together, and are told in one notice.
const BACK_SETTLES_MS: u64 = 2_000;

/// Part of the time before an absence is told by which absences may differ and still be told
/// together: the agents of one daemon leave within seconds.
const TOGETHER_PART: u64 = 10;

#[derive(Debug, Default)]
struct AgentAbsence {
    replicas: BTreeSet<(DaemonId, Incarnation)>,
    /// Whether the agent is reported as silent.
    is_silent: bool,
    away_since_ms: Option<u64>,
    /// Whether people were told that the agent is gone.
    is_told: bool,
    back_since_ms: Option<u64>,
    newest: Incarnation,
    /// Number of absences that were told, so that each has an identifier of its own.
    told: u32,
}

/// The agents that are away.
#[derive(Debug)]
pub(super) struct Absences {
    gone_after_ms: u64,
    agents: BTreeMap<AgentId, AgentAbsence>,
}

// === impl Absences ===

impl Absences {
    pub(super) fn new(gone_after_ms: u64) -> Absences {
        Absences { gone_after_ms, agents: BTreeMap::new() }
    }

    /// Takes a change of presence. Guests, such as commands, come and go.
    pub(super) fn presence(&mut self, presence: &Presence, is_start: bool, now_ms: u64) {
        let resident = presence.resident();
        if resident.daemon.is_guest() || !self.has_room_for(&resident.agent) {
            return;
        }
        let is_known = self.agents.contains_key(&resident.agent);
        if !is_known && matches!(presence, Presence::Left(_)) {
            return;
        }
        let trace = self.agents.entry(resident.agent.clone()).or_default();
        let replica = (resident.daemon.clone(), resident.incarnation);
        match presence {
            Presence::Joined(_) => {
                trace.newest = trace.newest.max(resident.incarnation);
                trace.replicas.insert(replica);
                trace.is_silent = false;
            }
            Presence::Left(_) => {
                trace.replicas.remove(&replica);
            }
        }
        trace.judge(now_ms);
        if is_start {
            trace.back_since_ms = None;
        }
    }

    /// Whether the agent can be remembered. One that is gone for good gives way.
    fn has_room_for(&mut self, agent: &AgentId) -> bool {
        if self.agents.len() < AGENTS_MAX || self.agents.contains_key(agent) {
            return true;
        }
        let gone = self.agents.iter().find(|(_, trace)| trace.is_told);
        let gone = gone.map(|(agent, _)| agent.clone());
        gone.is_some_and(|gone| self.agents.remove(&gone).is_some())
    }

    /// Takes an announcement of the Domain Maintainer about agents with capabilities.
    pub(super) fn changed(&mut self, left: &[AgentId], joined: &[AgentId], now_ms: u64) {
        for (agents, is_silent) in [(left, true), (joined, false)] {
            for agent in agents {
                if let Some(trace) = self.agents.get_mut(agent) {
                    trace.is_silent = is_silent;
                    trace.judge(now_ms);
                }
            }
        }
    }

    /// Notes that an agent was heard: it is not silent any more.
    pub(super) fn heard(&mut self, agent: &AgentId, now_ms: u64) {
        if let Some(trace) = self.agents.get_mut(agent).filter(|trace| trace.is_silent) {
            trace.is_silent = false;
            trace.judge(now_ms);
        }
    }

    /// Returns the next time at which something is due.
    pub(super) fn next_due_ms(&self) -> Option<u64> {
        self.agents.values().filter_map(|trace| trace.due_ms(self.gone_after_ms)).min()
    }

    /// Returns notices of what is due now.
    pub(super) fn due(&mut self, now: NoticeTime) -> Vec<Notice> {
        let now_ms = now.steady_ms;
        let after_ms = self.gone_after_ms;
        let is_any = self.next_due_ms().is_some_and(|due| due <= now_ms);
        if !is_any {
            return Vec::new();
        }
        let soon_ms = now_ms.saturating_add(after_ms / TOGETHER_PART);
        let (mut gone, mut back) = (Vec::new(), Vec::new());
        for (agent, trace) in &mut self.agents {
            // What is due in a moment is told with what is due now.
            if trace.due_ms(after_ms).is_none_or(|due| due > soon_ms) {
                continue;
            }
            match trace.away_since_ms {
                Some(_) => {
                    trace.is_told = true;
                    trace.told = trace.told.wrapping_add(1);
                    gone.push((agent.clone(), trace.number()));
                }
                None => {
                    (trace.is_told, trace.back_since_ms) = (false, None);
                    back.push((agent.clone(), trace.number()));
                }
            }
        }
        let kinds = [(NoticeKind::AgentGone, gone), (NoticeKind::AgentBack, back)];
        let kinds = kinds.into_iter().filter(|(_, agents)| !agents.is_empty());
        kinds.map(|(kind, agents)| notice(kind, agents, now.wall_ms)).collect()
    }
}

fn notice(kind: NoticeKind, agents: Vec<(AgentId, String)>, wall_ms: u64) -> Notice {
    let about: Vec<_> = agents.iter().map(|(agent, number)| format!("{agent} {number}")).collect();
    let agents = agents.into_iter().map(|(agent, _)| agent).collect();
    Notice::new(kind, &about.join("\n"), wall_ms).with_agents(agents)
}

// === impl AgentAbsence ===

impl AgentAbsence {
    /// Returns the number of the last absence, which replicas of the notifier count alike.
    fn number(&self) -> String {
        format!("{} {}", self.newest, self.told)
    }

    /// Notes whether the agent is away, and since when.
    fn judge(&mut self, now_ms: u64) {
        let is_away = self.replicas.is_empty() || self.is_silent;
        match (is_away, self.away_since_ms) {
            (true, None) => (self.away_since_ms, self.back_since_ms) = (Some(now_ms), None),
            (false, Some(_)) => {
                self.away_since_ms = None;
                self.back_since_ms = self.is_told.then_some(now_ms);
            }
            _ => (),
        }
    }

    /// Returns when people are to be told of the absence or the return.
    fn due_ms(&self, gone_after_ms: u64) -> Option<u64> {
        match (self.away_since_ms, self.back_since_ms) {
            (Some(since), _) if !self.is_told => Some(since.saturating_add(gone_after_ms)),
            (None, Some(since)) => Some(since.saturating_add(BACK_SETTLES_MS)),
            _ => None,
        }
    }
}
