//! The Plan Requester (the paper, “Plan Requester”): takes goals, obtains a plan for each goal, and has
//! the plan carried out.
//!
//! - `request` (a goal) from a user or an agent → `confirm`s of progress and outcome.
//! - Reads domain and state from the Domain Maintainer. Then, depending on the planning mode of the
//!   ecosystem (centralised or decentralised), asks the Planning Agent for a plan (`planning`) or calls
//!   all actuators for proposals (`contract_net`). Asks the Plan Executor to execute the chosen plan.
//! - Replans at once when a plan fails, and reports the reason. Plans again for a kept goal whenever it
//!   no longer holds.
//! - Several goals run side by side; no plan breaks another's causal links (`scheduling`).
//!
//! Start reading at `PlanRequester::consider`.

mod contract_net;
mod execution;
mod explanations;
mod failover;
mod finished;
mod goal;
mod handover;
mod joint_plans;
mod orphan_plans;
mod planning;
mod planning_snapshot;
mod scheduling;
mod selection;
mod verification;

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    Achieve, Inform, Keep, Keeping, Outcome, Reason, Report, Request, SetMode, Snapshot,
};
use acl::{AgentId, ConversationId, Message, Performative};
use agent::replication::{self, JournalClient};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, Mode, Participation,
    PluginEntry, Presence, Resource, TimerId, WorkHandle,
};
use pddl::Condition;
use serde::Deserialize;

use crate::finished::FinishedGoals;
use crate::goal::{FAILURES_MAX, Goal, GoalPhase};
use crate::planning_snapshot::{PlanningSnapshot, first};

/// Maximum number of goals pursued at a time. A building has tens of goals. A further goal is refused
/// with a reason, not dropped silently.
const GOALS_MAX: usize = 256;

/// Delay between a change of the world and the next check of the goals. News of one event arrive in
/// several messages, which one check then covers.
const SETTLE_DELAY: Duration = Duration::from_millis(20);

/// Delay before planning again when no plan was found. After this delay the latest announcements of all
/// agents have arrived here, also on a busy machine.
const ANNOUNCEMENT_DELAY: Duration = Duration::from_millis(100);

/// Interval at which waiting and holding goals are checked even if no news have come. A broadcast may
/// be lost.
const RECHECK_INTERVAL: Duration = Duration::from_secs(10);

/// Delay before a question to another agent is asked again if no answer was received.
const ASK_AGAIN: Duration = Duration::from_millis(500);

/// Delay before the outcome of a goal is sent again, if there was no room for it in the outbox.
const TELL_AGAIN: Duration = Duration::from_millis(200);

/// Delay before another try of a plan that was declined because an actuator is busy.
const BUSY: Duration = Duration::from_millis(200);

/// The entry of the Plan Requester in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "plan-requester",
    about: "takes goals, has plans made for them and carried out",
    drivers: &[],
    has_replicas: true,
    build,
};

/// The `config` of a Plan Requester in the ecosystem file: the names of the other agents that take part
/// in planning, where they are not those of the ecosystem's settings.
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
    /// Whether a new plan is made when a plan fails. Switched off only in tests that show the effect of
    /// replanning.
    replanning: bool,
}

impl Config {
    fn of(blueprint: &Blueprint) -> Result<Config, BuildError> {
        let FileConfig { domain_maintainer, planning_agent, plan_executor, replanning } =
            blueprint.config_as()?;
        let roles = blueprint.host.settings.roles.clone();
        Ok(Config {
            domain_maintainer: domain_maintainer.unwrap_or(roles.domain_maintainer),
            planning_agent: planning_agent.unwrap_or(roles.planning_agent),
            plan_executor: plan_executor.unwrap_or(roles.plan_executor),
            replanning: replanning.unwrap_or(true),
        })
    }
}

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config = Config::of(&blueprint)?;
    let mode = blueprint.host.mode;
    let (keeper, goals, ended) =
        (JournalClient::new(&blueprint.host), BTreeMap::new(), FinishedGoals::default());
    Ok(Box::new(PlanRequester {
        config,
        mode,
        goals,
        ended,
        keeper,
        cheaper_plan_check: None,
        resend_timer: None,
    }))
}

struct PlanRequester {
    config: Config,
    mode: Mode,
    goals: BTreeMap<ConversationId, Goal>,
    ended: FinishedGoals,
    keeper: JournalClient<PlanRequester>,
    /// Background work that checks whether running plans could be replaced by much cheaper ones.
    cheaper_plan_check: Option<WorkHandle>,
    /// Timer until the next try to send outcomes for which there was no room in the outbox.
    resend_timer: Option<TimerId>,
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
        if !is_leading {
            self.resign(ctx);
        }
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        replication::handle_presence(self, presence, ctx);
        match presence {
            Presence::Left(resident) => self.bidder_left(&resident.agent, ctx),
            Presence::Joined(resident) if resident.agent == self.config.plan_executor => {
                self.executor_came(ctx);
            }
            Presence::Joined(resident) if self.keeper.journals().contains(&resident.agent) => {
                if self.keeper.is_leading() {
                    self.replicate_all(ctx);
                }
                self.reconsider_waiting(ctx);
            }
            Presence::Joined(resident) => self.send_missed_outcomes(resident, ctx),
        }
    }

    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        self.keeper.has_delivered()
    }

    fn answer_query(&mut self, resource: Resource, _ctx: &mut Context<Self>) -> Option<String> {
        if resource != Resource::Goals {
            return None;
        }
        let goals: Vec<_> = self.goals.values().map(Goal::status).collect();
        serde_json::to_string(&goals).ok()
    }
}

impl PlanRequester {
    // === requests ===

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let engagement = Participation::of(&message);
        let asked = match message.content_as::<Request>() {
            Ok(Request::Achieve(asked)) => asked,
            Ok(Request::SetMode(SetMode { mode })) => {
                self.mode = mode;
                let report = Report::new(Outcome::Done, format!("plans are {mode} from now on"));
                return ctx.answer(&engagement, Performative::Confirm, &report);
            }
            Ok(Request::Keep(Keeping { records })) if message.sender == *ctx.id() => {
                return self.receive_handover(&message, records, ctx);
            }
            Ok(_) => {
                let detail = "a Plan Requester takes goals: `achieve`, and the flow: `set-mode`";
                return ctx.refuse(&engagement, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        if let Some(goal) = self.goals.get_mut(&engagement.conversation)
            && goal.is_asked_again(&engagement, &asked)
        {
            goal.engagement = engagement;
            let report = match goal.phase {
                GoalPhase::Holding => failover::holding(),
                _ => Report::new(Outcome::Progress, "accepted before; it goes on"),
            };
            return ctx.answer(&goal.engagement, Performative::Confirm, &report);
        }
        if let Some(report) = self.ended.of(&engagement) {
            return ctx.answer(&engagement, Performative::Confirm, report);
        }
        match self.admissible(&asked, &engagement) {
            Ok(condition) => {
                self.take_place(&message, &asked, ctx);
                let mut goal = Goal::new(engagement, message.incarnation, asked, condition);
                goal.add_history(ctx.router().host_services().wall_clock(), None, "asked for");
                let id = goal.conversation().clone();
                tracing::info!(conversation = %id, goal = goal.text, "a goal");
                self.goals.insert(id.clone(), goal);
                self.replicate_new_goal(&id, ctx);
                self.consider(&id, ctx);
            }
            Err((reason, detail)) => ctx.refuse(&engagement, reason, detail),
        }
    }

    /// Cancels the goals that an earlier incarnation of the sender requested and that the new request
    /// `asked` repeats. The earlier incarnation can no longer receive the outcomes of these goals or
    /// cancel them, so the new goal replaces them.
    fn take_place(&mut self, message: &Message, asked: &Achieve, ctx: &mut Context<Self>) {
        let (by, life) = (&message.sender, message.incarnation);
        let former = self.goals.iter().filter(|(_, goal)| goal.is_asked_anew(by, life, asked));
        let former: Vec<_> = former.map(|(id, _)| id.clone()).collect();
        for id in former {
            tracing::info!(conversation = %id, "its asker was restarted and asks again");
            self.cancel(&id, ctx);
        }
    }

    fn admissible(
        &self,
        asked: &Achieve,
        engagement: &Participation,
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
        if self.goals.contains_key(&engagement.conversation) {
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
        let is_here = self.goals.contains_key(id);
        self.cancel(id, ctx);
        // A `cancel` within the goal's own exchange gets the goal's final report and needs no answer of
        // its own. Only a sender that opens an exchange for the `cancel` is answered here.
        let other = message.opens_exchange().then(|| Participation::of(&message));
        if !is_here {
            let unknown = || format!("there is no goal `{id}`");
            other.iter().for_each(|other| ctx.refuse(other, Reason::Unknown, unknown()));
            return;
        }
        // Confirmed only when it is on record: then a standby that takes over cancels the goal too.
        self.replicate_cancellation(id, ctx, move |ctx| {
            let report = Report::new(Outcome::Cancelled, "the goal is given up");
            other.iter().for_each(|other| ctx.answer(other, Performative::Confirm, &report));
        });
    }

    fn cancel(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.add_history(ctx.router().host_services().wall_clock(), None, "cancelled");
        match &goal.phase {
            GoalPhase::Executing(token) => {
                let token = token.clone();
                goal.phase = GoalPhase::Cancelling(token.clone());
                let executor = self.config.plan_executor.clone();
                ctx.send_turn(&token, &executor, Performative::Cancel, serde_json::Value::Null);
                ctx.extend(&token, ctx.settings().answer_deadline * 2);
            }
            GoalPhase::Preempted(token) => goal.phase = GoalPhase::Cancelling(token.clone()),
            GoalPhase::Cancelling(_) => (),
            GoalPhase::Planning(token) => {
                let (token, planner) = (token.clone(), self.config.planning_agent.clone());
                ctx.send_turn(&token, &planner, Performative::Cancel, serde_json::Value::Null);
                ctx.close(&token);
                self.end(id, Outcome::Cancelled, "cancelled as asked", ctx);
            }
            _ => self.end(id, Outcome::Cancelled, "cancelled as asked", ctx),
        }
    }

    // === considering ===

    /// Checks whether a goal holds. If the goal does not hold, and no other goal comes first, plans for
    /// it.
    fn consider(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        if let Some(why) = self.missing_quorum(id, ctx) {
            return self.wait_for_quorum(id, why, ctx);
        }
        if !self.is_its_turn(id) {
            return;
        }
        if self.is_still_blocked(id, ctx.now()) {
            return self.schedule_next(ctx);
        }
        let asked = ctx.ask(Resource::Domain, &self.config.domain_maintainer);
        let considered = id.clone();
        let work = ctx.run(asked, move |requester: &mut Self, answers, ctx| {
            let snapshot = answers.first().and_then(|bytes| serde_json::from_slice(bytes).ok());
            match snapshot {
                Some(snapshot) => requester.domain_fetched(&considered, snapshot, ctx),
                None => {
                    let why = "no Domain Maintainer answers".to_owned();
                    requester.wait(&considered, why, ASK_AGAIN, ctx);
                }
            }
        });
        if let Some(goal) = self.goals.get_mut(id) {
            if let Some(timer) = goal.timer.take() {
                ctx.cancel_timer(timer);
            }
            goal.phase = GoalPhase::FetchingDomain(work);
            goal.is_request_stale = false;
        }
    }

    fn domain_fetched(&mut self, id: &ConversationId, snapshot: Snapshot, ctx: &mut Context<Self>) {
        let known = match PlanningSnapshot::read(snapshot) {
            Ok(known) => known,
            Err(problem) => return self.end(id, Outcome::Failed, problem, ctx),
        };
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.compare_with(&known.offers);
        let known = known.without_avoided(goal.avoided(ctx.now()));
        if goal.rounds == 0
            && let Some(problem) = wrong_in(goal, &known)
        {
            if goal.in_warm_up(ctx.now()) {
                return self.wait(id, problem, ASK_AGAIN, ctx);
            }
            return self.end(id, Outcome::Failed, problem, ctx);
        }
        match known.open_conjuncts(&goal.condition) {
            Ok(open) if open.is_empty() => self.satisfied(id, ctx),
            Ok(_) if goal.rounds > 0 && !self.config.replanning => {
                self.end(
                    id,
                    Outcome::Failed,
                    "it does not hold any more, and replanning is off",
                    ctx,
                );
            }
            Ok(open) => {
                goal.holds_reported = false;
                if goal.rounds > 0
                    && let Some(lost) = lost_to(goal, &known)
                {
                    goal.planning_mode = scheduling::PlanningMode::default();
                    self.report_changes(id, &known, &open, ctx);
                    return self.no_plan(id, lost, ctx);
                }
                let known = known.without_agents(&self.agents_in_use(id));
                if self.wait_if_all_in_use(id, &known, ctx) {
                    return;
                }
                match self.mode {
                    Mode::Centralized => self.ask_planner(id, known, open, ctx),
                    Mode::Decentralized => self.call_for_proposals(id, known, open, ctx),
                }
            }
            Err(problem) => self.end(id, Outcome::Failed, problem, ctx),
        }
    }

    fn satisfied(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.failures = 0;
        goal.planning_mode = scheduling::PlanningMode::default();
        match goal.keep {
            Keep::Achieve => {
                let detail = if goal.rounds == 0 { "it holds already" } else { "the goal holds" };
                self.end(id, Outcome::Done, detail, ctx);
            }
            Keep::Maintain => {
                goal.phase = GoalPhase::Holding;
                goal.no_plan_because.clear();
                let was_planned_for = goal.plan.take().is_some();
                let news = !std::mem::replace(&mut goal.holds_reported, true);
                if news {
                    self.send_report(id, failover::holding(), ctx);
                }
                if was_planned_for {
                    // A replica that takes over does not need this plan.
                    self.forget_plan(id, ctx);
                }
                self.recheck_within(id, RECHECK_INTERVAL, ctx);
                self.schedule_next(ctx);
            }
        }
    }

    // === waiting ===

    /// Handles a plan that failed or could not be made: plans for the goal again after the time `wait`,
    /// or gives the goal up.
    fn retry(&mut self, id: &ConversationId, why: String, wait: Duration, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        goal.failures += 1;
        let gives_up = goal.keep == Keep::Achieve && goal.failures >= FAILURES_MAX;
        if gives_up || !self.config.replanning {
            let detail = format!("given up after {} plans: {why}", goal.rounds);
            return self.end(id, Outcome::Failed, detail, ctx);
        }
        // The first retries are immediate. Later ones back off, so that a permanent fault does not load
        // the machine.
        let backoff = Duration::from_millis(100 << goal.failures.min(6)) * goal.failures.min(1);
        let wait = if goal.failures <= 3 { wait } else { wait.max(backoff) };
        self.send_report(id, Report::new(Outcome::Progress, format!("planning anew: {why}")), ctx);
        self.wait(id, why, wait, ctx);
    }

    /// Makes a goal wait for the time `wait`, and then considers it again. Other goals may be planned
    /// for meanwhile.
    fn wait(&mut self, id: &ConversationId, why: String, wait: Duration, ctx: &mut Context<Self>) {
        let considered = id.clone();
        let timer = ctx.after(wait, move |requester: &mut Self, ctx| {
            if let Some(goal) = requester.goals.get_mut(&considered) {
                goal.timer = None;
            }
            requester.consider(&considered, ctx);
        });
        if let Some(goal) = self.goals.get_mut(id) {
            if let Some(earlier) = goal.timer.replace(timer) {
                ctx.cancel_timer(earlier);
            }
            goal.phase = GoalPhase::WaitingForChange(why);
        }
        self.schedule_next(ctx);
    }

    /// Handles that planning found no plan for a goal. While news may still be on their way, plans once
    /// more. After that a goal that is to be achieved once ends; a kept goal waits until the ecosystem
    /// changes, or until a failed action may be tried again.
    fn no_plan(&mut self, id: &ConversationId, why: String, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        if std::mem::take(&mut goal.is_request_stale) {
            // The search used a state of the world that is out of date.
            return self.wait(id, why, SETTLE_DELAY, ctx);
        }
        let now = ctx.now();
        let chance = goal.next_chance(now);
        if chance.is_none() && self.config.replanning {
            // An agent may know facts about itself that have not arrived here yet. An agent that could
            // reach the goal may be absent for a moment.
            let patience = ANNOUNCEMENT_DELAY.max(ctx.settings().grace);
            let rest = patience.saturating_sub(now - *goal.no_plan_since.get_or_insert(now));
            if !rest.is_zero() || goal.in_warm_up(now) {
                return self.wait(id, why, rest.max(ASK_AGAIN), ctx);
            }
        }
        match (goal.keep, chance) {
            (Keep::Achieve, None) => self.end(id, Outcome::Failed, why, ctx),
            (Keep::Achieve, Some(_))
                if !self.config.replanning || goal.failures >= FAILURES_MAX =>
            {
                self.end(id, Outcome::Failed, why, ctx);
            }
            (_, chance) => {
                if goal.no_plan_because != why {
                    goal.no_plan_because.clone_from(&why);
                    let detail = format!("no plan now: {why}; waiting for the ecosystem to change");
                    self.send_report(id, Report::new(Outcome::Progress, detail), ctx);
                }
                let wait =
                    chance.map_or(RECHECK_INTERVAL, |chance| RECHECK_INTERVAL.min(chance - now));
                self.wait(id, why, wait, ctx);
            }
        }
    }

    // === reports ===

    fn send_report(&mut self, id: &ConversationId, report: Report, ctx: &mut Context<Self>) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        tracing::info!(conversation = %id, outcome = %report.outcome, detail = report.detail, "goal");
        let now = ctx.router().host_services().wall_clock();
        goal.add_history(now, Some(report.outcome), report.detail.as_str());
        let told = ctx.try_answer(&goal.engagement, Performative::Confirm, &report);
        if !report.outcome.is_final() {
            if let Err(why) = told {
                tracing::debug!(conversation = %id, %why, "a progress report could not be sent");
            }
            return self.replicate_goal(id, ctx);
        }
        if let Err(why) = told {
            tracing::info!(conversation = %id, %why, "the final report is sent later");
            self.ended.queue_unsent(goal.engagement.clone(), report);
            self.schedule_resend(ctx);
        }
    }

    /// Sends the outcome of a goal to its initiator: at once, or as soon as there is room in the
    /// outbox.
    fn send_or_queue(&mut self, to: &Participation, report: Report, ctx: &mut Context<Self>) {
        if ctx.try_answer(to, Performative::Confirm, &report).is_err() {
            self.ended.queue_unsent(to.clone(), report);
            self.schedule_resend(ctx);
        }
    }

    /// Starts the timer after which outcomes that are still unsent are sent.
    fn schedule_resend(&mut self, ctx: &mut Context<Self>) {
        if self.resend_timer.is_none() {
            self.resend_timer = Some(ctx.after(TELL_AGAIN, |requester: &mut Self, ctx| {
                requester.resend_timer = None;
                requester.resend_unsent(ctx);
            }));
        }
    }

    fn resend_unsent(&mut self, ctx: &mut Context<Self>) {
        while let Some((engagement, report)) = self.ended.pop_unsent() {
            if ctx.try_answer(&engagement, Performative::Confirm, &report).is_err() {
                self.ended.queue_unsent(engagement, report);
                return self.schedule_resend(ctx);
            }
        }
    }

    fn end(
        &mut self,
        id: &ConversationId,
        outcome: Outcome,
        detail: impl Into<String>,
        ctx: &mut Context<Self>,
    ) {
        let report = Report::new(outcome, detail);
        self.send_report(id, report.clone(), ctx);
        if let Some(goal) = self.goals.remove(id) {
            if matches!(goal.phase, GoalPhase::Verifying(_)) {
                self.release_agents(id);
            }
            let history = goal.history().to_vec();
            self.ended.store_sent(goal.engagement.clone(), Report { history, ..report.clone() });
            self.replicate_outcome(&goal, report, ctx);
            if let Some(timer) = goal.timer {
                ctx.cancel_timer(timer);
            }
            if let GoalPhase::CollectingProposals(call) = goal.phase {
                call.reject_all("the goal has ended", ctx);
            }
        }
        self.schedule_next(ctx);
    }

    // === changes of the world ===

    /// Handles a change of the world: a goal that held may not hold now, and a waiting goal may have a
    /// plan.
    fn informed(&mut self, message: Message, ctx: &mut Context<Self>) {
        if message.sender != self.config.domain_maintainer {
            return;
        }
        let Ok(Inform::Epoch(change)) = message.content_as::<Inform>() else { return };
        let agents_changed = !change.joined.is_empty() || !change.left.is_empty();
        let mut concerned = Vec::new();
        // When planning for one goal ends, the next goal is taken up from there.
        let is_busy = self.goals.values().any(|goal| goal.phase.is_planning());
        for (id, goal) in &mut self.goals {
            change.joined.iter().for_each(|agent| goal.reset_backoffs(agent));
            if agents_changed {
                goal.blocked_by_agents = None;
                goal.is_request_stale = goal.phase.is_planning();
                goal.no_plan_since = None;
            }
            let is_concerned = match goal.phase {
                GoalPhase::Queued => !is_busy,
                GoalPhase::WaitingForChange(_) | GoalPhase::Holding => true,
                // A change of state does not free the agents that other goals use.
                GoalPhase::WaitingForAgents(_) => agents_changed,
                _ => false,
            };
            if is_concerned {
                concerned.push(id.clone());
            }
        }
        for id in concerned {
            self.recheck_soon(&id, ctx);
        }
        self.check_for_cheaper_plans(&change.joined, ctx);
    }

    fn recheck_soon(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        self.recheck_within(id, SETTLE_DELAY, ctx);
    }

    fn recheck_within(&mut self, id: &ConversationId, wait: Duration, ctx: &mut Context<Self>) {
        let considered = id.clone();
        let timer = ctx.after(wait, move |requester: &mut Self, ctx| {
            if let Some(goal) = requester.goals.get_mut(&considered) {
                goal.timer = None;
            }
            requester.consider(&considered, ctx);
        });
        if let Some(goal) = self.goals.get_mut(id)
            && let Some(earlier) = goal.timer.replace(timer)
        {
            ctx.cancel_timer(earlier);
        }
    }
}

/// Returns the errors that checking a goal against the composite domain finds.
fn errors_in(goal: &Goal, known: &PlanningSnapshot) -> Vec<pddl::Diagnostic> {
    let diagnostics = pddl::check::check_condition(&known.domain, &known.problem, &goal.condition);
    diagnostics.into_iter().filter(pddl::Diagnostic::is_error).collect()
}

/// Returns, as text for a person, the parts of a goal that were valid before and are not valid now,
/// because the agent that declared the names in them has left. `None` if there are no such parts.
fn lost_to(goal: &Goal, known: &PlanningSnapshot) -> Option<String> {
    let errors = errors_in(goal, known);
    let lost: Vec<_> = errors.iter().map(|error| error.message.as_str()).collect();
    (!lost.is_empty()).then(|| format!("{}: its agent is not here", lost.join(", ")))
}

/// Returns, as text for a person, the errors that checking a goal against the composite domain finds;
/// `None` if there are none.
fn wrong_in(goal: &Goal, known: &PlanningSnapshot) -> Option<String> {
    let errors = errors_in(goal, known);
    if errors.is_empty() {
        let both = known.contradiction(&goal.condition)?;
        return Some(format!("it can never hold: it requires `{both}` and `(not {both})`"));
    }
    let lines: Vec<_> = errors.iter().map(|error| error.located(&goal.text)).collect();
    Some(lines.join("\n"))
}
