//! One goal: its condition, its phase, and its history.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, SystemTime};

use acl::content::{
    Achieve, Execute, GoalStatus, HistoryEntry, Keep, Offers, Outcome, Partition, Reason, Report,
    Version,
};
use acl::{AgentId, ConversationId, Incarnation, ReplyToken};
use agent::{Participation, TimerId, WorkHandle};
use pddl::{Condition, PlanStep};
use tokio::time::Instant;

use crate::explanations::GoalContext;
use crate::planning_snapshot::{AvoidedAction, AvoidedActions, outside};
use crate::scheduling::{ExplanationTask, PlanningMode};

/// Maximum number of history entries per goal: enough to explain the goal's present phase.
const HISTORY_LINES_MAX: usize = 64;

/// How long a failed action is avoided after its first failure. The time doubles with every failure, up
/// to `AVOIDED_MAX`. A loose contact needs seconds, a repair minutes.
const AVOIDED_FIRST: Duration = Duration::from_secs(10);
const AVOIDED_MAX: Duration = Duration::from_secs(300);

/// Warm-up after a fail-over. During this time a missing agent does not count as gone: daemons that
/// boot together need this long to connect and to announce their models.
const WARM_UP: Duration = Duration::from_secs(10);

/// Number of failures after which a goal to be achieved stops using an action. The action is tried at
/// once, after ten seconds and after thirty; then the user is told.
const TRIES_MAX: u32 = 3;

/// Number of plans in a row that may fail before a goal to be achieved is given up. Every failure rules
/// out an action for a while, so this many failures mean that no other way is left.
pub(crate) const FAILURES_MAX: u32 = 12;

/// One goal.
pub(crate) struct Goal {
    pub(crate) engagement: Participation,
    /// Incarnation of the initiator that asked for this goal.
    pub(crate) initiator_incarnation: Incarnation,
    pub(crate) text: String,
    pub(crate) condition: Condition,
    pub(crate) keep: Keep,
    pub(crate) priority: i32,
    pub(crate) partition: Partition,
    pub(crate) phase: GoalPhase,
    /// Number of plans executed so far.
    pub(crate) rounds: u32,
    /// Number of plans in a row that have failed.
    pub(crate) failures: u32,
    /// The constraints of the next round of planning.
    pub(crate) planning_mode: PlanningMode,
    /// The plan that runs, or ran last, as the executor was asked for it, with the steps that are known
    /// to be done.
    pub(crate) plan: Option<Box<Execute>>,
    /// Version of the last record of this goal that was sent to the Journals.
    pub(crate) version: Version,
    /// When this replica took the goal over; `None` if it has had the goal from the start.
    pub(crate) adopted_at: Option<Instant>,
    /// Steps of the running plan that are not known to be done, under the names that their agents use.
    pub(crate) steps_left: Vec<PlanStep>,
    /// Steps of the failed plan that were not done; the planner may reuse them.
    pub(crate) failed_steps: Vec<PlanStep>,
    /// The reason for waiting that the user was last told.
    pub(crate) blocked_by: String,
    /// Set when this goal needs agents that other goals use: the agents in use then, and the time until
    /// which this is believed. While all these agents are still in use, planning again would find
    /// nothing new.
    pub(crate) blocked_by_agents: Option<(BTreeSet<AgentId>, Instant)>,
    /// Why there was no plan last time, as the user was told.
    pub(crate) no_plan_because: String,
    /// Whether agents have joined or left since planning for this goal began.
    pub(crate) is_request_stale: bool,
    /// Since when there is no plan, with no agent joining or leaving in between.
    pub(crate) no_plan_since: Option<Instant>,
    /// Since when bids use action models that the Domain Maintainer does not have yet.
    pub(crate) behind_since: Option<Instant>,
    /// Whether the user was told that the goal holds, since it last did not hold.
    pub(crate) holds_reported: bool,
    pub(crate) timer: Option<TimerId>,
    /// Facts and offers seen by the last round of planning.
    pub(crate) last_context: Option<GoalContext>,
    avoided: BTreeMap<(AgentId, String), ActionBackoff>,
    history: Vec<HistoryEntry>,
}

/// A failed action of an agent, which is avoided for a while.
struct ActionBackoff {
    until: Instant,
    span: Duration,
    times: u32,
    /// Whether the agent refused the action as [`Reason::Incapable`] although it offers it.
    is_refused: bool,
    /// Whether the agent no longer offers the action.
    is_withdrawn: bool,
    why: String,
}

/// The phase of a goal.
pub(crate) enum GoalPhase {
    /// Another goal is being planned for.
    Queued,
    /// The goal needs agents or facts that the plans of other goals use.
    WaitingForAgents(String),
    /// The goal waits for a capability, or for the state to change.
    WaitingForChange(String),
    /// The state and the domain are being fetched.
    FetchingDomain(
        #[expect(dead_code, reason = "ends the question when it is dropped")] WorkHandle,
    ),
    /// The central planner is asked.
    Planning(ReplyToken),
    /// Proposals are called for.
    CollectingProposals(Box<crate::contract_net::ContractNetState>),
    /// There is no plan; the reason is being computed.
    Explaining(#[expect(dead_code, reason = "ends the work when it is dropped")] ExplanationTask),
    /// A plan is being executed.
    Executing(ReplyToken),
    /// The executor was asked to cancel the plan, because the goal was cancelled.
    Cancelling(ReplyToken),
    /// The executor was asked to cancel the plan, because another goal or a better plan comes first.
    Preempted(ReplyToken),
    /// The plan was carried out; whether the goal holds is being checked.
    Verifying(Option<WorkHandle>),
    /// The goal holds and is watched.
    Holding,
}

impl GoalPhase {
    pub(crate) fn words(&self) -> String {
        match self {
            GoalPhase::Queued => "waiting: another goal comes first".to_owned(),
            GoalPhase::WaitingForAgents(why) => format!("waiting: it {why}"),
            GoalPhase::WaitingForChange(why) => format!("waiting: {why}"),
            GoalPhase::FetchingDomain(_) => "compiling domain and state".to_owned(),
            GoalPhase::Planning(_) => "planning".to_owned(),
            GoalPhase::CollectingProposals(_) => "calling for proposals".to_owned(),
            GoalPhase::Explaining(_) => "finding out why there is no plan".to_owned(),
            GoalPhase::Executing(_) => "executing".to_owned(),
            GoalPhase::Cancelling(_) => "cancelling".to_owned(),
            GoalPhase::Preempted(_) => "giving way".to_owned(),
            GoalPhase::Verifying(_) => "checking whether it holds".to_owned(),
            GoalPhase::Holding => "holds".to_owned(),
        }
    }

    /// Whether the goal is being planned for; other goals then wait for their turn.
    pub(crate) fn is_planning(&self) -> bool {
        matches!(
            self,
            GoalPhase::FetchingDomain(_)
                | GoalPhase::Planning(_)
                | GoalPhase::CollectingProposals(_)
                | GoalPhase::Explaining(_)
        )
    }

    /// Whether a plan of the goal uses agents at present.
    pub(crate) fn is_running(&self) -> bool {
        self.is_under_way() || matches!(self, GoalPhase::Preempted(_) | GoalPhase::Verifying(_))
    }

    /// Whether a replica that takes the goal over must also take over a running plan.
    pub(crate) fn is_under_way(&self) -> bool {
        matches!(self, GoalPhase::Executing(_) | GoalPhase::Cancelling(_))
    }
}

impl Goal {
    pub(crate) fn new(
        engagement: Participation,
        life: Incarnation,
        asked: Achieve,
        condition: Condition,
    ) -> Goal {
        let Achieve { goal, keep, priority, partition } = asked;
        Goal {
            engagement,
            initiator_incarnation: life,
            text: goal,
            condition,
            keep,
            priority,
            partition,
            phase: GoalPhase::Queued,
            rounds: 0,
            failures: 0,
            planning_mode: PlanningMode::default(),
            plan: None,
            version: Version::default(),
            adopted_at: None,
            steps_left: Vec::new(),
            failed_steps: Vec::new(),
            blocked_by: String::new(),
            blocked_by_agents: None,
            no_plan_because: String::new(),
            is_request_stale: false,
            no_plan_since: None,
            behind_since: None,
            holds_reported: false,
            timer: None,
            last_context: None,
            avoided: BTreeMap::new(),
            history: Vec::new(),
        }
    }

    pub(crate) fn conversation(&self) -> &ConversationId {
        &self.engagement.conversation
    }

    /// Returns the agents that act in the remaining steps of the plan.
    pub(crate) fn acting(&self) -> impl Iterator<Item = AgentId> + '_ {
        let actors = self.steps_left.iter().filter_map(|step| step.arguments.first());
        actors.filter_map(|actor| AgentId::new(actor.as_str()).ok())
    }

    /// Adopts a plan that another replica has carried out up to the steps `done`.
    pub(crate) fn adopt_plan(&mut self, plan: Execute, done: Vec<u32>) {
        let steps = pddl::parse_plan(&plan.plan).into_result().map(|plan| plan.steps);
        let is_left = |step: &usize| u32::try_from(*step).is_ok_and(|step| !done.contains(&step));
        let left = steps.unwrap_or_default().into_iter().enumerate();
        let left = left.filter(|(step, _)| is_left(step));
        self.steps_left = left.map(|(_, step)| outside(&step, &plan.offers)).collect();
        self.plan = Some(Box::new(Execute { done, ..plan }));
    }

    /// Returns the history, oldest entry first.
    pub(crate) fn history(&self) -> &[HistoryEntry] {
        &self.history
    }

    /// Restores the history from before the goal was taken over.
    pub(crate) fn recall_history(&mut self, history: Vec<HistoryEntry>) {
        self.history = history;
        self.history.truncate(HISTORY_LINES_MAX);
    }

    /// Marks a step of the running plan as done.
    pub(crate) fn step_done(&mut self, action: &str, step: Option<u32>) {
        if let (Some(plan), Some(step)) = (&mut self.plan, step)
            && !plan.done.contains(&step)
        {
            plan.done.push(step);
        }
        if let Some(index) = self.steps_left.iter().position(|step| step.to_string() == action) {
            self.steps_left.remove(index);
        }
    }

    /// Adds an entry to the history, at wall-clock time `at`. Drops the oldest entry if the history is
    /// full.
    pub(crate) fn add_history(
        &mut self,
        at: SystemTime,
        outcome: Option<Outcome>,
        text: impl Into<String>,
    ) {
        if self.history.len() == HISTORY_LINES_MAX {
            self.history.remove(0);
        }
        let at = at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let at_ms = u64::try_from(at.as_millis()).unwrap_or(u64::MAX);
        self.history.push(HistoryEntry { at_ms, outcome, text: text.into() });
    }

    /// Avoids a failed action for a while; the time doubles with each failure.
    pub(crate) fn penalize(
        &mut self,
        (agent, action): (AgentId, String),
        report: &Report,
        now: Instant,
    ) {
        let avoidance = self.avoided.entry((agent, action)).or_insert_with(|| ActionBackoff {
            until: now,
            span: AVOIDED_FIRST / 2,
            times: 0,
            is_refused: false,
            is_withdrawn: false,
            why: String::new(),
        });
        avoidance.span = (avoidance.span * 2).min(AVOIDED_MAX);
        avoidance.until = now + avoidance.span;
        avoidance.times += 1;
        avoidance.is_refused = report.declined == Some(Reason::Incapable);
        avoidance.why.clone_from(&report.detail);
    }

    /// Makes all actions of an agent available again, because the agent has announced itself anew.
    pub(crate) fn reset_backoffs(&mut self, agent: &AgentId) {
        self.avoided.retain(|(avoided, _), _| avoided != agent);
    }

    /// Compares the avoided actions with the present offers. An avoided action that is not offered now
    /// is marked as withdrawn: its agent knows of the fault. When the agent offers it again, it is no
    /// longer avoided.
    pub(crate) fn compare_with(&mut self, offers: &Offers) {
        self.avoided.retain(|(agent, action), avoidance| {
            let is_offered = offers.get(agent).is_some_and(|actions| actions.contains_key(action));
            let is_offered_again = avoidance.is_withdrawn && is_offered;
            avoidance.is_withdrawn = !is_offered;
            !is_offered_again
        });
    }

    pub(crate) fn avoided(&self, now: Instant) -> AvoidedActions {
        let held = |avoidance: &ActionBackoff| AvoidedAction {
            why: avoidance.why.clone(),
            is_for_good: self.is_done_with(avoidance),
            is_withdrawn: avoidance.is_withdrawn,
        };
        self.avoided
            .iter()
            .filter(|(_, avoidance)| {
                avoidance.until > now || avoidance.is_withdrawn || self.is_done_with(avoidance)
            })
            .map(|(key, avoidance)| (key.clone(), held(avoidance)))
            .collect()
    }

    /// Whether an action is not tried again until its agent offers it anew. Always `false` for a kept
    /// goal: it is tried any number of times, at growing intervals.
    fn is_done_with(&self, avoidance: &ActionBackoff) -> bool {
        self.keep == Keep::Achieve && (avoidance.is_refused || avoidance.times >= TRIES_MAX)
    }

    /// Returns the earliest time at which a failed action may be tried again; `None` if there is no
    /// such action.
    pub(crate) fn next_chance(&self, now: Instant) -> Option<Instant> {
        self.avoided
            .values()
            .filter(|avoidance| !avoidance.is_withdrawn && !self.is_done_with(avoidance))
            .map(|avoidance| avoidance.until)
            .filter(|until| *until > now)
            .min()
    }

    /// Whether the goal was taken over less than [`MEETING`] ago. The agents that could reach it may
    /// not be known yet: after a power cut all machines start at once, some of them slowly.
    pub(crate) fn in_warm_up(&self, now: Instant) -> bool {
        self.adopted_at.is_some_and(|taken_over| now < taken_over + WARM_UP)
    }

    /// Whether `asked` repeats this goal, because its initiator did not learn that it was received.
    pub(crate) fn is_asked_again(&self, by: &Participation, asked: &Achieve) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.engagement.initiator == by.initiator
    }

    /// Whether `asked` is this goal, requested again by a later incarnation of its initiator. Two
    /// requests of the same incarnation are two goals.
    pub(crate) fn is_asked_anew(&self, by: &AgentId, life: Incarnation, asked: &Achieve) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.engagement.initiator == *by && self.initiator_incarnation < life
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

#[cfg(test)]
mod tests {
    use acl::content::{Offer, Outcome};

    use super::*;

    fn goal(keep: Keep) -> Goal {
        let engagement = Participation {
            initiator: AgentId::new("ann").expect("a name"),
            life: None,
            exchange: ReplyToken::new("e"),
            conversation: ConversationId::new("c"),
            protocol: None,
        };
        let asked = Achieve::new("(lit hall)", keep, 0);
        let condition = pddl::parse_condition(&asked.goal).into_result().expect("a condition");
        Goal::new(engagement, Incarnation(1), asked, condition)
    }

    fn lamp() -> (AgentId, String) {
        (AgentId::new("lamp").expect("a name"), "light".to_owned())
    }

    fn failed(declined: Option<Reason>) -> Report {
        Report { declined, ..Report::new(Outcome::Failed, "it is dark") }
    }

    #[test]
    fn who_failed_is_tried_three_times_and_who_refused_once() {
        let now = Instant::now();
        let mut silent = goal(Keep::Achieve);
        for _ in 0..2 {
            silent.penalize(lamp(), &failed(None), now);
            assert!(silent.next_chance(now).is_some());
        }
        silent.penalize(lamp(), &failed(None), now);
        assert_eq!(silent.next_chance(now), None);
        let year = Duration::from_secs(365 * 24 * 3_600);
        assert!(silent.avoided(now + year).contains_key(&lamp()));
        let mut refused = goal(Keep::Achieve);
        refused.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        assert_eq!(refused.next_chance(now), None);
        let mut kept = goal(Keep::Maintain);
        kept.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        assert_eq!(kept.next_chance(now), Some(now + AVOIDED_FIRST));
    }

    #[test]
    fn who_withdraws_an_action_or_comes_anew_is_tried_again() {
        let now = Instant::now();
        let mut goal = goal(Keep::Achieve);
        goal.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        let (inside, guard) = ("light".to_owned(), "(offers-light lamp)".to_owned());
        let offer = Offer { inside, guard, method: None };
        let (agent, action) = lamp();
        let offers: Offers = [(agent.clone(), [(action, offer)].into())].into();
        goal.compare_with(&offers);
        assert_eq!(goal.next_chance(now), None, "it goes on offering what it refuses");
        goal.compare_with(&Offers::new());
        assert_eq!(goal.next_chance(now), None, "no agent offers it");
        assert_eq!(goal.avoided(now).len(), 1, "the reason is still known");
        goal.compare_with(&offers);
        assert!(goal.avoided(now).is_empty(), "it is offered again");
        goal.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        goal.reset_backoffs(&agent);
        assert!(goal.avoided(now).is_empty());
    }
}
