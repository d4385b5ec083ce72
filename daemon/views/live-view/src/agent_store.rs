//! The agents: whether each is present, and what it offers.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::{
    AbsentAgent, Discovered, DiscoveryReport, Heartbeat, MailboxStatus, ModelAnnouncement,
};
use acl::{AgentId, DaemonId, Incarnation};
use pddl::ActionModel;

use crate::event::{AgentPlace, ExpectedAgent};
use crate::moment::{Moment, ViewLimits};
use crate::rows::AgentPresence;
use crate::text::cut;

/// Half periods of silence after which an agent counts as silent; Domain Maintainers tolerate as
/// many.
const HALF_PERIODS_TOLERATED: u64 = 7;

/// Longest silence that is tolerated, in milliseconds, whatever period an agent names.
const SILENCE_MS_MAX: u64 = 60_000;

/// Maximum number of replicas of one agent.
const REPLICAS_MAX: usize = 64;

/// Maximum number of actions of one agent that are kept.
const ACTIONS_MAX: usize = 500;

/// Maximum number of actions of an agent whose action model is not kept.
const NAMES_MAX: usize = 50;

/// Maximum number of problems of one agent that are kept.
const PROBLEMS_MAX: usize = 20;

/// One replica of an agent.
#[derive(Clone, Debug)]
pub(crate) struct ReplicaRecord {
    pub(crate) incarnation: Incarnation,
    pub(crate) since: Moment,
}

/// The last heartbeat of an agent.
#[derive(Clone, Debug)]
pub(crate) struct LastBeat {
    pub(crate) at: Moment,
    pub(crate) period_ms: u64,
    incarnation: Incarnation,
    sequence: u64,
    /// Digest of the agent's present action model.
    digest: String,
}

/// One action of an agent.
#[derive(Clone, Debug)]
pub(crate) struct SeenAction {
    pub(crate) parameters: String,
    pub(crate) is_offered: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct AgentRecord {
    pub(crate) replicas: BTreeMap<DaemonId, ReplicaRecord>,
    /// Moment at which the agent was seen to leave; `None` while it is here.
    pub(crate) gone_at: Option<Moment>,
    /// Moment at which anything of the agent was first observed.
    pub(crate) first_at: Option<Moment>,
    pub(crate) beat: Option<LastBeat>,
    pub(crate) model: Option<String>,
    /// Digest of the last observed action model, even if the model is too long to be kept.
    model_digest: Option<String>,
    pub(crate) actions: BTreeMap<String, SeenAction>,
    pub(crate) is_expected: bool,
    /// Whether the agent is expected only because a daemon has reported its absence.
    is_reported_absent: bool,
    /// Whether only guests, the processes of commands, have hosted the agent of late.
    is_at_guest: bool,
    expected_on: Vec<DaemonId>,
    pub(crate) mailbox: Option<MailboxStatus>,
    pub(crate) discovered: Option<Discovered>,
    pub(crate) conflicts: Vec<String>,
}

impl AgentRecord {
    pub(crate) fn presence(&self, now: Moment) -> AgentPresence {
        if self.gone_at.is_some() {
            return AgentPresence::Gone;
        }
        let is_silent = self.beat.as_ref().is_some_and(|beat| {
            let tolerated = beat.period_ms.saturating_mul(HALF_PERIODS_TOLERATED) / 2;
            now.since(beat.at) > tolerated.min(SILENCE_MS_MAX)
        });
        match self.first_at {
            Some(_) if is_silent => AgentPresence::Silent,
            Some(_) => AgentPresence::Present,
            None if self.is_expected => AgentPresence::Absent,
            None => AgentPresence::Unknown,
        }
    }

    /// Whether the agent is here and its present action model was not observed.
    pub(crate) fn lacks_model(&self) -> bool {
        let digest = self.beat.as_ref().map(|beat| &beat.digest);
        self.gone_at.is_none() && digest.is_some() && digest != self.model_digest.as_ref()
    }

    /// Whether anybody would miss the agent: the ecosystem file names it, or it has heartbeats.
    pub(crate) fn is_missed(&self) -> bool {
        self.is_expected || self.beat.is_some()
    }

    /// Whether the agent belongs to a command or to the keyboard of a person, which come and go, and
    /// is no part of the ecosystem.
    pub(crate) fn is_guest(&self) -> bool {
        self.is_at_guest && !self.is_expected && self.actions.is_empty()
    }

    pub(crate) fn since(&self) -> Option<Moment> {
        let joined = self.replicas.values().map(|replica| replica.since).min();
        self.gone_at.or(joined).or(self.first_at)
    }

    pub(crate) fn daemon(&self) -> Option<&DaemonId> {
        self.replicas.keys().next().or(self.expected_on.first())
    }

    pub(crate) fn offered(&self) -> Vec<String> {
        let offered = self.actions.iter().filter(|(_, action)| action.is_offered);
        offered.map(|(name, _)| name.clone()).collect()
    }
}

/// What an event has changed about an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum AgentChange {
    /// Nothing that a person cares about.
    Nothing,
    /// The agent has come.
    Came,
    /// The agent is gone.
    Went,
    /// The agent offers other actions than before.
    Offers,
}

#[derive(Clone, Debug)]
pub(crate) struct AgentStore {
    agents: BTreeMap<AgentId, AgentRecord>,
    /// The agents that are gone, the first one first.
    gone: BTreeSet<(Moment, AgentId)>,
    /// Number of times that an agent went, or came back after it was gone or silent.
    comings: u64,
    agents_max: usize,
    model_bytes: usize,
    /// Bytes of all kept action models, and their limit.
    models_bytes: usize,
    models_bytes_max: usize,
    text_bytes: usize,
}

impl AgentStore {
    pub(crate) fn new(limits: &ViewLimits) -> AgentStore {
        AgentStore {
            agents: BTreeMap::new(),
            gone: BTreeSet::new(),
            comings: 0,
            agents_max: limits.agents,
            model_bytes: limits.model_bytes,
            models_bytes: 0,
            models_bytes_max: limits.models_bytes,
            text_bytes: limits.text_bytes,
        }
    }

    pub(crate) fn get(&self, agent: &AgentId) -> Option<&AgentRecord> {
        self.agents.get(agent)
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (&AgentId, &AgentRecord)> {
        self.agents.iter()
    }

    /// Whether an agent belongs to a command or to the keyboard of a person.
    pub(crate) fn is_guest(&self, agent: &AgentId) -> bool {
        self.agents.get(agent).is_some_and(AgentRecord::is_guest)
    }

    /// Whether an agent is known and gone or silent.
    pub(crate) fn is_away(&self, name: &str, now: Moment) -> bool {
        let presence = self.agents.get(name).map(|record| record.presence(now));
        matches!(presence, Some(AgentPresence::Gone | AgentPresence::Silent))
    }

    /// Returns the number of times that an agent went, or came back after it was gone or silent. An
    /// agent that falls silent does so with time alone, and is not counted.
    pub(crate) fn comings(&self) -> u64 {
        self.comings
    }

    /// Returns the record of an agent, a new one if there is room. If the limit is reached, the
    /// agent that has left first is dropped.
    fn entry(&mut self, agent: &AgentId) -> Option<&mut AgentRecord> {
        if !self.agents.contains_key(agent) && self.agents.len() >= self.agents_max {
            let (_, dropped) = self.gone.pop_first()?;
            self.comings += 1;
            let model = self.agents.remove(&dropped).and_then(|record| record.model);
            self.models_bytes -= model.map_or(0, |model| model.len());
        }
        Some(self.agents.entry(agent.clone()).or_default())
    }

    fn came_back(&mut self, agent: &AgentId) {
        if let Some(record) = self.agents.get_mut(agent)
            && let Some(gone_at) = record.gone_at.take()
        {
            self.comings += 1;
            self.gone.remove(&(gone_at, agent.clone()));
        }
    }

    /// Marks an agent as gone. Returns whether it was here.
    fn leaves(&mut self, at: Moment, agent: &AgentId) -> AgentChange {
        let Some(record) = self.agents.get_mut(agent) else { return AgentChange::Nothing };
        let is_here = record.gone_at.is_none() && record.first_at.is_some();
        if !is_here || !record.replicas.is_empty() {
            return AgentChange::Nothing;
        }
        record.gone_at = Some(at);
        self.comings += 1;
        self.gone.insert((at, agent.clone()));
        AgentChange::Went
    }

    // === events ===

    pub(crate) fn joined(&mut self, at: Moment, place: &AgentPlace) -> AgentChange {
        let Some(record) = self.entry(&place.agent) else { return AgentChange::Nothing };
        let is_new = record.gone_at.is_some() || record.first_at.is_none();
        record.first_at.get_or_insert(at);
        let known = record.replicas.get(&place.daemon);
        if known.is_some_and(|replica| replica.incarnation >= place.incarnation)
            || (known.is_none() && record.replicas.len() >= REPLICAS_MAX)
        {
            return AgentChange::Nothing;
        }
        let since = began(place.incarnation).filter(|began| *began <= at).unwrap_or(at);
        let replica = ReplicaRecord { incarnation: place.incarnation, since };
        record.replicas.insert(place.daemon.clone(), replica);
        record.is_at_guest = record.replicas.keys().all(DaemonId::is_guest);
        self.came_back(&place.agent);
        if is_new { AgentChange::Came } else { AgentChange::Nothing }
    }

    pub(crate) fn left(&mut self, at: Moment, place: &AgentPlace) -> AgentChange {
        let Some(record) = self.agents.get_mut(&place.agent) else { return AgentChange::Nothing };
        let is_it = record
            .replicas
            .get(&place.daemon)
            .is_some_and(|replica| replica.incarnation <= place.incarnation);
        if is_it {
            record.replicas.remove(&place.daemon);
        }
        if !record.replicas.is_empty() {
            return AgentChange::Nothing;
        }
        self.leaves(at, &place.agent)
    }

    /// Takes the list of all agents that are present. Returns those that have left without notice.
    pub(crate) fn directory(&mut self, at: Moment, places: &[AgentPlace]) -> Vec<AgentId> {
        let listed: BTreeSet<_> =
            places.iter().map(|place| (&place.agent, &place.daemon)).collect();
        let mut missing = Vec::new();
        for (agent, record) in &mut self.agents {
            let was_here = !record.replicas.is_empty();
            record.replicas.retain(|daemon, _| listed.contains(&(agent, daemon)));
            if was_here && record.replicas.is_empty() {
                missing.push(agent.clone());
            }
        }
        for place in places {
            self.joined(at, place);
        }
        missing.retain(|agent| self.leaves(at, agent) == AgentChange::Went);
        missing
    }

    /// Takes what the Domain Maintainer says about the presence of an agent, for observers that
    /// have no other source.
    pub(crate) fn capability(&mut self, at: Moment, agent: &AgentId, is_here: bool) -> AgentChange {
        let Some(record) = self.entry(agent) else { return AgentChange::Nothing };
        if !record.replicas.is_empty() {
            return AgentChange::Nothing;
        }
        if !is_here {
            return self.leaves(at, agent);
        }
        let is_new = record.gone_at.is_some() || record.first_at.is_none();
        record.first_at.get_or_insert(at);
        self.came_back(agent);
        if is_new { AgentChange::Came } else { AgentChange::Nothing }
    }

    pub(crate) fn expected(&mut self, expected: &[ExpectedAgent]) {
        for record in self.agents.values_mut() {
            record.is_expected = record.is_reported_absent;
        }
        for ExpectedAgent { agent, daemons } in expected {
            let Some(record) = self.entry(agent) else { return };
            (record.is_expected, record.is_reported_absent) = (true, false);
            record.expected_on = daemons.iter().take(REPLICAS_MAX).cloned().collect();
        }
    }

    /// Takes the agents whose absence a daemon reports, which reads the ecosystem file. An agent that
    /// is not reported any more and is not here either is no longer in the file.
    pub(crate) fn reported_absent(&mut self, absent: &[AbsentAgent]) {
        for record in self.agents.values_mut() {
            if record.is_reported_absent && record.first_at.is_none() {
                (record.is_expected, record.is_reported_absent) = (false, false);
            }
        }
        for AbsentAgent { agent, daemons } in absent {
            let Some(record) = self.entry(agent) else { return };
            if !record.is_expected {
                (record.is_expected, record.is_reported_absent) = (true, true);
                record.expected_on = daemons.iter().take(REPLICAS_MAX).cloned().collect();
            }
        }
    }

    /// Notes that an agent has sent a message.
    pub(crate) fn spoke(&mut self, at: Moment, agent: &AgentId) {
        if let Some(record) = self.entry(agent) {
            record.first_at.get_or_insert(at);
        }
    }

    /// Whether a heartbeat changes more than the time at which the agent was heard: the agent comes, is
    /// heard again after a silence, has another model, or repeats stops.
    pub(crate) fn is_news(
        &self,
        at: Moment,
        agent: &AgentId,
        incarnation: Incarnation,
        beat: &Heartbeat,
    ) -> bool {
        let Some(record) = self.agents.get(agent) else { return true };
        let last = record.beat.as_ref();
        let is_same =
            last.is_some_and(|it| it.incarnation == incarnation && it.digest == beat.digest);
        let is_here = record.presence(at) == AgentPresence::Present;
        !is_same || !is_here || !beat.stops.is_empty()
    }

    /// Takes a heartbeat. Returns whether it is newer than the last one.
    pub(crate) fn heartbeat(
        &mut self,
        at: Moment,
        agent: &AgentId,
        incarnation: Incarnation,
        beat: &Heartbeat,
    ) -> bool {
        let digest = cut(&beat.digest, self.text_bytes);
        let Some(record) = self.entry(agent) else { return false };
        record.first_at.get_or_insert(at);
        let number = (incarnation, beat.sequence);
        if record.beat.as_ref().is_some_and(|last| (last.incarnation, last.sequence) >= number) {
            return false;
        }
        let (period_ms, sequence) = (u64::from(beat.period), beat.sequence);
        let was_silent = record.presence(at) == AgentPresence::Silent;
        record.beat = Some(LastBeat { at, period_ms, incarnation, sequence, digest });
        // Without other news of presence, an agent that speaks is here.
        if record.replicas.is_empty() {
            self.came_back(agent);
        }
        self.comings += u64::from(was_silent);
        true
    }

    /// Takes an action model. Returns the parsed model with the change.
    pub(crate) fn model(
        &mut self,
        agent: &AgentId,
        announced: &ModelAnnouncement,
    ) -> (Option<ActionModel>, AgentChange) {
        let nothing = (None, AgentChange::Nothing);
        let (bytes_max, room) = (self.text_bytes, self.models_bytes_max - self.models_bytes);
        let model_bytes = self.model_bytes;
        let digest = cut(&announced.heartbeat.digest, bytes_max);
        let Some(record) = self.entry(agent) else { return nothing };
        record.model_digest = Some(digest);
        if record.model.as_ref() == Some(&announced.model) {
            return nothing;
        }
        let Some(model) = pddl::parse_action_model(&announced.model).value else { return nothing };
        let former_bytes = record.model.take().map_or(0, |former| former.len());
        let bytes = announced.model.len();
        let is_kept = bytes <= model_bytes && bytes <= room + former_bytes;
        record.model = is_kept.then(|| announced.model.clone());
        let before = record.offered();
        record.actions.values_mut().for_each(|action| action.is_offered = false);
        let durative =
            model.durative_actions.iter().map(|action| (&action.name, &action.parameters));
        let plain = model.actions.iter().map(|action| (&action.name, &action.parameters));
        let actions = plain.chain(durative).filter(|(name, _)| name.as_str().len() <= bytes_max);
        for (name, parameters) in actions.take(if is_kept { ACTIONS_MAX } else { NAMES_MAX }) {
            let name = name.as_str().to_owned();
            if record.actions.len() >= ACTIONS_MAX && !record.actions.contains_key(&name) {
                record.actions.retain(|_, action| action.is_offered);
            }
            let parameters = if is_kept { typed(parameters) } else { String::new() };
            record.actions.insert(name, SeenAction { parameters, is_offered: true });
        }
        let change =
            if before == record.offered() { AgentChange::Nothing } else { AgentChange::Offers };
        self.models_bytes = self.models_bytes - former_bytes + if is_kept { bytes } else { 0 };
        (Some(model), change)
    }

    /// Takes actions that an agent is known to offer, unless its action model was observed.
    pub(crate) fn offers<'o>(
        &mut self,
        at: Moment,
        agent: &AgentId,
        actions: impl Iterator<Item = &'o String>,
    ) {
        let bytes_max = self.text_bytes;
        let Some(record) = self.entry(agent) else { return };
        record.first_at.get_or_insert(at);
        if record.model_digest.is_some() {
            return;
        }
        for action in actions.filter(|action| action.len() <= bytes_max) {
            if record.actions.len() < ACTIONS_MAX {
                let offered = SeenAction { parameters: String::new(), is_offered: true };
                record.actions.entry(action.clone()).or_insert(offered);
            }
        }
    }

    pub(crate) fn mailbox(&mut self, status: &MailboxStatus) {
        if let Some(record) = self.agents.get_mut(&status.agent) {
            record.mailbox = Some(status.clone());
        }
    }

    pub(crate) fn discovered(&mut self, report: &DiscoveryReport) {
        let bytes_max = self.text_bytes;
        for found in &report.discovered {
            let Some(record) = self.entry(&found.agent) else { return };
            record.discovered = Some(Discovered {
                agent: found.agent.clone(),
                by: cut(&found.by, bytes_max),
                joined: found.joined,
                problem: found.problem.as_ref().map(|problem| cut(problem, bytes_max)),
                toml: cut(&found.toml, bytes_max),
            });
        }
    }

    pub(crate) fn conflicts(&mut self, conflicts: &BTreeMap<AgentId, Vec<String>>) {
        let bytes_max = self.text_bytes;
        self.agents.values_mut().for_each(|record| record.conflicts.clear());
        for (agent, problems) in conflicts {
            let Some(record) = self.entry(agent) else { return };
            let problems = problems.iter().take(PROBLEMS_MAX);
            record.conflicts = problems.map(|problem| cut(problem, bytes_max)).collect();
        }
    }
}

/// Returns the moment at which an incarnation began: it is a number of microseconds since the Unix
/// epoch. `None` if it is another number.
fn began(incarnation: Incarnation) -> Option<Moment> {
    const YEAR_2020_MS: u64 = 1_577_836_800_000;
    Some(Moment(incarnation.0 / 1_000)).filter(|began| began.0 >= YEAR_2020_MS)
}

fn typed(parameters: &[pddl::Typed]) -> String {
    let each = parameters.iter().map(|parameter| {
        let name = parameter.name.as_str();
        if parameter.ty.is_object() {
            format!("?{name}")
        } else {
            format!("?{name} - {}", parameter.ty)
        }
    });
    each.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    fn place(agent: &str, daemon: &str, incarnation: u64) -> AgentPlace {
        let daemon = DaemonId::new(daemon).expect("a name");
        AgentPlace { agent: name(agent), daemon, incarnation: Incarnation(incarnation) }
    }

    fn beat(sequence: u64) -> Heartbeat {
        let beat = serde_json::json!({ "digest": "", "sequence": sequence, "period": 1000 });
        serde_json::from_value(beat).expect("a heartbeat")
    }

    fn store() -> AgentStore {
        AgentStore::new(&ViewLimits { agents: 3, ..ViewLimits::default() })
    }

    fn presence(store: &AgentStore, agent: &str, now: u64) -> Option<AgentPresence> {
        store.get(&name(agent)).map(|record| record.presence(Moment(now)))
    }

    #[test]
    fn an_agent_is_gone_when_its_last_replica_has_left() {
        let mut store = store();
        assert_eq!(store.joined(Moment(1), &place("r", "a", 5)), AgentChange::Came);
        assert_eq!(store.joined(Moment(2), &place("r", "b", 6)), AgentChange::Nothing);
        assert_eq!(store.left(Moment(3), &place("r", "a", 5)), AgentChange::Nothing);
        assert_eq!(store.left(Moment(3), &place("r", "b", 5)), AgentChange::Nothing, "restarted");
        assert_eq!(store.left(Moment(4), &place("r", "b", 6)), AgentChange::Went);
        assert_eq!(presence(&store, "r", 4), Some(AgentPresence::Gone));
        assert_eq!(store.joined(Moment(5), &place("r", "b", 7)), AgentChange::Came);
        assert_eq!(presence(&store, "r", 5), Some(AgentPresence::Present));
    }

    #[test]
    fn a_directory_tells_departures_that_were_missed() {
        let mut store = store();
        store.joined(Moment(1), &place("r", "a", 5));
        store.joined(Moment(1), &place("s", "a", 5));
        assert_eq!(store.directory(Moment(2), &[place("r", "a", 5)]), [name("s")]);
        assert_eq!(store.directory(Moment(3), &[place("r", "b", 6)]), [], "it has moved");
        assert_eq!(presence(&store, "r", 3), Some(AgentPresence::Present));
    }

    #[test]
    fn an_agent_without_heartbeats_is_silent() {
        let mut store = store();
        store.expected(&[ExpectedAgent { agent: name("t"), daemons: Vec::new() }]);
        assert_eq!(presence(&store, "t", 0), Some(AgentPresence::Absent));
        assert!(store.heartbeat(Moment(0), &name("t"), Incarnation(1), &beat(1)));
        assert!(!store.heartbeat(Moment(9_000), &name("t"), Incarnation(1), &beat(1)), "repeated");
        assert_eq!(presence(&store, "t", 3_500), Some(AgentPresence::Present));
        assert_eq!(presence(&store, "t", 3_501), Some(AgentPresence::Silent));
        assert!(store.heartbeat(Moment(9_000), &name("t"), Incarnation(2), &beat(1)));
        assert_eq!(presence(&store, "t", 9_000), Some(AgentPresence::Present));
    }

    #[test]
    fn agents_that_daemons_miss_are_absent() {
        let mut store = store();
        let absent = AbsentAgent { agent: name("t"), daemons: Vec::new() };
        store.reported_absent(std::slice::from_ref(&absent));
        assert_eq!(presence(&store, "t", 0), Some(AgentPresence::Absent));
        store.reported_absent(&[]);
        assert_eq!(presence(&store, "t", 1), Some(AgentPresence::Unknown), "not in the file");
        store.reported_absent(&[absent]);
        store.joined(Moment(2), &place("t", "d", 1));
        store.reported_absent(&[]);
        assert_eq!(presence(&store, "t", 2), Some(AgentPresence::Present));
        assert!(store.get(&name("t")).expect("known").is_expected, "it is in the file");
    }

    #[test]
    fn the_agents_that_left_first_are_dropped_first() {
        let mut store = store();
        for (at, agent) in [(1, "a"), (2, "b"), (3, "c")] {
            store.joined(Moment(at), &place(agent, "d", 1));
        }
        assert_eq!(store.joined(Moment(4), &place("e", "d", 1)), AgentChange::Nothing, "full");
        store.left(Moment(5), &place("b", "d", 1));
        assert_eq!(store.joined(Moment(6), &place("e", "d", 1)), AgentChange::Came);
        assert_eq!(presence(&store, "b", 6), None);
        assert_eq!((store.agents.len(), store.gone.len()), (3, 0));
    }

    #[test]
    fn withdrawn_actions_stay_known() {
        let mut store = store();
        let announce = |actions: &str| {
            let model = format!("(define (agent r) (:domain d) {actions})");
            let beat = serde_json::json!({
                "model": model, "digest": "", "sequence": 1, "period": 1000,
            });
            serde_json::from_value::<ModelAnnouncement>(beat).expect("a model")
        };
        let both = "(:action move :agent ?b - robot :parameters (?from ?to - location) :effect ())
            (:action dock :agent ?b - robot :parameters () :effect ())";
        assert_eq!(store.model(&name("r"), &announce(both)).1, AgentChange::Offers);
        assert_eq!(store.model(&name("r"), &announce("")).1, AgentChange::Offers);
        let record = store.get(&name("r")).expect("known");
        assert_eq!(record.offered(), Vec::<String>::new());
        assert_eq!(record.actions["move"].parameters, "?from - location ?to - location");
    }
}
