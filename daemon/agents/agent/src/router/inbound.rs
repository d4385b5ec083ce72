//! The receiving side of the router: messages, changes of presence and queries that arrive.

use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{DaemonReport, Reason};
use acl::{AgentId, Message, Performative};
use bytes::Bytes;
use substrate::{
    AgentAddress, Answer, Delivery, Destination, Inbound, Origin, Presence, ReceivedQuery,
    Rejected, Resource, Subject, ViolationKind,
};

use super::MessageRouter;
use crate::authorization::ForbiddenMessage;
use crate::broadcast_cache::{self, inform_of};
use crate::mailbox::{MailboxItem, MailboxSender};
use crate::receipts;
use crate::refusal::refusal;

impl Inbound for MessageRouter {
    fn deliver(&self, delivery: Delivery) {
        let Delivery { destination, payload, origin } = delivery;
        let origin = origin.as_ref();
        if let Some(performative) = performative_of(&destination) {
            self.activity.count_received(performative);
        }
        match destination {
            Destination::To(agent, Subject::Message(_)) => {
                self.receive_direct(&agent, payload, origin);
            }
            Destination::To(agent, Subject::Receipt) => {
                self.put(&agent, MailboxItem::Receipts(receipts::read(&payload)));
            }
            Destination::All(sender, _) | Destination::AgentState(sender) => {
                self.receive_broadcast(payload, &sender, origin);
            }
        }
    }

    fn presence(&self, presence: Presence) {
        if !self.authorizer.authorize_presence(&presence) {
            return;
        }
        let mut state = self.write();
        let changes = state.membership.update(&presence);
        for change in &changes {
            tracing::debug!(?change, "presence");
            let resident = change.resident();
            if let Presence::Left(resident) = change {
                state.cache.forget(&resident.agent);
            }
            let namesake = state.hosted.mailbox(&resident.agent);
            if let Some(namesake) = namesake.filter(|_| resident.daemon != self.daemon) {
                // If the mailbox is full, the notice is not needed: the agent checks for a name
                // conflict after each item that it handles.
                let _ = namesake.put(MailboxItem::NameConflict);
            }
        }
        drop(state);
        changes.iter().for_each(|change| self.feed_presence(change));
    }

    fn rejected(&self, rejected: &Rejected<'_>) {
        self.rejections.note(rejected);
    }

    fn accepts_answer(&self, answer: &Answer<'_>) -> bool {
        self.authorizer.authorize_answer(answer, || self.directory())
    }

    fn receive_query(&self, query: ReceivedQuery) {
        match query.resource {
            Resource::Domain
            | Resource::State
            | Resource::Goals
            | Resource::Questions
            | Resource::Stops
            | Resource::Journal => self.pass_query(&query),
            Resource::Directory
            | Resource::Model
            | Resource::Mailbox
            | Resource::Discovered
            | Resource::Plugins
            | Resource::Files
            | Resource::Daemon => {
                let answers = self.answers(query.resource, query.agent.as_ref());
                answers.into_iter().for_each(|answer| (query.answer)(answer));
            }
        }
    }
}

/// Returns the performative of a message with this destination; `None` for receipts.
fn performative_of(destination: &Destination) -> Option<Performative> {
    match destination {
        Destination::To(_, Subject::Message(performative)) | Destination::All(_, performative) => {
            Some(*performative)
        }
        Destination::AgentState(_) => Some(Performative::Inform),
        Destination::To(_, Subject::Receipt) => None,
    }
}

impl MessageRouter {
    fn receive_direct(&self, agent: &AgentId, payload: Bytes, origin: Option<&Origin>) {
        match self.authorizer.authorize_direct(origin, &payload, || self.directory()) {
            Ok(()) => self.put(agent, MailboxItem::Direct(payload)),
            Err(forbidden) => self.refuse_forbidden(agent, forbidden),
        }
    }

    /// Sends a refusal for a message that its origin may not send. Does nothing if the message does
    /// not open an exchange.
    fn refuse_forbidden(&self, agent: &AgentId, forbidden: ForbiddenMessage) {
        let ForbiddenMessage { message, origin, detail } = forbidden;
        if message.opens_exchange() {
            let to = AgentAddress { daemon: origin, agent: message.sender.clone() };
            let refusal = self.refusal(agent, *message, Reason::Forbidden, detail);
            let subject = Subject::Message(Performative::Refuse);
            self.send_to(&to, subject, acl::encode(&refusal));
        }
    }

    fn put(&self, agent: &AgentId, item: MailboxItem) {
        let mailbox = self.read().hosted.mailbox(agent).cloned();
        let Some(mailbox) = mailbox else {
            self.counters.count_unknown_receiver();
            tracing::debug!(%agent, "a message to an agent that is not hosted here");
            return;
        };
        match mailbox.put(item) {
            Err(MailboxItem::Direct(_)) if mailbox.is_closed() => {
                tracing::debug!(%agent, "a message to an agent that has ended");
            }
            Err(MailboxItem::Direct(payload)) => self.refuse_overflow(agent, &mailbox, &payload),
            _ => (),
        }
    }

    /// Refuses a message to an agent with a full mailbox, so that the sender need not wait for an
    /// answer.
    fn refuse_overflow(&self, agent: &AgentId, mailbox: &MailboxSender, payload: &[u8]) {
        let from = acl::sender_of(payload);
        let from = from.as_ref().map_or("unknown", AgentId::as_str);
        if let Some(unsaid) = self.rejections.is_to_say("mailbox-full", from, Instant::now()) {
            tracing::warn!(%agent, from, unsaid, "mailbox full: a message is refused");
        }
        let Ok(message) = acl::decode(payload) else { return };
        if !message.opens_exchange() {
            // A turn of an open exchange is retried by its sender until there is room.
            return;
        }
        if !mailbox.door().refuse(&message.sender, &message.id) {
            // This is a copy of a message that the agent has received already and will answer.
            return;
        }
        let detail = format!("the mailbox of `{agent}` is full; ask again later");
        let to = message.sender.clone();
        let refusal = self.refusal(agent, message, Reason::MailboxFull, detail);
        self.send(&to, Subject::Message(Performative::Refuse), acl::encode(&refusal));
    }

    /// Builds a refusal in the name of `agent`, for a message that is not passed on to that agent.
    fn refusal(
        &self,
        agent: &AgentId,
        message: Message,
        reason: Reason,
        detail: String,
    ) -> Message {
        let incarnation = self.read().hosted.incarnation(agent).unwrap_or_default();
        refusal(agent, incarnation, message, reason, detail)
    }

    fn receive_broadcast(&self, payload: Bytes, sender: &AgentId, origin: Option<&Origin>) {
        let is_short_enough = |most| self.is_short_enough(&payload, most, sender, origin);
        if self.receive_repetition(&payload, sender, origin)
            || !is_short_enough(broadcast_cache::EPOCH_BYTES_MAX)
        {
            return;
        }
        let message = match acl::decode(&payload) {
            Ok(message) if message.sender == *sender => Arc::new(message),
            Ok(message) => {
                self.counters.count_unreadable();
                tracing::info!(%sender, claims = %message.sender, "a broadcast in another's name");
                return;
            }
            Err(error) if error.is_of_other_version() => {
                self.rejections.note(&Rejected {
                    violation: ViolationKind::OtherVersion,
                    detail: &format!("cannot be read: {}", error.problem),
                    claimed: Some(origin.map_or(sender.as_str(), |origin| origin.daemon.as_str())),
                    key: sender.as_str(),
                });
                return;
            }
            Err(error) => {
                self.counters.count_unreadable();
                tracing::info!(%sender, %error, "an unreadable broadcast");
                return;
            }
        };
        let inform = inform_of(&message);
        let bytes_max = inform.as_ref().and_then(broadcast_cache::bytes_max);
        if bytes_max.is_some_and(|most| !is_short_enough(most))
            || !self
                .authorizer
                .authorize_message(origin, &message, inform.as_ref(), || self.directory())
        {
            return;
        }
        if let Some(inform) = &inform {
            let mut state = self.write();
            let mut gap = None;
            // Only broadcasts of present agents are cached, so that other senders cannot fill the
            // cache.
            if state.membership.directory().find(sender).is_some() {
                gap = state.cache.keep(payload, &message, inform);
            }
            drop(state);
            gap.into_iter().for_each(|gap| self.activity.count_heartbeat_gap(gap));
            if self.domain_feed.receive(&message, inform) {
                self.request_model(sender, Duration::ZERO);
            }
        }
        self.read().hosted.broadcast(&message);
    }

    /// Whether a broadcast has at most `bytes_max` bytes. A longer broadcast is counted and logged.
    /// The bound is needed because the last broadcasts of every sender are cached.
    fn is_short_enough(
        &self,
        payload: &Bytes,
        bytes_max: usize,
        sender: &AgentId,
        origin: Option<&Origin>,
    ) -> bool {
        let bytes = payload.len();
        if bytes <= bytes_max {
            return true;
        }
        self.rejections.note(&Rejected {
            violation: ViolationKind::Oversized,
            detail: &format!("is a broadcast of {bytes} bytes; at most {bytes_max} are accepted"),
            claimed: Some(origin.map_or(sender.as_str(), |origin| origin.daemon.as_str())),
            key: sender.as_str(),
        });
        false
    }

    /// Handles a heartbeat that repeats the previous one of its sender. It is decoded only if an
    /// agent of this daemon listens to `inform` broadcasts. Returns `false` if the heartbeat must
    /// be handled as a new one.
    fn receive_repetition(
        &self,
        payload: &Bytes,
        sender: &AgentId,
        origin: Option<&Origin>,
    ) -> bool {
        let (repetition, has_listeners) = {
            let state = self.read();
            (state.cache.repetition(sender, payload), state.hosted.has_listeners())
        };
        let Some(repetition) = repetition else { return false };
        let incarnation = repetition.now.said.incarnation;
        let directory = || self.directory();
        if !self.authorizer.authorize_repetition(origin, sender, incarnation, directory) {
            return true;
        }
        if !self.domain_feed.receive_repetition(sender, &repetition) {
            return false;
        }
        let gap = self.write().cache.keep_repetition(sender, payload.clone(), repetition);
        gap.into_iter().for_each(|gap| self.activity.count_heartbeat_gap(gap));
        if has_listeners && let Ok(message) = acl::decode(payload) {
            self.read().hosted.broadcast(&Arc::new(message));
        }
        true
    }

    // === answering ===

    /// Returns the daemon's own answers to a query.
    fn answers(&self, resource: Resource, agent: Option<&AgentId>) -> Vec<Bytes> {
        let encode = |answer: Result<Vec<u8>, serde_json::Error>| answer.ok().map(Bytes::from);
        let answer = match resource {
            Resource::Directory => {
                let state = self.read();
                let residents = state.membership.directory().iter();
                let own: Vec<_> =
                    residents.filter(|resident| resident.daemon == self.daemon).collect();
                encode(serde_json::to_vec(&own))
            }
            Resource::Model => return self.write().hosted.models(agent),
            Resource::Mailbox => {
                let mailboxes = self.read().hosted.mailbox_statuses(agent);
                if mailboxes.is_empty() {
                    return Vec::new();
                }
                let (daemon, rejected) = (self.daemon.clone(), self.rejections.counts());
                let report = self.counters.report(daemon, mailboxes, rejected);
                encode(serde_json::to_vec(&report))
            }
            Resource::Discovered => self.reports.discovered(&self.daemon),
            Resource::Plugins => self.reports.plugins(),
            Resource::Files => self.reports.files(),
            Resource::Daemon => {
                let report = self.daemon_report();
                report.and_then(|report| encode(serde_json::to_vec(&report)))
            }
            Resource::Domain
            | Resource::State
            | Resource::Goals
            | Resource::Questions
            | Resource::Stops
            | Resource::Journal => None,
        };
        answer.into_iter().collect()
    }

    /// Returns the report of this daemon about itself; `None` for a guest, which is no daemon.
    fn daemon_report(&self) -> Option<DaemonReport> {
        if self.daemon.is_guest() {
            return None;
        }
        let (agents, (leads, stands_by), absent) = {
            let state = self.read();
            let directory = state.membership.directory();
            let leads = |agent: &AgentId| {
                directory.find(agent).is_some_and(|holder| holder.daemon == self.daemon)
            };
            let replicated = state.hosted.replicated().cloned();
            let absent = self.reports.absent(|agent| directory.find(agent).is_some());
            (state.hosted.count(), replicated.partition(leads), absent)
        };
        Some(self.reports.daemon(self.daemon.clone(), agents, leads, stands_by, absent))
    }

    /// Passes a query to each agent of this daemon, or only to the agent that is asked. Agents that
    /// do not serve the resource ignore it.
    fn pass_query(&self, query: &ReceivedQuery) {
        let mailboxes = self.read().hosted.mailboxes(query.agent.as_ref());
        for mailbox in mailboxes {
            let ReceivedQuery { resource, agent, answer } = query;
            let query = ReceivedQuery {
                resource: *resource,
                agent: agent.clone(),
                answer: Arc::clone(answer),
            };
            let _ = mailbox.put(MailboxItem::Question(query));
        }
    }
}
