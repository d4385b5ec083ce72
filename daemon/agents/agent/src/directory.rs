//! Directory of the present agents, with their daemons and incarnations, as one daemon sees them.
//! Presence changes update the directory.

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::{AgentId, DaemonId, Incarnation};
use substrate::{AgentAddress, Presence, Resident};

/// Directory: the agents that this daemon can reach.
///
/// Several agents of one name may appear at several daemons. The oldest one (the one with the
/// smallest incarnation) holds the name: messages to the name go to it. The others wait, and the next
/// oldest becomes the holder when the first leaves.
#[derive(Clone, Debug, Default)]
pub struct Directory {
    /// Agents of each name, the oldest first, which holds the name. All clones of the directory
    /// share the lists, because a change of presence affects the list of one name only.
    residents: BTreeMap<AgentId, Arc<Vec<Resident>>>,
}

impl Directory {
    /// Returns the oldest present agent of this name, which holds the name; `None` if no agent of
    /// the name is present.
    pub fn find(&self, agent: &AgentId) -> Option<&Resident> {
        self.residents.get(agent)?.first()
    }

    /// Returns all agents of this name: first the oldest one, which holds the name, then the
    /// others.
    pub fn all(&self, agent: &AgentId) -> &[Resident] {
        self.residents.get(agent).map_or(&[], |all| all.as_slice())
    }

    /// Returns this incarnation of an agent, also if an older agent holds the name; `None` if it is
    /// not present.
    pub fn find_incarnation(&self, agent: &AgentId, incarnation: Incarnation) -> Option<&Resident> {
        self.residents.get(agent)?.iter().find(|resident| resident.incarnation == incarnation)
    }

    /// Returns the agent of this name that has the incarnation of the one at `daemon` and comes
    /// before it; `None` if there is none. Two clocks that agree to the microsecond give two replicas
    /// one number, and then no receiver could tell their messages apart.
    pub(crate) fn twin_before(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        daemon: &DaemonId,
    ) -> Option<&Resident> {
        let is_twin =
            |other: &&Resident| other.incarnation == incarnation && other.daemon < *daemon;
        self.all(agent).iter().find(is_twin)
    }

    /// Returns the address of the oldest present agent of this name, which holds the name; `None`
    /// if no agent of the name is present.
    pub fn address(&self, agent: &AgentId) -> Option<AgentAddress> {
        let resident = self.find(agent)?;
        Some(AgentAddress { daemon: resident.daemon.clone(), agent: agent.clone() })
    }

    /// Returns, for each name, the oldest present agent, which holds the name; in the order of
    /// names.
    pub fn iter(&self) -> impl Iterator<Item = &Resident> {
        self.residents.values().filter_map(|residents| residents.first())
    }

    /// Returns the number of names that present agents hold.
    pub fn count(&self) -> usize {
        self.residents.len()
    }

    /// Returns the daemons that host at least one agent that holds its name.
    pub fn daemons(&self) -> impl Iterator<Item = &DaemonId> {
        let mut daemons: Vec<_> = self.iter().map(|resident| &resident.daemon).collect();
        daemons.sort();
        daemons.dedup();
        daemons.into_iter()
    }

    /// Applies a presence change. Returns the resulting changes of the agents that hold a name: an
    /// agent that becomes the oldest of its name counts as joined, and one that no longer is the
    /// oldest counts as left.
    pub fn update(&mut self, presence: &Presence) -> Vec<Presence> {
        let agent = &presence.resident().agent;
        let before = self.find(agent).cloned();
        let residents = Arc::make_mut(self.residents.entry(agent.clone()).or_default());
        match presence {
            Presence::Joined(resident) => {
                // A daemon has one incarnation of an agent at a time; the newest token is valid.
                residents.retain(|known| known.daemon != resident.daemon);
                residents.push(resident.clone());
                residents
                    .sort_by(|a, b| (a.incarnation, &a.daemon).cmp(&(b.incarnation, &b.daemon)));
            }
            Presence::Left(resident) => residents.retain(|known| known != resident),
        }
        let after = residents.first().cloned();
        if residents.is_empty() {
            self.residents.remove(agent);
        }
        match (before, after) {
            (before, after) if before == after => Vec::new(),
            (Some(before), Some(after)) => vec![Presence::Left(before), Presence::Joined(after)],
            (Some(before), None) => vec![Presence::Left(before)],
            (None, Some(after)) => vec![Presence::Joined(after)],
            (None, None) => Vec::new(),
        }
    }

    /// Returns the presence changes that turn `self` into `other`, for a listener that has missed
    /// changes.
    pub fn changes_to(&self, other: &Directory) -> Vec<Presence> {
        let left = self
            .iter()
            .filter(|resident| other.find(&resident.agent) != Some(*resident))
            .map(|resident| Presence::Left(resident.clone()));
        let joined = other
            .iter()
            .filter(|resident| self.find(&resident.agent) != Some(*resident))
            .map(|resident| Presence::Joined(resident.clone()));
        left.chain(joined).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resident(agent: &str, daemon: &str, incarnation: u64) -> Resident {
        Resident {
            agent: AgentId::new(agent).expect("a name"),
            daemon: DaemonId::new(daemon).expect("a name"),
            incarnation: Incarnation(incarnation),
        }
    }

    #[test]
    fn the_first_keeps_the_name_and_the_younger_one_inherits_it() {
        let mut directory = Directory::default();
        let (first, younger) = (resident("robot", "b", 1), resident("robot", "a", 2));
        let joined = directory.update(&Presence::Joined(first.clone()));
        assert_eq!(joined, [Presence::Joined(first.clone())]);
        assert_eq!(directory.update(&Presence::Joined(younger.clone())), []);
        assert_eq!(directory.all(&younger.agent)[1..], *std::slice::from_ref(&younger));

        let changes = directory.update(&Presence::Left(first.clone()));

        assert_eq!(changes, [Presence::Left(first), Presence::Joined(younger.clone())]);
        assert_eq!(directory.find(&younger.agent), Some(&younger));
    }

    #[test]
    fn a_restart_is_a_leaving_and_a_joining() {
        let mut directory = Directory::default();
        let (old, new) = (resident("robot", "a", 1), resident("robot", "a", 2));
        directory.update(&Presence::Joined(old.clone()));
        let changes = directory.update(&Presence::Joined(new.clone()));
        assert_eq!(changes, [Presence::Left(old.clone()), Presence::Joined(new)]);
        assert_eq!(directory.update(&Presence::Left(old)), [], "the old token is gone already");
    }

    #[test]
    fn of_two_with_one_number_the_later_daemon_has_a_twin() {
        let mut directory = Directory::default();
        let all = [("a", 1), ("b", 1), ("c", 2)];
        let all = all.map(|(daemon, number)| resident("robot", daemon, number));
        for resident in &all {
            directory.update(&Presence::Joined(resident.clone()));
        }
        let twins = all.each_ref().map(|Resident { agent, daemon, incarnation }| {
            directory.twin_before(agent, *incarnation, daemon)
        });
        assert_eq!(twins, [None, Some(&all[0]), None]);
    }

    #[test]
    fn missed_changes_can_be_applied_later() {
        let (mut then, mut now) = (Directory::default(), Directory::default());
        then.update(&Presence::Joined(resident("gone", "a", 1)));
        then.update(&Presence::Joined(resident("same", "a", 1)));
        now.update(&Presence::Joined(resident("same", "a", 1)));
        now.update(&Presence::Joined(resident("new", "a", 1)));
        for change in then.changes_to(&now) {
            then.update(&change);
        }
        assert_eq!(then.iter().collect::<Vec<_>>(), now.iter().collect::<Vec<_>>());
    }
}
