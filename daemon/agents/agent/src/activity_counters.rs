//! Counters of what the agents of a daemon do: messages, goals, rounds of planning, steps, restarts.
//!
//! Every counter has a fixed number of values: kinds and outcomes, never names. So they take the
//! same memory, and the same time to read, with one agent and with ten thousand.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use acl::Performative;
use acl::content::{GoalPhase, Mode, Outcome};
use tokio::time::Instant;

use crate::duration_histogram::{DurationCounts, DurationHistogram};

/// Bounds of the durations of planning: from a plan for one robot to the default deadline, and
/// beyond it.
const PLANNING_BOUNDS: &[Duration] = &[
    Duration::from_millis(1),
    Duration::from_millis(5),
    Duration::from_millis(10),
    Duration::from_millis(25),
    Duration::from_millis(50),
    Duration::from_millis(100),
    Duration::from_millis(250),
    Duration::from_millis(500),
    Duration::from_secs(1),
    Duration::from_millis(2_500),
    Duration::from_secs(5),
    Duration::from_secs(10),
    Duration::from_secs(30),
];

/// Bounds of the times between two heartbeats of one agent. By default they come once a second, and
/// an agent is gone after three and a half.
const HEARTBEAT_BOUNDS: &[Duration] = &[
    Duration::from_millis(500),
    Duration::from_millis(1_100),
    Duration::from_millis(1_500),
    Duration::from_millis(2_500),
    Duration::from_millis(3_500),
    Duration::from_secs(5),
    Duration::from_secs(10),
    Duration::from_secs(30),
];

const PERFORMATIVES: usize = Performative::ALL.len();
const PHASES: usize = GoalPhase::ALL.len();

/// Result of one round of planning for a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanningResult {
    /// A plan was found.
    Found,
    /// There is no plan now.
    Missing,
    /// The round ended without an answer: planning failed, or was not needed any more.
    Abandoned,
}

/// Outcome of one step of a plan, as its Plan Executor knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepOutcome {
    /// The actuator has confirmed the action.
    Done,
    /// The actuator has reported a failure.
    Failed,
    /// The action was cancelled.
    Cancelled,
    /// The actuator has refused the request.
    Refused,
    /// No answer of the actuator came.
    Lost,
}

/// Counters of what the agents of a daemon have done since the daemon started.
#[derive(Debug)]
pub struct ActivityCounters {
    sent: [AtomicU64; PERFORMATIVES],
    received: [AtomicU64; PERFORMATIVES],
    /// Number of goals in each phase now.
    phases: [AtomicU64; PHASES],
    goals: [AtomicU64; Outcome::FINAL.len()],
    planning: [PlanningCounters; Mode::ALL.len()],
    steps: [AtomicU64; StepOutcome::ALL.len()],
    heartbeat_gaps: DurationHistogram,
    agent_restarts: AtomicU64,
    plugin_restarts: AtomicU64,
}

/// Counters of the rounds of planning in one planning mode.
#[derive(Debug)]
struct PlanningCounters {
    rounds: [AtomicU64; PlanningResult::ALL.len()],
    durations: DurationHistogram,
}

/// The counts of [`ActivityCounters`] at one moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ActivityCounts {
    /// Number of messages that the agents of the daemon have sent, by performative.
    pub sent: Vec<(Performative, u64)>,
    /// Number of messages that have arrived at the daemon, by performative.
    pub received: Vec<(Performative, u64)>,
    /// Number of goals of this daemon's Plan Requester in each phase now, without ended goals.
    pub phases: Vec<(GoalPhase, u64)>,
    /// Number of goals that have ended, by outcome.
    pub goals: Vec<(Outcome, u64)>,
    /// Number of rounds of planning, by planning mode and result.
    pub planning_rounds: Vec<(Mode, PlanningResult, u64)>,
    /// Durations of the rounds of planning, by planning mode.
    pub planning: Vec<(Mode, DurationCounts)>,
    /// Number of steps that have ended, by outcome.
    pub steps: Vec<(StepOutcome, u64)>,
    /// Times between two heartbeats of one agent, of all agents together.
    pub heartbeat_gaps: DurationCounts,
    /// Number of times that an agent of the daemon was started again after a failure.
    pub agent_restarts: u64,
    /// Number of times that the process of a plugin was started again after a failure.
    pub plugin_restarts: u64,
}

/// A goal that counts in the phase that it has now, until this value is dropped.
#[derive(Debug)]
pub struct TrackedGoal {
    counters: Arc<ActivityCounters>,
    phase: GoalPhase,
    since: Instant,
}

impl PlanningResult {
    /// All results.
    pub const ALL: [PlanningResult; 3] =
        [PlanningResult::Found, PlanningResult::Missing, PlanningResult::Abandoned];

    /// Returns the name of the result, for programs that count.
    pub fn as_str(self) -> &'static str {
        match self {
            PlanningResult::Found => "found",
            PlanningResult::Missing => "missing",
            PlanningResult::Abandoned => "abandoned",
        }
    }
}

impl StepOutcome {
    /// All outcomes.
    pub const ALL: [StepOutcome; 5] = [
        StepOutcome::Done,
        StepOutcome::Failed,
        StepOutcome::Cancelled,
        StepOutcome::Refused,
        StepOutcome::Lost,
    ];

    /// Returns the name of the outcome, for programs that count.
    pub fn as_str(self) -> &'static str {
        match self {
            StepOutcome::Done => "done",
            StepOutcome::Failed => "failed",
            StepOutcome::Cancelled => "cancelled",
            StepOutcome::Refused => "refused",
            StepOutcome::Lost => "lost",
        }
    }

    /// Returns the outcome of a step that a report ends; `None` if the step goes on.
    pub fn of(outcome: Outcome) -> Option<StepOutcome> {
        match outcome {
            Outcome::Done => Some(StepOutcome::Done),
            Outcome::Failed => Some(StepOutcome::Failed),
            Outcome::Cancelled => Some(StepOutcome::Cancelled),
            Outcome::Progress | Outcome::Holds => None,
        }
    }
}

impl Default for ActivityCounters {
    fn default() -> ActivityCounters {
        ActivityCounters {
            sent: Default::default(),
            received: Default::default(),
            phases: Default::default(),
            goals: Default::default(),
            planning: Default::default(),
            steps: Default::default(),
            heartbeat_gaps: DurationHistogram::new(HEARTBEAT_BOUNDS),
            agent_restarts: AtomicU64::new(0),
            plugin_restarts: AtomicU64::new(0),
        }
    }
}

impl Default for PlanningCounters {
    fn default() -> PlanningCounters {
        let durations = DurationHistogram::new(PLANNING_BOUNDS);
        PlanningCounters { rounds: Default::default(), durations }
    }
}

impl ActivityCounters {
    /// Counts a message that an agent of this daemon sends.
    pub(crate) fn count_sent(&self, performative: Performative) {
        add(&self.sent, &Performative::ALL, performative);
    }

    /// Counts heartbeats that have arrived at this daemon in one message.
    pub(crate) fn count_received_heartbeats(&self, count: usize) {
        add_many(&self.received, &Performative::ALL, Performative::Inform, count as u64);
    }

    /// Counts a message that has arrived at this daemon.
    pub(crate) fn count_received(&self, performative: Performative) {
        add(&self.received, &Performative::ALL, performative);
    }

    /// Counts the time between two heartbeats of one agent.
    pub(crate) fn count_heartbeat_gap(&self, gap: Duration) {
        self.heartbeat_gaps.count(gap);
    }

    /// Begins to count a goal, in its first phase.
    pub fn track_goal(self: Arc<Self>, phase: GoalPhase) -> TrackedGoal {
        add(&self.phases, &GoalPhase::ALL, phase);
        TrackedGoal { counters: self, phase, since: Instant::now() }
    }

    /// Counts a goal that has ended.
    pub fn count_goal(&self, outcome: Outcome) {
        add(&self.goals, &Outcome::FINAL, outcome);
    }

    /// Counts a step that has ended.
    pub fn count_step(&self, outcome: StepOutcome) {
        add(&self.steps, &StepOutcome::ALL, outcome);
    }

    /// Counts that an agent of the daemon is started again after a failure.
    pub fn count_agent_restart(&self) {
        self.agent_restarts.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts that the process of a plugin is started again after a failure.
    pub fn count_plugin_restart(&self) {
        self.plugin_restarts.fetch_add(1, Ordering::Relaxed);
    }

    fn count_planning(&self, mode: Mode, result: PlanningResult, duration: Duration) {
        let counters = Mode::ALL.iter().zip(&self.planning).find(|(each, _)| **each == mode);
        if let Some((_, counters)) = counters {
            add(&counters.rounds, &PlanningResult::ALL, result);
            counters.durations.count(duration);
        }
    }

    /// Returns the present counts.
    pub fn counts(&self) -> ActivityCounts {
        let planning = || Mode::ALL.into_iter().zip(&self.planning);
        let rounds = planning().flat_map(|(mode, counters)| {
            let results = counted(&PlanningResult::ALL, &counters.rounds);
            results.into_iter().map(move |(result, count)| (mode, result, count))
        });
        let is_open = |(phase, _): &(GoalPhase, u64)| *phase != GoalPhase::Ended;
        let phases = counted(&GoalPhase::ALL, &self.phases).into_iter().filter(is_open);
        ActivityCounts {
            sent: counted(&Performative::ALL, &self.sent),
            received: counted(&Performative::ALL, &self.received),
            phases: phases.collect(),
            goals: counted(&Outcome::FINAL, &self.goals),
            planning_rounds: rounds.collect(),
            planning: planning().map(|(mode, each)| (mode, each.durations.counts())).collect(),
            steps: counted(&StepOutcome::ALL, &self.steps),
            heartbeat_gaps: self.heartbeat_gaps.counts(),
            agent_restarts: self.agent_restarts.load(Ordering::Relaxed),
            plugin_restarts: self.plugin_restarts.load(Ordering::Relaxed),
        }
    }
}

impl TrackedGoal {
    /// Counts the goal in another phase. If this ends a round of planning, counts the round, with
    /// its `result`.
    pub fn move_to(&mut self, phase: GoalPhase, result: PlanningResult) {
        if phase == self.phase {
            return;
        }
        let mode = match self.phase {
            GoalPhase::Planning => Some(Mode::Centralized),
            GoalPhase::CollectingProposals => Some(Mode::Decentralized),
            _ => None,
        };
        if let Some(mode) = mode {
            self.counters.count_planning(mode, result, self.since.elapsed());
        }
        // The new phase comes first, so that a reader never counts one goal less.
        add(&self.counters.phases, &GoalPhase::ALL, phase);
        subtract(&self.counters.phases, self.phase);
        (self.phase, self.since) = (phase, Instant::now());
    }
}

impl Drop for TrackedGoal {
    fn drop(&mut self) {
        subtract(&self.counters.phases, self.phase);
    }
}

fn add<K: PartialEq, const N: usize>(counters: &[AtomicU64; N], keys: &[K; N], key: K) {
    add_many(counters, keys, key, 1);
}

fn add_many<K: PartialEq, const N: usize>(
    counters: &[AtomicU64; N],
    keys: &[K; N],
    key: K,
    count: u64,
) {
    if let Some((_, counter)) = keys.iter().zip(counters).find(|(each, _)| **each == key) {
        counter.fetch_add(count, Ordering::Relaxed);
    }
}

fn subtract(counters: &[AtomicU64; PHASES], phase: GoalPhase) {
    let counter = GoalPhase::ALL.iter().zip(counters).find(|(each, _)| **each == phase);
    if let Some((_, counter)) = counter {
        counter.fetch_sub(1, Ordering::Relaxed);
    }
}

fn counted<K: Copy, const N: usize>(keys: &[K; N], counters: &[AtomicU64; N]) -> Vec<(K, u64)> {
    let counts = counters.iter().map(|counter| counter.load(Ordering::Relaxed));
    keys.iter().copied().zip(counts).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count_of<K: PartialEq>(counts: &[(K, u64)], key: &K) -> u64 {
        counts.iter().find(|(each, _)| each == key).expect("all are counted").1
    }

    #[tokio::test(start_paused = true)]
    async fn a_goal_counts_in_its_phase_until_it_is_gone() {
        let counters = Arc::<ActivityCounters>::default();
        let in_phase = |phase| count_of(&counters.counts().phases, &phase);
        let mut goal = Arc::clone(&counters).track_goal(GoalPhase::Queued);
        assert_eq!(in_phase(GoalPhase::Queued), 1);
        goal.move_to(GoalPhase::CollectingProposals, PlanningResult::Abandoned);
        assert_eq!([GoalPhase::Queued, GoalPhase::CollectingProposals].map(in_phase), [0, 1]);
        tokio::time::advance(Duration::from_millis(20)).await;
        goal.move_to(GoalPhase::CollectingProposals, PlanningResult::Found);
        goal.move_to(GoalPhase::Executing, PlanningResult::Found);
        drop(goal);
        let counts = counters.counts();
        assert!(counts.phases.iter().all(|(_, count)| *count == 0));
        let rounds = counts.planning_rounds.iter().filter(|(.., count)| *count > 0);
        let expected = (Mode::Decentralized, PlanningResult::Found, 1);
        assert_eq!(rounds.copied().collect::<Vec<_>>(), [expected]);
        let (_, durations) = counts
            .planning
            .iter()
            .find(|(mode, _)| *mode == expected.0)
            .expect("both modes are counted");
        assert_eq!((durations.count, durations.sum), (1, Duration::from_millis(20)));
    }

    #[test]
    fn each_event_is_counted_under_its_kind() {
        let counters = ActivityCounters::default();
        counters.count_sent(Performative::NotUnderstood);
        counters.count_received(Performative::Agree);
        counters.count_goal(Outcome::Failed);
        counters.count_goal(Outcome::Progress);
        counters.count_step(StepOutcome::Lost);
        counters.count_heartbeat_gap(Duration::from_secs(60));
        counters.count_agent_restart();
        counters.count_plugin_restart();
        let counts = counters.counts();
        assert_eq!(count_of(&counts.sent, &Performative::NotUnderstood), 1);
        assert_eq!(count_of(&counts.received, &Performative::Agree), 1);
        assert_eq!(counts.sent.iter().map(|(_, count)| count).sum::<u64>(), 1);
        assert_eq!(counts.goals.iter().map(|(_, count)| count).sum::<u64>(), 1, "one has ended");
        assert_eq!(count_of(&counts.goals, &Outcome::Failed), 1);
        assert_eq!(count_of(&counts.steps, &StepOutcome::Lost), 1);
        assert_eq!(counts.heartbeat_gaps.count, 1);
        assert_eq!((counts.agent_restarts, counts.plugin_restarts), (1, 1));
    }
}
