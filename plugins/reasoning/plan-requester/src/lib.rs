//! The Plan Requester (the paper, “Plan Requester”): receives goals, obtains a plan for each goal,
//! and has the plan executed.
//!
//! - `request` (a goal) from a user or an agent → `confirm`s with the progress and the outcome.
//! - Queries the Domain Maintainer for domain and state. Then, depending on the planning mode of
//!   the ecosystem (centralised or decentralised), requests a plan from the Planning Agent
//!   (`planning`), or sends a call for proposals to all actuators (`contract_net`). Requests the
//!   Plan Executor to execute the chosen plan.
//! - Replans at once when a plan fails, and reports the reason. Plans for a kept goal again
//!   whenever the goal no longer holds.
//! - Asks itself for goals when their times have come, and tells of those that are late
//!   (`goal_clock`).
//! - Pursues several goals in parallel; no plan breaks the causal links of another plan
//!   (`scheduling`).
//!
//! [`dry_run()`] plans for a goal without requesting it, with the same checks.
//!
//! The lifecycle of each goal is the state machine of the crate `goal-lifecycle`; the module
//! `lifecycle` calls it. Start reading there.

mod combining;
mod contract_net;
mod dry_run;
mod due_goal;
mod due_records;
mod early_requests;
mod execution;
mod explanations;
mod failover;
mod file_goals;
mod finished;
mod goal;
mod goal_check;
mod goal_clock;
mod handover;
mod joint_planning;
mod joint_plans;
mod joint_state;
mod lifecycle;
mod numbering;
mod orphan_plans;
mod planning;
mod planning_snapshot;
mod proposals;
mod scheduling;
mod selection;
mod verification;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    Achieve, GoalPhase, Inform, Outcome, Reason, Report, Request, SetMode, Snapshot, StoreRecords,
};
use acl::{AgentId, ConversationId, Message, Performative};
use agent::replication::{self, JournalClient};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, ConfiguredModels, Context, LaunchableAgent, Mode,
    Participation, PluginEntry, Presence, Resource, TimerId, WorkHandle,
};
use goal_lifecycle::{Attempt, GoalEvent, PlanningFlow, holding};
use pddl::{ActionModel, Condition};
use serde::Deserialize;
use tokio::time::Instant;

pub use crate::dry_run::{DryRunRequest, DryRunResult, DryRunStep, ThreatenedGoal, dry_run};
use crate::due_goal::{GoalLimits, timestamp};
use crate::early_requests::EarlyRequests;
pub use crate::file_goals::{FileGoal, FileGoals};
use crate::finished::FinishedGoals;
use crate::goal::{Goal, PlanningRound, Work};
use crate::goal_check::{absent_declarers, lost_to, wrong_in};
use crate::goal_clock::GoalClock;
use crate::numbering::GoalNumbers;
use crate::planning_snapshot::{PlanningSnapshot, first};

/// Maximum number of goals pursued at a time. A building has tens of goals. Further goals are
/// refused with a reason.
const GOALS_MAX: usize = 256;

/// Delay before a request to another agent is repeated if no answer arrived.
const ASK_AGAIN: Duration = Duration::from_millis(500);

/// Delay before the outcome of a goal is sent again, if the outbox was full.
const TELL_AGAIN: Duration = Duration::from_millis(200);

/// Delay before the next attempt of a plan or a proposal that was declined.
const BUSY: Duration = Duration::from_millis(200);

/// Whether an agent that declines a request for this reason may take it a moment later, or another
/// replica of the agent may.
fn is_passing(reason: Reason) -> bool {
    matches!(reason, Reason::Busy | Reason::MailboxFull | Reason::Stopping | Reason::StandingBy)
}

/// The entry of the Plan Requester in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "plan-requester",
    about: "takes goals, has plans made for them and carried out",
    drivers: &[],
    has_replicas: true,
    build,
};

/// The `config` of a Plan Requester in the ecosystem file: the names of the other agents that take
/// part in planning. A missing name is taken from the ecosystem's settings.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct FileConfig {
    domain_maintainer: Option<AgentId>,
    planning_agent: Option<AgentId>,
    plan_executor: Option<AgentId>,
    replanning: Option<bool>,
}

/// The configuration of a Plan Requester.
#[derive(Debug)]
struct Config {
    domain_maintainer: AgentId,
    planning_agent: AgentId,
    plan_executor: AgentId,
    /// The action models that the agents of the ecosystem file will announce, as far as they are
    /// known.
    configured_models: Vec<ActionModel>,
    /// Whether a new plan is made when a plan fails. Switched off only in tests that show the
    /// effect of replanning.
    replanning: bool,
}

impl Config {
    fn of(blueprint: &Blueprint) -> Result<Config, BuildError> {
        let FileConfig { domain_maintainer, planning_agent, plan_executor, replanning } =
            blueprint.config_as()?;
        let roles = blueprint.host.settings.roles.clone();
        let configured = blueprint.host.resources.get::<ConfiguredModels>();
        Ok(Config {
            domain_maintainer: domain_maintainer.unwrap_or(roles.domain_maintainer),
            planning_agent: planning_agent.unwrap_or(roles.planning_agent),
            plan_executor: plan_executor.unwrap_or(roles.plan_executor),
            configured_models: configured.map(|models| models.0.clone()).unwrap_or_default(),
            replanning: replanning.unwrap_or(true),
        })
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config = Config::of(&blueprint)?;
    let mode = blueprint.host.mode;
    let file_goals = blueprint.host.resources.get::<FileGoals>();
    let file_goals = file_goals.map(|goals| (*goals).clone()).unwrap_or_default();
    let (journal_client, goals, ended) =
        (JournalClient::new(&blueprint.host), BTreeMap::new(), FinishedGoals::default());
    Ok(Box::new(PlanRequester {
        config,
        mode,
        goals,
        ended,
        numbers: GoalNumbers::default(),
        early: EarlyRequests::default(),
        clock: GoalClock::new(file_goals),
        journal_client,
        cheaper_plan_check: None,
        resend_timer: None,
        began_at: None,
    }))
}

struct PlanRequester {
    config: Config,
    mode: Mode,
    goals: BTreeMap<ConversationId, Goal>,
    ended: FinishedGoals,
    numbers: GoalNumbers,
    /// Requests that wait until the Journals have been read.
    early: EarlyRequests,
    /// Goals that are asked for by the clock.
    clock: GoalClock,
    journal_client: JournalClient<PlanRequester>,
    /// Background work that checks whether running plans could be replaced by much cheaper ones.
    cheaper_plan_check: Option<WorkHandle>,
    /// Timer until the next attempt to send outcomes for which the outbox had no room; `None` if
    /// there are no such outcomes.
    resend_timer: Option<TimerId>,
    /// Time from which the times in the goals' states are counted: that of the first call of
    /// [`PlanRequester::elapsed`]; `None` before that call.
    began_at: Option<Instant>,
}

impl Agent for PlanRequester {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
            .on_broadcast(Performative::Inform, Self::informed)
    }

    fn leadership_changed(&mut self, is_leading: bool, ctx: &mut Context<Self>) {
        replication::handle_leadership(self, is_leading, ctx);
        match is_leading {
            true => self.await_journals(ctx),
            false => self.resign(ctx),
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        replication::handle_presence(self, presence, ctx);
        match presence {
            Presence::Left(resident) => self.bidder_left(&resident.agent, ctx),
            Presence::Joined(resident) if resident.agent == self.config.plan_executor => {
                self.executor_came(ctx);
            }
            Presence::Joined(resident)
                if self.journal_client.journals().contains(&resident.agent) =>
            {
                if self.journal_client.is_leading() {
                    self.replicate_all(ctx);
                }
                self.reconsider_waiting(ctx);
            }
            Presence::Joined(resident) => self.send_missed_outcomes(resident, ctx),
        }
    }

    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        self.journal_client.has_delivered()
    }

    fn answer_query(&mut self, resource: Resource, ctx: &mut Context<Self>) -> Option<String> {
        if resource != Resource::Goals {
            return None;
        }
        let now = timestamp(ctx.wall_clock());
        let due = self.clock.goals.iter().map(|(id, due)| due.status(id, now));
        let goals: Vec<_> = self.goals.values().map(Goal::status).chain(due).collect();
        serde_json::to_string(&goals).ok()
    }
}

impl PlanRequester {
    // === requests ===

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let (asked, limits) = match message.content_as::<Request>() {
            Ok(Request::Achieve(asked)) => {
                let is_own = message.sender == *ctx.id();
                let limits = is_own.then(|| self.limits_of(&message.conversation_id)).flatten();
                (asked, limits)
            }
            Ok(Request::Schedule(scheduled)) => {
                return self.schedule_requested(message, *scheduled, ctx);
            }
            Ok(Request::SetMode(SetMode { mode })) => {
                self.mode = mode;
                let report = Report::new(Outcome::Done, format!("plans are {mode} from now on"));
                return ctx.answer(&participation, Performative::Confirm, &report);
            }
            Ok(Request::StoreRecords(StoreRecords { records })) if message.sender == *ctx.id() => {
                return self.receive_handover(&message, records, ctx);
            }
            Ok(_) => {
                let detail = "a Plan Requester takes goals: `achieve`, and the flow: `set-mode`";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        self.take_goal(&message, asked, limits, ctx);
    }

    /// Takes a goal, unless it was requested before.
    fn take_goal(
        &mut self,
        message: &Message,
        asked: Achieve,
        limits: Option<GoalLimits>,
        ctx: &mut Context<Self>,
    ) {
        let participation = Participation::of(message);
        if let Some(goal) = self.goals.get_mut(&participation.conversation)
            && goal.is_asked_again(&participation, &asked)
        {
            goal.participation = participation;
            let report = match goal.state.phase() {
                GoalPhase::Holding => holding(),
                _ => Report::new(Outcome::Progress, "accepted before; it goes on"),
            };
            return ctx.answer(&goal.participation, Performative::Confirm, &report);
        }
        if let Some(report) = self.ended.of(&participation) {
            return ctx.answer(&participation, Performative::Confirm, report);
        }
        let is_own = message.sender == *ctx.id();
        if let Some(report) = self.ended.outcome_of(&participation.conversation).filter(|_| is_own)
        {
            return ctx.answer(&participation, Performative::Confirm, report);
        }
        match self.admissible(&asked, &participation) {
            Ok(condition) => {
                // Its own occurrences have conversations that say whether they are the same.
                if !is_own {
                    self.take_place(message, &asked, ctx);
                }
                let mut goal = Goal::new(participation, message.incarnation, asked, condition);
                goal.number = self.numbers.next();
                goal.add_history(ctx.wall_clock(), None, "asked for");
                goal.limits = limits;
                let id = goal.conversation().clone();
                tracing::info!(conversation = %id, goal = goal.text, "a goal");
                self.goals.insert(id.clone(), goal);
                self.replicate_new_goal(&id, ctx);
                self.consider(&id, ctx);
                self.look_at_clock(ctx);
            }
            Err((reason, detail)) => ctx.refuse(&participation, reason, detail),
        }
    }

    /// Cancels the goals that an earlier incarnation of the sender requested and that the new
    /// request `asked` repeats. The earlier incarnation can no longer receive the outcomes of these
    /// goals or cancel them. Therefore the new goal replaces them.
    fn take_place(&mut self, message: &Message, asked: &Achieve, ctx: &mut Context<Self>) {
        let (by, incarnation) = (&message.sender, message.incarnation);
        let former =
            self.goals.iter().filter(|(_, goal)| goal.is_asked_anew(by, incarnation, asked));
        let former: Vec<_> = former.map(|(id, _)| id.clone()).collect();
        for id in former {
            tracing::info!(conversation = %id, "its asker was restarted and asks again");
            self.cancel(&id, ctx);
        }
    }

    fn admissible(
        &self,
        asked: &Achieve,
        participation: &Participation,
    ) -> Result<Condition, (Reason, String)> {
        let untold = self.ended.unsent_count();
        if self.goals.len() + untold >= GOALS_MAX {
            let detail = match untold {
                0 => {
                    format!("{GOALS_MAX} goals are pursued already; ask again when some have ended")
                }
                _ => format!(
                    "{} goals are pursued already, and {untold} more could not be reported as \
                     ended yet; ask again later",
                    self.goals.len()
                ),
            };
            return Err((Reason::Busy, detail));
        }
        if self.goals.contains_key(&participation.conversation) {
            return Err((Reason::OutOfTurn, "this conversation is about another goal".to_owned()));
        }
        pddl::parse_condition(&asked.goal).into_result().map_err(|diagnostics| {
            let lines: Vec<_> =
                diagnostics.iter().map(|diagnostic| diagnostic.located(&asked.goal)).collect();
            (Reason::BadContent, lines.join("\n"))
        })
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let id = &message.conversation_id;
        // A `cancel` within the goal's own exchange is answered by the goal's final report. Only a
        // sender that opens a new exchange for the `cancel` is answered here.
        let asker = message.opens_exchange().then(|| Participation::of(&message));
        match !self.is_goal(id) && self.early.has_unread_journals() {
            true => self.hold_cancellation(id, asker, ctx),
            false => self.cancel_for(id, asker, ctx),
        }
    }

    /// Whether a goal, or a goal by the clock, of this conversation is known and has not ended.
    fn is_goal(&self, id: &ConversationId) -> bool {
        self.goals.contains_key(id) || self.is_due_goal(id)
    }

    /// Cancels a goal. `asker` is the exchange that waits for the answer; `None` if the goal's final
    /// report is the answer.
    fn cancel_for(
        &mut self,
        id: &ConversationId,
        asker: Option<Participation>,
        ctx: &mut Context<Self>,
    ) {
        if self.is_due_goal(id) {
            return self.due_cancelled(id, asker, ctx);
        }
        let is_here = self.goals.contains_key(id);
        self.cancel(id, ctx);
        if !is_here {
            let unknown = || format!("there is no goal `{id}`");
            asker.iter().for_each(|asker| ctx.refuse(asker, Reason::Unknown, unknown()));
            return;
        }
        // The cancellation is confirmed only when it is recorded, so that a standby that takes over
        // cancels the goal too.
        self.replicate_cancellation(id, ctx, move |ctx| {
            let report = Report::new(Outcome::Cancelled, "the goal is given up");
            asker.iter().for_each(|asker| ctx.answer(asker, Performative::Confirm, &report));
        });
    }

    fn cancel(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.add_history(ctx.wall_clock(), None, "cancelled");
        self.handle(id, GoalEvent::Cancelled, ctx);
    }

    // === comparing ===

    /// Queries the Domain Maintainer for the domain and the state, in order to compare a goal with
    /// them.
    fn fetch_domain(&mut self, id: &ConversationId, attempt: Attempt, ctx: &mut Context<Self>) {
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let considered = id.clone();
        let work = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            let event = match snapshot {
                Some(snapshot) => requester.compare_goal(&considered, attempt, snapshot, ctx),
                None => Some(GoalEvent::DomainMissing(attempt)),
            };
            event.into_iter().for_each(|event| requester.handle(&considered, event, ctx));
        });
        if let Some(goal) = self.goals.get_mut(id) {
            goal.work = Work::Question(work);
        }
    }

    /// Compares a goal with the domain and the state. Prepares a round of planning if the goal does
    /// not hold. Returns `None` if the goal has ended.
    fn compare_goal(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        snapshot: Snapshot,
        ctx: &mut Context<Self>,
    ) -> Option<GoalEvent> {
        let known = match PlanningSnapshot::read(snapshot) {
            Ok(known) => known,
            Err(problem) => return Some(GoalEvent::DomainUnusable(attempt, problem)),
        };
        let now = self.elapsed(ctx);
        let goal = self.goals.get_mut(id).filter(|goal| goal.is_current(attempt))?;
        goal.state.backoffs_mut().compare_with(&known.offers);
        let known = known.without_avoided(goal.state.backoffs().avoided(now));
        let is_first = goal.state.rounds() == 0;
        let is_absent = |model: &&ActionModel| {
            AgentId::new(model.agent.as_str()).is_ok_and(|agent| ctx.find(&agent).is_none())
        };
        let absent = || self.config.configured_models.iter().filter(is_absent);
        if let Some(lost) = is_first.then(|| absent_declarers(goal, &known, absent())).flatten() {
            return Some(GoalEvent::GoalLost(attempt, lost));
        }
        if let Some(problem) = is_first.then(|| wrong_in(goal, &known)).flatten() {
            return Some(GoalEvent::GoalInvalid(attempt, problem));
        }
        let open = match known.open_conjuncts(&goal.condition) {
            Ok(open) if open.is_empty() => return Some(GoalEvent::GoalHolds(attempt)),
            Ok(open) => open,
            Err(problem) => return Some(GoalEvent::DomainUnusable(attempt, problem)),
        };
        if let Some(lost) = (!is_first).then(|| lost_to(goal, &known)).flatten() {
            if self.config.replanning {
                self.report_changes(id, &known, &open, ctx);
            }
            return Some(GoalEvent::GoalLost(attempt, lost));
        }
        let known = known.without_agents(&self.agents_in_use(id));
        if let Some(blockers) = self.all_in_use(id, &known) {
            return Some(GoalEvent::AgentsBusy(attempt, blockers));
        }
        let flow = match self.mode {
            Mode::Centralized => PlanningFlow::Centralized,
            Mode::Decentralized => PlanningFlow::Decentralized,
        };
        let round = PlanningRound { known: Arc::new(known), open, found: None, why_missing: None };
        self.goals.get_mut(id)?.round = Some(round);
        Some(GoalEvent::GoalOpen(attempt, flow))
    }

    /// Searches a plan for a goal, in the planning flow of the goal's phase.
    fn plan(&mut self, id: &ConversationId, attempt: Attempt, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get(id) else { return };
        let Some(round) = &goal.round else { return };
        let (known, open) = (Arc::clone(&round.known), round.open.clone());
        let phase = goal.state.phase();
        self.report_changes(id, &known, &open, ctx);
        match phase {
            GoalPhase::Planning => self.ask_planner(id, attempt, &known, ctx),
            _ => self.call_for_proposals(id, attempt, &known, &open, ctx),
        }
    }

    // === reports ===

    pub(crate) fn send_report(
        &mut self,
        id: &ConversationId,
        report: Report,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        tracing::info!(conversation = %id, outcome = %report.outcome, detail = report.detail, "goal");
        let now = ctx.wall_clock();
        goal.add_history(now, Some(report.outcome), report.detail.as_str());
        let told = ctx.try_answer(&goal.participation, Performative::Confirm, &report);
        if !report.outcome.is_final() {
            if let Err(why) = told {
                tracing::debug!(conversation = %id, %why, "a progress report could not be sent");
            }
            return self.replicate_goal(id, ctx);
        }
        if let Err(why) = told {
            tracing::info!(conversation = %id, %why, "the final report is sent later");
            self.ended.queue_unsent(goal.participation.clone(), report);
            self.schedule_resend(ctx);
        }
    }

    /// Sends the outcome of a goal to its initiator. If the outbox is full, queues the outcome.
    fn send_or_queue(&mut self, to: &Participation, report: Report, ctx: &mut Context<Self>) {
        if ctx.try_answer(to, Performative::Confirm, &report).is_err() {
            self.ended.queue_unsent(to.clone(), report);
            self.schedule_resend(ctx);
        }
    }

    /// Starts the timer for the next attempt to send queued outcomes, if it is not running.
    fn schedule_resend(&mut self, ctx: &mut Context<Self>) {
        if self.resend_timer.is_none() {
            self.resend_timer = Some(ctx.after(TELL_AGAIN, |requester: &mut Self, ctx| {
                requester.resend_timer = None;
                requester.resend_unsent(ctx);
            }));
        }
    }

    fn resend_unsent(&mut self, ctx: &mut Context<Self>) {
        while let Some((participation, report)) = self.ended.pop_unsent() {
            if ctx.try_answer(&participation, Performative::Confirm, &report).is_err() {
                self.ended.queue_unsent(participation, report);
                return self.schedule_resend(ctx);
            }
        }
    }

    // === changes of the world ===

    /// Handles a change of the world: a goal that held may not hold any more, and a goal that waits
    /// may have a plan now.
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        if message.sender != self.config.domain_maintainer {
            return;
        }
        let Ok(Inform::Epoch(change)) = message.content_as::<Inform>() else { return };
        // When planning for one goal ends, planning for the next goal is started there.
        let event = GoalEvent::WorldChanged {
            joined: change.joined.clone(),
            have_agents_changed: !change.joined.is_empty() || !change.left.is_empty(),
            is_planning_busy: self.is_planning_busy(),
        };
        let goals: Vec<_> = self.goals.keys().cloned().collect();
        for id in goals {
            self.handle(&id, event.clone(), ctx);
        }
        self.check_for_cheaper_plans(&change.joined, ctx);
    }
}
