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

    fn deliver_heartbeats(&self, beats: Vec<(AgentId, Bytes)>, origin: Option<&Origin>) {
        self.activity.count_received_heartbeats(beats.len());
        for (sender, payload) in self.receive_repetitions(beats, origin) {
            self.receive_new_broadcast(Bytes::copy_from_slice(&payload), &sender, origin);
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
        let beats = vec![(sender.clone(), payload)];
        for (sender, payload) in self.receive_repetitions(beats, origin) {
            self.receive_new_broadcast(payload, &sender, origin);
        }
    }

    /// Handles a broadcast that does not repeat the previous one of its sender.
    fn receive_new_broadcast(&self, payload: Bytes, sender: &AgentId, origin: Option<&Origin>) {
        let is_short_enough = |most| self.is_short_enough(&payload, most, sender, origin);
        if !is_short_enough(broadcast_cache::EPOCH_BYTES_MAX) {
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

    /// Handles the broadcasts among `beats` that are heartbeats and repeat the previous ones of their
    /// senders. They are decoded only if an agent of this daemon listens to `inform` broadcasts.
    /// Returns the others, which must be handled as new ones.
    fn receive_repetitions(
        &self,
        beats: Vec<(AgentId, Bytes)>,
        origin: Option<&Origin>,
    ) -> Vec<(AgentId, Bytes)> {
        let (mut repeated, mut others) = (Vec::with_capacity(beats.len()), Vec::new());
        let (has_listeners, directory) = {
            let state = self.read();
            for (sender, payload) in beats {
                match state.cache.repetition(&sender, &payload) {
                    Some(repetition) => repeated.push((sender, payload, repetition)),
                    None => others.push((sender, payload)),
                }
            }
            (state.hosted.has_listeners(), Arc::clone(state.membership.directory()))
        };
        repeated.retain(|(sender, _, repetition)| {
            let incarnation = repetition.said.incarnation;
            self.authorizer.authorize_repetition(origin, sender, incarnation, &directory)
        });
        if repeated.is_empty() {
            return others;
        }
        let each = repeated.iter().map(|(sender, _, repetition)| (sender, repetition));
        let mut is_taken = self.domain_feed.receive_repetitions(each).into_iter();
        repeated.retain(|(sender, payload, _)| {
            let is_taken = is_taken.next() == Some(true);
            if !is_taken {
                others.push((sender.clone(), payload.clone()));
            }
            is_taken
        });
        let mut state = self.write();
        for (sender, payload, repetition) in &repeated {
            let gap = state.cache.keep_repetition(sender, payload, repetition);
            gap.into_iter().for_each(|gap| self.activity.count_heartbeat_gap(gap));
        }
        drop(state);
        if has_listeners {
            for message in repeated.iter().filter_map(|(_, payload, _)| acl::decode(payload).ok()) {
                self.read().hosted.broadcast(&Arc::new(message));
            }
        }
        others
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

#[cfg(test)]
mod tests {
    use acl::content::{Heartbeat, Inform, Methods, ModelAnnouncement};
    use acl::{DaemonId, EcosystemId, Incarnation, Millis};
    use serde_json::json;
    use substrate::Resident;

    use super::*;
    use crate::host::Host;
    use crate::settings::AgentSettings;

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    /// Returns a heartbeat of an agent with this digest, as Althing's own encoder writes it.
    fn beat_of(sender: &str, digest: &str, facts: &str, sequence: u64) -> (AgentId, Bytes) {
        let heartbeat = json!({
            "of": "heartbeat", "digest": digest, "facts": facts, "period": 1000, "sequence": sequence
        });
        told(sender, sequence, heartbeat)
    }

    fn beat(sender: &str, facts: &str, sequence: u64) -> (AgentId, Bytes) {
        beat_of(sender, "d", facts, sequence)
    }

    fn told(sender: &str, number: u64, content: serde_json::Value) -> (AgentId, Bytes) {
        let message = json!({
            "version": acl::SCHEMA_VERSION, "id": format!("{sender}.7.{number}"),
            "performative": "inform", "sender": sender, "incarnation": 7, "content": content,
            "conversation_id": sender
        });
        let message = acl::decode(message.to_string().as_bytes()).expect("a message");
        (agent(sender), acl::encode(&message))
    }

    /// Returns the router of a daemon at which a lamp and a fan are present.
    fn router() -> Arc<MessageRouter> {
        let (ecosystem, daemon) = (EcosystemId::new("test"), DaemonId::new("here"));
        let (ecosystem, daemon) = (ecosystem.expect("a name"), daemon.expect("a name"));
        let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
        for name in ["lamp", "fan"] {
            let (agent, daemon) = (agent(name), daemon.clone());
            let resident = Resident { agent, daemon, incarnation: Incarnation(7) };
            router.presence(Presence::Joined(resident));
        }
        router
    }

    #[test]
    fn heartbeats_of_a_batch_are_kept_whether_they_are_repeated_or_new() {
        let router = router();
        let kept = || router.read().cache.all().collect::<Vec<_>>();
        let first = [beat("fan", "", 1), beat("lamp", "(lit lamp)", 4)];
        // The second batch repeats one and changes the other; the third has one sender twice, and
        // a sender that is not present.
        let second = [beat("fan", "", 2), beat("lamp", "", 5)];
        let third =
            [beat("fan", "", 3), beat("stranger", "", 1), beat("lamp", "", 6), beat("lamp", "", 7)];
        for (batch, last) in [(first.to_vec(), first), (second.to_vec(), second)] {
            router.deliver_heartbeats(batch, None);
            assert_eq!(kept(), last.map(|(_, text)| text));
        }
        let is_repeated = |name| router.read().cache.is_repeated(&agent(name));
        assert_eq!((is_repeated("fan"), is_repeated("lamp")), (true, false));
        router.deliver_heartbeats(third.to_vec(), None);
        assert_eq!(kept(), [beat("fan", "", 3).1, beat("lamp", "", 7).1]);
        let counts = router.activity().counts();
        assert!(counts.received.contains(&(Performative::Inform, 8)), "{counts:?}");
        assert_eq!(counts.heartbeat_gaps.count, 5);
    }

    #[tokio::test]
    async fn a_repetition_that_the_shared_domain_does_not_take_is_decoded() {
        let ontology = "(define (domain test) (:requirements :typing) (:types agent - object)
            (:predicates (lit ?a - agent)))";
        let ontology = pddl::parse_domain(ontology).value;
        let map = "(define (problem map) (:domain test) (:init) (:goal (and)))";
        let map = pddl::parse_problem(map).value;
        let host = Host::new(ontology.expect("a domain"), map.expect("a problem"));
        let router = router();
        let domain = router.shared_domain(&host);
        let methods = Methods::default();
        let announce = |name: &str| {
            let model = format!("(define (agent {name}) (:domain test) (:objects {name} - agent))");
            let digest = capability::model_digest(&model, &methods);
            let heartbeat = Heartbeat {
                digest: digest.clone(),
                sequence: 1,
                facts: String::new(),
                known_for: [].into(),
                period: Millis(Duration::from_secs(1)),
                stops: Vec::new(),
            };
            let announced = ModelAnnouncement { model, methods: methods.clone(), heartbeat };
            let inform = Inform::Model(Box::new(announced));
            let (sender, payload) = told(name, 1, serde_json::to_value(&inform).expect("JSON"));
            let destination = Destination::AgentState(sender);
            router.deliver(Delivery { destination, payload, origin: None });
            assert!(domain.has_model(&agent(name), Incarnation(7)), "{name}");
            digest
        };
        let (of_fan, of_lamp) = (announce("fan"), announce("lamp"));
        let fan = |sequence| beat_of("fan", &of_fan, "", sequence);
        let lamp = |sequence| beat_of("lamp", &of_lamp, "", sequence);
        let is_repeated = |name| router.read().cache.is_repeated(&agent(name));
        router.deliver_heartbeats(vec![fan(2), lamp(2)], None);
        assert_eq!((is_repeated("fan"), is_repeated("lamp")), (false, false), "the first ones");
        // The shared domain takes the first heartbeat of the lamp; the second does not follow the one
        // that it was compared with.
        router.deliver_heartbeats(vec![lamp(3), fan(3), lamp(4)], None);
        assert_eq!((is_repeated("fan"), is_repeated("lamp")), (true, false));
        let kept: Vec<_> = router.read().cache.all().collect();
        assert!(kept.contains(&fan(3).1) && kept.contains(&lamp(4).1), "{kept:?}");
        router.deliver_heartbeats(vec![lamp(5), fan(4)], None);
        assert_eq!((is_repeated("fan"), is_repeated("lamp")), (true, true));
    }
}
