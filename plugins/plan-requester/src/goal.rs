//! One goal of the Plan Requester: its condition, its phase, and its history.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, SystemTime};

use acl::content::{
    Achieve, Execute, GoalStatus, HISTORY_ENTRIES_MAX, HistoryEntry, Keep, Offers, Outcome,
    Partition, Reason, Report, Version,
};
use acl::{AgentId, ConversationId, Incarnation, ReplyToken};
use agent::{Participation, TimerId, WorkHandle};
use pddl::{Condition, PlanStep};
use tokio::time::Instant;

use crate::explanations::GoalContext;
use crate::planning_snapshot::{AvoidedAction, AvoidedActions, outside};
use crate::scheduling::{ExplanationTask, PlanningMode};

/// How long a failed action is avoided after its first failure. The time doubles with every failure, up
/// to `AVOIDED_MAX`. A loose contact recovers within seconds, a repair takes minutes.
const AVOIDED_FIRST: Duration = Duration::from_secs(10);
const AVOIDED_MAX: Duration = Duration::from_secs(300);

/// Duration of the warm-up after a fail-over, in which a missing agent does not count as gone. Daemons
/// that boot together need this long to connect and to announce their models.
const WARM_UP: Duration = Duration::from_secs(10);

/// Number of failures of an action after which it is no longer used for a goal that is to be achieved
/// once. The action is tried at once, after ten seconds and after thirty; then the failure is reported
/// to the user.
const TRIES_MAX: u32 = 3;

/// Number of plans in a row that may fail before a goal that is to be achieved once is given up. Every
/// failure rules out an action for a while, so this many failures mean that no other way is left.
pub(crate) const FAILURES_MAX: u32 = 12;

/// A goal that the Plan Requester pursues.
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
    /// Number of plans for this goal executed so far.
    pub(crate) rounds: u32,
    /// Number of plans for this goal in a row that have failed.
    pub(crate) failures: u32,
    /// The constraints of the next round of planning for this goal.
    pub(crate) planning_mode: PlanningMode,
    /// The plan of this goal that runs or ran last, as it was requested from the Plan Executor, with
    /// the steps that are known to be done.
    pub(crate) plan: Option<Box<Execute>>,
    /// Version of the last record of this goal that was sent to the Journals.
    pub(crate) version: Version,
    /// Time at which this replica took the goal over; `None` if it has had the goal from the start.
    pub(crate) adopted_at: Option<Instant>,
    /// Steps of the running plan that are not known to be done, with the action names that their agents
    /// use.
    pub(crate) steps_left: Vec<PlanStep>,
    /// Steps of the failed plan that were not done; the planner may reuse them.
    pub(crate) failed_steps: Vec<PlanStep>,
    /// Reason why the goal waits, as the user was last told.
    pub(crate) blocked_by: String,
    /// The agents that other goals used when this goal was found to need some of them, and the time
    /// until which this finding counts. While all these agents are still in use, planning again would
    /// find nothing new.
    pub(crate) blocked_by_agents: Option<(BTreeSet<AgentId>, Instant)>,
    /// Reason why the last round of planning found no plan, as the user was told.
    pub(crate) no_plan_because: String,
    /// Whether agents have joined or left since planning for this goal began.
    pub(crate) is_request_stale: bool,
    /// Time since which there is no plan for the goal, with no agent joining or leaving in between.
    pub(crate) no_plan_since: Option<Instant>,
    /// Time since which bids use action models that the Domain Maintainer does not have yet.
    pub(crate) behind_since: Option<Instant>,
    /// Whether the user was told that the goal holds, since the goal last did not hold.
    pub(crate) holds_reported: bool,
    pub(crate) timer: Option<TimerId>,
    /// Facts and offered actions that concern the goal, as the last round of planning saw them.
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
    /// The goal waits in the queue while another goal is being planned for.
    Queued,
    /// The goal waits for agents or facts that the plans of other goals use.
    WaitingForAgents(String),
    /// The goal waits for a capability, or for a change of the known state.
    WaitingForChange(String),
    /// The state and the domain are being fetched, to plan for the goal.
    FetchingDomain(
        #[expect(dead_code, reason = "ends the question when it is dropped")] WorkHandle,
    ),
    /// The Planning Agent has been asked for a plan.
    Planning(ReplyToken),
    /// The actuators have been called for proposals.
    CollectingProposals(Box<crate::contract_net::ContractNetState>),
    /// There is no plan for the goal; the reason is being computed.
    Explaining(#[expect(dead_code, reason = "ends the work when it is dropped")] ExplanationTask),
    /// A plan for the goal is being executed.
    Executing(ReplyToken),
    /// The Plan Executor was asked to cancel the plan, because the goal was cancelled.
    Cancelling(ReplyToken),
    /// The Plan Executor was asked to cancel the plan, because another goal or a better plan comes
    /// first.
    Preempted(ReplyToken),
    /// The plan was carried out; the Plan Requester is checking whether the goal holds.
    Verifying(Option<WorkHandle>),
    /// The goal holds, and the known state is watched for changes.
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

    /// Whether agents are in use by a plan of the goal at present.
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

    /// Returns the agents that act in the plan's steps that are not known to be done.
    pub(crate) fn acting(&self) -> impl Iterator<Item = AgentId> + '_ {
        let actors = self.steps_left.iter().filter_map(|step| step.arguments.first());
        actors.filter_map(|actor| AgentId::new(actor.as_str()).ok())
    }

    /// Adopts `plan`, of which the steps `done` were carried out for another replica.
    pub(crate) fn adopt_plan(&mut self, plan: Execute, done: Vec<u32>) {
        let steps = pddl::parse_plan(&plan.plan).into_result().map(|plan| plan.steps);
        let is_left = |step: &usize| u32::try_from(*step).is_ok_and(|step| !done.contains(&step));
        let left = steps.unwrap_or_default().into_iter().enumerate();
        let left = left.filter(|(step, _)| is_left(step));
        self.steps_left = left.map(|(_, step)| outside(&step, &plan.offers)).collect();
        self.plan = Some(Box::new(Execute { done, ..plan }));
    }

    /// Returns the history of the goal, oldest entry first.
    pub(crate) fn history(&self) -> &[HistoryEntry] {
        &self.history
    }

    /// Restores the part of the goal's history from before this replica took the goal over.
    pub(crate) fn recall_history(&mut self, history: Vec<HistoryEntry>) {
        self.history = history;
        self.history.truncate(HISTORY_ENTRIES_MAX);
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

    /// Adds an entry to the history of the goal, at wall-clock time `at`. Drops the oldest entry if the
    /// history is full.
    pub(crate) fn add_history(
        &mut self,
        at: SystemTime,
        outcome: Option<Outcome>,
        text: impl Into<String>,
    ) {
        if self.history.len() == HISTORY_ENTRIES_MAX {
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

    /// Ends the avoiding of all actions of an agent, because the agent has announced itself anew.
    pub(crate) fn reset_backoffs(&mut self, agent: &AgentId) {
        self.avoided.retain(|(avoided, _), _| avoided != agent);
    }

    /// Compares the avoided actions with the present offers. An avoided action that is not offered now
    /// is marked as withdrawn, because its agent knows of the fault. When the agent offers the action
    /// again, it is no longer avoided.
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

    /// Whether an action is tried no more for this goal until its agent offers the action anew. Always
    /// `false` for a kept goal, for which an action is tried any number of times, at growing intervals.
    fn is_done_with(&self, avoidance: &ActionBackoff) -> bool {
        self.keep == Keep::Achieve && (avoidance.is_refused || avoidance.times >= TRIES_MAX)
    }

    /// Returns the earliest time at which a failed action may be tried again; `None` if no failed
    /// action may be tried again.
    pub(crate) fn next_chance(&self, now: Instant) -> Option<Instant> {
        self.avoided
            .values()
            .filter(|avoidance| !avoidance.is_withdrawn && !self.is_done_with(avoidance))
            .map(|avoidance| avoidance.until)
            .filter(|until| *until > now)
            .min()
    }

    /// Whether the goal was taken over less than [`WARM_UP`] ago. The agents that could reach the goal
    /// may not be known yet: after a power cut all machines start at once, some of them slowly.
    pub(crate) fn in_warm_up(&self, now: Instant) -> bool {
        self.adopted_at.is_some_and(|taken_over| now < taken_over + WARM_UP)
    }

    /// Whether the request `asked` repeats the request of this goal. An initiator repeats a request if
    /// it did not learn that the goal was received.
    pub(crate) fn is_asked_again(&self, by: &Participation, asked: &Achieve) -> bool {
        let is_same = self.text == asked.goal && self.keep == asked.keep;
        is_same && self.engagement.initiator == by.initiator
    }

    /// Whether `asked` requests the same as this goal, but comes from a later incarnation of the
    /// initiator. Two requests of one incarnation are two goals.
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
