//! The agents of one daemon: their mailboxes, the broadcasts that they listen to, and their latest
//! announcements.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::content::MailboxStatus;
use acl::{AgentId, Incarnation, Message, Performative};
use bytes::Bytes;

use crate::daemon_figures::MailboxTotals;
use crate::latest_announcement::LatestAnnouncement;
use crate::mailbox::{MailboxItem, MailboxSender};

/// The agents that a daemon hosts.
#[derive(Default)]
pub(crate) struct LocalAgents {
    agents: BTreeMap<AgentId, LocalAgent>,
    /// Number of agents that listen to `inform` broadcasts.
    listeners: usize,
    /// Number of messages that have found the mailbox of an agent full that is not here any more.
    overflowed: u64,
}

struct LocalAgent {
    mailbox: MailboxSender,
    incarnation: Incarnation,
    /// Whether other daemons may host replicas of the agent.
    has_replicas: bool,
    interests: BTreeSet<Performative>,
    /// Latest announcement of the agent, with which the daemon answers queries for the agent's
    /// model.
    announcement: LatestAnnouncement,
}

impl LocalAgents {
    /// Adds an agent that listens to broadcasts with the performatives in `interests`. The agent
    /// replaces an earlier incarnation of the same name.
    pub(crate) fn add(
        &mut self,
        agent: &AgentId,
        incarnation: Incarnation,
        interests: BTreeSet<Performative>,
        mailbox: MailboxSender,
    ) {
        let announcement = LatestAnnouncement::default();
        let has_replicas = false;
        let hosted = LocalAgent { mailbox, incarnation, has_replicas, interests, announcement };
        let former = self.agents.insert(agent.clone(), hosted);
        self.keep_overflow(former.as_ref());
        self.count_listeners();
    }

    /// Records that other daemons may host replicas of an agent.
    pub(crate) fn record_replicas(&mut self, agent: &AgentId) {
        if let Some(hosted) = self.agents.get_mut(agent) {
            hosted.has_replicas = true;
        }
    }

    /// Returns the number of agents.
    pub(crate) fn count(&self) -> usize {
        self.agents.len()
    }

    /// Returns the agents of which other daemons may host replicas, in the order of names.
    pub(crate) fn replicated(&self) -> impl Iterator<Item = &AgentId> {
        self.agents.iter().filter(|(_, hosted)| hosted.has_replicas).map(|(agent, _)| agent)
    }

    /// Removes this incarnation of an agent. Returns `false` if the daemon hosts another
    /// incarnation of the agent, or none.
    pub(crate) fn remove(&mut self, agent: &AgentId, incarnation: Incarnation) -> bool {
        let is_it = self.incarnation(agent) == Some(incarnation);
        if is_it {
            let former = self.agents.remove(agent);
            self.keep_overflow(former.as_ref());
            self.count_listeners();
        }
        is_it
    }

    /// Keeps what the mailbox of an agent that leaves has counted, so that the total never falls.
    fn keep_overflow(&mut self, former: Option<&LocalAgent>) {
        self.overflowed += former.map_or(0, |former| former.mailbox.load().2);
    }

    /// Returns the state of all mailboxes together.
    pub(crate) fn mailbox_totals(&self) -> MailboxTotals {
        let empty = MailboxTotals { overflowed: self.overflowed, ..MailboxTotals::default() };
        self.agents.values().fold(empty, |totals, hosted| {
            let (waiting, most, overflowed) = hosted.mailbox.load();
            MailboxTotals {
                waiting: totals.waiting + waiting as u64,
                fullest: totals.fullest.max(waiting as f64 / most.max(1) as f64),
                overflowed: totals.overflowed + overflowed,
            }
        })
    }

    fn count_listeners(&mut self) {
        let listens = |hosted: &&LocalAgent| hosted.interests.contains(&Performative::Inform);
        self.listeners = self.agents.values().filter(listens).count();
    }

    /// Whether an agent listens to `inform` broadcasts.
    pub(crate) fn has_listeners(&self) -> bool {
        self.listeners > 0
    }

    /// Returns the incarnation of an agent; `None` if the daemon does not host the agent.
    pub(crate) fn incarnation(&self, agent: &AgentId) -> Option<Incarnation> {
        self.agents.get(agent).map(|hosted| hosted.incarnation)
    }

    /// Returns the mailbox of an agent; `None` if the daemon does not host the agent.
    pub(crate) fn mailbox(&self, agent: &AgentId) -> Option<&MailboxSender> {
        self.agents.get(agent).map(|hosted| &hosted.mailbox)
    }

    /// Returns the mailbox of each agent, or only the one of the agent `asked`.
    pub(crate) fn mailboxes(&self, asked: Option<&AgentId>) -> Vec<MailboxSender> {
        self.asked(asked).map(|(_, hosted)| hosted.mailbox.clone()).collect()
    }

    /// Returns the state of each mailbox, or only that of the agent `asked`.
    pub(crate) fn mailbox_statuses(&self, asked: Option<&AgentId>) -> Vec<MailboxStatus> {
        self.asked(asked).map(|(agent, hosted)| hosted.mailbox.status(agent.clone())).collect()
    }

    fn asked<'s>(
        &'s self,
        asked: Option<&'s AgentId>,
    ) -> impl Iterator<Item = (&'s AgentId, &'s LocalAgent)> {
        self.agents.iter().filter(move |(agent, _)| asked.is_none_or(|asked| asked == *agent))
    }

    /// Puts a broadcast into the mailbox of each agent that listens to it. If a mailbox is full,
    /// its agent misses the broadcast, until the sender repeats it or the agent requests its
    /// content.
    pub(crate) fn broadcast(&self, message: &Arc<Message>) {
        for hosted in self.agents.values() {
            if hosted.interests.contains(&message.performative) {
                let _ = hosted.mailbox.put(MailboxItem::Broadcast(Arc::clone(message)));
            }
        }
    }

    /// Records a model or heartbeat that an agent of this daemon sends.
    pub(crate) fn record_announcement(&mut self, agent: &AgentId, payload: &Bytes, is_model: bool) {
        if let Some(hosted) = self.agents.get_mut(agent) {
            hosted.announcement.record(payload, is_model);
        }
    }

    /// Returns the latest model of each agent, or only the one of the agent `asked`. Each model
    /// contains the latest heartbeat of its agent.
    pub(crate) fn models(&mut self, asked: Option<&AgentId>) -> Vec<Bytes> {
        let asked = |agent: &AgentId| asked.is_none_or(|asked| asked == agent);
        let hosted = self.agents.iter_mut().filter(|(agent, _)| asked(agent));
        hosted.filter_map(|(_, hosted)| hosted.announcement.model()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mailbox::{Mailbox, mailbox};

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    fn add(
        hosted: &mut LocalAgents,
        agent: &str,
        incarnation: u64,
        interests: &[Performative],
    ) -> Mailbox {
        let (sender, mailbox) = mailbox(4, 4);
        let interests = interests.iter().copied().collect();
        hosted.add(&name(agent), Incarnation(incarnation), interests, sender);
        mailbox
    }

    #[test]
    fn a_broadcast_goes_to_the_agents_that_listen_to_it() {
        let mut hosted = LocalAgents::default();
        let robot = add(&mut hosted, "robot", 1, &[Performative::Cfp]);
        assert!(!hosted.has_listeners());
        let maintainer = add(&mut hosted, "maintainer", 1, &[Performative::Inform]);
        assert!(hosted.has_listeners());
        let text = r#"{"version": 2, "id": "m", "performative": "inform", "sender": "lamp",
            "incarnation": 1, "content": null, "conversation_id": "c"}"#;
        let message = acl::decode(text.as_bytes()).expect("a message");

        hosted.broadcast(&Arc::new(message));

        assert_eq!([robot.waiting(), maintainer.waiting()], [0, 1]);
    }

    #[test]
    fn a_former_incarnation_does_not_remove_its_successor() {
        let mut hosted = LocalAgents::default();
        let interests = [Performative::Inform];
        let _former = add(&mut hosted, "robot", 1, &interests);
        let _present = add(&mut hosted, "robot", 2, &interests);
        assert!(!hosted.remove(&name("robot"), Incarnation(1)));
        assert_eq!(hosted.incarnation(&name("robot")), Some(Incarnation(2)));
        assert!(hosted.remove(&name("robot"), Incarnation(2)));
        assert!(hosted.mailbox(&name("robot")).is_none());
        assert!(!hosted.has_listeners());
    }

    #[test]
    fn the_total_of_overflows_never_falls() {
        let mut hosted = LocalAgents::default();
        let _mailbox = add(&mut hosted, "robot", 1, &[]);
        let door = hosted.mailbox(&name("robot")).cloned().expect("it is hosted");
        (0..7).for_each(|_| drop(door.put(MailboxItem::NameConflict)));
        let totals = MailboxTotals { waiting: 4, fullest: 1.0, overflowed: 3 };
        assert_eq!(hosted.mailbox_totals(), totals);
        let _later = add(&mut hosted, "robot", 2, &[]);
        assert_eq!(hosted.mailbox_totals().overflowed, 3, "another incarnation has come");
        assert!(hosted.remove(&name("robot"), Incarnation(2)));
        let totals = MailboxTotals { overflowed: 3, ..MailboxTotals::default() };
        assert_eq!(hosted.mailbox_totals(), totals);
    }

    #[test]
    fn a_query_reaches_one_agent_or_all() {
        let mut hosted = LocalAgents::default();
        let _mailboxes = ["a", "b"].map(|agent| add(&mut hosted, agent, 1, &[]));
        let (robot, unknown) = (name("b"), name("c"));
        for (asked, count) in [(None, 2), (Some(&robot), 1), (Some(&unknown), 0)] {
            assert_eq!(hosted.mailboxes(asked).len(), count);
            assert_eq!(hosted.mailbox_statuses(asked).len(), count);
        }
        assert!(hosted.models(None).is_empty(), "nothing was announced");
        hosted.record_announcement(&robot, &Bytes::from_static(b"model"), true);
        hosted.record_announcement(&unknown, &Bytes::from_static(b"model"), true);
        assert_eq!(hosted.models(None), [Bytes::from_static(b"model")]);
        assert!(hosted.models(Some(&name("a"))).is_empty());
    }
}
