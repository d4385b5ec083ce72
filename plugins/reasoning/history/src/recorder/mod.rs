//! The recorder: makes events with causes out of the messages and the presence of agents. It has no
//! clock and no file: time is a parameter, and events are taken by its owner.
//!
//! Chains are complete because each event gets its cause when it is made: the message names its
//! conversation, its exchange and the token of its step, and what nothing else caused has a root of
//! its own. A cause is always an earlier event.
//!
//! - `awards`: the proposal that a step comes from.
//! - `goals`: goals, calls for proposals, bids and plans.
//! - `steps`: steps of plans, stops, questions, and refusals of any request.
//! - `state`: facts and presence.
//! - `breaking`: finds the event that broke a plan.

mod agent_trace;
mod awards;
mod breaking;
mod draft;
mod fact_table;
mod goals;
mod pddl_text;
mod recent_map;
mod state;
mod steps;
#[cfg(test)]
mod tests;

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{HistoryKind, HistoryRoot};
use acl::{AgentId, Message, Performative};
use agent::Presence;

use self::agent_trace::AgentTrace;
use self::draft::{EventCause, EventDraft, EventLink};
use self::fact_table::FactTable;
use self::goals::GoalTrace;
use self::pddl_text::{auxiliary_of, facts, head, heads, private_names, without_introducers};
use self::recent_map::RecentMap;
use self::state::is_epoch;
use self::steps::ExchangeTrace;
use crate::event::{EventDescription, RecordedEvent, shortened};
use crate::past::PastHistory;
use crate::store::SEGMENT_EVENTS;

/// Maximum numbers of what the recorder remembers. The oldest entries are forgotten.
const CONVERSATIONS_MAX: usize = 4_096;
const EXCHANGES_MAX: usize = 16_384;
const AGENTS_MAX: usize = 20_000;
const STOPS_MAX: usize = 1_024;
const MESSAGES_MAX: usize = 16_384;
const PRIVATE_NAMES_MAX: usize = 10_000;

/// Maximum number of messages that wait for others. Further ones are taken at once.
const WAITING_MAX: usize = 4_096;

/// Time for which an announcement of the Domain Maintainer waits for the messages that caused it,
/// which may come by another way.
const EPOCH_DELAY_MS: u64 = 500;

/// Longest time for which the facts of an agent wait for its model, which says what is private.
const MODEL_DELAY_MS: u64 = 3_000;

/// Milliseconds of a day. Each day begins a segment, so that old ones can be deleted.
const DAY_MS: u64 = 86_400_000;

/// Makes events out of messages.
pub struct EventRecorder {
    next_number: u64,
    day: Option<u64>,
    events: Vec<RecordedEvent>,
    facts: FactTable,
    agents: RecentMap<AgentTrace>,
    goals: RecentMap<GoalTrace>,
    exchanges: RecentMap<ExchangeTrace>,
    stops: RecentMap<EventLink>,
    last_stop: Option<EventLink>,
    /// Identifiers of messages that were heard.
    heard: RecentMap<()>,
    /// Names of predicates and functions that a model declares private.
    private: BTreeSet<String>,
    /// Names that the ontology or a model declares, and not as private; `None` if the ontology is
    /// not known.
    public: Option<BTreeSet<String>>,
    /// Messages that wait for others, with the time until which they wait at the longest.
    waiting: VecDeque<(u64, Message)>,
    /// Agents whose models are wanted.
    unknown_models: BTreeSet<AgentId>,
    /// The newest changes of facts, for facts that follow from them.
    recent_facts: VecDeque<(EventLink, Arc<str>)>,
    /// The newest request for a change, with its time.
    last_request: Option<(u64, EventLink)>,
    /// The event that the history runs again; `None` if it has begun.
    outage: Option<EventLink>,
    names: HashMap<String, Arc<str>>,
}

// === impl EventRecorder ===

impl EventRecorder {
    /// Creates a recorder whose first event has a number greater than `newest`.
    pub fn new(newest: u64) -> EventRecorder {
        EventRecorder {
            next_number: newest + 1,
            day: None,
            events: Vec::new(),
            facts: FactTable::new(),
            agents: RecentMap::new(AGENTS_MAX),
            goals: RecentMap::new(CONVERSATIONS_MAX),
            exchanges: RecentMap::new(EXCHANGES_MAX),
            stops: RecentMap::new(STOPS_MAX),
            last_stop: None,
            heard: RecentMap::new(MESSAGES_MAX),
            private: BTreeSet::new(),
            public: None,
            waiting: VecDeque::new(),
            unknown_models: BTreeSet::new(),
            recent_facts: VecDeque::new(),
            last_request: None,
            outage: None,
            names: HashMap::new(),
        }
    }

    /// Goes on after the events of the files, if there are any: goals are known again, and the time
    /// in which the history agent `name` did not run is recorded.
    pub(crate) fn resume(&mut self, past: PastHistory, name: &str, at_ms: u64) {
        let Some(newest_ms) = past.newest_ms else { return };
        for goal in past.goals {
            let event = EventLink { number: goal.number, root: goal.root };
            let trace = GoalTrace::new(goal.goal.to_string(), event);
            self.goals.insert(&goal.conversation, trace);
        }
        let gap = Duration::from_secs(at_ms.saturating_sub(newest_ms).div_ceil(1_000));
        let gap = humantime::format_duration(gap);
        let text = format!("`{name}` records again; it did not run, for at most {gap}");
        let cause = EventCause::Root(HistoryRoot::Death);
        let draft = EventDraft::new(HistoryKind::Presence, name, name, text, cause);
        self.outage = Some(self.record(draft, at_ms));
    }

    /// Takes the events that were made since the last call.
    pub fn take_events(&mut self) -> Vec<RecordedEvent> {
        std::mem::take(&mut self.events)
    }

    /// Whether messages wait for others, so that time makes events of them.
    pub fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Number of facts that were not recorded, because there are too many.
    pub fn dropped(&self) -> u64 {
        self.facts.dropped
    }

    /// Takes the names of agents whose models the recorder needs, to know what is private.
    pub fn take_unknown_models(&mut self) -> BTreeSet<AgentId> {
        std::mem::take(&mut self.unknown_models)
    }

    /// Records what a message means. A message that was heard before is ignored.
    pub fn hear(&mut self, message: Message, at_ms: u64) {
        let is_beat = message.performative == Performative::Inform && message.receiver.is_empty();
        if !is_beat {
            if self.heard.contains(message.id.as_str()) {
                return;
            }
            self.heard.insert(message.id.as_str(), ());
        }
        self.tick(at_ms);
        if is_beat {
            return self.hear_broadcast(message, at_ms);
        }
        match message.performative {
            Performative::Request => self.hear_request(&message, at_ms),
            Performative::Confirm => self.hear_confirm(&message, at_ms),
            Performative::Refuse | Performative::NotUnderstood => {
                self.hear_refusal(&message, at_ms)
            }
            Performative::Cfp => self.hear_call(&message, at_ms),
            Performative::Agree => self.hear_bid(&message, at_ms),
            Performative::Propose => self.hear_proposal(&message, at_ms),
            Performative::AcceptProposal | Performative::RejectProposal => {
                self.hear_choice(&message, at_ms)
            }
            Performative::Cancel => self.hear_cancel(&message, at_ms),
            Performative::QueryRef => self.hear_question(&message, at_ms),
            Performative::Inform => self.hear_answer(&message, at_ms),
        }
    }

    /// Handles the messages that have waited long enough.
    pub fn tick(&mut self, at_ms: u64) {
        let (mut index, mut is_epoch_waiting) = (0, false);
        while let Some((until, message)) = self.waiting.get(index) {
            let is_epoch = is_epoch(message);
            // Announcements of the Domain Maintainer are taken in their order. One about facts that
            // nobody has declared waits for the models that declare them.
            let is_early = is_epoch
                && (is_epoch_waiting
                    || *until + MODEL_DELAY_MS > at_ms && self.has_undeclared(message));
            let is_ready = *until <= at_ms && !is_early
                // The clock was set back.
                || *until > at_ms + MODEL_DELAY_MS
                || self.is_model_known(message);
            if !is_ready {
                is_epoch_waiting |= is_epoch;
                index += 1;
            } else if let Some((_, message)) = self.waiting.remove(index) {
                self.take_broadcast(message, at_ms);
            }
        }
    }

    /// Learns from the model of an agent what is private.
    pub fn learn_model(&mut self, agent: &AgentId, model: &str) {
        for name in private_names(model) {
            if self.private.len() < PRIVATE_NAMES_MAX {
                self.private.insert(name);
            }
        }
        if let Some(public) = self.public.as_mut() {
            let room = PRIVATE_NAMES_MAX.saturating_sub(public.len());
            let names = heads(model).map(str::to_ascii_lowercase);
            public.extend(names.filter(|name| !self.private.contains(name)).take(room));
        }
        self.agent(agent.as_str()).is_model_known = true;
    }

    /// Learns the names that the ontology declares. From now on, a fact that neither the ontology
    /// nor a model declares counts as private: the model that declares it is not known yet.
    pub fn learn_ontology(&mut self, names: impl IntoIterator<Item = String>) {
        let public = self.public.get_or_insert_default();
        public.extend(names.into_iter().map(|name| name.to_ascii_lowercase()));
    }

    /// Records that an agent has joined or left. `is_start` states whether the history begins, so
    /// that the agent may have been present before. Guests, such as commands, are left out.
    pub fn presence(&mut self, presence: &Presence, is_start: bool, at_ms: u64) {
        self.tick(at_ms);
        let resident = presence.resident();
        // A command that ends is no failure.
        if resident.daemon.is_guest() {
            return;
        }
        match presence {
            Presence::Joined(_) => {
                self.joined(resident.agent.as_str(), resident.daemon.as_str(), is_start, at_ms);
            }
            Presence::Left(_) => {
                self.left(resident.agent.as_str(), resident.daemon.as_str(), at_ms);
            }
        }
    }

    /// Gives the next events numbers that are greater by `shift`.
    pub fn skip_numbers(&mut self, shift: u64) {
        self.next_number += shift;
    }

    // === for the other files of the recorder ===

    /// Records an event, and returns a reference to it.
    fn record(&mut self, draft: EventDraft<'_>, at_ms: u64) -> EventLink {
        let day = at_ms / DAY_MS;
        if self.day.is_some_and(|before| before != day) {
            self.next_number = self.next_number.next_multiple_of(SEGMENT_EVENTS);
        }
        self.day = Some(day);
        let number = self.next_number;
        self.next_number += 1;
        let (cause, root) = match draft.cause {
            EventCause::Root(root) => (None, root),
            EventCause::Event(event) => (Some(event.number), event.root),
        };
        let is_private = |text: &str| heads(text).any(|head| self.is_private_name(head));
        let private = is_private(draft.subject)
            || draft.kind == HistoryKind::Fact && self.is_undeclared(draft.subject)
            || matches!(&draft.what, EventDescription::Sentence(text) if is_private(text));
        let event = RecordedEvent {
            number,
            at_ms,
            kind: draft.kind,
            subject: shortened(&without_introducers(draft.subject)).into(),
            agent: self.name(draft.agent),
            conversation: self.name(&shortened(draft.conversation)),
            what: match draft.what {
                EventDescription::Sentence(text) => {
                    EventDescription::Sentence(shortened(&without_introducers(&text)).into())
                }
                change => change,
            },
            cause,
            root,
            worked: draft.worked,
            private,
        };
        self.events.push(event);
        EventLink { number, root }
    }

    fn is_private_name(&self, name: &str) -> bool {
        if self.private.is_empty() {
            return false;
        }
        let name = name.to_ascii_lowercase();
        let is_public = self.public.as_ref().is_some_and(|public| public.contains(&name));
        self.private.contains(&name)
            || !is_public && auxiliary_of(&name).any(|of| self.private.contains(of))
    }

    fn is_undeclared(&self, fact: &str) -> bool {
        let (Some(public), Some(name)) = (&self.public, head(fact)) else { return false };
        let name = name.to_ascii_lowercase();
        // What an agent offers is known to all.
        !name.starts_with("offers-")
            && !public.contains(&name)
            && !auxiliary_of(&name).any(|of| public.contains(of))
    }

    /// Whether an announcement has facts that neither the ontology nor a model declares.
    fn has_undeclared(&self, epoch: &Message) -> bool {
        let texts = ["believed", "retracted"].map(|key| epoch.content.get(key));
        let texts = texts.into_iter().flatten().filter_map(serde_json::Value::as_str);
        texts.flat_map(facts).any(|fact| self.is_undeclared(fact.fact))
    }

    /// Returns when something was found that was there before, in words.
    fn beginning(&self) -> &'static str {
        match self.outage {
            Some(_) => "as the history begins again",
            None => "as the history begins",
        }
    }

    /// Returns the name as shared text.
    fn name(&mut self, name: &str) -> Arc<str> {
        if let Some(known) = self.names.get(name) {
            return Arc::clone(known);
        }
        if self.names.len() >= AGENTS_MAX {
            self.names.clear();
        }
        let shared: Arc<str> = name.into();
        self.names.insert(name.to_owned(), Arc::clone(&shared));
        shared
    }

    /// Returns what is known of an agent.
    fn agent(&mut self, name: &str) -> &mut AgentTrace {
        if !self.agents.contains(name) {
            self.agents.insert(name, AgentTrace::default());
        }
        self.agents.get_mut(name).expect("invariant: it was inserted if it was missing")
    }

    /// Returns the cause of something that an agent does by itself: a device has noticed something,
    /// anyone else speaks for a person.
    fn own_initiative(&self, agent: &str) -> EventCause {
        match self.agents.get(agent) {
            Some(trace) if trace.is_actuator => {
                let noticed = trace.running_step().or(trace.last_fact);
                noticed.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event)
            }
            _ => EventCause::Root(HistoryRoot::Person),
        }
    }

    /// Records a request for a change, which is not about a goal.
    fn record_request(&mut self, message: &Message, what: &str, at_ms: u64) -> EventLink {
        let sender = message.sender.as_str();
        let cause = self.own_initiative(sender);
        let text = format!("`{sender}` {what}");
        let conversation = message.conversation_id.as_str();
        let draft = EventDraft::new(HistoryKind::Request, sender, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.last_request = Some((at_ms, event));
        event
    }
}
