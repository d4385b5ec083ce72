//! Membership, as one daemon sees it: the directory of the present agents, and a channel of its
//! changes.

use std::sync::Arc;

use substrate::Presence;
use tokio::sync::broadcast;

use crate::directory::Directory;

/// Capacity of the channel of presence changes. An agent that lags further behind misses changes,
/// and compares directories instead.
const CHANGES_MAX: usize = 1_024;

/// The present agents, and the subscribers to changes of presence.
pub(crate) struct AgentMembership {
    /// Directory of the present agents. Readers share it; a change is made in a copy.
    directory: Arc<Directory>,
    changes: broadcast::Sender<Presence>,
}

impl Default for AgentMembership {
    fn default() -> AgentMembership {
        let (changes, _) = broadcast::channel(CHANGES_MAX);
        AgentMembership { directory: Arc::default(), changes }
    }
}

impl AgentMembership {
    /// Returns the directory of the present agents.
    pub(crate) fn directory(&self) -> &Arc<Directory> {
        &self.directory
    }

    /// Returns the directory of the present agents, and a receiver of every change of it from now
    /// on.
    pub(crate) fn subscribe(&self) -> (Arc<Directory>, broadcast::Receiver<Presence>) {
        (Arc::clone(&self.directory), self.changes.subscribe())
    }

    /// Returns the directory if `receiver` has no unread change, so that its agent has received all
    /// changes in the directory; otherwise `None`.
    pub(crate) fn directory_if_read(
        &self,
        receiver: &broadcast::Receiver<Presence>,
    ) -> Option<Arc<Directory>> {
        receiver.is_empty().then(|| Arc::clone(&self.directory))
    }

    /// Applies a change of presence. If the holder of the name changes, sends that change to the
    /// subscribers, and returns it: the former holder has left, and the new one has joined.
    pub(crate) fn update(&mut self, presence: &Presence) -> Vec<Presence> {
        let changes = Arc::make_mut(&mut self.directory).update(presence);
        for change in &changes {
            // Sending fails only if there is no subscriber.
            let _ = self.changes.send(change.clone());
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use acl::{AgentId, DaemonId, Incarnation};
    use substrate::Resident;

    use super::*;

    fn robot(daemon: &str, incarnation: u64) -> Resident {
        Resident {
            agent: AgentId::new("robot").expect("a name"),
            daemon: DaemonId::new(daemon).expect("a name"),
            incarnation: Incarnation(incarnation),
        }
    }

    #[test]
    fn a_subscriber_gets_every_change_of_holders_after_its_directory() {
        let mut membership = AgentMembership::default();
        let (first, rival) = (robot("a", 1), robot("b", 2));
        membership.update(&Presence::Joined(first.clone()));
        let (directory, mut changes) = membership.subscribe();
        assert_eq!(directory.find(&first.agent), Some(&first));
        assert!(membership.update(&Presence::Joined(rival.clone())).is_empty(), "a rival");

        let changed = membership.update(&Presence::Left(first.clone()));

        assert_eq!(changed, [Presence::Left(first), Presence::Joined(rival.clone())]);
        for change in changed {
            assert!(membership.directory_if_read(&changes).is_none(), "it has unread changes");
            assert_eq!(changes.try_recv(), Ok(change));
        }
        let read = membership.directory_if_read(&changes).expect("all changes are read");
        assert_eq!(read.find(&rival.agent), Some(&rival));
        assert!(directory.find(&rival.agent) != Some(&rival), "a reader keeps what it took");
    }
}
