//! Events about the state: facts of heartbeats, effects, announcements of the Domain Maintainer,
//! and presence.

use std::sync::Arc;

use acl::Message;
use acl::content::{
    ChangeState, EpochChange, Heartbeat, HistoryKind, HistoryRoot, Inform, Observation,
};

use super::draft::{EventCause, EventDraft, EventLink};
use super::fact_table::FactChange;
use super::pddl_text::facts;
use super::{EPOCH_DELAY_MS, EventRecorder, MODEL_DELAY_MS, WAITING_MAX};
use crate::event::{EventDescription, FALSE, UNKNOWN};
use crate::words::words_of;

/// Number of recent changes of facts among which the cause of a derived fact is looked for.
const RECENT_FACTS: usize = 64;

/// Time in which an announcement about an agent is about its presence that was heard already.
const SAME_PRESENCE_MS: u64 = 10_000;

/// Whether a message is an announcement of the Domain Maintainer.
pub(super) fn is_epoch(message: &Message) -> bool {
    message.content.get("of").and_then(serde_json::Value::as_str) == Some("epoch")
}

impl EventRecorder {
    /// Takes a broadcast, or lets it wait for the messages that belong before it.
    pub(super) fn hear_broadcast(&mut self, message: Message, at_ms: u64) {
        let of = message.content.get("of").and_then(serde_json::Value::as_str);
        let delay = match of {
            Some("epoch") => EPOCH_DELAY_MS,
            Some("heartbeat") if !self.is_model_known(&message) => {
                self.unknown_models.insert(message.sender.clone());
                MODEL_DELAY_MS
            }
            _ => return self.take_broadcast(message, at_ms),
        };
        if self.waiting.len() < WAITING_MAX {
            self.waiting.push_back((at_ms + delay, message));
        } else {
            self.take_broadcast(message, at_ms);
        }
    }

    /// Whether the message is a heartbeat of an agent whose private facts are known.
    pub(super) fn is_model_known(&self, message: &Message) -> bool {
        message.content.get("of").and_then(serde_json::Value::as_str) == Some("heartbeat")
            && self.agents.get(message.sender.as_str()).is_some_and(|trace| trace.is_model_known)
    }

    /// Records what a broadcast means.
    pub(super) fn take_broadcast(&mut self, message: Message, at_ms: u64) {
        match message.content_as::<Inform>() {
            Ok(Inform::Model(announcement)) => {
                self.learn_model(&message.sender, &announcement.model);
                self.take_heartbeat(&message, &announcement.heartbeat, true, at_ms);
            }
            Ok(Inform::Heartbeat(heartbeat)) => {
                self.take_heartbeat(&message, &heartbeat, false, at_ms);
            }
            Ok(Inform::Epoch(change)) => self.take_epoch(&message, &change, at_ms),
            Ok(Inform::Answer(_)) | Err(_) => (),
        }
    }

    fn take_heartbeat(
        &mut self,
        message: &Message,
        heartbeat: &Heartbeat,
        is_model: bool,
        at_ms: u64,
    ) {
        let agent = self.name(message.sender.as_str());
        let trace = self.agent(&agent);
        trace.is_actuator = true;
        let was_silent = std::mem::take(&mut trace.is_silent);
        if was_silent {
            self.heard_again(&agent, at_ms);
        }
        if is_model {
            self.take_model(&agent, &heartbeat.digest, at_ms);
        }
        let changes = self.facts.report(&agent, &heartbeat.facts);
        if !changes.is_empty() {
            self.facts.mark_expiring(&agent, heartbeat.known_for.keys());
        }
        for change in changes {
            let step = self.agent(&agent).step_behind(&change.fact, at_ms);
            let cause = step.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event);
            self.record_fact(&agent, &change, "", cause, at_ms);
        }
        for stop in &heartbeat.stops {
            self.take_stop(stop, at_ms);
        }
    }

    /// Records that an agent offers other actions than before.
    fn take_model(&mut self, agent: &str, digest: &str, at_ms: u64) {
        let trace = self.agent(agent);
        let former = std::mem::replace(&mut trace.digest, digest.to_owned());
        if former.is_empty() || former == *digest {
            return;
        }
        let cause = trace.running_step().or(trace.last_fact);
        let cause = cause.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event);
        let text = format!("`{agent}` announces other actions than before");
        let draft = EventDraft::new(HistoryKind::Presence, agent, agent, text, cause);
        let event = self.record(draft, at_ms);
        self.agent(agent).last_model = Some(event);
    }

    fn heard_again(&mut self, agent: &str, at_ms: u64) {
        let cause = EventCause::Root(HistoryRoot::Arrival);
        let text = format!("`{agent}` is heard again");
        let draft = EventDraft::new(HistoryKind::Presence, agent, agent, text, cause).worked(true);
        let event = self.record(draft, at_ms);
        let trace = self.agent(agent);
        (trace.last_joined, trace.last_left) = (Some(event), None);
    }

    /// Records the change of a fact.
    pub(super) fn record_fact(
        &mut self,
        agent: &Arc<str>,
        change: &FactChange,
        conversation: &str,
        cause: EventCause,
        at_ms: u64,
    ) -> EventLink {
        let what =
            EventDescription::Change { from: change.from.clone(), to: Arc::clone(&change.to) };
        let event = self.record(
            EventDraft {
                kind: HistoryKind::Fact,
                subject: &change.fact,
                agent,
                conversation,
                what,
                cause,
                worked: *change.to != *FALSE && *change.to != *UNKNOWN,
            },
            at_ms,
        );
        self.facts.set_event(agent, &change.fact, event);
        self.agent(agent).last_fact = Some(event);
        if self.recent_facts.len() >= RECENT_FACTS {
            self.recent_facts.pop_front();
        }
        self.recent_facts.push_back((event, Arc::clone(&change.fact)));
        event
    }

    /// Records facts that `agent` has observed or caused.
    pub(super) fn record_added(
        &mut self,
        agent: &str,
        text: &str,
        conversation: &str,
        cause: EventCause,
        at_ms: u64,
    ) {
        let agent = self.name(agent);
        for change in self.facts.add(&agent, text) {
            self.record_fact(&agent, &change, conversation, cause, at_ms);
        }
    }

    /// Records a change of the state by a request that was carried out.
    pub(super) fn record_change(
        &mut self,
        sender: &str,
        change: &ChangeState,
        conversation: &str,
        cause: EventCause,
        at_ms: u64,
    ) {
        let owner = change.owner.as_ref().map_or(sender, |owner| owner.as_str());
        let owner = self.name(owner);
        for retracted in self.facts.retract(&owner, &change.retract) {
            self.record_fact(&owner, &retracted, conversation, cause, at_ms);
        }
        self.record_added(&owner, &change.believe, conversation, cause, at_ms);
    }

    /// Records what an agent has observed.
    pub(super) fn record_observation(
        &mut self,
        message: &Message,
        observed: &Observation,
        at_ms: u64,
    ) {
        let sender = message.sender.as_str();
        let step = self.agents.get(sender).and_then(|trace| trace.running_step());
        let cause = step.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event);
        let conversation = message.conversation_id.as_str();
        self.record_added(sender, &observed.facts, conversation, cause, at_ms);
    }

    /// Records what the Domain Maintainer announces and no other message has said: facts that
    /// follow from others, facts that expire, and agents that are silent.
    fn take_epoch(&mut self, message: &Message, change: &EpochChange, at_ms: u64) {
        for agent in &change.left {
            self.silent(agent.as_str(), at_ms);
        }
        let maintainer = self.name(message.sender.as_str());
        for retracted in facts(&change.retracted) {
            let is_derived = self.facts.claimants(retracted.fact).any(|it| *it == maintainer);
            // What another agent has retracted was heard from that agent.
            let (owner, cause) = match self.facts.expired(retracted.fact) {
                _ if !self.facts.is_claimed(&retracted) => continue,
                _ if is_derived => (Arc::clone(&maintainer), self.cause_of_derived(retracted.fact)),
                Some(owner) => (Arc::clone(owner), EventCause::Root(HistoryRoot::Clock)),
                None => continue,
            };
            let text = match retracted.value.parse::<f64>() {
                Ok(_) => format!("(= {} {})", retracted.fact, retracted.value),
                Err(_) => retracted.fact.to_owned(),
            };
            for mut change in self.facts.retract(&owner, &text) {
                if !is_derived {
                    change.to = UNKNOWN.into();
                }
                self.record_fact(&owner, &change, "", cause, at_ms);
            }
        }
        let believed = facts(&change.believed).filter(|fact| fact.value != UNKNOWN);
        let news: Vec<_> = believed.filter(|fact| !self.facts.is_claimed(fact)).collect();
        for fact in news {
            // Another agent claims another value of the fact; the maintainer decides between them.
            let is_denied = fact.value == FALSE && self.facts.claimants(fact.fact).next().is_some();
            if is_denied || self.facts.is_believed(fact.fact) {
                continue;
            }
            let cause = self.cause_of_derived(fact.fact);
            let text = match fact.value.parse::<f64>() {
                Ok(_) => format!("(= {} {})", fact.fact, fact.value),
                Err(_) => fact.fact.to_owned(),
            };
            self.record_added(&maintainer, &text, "", cause, at_ms);
        }
    }

    /// Returns the change from which a derived fact follows: the newest one about one of its
    /// objects, or else the newest one.
    fn cause_of_derived(&self, fact: &str) -> EventCause {
        let names_same = |other: &str| {
            words_of(fact).skip(1).any(|object| words_of(other).skip(1).any(|o| o == object))
        };
        let mut recent = self.recent_facts.iter().rev();
        let related = recent.find(|(_, other)| names_same(other));
        let newest = related.or(self.recent_facts.back());
        newest.map_or(EventCause::Root(HistoryRoot::Sensor), |(event, _)| (*event).into())
    }

    /// Records that an agent has joined.
    pub(super) fn joined(&mut self, agent: &str, daemon: &str, is_start: bool, at_ms: u64) {
        let text = match is_start {
            true => format!("`{agent}` is at `{daemon}`, {}", self.beginning()),
            false => format!("`{agent}` joins at `{daemon}`"),
        };
        let outage = self.outage.filter(|_| is_start);
        let cause = outage.map_or(EventCause::Root(HistoryRoot::Arrival), EventCause::Event);
        let draft = EventDraft::new(HistoryKind::Presence, agent, agent, text, cause).worked(true);
        let event = self.record(draft, at_ms);
        let trace = self.agent(agent);
        (trace.last_joined, trace.last_left) = (Some(event), None);
    }

    /// Records that an agent has left.
    pub(super) fn left(&mut self, agent: &str, daemon: &str, at_ms: u64) {
        self.gone(agent, format!("`{agent}` leaves `{daemon}`"), at_ms);
    }

    /// Records that an agent is silent, unless it has left.
    fn silent(&mut self, agent: &str, at_ms: u64) {
        let trace = self.agents.get(agent);
        let left = trace.and_then(|trace| trace.last_left);
        if left.is_none_or(|(left, _)| at_ms.saturating_sub(left) > SAME_PRESENCE_MS) {
            self.gone(agent, format!("`{agent}` is silent"), at_ms);
            self.agent(agent).is_silent = true;
        }
    }

    fn gone(&mut self, agent: &str, text: String, at_ms: u64) {
        let cause = EventCause::Root(HistoryRoot::Death);
        let event =
            self.record(EventDraft::new(HistoryKind::Presence, agent, agent, text, cause), at_ms);
        let trace = self.agent(agent);
        (trace.is_silent, trace.last_left) = (false, Some((at_ms, event)));
        let agent = self.name(agent);
        for change in self.facts.forget(&agent) {
            self.record_fact(&agent, &change, "", event.into(), at_ms);
        }
    }
}
