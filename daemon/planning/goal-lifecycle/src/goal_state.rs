//! The state of one goal, and how events change it.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::AgentId;
use acl::content::{GoalPhase, Keep, Outcome, Reason, Report};

use crate::action_backoff::ActionBackoffs;
use crate::event::{
    Attempt, Blockers, ExecutionEnd, GoalCommand, GoalEvent, GoalVerdict, MissingPlan,
    PlanDecision, PlanningFlow, PlanningMode, Turn,
};
use crate::transitions::is_lawful;

/// Delay between a change of the world and the next check of the goals. One change causes several
/// messages, and one check covers all of them.
pub const SETTLE_DELAY: Duration = Duration::from_millis(20);

/// Interval at which waiting and holding goals are checked even if no message reports a change,
/// because a broadcast may be lost.
pub const RECHECK_INTERVAL: Duration = Duration::from_secs(10);

/// Number of plans in a row that may fail before a goal that is to be achieved once is given up.
/// Most failures exclude an action from planning for a while, so after this many failures no other
/// way is left. A plan that was not carried out because an agent is busy or absent is no failure: see
/// `GoalState::postpone`.
pub const FAILURES_MAX: u32 = 12;

/// Delay before planning again when no plan was found. Within this delay the latest messages of all
/// agents arrive here, even on a busy machine.
const ANNOUNCEMENT_DELAY: Duration = Duration::from_millis(100);

/// Delay before an unanswered query to an agent, such as the Domain Maintainer, is repeated.
const ASK_AGAIN: Duration = Duration::from_millis(500);

/// Length of the warm-up, which begins when this replica takes a goal over. During the warm-up a
/// missing agent does not count as gone. After a power cut all machines start at once, and this
/// replica takes over the goals of its earlier incarnation. The daemons then need this long to
/// connect and to announce the action models of their agents.
const WARM_UP: Duration = Duration::from_secs(10);

/// How long a goal is not planned for again because other goals use the agents that it needs. After
/// this time planning is tried again, because the state may have changed.
const STILL_BLOCKED: Duration = Duration::from_secs(5);

/// Maximum number of blocking goals that a message to the initiator lists by name; further ones are
/// only counted.
const BLOCKERS_TOLD: usize = 3;

/// Number of checks of the goal after which its executed plan counts as ineffective. The last
/// heartbeat of an agent may arrive after the first check.
const LOOKS_MAX: u32 = 3;

/// Number of failed plans in a row before replanning backs off, so that a permanent fault does not
/// load the machine. Up to this number, planning is repeated at once.
const IMMEDIATE_RETRIES: u32 = 3;

const NO_MAINTAINER: &str = "no Domain Maintainer answers";
const CANCELLED: &str = "cancelled as asked";
const CANCELLED_LATE: &str = "cancelled as asked; every step was done before the cancel came";
const DONE_BEFORE: &str = "it was done before the cancel came";

/// Settings that affect the state machine of a goal.
#[derive(Clone, Copy, Debug)]
pub struct Policy {
    /// Whether a new plan is made when a plan fails.
    pub is_replanning: bool,
    /// How long an agent may be absent before the other agents act on its absence.
    pub grace: Duration,
}

/// The state of a goal.
#[derive(Clone, Debug)]
pub struct GoalState {
    keep: Keep,
    phase: GoalPhase,
    attempt: Attempt,
    /// Reason why the goal waits; empty in every phase without waiting.
    waits_because: String,
    rounds: u32,
    /// Number of plans in a row that have failed.
    failures: u32,
    /// Number of times in a row that a plan was not made or not carried out, because an agent is busy
    /// or absent.
    hindrances: u32,
    /// Whether the goal waits because of such a hindrance, which a change of the state does not end.
    is_postponed: bool,
    /// Whether the goal was cancelled while its plan was being carried out.
    is_cancelled: bool,
    planning_mode: PlanningMode,
    /// Time at which this replica took the goal over from the records in the Journals; `None` if it
    /// has had the goal from the start.
    adopted_at: Option<Duration>,
    /// The blockers that the last report to the initiator named, as text.
    blocked_by: String,
    /// The agents that blocked this goal at the last check because different goals used them, and
    /// the time until which this result is valid. Planning again is useless while all these agents
    /// are still in use.
    blocked_by_agents: Option<(BTreeSet<AgentId>, Duration)>,
    /// Reason why the last round of planning found no plan, as reported to the initiator.
    no_plan_because: String,
    /// Time since which there is no plan for the goal, with no agent joining or leaving in between.
    no_plan_since: Option<Duration>,
    /// Time since which bids use action models that the Domain Maintainer does not have yet.
    outdated_since: Option<Duration>,
    /// Whether agents have joined or left since planning for this goal began.
    is_request_stale: bool,
    /// Whether the initiator has received a report that the goal holds, since the goal last did not
    /// hold.
    is_holding_reported: bool,
    /// Number of checks of the goal since its plan was carried out.
    looks: u32,
    backoffs: ActionBackoffs,
}

/// Returns the report to the initiator that a kept goal holds.
pub fn holding() -> Report {
    Report::new(Outcome::Holds, "the goal holds; it is watched")
}

fn progress(detail: impl Into<String>) -> GoalCommand {
    GoalCommand::Report(Report::new(Outcome::Progress, detail))
}

/// Returns the delay before planning again after this number of plans in a row that came to nothing.
fn backoff(times: u32) -> Duration {
    Duration::from_millis(100 << times.min(6))
}

/// Whether a plan has failed only because the agent of a step has other work: it can do the same
/// action later.
fn is_only_busy(report: &Report) -> bool {
    matches!(report.declined, Some(Reason::Busy | Reason::MailboxFull))
}

impl GoalState {
    /// Returns the state of a goal that was just accepted.
    pub fn new(keep: Keep) -> GoalState {
        GoalState {
            keep,
            phase: GoalPhase::Queued,
            attempt: Attempt::default(),
            waits_because: String::new(),
            rounds: 0,
            failures: 0,
            hindrances: 0,
            is_postponed: false,
            is_cancelled: false,
            planning_mode: PlanningMode::default(),
            adopted_at: None,
            blocked_by: String::new(),
            blocked_by_agents: None,
            no_plan_because: String::new(),
            no_plan_since: None,
            outdated_since: None,
            is_request_stale: false,
            is_holding_reported: false,
            looks: 0,
            backoffs: ActionBackoffs::new(keep),
        }
    }

    /// Returns the state of a goal that this replica takes over, and the commands that resume it.
    /// `rounds` is the number of plans that earlier replicas executed. `failures` is the number of
    /// these plans that failed in a row, up to the last one. `is_running` tells whether a plan of
    /// the goal runs now.
    pub fn resumed(
        keep: Keep,
        (rounds, failures): (u32, u32),
        is_running: bool,
        now: Duration,
    ) -> (GoalState, Vec<GoalCommand>) {
        let mut state =
            GoalState { rounds, failures, adopted_at: Some(now), ..GoalState::new(keep) };
        if !is_running {
            return (state, vec![progress("the goal was taken over"), GoalCommand::Consider]);
        }
        state.phase = GoalPhase::Executing;
        let requested = GoalCommand::RequestExecution(state.next_attempt());
        (state, vec![requested, progress("the goal was taken over; its plan goes on")])
    }

    /// Returns the current phase of the goal.
    pub fn phase(&self) -> GoalPhase {
        self.phase
    }

    /// Returns the reason why the goal waits, as text that completes “waiting: ”; empty if the goal
    /// does not wait.
    pub fn waits_because(&self) -> &str {
        &self.waits_because
    }

    /// Returns the number of the work that this state began last. Events of earlier work have a
    /// smaller number.
    pub fn attempt(&self) -> Attempt {
        self.attempt
    }

    /// Returns the number of plans that were executed for this goal so far.
    pub fn rounds(&self) -> u32 {
        self.rounds
    }

    /// Returns the number of plans in a row that have failed.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// Whether the goal was cancelled, and what became of its plan is not known yet.
    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled && self.phase != GoalPhase::Ended
    }

    /// Returns which other plans and goals the next round of planning must respect.
    pub fn planning_mode(&self) -> PlanningMode {
        self.planning_mode
    }

    /// Returns the back-off of the actions that failed in earlier plans.
    pub fn backoffs(&self) -> &ActionBackoffs {
        &self.backoffs
    }

    /// Returns the back-off of the failed actions, to be changed: for example, to compare it with
    /// the present offers.
    pub fn backoffs_mut(&mut self) -> &mut ActionBackoffs {
        &mut self.backoffs
    }

    /// Records that every bid uses an action model that the Domain Maintainer has.
    pub fn note_bids_current(&mut self) {
        self.outdated_since = None;
    }

    /// Changes the state by an event that happened at the time `now`. Returns the commands that the
    /// owner must carry out, in this order. Two kinds of events change nothing: those of earlier
    /// work, and those without a transition in the table.
    pub fn handle(&mut self, event: GoalEvent, now: Duration, policy: Policy) -> Vec<GoalCommand> {
        let (kind, from) = (event.kind(), self.phase);
        let is_of_earlier_work = event.attempt().is_some_and(|attempt| attempt != self.attempt);
        if is_of_earlier_work || !crate::transitions::is_expected(kind, from) {
            return Vec::new();
        }
        let commands = self.react(event, now, policy);
        debug_assert!(is_lawful(kind, from, self.phase), "{kind:?}: {from:?} to {:?}", self.phase);
        commands
    }

    fn react(&mut self, event: GoalEvent, now: Duration, policy: Policy) -> Vec<GoalCommand> {
        match event {
            GoalEvent::Considered(turn) => self.considered(turn, now),
            GoalEvent::DomainMissing(_) => self.wait(NO_MAINTAINER.to_owned(), ASK_AGAIN),
            GoalEvent::DomainUnusable(_, why) => self.end(Outcome::Failed, why),
            GoalEvent::GoalInvalid(_, why) if self.in_warm_up(now) => self.wait(why, ASK_AGAIN),
            GoalEvent::GoalInvalid(_, why) => self.end(Outcome::Failed, why),
            GoalEvent::GoalHolds(_) => self.satisfied(),
            GoalEvent::GoalLost(..) | GoalEvent::AgentsBusy(..) | GoalEvent::GoalOpen(..) => {
                self.unsatisfied(event, now, policy)
            }
            GoalEvent::PlannerFailed(_, why, wait) => self.retry(why, wait, policy),
            GoalEvent::PlannerBusy(_, why, wait) => self.postpone(why, wait, policy),
            GoalEvent::MembersBusy(_, why, share) => {
                let wait = backoff(self.hindrances.saturating_add(1));
                let longer = wait * u32::from(share) / 256;
                self.postpone(why, wait + longer, policy)
            }
            GoalEvent::BidsOutdated(_, why) => self.bids_outdated(why, now, policy),
            GoalEvent::PlanFound(_, decision) => self.plan_found(decision, now, policy),
            GoalEvent::PlanMissing(_) => {
                self.enter(GoalPhase::Explaining);
                vec![GoalCommand::Explain(self.next_attempt())]
            }
            GoalEvent::Explained(_, missing) => self.explained(missing, now, policy),
            GoalEvent::ExecutorRestarted(_) => {
                vec![GoalCommand::RequestExecution(self.next_attempt())]
            }
            GoalEvent::OtherPlanRuns(_, round) => self.other_plan_runs(round),
            GoalEvent::ExecutionEnded(_, end) => self.execution_ended(end, now, policy),
            GoalEvent::Verified(_, verdict) => self.verified(verdict, policy),
            GoalEvent::Cancelled => self.cancelled(),
            GoalEvent::Yielded(why) => {
                self.enter(GoalPhase::Preempted);
                vec![GoalCommand::CancelExecution, progress(why)]
            }
            GoalEvent::AgentsReleased => {
                self.enter(GoalPhase::Queued);
                Vec::new()
            }
            GoalEvent::WorldChanged { joined, have_agents_changed, is_planning_busy } => {
                self.world_changed(&joined, have_agents_changed, is_planning_busy)
            }
            GoalEvent::EndedElsewhere => {
                let is_executing = self.phase == GoalPhase::Executing;
                self.enter(GoalPhase::Ended);
                vec![if is_executing { GoalCommand::CancelExecution } else { GoalCommand::Abandon }]
            }
            GoalEvent::TakenOver => {
                self.enter(GoalPhase::Ended);
                vec![GoalCommand::Abandon]
            }
        }
    }

    /// Enters a phase and clears the reason for waiting. A caller that enters a waiting phase sets
    /// the reason afterwards.
    fn enter(&mut self, phase: GoalPhase) {
        self.phase = phase;
        self.waits_because.clear();
        self.is_postponed = false;
    }

    fn next_attempt(&mut self) -> Attempt {
        self.attempt = Attempt(self.attempt.0 + 1);
        self.attempt
    }

    /// Whether the goal was taken over less than [`WARM_UP`] ago. The agents that could reach the
    /// goal may not be known yet.
    fn in_warm_up(&self, now: Duration) -> bool {
        self.adopted_at.is_some_and(|adopted| now < adopted.saturating_add(WARM_UP))
    }

    // === a round of planning ===

    fn considered(&mut self, turn: Turn, now: Duration) -> Vec<GoalCommand> {
        if let Some(why) = turn.missing_quorum {
            let is_told = self.phase == GoalPhase::WaitingForChange && self.waits_because == why;
            self.enter(GoalPhase::WaitingForChange);
            self.waits_because.clone_from(&why);
            let told = (!is_told).then(|| progress(format!("waiting: {why}")));
            // Other goals may not need the quorum.
            return told.into_iter().chain([GoalCommand::ScheduleNext]).collect();
        }
        if turn.is_planning_busy {
            self.enter(GoalPhase::Queued);
            return Vec::new();
        }
        let is_still_blocked = self.blocked_by_agents.as_ref().is_some_and(|(agents, until)| {
            now < *until && !agents.is_empty() && agents.is_subset(&turn.agents_in_use)
        });
        if is_still_blocked {
            self.enter(GoalPhase::WaitingForAgents);
            self.waits_because = format!("it {}", self.blocked_by);
            return vec![GoalCommand::ScheduleNext];
        }
        self.enter(GoalPhase::FetchingDomain);
        self.is_request_stale = false;
        vec![GoalCommand::StopTimer, GoalCommand::FetchDomain(self.next_attempt())]
    }

    fn satisfied(&mut self) -> Vec<GoalCommand> {
        (self.failures, self.hindrances) = (0, 0);
        self.planning_mode = PlanningMode::default();
        if self.keep == Keep::Achieve {
            let detail = if self.rounds == 0 { "it holds already" } else { "the goal holds" };
            return self.end(Outcome::Done, detail);
        }
        self.enter(GoalPhase::Holding);
        self.no_plan_because.clear();
        let is_told = std::mem::replace(&mut self.is_holding_reported, true);
        let told = (!is_told).then(|| GoalCommand::Report(holding()));
        let rest = [
            GoalCommand::ForgetPlan,
            GoalCommand::ConsiderAfter(RECHECK_INTERVAL),
            GoalCommand::ScheduleNext,
        ];
        told.into_iter().chain(rest).collect()
    }

    fn unsatisfied(&mut self, event: GoalEvent, now: Duration, policy: Policy) -> Vec<GoalCommand> {
        if self.rounds > 0 && !policy.is_replanning {
            let why = "it does not hold any more, and replanning is off";
            return self.end(Outcome::Failed, why);
        }
        self.is_holding_reported = false;
        match event {
            GoalEvent::GoalLost(_, why) => {
                self.planning_mode = PlanningMode::default();
                self.no_plan(why, now, policy)
            }
            GoalEvent::AgentsBusy(_, blockers) => self.block(blockers, now),
            GoalEvent::GoalOpen(_, PlanningFlow::Centralized) => {
                self.enter(GoalPhase::Planning);
                vec![GoalCommand::Plan(self.next_attempt())]
            }
            _ => {
                self.enter(GoalPhase::CollectingProposals);
                vec![GoalCommand::Plan(self.next_attempt())]
            }
        }
    }

    /// Waits for the newer action models of the bidders, up to a limit of time. After the limit no
    /// command is returned, and the owner uses the bids as they are.
    fn bids_outdated(&mut self, why: String, now: Duration, policy: Policy) -> Vec<GoalCommand> {
        let since = *self.outdated_since.get_or_insert(now);
        if now.saturating_sub(since) >= ANNOUNCEMENT_DELAY.max(policy.grace) {
            return Vec::new();
        }
        let rejected = "a new call for proposals follows: an action model is newer";
        let mut commands = vec![GoalCommand::RejectProposals(rejected)];
        commands.extend(self.wait(why, ANNOUNCEMENT_DELAY));
        commands
    }

    fn plan_found(
        &mut self,
        decision: PlanDecision,
        now: Duration,
        policy: Policy,
    ) -> Vec<GoalCommand> {
        self.planning_mode = PlanningMode::Cooperative;
        if !matches!(decision, PlanDecision::Conflict(_)) {
            self.no_plan_since = None;
        }
        match decision {
            PlanDecision::Run => {
                self.rounds += 1;
                self.enter(GoalPhase::Executing);
                self.blocked_by.clear();
                self.no_plan_because.clear();
                // The next goal may be planned for during execution.
                vec![GoalCommand::Execute(self.next_attempt()), GoalCommand::ScheduleNext]
            }
            PlanDecision::Preempt(others, blockers) => {
                let mut commands = self.block(blockers, now);
                commands.push(GoalCommand::Preempt(others));
                commands
            }
            PlanDecision::WaitFor(blockers) => self.block(blockers, now),
            PlanDecision::Conflict(kept) => {
                let why = format!("every plan for it would undo {kept}, which is kept");
                self.no_plan(why, now, policy)
            }
        }
    }

    /// Handles the reason why there is no plan: tries the next mode of planning, waits for other
    /// goals, or reports the reason.
    fn explained(
        &mut self,
        missing: MissingPlan,
        now: Duration,
        policy: Policy,
    ) -> Vec<GoalCommand> {
        if missing.are_agents_free_again {
            self.enter(GoalPhase::Queued);
            return vec![GoalCommand::ScheduleNext];
        }
        let has_hope = missing.has_hope && self.planning_mode != PlanningMode::DiagnoseConflict;
        let next = match self.planning_mode {
            PlanningMode::Cooperative if has_hope && missing.can_preempt => {
                PlanningMode::Preemptive
            }
            _ if has_hope && !missing.blockers.goals.is_empty() => {
                return self.block(missing.blockers, now);
            }
            _ if has_hope && missing.has_kept_goals => PlanningMode::DiagnoseConflict,
            _ => {
                self.planning_mode = PlanningMode::default();
                return self.no_plan(missing.why, now, policy);
            }
        };
        self.planning_mode = next;
        self.enter(GoalPhase::Queued);
        vec![GoalCommand::Consider]
    }

    // === waiting ===

    /// Makes the goal wait until the plan of one of the blockers no longer runs.
    fn block(&mut self, blockers: Blockers, now: Duration) -> Vec<GoalCommand> {
        self.planning_mode = PlanningMode::Cooperative;
        let Blockers { goals, agents } = blockers;
        self.blocked_by_agents =
            (!agents.is_empty()).then(|| (agents, now.saturating_add(STILL_BLOCKED)));
        let names: Vec<_> = goals.iter().map(|goal| format!("`{goal}`")).collect();
        let why = match names.split_at(names.len().min(BLOCKERS_TOLD)) {
            (told, []) => format!("needs what {} is using", told.join(" and ")),
            (told, more) => {
                format!("needs what {} and {} more are using", told.join(", "), more.len())
            }
        };
        let told = (self.blocked_by != why).then(|| progress(format!("waiting: it {why}")));
        self.enter(GoalPhase::WaitingForAgents);
        self.waits_because = format!("it {why}");
        self.blocked_by = why;
        told.into_iter().chain([GoalCommand::ScheduleNext]).collect()
    }

    /// Makes the goal wait for the time `wait`, after which the goal is checked again. Other goals
    /// may be planned for during the wait.
    fn wait(&mut self, why: String, wait: Duration) -> Vec<GoalCommand> {
        self.enter(GoalPhase::WaitingForChange);
        self.waits_because = why;
        vec![GoalCommand::ConsiderAfter(wait), GoalCommand::ScheduleNext]
    }

    /// Handles a plan that failed or could not be made: plans for the goal again after the time
    /// `wait`, or gives the goal up.
    fn retry(&mut self, why: String, wait: Duration, policy: Policy) -> Vec<GoalCommand> {
        self.failures += 1;
        self.hindrances = 0;
        let gives_up = self.keep == Keep::Achieve && self.failures >= FAILURES_MAX;
        if gives_up || !policy.is_replanning {
            let detail = format!("given up after {} plans: {why}", self.rounds);
            return self.end(Outcome::Failed, detail);
        }
        let backoff = backoff(self.failures);
        let wait = if self.failures <= IMMEDIATE_RETRIES { wait } else { wait.max(backoff) };
        let mut commands = vec![progress(format!("planning anew: {why}"))];
        commands.extend(self.wait(why, wait));
        commands
    }

    /// Handles a plan that was not made or not carried out because an agent is busy or absent: plans
    /// for the goal again after the time `wait` at least. Nothing has failed, so the goal is not given
    /// up, however long this takes.
    fn postpone(&mut self, why: String, wait: Duration, policy: Policy) -> Vec<GoalCommand> {
        if !policy.is_replanning {
            return self.retry(why, wait, policy);
        }
        self.hindrances = self.hindrances.saturating_add(1);
        let mut commands = vec![progress(format!("planning anew: {why}"))];
        commands.extend(self.wait(why, wait.max(backoff(self.hindrances))));
        self.is_postponed = true;
        commands
    }

    /// Handles a round of planning that found no plan. While messages about recent changes may
    /// still arrive, plans once more. After that, a goal that is to be achieved once ends; a kept
    /// goal waits until the ecosystem changes, or until a failed action may be tried again.
    fn no_plan(&mut self, why: String, now: Duration, policy: Policy) -> Vec<GoalCommand> {
        if std::mem::take(&mut self.is_request_stale) {
            // The search used an outdated state of the world.
            return self.wait(why, SETTLE_DELAY);
        }
        let chance = self.backoffs.next_chance(now);
        if chance.is_none() && policy.is_replanning {
            // A fact that an agent has observed may not have arrived here yet. An agent that could
            // reach the goal may be absent for a moment.
            let patience = ANNOUNCEMENT_DELAY.max(policy.grace);
            let waited = now.saturating_sub(*self.no_plan_since.get_or_insert(now));
            let rest = patience.saturating_sub(waited);
            if !rest.is_zero() || self.in_warm_up(now) {
                return self.wait(why, rest.max(ASK_AGAIN));
            }
        }
        let may_try_again = policy.is_replanning && self.failures < FAILURES_MAX;
        if self.keep == Keep::Achieve && (chance.is_none() || !may_try_again) {
            return self.end(Outcome::Failed, why);
        }
        let is_told = self.no_plan_because == why;
        self.no_plan_because.clone_from(&why);
        let told = (!is_told)
            .then(|| progress(format!("no plan now: {why}; waiting for the ecosystem to change")));
        let wait = chance
            .map_or(RECHECK_INTERVAL, |chance| RECHECK_INTERVAL.min(chance.saturating_sub(now)));
        told.into_iter().chain(self.wait(why, wait)).collect()
    }

    // === execution ===

    /// Continues with a plan of the goal that already runs, instead of the plan made here. If that
    /// plan was to be cancelled, the running plan is cancelled.
    fn other_plan_runs(&mut self, round: u32) -> Vec<GoalCommand> {
        self.rounds = self.rounds.max(round);
        let adopted =
            [GoalCommand::AdoptRunningPlan, GoalCommand::RequestExecution(self.next_attempt())];
        let last = match self.phase {
            GoalPhase::Executing => progress("another plan for the goal is under way, and goes on"),
            _ => GoalCommand::CancelExecution,
        };
        adopted.into_iter().chain([last]).collect()
    }

    fn execution_ended(
        &mut self,
        end: ExecutionEnd,
        now: Duration,
        policy: Policy,
    ) -> Vec<GoalCommand> {
        let from = self.phase;
        // Other goals wait until this goal is verified, because their plans might undo it.
        let is_verified_first = matches!(from, GoalPhase::Executing | GoalPhase::Cancelling)
            && self.keep == Keep::Achieve
            && matches!(end, ExecutionEnd::Done);
        let next = match (from, end) {
            (_, ExecutionEnd::Done) if self.keep == Keep::Achieve => self.verify_first(),
            (GoalPhase::Cancelling, end) => self.cancelled_in_execution(end),
            (_, ExecutionEnd::Done) => {
                // The goal is checked once more before it is reported to hold: an agent may have
                // left during the execution.
                (self.failures, self.hindrances) = (0, 0);
                self.enter(GoalPhase::Holding);
                vec![GoalCommand::ConsiderAfter(SETTLE_DELAY), GoalCommand::ScheduleNext]
            }
            // The goal waits in the queue, behind the goal that it yielded to.
            (GoalPhase::Preempted, _) => {
                self.enter(GoalPhase::Queued);
                vec![GoalCommand::ScheduleNext]
            }
            (_, ExecutionEnd::Failed(report, _)) if is_only_busy(&report) => {
                self.postpone(report.detail, Duration::ZERO, policy)
            }
            (_, ExecutionEnd::Failed(report, blamed)) => {
                blamed.into_iter().for_each(|it| self.backoffs.penalize(it, &report, now));
                self.retry(report.detail, Duration::ZERO, policy)
            }
            (_, ExecutionEnd::Cancelled(why)) => self.retry(why, Duration::ZERO, policy),
            (_, ExecutionEnd::Unknown(why, wait)) => self.postpone(why, wait, policy),
        };
        let released = (!is_verified_first).then_some(GoalCommand::ReleaseAgents);
        released.into_iter().chain(next).collect()
    }

    fn cancelled_in_execution(&mut self, end: ExecutionEnd) -> Vec<GoalCommand> {
        let detail = match end {
            ExecutionEnd::Done => CANCELLED_LATE.to_owned(),
            ExecutionEnd::Cancelled(_) => CANCELLED.to_owned(),
            ExecutionEnd::Failed(report, _) => report.detail,
            ExecutionEnd::Unknown(why, _) => format!("cancelled, not confirmed: {why}"),
        };
        self.end(Outcome::Cancelled, detail)
    }

    fn verify_first(&mut self) -> Vec<GoalCommand> {
        self.enter(GoalPhase::Verifying);
        self.looks = 1;
        vec![GoalCommand::Verify(self.next_attempt(), Duration::ZERO)]
    }

    fn verified(&mut self, verdict: GoalVerdict, policy: Policy) -> Vec<GoalCommand> {
        let next = match verdict {
            GoalVerdict::Holds if self.is_cancelled => return self.end(Outcome::Done, DONE_BEFORE),
            GoalVerdict::Holds => return self.end(Outcome::Done, "the goal holds"),
            GoalVerdict::Unmet(_) if self.looks < LOOKS_MAX => {
                self.looks += 1;
                return vec![GoalCommand::Verify(self.next_attempt(), SETTLE_DELAY)];
            }
            GoalVerdict::Unmet(unmet) if self.is_cancelled => {
                let detail = format!("{CANCELLED_LATE}, and {unmet}");
                return self.end(Outcome::Cancelled, detail);
            }
            _ if self.is_cancelled => return self.end(Outcome::Cancelled, CANCELLED_LATE),
            GoalVerdict::Unusable(why) => return self.end(Outcome::Failed, why),
            GoalVerdict::Unmet(unmet) => {
                let why = format!("every step is done, and {unmet}");
                self.retry(why, Duration::ZERO, policy)
            }
            GoalVerdict::Unanswered => self.wait(NO_MAINTAINER.to_owned(), ASK_AGAIN),
        };
        std::iter::once(GoalCommand::ReleaseAgents).chain(next).collect()
    }

    // === the end ===

    fn cancelled(&mut self) -> Vec<GoalCommand> {
        match self.phase {
            GoalPhase::Executing => {
                self.is_cancelled = true;
                self.enter(GoalPhase::Cancelling);
                vec![GoalCommand::CancelExecution]
            }
            GoalPhase::Preempted | GoalPhase::Cancelling => {
                self.is_cancelled = true;
                self.enter(GoalPhase::Cancelling);
                Vec::new()
            }
            GoalPhase::Planning => {
                let end = self.end(Outcome::Cancelled, CANCELLED);
                std::iter::once(GoalCommand::CancelPlanning).chain(end).collect()
            }
            _ => self.end(Outcome::Cancelled, CANCELLED),
        }
    }

    /// Ends the goal. If its plan was being verified, its agents are released, too.
    fn end(&mut self, outcome: Outcome, detail: impl Into<String>) -> Vec<GoalCommand> {
        let released = (self.phase == GoalPhase::Verifying).then_some(GoalCommand::ReleaseAgents);
        self.enter(GoalPhase::Ended);
        let end = GoalCommand::End(outcome, detail.into());
        [end].into_iter().chain(released).chain([GoalCommand::ScheduleNext]).collect()
    }

    // === changes of the world ===

    /// Handles a change of the world. A goal that held may not hold now, and a waiting goal may
    /// have a plan.
    fn world_changed(
        &mut self,
        joined: &[AgentId],
        have_agents_changed: bool,
        is_planning_busy: bool,
    ) -> Vec<GoalCommand> {
        joined.iter().for_each(|agent| self.backoffs.reset(agent));
        if have_agents_changed {
            self.blocked_by_agents = None;
            self.is_request_stale = self.phase.is_planning();
            self.no_plan_since = None;
        }
        let is_concerned = match self.phase {
            GoalPhase::Queued => !is_planning_busy,
            // A change of the state makes no agent less busy; one that joins may be the one that is
            // missing.
            GoalPhase::WaitingForChange => have_agents_changed || !self.is_postponed,
            GoalPhase::Holding => true,
            // A change of state does not free the agents that other goals use.
            GoalPhase::WaitingForAgents => have_agents_changed,
            _ => false,
        };
        is_concerned.then_some(GoalCommand::ConsiderAfter(SETTLE_DELAY)).into_iter().collect()
    }
}
