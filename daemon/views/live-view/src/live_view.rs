//! The view of an ecosystem: takes events, and returns what is to be seen.

mod agent_views;
mod daemon_views;
mod health;
mod incoming;
mod learning;

use std::collections::VecDeque;

use acl::content::{Discovered, StopState};
use acl::{AgentId, ConversationId, EcosystemId, ReplyToken};
use conversation::{DuplicateWindow, Transcript};

use crate::activity_log::{ActivityLog, Sentence};
use crate::agent_store::{AgentChange, AgentStore};
use crate::bounded::BoundedMap;
use crate::conversation_store::ConversationStore;
use crate::daemon_store::DaemonStore;
use crate::event::{AgentPlace, ViewEvent};
use crate::fact_store::FactStore;
use crate::floor::FloorSources;
use crate::goal_store::{GoalStore, GoalTexts};
use crate::moment::{Moment, ViewLimits};
use crate::moves::MoveSchemas;
use crate::question_store::QuestionStore;
use crate::rows::{
    ActivityEntry, AgentDetail, AgentRow, ConversationDetail, ConversationRow, DaemonRow, FactRow,
    FloorPlan, GoalDetail, GoalRow, Overview, QuestionRow, StopRow,
};
use crate::stop_store::StopStore;
use crate::text::{duration, plural};

/// Number of message identifiers by which repeated messages are recognized.
const DUPLICATES_MAX: usize = 10_000;

/// Maximum number of requests to stop that are followed.
const STOP_EXCHANGES_MAX: usize = 10_000;

/// Time after the first event, or after the ecosystem was reached again, within which what is learnt
/// is told without sentences: it was so before.
const INVENTORY_MS: u64 = 2_000;

/// Maximum number of recent message problems that are kept.
const TROUBLES_MAX: usize = 100;

/// A message that was refused or that broke its protocol.
#[derive(Clone, Debug)]
struct Trouble {
    at: Moment,
    text: String,
    conversation: ConversationId,
}

/// How many messages there were of some kinds.
#[derive(Clone, Copy, Debug, Default)]
struct ObservedMessages {
    messages: u64,
    lost: u64,
    unreadable: u64,
    out_of_turn: u64,
}

/// What is to be seen of one ecosystem. A copy is independent of the original.
#[derive(Clone, Debug)]
pub struct LiveView {
    ecosystem: EcosystemId,
    limits: ViewLimits,
    goals: GoalStore,
    agents: AgentStore,
    facts: FactStore,
    moves: MoveSchemas,
    /// Epoch of the last domain that was searched for moving actions.
    learned_epoch: Option<u64>,
    stops: StopStore,
    questions: QuestionStore,
    activity: ActivityLog,
    conversations: ConversationStore,
    daemons: DaemonStore,
    transcript: Transcript,
    duplicates: DuplicateWindow,
    /// Requests to stop and to release stops, which go to all agents. Those that do not act decline
    /// them, which is no news.
    stop_exchanges: BoundedMap<ReplyToken, ()>,
    counts: ObservedMessages,
    /// Messages that were refused, the last ones.
    refused: VecDeque<Trouble>,
    /// Messages that broke their protocol, the last ones.
    out_of_turn: VecDeque<Trouble>,
    /// Moment of the first event.
    began_at: Option<Moment>,
    /// Moment at which messages were lost last.
    lost_at: Option<Moment>,
    /// Moment at which a message could not be parsed last.
    unreadable_at: Option<Moment>,
    is_reached: Option<bool>,
    /// Moment at which the ecosystem was reached last, or else that of the first event: what is
    /// learnt right after it was so before.
    joined_at: Option<Moment>,
    /// Moment since which the ecosystem is not reached.
    unreached_at: Option<Moment>,
    /// Whether a list of all present agents was observed.
    has_directory: bool,
    /// Number of events that were more than a heartbeat without news.
    events: u64,
}

/// The state of a view by which one sees whether rows may have changed otherwise than with time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewRevision {
    /// Number of events that were more than a heartbeat of an agent that is here, with the same model
    /// and without stops.
    pub events: u64,
    /// Number of changes of facts.
    pub facts: u64,
    /// Number of times that an agent went, or came back after it was gone or silent: the facts of
    /// those that are away are stale.
    pub comings: u64,
}

impl LiveView {
    /// Creates the view of an ecosystem before the first event.
    pub fn new(ecosystem: EcosystemId, limits: ViewLimits) -> LiveView {
        LiveView {
            ecosystem,
            goals: GoalStore::new(&limits),
            agents: AgentStore::new(&limits),
            facts: FactStore::new(&limits),
            moves: MoveSchemas::default(),
            learned_epoch: None,
            stops: StopStore::new(limits.agents, limits.text_bytes),
            questions: QuestionStore::new(limits.questions, limits.text_bytes),
            activity: ActivityLog::new(limits.activity, limits.text_bytes),
            conversations: ConversationStore::new(&limits),
            daemons: DaemonStore::new(limits.daemons, limits.text_bytes),
            transcript: Transcript::new(),
            duplicates: DuplicateWindow::new(DUPLICATES_MAX),
            stop_exchanges: BoundedMap::new(STOP_EXCHANGES_MAX),
            counts: ObservedMessages::default(),
            refused: VecDeque::new(),
            out_of_turn: VecDeque::new(),
            began_at: None,
            lost_at: None,
            unreadable_at: None,
            is_reached: None,
            joined_at: None,
            unreached_at: None,
            has_directory: false,
            events: 0,
            limits,
        }
    }

    /// Returns the name of the observed ecosystem.
    pub fn ecosystem(&self) -> &EcosystemId {
        &self.ecosystem
    }

    /// Returns the limits of what is kept.
    pub fn limits(&self) -> &ViewLimits {
        &self.limits
    }

    // === events ===

    /// Takes an event that was observed at `at`.
    pub fn observe(&mut self, at: Moment, event: ViewEvent) {
        self.began_at.get_or_insert(at);
        self.joined_at.get_or_insert(at);
        // A heartbeat without news takes it back.
        self.events += 1;
        match event {
            ViewEvent::Message(message) => self.take_message(at, &message),
            ViewEvent::Joined(place) => self.take_joined(at, &place),
            ViewEvent::Left(place) => {
                if self.agents.left(at, &place) == AgentChange::Went {
                    self.tell_departure(at, &place.agent);
                }
            }
            ViewEvent::Directory(places) => self.take_directory(at, &places),
            ViewEvent::Expected(expected) => {
                self.daemons.expected(expected.iter().flat_map(|agent| &agent.daemons));
                self.agents.expected(&expected);
            }
            ViewEvent::State(state) => self.facts.replace(at, &state),
            ViewEvent::Domain(snapshot) => {
                self.agents.conflicts(&snapshot.conflicts);
                self.learn_moves(&snapshot);
            }
            ViewEvent::Goals(statuses) => self.goals.statuses(at, &statuses),
            ViewEvent::Questions(questions) => self.questions.listed(at, &questions),
            ViewEvent::Mailboxes(mailboxes) => {
                self.daemons.mailboxes(at, &mailboxes);
                mailboxes.mailboxes.iter().for_each(|status| self.agents.mailbox(status));
            }
            ViewEvent::Stops(states) => self.take_stops(at, &states),
            ViewEvent::Discovered(report) => self.agents.discovered(&report),
            ViewEvent::Daemon(report) => {
                self.agents.reported_absent(&report.absent);
                let daemon = report.daemon.clone();
                if self.daemons.status(at, report) {
                    self.tell(at, Sentence::notable(format!("the daemon {daemon} was restarted")));
                }
            }
            ViewEvent::RoundTrip { daemon, micros } => {
                self.daemons.round_trip(at, &daemon, micros);
            }
            ViewEvent::NoAnswer(daemon) => self.daemons.no_answer(&daemon),
            ViewEvent::Lost(count) => {
                self.counts.lost = self.counts.lost.saturating_add(count);
                self.lost_at = Some(at);
                let lost = plural(count, "message");
                self.tell(at, Sentence::problem(format!("{lost} not observed")));
            }
            ViewEvent::Unread { since } => {
                self.joined_at = Some(at);
                let gap = duration(at.since(since));
                let text = format!("nothing was observed for {gap}, because nobody read the view");
                self.tell(at, Sentence::problem(text));
            }
            ViewEvent::Unreadable(count) => {
                self.counts.unreadable = self.counts.unreadable.saturating_add(count);
                self.unreadable_at = Some(at);
            }
            ViewEvent::Reached(is_reached) => self.take_reached(at, is_reached),
        }
    }

    fn tell(&mut self, at: Moment, sentence: Sentence) {
        self.activity.add(at, sentence);
    }

    /// Whether `at` is within the time in which things are learnt that were so before.
    fn is_inventory(&self, at: Moment) -> bool {
        self.joined_at.is_none_or(|joined| at.since(joined) < INVENTORY_MS)
    }

    fn tell_arrival(&mut self, at: Moment, agent: &AgentId) {
        if !self.is_inventory(at) && !self.agents.is_guest(agent) {
            let sentence = self.presence_sentence(agent, "is here", Sentence::notable);
            self.tell(at, sentence);
        }
    }

    fn tell_departure(&mut self, at: Moment, agent: &AgentId) {
        if !self.agents.is_guest(agent) {
            let sentence = self.presence_sentence(agent, "is gone", Sentence::problem);
            self.tell(at, sentence);
        }
    }

    /// Returns a sentence about the presence of an agent. Commands come and go, and nobody misses
    /// them.
    fn presence_sentence(
        &self,
        agent: &AgentId,
        what: &str,
        of_missed: fn(String) -> Sentence,
    ) -> Sentence {
        let is_missed = self.agents.get(agent).is_some_and(|record| record.is_missed());
        let text = format!("{agent} {what}");
        let sentence = if is_missed { of_missed(text) } else { Sentence::routine(text) };
        sentence.about(agent)
    }

    fn take_joined(&mut self, at: Moment, place: &AgentPlace) {
        self.daemons.hosts(at, &place.daemon);
        if self.agents.joined(at, place) == AgentChange::Came {
            self.tell_arrival(at, &place.agent);
        }
    }

    fn take_directory(&mut self, at: Moment, places: &[AgentPlace]) {
        for agent in self.agents.directory(at, places) {
            self.tell_departure(at, &agent);
        }
        places.iter().for_each(|place| self.daemons.hosts(at, &place.daemon));
        self.has_directory = true;
    }

    fn take_stops(&mut self, at: Moment, states: &[StopState]) {
        states.iter().for_each(|state| self.stops.state(at, state));
    }

    fn take_reached(&mut self, at: Moment, is_reached: bool) {
        let before = self.is_reached.replace(is_reached);
        if is_reached && before != Some(true) {
            self.joined_at = Some(at);
        }
        self.unreached_at = match self.unreached_at {
            _ if is_reached => None,
            since => since.or(Some(at)),
        };
        match (before, is_reached) {
            (Some(true) | None, false) => {
                self.tell(at, Sentence::problem("the ecosystem is not reached"));
            }
            (Some(false), true) => {
                self.tell(at, Sentence::notable("the ecosystem is reached again"));
            }
            _ => (),
        }
    }

    /// Returns the state by which one sees whether rows may have changed.
    pub fn revision(&self) -> ViewRevision {
        let (events, facts) = (self.events, self.facts.revision());
        ViewRevision { events, facts, comings: self.agents.comings() }
    }

    /// Whether any stop was observed that may be in force.
    pub fn has_stops(&self) -> bool {
        !self.stops.is_empty()
    }

    // === rows ===

    /// Returns whether all is well at `now`, and why not.
    pub fn overview(&self, now: Moment) -> Overview {
        health::overview(self, now)
    }

    /// Returns all goals: those that are pursued first, the newest first; then those that wait for
    /// their times, the next one first; then those that have ended, the newest first.
    pub fn goals(&self, now: Moment) -> Vec<GoalRow> {
        self.goals.rows(self.goal_texts(now))
    }

    /// Returns one goal with its plans; `None` if it is not known.
    pub fn goal(&self, conversation: &ConversationId, now: Moment) -> Option<GoalDetail> {
        self.goals.detail(conversation, self.goal_texts(now))
    }

    fn goal_texts(&self, now: Moment) -> GoalTexts<'_> {
        GoalTexts { now, moves: &self.moves }
    }

    /// Returns all agents of the ecosystem, sorted by name. The agents of commands are left out.
    pub fn agents(&self, now: Moment) -> Vec<AgentRow> {
        agent_views::rows(self, now)
    }

    /// Returns the agents with rows that may differ from the revision `since`, sorted by name, if
    /// nothing has happened after it and no stop is in force: those that change with time alone.
    /// `None` in all other cases.
    pub fn agents_since(&self, since: ViewRevision, now: Moment) -> Option<Vec<AgentRow>> {
        let is_same = since.events == self.events && since.comings == self.agents.comings();
        (is_same && !self.has_stops()).then(|| agent_views::moving_rows(self, now))
    }

    /// Returns agents with present action models that were not observed, at most `agents_max` of them.
    /// A query for the models of these agents tells them: a model that is announced while its agent
    /// starts reaches few observers.
    pub fn missing_models(&self, agents_max: usize) -> Vec<AgentId> {
        let missing = self.agents.iter().filter(|(_, record)| record.lacks_model());
        missing.map(|(agent, _)| agent.clone()).take(agents_max).collect()
    }

    /// Returns one agent with everything that is known about it; `None` if it is not known.
    pub fn agent(&self, agent: &AgentId, now: Moment) -> Option<AgentDetail> {
        agent_views::detail(self, agent, now)
    }

    /// Returns all facts, sorted by predicate or function and arguments.
    pub fn facts(&self, now: Moment) -> Vec<FactRow> {
        self.facts.rows(now, &|owner| self.agents.is_away(owner, now))
    }

    /// Returns the facts that were reported or changed after this revision, sorted as all are; `None`
    /// if one was removed after it, if an agent went or came back after it, or if the revision is that
    /// of another view. Rows that have changed with time alone are among them only `with_time`.
    pub fn facts_since(
        &self,
        revision: ViewRevision,
        now: Moment,
        with_time: bool,
    ) -> Option<Vec<FactRow>> {
        let is_ours = revision.facts <= self.facts.revision();
        let is_same = is_ours && revision.comings == self.agents.comings();
        let is_away = |owner: &str| self.agents.is_away(owner, now);
        let since = (revision.facts, with_time);
        is_same.then(|| self.facts.rows_since(since, now, &is_away)).flatten()
    }

    /// Returns the floor plan.
    pub fn floor(&self, now: Moment) -> FloorPlan {
        let sources = FloorSources {
            facts: &self.facts,
            moves: &self.moves,
            paths: self.goals.paths(&self.moves),
            now,
            rooms_max: self.limits.rooms,
        };
        let stops: Vec<_> = self.stops.in_force(now).collect();
        sources.plan(&|name| self.agents.is_away(name, now), &|name| {
            stops.iter().any(|stop| stop.concerns(name))
        })
    }

    /// Returns all open questions, those with the least remaining time first.
    pub fn questions(&self, now: Moment) -> Vec<QuestionRow> {
        self.questions.rows(now)
    }

    /// Iterates over what happened, oldest first.
    pub fn activity(&self) -> impl DoubleEndedIterator<Item = &ActivityEntry> + ExactSizeIterator {
        self.activity.entries().iter()
    }

    /// Returns all conversations, the one with the newest message first.
    pub fn conversations(&self) -> Vec<ConversationRow> {
        self.conversations.rows()
    }

    /// Returns one conversation with its messages; `None` if it is not known.
    pub fn conversation(&self, conversation: &ConversationId) -> Option<ConversationDetail> {
        self.conversations.detail(conversation)
    }

    /// Returns all daemons, sorted by name.
    pub fn topology(&self, now: Moment) -> Vec<DaemonRow> {
        daemon_views::rows(self, now)
    }
    /// Returns the stops in force, sorted by their identifiers.
    pub fn stops(&self, now: Moment) -> Vec<StopRow> {
        self.stops.rows(now)
    }

    /// Returns the discovered agents, sorted by name: those that take part, and those that wait for
    /// admission.
    pub fn discovered(&self) -> Vec<Discovered> {
        let mut found: Vec<_> =
            self.agents.iter().filter_map(|(_, record)| record.discovered.clone()).collect();
        found.sort_by(|one, other| one.agent.cmp(&other.agent));
        found
    }
}
