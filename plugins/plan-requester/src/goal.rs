//! One goal: what is wanted, where it stands, and what has happened.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Achieve, GoalStatus, Keep};
use acl::{AgentId, ConversationId, ReplyToken};
use agent::{Engagement, TimerId, Work};
use pddl::{Condition, PlanStep};
use tokio::time::Instant;

use crate::explaining::Seen;
use crate::known::Avoided;
use crate::sharing::{Attempt, Explaining};

/// Lines of history kept per goal: enough to see how it came to where it stands.
const HISTORY_LINES_MAX: usize = 64;

/// How long an action that failed is not asked for again, at first; doubled at every failure.
/// A loose contact needs seconds, a repair minutes.
const AVOIDED_FIRST: Duration = Duration::from_secs(10);
const AVOIDED_MAX: Duration = Duration::from_secs(300);

/// Plans in a row that may fail before a goal that is to be achieved is given up. Every failure
/// rules out an action for a while, so this many mean that nothing else is left to try.
pub(crate) const FAILURES_MAX: u32 = 12;

/// One goal.
pub(crate) struct Goal {
    pub(crate) engagement: Engagement,
    pub(crate) text: String,
    pub(crate) condition: Condition,
    pub(crate) keep: Keep,
    pub(crate) priority: i32,
    pub(crate) phase: Phase,
    /// Plans made so far.
    pub(crate) rounds: u32,
    /// Plans in a row that failed.
    pub(crate) failures: u32,
    /// What the next round of planning has to respect.
    pub(crate) attempt: Attempt,
    /// The steps of the running plan that are not known to be done, as their agents name them.
    pub(crate) steps_left: Vec<PlanStep>,
    /// What the user was told last of what it waits for.
    pub(crate) blocked_by: String,
    /// Whether the user was told that it holds, since it last did not.
    pub(crate) is_told: bool,
    pub(crate) timer: Option<TimerId>,
    /// What the last round of planning saw.
    pub(crate) seen: Option<Seen>,
    avoided: BTreeMap<(AgentId, String), Avoidance>,
    history: Vec<String>,
}

struct Avoidance {
    until: Instant,
    span: Duration,
}

/// Where a goal stands.
pub(crate) enum Phase {
    /// Another goal is being planned for.
    Queued,
    /// It needs what the plans of other goals are using.
    Blocked(String),
    /// It waits: for a capability, or for the state to change.
    Waiting(String),
    /// The state and the domain are asked for.
    Compiling(#[expect(dead_code, reason = "ends the question when it is dropped")] Work),
    /// The central planner is asked.
    Planning(ReplyToken),
    /// Proposals are called for.
    Calling(Box<crate::calling::Call>),
    /// There is no plan; why is being worked out.
    Explaining(#[expect(dead_code, reason = "ends the work when it is dropped")] Explaining),
    /// A plan is being executed.
    Executing(ReplyToken),
    /// The executor is asked to give up: the goal was cancelled.
    Cancelling(ReplyToken),
    /// The executor is asked to give up: another goal or another plan comes first.
    Yielding(ReplyToken),
    /// It holds, and is watched.
    Holding,
}

impl Phase {
    pub(crate) fn words(&self) -> String {
        match self {
            Phase::Queued => "waiting: another goal comes first".to_owned(),
            Phase::Blocked(why) => format!("waiting: it {why}"),
            Phase::Waiting(why) => format!("waiting: {why}"),
            Phase::Compiling(_) => "compiling domain and state".to_owned(),
            Phase::Planning(_) => "planning".to_owned(),
            Phase::Calling(_) => "calling for proposals".to_owned(),
            Phase::Explaining(_) => "looking why there is no plan".to_owned(),
            Phase::Executing(_) => "executing".to_owned(),
            Phase::Cancelling(_) => "cancelling".to_owned(),
            Phase::Yielding(_) => "giving way".to_owned(),
            Phase::Holding => "holds".to_owned(),
        }
    }

    /// Whether it is being planned for, so that other goals wait for their turn.
    pub(crate) fn is_planning(&self) -> bool {
        matches!(
            self,
            Phase::Compiling(_) | Phase::Planning(_) | Phase::Calling(_) | Phase::Explaining(_)
        )
    }

    /// Whether a plan of it runs, so that its agents are needed.
    pub(crate) fn is_running(&self) -> bool {
        matches!(self, Phase::Executing(_) | Phase::Cancelling(_) | Phase::Yielding(_))
    }
}

impl Goal {
    pub(crate) fn new(engagement: Engagement, asked: Achieve, condition: Condition) -> Goal {
        let Achieve { goal, keep, priority } = asked;
        Goal {
            engagement,
            text: goal,
            condition,
            keep,
            priority,
            phase: Phase::Queued,
            rounds: 0,
            failures: 0,
            attempt: Attempt::default(),
            steps_left: Vec::new(),
            blocked_by: String::new(),
            is_told: false,
            timer: None,
            seen: None,
            avoided: BTreeMap::new(),
            history: Vec::new(),
        }
    }

    pub(crate) fn conversation(&self) -> &ConversationId {
        &self.engagement.conversation
    }

    /// The agents that act in what is left of its plan.
    pub(crate) fn acting(&self) -> impl Iterator<Item = AgentId> + '_ {
        let actors = self.steps_left.iter().filter_map(|step| step.arguments.first());
        actors.filter_map(|actor| AgentId::new(actor.as_str()).ok())
    }

    /// A step of the running plan is done.
    pub(crate) fn step_done(&mut self, action: &str) {
        if let Some(index) = self.steps_left.iter().position(|step| step.to_string() == action) {
            self.steps_left.remove(index);
        }
    }

    pub(crate) fn note(&mut self, line: impl Into<String>) {
        if self.history.len() == HISTORY_LINES_MAX {
            self.history.remove(0);
        }
        self.history.push(line.into());
    }

    /// An action failed: it is not asked for again for a while, which doubles.
    pub(crate) fn avoid(&mut self, agent: AgentId, action: String, now: Instant) {
        let avoidance = self
            .avoided
            .entry((agent, action))
            .or_insert(Avoidance { until: now, span: AVOIDED_FIRST / 2 });
        avoidance.span = (avoidance.span * 2).min(AVOIDED_MAX);
        avoidance.until = now + avoidance.span;
    }

    /// An agent announced itself anew: what failed before may work now.
    pub(crate) fn forgive(&mut self, agent: &AgentId) {
        self.avoided.retain(|(avoided, _), _| avoided != agent);
    }

    pub(crate) fn avoided(&self, now: Instant) -> Avoided {
        let avoided = self.avoided.iter().filter(|(_, avoidance)| avoidance.until > now);
        avoided.map(|(key, _)| key.clone()).collect()
    }

    /// When an action that failed may be tried again.
    pub(crate) fn next_chance(&self, now: Instant) -> Option<Instant> {
        self.avoided.values().map(|avoidance| avoidance.until).filter(|until| *until > now).min()
    }

    pub(crate) fn status(&self) -> GoalStatus {
        GoalStatus {
            conversation: self.conversation().clone(),
            goal: self.text.clone(),
            keep: self.keep,
            priority: self.priority,
            phase: self.phase.words(),
            rounds: self.rounds,
            history: self.history.clone(),
        }
    }
}
