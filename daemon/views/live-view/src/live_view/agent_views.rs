//! The rows of agents.

use std::collections::BTreeMap;

use acl::AgentId;
use acl::content::Stop;

use super::LiveView;
use crate::agent_store::AgentRecord;
use crate::moment::Moment;
use crate::rows::{
    ActionRow, ActivityEntry, AgentDetail, AgentPresence, AgentRow, FactTruth, ReplicaRow,
};
use crate::text::{duration, plural};

/// Number of activities of one agent that are shown.
const RECENT_MAX: usize = 20;

/// What the rows of all agents share.
struct SharedParts<'v> {
    now: Moment,
    stops: Vec<&'v Stop>,
    /// The place of each agent that moves.
    places: BTreeMap<&'v str, &'v str>,
}

impl<'v> SharedParts<'v> {
    fn of(view: &'v LiveView, now: Moment) -> SharedParts<'v> {
        let mut places = BTreeMap::new();
        let stops: Vec<_> = view.stops.in_force(now).collect();
        // Only stops ask for the places.
        for (_, record) in view.facts.iter().filter(|_| !stops.is_empty()) {
            let fact = &record.fact;
            for at in view.moves.places.iter().filter(|at| at.predicate == fact.predicate) {
                let named = fact.arguments.get(at.mover).zip(fact.arguments.get(at.place));
                if let Some((mover, place)) = named.filter(|_| fact.truth == FactTruth::True) {
                    places.insert(mover.as_str(), place.as_str());
                }
            }
        }
        SharedParts { now, stops, places }
    }

    fn stops_of(&self, agent: &AgentId) -> Vec<Stop> {
        let place = self.places.get(agent.as_str());
        let concerns = |stop: &Stop| {
            stop.concerns(agent.as_str()) || place.is_some_and(|place| stop.concerns(place))
        };
        self.stops.iter().filter(|stop| concerns(stop)).map(|stop| (*stop).clone()).collect()
    }
}

/// Returns all agents of the ecosystem, sorted by name.
pub(super) fn rows(view: &LiveView, now: Moment) -> Vec<AgentRow> {
    let shared = SharedParts::of(view, now);
    let residents = view.agents.iter().filter(|(_, record)| !record.is_guest());
    residents.map(|(agent, record)| row(view, agent, record, &shared)).collect()
}

/// Returns the agents with rows that change with time alone, sorted by name: those that are not here,
/// and those that carry a step out, which may become late.
pub(super) fn moving_rows(view: &LiveView, now: Moment) -> Vec<AgentRow> {
    let shared = SharedParts::of(view, now);
    let is_moving = |(agent, record): &(&AgentId, &AgentRecord)| {
        let presence = record.presence(now);
        presence != AgentPresence::Present || view.goals.is_acting(agent)
    };
    let residents = view.agents.iter().filter(|(_, record)| !record.is_guest());
    let moving = residents.filter(is_moving);
    moving.map(|(agent, record)| row(view, agent, record, &shared)).collect()
}

fn row(view: &LiveView, agent: &AgentId, record: &AgentRecord, shared: &SharedParts) -> AgentRow {
    let now = shared.now;
    let running = view.goals.running_of(agent, view.goal_texts(now)).into_iter();
    let newest = running.max_by_key(|step| step.started_at);
    let presence = record.presence(now);
    let mut problems = presence_problem(record, presence, now);
    problems.extend(record.conflicts.iter().map(|conflict| format!("no plan uses it: {conflict}")));
    problems.extend(record.discovered.iter().filter_map(|found| found.problem.clone()));
    let overflowed = record.mailbox.as_ref().map_or(0, |mailbox| mailbox.overflowed);
    if overflowed > 0 {
        problems.push(format!("{} did not fit into its mailbox", plural(overflowed, "message")));
    }
    // Only agents that act can be stopped; a view that begins during a stop sees no action of them.
    let acts = !record.actions.is_empty() || view.stops.is_held_by(agent);
    let is_stopped = acts && !shared.stops_of(agent).is_empty();
    AgentRow {
        agent: agent.clone(),
        daemon: leading_daemon(view, agent, record),
        presence,
        since: record.since(),
        heartbeat_age_ms: record.beat.as_ref().map(|beat| now.since(beat.at)),
        actions: record.offered(),
        doing: newest.as_ref().map(|step| step.text.clone()),
        doing_since: newest.as_ref().map(|step| step.started_at),
        late_ms: newest.as_ref().and_then(|step| step.late_ms),
        waiting: record.mailbox.as_ref().map(|mailbox| mailbox.waiting),
        replicas: u64::try_from(record.replicas.len()).unwrap_or(u64::MAX),
        is_stopped,
        problems,
    }
}

fn presence_problem(record: &AgentRecord, presence: AgentPresence, now: Moment) -> Vec<String> {
    let age = |at: Option<Moment>| duration(at.map_or(0, |at| now.since(at)));
    match presence {
        AgentPresence::Silent => {
            let heard = record.beat.as_ref().map(|beat| beat.at);
            vec![format!("no heartbeat for {}", age(heard))]
        }
        AgentPresence::Gone if record.is_missed() => {
            vec![format!("gone for {}", age(record.gone_at))]
        }
        AgentPresence::Absent => vec!["the ecosystem file names it, and it is not here".to_owned()],
        _ => Vec::new(),
    }
}

/// Returns whether a replica leads; `None` if its daemon has not said so.
fn leads(view: &LiveView, agent: &AgentId, daemon: &acl::DaemonId) -> Option<bool> {
    let (_, report) = view.daemons.get(daemon)?.status.as_ref()?;
    if report.leads.contains(agent) {
        return Some(true);
    }
    report.stands_by.contains(agent).then_some(false)
}

fn leading_daemon(view: &LiveView, agent: &AgentId, record: &AgentRecord) -> Option<acl::DaemonId> {
    let mut replicas = record.replicas.keys();
    let leader = replicas.find(|daemon| leads(view, agent, daemon) == Some(true));
    leader.or(record.daemon()).cloned()
}

/// Returns one agent with everything that is known about it.
pub(super) fn detail(view: &LiveView, agent: &AgentId, now: Moment) -> Option<AgentDetail> {
    let record = view.agents.get(agent)?;
    let shared = SharedParts::of(view, now);
    let row = row(view, agent, record, &shared);
    let replicas = record.replicas.iter().map(|(daemon, replica)| ReplicaRow {
        daemon: daemon.clone(),
        incarnation: replica.incarnation,
        leads: leads(view, agent, daemon),
        since: replica.since,
    });
    let actions = record.actions.iter().map(|(name, action)| {
        let times = view.goals.times.of(agent.as_str(), name);
        ActionRow {
            action: name.clone(),
            parameters: action.parameters.clone(),
            is_offered: action.is_offered,
            runs: times.map_or(0, |times| times.runs),
            failures: times.map_or(0, |times| times.failures),
            usual_ms: times.and_then(|times| times.usual_ms()),
        }
    });
    Some(AgentDetail {
        stops: if row.is_stopped { shared.stops_of(agent) } else { Vec::new() },
        row,
        replicas: replicas.collect(),
        actions: actions.collect(),
        model: record.model.clone(),
        facts: view.facts.rows_of(agent.as_str(), now, &|owner| view.agents.is_away(owner, now)),
        mailbox: record.mailbox.clone(),
        running: view.goals.running_of(agent, view.goal_texts(now)),
        recent: recent(view, agent),
        discovered: record.discovered.clone(),
        heartbeat_period_ms: record.beat.as_ref().map(|beat| beat.period_ms),
    })
}

fn recent(view: &LiveView, agent: &AgentId) -> Vec<ActivityEntry> {
    let newest = view.activity().rev().filter(|entry| entry.agent.as_ref() == Some(agent));
    let mut recent: Vec<_> = newest.take(RECENT_MAX).cloned().collect();
    recent.reverse();
    recent
}
